//! The appendix: everything that proves or explains the plan and that nobody needs beside the machine.

use super::ReportInput;
use super::chart;
use super::markup::{area, duration, escape, nonzero, number, percent, prose, triple};
use super::views::swatch;
use super::words;
use crate::geometry::sort_descending;
use crate::planning::params::PlanParams;
use crate::planning::plan::{CandidateCounts, MissedCause, Obstruction, RiskReason, SetupId, Stability, share};
use crate::planning::sequence::{Leg, Sequence};
use crate::planning::verdict::Rejection;
use crate::rendering::{Ink, MissGroup};
use crate::wire::plan::{AtRiskDocument, CoverageDocument, RiskReasonDocument, StabilityDocument};
use crate::wire::words::{
    EXPECTED_ERROR_IS, HeadlineShare, MEANING_OF_INDEPENDENT, advice_sentence, apart_mm, asked_name, by_thousands,
    changed_params, counted, headline as headline_shares, risk_meaning, turn_phrase,
};

/// Max spots listed for each cause.
const SPOTS_LISTED: usize = 3;
/// Moves up to which their table is open.
const OPEN_ROWS: usize = 24;
/// Max pairs of blocking bodies listed.
const OBSTRUCTIONS_LISTED: usize = 10;
/// Files that tell of every face and every spot.
const FILES_OF_MISSED: &str = "<code>coverage.csv</code> lists every face of the uploaded file with its measured share, the grade of most \
     of its measured area (<code>best_grade</code>: each point has the best grade that a view gives it), and the cause of most of its \
     missed area; <code>missed.json</code> lists every spot, and the views of every remedy.";

/// All sections of the appendix.
pub(super) fn sections(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    [
        "<section class=\"appendix\">\n<h2>Appendix</h2>\n".to_owned(),
        shares(&CoverageDocument::from(&plan.coverage)),
        curve(input),
        causes(input),
        at_risk(input),
        registration(input),
        order(input),
        obstructions(&plan.obstructions),
        settings(input),
        "</section>\n".to_owned(),
    ]
    .concat()
}

/// Table of the shares that head a plan, with the meaning of each denominator.
fn shares(coverage: &CoverageDocument) -> String {
    let row = |figure: &HeadlineShare| {
        format!(
            "<tr><td>{}{}</td><td class=\"n\">{}</td><td class=\"soft\">{}</td></tr>\n",
            figure.name,
            if figure.is_independent { ", independent" } else { "" },
            percent(figure.share),
            escape(figure.meaning)
        )
    };
    let rows: String = headline_shares(coverage).iter().map(row).collect();
    format!(
        "<h3>Coverage</h3>\n<div class=\"card scroll\"><table>\n<thead><tr><th>Share</th><th class=\"n\">Simulated</th><th>Meaning</th></tr></thead>\n\
         <tbody>\n{rows}</tbody></table></div>\n<p class=\"soft\" style=\"margin-top:8px\">Independent: on {MEANING_OF_INDEPENDENT}.</p>\n"
    )
}

/// Part on coverage after each view; empty if none is executed.
fn curve(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    let chart = chart::curve(&plan.coverage, &plan.views);
    if chart.is_empty() {
        return chart;
    }
    format!("<h3>Coverage after each view</h3>\n<div class=\"card narrow\">{chart}</div>\n")
}

/// Part on the causes of missed area; empty if nothing is missed.
fn causes(input: &ReportInput<'_>) -> String {
    let mut by_area: Vec<&MissedCause> = input.outcome.plan.missed.iter().collect();
    sort_descending(&mut by_area, |spot| spot.area_mm2);
    let rows: String = by_area.iter().map(|cause| missed_row(input, cause)).collect();
    if rows.is_empty() {
        return rows;
    }
    let asked = asked_name(input.outcome.plan.coverage.is_of_open);
    format!(
        "<h3>Causes of missed area</h3>\n<div class=\"card scroll\"><table>\n<thead><tr><th>Cause</th><th class=\"n\">Area</th>\
         <th class=\"n\">Of {asked}</th><th class=\"n\">Spots</th><th>Largest spots, centre in mm</th></tr></thead>\n\
         <tbody>\n{rows}</tbody></table></div>\n<p class=\"soft\" style=\"margin-top:8px\">{FILES_OF_MISSED}</p>\n"
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
         <td class=\"n\">{}</td><td class=\"soft\">{}</td></tr>\n",
        swatch(Ink::Missed(MissGroup::of(missed.cause))),
        words::cause_name(missed.cause),
        missed.cause.as_str(),
        words::cause_meaning(missed.cause, input.subject.scanner, &plan.params),
        area(missed.area_mm2),
        percent(share(missed.area_mm2, plan.coverage.asked_area_mm2)),
        number(missed.spots.len() as f64, 0),
        spots.join("<br/>")
    )
}

