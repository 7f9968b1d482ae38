//! The sections of the page that are text, tables and bars.

use std::fmt::Write;

use super::ReportInput;
use super::chart;
use super::markup::{area, duration, escape, number, percent, triple};
use super::palette::{Ink, MissGroup};
use super::views::swatch;
use super::words;
use crate::planning::params::PlanParams;
use crate::planning::plan::{
    Cause, Drawn, Grade, MissedCause, MissedSpot, Obstruction, Remedy, RiskReason, Robust, SetupId, Stability, share,
};
use crate::planning::sequence::{Leg, Sequence};
use crate::wire::plan::{
    AdviceDocument, AtRiskDocument, CoverageDocument, RiskReasonDocument, RobustDocument, StabilityDocument,
};
use crate::wire::warnings::of_robust;
use crate::wire::words::{
    HeadlineShare, advice_sentence, changed_params, headline as headline_shares, risk_meaning, treated_spots, turn_phrase,
};

/// Max spots listed for each cause.
const SPOTS_LISTED: usize = 3;
/// Max pairs of blocking bodies listed.
const OBSTRUCTIONS_LISTED: usize = 10;
/// Number of characters shown of the file's digest.
const DIGEST_SHOWN: usize = 12;

/// Section on the bodies that keep the cell from candidates; empty if there are none.
pub(super) fn obstructions(input: &ReportInput<'_>) -> String {
    let rows: Vec<_> = input.outcome.plan.obstructions.iter().take(OBSTRUCTIONS_LISTED).map(obstruction_row).collect();
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "<section>\n<h2>What blocks the cell</h2>\n<p>Pairs of bodies whose collisions keep the cell from viewpoints that were \
         considered, the pair that blocks most first. Distance and position are those at one of these viewpoints.</p>\n\
         <div class=\"card scroll\"><table>\n<thead><tr><th>Bodies</th><th class=\"n\">Without a station</th>\
         <th class=\"n\">Without a path</th><th class=\"n\">Distance</th><th class=\"n\">Position, base frame</th>\
         <th>What would help</th></tr></thead>\n<tbody>\n{}</tbody>\
         </table></div>\n</section>\n",
        rows.concat()
    )
}

fn obstruction_row(obstruction: &Obstruction) -> String {
    let Obstruction { bodies, without_station, without_path, separation, advice, .. } = obstruction;
    let apart = separation.as_ref().map_or_else(|| "—".into(), |found| format!("{} mm", number(found.distance_mm, 1)));
    let place = separation.as_ref().map_or_else(|| "—".into(), |found| triple(found.place_in_base_mm.into(), 0));
    format!(
        "<tr><td>{}</td><td class=\"n\">{without_station}</td><td class=\"n\">{without_path}</td><td class=\"n\">{apart}</td>\
         <td class=\"n\">{place}</td><td>{}</td></tr>\n",
        escape(&bodies.to_string()),
        escape(&advice_sentence(advice))
    )
}

/// Header: the plan, its part and its hardware.
pub(super) fn header(input: &ReportInput<'_>) -> String {
    let part = &input.outcome.plan.part;
    let size = part.aabb.extent_mm();
    let digest: String = part.sha256.chars().take(DIGEST_SHOWN).collect();
    let size = [size.x, size.y, size.z].map(|edge_mm| number(edge_mm, 1)).join(" × ");
    let mut facts = vec![
        ("Size", format!("{size}\u{a0}mm")),
        ("Surface", format!("{} in {} triangles", area(part.area_mm2), number(part.triangles as f64, 0))),
        ("File, SHA-256", format!("<code title=\"{}\">{}…</code>", escape(&part.sha256), escape(&digest))),
        ("Scanner", escape(&input.scanner.name)),
        ("Cell", input.cell_name.map_or_else(|| "none: viewpoints only".into(), escape)),
    ];
    facts.extend(input.echo.part_number.iter().map(|number| ("Part number", escape(number))));
    facts.extend(input.echo.serial.iter().map(|serial| ("Serial number", escape(serial))));
    let labels: Vec<String> = input
        .echo
        .labels
        .iter()
        .map(|(name, value)| format!("<span class=\"chip\">{}: {}</span>", escape(name), escape(value)))
        .collect();
    if !labels.is_empty() {
        facts.push(("Labels", labels.join(" ")));
    }
    let facts: Vec<String> = facts.iter().map(|(name, value)| format!("<div><dt>{name}</dt><dd>{value}</dd></div>")).collect();
    format!(
        "<header>\n<p class=\"kind\">Scan plan</p>\n<h1>{}</h1>\n<dl class=\"facts\">{}</dl>\n</header>\n",
        escape(input.part_name),
        facts.concat()
    )
}

