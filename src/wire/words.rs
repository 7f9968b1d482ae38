//! Sentences and numbers as people read them, in JSON, reports and on pages alike.

use std::fmt::Write;

use serde_json::Value;

use crate::cell::{Contact, PoseSpec};
use crate::geometry::{Part, Pose, Table, sort_descending};
pub(crate) use crate::geometry::{counted, listed};
use crate::inspection::rescan::RescanStop;
use crate::planning::context::NoPlan;
use crate::planning::params::{Brightness, Corners, OverlapParams, PlanParams, PoseErrorParams, RealismParams, SelectionGoal};
use crate::planning::plan::Stability;
use crate::planning::plan::{
    Advice, Cause, MissedCause, MissedSpot, PartSide, Plan, RegionCoverage, Remedy, RemedyKind, RemedyView, RiskReason,
    StopReason, Turn, TurnKind, share,
};
use crate::planning::sequence::bound_gap;
use crate::planning::verdict::{MIN_RESISTANCE, Rejection};
use crate::wire::plan::{AtRiskDocument, CoverageDocument, RegionCoverageDocument, StabilityDocument};
use crate::wire::summary::choice_ended_by;

#[cfg(test)]
mod tests;

/// Max characters shown of a parameter's value.
const MAX_VALUE_CHARS: usize = 160;
/// Causes that are named where no plan is possible.
const NAMED_CAUSES: usize = 3;
/// Reason for which a region without samples does not reach its target.
pub(crate) const NOTHING_IN_REGION: &str = "it contains none of the asked surface";
/// Meaning of the expected error of a registration.
pub(crate) const EXPECTED_ERROR_IS: &str = "from independent noise alone, without errors of calibration and hand-eye";
/// Share that may be lacking of a whole, or be left of nothing: sums over samples are not exact to the last bit.
const SUM_SLACK: f64 = 1e-9;
/// Size from which on a number is told with a power of ten: areas of 1000 m² in mm², of which no cell has more.
const MAX_PLAIN: f64 = 1e9;
/// Share from which on a part of an area counts as all of it.
const ALL: f64 = 1.0 - SUM_SLACK;

/// Returns true for characters that no name may have: control characters, and those that turn the direction of the text after them (Unicode
/// Standard Annex 9: embeddings, overrides and isolates), by which a name would rearrange the sentence that it stands in.
#[must_use]
pub fn is_control(character: char) -> bool {
    character.is_control() || matches!(character, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Every parameter that differs from its default, by its dotted key in alphabetical order, with its value as JSON, cut
/// where it is long. Defaults that were resolved (`part.patch_edge_mm` …) are among them.
#[must_use]
pub fn changed_params(params: &PlanParams) -> Vec<(String, String)> {
    let mut changed = Vec::new();
    if let (Ok(value), Ok(default)) = (serde_json::to_value(params), serde_json::to_value(PlanParams::default())) {
        collect_changes("", &value, &default, &mut changed);
    }
    changed.sort();
    changed
}

fn collect_changes(key: &str, value: &Value, default: &Value, changed: &mut Vec<(String, String)>) {
    match (value, default) {
        (Value::Object(fields), Value::Object(defaults)) => {
            for (name, field) in fields {
                let dotted = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                collect_changes(&dotted, field, defaults.get(name).unwrap_or(&Value::Null), changed);
            }
        }
        _ if value != default => changed.push((key.into(), abridged(rounded(value).to_string()))),
        _ => {}
    }
}

/// The value with six significant digits in every number.
fn rounded(value: &Value) -> Value {
    match value {
        Value::Number(number) if number.is_f64() => {
            number.as_f64().and_then(|x| format!("{x:.5e}").parse::<f64>().ok()).map_or(Value::Null, Value::from)
        }
        Value::Array(items) => items.iter().map(rounded).collect(),
        Value::Object(fields) => Value::Object(fields.iter().map(|(key, field)| (key.clone(), rounded(field))).collect()),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => value.clone(),
    }
}

/// Cuts a long value: a list of a thousand faces says no more than its beginning.
fn abridged(text: String) -> String {
    match text.char_indices().nth(MAX_VALUE_CHARS) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

/// A share that heads a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadlineShare {
    /// Name, with its denominator.
    pub name: &'static str,
    /// The share, 0 to 1.
    pub share: f64,
    /// True if it is on samples that were not used to choose views.
    pub is_independent: bool,
    /// Meaning, in a sentence without a full stop.
    pub meaning: &'static str,
}

/// Name of the share that is known on the samples that views are chosen on alone.
pub(crate) const MEASURED_OF_COVERABLE: &str = "measured of coverable";
/// Meaning of a share that is independent.
pub(crate) const MEANING_OF_INDEPENDENT: &str = "samples that were not used to choose views";
/// Meaning of the coverable area where the reach of the cell is ignored.
pub(crate) const MEANING_OF_REACH_IGNORED: &str = "at least one viewpoint measures it, whether the robot reaches that or not";
/// Meanings of the shares up to an angle of incidence.
const MEANING_OF_35_DEG: &str = "measured at 35° or less between the normal and the ray to the origin of the scanner frame";
const MEANING_OF_60_DEG: &str = "measured at 60° or less between the normal and the ray to the origin of the scanner frame";
/// Meaning of the area that further views are planned for.
pub(crate) const MEANING_OF_OPEN: &str =
    "open: asked area that earlier scans left open, but for losses that no further view mends";

/// Name of the area that shares of a plan are of: what is asked of the part, or what earlier scans left open of that.
pub(crate) fn asked_name(is_of_open: bool) -> &'static str {
    if is_of_open { "open" } else { "asked" }
}

/// Phrase for that area at the end of a share in a sentence.
pub(crate) fn of_asked_phrase(is_of_open: bool) -> &'static str {
    if is_of_open { "of the open area" } else { "of asked" }
}