/// Part on measured area that a real scan may lack.
fn at_risk(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    let document = AtRiskDocument::from(&plan.coverage);
    let row = |(reason, found): (RiskReason, &RiskReasonDocument)| {
        format!(
            "<tr><td><b>{}</b> <code>{}</code></td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"soft\">{}</td></tr>\n",
            words::risk_name(reason),
            reason.as_str(),
            area(found.area_mm2),
            percent(found.of_visible),
            escape(&risk_meaning(reason, &plan.params.realism))
        )
    };
    let rows: String = RiskReason::ALL.into_iter().zip(&document.reasons).map(row).collect();
    let counts = if document.counted { "It counts as measured." } else { "It does not count as measured." };
    format!(
        "<h3>At risk in a real scan</h3>\n<p>{} of the area that the views measure in the simulation, {} of the visible \
         area, may be missing from a real scan. {counts} Surface that is at risk for several reasons is listed under each. The widths \
         behind it are our choice: they have no published source.</p>\n<div class=\"card scroll\"><table>\n<thead><tr><th>Reason</th>\
         <th class=\"n\">Area</th><th class=\"n\">Of visible</th><th>Meaning</th></tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n\
         ",
        area(document.area_mm2),
        percent(document.of_visible)
    )
}

/// Part on the registration of setups and views by shared surface; empty for a single view.
fn registration(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    let row = |name: String, stability: &Stability| {
        let document = StabilityDocument::from(stability);
        let error =
            document.expected_error_mm.map_or_else(|| "unbounded".to_owned(), |mm| format!("≥ {} µm", nonzero(1e3 * mm, 1)));
        format!(
            "<tr><td>{name}</td><td class=\"n\">{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{error}</td>\
             <td>{}</td></tr>\n",
            area(document.shared_area_mm2),
            document.weakest.replace('-', "−"),
            nonzero(document.resistance, 3),
            if document.fixed { "yes" } else { "no" }
        )
    };
    let pairs = plan.setup_links.iter().map(|link| {
        let [a, b] = link.setups.map(|setup| setup.0 + 1);
        row(format!("Setups {a} and {b}"), &link.stability)
    });
    let views = plan.setups.iter().enumerate().filter_map(|(number, setup)| {
        let ([a, b], stability) = setup.weakest_link.as_ref()?;
        Some(row(format!("Views {} and {}, the weakest link of setup {}", a.0, b.0, number + 1), stability))
    });
    let rows: String = pairs.chain(views).collect();
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "<h3>Registration by shared surface</h3>\n<p>Setups form one measurement only if they can be registered to each \
         other: the surface that both measure must constrain every motion of one relative to the other. Views of one setup \
         share one frame; their rows are for information. The error is a lower bound (1 σ): {EXPECTED_ERROR_IS}.</p>\n\
         <div class=\"card scroll\"><table>\n<thead><tr><th>Between</th><th class=\"n\">Shared</th><th>Weakest motion</th>\
         <th class=\"n\">Resistance</th><th class=\"n\">Expected error</th><th>All fixed</th></tr></thead>\n<tbody>\n{rows}</tbody>\
         </table></div>\n"
    )
}

