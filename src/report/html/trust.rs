//! The section on why the figures may be trusted: the independent check, poses that are off, bounds, the limits of the devices,
//! and hashes that tie the report to its files.

use super::ReportInput;
use super::markup::{duration, escape, number, percent, prose};
use super::sections::digest;
use crate::cell::CalibrationProvenance;
use crate::planning::params::{PlanParams, PoseErrorParams};
use crate::planning::plan::{Bound, Drawn, Plan, Robust};
use crate::planning::sequence::Sequence;
use crate::report::text::holds_grades;
use crate::wire::plan::{AtRiskDocument, RobustDocument};
use crate::wire::summary::rescan_ended;
use crate::wire::warnings::of_robust;
use crate::wire::words::{asked_name, at_risk_sentence, bounded_moves, counted, order_claim, pose_error_sizes};

/// The section.
pub(super) fn section(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    let robust = plan.coverage.robust.as_ref();
    let asked = asked_name(plan.coverage.is_of_open);
    let calibrated = input.subject.cell.and_then(|cell| cell.calibrated.as_ref());
    let robust = robust.map_or_else(String::new, |robust| {
        fragile(plan, robust)
            + &under_pose_errors(robust, asked, source_of(&robust.pose_error, calibrated))
            + moved_along(input.subject.cell.is_some())
    });
    format!(
        "<section>\n<h2>Why these figures can be trusted</h2>\n<h3>Independent check</h3>\n{}{robust}<h3>Bounds</h3>\n{}{}<h3>At risk</h3>\n\
         <p>{}; see the appendix.</p>\n<h3>Limits of the devices</h3>\n{}<h3>Files</h3>\n{}</section>\n",
        independent(input),
        bounds(input),
        order(input),
        escape(&at_risk_sentence(&AtRiskDocument::from(&plan.coverage))),
        devices(input),
        files(input)
    )
}

/// Coverage on samples that no view was chosen on.
fn independent(input: &ReportInput<'_>) -> String {
    let coverage = &input.outcome.plan.coverage;
    let independent = &coverage.independent;
    let asked = asked_name(coverage.is_of_open);
    format!(
        "<p>On the samples that the views were chosen on, they measure {} of the {asked} area; that figure may be slightly optimistic. \
         On {} independent samples the same views measure <b>{} of the {asked} area</b>, {} of the whole surface. The figures at the \
         top are those of the independent samples.</p>\n",
        percent(coverage.of_asked()),
        number(independent.samples as f64, 0),
        percent(independent.of_asked()),
        percent(independent.of_total()),
    )
}

fn bounds(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    let bound = &plan.bound;
    let grades = if bound.views_lower > 0 { grades_held(&plan.params) } else { "" };
    let proved = proved(bound, plan.executed_views() == plan.views.len()) + grades;
    let area = bound.of_asked_upper.zip(bound.gap_of_asked).map_or_else(String::new, |(upper, gap)| {
        format!(
            " On the samples that views are chosen on, no choice of the same number of views measures more than another {} of the \
             {} area: up to {} in total.",
            percent(gap),
            asked_name(plan.coverage.is_of_open),
            percent(upper)
        )
    });
    let ended = rescan_ended(plan).map_or_else(String::new, |ended| format!("The choice of views ended because {ended}. "));
    format!("<p>{}{proved}{area}</p>\n", escape(&ended))
}

/// Says that a bound is one of choices that hold the grades too; empty where the plan does not have to.
fn grades_held(params: &PlanParams) -> &'static str {
    if holds_grades(params) {
        " The bound also keeps the area at each grade (selection.max_grade_loss, selection.min_grade_a): fewer views may reach the target with worse grades."
    } else {
        ""
    }
}

/// Says how many views any choice needs for what the chosen ones measure, which is more than the plan does where some have no path.
/// Further views, of which none is computed, have a bound of 0.
fn proved(bound: &Bound, have_all_a_path: bool) -> String {
    if bound.views_lower == 0 {
        return "No lower bound on the number of views was computed.".to_owned();
    }
    let views = counted(bound.views_lower as usize, "view");
    match (bound.gap, have_all_a_path) {
        (0, true) => {
            format!(
                "No choice of fewer than {views} from the same viewpoints reaches this coverage: the number is proven optimal."
            )
        }
        (0, false) => format!(
            "No choice of fewer than {views} from the same viewpoints measures what the chosen views do, including those without a \
             path: the number is proven optimal."
        ),
        (gap, true) => {
            format!("At least {views} from the viewpoints considered are needed for this coverage; the plan has {gap} more.")
        }
        (gap, false) => format!(
            "At least {views} from the viewpoints considered are needed for what the chosen views measure, including those without a \
             path; {gap} more were chosen."
        ),
    }
}

/// Words in place of a bound of the cycle where the tour is empty.
const NO_ORDER: &str = "<p>No view is executed, so there is no order and no cycle to judge.</p>\n";