/// Section with the main figures and the limits of their validity.
pub(super) fn headline(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    let (coverage, visible) = (&plan.coverage, plan.coverage.independent.of_visible());
    let measuring = plan.views.iter().filter(|view| view.rejected.is_none()).count();
    let mut figures = vec![
        ("figure main", number(measuring as f64, 0), if measuring == 1 { "view" } else { "views" }),
        ("figure", number(f64::from(plan.bound.views_lower), 0), "lower bound on views"),
        ("figure main", percent(visible.measured), "of the visible area measured"),
        ("figure main", percent(visible.grades_a_b), "of the visible area at grade A or B"),
        ("figure", percent(visible.within[0]), "of it at 35° or less"),
        ("figure", percent(visible.within[1]), "of it at 60° or less"),
    ];
    let motion_secs: f64 = plan.sequences().map(Sequence::motion_secs).sum();
    if plan.sequences().next().is_some() {
        figures.push(("figure", duration(motion_secs), "moving"));
    }
    figures.extend(input.cycle_secs.map(|secs| ("figure", duration(secs), "cycle time")));
    let figures: Vec<String> = figures
        .iter()
        .map(|(class, value, name)| format!("<div class=\"{class}\"><b>{value}</b><span>{name}</span></div>"))
        .collect();
    format!(
        "<section>\n<div class=\"figures\">{}</div>\n{}{}<p style=\"margin-top:12px\"><b>Why the selection ended:</b> {} \
         Of the {} asked for, the viewpoints considered can measure {} (the coverable area).</p>\n\
         <div class=\"notice\"><p><b>This is simulated coverage, computed from the models of the part and of the scanner. \
         It is not a measurement.</b> Shiny, dark or transparent surfaces, and parts that differ from their model, give less. \
         The planner is not safety-rated: guarding, speed limits and emergency stops belong to the cell’s own safety \
         system.</p></div>\n</section>\n",
        figures.concat(),
        grades_bar(input),
        shares_table(&CoverageDocument::from(coverage)),
        words::stop(plan.stopped_because, &plan.params),
        area(coverage.asked_area_mm2),
        area(coverage.coverable_area_mm2),
    )
}

/// Table of the shares that head a plan, with the meaning of each denominator.
fn shares_table(coverage: &CoverageDocument) -> String {
    let row = |figure: &HeadlineShare| {
        format!(
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"soft keep\">{}</td></tr>\n",
            figure.name,
            percent(figure.share),
            escape(figure.meaning)
        )
    };
    let rows: String = headline_shares(coverage).iter().map(row).collect();
    format!(
        "<div class=\"card scroll\"><table>\n<thead><tr><th>Share</th><th class=\"n\">Simulated</th><th>Meaning</th></tr></thead>\n\
         <tbody>\n{rows}</tbody></table></div>\n"
    )
}