/// Part on the order in which the views are visited; empty without a cell.
fn order(input: &ReportInput<'_>) -> String {
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
    // A long table would hide what follows it.
    let open = if rows.len() <= OPEN_ROWS { " open=\"open\"" } else { "" };
    format!(
        "<h3>Visiting order</h3>\n<p>From home through every view and back: {} of motion, in {} of which the table turns.</p>\n\
         <details class=\"fold\"{open}><summary>All moves</summary><div class=\"card scroll\"><table>\n<thead><tr><th class=\"n\">Stop</th>\
         <th>At</th><th class=\"n\">Turntable</th><th class=\"n\">Joints 1 to 6</th><th class=\"n\">Move</th>\
         <th class=\"n\">Via points</th></tr></thead>\n<tbody>\n{}</tbody></table></div></details>\n",
        duration(plan.sequences().map(Sequence::motion_secs).sum()),
        duration(plan.sequences().map(Sequence::turning_secs).sum()),
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

/// Part on the bodies that keep the cell from candidates; empty if there are none.
pub(super) fn obstructions(obstructions: &[Obstruction]) -> String {
    let rows: Vec<_> = obstructions.iter().take(OBSTRUCTIONS_LISTED).map(obstruction_row).collect();
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "<h3>What blocks the cell</h3>\n<p>Pairs of bodies whose collisions block viewpoints that were considered; \
         the pair that blocks most comes first. Distance and position are those at one of these viewpoints.</p>\n\
         <div class=\"card scroll\"><table>\n<thead><tr><th>Bodies</th><th class=\"n\">Without a station</th>\
         <th class=\"n\">Without a path</th><th class=\"n\">Distance</th><th class=\"n\">Position, base frame</th>\
         <th>What would help</th></tr></thead>\n<tbody>\n{}</tbody>\
         </table></div>\n{}",
        rows.concat(),
        unlisted_pairs(obstructions.len() - rows.len())
    )
}

/// Sentence on the pairs that the table has no row for; empty if it has all.
fn unlisted_pairs(pairs: usize) -> String {
    if pairs == 0 {
        return String::new();
    }
    let are = if pairs == 1 { "is" } else { "are" };
    format!("<p class=\"soft\" style=\"margin-top:8px\">{} {are} not listed.</p>\n", counted(pairs, "more pair"))
}

fn obstruction_row(obstruction: &Obstruction) -> String {
    let Obstruction { bodies, without_station, without_path, separation, advice, .. } = obstruction;
    let apart =
        separation.as_ref().map_or_else(|| "—".into(), |found| format!("{} mm", by_thousands(&apart_mm(found.distance_mm))));
    let place = separation.as_ref().map_or_else(|| "—".into(), |found| triple(found.place_in_base_mm.into(), 0));
    format!(
        "<tr><td>{}</td><td class=\"n\">{without_station}</td><td class=\"n\">{without_path}</td><td class=\"n\">{apart}</td>\
         <td class=\"n\">{place}</td><td>{}</td></tr>\n",
        escape(&bodies.to_string()),
        prose(&advice_sentence(advice))
    )
}

/// Part on candidates and on parameters that are not at their defaults.
fn settings(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    format!("<h3>How it was planned</h3>\n<p>{}</p>\n{}", considered(&plan.candidates), parameters(&plan.params))
}

/// Sentences on what became of the candidates.
fn considered(counts: &CandidateCounts) -> String {
    let [generated, kept] = [counts.generated, counts.kept].map(|count| number(count as f64, 0));
    let dropped =
        |(reason, count): (&Rejection, &usize)| format!("{} ({})", words::rejection_remark(*reason), number(*count as f64, 0));
    let dropped: Vec<String> = counts.rejected.iter().map(dropped).collect();
    let dropped = if dropped.is_empty() { String::new() } else { format!(" Dropped: {}.", dropped.join(", ")) };
    let viewpoints = if counts.generated == 1 { "viewpoint was" } else { "viewpoints were" };
    format!("{generated} {viewpoints} considered, {kept} of them usable.{dropped}")
}

/// Table of the parameters that are not at their defaults.
pub(super) fn parameters(params: &PlanParams) -> String {
    let row = |(key, value): &(String, String)| {
        format!("<tr><td><code>{}</code></td><td><code>{}</code></td></tr>\n", escape(key), escape(value))
    };
    let rows: String = changed_params(params).iter().map(row).collect();
    if rows.is_empty() {
        return "<p class=\"soft\">Every parameter has its default.</p>\n".to_owned();
    }
    format!(
        "<div class=\"card scroll\"><table>\n<thead><tr><th>Parameter, changed from its default or derived</th><th>Value</th></tr></thead>\n\
         <tbody>\n{rows}</tbody></table></div>\n"
    )
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::cell::{Contact, Presets, Separation, SpecLibrary};
    use crate::planning::plan::{Advice, Coverage};
    use crate::wire::words::MEANING_OF_OPEN;

    /// `best_grade` was told as the face's grade, and read as the best grade on it.
    #[test]
    fn the_grade_of_a_face_is_told_as_that_of_most_of_its_area() {
        assert!(
            FILES_OF_MISSED.contains("the grade of most of its measured area (<code>best_grade</code>:"),
            "{FILES_OF_MISSED}"
        );
    }

    /// "asked: every face outside excluded regions" was told of further views.
    #[test]
    fn what_is_asked_of_further_views_is_what_scans_left_open() {
        let told = |is_of_open: bool| shares(&CoverageDocument::from(&Coverage { is_of_open, ..Coverage::default() }));
        assert!(
            told(true).contains(MEANING_OF_OPEN) && !told(true).contains("every face outside excluded regions"),
            "{}",
            told(true)
        );
        let open = "<td>measured of open, independent</td>";
        assert!(told(true).contains(open) && !told(true).contains("of asked"), "{}", told(true));
        assert!(told(true).contains("<td>measured of coverable</td>"), "{}", told(true));
        assert!(told(true).contains("Independent: on samples that were not used to choose views."), "{}", told(true));
        assert!(told(false).contains("asked: every face outside excluded regions") && !told(false).contains(MEANING_OF_OPEN));
    }

    /// 4.96 mm were told as 5.0 mm, which is the clearance that they miss.
    #[test]
    fn a_distance_below_the_clearance_is_told_as_below_it() {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
        let row = |distance_mm: f64| {
            let bodies = Contact { a: "forearm".into(), b: "part".into() };
            let separation = Separation { bodies: bodies.clone(), distance_mm, place_in_base_mm: Point3::origin() };
            obstruction_row(&Obstruction {
                bodies,
                without_station: 1,
                without_path: 0,
                configuration: cell.home_rad,
                separation: Some(separation),
                advice: Advice::TurnPart,
            })
        };
        assert!(row(4.96).contains(">4.9 mm<") && row(-2.34).contains(">−2.3 mm<"), "{}{}", row(4.96), row(-2.34));
    }

    /// The table had 10 of 59 pairs and said nothing of the others.
    #[test]
    fn a_table_of_blocking_pairs_says_how_many_it_leaves_out() {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
        let pair = |number: usize| Obstruction {
            bodies: Contact { a: "forearm".into(), b: format!("guard {number}").into() },
            without_station: 1,
            without_path: 0,
            configuration: cell.home_rad,
            separation: None,
            advice: Advice::MoveFoot,
        };
        let told = |pairs: usize| obstructions(&(0..pairs).map(pair).collect::<Vec<_>>());
        assert!(told(59).ends_with(">49 more pairs are not listed.</p>\n"), "{}", told(59));
        assert!(told(11).ends_with(">1 more pair is not listed.</p>\n"), "{}", told(11));
        assert!(told(10).matches("<tr>").count() == 11 && !told(10).contains("not listed"), "{}", told(10));
        assert_eq!(told(0), "");
    }

    #[test]
    fn dropped_viewpoints_are_told_in_words() {
        let rejected = [(Rejection::BelowTable, 1778), (Rejection::BodyMeetsPart, 6)].into();
        let counts = CandidateCounts { generated: 5820, kept: 4036, rejected };
        let told = "5\u{202f}820 viewpoints were considered, 4\u{202f}036 of them usable. Dropped: below the plate (1\u{202f}778), the \
                    scanner’s body would meet the part (6).";
        assert_eq!(considered(&counts), told);
        let all = CandidateCounts { generated: 4, kept: 4, ..CandidateCounts::default() };
        assert_eq!(considered(&all), "4 viewpoints were considered, 4 of them usable.");
    }
}