/// Bound of the cycle; empty without a cell.
fn order(input: &ReportInput<'_>) -> String {
    let plan = &input.outcome.plan;
    if plan.sequences().next().is_none() {
        return String::new();
    }
    if plan.visits().next().is_none() {
        return NO_ORDER.to_owned();
    }
    let sum = |secs: fn(&Sequence) -> f64| duration(plan.sequences().map(secs).sum());
    let moving_secs: f64 = plan.sequences().map(Sequence::motion_secs).sum();
    let lower_secs: f64 = plan.sequences().map(|sequence| sequence.moving_lower_secs).sum();
    let claim = order_claim(moving_secs, lower_secs).map_or_else(String::new, |claim| format!(": {claim}"));
    let moves = bounded_moves(plan.params.motion.corners);
    format!(
        "<p>The order as first found takes {} of motion; the lower bound over the stations and moves considered is {}. Stations \
         were then shifted in table angle and roll, after which the motion takes {}; the lower bound for these stations in any \
         order, {moves}, is {}{claim}. Every move was checked for collisions along its whole length.</p>\n",
        sum(|sequence| sequence.ordered_secs),
        sum(|sequence| sequence.lower_bound_secs),
        duration(moving_secs),
        duration(lower_secs)
    )
}

fn devices(input: &ReportInput<'_>) -> String {
    let (scanner, limits) = (input.subject.scanner, &input.outcome.plan.params.limits);
    let row = |device: &crate::cell::OpticalDevice| {
        let (deg, own_deg) = (limits.incidence_max_rad(device).to_degrees(), device.incidence_max_rad.to_degrees());
        format!(
            "<tr><td>{}</td><td class=\"n\">{} × {}</td><td class=\"n\">{}°</td><td class=\"n\">{}°</td></tr>\n",
            device.name.as_str(),
            number(device.lens.width_px, 0),
            number(device.lens.height_px, 0),
            number(deg, 1),
            number(own_deg, 1)
        )
    };
    let rows: String = scanner.devices.iter().map(row).collect();
    format!(
        "<div class=\"card scroll\"><table class=\"narrow\">\n<thead><tr><th>Device</th><th class=\"n\">Image, pixels</th>\
         <th class=\"n\">Max incidence here</th><th class=\"n\">Its own</th></tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n\
         <p class=\"soft\" style=\"margin-top:8px\">Working depth {} to {} mm, best focus at {} mm. A point counts as measured only if \
         both cameras and the projector see it within these limits.</p>\n",
        number(scanner.near_mm, 0),
        number(scanner.far_mm, 0),
        number(scanner.best_mm, 0)
    )
}

fn files(input: &ReportInput<'_>) -> String {
    let named = if input.subject.cell.is_some() { ", which every program of this plan names" } else { "" };
    let plan = match input.plan_sha256 {
        "" => String::new(),
        sha256 => format!("; of <code>plan.json</code> {}{named}", digest(sha256)),
    };
    format!("<p>SHA-256 of the part’s file: {}{plan}.</p>\n", digest(input.subject.part_sha256))
}

/// Coverage under pose errors, with the 5th percentile where some kind has draws enough for one.
fn under_pose_errors(robust: &Robust, asked: &str, source: &str) -> String {
    let kinds = [
        ("Every view, independently", &robust.views),
        ("The part and its support, as one", &robust.part),
        ("The hand-eye calibration, the same in every view", &robust.hand_eye),
    ];
    let tells_p5 = kinds.iter().any(|(_, drawn)| drawn.told_p5().is_some());
    let cell = |text: String| format!("<td class=\"n\">{text}</td>");
    let row = |(name, drawn): (&str, &Drawn)| {
        let [nominal, mean, worst] = [drawn.nominal, drawn.mean(), drawn.worst()].map(|share| cell(percent(share)));
        let p5 = if tells_p5 { cell(drawn.told_p5().map_or_else(|| "–".to_owned(), percent)) } else { String::new() };
        let draws = cell(number(drawn.draws() as f64, 0));
        format!("<tr><td>{name}</td>{draws}{nominal}{mean}{p5}{worst}</tr>\n")
    };
    let [angle_deg, shift_mm] = pose_error_sizes(&robust.pose_error);
    let p5 = if tells_p5 { "<th class=\"n\">5th percentile</th>" } else { "" };
    format!(
        "<h3>Coverage under pose errors</h3>\n<p>Measured share of the {asked} area if poses are off by {angle_deg}° about a random axis \
         and by {shift_mm}\u{a0}mm in a random direction{source}:</p>\n<div class=\"card scroll\"><table>\n\
         <thead><tr><th>Error of</th><th class=\"n\">Draws</th><th class=\"n\">Nominal</th><th class=\"n\">Mean</th>{p5}\
         <th class=\"n\">Worst of the draws</th></tr></thead>\n<tbody>\n{}</tbody></table></div>\n",
        kinds.map(row).concat()
    )
}

