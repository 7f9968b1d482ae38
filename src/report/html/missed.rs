//! The section on what is missed: numbered spots in pictures, and what would help, one row for spots that the same fix mends.

use super::ReportInput;
use super::album::Album;
use super::markup::{area, escape, number, percent, triple, with_options};
use super::pictures::{self, SIDES};
use super::spots::{self, NumberedSpot};
use super::views::{figures, legend, swatch, together, unmeasured};
use super::words;
use crate::geometry::{Part, Pose, SimdLevel, Table};
use crate::planning::params::SelectionGoal;
use crate::planning::plan::{Cause, Plan, Remedy, RemedyKind, StopReason, share};
use crate::rendering::{Ink, MissGroup};
use crate::report::text::{UNSTABLE_POSE_KEPT, cell_remedy, keeps_unstable_pose};
use crate::wire::plan::{AdviceDocument, options};
use crate::wire::summary::{further_setup, own_plan_remark, stop_rules, turned_setup};
use crate::wire::warnings::FieldWarning;
use crate::wire::words::{
    ChoiceRules, RESCAN_WITHOUT_PATH, WITHOUT_PATH, asked_name, counted, partial_of_spots, rounded_down_deg, turn_phrase,
};

/// Spots that one fix mends.
struct FixGroup<'a> {
    /// Action in words.
    action: String,
    /// Parameters that do it, as options; may be empty.
    options: String,
    /// True if it mends anything; groups that do not come last.
    is_help: bool,
    /// Pose into which it turns the part: two may be turned to in the same words.
    table_from_part: Option<&'a Pose<Table, Part>>,
    numbers: Vec<usize>,
    area_mm2: f64,
    /// Remedies of the spots, as far as one was searched for and is the fix.
    remedies: Vec<&'a Remedy>,
}

impl FixGroup<'_> {
    /// The action, after the share of the spots that it measures where it does not work for each of them.
    fn told(&self) -> String {
        let is_partial = |remedy: &&Remedy| remedy.kind != RemedyKind::None && !remedy.works();
        if !self.is_help || !self.remedies.iter().any(is_partial) {
            return self.action.clone();
        }
        let measured_mm2: f64 = self.remedies.iter().map(|remedy| remedy.area_mm2).sum();
        let partial = partial_of_spots(self.numbers.len(), self.area_mm2, measured_mm2);
        format!("{}: {}", words::capitalised(&partial), words::uncapitalised(&self.action))
    }

    /// Options of the fix, with those that keep the choice of views from ending before the views of the remedies.
    fn all_options(&self, plan: &Plan) -> String {
        let rules = options(&stop_rules(plan, &self.remedies));
        [self.options.as_str(), rules.as_str()].into_iter().filter(|options| !options.is_empty()).collect::<Vec<_>>().join(" ")
    }
}

/// The section.
pub(super) fn section(input: &ReportInput<'_>, album: &mut Album, level: SimdLevel) -> String {
    let plan = &input.outcome.plan;
    let asked = asked_name(plan.coverage.is_of_open);
    if plan.missed.is_empty() {
        return format!("<section>\n<h2>What is missed</h2>\n<p>Nothing: all of the {asked} area is measured.</p>\n</section>\n");
    }
    let spots = spots::numbered(input);
    let missed_mm2: f64 = plan.missed.iter().map(|missed| missed.area_mm2).sum();
    let count: usize = plan.missed.iter().map(|missed| missed.spots.len()).sum();
    let pictures = numbered_pictures(input, album, &spots, level);
    let legend = legend(album, unmeasured(input, Ink::of_cause).into_iter().chain([Ink::ByOthers]), Ink::label);
    format!(
        "<section>\n<h2>What is missed, and how to fix it</h2>\n<p>On the samples that views are chosen on, {} of the {asked} area is missed: {} in {} {}. The part is shown in \
         grey; every missed spot has the colour of its cause, paler where something hides it from this side. Numbers are those \
         of the list below; a dashed ring marks a spot that none of the three sides shows.</p>\n{}{}{}{}</section>\n",
        percent(share(missed_mm2, plan.coverage.asked_area_mm2)),
        area(missed_mm2),
        number(count as f64, 0),
        if count == 1 { "spot" } else { "spots" },
        together(&pictures, &legend),
        advice(input),
        fixes(input, &spots),
        list(input, &spots)
    )
}