/// The shares that head a plan, the one to read first at the top: on independent samples, but for the share of the coverable area,
/// which is known on the samples that views are chosen on alone.
#[must_use]
pub fn headline(coverage: &CoverageDocument) -> [HeadlineShare; 7] {
    let independent = coverage.independent;
    let visible = independent.map_or(coverage.visible, |independent| independent.visible);
    let of_asked = independent.map_or(coverage.of_asked, |independent| independent.of_asked);
    let of_total = independent.map_or(coverage.of_total, |independent| independent.of_total);
    let [asked, visible_meaning, coverable_meaning] = headline_meanings(coverage.of_open);
    [
        ("measured of visible", visible.of_visible, visible_meaning),
        ("grades A and B of visible", visible.grades_a_b_of_visible, "measured near best focus and at moderate incidence"),
        ("within 35° of visible", visible.within_35_deg_of_visible, MEANING_OF_35_DEG),
        ("within 60° of visible", visible.within_60_deg_of_visible, MEANING_OF_60_DEG),
        (if coverage.of_open { "measured of open" } else { "measured of asked" }, of_asked, asked),
        (MEASURED_OF_COVERABLE, coverage.of_coverable, coverable_meaning),
        ("measured of total", of_total, "total: every face of the part"),
    ]
    .map(|(name, share, meaning)| {
        let is_independent = independent.is_some() && name != MEASURED_OF_COVERABLE;
        HeadlineShare { name, share, is_independent, meaning }
    })
}

/// Meanings of the asked, the visible and the coverable area; of further views, that of the open area in place of the asked one.
fn headline_meanings(is_of_open: bool) -> [&'static str; 3] {
    if is_of_open {
        return [
            MEANING_OF_OPEN,
            "visible: open area that can be seen at all (the part neither stands on it nor encloses it)",
            "coverable: open area that at least one usable viewpoint measures, on the samples that views are chosen on",
        ];
    }
    [
        "asked: every face outside excluded regions",
        "visible: asked area that can be seen at all (the part neither stands on it nor encloses it)",
        "coverable: asked area that at least one usable viewpoint measures, on the samples that views are chosen on; by \
         default, targets are shares of it",
    ]
}

/// Area at risk on one line: how much of the visible area, whether it counts, and for which reasons.
#[must_use]
pub fn at_risk_sentence(at_risk: &AtRiskDocument) -> String {
    let percent = |share: f64| format!("{} %", percent_below(share, 1.0, 2));
    let counts = if at_risk.counted { "counted as measured" } else { "not counted as measured" };
    let there = at_risk.reasons.iter().filter(|reason| reason.area_mm2 > 0.0);
    let reasons: Vec<_> = there.map(|reason| format!("{} {}", risk_phrase(&reason.reason), percent(reason.of_visible))).collect();
    let reasons = if reasons.is_empty() { String::new() } else { format!(": {}", reasons.join(", ")) };
    format!("At risk in a real scan: {} of visible, {counts}{reasons}", percent(at_risk.of_visible))
}

/// A reason for which area is at risk, of this name in files, in a few words.
pub(crate) fn risk_phrase(name: &str) -> String {
    name.replace("inter_", "inter-").replace('_', " ")
}

/// Meaning of a reason for which area is at risk, in a sentence without a full stop.
#[must_use]
pub fn risk_meaning(reason: RiskReason, realism: &RealismParams) -> String {
    match reason {
        RiskReason::ConcaveZone => format!(
            "within {} mm of a concave edge with an opening angle below {}°, where scanners lose points",
            realism.concave_zone_mm, realism.concave_dihedral_deg
        ),
        RiskReason::InterReflection => {
            "in that zone, and in every view that measures it the projector's light reflects onto the opposite face".to_owned()
        }
        RiskReason::FrameMargin => {
            format!(
                "within {} px of the border of an image, and no view measures it outside both margins",
                realism.frame_margin_px
            )
        }
        RiskReason::SilhouetteMargin => {
            let px = realism.silhouette_margin_px;
            format!("within {px} px of a depth discontinuity in an image, and no view measures it outside both margins")
        }
    }
}

/// A cause as a remark on a spot: "the part stands on it".
#[must_use]
pub fn cause_phrase(cause: Cause) -> &'static str {
    match cause {
        Cause::ExcludedResting => "the part stands on it",
        Cause::Enclosed => "enclosed by the part",
        Cause::FacesTable => "faces the table",
        Cause::Facing => "faces away",
        Cause::Depth => "outside the working depth",
        Cause::FrameLeft => "outside the left image",
        Cause::FrameRight => "outside the right image",
        Cause::FrameProjector => "outside the projected field",
        Cause::IncidenceLeft => "too oblique for the left camera",
        Cause::IncidenceRight => "too oblique for the right camera",
        Cause::IncidenceProjector => "too oblique for the projector",
        Cause::ShadowLeft => "hidden from the left camera",
        Cause::ShadowRight => "hidden from the right camera",
        Cause::ShadowProjector => "in the projector's shadow",
        Cause::Exposure => "too dark or saturated",
        Cause::BelowGrade => "not measured well enough",
        Cause::Unreachable => "out of the robot's reach",
        Cause::Collision => "collision",
        Cause::HiddenByCell => "hidden by an obstacle of the cell",
        Cause::NoPath => "no safe path found",
        Cause::NotChosen => "measurable, but no view chosen",
        Cause::AtRisk => "measured, but at risk",
    }
}