/// Bar of the asked area by grade, and the rest.
fn grades_bar(input: &ReportInput<'_>) -> String {
    let coverage = &input.outcome.plan.coverage;
    let grades = [(Grade::A, "A"), (Grade::B, "B"), (Grade::C, "C"), (Grade::D, "D")];
    let shares = grades
        .map(|(grade, name)| (grade, name, share(coverage.measured.grade_area_mm2[grade as usize], coverage.asked_area_mm2)));
    let (mut bar, mut legend, mut spoken) = (String::new(), String::new(), String::new());
    for (grade, name, share) in shares {
        let ink = Ink::Measured(grade);
        // Writing to a String cannot fail.
        let _ = write!(bar, "<i style=\"width:{:.3}%;background:{}\"></i>", share * 100.0, ink.hex());
        let _ = write!(legend, "<li>{}Grade {name} {}</li>", swatch(ink), percent(share));
        let _ = write!(spoken, "grade {name} {}, ", percent(share));
    }
    let missed = percent(1.0 - coverage.of_asked());
    format!(
        "<div class=\"bar\" role=\"img\" aria-label=\"Asked area: {spoken}not measured {missed}\">{bar}</div>\n\
         <ul class=\"legend\">{legend}<li><span class=\"swatch\" style=\"background:var(--well)\"></span>Not measured {missed}</li></ul>\n\
         <p class=\"soft\" style=\"margin-top:6px\">Shares of the asked area. The grade of a point says how squarely, and how \
         close to best focus, its best view sees it: A is close to the ideal, D is close to the scanner’s limits.</p>\n"
    )
}

/// Section on the independent check: coverage on samples that no view was chosen on, and under pose errors.
pub(super) fn certificate(input: &ReportInput<'_>) -> String {
    let coverage = &input.outcome.plan.coverage;
    let independent = &coverage.independent;
    let said = format!(
        "<section>\n<h2>Independent check</h2>\n<p>Because views are optimised on one set of samples, the share measured of \
         that set is slightly optimistic: {}. On {} independent samples the same views measure <b>{} of the asked area</b>, \
         {} of the whole surface.</p>\n",
        percent(coverage.of_asked()),
        number(independent.samples as f64, 0),
        percent(independent.of_asked()),
        percent(independent.of_total()),
    );
    let params = &input.outcome.plan.params;
    let under_errors = |robust: &Robust| fragile(params, robust) + &under_pose_errors(robust);
    said + &coverage.robust.as_ref().map_or_else(String::new, under_errors) + "</section>\n"
}

/// Coverage under pose errors.
fn under_pose_errors(robust: &Robust) -> String {
    let row = |name: &str, drawn: &Drawn| {
        let shares = [drawn.nominal, drawn.mean(), drawn.p5(), drawn.worst()]
            .map(|share| format!("<td class=\"n\">{}</td>", percent(share)));
        format!("<tr><td>{name}</td><td class=\"n\">{}</td>{}</tr>\n", number(drawn.draws() as f64, 0), shares.concat())
    };
    format!(
        "<p>Measured share of the asked area if poses are off by {}° about a random axis and by {}\u{a0}mm in a random \
         direction:</p>\n<div class=\"card scroll\"><table>\n\
         <thead><tr><th>Error of</th><th class=\"n\">Draws</th><th class=\"n\">Nominal</th>\
         <th class=\"n\">Mean</th><th class=\"n\">5th percentile</th><th class=\"n\">Worst</th></tr></thead>\n<tbody>\n{}{}{}</tbody></table></div>\n",
        number(robust.pose_error.angle_deg, 2),
        number(robust.pose_error.translation_mm, 2),
        row("Every view, independently", &robust.views),
        row("The part as a whole", &robust.part),
        row("The hand-eye calibration, the same in every view", &robust.hand_eye),
    )
}

/// Notice that the plan is fragile under pose errors; empty if it is not.
fn fragile(params: &PlanParams, robust: &Robust) -> String {
    of_robust(params, &RobustDocument::from(robust), "").map_or_else(String::new, |warning| {
        format!(
            "<div class=\"notice\" style=\"margin-bottom:12px\"><p><b>Fragile under pose errors</b> <code>{}</code>: \
             <code>{}</code> {}. What helps: {}.</p></div>\n",
            warning.code.as_str(),
            escape(&warning.pointer.trim_start_matches('/').replace('/', ".")),
            escape(&warning.detail),
            escape(&warning.remedy)
        )
    })
}