fn numbered_pictures(input: &ReportInput<'_>, album: &mut Album, spots: &[NumberedSpot<'_>], level: SimdLevel) -> String {
    let drawings = spots::drawings(input.outcome, spots, &pictures::seen_sides(input, album, level));
    let numbered = drawings.iter().zip(&SIDES).map(|(drawing, side)| pictures::misses(input, album, side, drawing));
    figures(&numbered.collect::<Vec<String>>())
}

/// Advice for the plan as a whole; empty if there is none.
fn advice(input: &ReportInput<'_>) -> String {
    let item = |advice: &AdviceDocument| format!("<li>{}<br/>{}</li>\n", escape(&advice.text), with_options(&advice.options()));
    let plan = &input.outcome.plan;
    let items: String = AdviceDocument::all_of(plan).iter().map(item).collect();
    if items.is_empty() {
        return String::new();
    }
    let adds_setup = plan.advice.iter().map(|advice| advice.table_from_part.is_some());
    let is_kept = keeps_unstable_pose(adds_setup, input.warnings);
    let kept = if is_kept { format!("<p>{}.</p>\n", words::capitalised(UNSTABLE_POSE_KEPT)) } else { String::new() };
    format!(
        "<h3>What would measure more, or better</h3>\n<p>Changes to the whole plan, each simulated with usable views. \
         The coverage is estimated on the low side, since a plan with these parameters chooses its views anew; it may take less time \
         or more.</p>\n<ul class=\"card list\">\n{items}</ul>\n{kept}"
    )
}

/// Table of the fixes, those that mend most first.
fn fixes(input: &ReportInput<'_>, spots: &[NumberedSpot<'_>]) -> String {
    let plan = &input.outcome.plan;
    let mut groups: Vec<FixGroup<'_>> = Vec::new();
    for spot in spots {
        let remedy = spot.spot.remedy.as_ref();
        let of_cell = cell_remedy(plan, (spot.cause, remedy), input.warnings);
        let of_cell = of_cell.map(|remedy| (words::capitalised(&remedy), String::new(), true));
        let remedy = remedy.filter(|_| of_cell.is_none());
        let fix = of_cell.unwrap_or_else(|| fix(spot, plan));
        add(&mut groups, (spot.number, spot.spot.area_mm2), fix, remedy);
    }
    // Stable: equal ones stay in the order of their largest spots.
    groups.sort_by(|a, b| b.is_help.cmp(&a.is_help).then(b.area_mm2.total_cmp(&a.area_mm2)));
    let row = |group: &FixGroup<'_>| {
        let options = group.all_options(plan);
        let options = if options.is_empty() { options } else { format!("<br/>{}", with_options(&options)) };
        format!(
            "<tr><td>{}{options}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>\n",
            with_options(&group.told()),
            ranges(&group.numbers),
            number(group.numbers.len() as f64, 0),
            percent(share(group.area_mm2, plan.coverage.asked_area_mm2))
        )
    };
    let rows: String = groups.iter().map(row).collect();
    let asked = asked_name(plan.coverage.is_of_open);
    format!(
        "<h3>Fixes for the spots</h3>\n<div class=\"card scroll\"><table>\n<thead><tr><th>Fix</th><th>Spots</th>\
         <th class=\"n\">Number</th><th class=\"n\">Of {asked}</th></tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n{}",
        unnumbered(input, spots)
    )
}

/// Adds a spot, by its number and area, to the group of those that the same action mends, with the part in the same pose; the remedy is
/// that of the spot if the action is it.
fn add<'a>(
    groups: &mut Vec<FixGroup<'a>>,
    (number, area_mm2): (usize, f64),
    (action, options, is_help): (String, String, bool),
    remedy: Option<&'a Remedy>,
) {
    let table_from_part = remedy.and_then(|remedy| remedy.table_from_part.as_ref());
    let is_same = |group: &FixGroup<'_>| group.action == action && group.table_from_part == table_from_part;
    let at = groups.iter().position(is_same).unwrap_or(groups.len());
    if at == groups.len() {
        let (numbers, remedies) = (Vec::new(), Vec::new());
        groups.push(FixGroup { action, options, is_help, table_from_part, numbers, area_mm2: 0.0, remedies });
    }
    groups[at].numbers.push(number);
    groups[at].remedies.extend(remedy);
    groups[at].area_mm2 += area_mm2;
}