/// A reason for which a candidate was dropped, as a remark on it: "below the plate".
#[must_use]
pub fn rejection_phrase(reason: Rejection) -> &'static str {
    match reason {
        Rejection::BelowTable => "below the plate",
        Rejection::LowElevation => "too low over the plate",
        Rejection::InsidePart => "inside the part",
        Rejection::InsideObstacle => "inside an obstacle",
        Rejection::BodyMeetsPlate => "the scanner's body would meet the plate",
        Rejection::BodyMeetsPart => "the scanner's body would meet the part",
        Rejection::Unreachable => "out of the robot's reach",
        Rejection::Collision => "something collides at every station",
        Rejection::Duplicate => "the same as another one",
        Rejection::MeasuresNothing => "measures nothing that is asked for",
        Rejection::NotNeeded => "adds little or nothing to the others considered",
    }
}

/// The spots for which a remedy was searched for, largest first.
#[must_use]
pub fn treated_spots(missed: &[MissedCause]) -> Vec<(Cause, &MissedSpot, &Remedy)> {
    let mut treated: Vec<_> = missed
        .iter()
        .flat_map(|missed| missed.spots.iter().map(move |spot| (missed.cause, spot)))
        .filter_map(|(cause, spot)| spot.remedy.as_ref().map(|remedy| (cause, spot, remedy)))
        .collect();
    sort_descending(&mut treated, |treated| treated.1.area_mm2);
    treated
}

/// Reasons for which no plan is possible, in a sentence.
#[must_use]
pub fn no_plan_sentence(finding: &NoPlan) -> String {
    let (candidates, asked_mm2, missed_mm2) = match finding {
        NoPlan::NothingMeasured { candidates, asked_mm2, missed_mm2, .. } => (candidates, asked_mm2, missed_mm2),
        NoPlan::NothingInStudy => return "no candidate measures anything; check the part's unit and size".to_owned(),
        NoPlan::NoFurtherView { measured_of_asked, left_of_asked, hopeless_of_asked, rule } => {
            let [measured, left, hopeless] =
                [measured_of_asked, left_of_asked, hopeless_of_asked].map(|share| percent_below(*share, 1.0, 2));
            return format!(
                "no further view is worth taking ({}): {measured} % of the asked area is measured, further views are expected to add \
                 {left} %, and {hopeless} % cannot be recovered by any view",
                rescan_stop_phrase(rule)
            );
        }
        NoPlan::NotRegistered { stability } => {
            return format!(
                "the setups share {} mm² of surface, which leaves {} free, so they cannot be registered to each other; if markers \
                 or a fixture register them, plan with --set registration=markers or fixture, and if they need not be registered, with \
                 --set registration=none; else allow more views (selection.max_views) or more setups, or plan with --set setups=1",
                area_mm2(stability.shared_area_mm2),
                freedom(stability)
            );
        }
    };
    let dropped: Vec<_> =
        candidates.rejected.iter().map(|(reason, count)| format!("{} {count}", rejection_phrase(*reason))).collect();
    let dropped = if dropped.is_empty() { String::new() } else { format!(" (dropped: {})", dropped.join(", ")) };
    if candidates.generated == 0 {
        return "no candidate was proposed; check that the part lies within the robot's reach, or propose candidates by other \
                candidates.strategies"
            .to_owned();
    }
    let usable = match candidates.kept {
        0 => format!("none of {} is usable{dropped}", counted(candidates.generated, "candidate")),
        kept => {
            let all = counted(candidates.generated, "candidate");
            format!("{kept} of {all} can be used{dropped}, but none measures enough to be worth a view")
        }
    };
    let named = missed_mm2.iter().take(NAMED_CAUSES);
    let named = named.map(|(cause, mm2)| format!("{} ({} %)", cause_phrase(*cause), percent_below(mm2 / asked_mm2, 1.0, 0)));
    format!("{usable}; area missed by cause: {}", named.collect::<Vec<_>>().join(", "))
}

/// Rule that ended a rescan, of this name in files, in a clause.
fn rescan_stop_phrase(rule: &str) -> &str {
    match RescanStop::ALL.into_iter().find(|stop| stop.as_str() == rule) {
        Some(RescanStop::Target) => "the target of the plan is measured",
        Some(RescanStop::MinGain) => "the best view is expected to add less than min_gain of the rescan",
        Some(RescanStop::MaxViews) => "the rescan has as many views as its max_views allows",
        Some(RescanStop::MaxRounds) => "as many rounds were made as max_rounds of the rescan allows",
        Some(RescanStop::LittleLeft) => "all further views together are expected to add less than min_left of the rescan",
        Some(RescanStop::NothingMissing) => "nothing that a view could recover is missing",
        None => rule,
    }
}

/// Stability of a registration in a sentence that begins with what two measurements share.
#[must_use]
pub fn stability_sentence(stability: &StabilityDocument) -> String {
    let StabilityDocument { shared_area_mm2, fixed: is_fixed, resistance, weakest, expected_error_mm } = stability;
    let error = expected_error_mm.map_or("unbounded".to_owned(), |error_mm| {
        format!("at least {} µm (1 σ, {EXPECTED_ERROR_IS})", fixed_nonzero(1e3 * error_mm, 1))
    });
    let resistance = fixed_nonzero(*resistance, 3);
    format!(
        "share {} mm², {}; weakest motion: {weakest}, resistance {resistance} (at least {MIN_RESISTANCE} needed), expected \
         error {error}",
        area_mm2(*shared_area_mm2),
        if *is_fixed { "all six degrees of freedom constrained" } else { "not all six degrees of freedom constrained" }
    )
}