/// Says that the error is that of the cell's calibration; empty where it was given or is the default.
fn source_of(error: &PoseErrorParams, calibrated: Option<&CalibrationProvenance>) -> &'static str {
    if calibrated.is_some_and(|known| PoseErrorParams::of_calibration(known) == *error) {
        " (twice the standard deviations of the cell's calibration or twice its residuals, whichever are larger)"
    } else {
        ""
    }
}

/// Says what is off with the part; empty without a cell, where nothing carries it.
fn moved_along(has_cell: bool) -> &'static str {
    if !has_cell {
        return "";
    }
    "<p class=\"soft\" style=\"margin-top:8px\">The support is the plate, with the fixture if there is one: they are off \
     together with the part, as a wrong pose of the table puts them. A part that is put down wrongly shifts on the plate and \
     turns about the vertical only, which this includes.</p>\n"
}

/// Notice that the plan is fragile under pose errors; empty if it is not.
fn fragile(plan: &Plan, robust: &Robust) -> String {
    let stopped = (plan.coverage.is_of_open, plan.stopped_because);
    of_robust(&plan.params, &RobustDocument::from(robust), stopped, "").map_or_else(String::new, |warning| {
        format!(
            "<div class=\"notice\" style=\"margin-bottom:12px\"><p><b>Fragile under pose errors</b> <code>{}</code>: \
             <code>{}</code> {}. What to do: {}.</p></div>\n",
            warning.code.as_str(),
            escape(&warning.pointer.trim_start_matches('/').replace('/', ".")),
            escape(&warning.detail),
            prose(&warning.remedy)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_column_of_the_5th_percentile_is_left_out_where_no_kind_has_20_draws() {
        let drawn = |draws: usize| Drawn::new(0.97, vec![0.95; draws]);
        let table = |part_draws: usize| {
            let pose_error = PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 };
            let robust = Robust { pose_error, views: drawn(6), part: drawn(part_draws), hand_eye: drawn(12) };
            under_pose_errors(&robust, "asked", "")
        };
        let few = table(12);
        assert!(!few.contains("5th percentile") && !few.contains('–'), "{few}");
        assert!(few.contains("<td class=\"n\">6</td>") && few.contains("Worst of the draws"), "{few}");
        let many = table(20);
        assert!(many.contains("5th percentile") && many.matches("<td class=\"n\">–</td>").count() == 2, "{many}");
    }

    /// The error of a calibrated cell was told as if the user had asked for it.
    #[test]
    fn an_error_that_is_the_calibrations_says_so() {
        let calibrated: CalibrationProvenance = serde_json::from_value(serde_json::json!({
            "by": "vantage", "at": "2026-11-20T09:00:00Z", "calibration_id": "ab", "data_sha256": "cd", "rms_rotation_deg": 0.01,
            "rms_translation_mm": 0.1, "point_sd_mm": 0.05, "rotation_sd_deg": 0.005, "translation_sd_mm": 0.04
        }))
        .expect("a provenance");
        let of_calibration = PoseErrorParams::of_calibration(&calibrated);
        assert!(source_of(&of_calibration, Some(&calibrated)).contains("cell's calibration"));
        let own = PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 };
        assert_eq!([source_of(&own, Some(&calibrated)), source_of(&of_calibration, None)], ["", ""]);
    }

    /// "The part as a whole" was told of draws in which the plate moves along, and read as a part that is put down wrongly.
    #[test]
    fn an_error_of_the_part_says_what_moves_along() {
        let (pose_error, drawn) = (PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 }, || Drawn::new(0.97, vec![0.95; 12]));
        let table = under_pose_errors(&Robust { pose_error, views: drawn(), part: drawn(), hand_eye: drawn() }, "asked", "");
        assert!(table.contains("<td>The part and its support, as one</td>") && !table.contains("as a whole"), "{table}");
        assert!(moved_along(true).contains("The support is the plate") && moved_along(false).is_empty());
    }

    /// The number of further views was told to be proven optimal, or the plan to have so many more than 0.
    #[test]
    fn nothing_is_proved_of_a_number_of_views_without_a_bound() {
        for gap in [0, 4] {
            let told = proved(&Bound { gap, ..Bound::default() }, true);
            assert_eq!(told, "No lower bound on the number of views was computed.");
        }
    }

    #[test]
    fn a_bound_of_views_without_a_path_is_not_one_of_what_the_plan_reaches() {
        let told = |gap: u32, have_all_a_path: bool| {
            proved(&Bound { views_lower: 3, gap, of_asked_upper: None, gap_of_asked: None }, have_all_a_path)
        };
        assert!(told(0, true).starts_with("No choice of fewer than 3 views from the same viewpoints reaches this coverage:"));
        for gap in [0, 2] {
            let told = told(gap, false);
            assert!(told.contains("including those without a path") && !told.contains("this coverage"), "{told}");
        }
        assert!(told(2, true).ends_with("the plan has 2 more."), "{}", told(2, true));
    }
}