/// Sentence on the spots without a number; empty if all have one.
fn unnumbered(input: &ReportInput<'_>, spots: &[NumberedSpot<'_>]) -> String {
    let plan = &input.outcome.plan;
    let all: usize = plan.missed.iter().map(|missed| missed.spots.len()).sum();
    if all <= spots.len() {
        return String::new();
    }
    let numbered_mm2: f64 = spots.iter().map(|spot| spot.spot.area_mm2).sum();
    let missed_mm2: f64 = plan.missed.iter().map(|missed| missed.area_mm2).sum();
    let of_asked = percent(share((missed_mm2 - numbered_mm2).max(0.0), plan.coverage.asked_area_mm2));
    let told = without_number(all - spots.len(), &of_asked, asked_name(plan.coverage.is_of_open));
    format!("<p class=\"soft\" style=\"margin-top:8px\">{told}</p>\n")
}

fn without_number(spots: usize, of_asked: &str, asked: &str) -> String {
    let (together, are) = if spots == 1 { ("", "is") } else { (" together", "are") };
    format!(
        "{} without a number, {of_asked} of the {asked} area{together}, {are} listed in <code>missed.json</code>.",
        counted(spots, "smaller spot")
    )
}

/// Fix of a spot: what to do, the options that do it beside rules that end the choice of views, and whether it is any help.
fn fix(spot: &NumberedSpot<'_>, plan: &Plan) -> (String, String, bool) {
    let told = |action: &str| (action.to_owned(), String::new(), true);
    match &spot.spot.remedy {
        Some(remedy) => match remedy.kind {
            RemedyKind::Setup => {
                let turn = remedy.turn.as_ref().map(turn_phrase);
                let action = words::capitalised(turn.as_deref().unwrap_or("turn it onto another side"));
                let set = turned_setup(plan, turn.as_deref(), &[remedy]);
                (format!("{action} and scan again{}", own_plan_remark(&set)), options(&set), true)
            }
            RemedyKind::View => {
                let rules = ChoiceRules::of(plan);
                (more_views(rules), String::new(), !rules.left_out_views())
            }
            RemedyKind::Roll => told(&posed("Add views with the scanner rolled", plan.coverage.is_of_open)),
            RemedyKind::Tilt => told(&posed("Add tilted views", plan.coverage.is_of_open)),
            RemedyKind::Standoff => told(&posed("Add views at another distance", plan.coverage.is_of_open)),
            RemedyKind::Limit => limits(remedy, plan.coverage.is_of_open),
            RemedyKind::None if spot.cause == Cause::Enclosed => {
                told("No view can see it: exclude it if it need not be measured (regions.exclude)")
            }
            RemedyKind::None => {
                ("No fix found: up to 8 of the views tried together see less than half of it".to_owned(), String::new(), false)
            }
        },
        None if matches!(spot.cause, Cause::ExcludedResting | Cause::FacesTable) => {
            let action = "Turn the part over: it stands on this surface, or the surface faces the table";
            (action.to_owned(), options(&further_setup(plan, None, None)), true)
        }
        None => (unsearched(spot.cause, plan.params.missed.remedies).to_owned(), String::new(), false),
    }
}

/// Action by which a plan takes the poses of views; a rescan takes none.
fn posed(action: &str, is_of_open: bool) -> String {
    let put = if is_of_open { "plan the part again with their poses in" } else { "put their poses into" };
    format!("{action}: {put} candidates.poses")
}