/// Names the motion of one measurement against another that shared surface resists least.
#[must_use]
pub fn freedom(stability: &Stability) -> String {
    let (turn, shift) = (stability.turn_in_part, stability.shift_in_part);
    let (what, axis) = if turn.norm() > shift.norm() { ("turning about", turn) } else { ("sliding along", shift) };
    let Some(axis) = axis.try_normalize(f64::MIN_POSITIVE) else { return "every motion".to_owned() };
    let [x, y, z] = [axis.x, axis.y, axis.z].map(|part| fixed(part, 2));
    format!("{what} ({x} {y} {z})")
}

/// Reasons for which a region does not reach its target: the causes of its missed area, the largest first. `None` if it
/// reaches it, or has none.
#[must_use]
pub fn shortfall(region: &RegionCoverage) -> Option<String> {
    if !region.is_unmet() {
        return None;
    }
    if region.samples == 0 {
        return Some(NOTHING_IN_REGION.to_owned());
    }
    let miss = |(cause, missed_mm2): &(Cause, f64)| {
        let noise = noise_remark(region, *cause).map_or_else(String::new, |remark| format!("; {remark}"));
        format!("{} ({} mm²{noise})", cause_phrase(*cause), area_mm2(*missed_mm2))
    };
    Some(region.missed_mm2.iter().map(miss).collect::<Vec<_>>().join(", "))
}

/// Target of a region and the verdict on it: "target 95.00 %: met (independent 96.00 %, standard error 0.99 points)", of 400 samples. One
/// that is met on the samples that views were chosen on alone says so.
pub(crate) fn region_verdict(region: &RegionCoverageDocument) -> String {
    let independent = independent_share(region);
    let told = independent.as_ref().map_or_else(String::new, |share| format!(" (independent {share})"));
    let Some(target) = region.target else { return format!("no target{told}") };
    let target = percent_below(target, 1.0, 2);
    match (region.met, independent) {
        (Some(true), Some(share)) if region.is_refuted() => {
            let samples = region.independent_samples.unwrap_or_default();
            format!("target {target} %: met on the samples that views were chosen on; on {samples} others {share}: NOT CONFIRMED")
        }
        (Some(true), _) => format!("target {target} %: met{told}"),
        (Some(false) | None, _) => format!("target {target} %: NOT MET{told}"),
    }
}

/// Measured share of a region on samples that the views were not chosen on: "93.75 %, standard error 1.22 points", of 400. `None` where
/// there are none.
pub(crate) fn independent_share(region: &RegionCoverageDocument) -> Option<String> {
    let (of_asked, error) = region.independent_of_asked.zip(region.independent_standard_error)?;
    // A share that misses the target is not rounded up to it.
    let limit = region.target.filter(|target| of_asked < *target).unwrap_or(1.0);
    Some(format!("{} %, standard error {} points", percent_below(of_asked, limit, 2), fixed_nonzero(100.0 * error, 2)))
}

/// Remark on the area of a region that is missed for a cause, where the scanner's noise is the reason for it.
#[must_use]
pub fn noise_remark(region: &RegionCoverage, cause: Cause) -> Option<String> {
    let beyond_mm2 = region.beyond_noise_area_mm2;
    if cause != Cause::BelowGrade || beyond_mm2 <= 0.0 {
        return None;
    }
    let below_grade_mm2: f64 = region.missed_mm2.iter().filter(|(missed, _)| *missed == cause).map(|(_, mm2)| mm2).sum();
    let part = if beyond_mm2 < below_grade_mm2 * ALL { format!(" on {} mm²", area_mm2(beyond_mm2)) } else { String::new() };
    let min_mm = rounded_up_mm(0.5 * region.min_tolerance_mm);
    let is_own = region.tolerance_mm.is_some_and(|tolerance_mm| tolerance_mm < region.min_tolerance_mm);
    let tolerance = if is_own { "tolerance" } else { "the tolerance of a feature that overlaps it is" };
    Some(format!("{tolerance} too fine for the scanner's noise{part}; the finest that this noise allows is ±{min_mm} mm"))
}

/// Formats the limits of a tolerance zone of this width as a drawing has them: ±0.150 of a zone of 0.3 mm. They have three decimals, or up
/// to six where the limit has more: a limit is told as it is given.
pub(crate) fn limits_mm(tolerance_mm: f64) -> String {
    let limit_mm = 0.5 * tolerance_mm;
    let micrometres = 1e3 * limit_mm;
    // Six decimals hold three digits of the finest limit.
    let is_finer = (micrometres - micrometres.round()).abs() > 1e-6;
    let limit = if is_finer { fixed(limit_mm, 6).trim_end_matches('0').to_owned() } else { fixed(limit_mm, 3) };
    format!("±{limit}")
}

/// Formats a length so that it is not below `length_mm`, with three decimals.
pub(crate) fn rounded_up_mm(length_mm: f64) -> String {
    // A value that three decimals hold is not rounded up for its last bit.
    fixed((length_mm * 1e3 - 1e-6).ceil() / 1e3, 3)
}

/// Remedy of a home at which two bodies are closer together than a plan allows.
pub(crate) fn home_remedy(bodies: &Contact, clearance_mm: f64) -> String {
    if bodies.is_with_part() {
        HOME_REMEDY.to_owned()
    } else {
        format!(
            "give the cell another home: turn its joints until {bodies} are {clearance_mm} mm apart or more (home_deg; `vantage cell` \
             finds one), or plan with a smaller motion.clearance_mm"
        )
    }
}

/// Remedy of a home at which part or fixture meets another body.
const HOME_REMEDY: &str = "give the cell a home farther from the part, such as one above it (home_deg; `vantage cell --home`)";