/// Section on advice for the plan as a whole; empty if there is none.
pub(super) fn advice(input: &ReportInput<'_>) -> String {
    let item =
        |advice: &AdviceDocument| format!("<li>{}<br/><code>{}</code></li>\n", escape(&advice.text), escape(&advice.options()));
    let items: String = AdviceDocument::all_of(&input.outcome.plan).iter().map(item).collect();
    if items.is_empty() {
        return String::new();
    }
    format!(
        "<section>\n<h2>What would measure more</h2>\n<p>Changes of the whole plan, each tried on the model: views were chosen for \
         it that the cell can take. “At least” holds for a plan with these parameters that meets its target.</p>\n\
         <ul class=\"card\">\n{items}</ul>\n</section>\n"
    )
}

/// Section on measured area that a real scan may lack.
pub(super) fn at_risk(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    let document = AtRiskDocument::from(&plan.coverage);
    let row = |(reason, found): (RiskReason, &RiskReasonDocument)| {
        format!(
            "<tr><td><code>{}</code></td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"soft keep\">{}</td></tr>\n",
            reason.as_str(),
            area(found.area_mm2),
            percent(found.of_visible),
            escape(&risk_meaning(reason, &plan.params.realism))
        )
    };
    let rows: String = RiskReason::ALL.into_iter().zip(&document.reasons).map(row).collect();
    let counts = if document.counted { "It counts as measured." } else { "It does not count as measured." };
    format!(
        "<section>\n<h2>At risk in a real scan</h2>\n<p>{} of the area that the views measure in the simulation, {} of the visible \
         area, may be lacking in a real scan. {counts} Surface that is at risk for several reasons is listed under each. The widths \
         behind it are our choice: they have no published source.</p>\n<div class=\"card scroll\"><table>\n<thead><tr><th>Reason</th>\
         <th class=\"n\">Area</th><th class=\"n\">Of visible</th><th>Meaning</th></tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n\
         </section>\n",
        area(document.area_mm2),
        percent(document.of_visible)
    )
}

/// Section on coverage after each view.
pub(super) fn curve(input: &ReportInput<'_>) -> String {
    format!(
        "<section>\n<h2>Coverage after each view</h2>\n<div class=\"card narrow\">{}</div>\n</section>\n",
        chart::curve(&input.outcome.plan.coverage)
    )
}

/// Section on missed area and its causes.
pub(super) fn missed(input: &ReportInput<'_>) -> String {
    let missed = &input.outcome.plan.missed;
    if missed.is_empty() {
        return "<section>\n<h2>What is missed</h2>\n<p>Nothing: all of the asked area is measured.</p>\n</section>\n".into();
    }
    let mut by_area: Vec<&MissedCause> = missed.iter().collect();
    by_area.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    let rows: Vec<String> = by_area.iter().map(|cause| missed_row(input, cause)).collect();
    format!(
        "<section>\n<h2>What is missed, and why</h2>\n<p>Each spot is listed under what stopped the view that came \
         closest to measuring it. Coordinates are the part’s own.</p>\n<div class=\"card scroll\"><table>\n<thead><tr><th>Cause</th>\
         <th class=\"n\">Area</th><th class=\"n\">Of asked</th><th class=\"n\">Spots</th><th>Largest spots, centre in mm</th></tr></thead>\n\
         <tbody>\n{}</tbody></table></div>\n{}<p class=\"soft\" style=\"margin-top:8px\"><code>coverage.csv</code> lists every face of the \
         uploaded file with its measured share, grade and cause; <code>missed.json</code> lists every spot, and the views of \
         every remedy.</p>\n</section>\n",
        rows.concat(),
        spots(input)
    )
}