/// Action by which a plan chooses more of the views that it has: it changes the rule that ended the choice.
fn more_views(rules: ChoiceRules) -> String {
    let rules = match rules {
        ChoiceRules::Plan(rules) => rules,
        ChoiceRules::Rescan(stop) => return more_further_views(stop),
    };
    let action = match rules.ended_by {
        StopReason::NoPath => return words::capitalised(WITHOUT_PATH),
        StopReason::Growth => "Choose more views: lower selection.min_growth, as each adds less than that",
        StopReason::MaxViews => "Choose more views: raise selection.max_views",
        StopReason::NoGain => return format!("Choose more views: {}", rules.for_gain().trim_end_matches(',')),
        StopReason::Target | StopReason::RegionsUnmet => match rules.goal {
            SelectionGoal::BestCoverage => "Choose more views: raise selection.max_views",
            SelectionGoal::FewestViews | SelectionGoal::MinTime if rules.views_left == Some(0) => {
                "Choose more views: raise selection.target and selection.max_views"
            }
            SelectionGoal::FewestViews | SelectionGoal::MinTime => "Choose more views: raise selection.target",
        },
    };
    action.to_owned()
}

/// Action by which a rescan chooses more views: it changes the rule that ended the choice.
fn more_further_views(stop: StopReason) -> String {
    let action = match stop {
        StopReason::NoPath => return words::capitalised(RESCAN_WITHOUT_PATH),
        StopReason::Target => "Choose more views: plan the part again with a higher selection.target, at which the rescan ends",
        StopReason::MaxViews => "Choose more views: raise max_views of the rescan",
        StopReason::Growth => "Choose more views: lower min_gain of the rescan, as each is expected to add less than that",
        StopReason::NoGain | StopReason::RegionsUnmet => {
            "Choose more views: raise max_views of the rescan, or lower its min_gain"
        }
    };
    action.to_owned()
}

/// Says why no fix was searched for a spot.
fn unsearched(cause: Cause, remedies: u32) -> &'static str {
    match (cause, remedies) {
        (Cause::AtRisk, _) => {
            "No fix was searched for: views measure it, but area at risk does not count (realism.count_at_risk)"
        }
        (_, 0) => "No fix was searched for (missed.remedies = 0)",
        _ => "No fix was searched for: only the largest spots are tried",
    }
}

/// Fix by a larger limit, which a rescan does not take.
fn limits(remedy: &Remedy, is_of_open: bool) -> (String, String, bool) {
    let option = |name: &str, deg: Option<f64>| deg.map(|deg| format!("--set limits.{name}={:.1}", rounded_down_deg(deg)));
    let options = [option("camera_deg", remedy.camera_deg), option("projector_deg", remedy.projector_deg)];
    let options = options.into_iter().flatten().collect::<Vec<_>>().join(" ");
    if is_of_open {
        return (format!("Allow a larger angle of incidence: plan the part again with {options}"), String::new(), true);
    }
    (format!("Allow a larger angle of incidence ({options})"), options, true)
}

/// List of the numbered spots.
fn list(input: &ReportInput<'_>, spots: &[NumberedSpot<'_>]) -> String {
    let rows: String = spots.iter().map(|spot| row(spot, &input.outcome.plan, input.warnings)).collect();
    let asked = asked_name(input.outcome.plan.coverage.is_of_open);
    format!(
        "<h3>The largest spots</h3>\n<p>Each spot is listed under what stopped the view that came closest to measuring it. The \
         fix is the cheapest of those simulated that measures at least 90 % of the spot; if none does, the cheapest that \
         measures at least half, with that share stated first. Its views are in <code>plan.json</code>. Coordinates are the part’s own.</p>\n\
         <div class=\"card scroll\"><table class=\"spots\">\n<thead><tr><th class=\"n\">No.</th><th>Cause</th><th class=\"n\">Area</th>\
         <th class=\"n\">Of {asked}</th><th>Centre, size in mm</th><th>Fix</th></tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n"
    )
}