/// Remedy of area that more views would measure in a plan that was left short of its target by views without a path.
pub(crate) const WITHOUT_PATH: &str = "views to which no collision-free path was found were left out; more views \
     (selection.target, selection.max_views) may measure some of it, and a smaller motion.clearance_mm may free a path";

/// Remedy of such area for further views, which take no parameters of a plan and end at its target.
pub(crate) const RESCAN_WITHOUT_PATH: &str = "views to which no collision-free path was found were left out; plan the part again: \
     more views (selection.target) may measure some of it, and a smaller motion.clearance_mm may free a path";

/// Advice on how to keep two bodies apart, in a sentence.
#[must_use]
pub fn advice_sentence(advice: &Advice) -> String {
    let text = match advice {
        Advice::MoveHome => HOME_REMEDY,
        Advice::FreeHome { bodies, clearance_mm } => return home_remedy(bodies, *clearance_mm),
        Advice::ReduceClearance(max_mm) => {
            return format!("collision-free there with --set motion.clearance_mm={}", rounded_down(*max_mm, 1));
        }
        Advice::MoveObstacle(name) => return format!("move {name}, or the table away from it"),
        Advice::MoveFixture => "clamp the part elsewhere, or plan it in several setups",
        Advice::MoveTable => {
            "the part hits the robot's foot as the table turns: move the table away from the robot, or the part closer to the table's axis"
        }
        Advice::TurnPart => {
            "lay the part another way (setups, part.table_from_part), or scan it from farther away (candidates.standoffs_mm)"
        }
        Advice::RaisePart => {
            "raise the part above the plate, or the robot's foot; `vantage study reach` finds the layout that reaches most"
        }
        Advice::MoveFoot => {
            "the arm collides with itself there: move its foot closer to the table or farther away; `vantage study reach` compares layouts"
        }
        Advice::MountScanner => "mount the scanner differently (flange_from_scanner); `vantage study reach` compares mounts",
    };
    text.to_owned()
}

/// Remedy that views do not give and that was not tried, in plain text: of area that is too dark or saturated, and of area that is missed
/// for want of a path. `None` for other causes.
pub(crate) fn untried_remedy(plan: &Plan, cause: Cause) -> Option<String> {
    let brightness = plan.params.scan.brightness;
    let is_of_rescan = plan.coverage.is_of_open && brightness != Brightness::Auto;
    let of_exposure = (cause == Cause::Exposure).then(|| match is_of_rescan {
        true => "plan the part again with scan.brightness = auto".to_owned(),
        false => exposure_remedy(brightness),
    });
    of_exposure.or_else(|| path_remedy(plan, cause))
}

/// Remedy of area that is too dark or saturated at the brightness of a plan, in plain text.
pub(crate) fn exposure_remedy(brightness: Brightness) -> String {
    match brightness {
        Brightness::Level(level) => {
            format!("let each view have its own brightness in place of {level} for all (--set scan.brightness=auto)")
        }
        Brightness::Auto => "coat it with matting spray, or check its entry in materials: no brightness suits it".to_owned(),
    }
}

/// Remedy of area that is missed for want of a path, in a plan that ended for that, in plain text: advice on the two bodies that meet on
/// the straight move to most candidates. `None` for other causes and plans, and where none meet.
fn path_remedy(plan: &Plan, cause: Cause) -> Option<String> {
    if cause != Cause::NoPath || plan.stopped_because != StopReason::NoPath {
        return None;
    }
    let blocking = plan.obstructions.iter().filter(|obstruction| obstruction.without_path > 0);
    // Of equal ones the last: it is the first of the pairs.
    let obstruction = blocking.rev().max_by_key(|obstruction| obstruction.without_path)?;
    let advice = advice_sentence(&obstruction.advice).replace('`', "");
    let candidates = counted(obstruction.without_path, "candidate");
    Some(format!("{advice} ({} meet on the straight move to {candidates})", obstruction.bodies))
}

/// Turn in degrees and shift in mm of a pose error with three significant digits: the error of a calibrated cell is small and not
/// round.
pub(crate) fn pose_error_sizes(error: &PoseErrorParams) -> [String; 2] {
    [error.angle_deg, error.translation_mm].map(|value| {
        let decimals = if value > 0.0 { (2.0 - value.log10().floor()).clamp(0.0, 12.0) } else { 0.0 };
        let text = fixed(value, decimals as usize);
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    })
}

/// A share as a percentage, without the sign. A share below `limit`, a target or the whole, is not rounded up to it, and one above 0
/// is not rounded to that: it has as many more decimals as show two digits.
#[must_use]
pub fn percent_below(share: f64, limit: f64, decimals: usize) -> String {
    let [text, of_limit] = [share, limit].map(|share| fixed(100.0 * share, decimals));
    if share > SUM_SLACK && is_zero(&text) {
        fixed_nonzero(100.0 * share, decimals)
    } else if share < limit - SUM_SLACK && text == of_limit {
        rounded_down(100.0 * share, decimals)
    } else {
        text
    }
}

/// A share of a whole as a percentage with its sign and two decimals, as [`percent_below`] has it.
pub(crate) fn percent(share: f64) -> String {
    percent_to(share, 2)
}

/// A share of a whole as a percentage with its sign and so many decimals, as [`percent_below`] has it.
pub(crate) fn percent_to(share: f64, decimals: usize) -> String {
    format!("{} %", percent_below(share, 1.0, decimals))
}

/// The number with so many decimals, without the digits that a turn into radians and back adds. It is no negative zero.
pub(crate) fn rounded_to(value: f64, decimals: i32) -> f64 {
    let steps = 10_f64.powi(decimals);
    (value * steps).round() / steps + 0.0
}