/// Table of the largest spots with their remedies; empty if no remedy was searched for.
fn spots(input: &ReportInput<'_>) -> String {
    let treated = treated_spots(&input.outcome.plan.missed);
    if treated.is_empty() {
        return String::new();
    }
    let rows: Vec<String> = treated.iter().map(|(cause, spot, remedy)| spot_row(*cause, spot, remedy)).collect();
    format!(
        "<h3 style=\"margin-top:20px\">The largest spots, and what would help</h3>\n<p>For each spot, the cheapest remedy \
         that was simulated and measures at least 90 % of it; where none does, the cheapest that measures at least half, its \
         share first. Its views are in <code>plan.json</code>; to plan with them, put \
         their poses into <code>candidates.poses</code>.</p>\n<div class=\"card scroll\"><table>\n<thead><tr><th>Cause</th>\
         <th class=\"n\">Area</th><th class=\"n\">Centre in mm</th><th class=\"n\">Size in mm</th><th>Remedy</th></tr></thead>\n\
         <tbody>\n{}</tbody></table></div>\n",
        rows.concat()
    )
}

fn spot_row(cause: Cause, spot: &MissedSpot, remedy: &Remedy) -> String {
    let size = [spot.extent_mm.x, spot.extent_mm.y, spot.extent_mm.z].map(|edge_mm| number(edge_mm, 1)).join(" × ");
    format!(
        "<tr><td>{}{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{size}</td><td>{}</td></tr>\n",
        swatch(Ink::Missed(MissGroup::of(cause))),
        words::cause_name(cause),
        area(spot.area_mm2),
        triple(spot.centre_mm.into(), 1),
        words::remedy(remedy)
    )
}

fn missed_row(input: &ReportInput<'_>, missed: &MissedCause) -> String {
    let plan = &input.outcome.plan;
    let spots: Vec<String> = missed
        .spots
        .iter()
        .take(SPOTS_LISTED)
        .map(|spot| format!("{} at {}", area(spot.area_mm2), triple(spot.centre_mm.into(), 1)))
        .collect();
    format!(
        "<tr><td>{}<b>{}</b> <code>{}</code><br/><span class=\"soft\">{}</span></td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
         <td class=\"n\">{}</td><td class=\"soft keep\">{}</td></tr>\n",
        swatch(Ink::Missed(MissGroup::of(missed.cause))),
        words::cause_name(missed.cause),
        missed.cause.as_str(),
        words::cause_meaning(missed.cause, input.scanner, &plan.params),
        area(missed.area_mm2),
        percent(share(missed.area_mm2, plan.coverage.asked_area_mm2)),
        number(missed.spots.len() as f64, 0),
        spots.join("<br/>")
    )
}

/// Section on the registration of setups and views by shared surface; empty for a single view.
pub(super) fn registration(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    let row = |name: String, stability: &Stability| {
        let document = StabilityDocument::new(stability, input.scanner, &plan.params);
        let error = document.expected_error_mm.map_or_else(|| "unbounded".to_owned(), |mm| format!("{:.1} µm", 1e3 * mm));
        format!(
            "<tr><td>{name}</td><td class=\"n\">{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{error}</td>\
             <td>{}</td></tr>\n",
            area(document.shared_area_mm2),
            document.weakest,
            number(document.resistance, 3),
            if document.fixed { "yes" } else { "no" }
        )
    };
    let pairs = plan.setup_links.iter().map(|link| {
        let [a, b] = link.setups.map(|setup| setup.0 + 1);
        row(format!("Setups {a} and {b}"), &link.stability)
    });
    let views = plan.setups.iter().enumerate().filter_map(|(number, setup)| {
        let ([a, b], stability) = setup.weakest_link.as_ref()?;
        Some(row(format!("Views {} and {}, the worst joined of setup {}", a.0, b.0, number + 1), stability))
    });
    let rows: String = pairs.chain(views).collect();
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "<section>\n<h2>Registration by shared surface</h2>\n<p>Setups are one measurement only if they can be registered to each \
         other: the surface that both measure has to resist every motion of one against the other. Views of one setup share \
         the table's frame; theirs is information. The error is that of the scanner's noise alone (1 σ).</p>\n\
         <div class=\"card scroll\"><table>\n<thead><tr><th>Between</th><th class=\"n\">Shared</th><th>Weakest motion</th>\
         <th class=\"n\">Resistance</th><th class=\"n\">Expected error</th><th>All fixed</th></tr></thead>\n<tbody>\n{rows}</tbody>\
         </table></div>\n</section>\n"
    )
}