fn row(spot: &NumberedSpot<'_>, plan: &Plan, warnings: &[FieldWarning]) -> String {
    let extent_mm = &spot.spot.extent_mm;
    let of_cell = cell_remedy(plan, (spot.cause, spot.spot.remedy.as_ref()), warnings);
    let of_cell = of_cell.map(|remedy| escape(&words::capitalised(&remedy)));
    let told = |remedy: &Remedy| words::remedy(remedy, ChoiceRules::of(plan));
    let found = || spot.spot.remedy.as_ref().map_or_else(|| "—".to_owned(), told);
    let size = [extent_mm.x, extent_mm.y, extent_mm.z].map(|edge_mm| number(edge_mm, 1)).join(" × ");
    format!(
        "<tr><td class=\"n\"><b>{}</b></td><td>{}{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td>{}<br/>{size}</td>\
         <td>{}</td></tr>\n",
        spot.number,
        swatch(Ink::Missed(MissGroup::of(spot.cause))),
        words::cause_name(spot.cause),
        area(spot.spot.area_mm2),
        percent(share(spot.spot.area_mm2, plan.coverage.asked_area_mm2)),
        triple(spot.spot.centre_mm.into(), 1),
        of_cell.unwrap_or_else(found)
    )
}

/// Ascending numbers with runs joined: "1–4, 7, 9".
fn ranges(numbers: &[usize]) -> String {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for number in numbers {
        if let Some([_, last]) = runs.last_mut()
            && *last + 1 == *number
        {
            *last = *number;
        } else {
            runs.push([*number; 2]);
        }
    }
    let told = |[first, last]: &[usize; 2]| if first == last { first.to_string() } else { format!("{first}–{last}") };
    runs.iter().map(told).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;
    use crate::wire::words::PlanRules;

    #[test]
    fn runs_of_numbers_are_joined() {
        assert_eq!(ranges(&[1, 2, 3, 4, 7, 9, 10]), "1–4, 7, 9–10");
        assert_eq!((ranges(&[5]), ranges(&[])), ("5".to_owned(), String::new()));
    }

    #[test]
    fn more_views_are_asked_for_by_the_rule_that_ended_the_choice() {
        let told = |goal: SelectionGoal, ended_by: StopReason, views_left: Option<usize>| {
            more_views(ChoiceRules::Plan(PlanRules {
                goal,
                ended_by,
                views_left,
                min_gain_mm2: 0.0,
                is_priced: true,
                must_overlap: true,
            }))
        };
        let fewest = |ended_by: StopReason| told(SelectionGoal::FewestViews, ended_by, None);
        assert!(fewest(StopReason::Growth).contains("selection.min_growth"), "{}", fewest(StopReason::Growth));
        assert_eq!(fewest(StopReason::MaxViews), "Choose more views: raise selection.max_views");
        assert_eq!(fewest(StopReason::Target), "Choose more views: raise selection.target");
        let gained = "Choose more views: lower selection.view_cost_mm2_per_s, or ask for less shared surface (selection.overlap)";
        assert_eq!(fewest(StopReason::NoGain), gained);
        let full = told(SelectionGoal::MinTime, StopReason::Target, Some(0));
        assert_eq!(full, "Choose more views: raise selection.target and selection.max_views");
        for stopped_because in [StopReason::NoGain, StopReason::RegionsUnmet] {
            let best = told(SelectionGoal::BestCoverage, stopped_because, Some(0));
            assert!(!best.contains("selection.target"), "targets do not count: {best}");
        }
        let unworthy = fewest(StopReason::NoGain);
        assert!(unworthy.contains("selection.view_cost_mm2_per_s") && !unworthy.contains("selection.target"), "{unworthy}");
        let pathless = fewest(StopReason::NoPath);
        assert!(pathless.eq_ignore_ascii_case(WITHOUT_PATH), "a higher target replaces no view without a path: {pathless}");
    }

    /// A rescan was told to raise parameters of a plan, which it does not take.
    #[test]
    fn more_further_views_are_asked_for_by_the_rules_of_the_rescan() {
        let further = |stop: StopReason| more_views(ChoiceRules::Rescan(stop));
        assert_eq!(further(StopReason::MaxViews), "Choose more views: raise max_views of the rescan");
        assert!(further(StopReason::Growth).contains("lower min_gain of the rescan"), "{}", further(StopReason::Growth));
        assert!(further(StopReason::Target).contains("plan the part again with a higher selection.target"));
        for stop in StopReason::ALL {
            let told = further(stop);
            assert!(!told.contains("selection.max_views") && !told.contains("selection.min_growth"), "{told}");
        }
        let pathless = further(StopReason::NoPath);
        assert!(pathless.eq_ignore_ascii_case(RESCAN_WITHOUT_PATH), "none of its rules brings a path: {pathless}");
        let posed = [true, false].map(|is_of_open| posed("Add tilted views", is_of_open));
        assert_eq!(posed[0], "Add tilted views: plan the part again with their poses in candidates.poses");
        assert_eq!(posed[1], "Add tilted views: put their poses into candidates.poses");
        let remedy = Remedy {
            kind: RemedyKind::Limit,
            views: Vec::new(),
            table_from_part: None,
            turn: None,
            camera_deg: Some(60.0),
            projector_deg: None,
            area_mm2: 10.0,
            of_spot: 1.0,
            tried: 3,
        };
        let (action, options, _) = limits(&remedy, true);
        assert_eq!(options, "", "a rescan takes none");
        assert_eq!(action, "Allow a larger angle of incidence: plan the part again with --set limits.camera_deg=60.0");
    }

    /// Spots that two poses show were one row, with the options of the first pose.
    #[test]
    fn a_turn_in_the_same_words_into_another_pose_is_another_fix() {
        let remedies = [turned(1.0, 1.0), turned(2.0, 1.0), turned(1.0, 1.0)];
        let mut groups = Vec::new();
        for (number, remedy) in (1..).zip(&remedies) {
            let fix = ("Stand it on its back and scan again".to_owned(), String::new(), true);
            add(&mut groups, (number, 10.0), fix, Some(remedy));
        }
        let numbers: Vec<&[usize]> = groups.iter().map(|group| group.numbers.as_slice()).collect();
        assert_eq!(numbers, [&[1, 3][..], &[2]]);
    }

    /// Remedy that turns the part into a pose and measures such a share of a spot of 10 mm².
    fn turned(x_mm: f64, of_spot: f64) -> Remedy {
        Remedy {
            kind: RemedyKind::Setup,
            views: Vec::new(),
            table_from_part: Some(Pose::from_parts(Vector3::new(x_mm, 0.0, 0.0), UnitQuaternion::identity())),
            turn: None,
            camera_deg: None,
            projector_deg: None,
            area_mm2: 10.0 * of_spot,
            of_spot,
            tried: 3,
        }
    }

    /// "Turn it upside down … 15.94 %" was told of a turn that measures 54 % of that.
    #[test]
    fn a_fix_that_measures_too_little_of_its_spots_begins_with_the_share() {
        let told = |of_spots: &[f64], is_help: bool| {
            let remedies: Vec<Remedy> = of_spots.iter().map(|of_spot| turned(1.0, *of_spot)).collect();
            let mut groups = Vec::new();
            for (number, remedy) in (1..).zip(&remedies) {
                add(&mut groups, (number, 10.0), ("Turn it over".to_owned(), String::new(), is_help), Some(remedy));
            }
            groups[0].told()
        };
        assert_eq!(told(&[0.54], true), "Only 54 % of it, 5.40 mm²: turn it over");
        assert_eq!(told(&[0.54, 1.0], true), "Only 77 % of them, 15.4 mm²: turn it over");
        assert_eq!(told(&[0.899], true), "Only 89 % of it, 8.99 mm²: turn it over");
        assert_eq!((told(&[0.9, 1.0], true), told(&[0.54], false)), ("Turn it over".to_owned(), "Turn it over".to_owned()));
    }

    #[test]
    fn a_spot_without_a_search_says_why() {
        assert!(unsearched(Cause::Facing, 8).ends_with("only the largest spots are tried"));
        assert!(unsearched(Cause::Facing, 0).ends_with("(missed.remedies = 0)"));
        for remedies in [0, 8] {
            assert!(unsearched(Cause::AtRisk, remedies).ends_with("(realism.count_at_risk)"), "size is not the reason");
        }
    }

    #[test]
    fn spots_without_a_number_are_counted_in_one_and_in_many() {
        let listed = "listed in <code>missed.json</code>.";
        let one = without_number(1, "0.02 %", "asked");
        assert_eq!(one, format!("1 smaller spot without a number, 0.02 % of the asked area, is {listed}"));
        let two = without_number(2, "0.02 %", "asked");
        assert_eq!(two, format!("2 smaller spots without a number, 0.02 % of the asked area together, are {listed}"));
    }
}