/// Formats `value` with so many decimals so that it is not above the value.
fn rounded_down(value: f64, decimals: usize) -> String {
    let steps = 10_f64.powi(decimals as i32);
    fixed((value * steps).floor() / steps, decimals)
}

/// Distance of two bodies, mm: with one decimal, and rounded down, so that one below a clearance is not told as that clearance;
/// with as many more as show two digits where that would be told as zero. Negative for a depth, which is rounded to the nearest.
pub(crate) fn apart_mm(distance_mm: f64) -> String {
    if distance_mm < 0.0 {
        return fixed_nonzero(distance_mm, 1);
    }
    let text = rounded_down(distance_mm, 1);
    let is_told_as_zero = distance_mm > 0.0 && is_zero(&text);
    if is_told_as_zero { rounded_down(distance_mm, decimals_of_two_digits(distance_mm)) } else { text }
}

/// Claim on a tour's order by the time of its moves and the lower bound over all orders of its stations; `None` without a bound.
pub(crate) fn order_claim(moving_secs: f64, lower_secs: f64) -> Option<String> {
    bound_gap(moving_secs, lower_secs).map(|gap| {
        if gap <= 0.0 {
            return "order proven optimal for its stations".to_owned();
        }
        // Rounded up, or the time would not be within.
        let percent = fixed((1000.0 * gap - SUM_SLACK).ceil() / 10.0, 1);
        format!("moving time within {percent} % of its lower bound")
    })
}

/// Moves that the lower bound over all orders of a tour's stations assumes.
pub(crate) fn bounded_moves(corners: Corners) -> &'static str {
    match corners {
        Corners::Stop => "with straight moves",
        Corners::Round => "with each move as long as its slowest axis takes",
    }
}

/// Two shares as percentages, without the sign: with one decimal, and with as many more, at most six, as tell them apart.
pub(crate) fn percents_apart(shares: [f64; 2]) -> [String; 2] {
    const MAX_DECIMALS: usize = 6;
    let told = |decimals: usize| shares.map(|share| percent_below(share, 1.0, decimals));
    (1..=MAX_DECIMALS).map(told).find(|[one, other]| one != other).unwrap_or_else(|| told(1))
}

/// Share of a spot that a remedy measures, in whole percent; `None` where it works.
#[must_use]
pub fn partial_percent(of_spot: f64) -> Option<String> {
    // A share that does not suffice is not rounded to one that does.
    let max_percent = 100.0 * Remedy::WORKS_FROM - 1.0;
    (of_spot < Remedy::WORKS_FROM).then(|| format!("{} %", fixed((100.0 * of_spot).min(max_percent), 0)))
}

/// Share and area of a spot that a remedy measures, to be said before the remedy; `None` where it works.
#[must_use]
pub fn partial_share(of_spot: f64, measured_mm2: f64) -> Option<String> {
    partial_percent(of_spot).map(|percent| format!("only {percent} of it, {} mm²", area_mm2(measured_mm2)))
}

/// Share and area of some spots that a fix measures which does not work for each of them, to be said before the fix:
/// `only 54 % of it, 7.50 mm²`.
pub(crate) fn partial_of_spots(spots: usize, spots_mm2: f64, measured_mm2: f64) -> String {
    let of_spots = share(measured_mm2, spots_mm2);
    // What is left of them is not rounded away.
    let percent = partial_percent(of_spots).unwrap_or_else(|| format!("{} %", percent_below(of_spots, 1.0, 0)));
    let them = if spots == 1 { "it" } else { "them" };
    format!("only {percent} of {them}, {} mm²", area_mm2(measured_mm2))
}

/// The finding that none of so many views tried for a spot helps.
pub(crate) fn none_found(tried: usize) -> String {
    format!("no fix found ({})", tried_in_vain(tried))
}

/// Reason for which none of so many views tried for a spot helps.
pub(crate) fn tried_in_vain(tried: usize) -> String {
    match tried {
        1 => "the one view tried does not see half of it".to_owned(),
        tried => format!("{tried} views tried; up to 8 of them together see less than half of it"),
    }
}

/// Rules by which the views of a plan were chosen, and which end their choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ChoiceRules {
    /// Rules of a plan.
    Plan(PlanRules),
    /// Rules of a rescan, of which this one ended the choice.
    Rescan(StopReason),
}

/// Rules of a plan that end the choice of its views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanRules {
    /// Goal of the selection.
    pub goal: SelectionGoal,
    /// Rule that ended the choice.
    pub ended_by: StopReason,
    /// Number of views that `selection.max_views` leaves; `None` without that limit.
    pub views_left: Option<usize>,
    /// Asked area that a view has to add.
    pub min_gain_mm2: f64,
    /// True where the time of a view counts against its area.
    pub is_priced: bool,
    /// True where views have to share surface.
    pub must_overlap: bool,
}

impl ChoiceRules {
    /// Rules of a plan.
    #[must_use]
    pub fn of(plan: &Plan) -> Self {
        if plan.coverage.is_of_open {
            return Self::Rescan(plan.stopped_because);
        }
        let selection = &plan.params.selection;
        Self::Plan(PlanRules {
            goal: selection.goal,
            ended_by: choice_ended_by(plan),
            views_left: selection.max_views.map(|limit| (limit as usize).saturating_sub(plan.views.len())),
            min_gain_mm2: selection.min_growth * plan.coverage.asked_area_mm2,
            is_priced: selection.view_cost_mm2_per_s > 0.0,
            must_overlap: selection.overlap != OverlapParams::default(),
        })
    }