/// Section on the order in which the views are visited; empty without a cell.
pub(super) fn order(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    let label = |id| plan.views.iter().find(|view| view.id == id).map_or("", |view| view.label.as_str());
    let mut rows: Vec<String> = Vec::new();
    for (setup, sequence) in plan.sequences().enumerate() {
        if setup > 0 {
            let turn = plan.turn_into(SetupId::at(setup)).map_or_else(|| "turn it over".to_owned(), |turn| turn_phrase(&turn));
            rows.push(format!("<tr><td></td><td colspan=\"5\">Setup {}, from the first: {turn}.</td></tr>\n", setup + 1));
        }
        let visits = sequence.visits.iter().zip(1..);
        rows.extend(
            visits.map(|((view, leg), stop)| order_row(&stop.to_string(), &format!("View {} ({})", view.0, label(*view)), leg)),
        );
        rows.push(order_row("", "Home", &sequence.return_home));
    }
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "<section>\n<h2>Visiting order</h2>\n<p>From home through every view and back: {} of motion, in {} of which the table turns. \
         The order chosen takes {}; the lower bound over the stations and moves considered is {}. Stations were then moved \
         along the table's angle and rolled to shorten the moves.</p>\n\
         <div class=\"card scroll\"><table>\n<thead><tr><th class=\"n\">Stop</th><th>At</th><th class=\"n\">Turntable</th>\
         <th class=\"n\">Joints 1 to 6</th><th class=\"n\">Move</th><th class=\"n\">Via points</th></tr></thead>\n<tbody>\n{}</tbody>\
         </table></div>\n</section>\n",
        duration(plan.sequences().map(Sequence::motion_secs).sum()),
        duration(plan.sequences().map(Sequence::turning_secs).sum()),
        duration(plan.sequences().map(|sequence| sequence.ordered_secs).sum()),
        duration(plan.sequences().map(|sequence| sequence.lower_bound_secs).sum()),
        rows.concat()
    )
}

fn order_row(stop: &str, name: &str, leg: &Leg) -> String {
    let joints = leg.target.joints_rad.map(|joint| number(joint.to_degrees(), 1)).join(", ");
    format!(
        "<tr><td class=\"n\">{stop}</td><td>{name}</td><td class=\"n\">{}°</td><td class=\"n\">{joints}°</td><td class=\"n\">{}</td>\
         <td class=\"n\">{}</td></tr>\n",
        number(leg.target.table_angle_rad.to_degrees(), 1),
        duration(leg.duration_secs),
        leg.via_rad.len()
    )
}

/// Section on candidates and on parameters that are not at their defaults.
pub(super) fn settings(input: &ReportInput<'_>) -> String {
    let counts = &input.outcome.plan.candidates;
    let rejected: Vec<String> = counts.rejected.iter().map(|(reason, count)| format!("{} {count}", reason.as_str())).collect();
    let rejected = if rejected.is_empty() { String::new() } else { format!(" Dropped: {}.", rejected.join(", ")) };
    let rows: Vec<String> = changed_params(&input.outcome.plan.params)
        .iter()
        .map(|(key, value)| format!("<tr><td><code>{}</code></td><td><code>{}</code></td></tr>\n", escape(key), escape(value)))
        .collect();
    format!(
        "<section>\n<h2>How it was planned</h2>\n<p>{} viewpoints were considered, {} of them usable.{rejected}</p>\n<div class=\"card \
         scroll\"><table>\n<thead><tr><th>Parameter, changed from its default or derived</th><th>Value</th></tr></thead>\n\
         <tbody>\n{}</tbody></table></div>\n</section>\n",
        counts.generated,
        counts.kept,
        rows.concat()
    )
}

/// Footer: source of the numbers.
pub(super) fn footer(input: &ReportInput<'_>) -> String {
    format!(
        "<footer>\n<p>Written by Vantage {} from <code>plan.json</code>, which holds every number at full precision \
         (SHA-256 <code>{}</code>).</p>\n</footer>\n",
        env!("CARGO_PKG_VERSION"),
        escape(input.plan_sha256)
    )
}