    /// Returns true if views without a path were left out of a plan, which therefore misses its target: no rule that ends the
    /// choice mends that.
    pub(crate) fn left_out_views(self) -> bool {
        self.without_path().is_some()
    }

    /// Remedy of area that more views would measure, where views without a path were left out; `None` where none were.
    pub(crate) fn without_path(self) -> Option<&'static str> {
        match self {
            Self::Plan(PlanRules { ended_by: StopReason::NoPath, .. }) => Some(WITHOUT_PATH),
            Self::Rescan(StopReason::NoPath) => Some(RESCAN_WITHOUT_PATH),
            Self::Plan(_) | Self::Rescan(_) => None,
        }
    }

    /// The rules as they are to be changed for the views of a remedy; `None` where that does not help.
    fn to_change(self, remedy: &Remedy) -> Option<String> {
        let of_rescan = match self {
            Self::Plan(rules) => return rules.to_change(remedy),
            Self::Rescan(StopReason::Target) => "plan the part again with a higher selection.target, at which the rescan ends,",
            Self::Rescan(StopReason::MaxViews) => "raise max_views of the rescan",
            Self::Rescan(StopReason::Growth) => "lower min_gain of the rescan",
            Self::Rescan(StopReason::NoPath) => return None,
            Self::Rescan(StopReason::NoGain | StopReason::RegionsUnmet) => {
                "raise max_views of the rescan, or lower its min_gain,"
            }
        };
        Some(of_rescan.to_owned())
    }
}

impl PlanRules {
    /// Change with which views are chosen that gained too little, in a clause.
    pub(crate) fn for_gain(self) -> &'static str {
        match (self.is_priced, self.must_overlap) {
            (true, true) => "lower selection.view_cost_mm2_per_s, or ask for less shared surface (selection.overlap),",
            (true, false) => "lower selection.view_cost_mm2_per_s",
            (false, true) => "ask for less shared surface (selection.overlap)",
            // They add nothing on the samples that views are chosen on.
            (false, false) => "choose views on more samples (part.samples_per_mm2)",
        }
    }

    /// The rule that ended the choice, and those that would end it before the views of a remedy are chosen, as they are to be
    /// changed; `None` where views without a path were left out. A plan for the best coverage heeds no target.
    fn to_change(self, remedy: &Remedy) -> Option<String> {
        let heeds_target = self.goal != SelectionGoal::BestCoverage;
        let [mut target, mut max_views, mut min_growth] = [false, !heeds_target, false];
        match self.ended_by {
            StopReason::Target | StopReason::RegionsUnmet => target = heeds_target,
            StopReason::NoPath => return None,
            StopReason::MaxViews => max_views = true,
            StopReason::Growth => (max_views, min_growth) = (false, true),
            StopReason::NoGain => return Some(self.for_gain().to_owned()),
        }
        max_views |= self.views_left.is_some_and(|left| left < remedy.views.len());
        min_growth |= remedy.views.iter().any(|view| view.area_mm2 < self.min_gain_mm2);
        let rules = [
            (target, "raise selection.target"),
            (max_views, "raise selection.max_views"),
            (min_growth, "lower selection.min_growth"),
        ];
        Some(rules.into_iter().filter_map(|(ends, change)| ends.then_some(change)).collect::<Vec<_>>().join(" and "))
    }
}

/// A remedy in a sentence for a plan whose views were chosen by these rules. Where it does not work, the share that it measures
/// comes first.
#[must_use]
pub fn fix_sentence(remedy: &Remedy, rules: ChoiceRules) -> String {
    let Some(first) = remedy.views.first() else { return none_found(remedy.tried) };
    let candidate = first.candidate.0;
    let mut text = match remedy.kind {
        RemedyKind::View => match rules.to_change(remedy) {
            Some(change) => format!("{change} so that candidate {candidate} is chosen too"),
            None => return rules.without_path().unwrap_or_default().to_owned(),
        },
        RemedyKind::Roll => format!("roll candidate {candidate} by {}°", degrees(first.roll_rad)),
        RemedyKind::Tilt => format!("tilt candidate {candidate} by {}°{}", degrees(first.tilt_rad), rolled(first)),
        RemedyKind::Standoff => {
            format!("take candidate {candidate} from {} mm{}{}", fixed(first.standoff_mm, 0), tilted(first), rolled(first))
        }
        RemedyKind::Setup => {
            let turn = remedy.turn.as_ref().map_or_else(|| "turn it onto another side".to_owned(), turn_phrase);
            format!("{turn} and scan again")
        }
        RemedyKind::Limit => limits_text(remedy),
        RemedyKind::None => String::new(),
    };
    // Writing to a String cannot fail.
    let _ = match remedy.views.len() - 1 {
        0 => Ok(()),
        1 => write!(text, "; with 1 more view"),
        more => write!(text, "; with {more} more views"),
    };
    if let Some(share) = partial_share(remedy.of_spot, remedy.area_mm2) {
        return format!("{share}: {text}");
    }
    let _ = write!(text, ": measures {} mm², {} % of it", area_mm2(remedy.area_mm2), percent_below(remedy.of_spot, 1.0, 0));
    text
}

/// Name of a side of the part as it lies.
fn side_name(side: PartSide) -> &'static str {
    match side {
        PartSide::Right => "right side",
        PartSide::Back => "back",
        PartSide::Left => "left side",
        PartSide::Front => "front",
    }
}

/// A turn of the part as an operator is asked for it: "turn it upside down".
#[must_use]
pub fn turn_phrase(turn: &Turn) -> String {
    let side = side_name(turn.side);
    match turn.kind {
        TurnKind::None => "leave it as it lies".to_owned(),
        TurnKind::UpsideDown => "turn it upside down".to_owned(),
        TurnKind::OnSide => format!("stand it on its {side}"),
        TurnKind::Tilt => format!("tilt it by {}° towards its {side}", degrees(turn.angle_rad)),
    }
}

/// Lie of the part after a turn from the first setup: "upside down".
#[must_use]
pub fn lie_phrase(turn: &Turn) -> String {
    let side = side_name(turn.side);
    match turn.kind {
        TurnKind::None => "on the same side as in setup 1".to_owned(),
        TurnKind::UpsideDown => "upside down".to_owned(),
        TurnKind::OnSide => format!("on its {side}"),
        TurnKind::Tilt => format!("tilted by {}° towards its {side}", degrees(turn.angle_rad)),
    }
}

/// Lie of the part in the first setup, where that is not as it is placed: "upside down relative to its placement (part.table_from_part)".
/// Setups that a plan chooses by itself may leave the pose that a job gives.
pub(crate) fn first_lie(placed: Option<&PoseSpec>, first: &Pose<Table, Part>) -> Option<String> {
    let turn = Turn::between(&placed.copied().unwrap_or_default().pose(), first);
    let is_turned = turn.kind != TurnKind::None;
    is_turned.then(|| format!("{} relative to its placement (part.table_from_part)", lie_phrase(&turn)))
}

fn limits_text(remedy: &Remedy) -> String {
    let limit = |name: &str, deg: Option<f64>| deg.map(|deg| format!("{name} to {}°", fixed(rounded_down_deg(deg), 1)));
    let limits = [limit("limits.camera_deg", remedy.camera_deg), limit("limits.projector_deg", remedy.projector_deg)];
    let limits: Vec<_> = limits.into_iter().flatten().collect();
    let from = remedy.views.first().map_or_else(String::new, |first| {
        format!(" and scan from candidate {}{}{}", first.candidate.0, tilted(first), rolled(first))
    });
    format!("raise {}{from}", limits.join(" and "))
}

/// A limit of incidence rounded down to a tenth of a degree: it may not exceed a device's own.
pub(crate) fn rounded_down_deg(deg: f64) -> f64 {
    // A value that one decimal holds is not rounded down for its last bit.
    (deg * 10.0 + 1e-6).floor() / 10.0
}

fn tilted(view: &RemedyView) -> String {
    if view.tilt_rad == 0.0 { String::new() } else { format!(", tilted by {}°", degrees(view.tilt_rad)) }
}

fn rolled(view: &RemedyView) -> String {
    if view.roll_rad == 0.0 { String::new() } else { format!(", rolled by {}°", degrees(view.roll_rad)) }
}

fn degrees(angle_rad: f64) -> String {
    fixed(angle_rad.to_degrees(), 0)
}

/// Formats an area with one decimal, with as many more as show three digits where it is small, and with a narrow space between
/// thousands.
pub(crate) fn area_mm2(area_mm2: f64) -> String {
    /// Area below which three digits are fewer than one decimal, mm².
    const SMALL_MM2: f64 = 10.0;
    /// Area that is nothing but the rounding of a sum, mm².
    const NOTHING_MM2: f64 = 1e-9;
    let size = area_mm2.abs();
    let decimals = if (NOTHING_MM2..SMALL_MM2).contains(&size) { 2.0 - size.log10().floor() } else { 1.0 };
    by_thousands(&fixed(area_mm2, decimals as usize))
}

/// The number with a narrow space between thousands, and with a true minus sign.
pub(crate) fn by_thousands(number: &str) -> String {
    let (sign, digits) = number.strip_prefix('-').map_or(("", number), |digits| ("−", digits));
    let (whole, fraction) = digits.split_at(digits.find(|digit: char| !digit.is_ascii_digit()).unwrap_or(digits.len()));
    let mut grouped = String::from(sign);
    for (position, digit) in whole.chars().enumerate() {
        if position > 0 && (whole.len() - position).is_multiple_of(3) {
            grouped.push('\u{202f}');
        }
        grouped.push(digit);
    }
    grouped + fraction
}

/// Formats `value` with so many decimals; zero has no sign. One of more digits than any quantity of a cell has six significant ones and a
/// power of ten: "1e308".
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    if value.is_finite() && value.abs() >= MAX_PLAIN {
        return scientific(value);
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if is_zero(rest) => rest.into(),
        _ => text,
    }
}

/// Formats `value` with six significant digits at most and a power of ten.
fn scientific(value: f64) -> String {
    let text = format!("{value:.5e}");
    let (digits, power) = text.split_once('e').unwrap_or((text.as_str(), "0"));
    format!("{}e{power}", digits.trim_end_matches('0').trim_end_matches('.'))
}

/// Formats `value` with so many decimals; where they would show a value as zero that is not, with as many more, at most twelve in
/// all, as show two digits, which is what an uncertainty has (GUM 7.2.6).
pub(crate) fn fixed_nonzero(value: f64, decimals: usize) -> String {
    let text = fixed(value, decimals);
    if value == 0.0 || !is_zero(&text) {
        return text;
    }
    fixed(value, decimals_of_two_digits(value))
}

/// Number of decimals, at most twelve, that show two digits of a value that is not zero.
fn decimals_of_two_digits(value: f64) -> usize {
    const MAX_DECIMALS: f64 = 12.0;
    (1.0 - value.abs().log10().floor()).min(MAX_DECIMALS) as usize
}

/// Returns true for a number without a sign that has no digit but zeros.
fn is_zero(number: &str) -> bool {
    number.bytes().all(|byte| byte == b'0' || byte == b'.')
}
