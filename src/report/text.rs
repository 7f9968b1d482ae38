//! A plan as stable readable text: what golden files hold, what diffs show, what the log gets. Numbers are rounded so
//! that the last bit of a float never shows; a pose is given by its origin and two axes, since a quaternion near w = 0
//! changes its sign for nothing. mm, mm², s and degrees.

use std::fmt::{self, Write};

use nalgebra::{Point3, Vector3};

use crate::cell::Separation;
use crate::geometry::Pose;
use crate::planning::params::{Corners, PlanParams};
use crate::planning::plan::{
    Bound, Cause, Coverage, MissedCause, Obstruction, Plan, Remedy, RemedyKind, RiskReason, SetupId, SetupLink, SetupPlan,
    Stability, share,
};
use crate::planning::sequence::{Leg, Sequence};
use crate::planning::stations::Station;
use crate::wire::plan::{
    AdviceDocument, AtRiskDocument, CoverageDocument, RegionCoverageDocument, RobustDocument, StabilityDocument,
};
use crate::wire::summary::{Summary, rescan_ended};
use crate::wire::warnings::{FieldWarning, WarningCode, of_robust, parameter_of};
use crate::wire::words::{
    ChoiceRules, MEANING_OF_INDEPENDENT, MEANING_OF_REACH_IGNORED, MEASURED_OF_COVERABLE, NOTHING_IN_REGION, advice_sentence,
    apart_mm, area_mm2, asked_name, at_risk_sentence, bounded_moves, cause_phrase, changed_params, counted, first_lie,
    fix_sentence, fixed, fixed_nonzero, headline, lie_phrase, limits_mm, noise_remark, of_asked_phrase, order_claim,
    percent_below, pose_error_sizes, region_verdict, risk_meaning, stability_sentence, treated_spots, untried_remedy,
};

/// Words on a region of which earlier scans left nothing open.
pub(crate) const NOTHING_OPEN: &str = "met: earlier scans left none of it open";

/// The text of a plan without a program. Same plan, same text; every line ends with a newline.
#[must_use]
pub fn text(plan: &Plan) -> String {
    text_with_warnings(plan, &Summary::of(plan), &[])
}

/// The text of a plan, with its summary and, after that, the warnings that stand at the head of reports.
#[must_use]
pub fn text_with_warnings(plan: &Plan, summary: &Summary, warnings: &[FieldWarning]) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = write_plan(&mut out, plan, summary, warnings);
    out
}

/// Warnings on the part itself, which stand before the plan; nothing where there are none.
#[must_use]
pub fn warned(warnings: &[FieldWarning]) -> String {
    let text = |warning: &FieldWarning| {
        format!("Check the unit of the part ({}): it {}\n  {}\n", warning.code.as_str(), warning.detail, warning.remedy)
    };
    let all: String = warnings.iter().map(text).collect();
    if all.is_empty() { all } else { all + "\n" }
}

/// Warnings on a plan, which follow its summary; nothing where there are none.
fn warned_of_plan(warnings: &[FieldWarning]) -> String {
    let text = |warning: &FieldWarning| {
        let FieldWarning { code, detail, remedy, .. } = warning;
        format!("Warning ({}), {}: {detail}\n  {remedy}\n", code.as_str(), parameter_of(warning))
    };
    let all: String = warnings.iter().map(text).collect();
    if all.is_empty() { all } else { all + "\n" }
}

fn write_plan(out: &mut String, plan: &Plan, summary: &Summary, warnings: &[FieldWarning]) -> fmt::Result {
    write_summary(out, summary)?;
    write!(out, "{}", warned_of_plan(warnings))?;
    write_part(out, plan)?;
    write_params(out, &plan.params)?;
    write_candidates(out, plan)?;
    write_coverage(out, &plan.coverage, &plan.missed, plan.table_from_part.is_some())?;
    write_at_risk(out, plan)?;
    write_warnings(out, plan)?;
    write_regions(out, &plan.coverage)?;
    write_setups(out, plan)?;
    write_links(out, &plan.setup_links, &plan.setups)?;
    let ended = rescan_ended(plan).unwrap_or_else(|| plan.stopped_because.as_str().to_owned());
    writeln!(out, "\nstopped because: {ended}")?;
    write_bound(out, &plan.bound, &plan.params)?;
    write_views(out, plan)?;
    plan.sequences().try_for_each(|sequence| write_sequence(out, sequence, plan.params.motion.corners))?;
    write_obstructions(out, &plan.obstructions)?;
    write_advice(out, plan, warnings)?;
    write_missed(out, plan, warnings)
}

/// Writes the summary in the sentences that every output has.
fn write_summary(out: &mut String, summary: &Summary) -> fmt::Result {
    summary.lines_with_rest("see \"missed\" below").iter().try_for_each(|line| writeln!(out, "{line}"))?;
    writeln!(out)
}

fn write_part(out: &mut String, plan: &Plan) -> fmt::Result {
    let part = &plan.part;
    writeln!(out, "part {}", part.sha256)?;
    writeln!(out, "  {} triangles, {} mm²", part.triangles, area_mm2(part.area_mm2))?;
    writeln!(out, "  box {} to {} mm", point(&part.aabb.min), point(&part.aabb.max))?;
    if let Some(table_from_part) = &plan.table_from_part {
        writeln!(out, "  on the table: {}", pose(table_from_part))?;
    }
    Ok(())
}

/// Lists the setups where there are several: poses of the part, and the area that each gives.
fn write_setups(out: &mut String, plan: &Plan) -> fmt::Result {
    if plan.setups.len() < 2 {
        return Ok(());
    }
    writeln!(out, "\nsetups")?;
    SetupId::number(&plan.setups).try_for_each(|(id, setup)| {
        let asked_mm2 = plan.coverage.asked_area_mm2;
        let [measured, coverable] = [setup.measured_area_mm2, setup.coverable_area_mm2].map(|mm2| percent(share(mm2, asked_mm2)));
        let executed = setup.views.iter().filter(|view| plan.views[view.index()].rejected.is_none()).count();
        let (views, at) = (measuring(executed), pose(&setup.table_from_part));
        let first = || first_lie(plan.params.part.table_from_part.as_ref(), &setup.table_from_part);
        let lies = plan.turn_into(id).map(|turn| lie_phrase(&turn)).or_else(first).map_or_else(String::new, |lies| lies + "; ");
        let asked = asked_name(plan.coverage.is_of_open);
        write!(out, "  {}: {lies}{views} {measured} % of the {asked} area", id.0 + 1)?;
        writeln!(out, " (its candidates could measure {coverable} %); {at}")
    })
}

/// Lists what setups, and the two worst joined views of each, share for a registration.
fn write_links(out: &mut String, links: &[SetupLink], setups: &[SetupPlan]) -> fmt::Result {
    let told = |stability: &Stability| stability_sentence(&StabilityDocument::from(stability));
    if !links.is_empty() || setups.iter().any(|setup| setup.weakest_link.is_some()) {
        writeln!(out, "\nregistration by shared surface")?;
    }
    for link in links {
        let [a, b] = link.setups.map(|setup| setup.0 + 1);
        writeln!(out, "  setups {a} and {b} {}", told(&link.stability))?;
    }
    if setups.iter().any(|setup| setup.weakest_link.is_some()) {
        writeln!(out, "  views of one setup share one frame, so their links need not constrain every degree of freedom")?;
    }
    for (number, setup) in setups.iter().enumerate() {
        if let Some(([a, b], stability)) = &setup.weakest_link {
            writeln!(out, "  weakest link of the views of setup {}: {} and {} {}", number + 1, a.0, b.0, told(stability))?;
        }
    }
    Ok(())
}

fn write_params(out: &mut String, params: &PlanParams) -> fmt::Result {
    writeln!(out, "\nparameters changed from their defaults or derived")?;
    let changed = changed_params(params);
    if changed.is_empty() {
        writeln!(out, "  none")?;
    }
    changed.iter().try_for_each(|(key, value)| writeln!(out, "  {key} = {value}"))
}

fn write_candidates(out: &mut String, plan: &Plan) -> fmt::Result {
    let counts = &plan.candidates;
    writeln!(out, "\ncandidates: {} generated, {} kept", counts.generated, counts.kept)?;
    counts.rejected.iter().try_for_each(|(reason, count)| writeln!(out, "  rejected, {}: {count}", reason.as_str()))
}

fn write_coverage(out: &mut String, coverage: &Coverage, missed: &[MissedCause], has_cell: bool) -> fmt::Result {
    let asked = asked_name(coverage.is_of_open);
    writeln!(out, "\ncoverage{}", if coverage.is_of_open { " of what earlier scans left open" } else { "" })?;
    // What is asked and not visible comes between the two.
    let is_unseen = |missed: &&MissedCause| matches!(missed.cause, Cause::ExcludedResting | Cause::Enclosed);
    let unseen = missed.iter().filter(is_unseen).map(|missed| (cause_phrase(missed.cause), missed.area_mm2));
    let seen = [("whole surface", coverage.total_area_mm2), (asked, coverage.asked_area_mm2)].into_iter().chain(unseen);
    let mut seen = seen.chain([("visible", coverage.visible_area_mm2)]);
    let measured = [("coverable", coverage.coverable_area_mm2), ("measured", coverage.measured.area_mm2)];
    seen.try_for_each(|(name, mm2)| writeln!(out, "  {name:<24} {:>12} mm²", area_mm2(mm2)))?;
    if has_cell {
        let mm2 = area_mm2(coverage.optically_coverable_area_mm2);
        writeln!(out, "  {:<24} {mm2:>12} mm²  {MEANING_OF_REACH_IGNORED}", "coverable, reach ignored")?;
    }
    measured.into_iter().try_for_each(|(name, mm2)| writeln!(out, "  {name:<24} {:>12} mm²", area_mm2(mm2)))?;
    let shares = [(asked, coverage.of_asked()), ("coverable", coverage.of_coverable()), ("total", coverage.of_total())];
    for (whole, fraction) in shares {
        let name = format!("measured of {whole}");
        writeln!(out, "  {name:<24} {:>12} %", percent(fraction))?;
    }
    for (name, area_mm2) in ["A", "B", "C", "D"].into_iter().zip(coverage.measured.grade_area_mm2) {
        let name = format!("grade {name} of {asked}");
        writeln!(out, "  {name:<24} {:>12} %", percent(share(area_mm2, coverage.asked_area_mm2)))?;
    }
    write_certificate(out, coverage)
}

/// Lists measured area that a real scan may lack, apart from the figures above.
fn write_at_risk(out: &mut String, plan: &Plan) -> fmt::Result {
    writeln!(out, "\n{}", at_risk_sentence(&AtRiskDocument::from(&plan.coverage)))?;
    for (reason, area) in RiskReason::ALL.into_iter().zip(plan.coverage.at_risk.by_reason_mm2) {
        writeln!(out, "  {:<24} {:>12} mm²  {}", reason.as_str(), area_mm2(area), risk_meaning(reason, &plan.params.realism))?;
    }
    Ok(())
}

/// Lists regions of interest and features, where there are any: what is asked of each, what is reached, and why not more.
fn write_regions(out: &mut String, coverage: &Coverage) -> fmt::Result {
    let is_of_open = coverage.is_of_open;
    if !coverage.regions.is_empty() {
        let of = if is_of_open { ", of what earlier scans left open" } else { "" };
        writeln!(out, "\nregions of interest and features{of}")?;
    }
    for region in &coverage.regions {
        let verdict = region_verdict(&RegionCoverageDocument::from(region));
        let tolerance = region.tolerance_mm.map_or_else(String::new, |mm| format!(", tolerance {} mm", limits_mm(mm)));
        // Quoted, so that no name breaks a line.
        writeln!(out, "  {:?}: {}{tolerance}, {}", region.name, region.kind.as_str(), counted(region.samples, "sample"))?;
        if is_of_open && region.samples == 0 {
            writeln!(out, "       {NOTHING_OPEN}")?;
            continue;
        }
        let [asked, measured] = [region.asked_area_mm2, region.measured_area_mm2].map(area_mm2);
        let reached = reached_percent(region.of_asked(), region.target);
        match is_of_open {
            true => writeln!(out, "       {measured} of {asked} mm² measured, {reached} % of the open area")?,
            false => writeln!(out, "       {measured} of {asked} mm² measured, {reached} %; {verdict}")?,
        }
        if region.samples == 0 {
            writeln!(out, "       {NOTHING_IN_REGION}")?;
        }
        for (cause, missed_mm2) in &region.missed_mm2 {
            let noise = noise_remark(region, *cause).map_or_else(String::new, |remark| format!("; {remark}"));
            writeln!(out, "       missed, {:<18} {:>10} mm²{noise}", cause.as_str(), area_mm2(*missed_mm2))?;
        }
    }
    Ok(())
}

fn write_certificate(out: &mut String, coverage: &Coverage) -> fmt::Result {
    let independent = &coverage.independent;
    writeln!(
        out,
        "\nindependent check, on {} {MEANING_OF_INDEPENDENT} (except \"{MEASURED_OF_COVERABLE}\"): quote these figures",
        independent.samples
    )?;
    for figure in headline(&CoverageDocument::from(coverage)) {
        writeln!(out, "  {:<26} {:>10} %  {}", figure.name, percent(figure.share), figure.meaning)?;
    }
    let Some(robust) = &coverage.robust else { return Ok(()) };
    let [angle_deg, shift_mm] = pose_error_sizes(&robust.pose_error);
    let asked = asked_name(coverage.is_of_open);
    writeln!(out, "\nmeasured of {asked} on these samples if poses are off by {angle_deg}° and {shift_mm} mm")?;
    for (name, drawn) in [("every view", &robust.views), ("part and support", &robust.part), ("hand-eye", &robust.hand_eye)] {
        let [nominal, mean, worst] = [drawn.nominal, drawn.mean(), drawn.worst()].map(percent);
        let p5 = drawn.told_p5().map_or_else(String::new, |p5| format!(", 5th percentile {} %", percent(p5)));
        let draws = counted(drawn.draws(), "draw");
        writeln!(out, "  {name:<16} nominal {nominal} %, mean {mean} %{p5}, worst of {draws} {worst} %")?;
    }
    Ok(())
}

/// Says that the plan is fragile under pose errors, if it is.
fn write_warnings(out: &mut String, plan: &Plan) -> fmt::Result {
    let robust = plan.coverage.robust.as_ref().map(RobustDocument::from);
    let warning =
        robust.and_then(|robust| of_robust(&plan.params, &robust, (plan.coverage.is_of_open, plan.stopped_because), ""));
    warning.map_or(Ok(()), |warning| {
        let knob = warning.pointer.trim_start_matches('/').replace('/', ".");
        writeln!(out, "\nwarning, {}: {knob} {}", warning.code.as_str(), warning.detail)?;
        writeln!(out, "  {}", warning.remedy)
    })
}

/// Lists the advice on the plan as a whole.
fn write_advice(out: &mut String, plan: &Plan, warnings: &[FieldWarning]) -> fmt::Result {
    if !plan.advice.is_empty() {
        writeln!(out, "\nadvice, simulated")?;
    }
    AdviceDocument::all_of(plan).iter().try_for_each(|advice| writeln!(out, "  {}", advice.text))?;
    if keeps_unstable_pose(plan.advice.iter().map(|advice| advice.table_from_part.is_some()), warnings) {
        writeln!(out, "  {UNSTABLE_POSE_KEPT}")?;
    }
    Ok(())
}

/// Remark on advice that keeps a pose in which the part would tip over.
pub(super) const UNSTABLE_POSE_KEPT: &str =
    "the part would still tip over in one of the present setups: place it so that it stands, and plan again";

/// Returns true if the part would tip over in a setup of the plan, and some advice adds one to those; `adds_setup` is told of each.
pub(super) fn keeps_unstable_pose(adds_setup: impl IntoIterator<Item = bool>, warnings: &[FieldWarning]) -> bool {
    let is_unstable = warnings.iter().any(|warning| warning.code == WarningCode::PartUnstable);
    is_unstable && adds_setup.into_iter().any(|adds| adds)
}

/// Returns true if the views, and so the bound on their number, have to keep the grades of greedy's choice.
pub(super) fn holds_grades(params: &PlanParams) -> bool {
    let selection = &params.selection;
    selection.keeps_grades(&params.score) && (selection.max_grade_loss.is_some() || selection.min_grade_a.is_some())
}

/// Writes the bounds; that of the number of views is left out where none was computed, as of further views.
fn write_bound(out: &mut String, bound: &Bound, params: &PlanParams) -> fmt::Result {
    if bound.views_lower > 0 {
        let grades = if holds_grades(params) { " at these grades" } else { "" };
        writeln!(out, "bound: at least {} needed{grades}, gap {}", counted(bound.views_lower as usize, "view"), bound.gap)?;
    }
    if let (Some(upper), Some(gap)) = (bound.of_asked_upper, bound.gap_of_asked) {
        writeln!(out, "bound: up to {} % of asked, gap {} percentage points", percent(upper), percent(gap))?;
    }
    Ok(())
}

fn write_views(out: &mut String, plan: &Plan) -> fmt::Result {
    writeln!(out, "\nviews, in the order chosen: {}", plan.views.len())?;
    for (view, measured_mm2) in plan.views.iter().zip(&plan.coverage.curve_area_mm2) {
        writeln!(out, "  {:>3}  candidate {}, {}", view.id.0, view.candidate.0, view.label.as_str())?;
        let of = of_asked_phrase(plan.coverage.is_of_open);
        write!(out, "       adds {} % {of}, total ", percent(view.gain_of_asked))?;
        write!(out, "{} %", percent(share(*measured_mm2, plan.coverage.asked_area_mm2)))?;
        writeln!(out, "; score {} mm²", area_mm2(view.score))?;
        writeln!(out, "       {}", pose(&view.part_from_scanner))?;
        if let Some(station) = &view.station {
            writeln!(out, "       {}", station_text(station))?;
        }
        if let Some(cause) = view.rejected {
            writeln!(out, "       rejected, measures nothing: {}", cause.as_str())?;
        }
    }
    Ok(())
}

fn write_sequence(out: &mut String, sequence: &Sequence, corners: Corners) -> fmt::Result {
    if sequence.visits.is_empty() {
        return writeln!(out, "\nsequence: none, because no view is executed");
    }
    writeln!(out, "\nsequence, from home")?;
    for (view, leg) in &sequence.visits {
        writeln!(out, "  to view {:<3} {}", view.0, leg_text(leg))?;
    }
    writeln!(out, "  to home     {}", leg_text(&sequence.return_home))?;
    writeln!(out, "  the table turns for {} s of this", fixed(sequence.turning_secs(), 1))?;
    let secs = [sequence.motion_secs(), sequence.ordered_secs, sequence.lower_bound_secs].map(|secs| fixed(secs, 1));
    let [moving, ordered, lower_bound] = secs;
    let (lower, moves) = (fixed(sequence.moving_lower_secs, 1), bounded_moves(corners));
    writeln!(out, "  {moving} s of motion in total, after stations were shifted in table angle and roll")?;
    let claim = order_claim(sequence.motion_secs(), sequence.moving_lower_secs);
    let claim = claim.map_or_else(String::new, |claim| format!(": {claim}"));
    writeln!(out, "  lower bound {lower} s for these stations in any order, {moves}{claim}")?;
    writeln!(out, "  before that shift: {ordered} s; lower bound {lower_bound} s over the stations and moves considered")
}

/// Lists the pairs of bodies that keep the cell from most candidates.
fn write_obstructions(out: &mut String, obstructions: &[Obstruction]) -> fmt::Result {
    const SHOWN: usize = 5;
    if !obstructions.is_empty() {
        writeln!(out, "\nin the way of viewpoints")?;
    }
    for Obstruction { bodies, without_station, without_path, separation, advice, .. } in obstructions.iter().take(SHOWN) {
        write!(out, "  {bodies}: {without_station} without a station, {without_path} without a path")?;
        match separation {
            Some(Separation { distance_mm, place_in_base_mm, .. }) if *distance_mm < 0.0 => write!(
                out,
                "; they overlap by {} mm at {} in the base frame",
                fixed_nonzero(-distance_mm, 1),
                point(place_in_base_mm)
            )?,
            Some(Separation { distance_mm, place_in_base_mm, .. }) => {
                write!(out, "; {} mm apart at {} in the base frame", apart_mm(*distance_mm), point(place_in_base_mm))?
            }
            None => {}
        }
        writeln!(out, "\n       {}", advice_sentence(advice))?;
    }
    match obstructions.len() {
        more if more > SHOWN => writeln!(out, "  and {} more", counted(more - SHOWN, "pair")),
        _ => Ok(()),
    }
}

fn write_missed(out: &mut String, plan: &Plan, warnings: &[FieldWarning]) -> fmt::Result {
    let (missed, asked_area_mm2) = (&plan.missed, plan.coverage.asked_area_mm2);
    writeln!(out, "\nmissed")?;
    if missed.is_empty() {
        writeln!(out, "  nothing")?;
    }
    for cause in missed {
        write!(out, "  {:<20} {:>10} mm²", cause.cause.as_str(), area_mm2(cause.area_mm2))?;
        let of = of_asked_phrase(plan.coverage.is_of_open);
        write!(out, " {:>6} % {of}, {}", percent(share(cause.area_mm2, asked_area_mm2)), counted(cause.spots.len(), "spot"))?;
        match cause.spots.first() {
            Some(spot) => writeln!(out, ", largest {} mm² at {}", area_mm2(spot.area_mm2), point(&spot.centre_mm))?,
            None => writeln!(out)?,
        }
    }
    write_spots(out, plan, warnings)
}

/// Fix of area that is missed for want of a path where the home of the cell is blocked, in plain text: the home, whatever else was
/// tried. `None` for other causes, and where the home is free.
fn home_remedy(cause: Cause, warnings: &[FieldWarning]) -> Option<String> {
    let blocked = warnings.iter().find(|warning| warning.code == WarningCode::HomeBlocked)?;
    (cause == Cause::NoPath).then(|| blocked.remedy.replace('`', ""))
}

/// Fix of area in plain text that views do not give: what mends the home where that is blocked and area is missed for want of a path; else,
/// where no remedy helps, what was not tried. `None` where neither applies.
pub(super) fn cell_remedy(plan: &Plan, missed: (Cause, Option<&Remedy>), warnings: &[FieldWarning]) -> Option<String> {
    let (cause, remedy) = missed;
    let mends_nothing = remedy.is_none_or(|remedy| remedy.kind == RemedyKind::None);
    home_remedy(cause, warnings).or_else(|| untried_remedy(plan, cause).filter(|_| mends_nothing))
}

/// The largest spots of all with what would cure them.
fn write_spots(out: &mut String, plan: &Plan, warnings: &[FieldWarning]) -> fmt::Result {
    let (treated, rules) = (treated_spots(&plan.missed), ChoiceRules::of(plan));
    if !treated.is_empty() {
        writeln!(out, "\nlargest missed spots, with the fixes that were tried")?;
    }
    for (cause, spot, remedy) in treated {
        write!(out, "  {:<20} {:>10} mm²", cause.as_str(), area_mm2(spot.area_mm2))?;
        let extent = [spot.extent_mm.x, spot.extent_mm.y, spot.extent_mm.z].map(|x| fixed(x, 1)).join(" × ");
        writeln!(out, " at {}, {extent} mm", point(&spot.centre_mm))?;
        let of_cell = cell_remedy(plan, (cause, Some(remedy)), warnings);
        writeln!(out, "       {}", of_cell.unwrap_or_else(|| fix_sentence(remedy, rules)))?;
    }
    Ok(())
}

fn leg_text(leg: &Leg) -> String {
    format!("{} s, {}", fixed(leg.duration_secs, 1), counted(leg.via_rad.len(), "via point"))
}

fn station_text(station: &Station) -> String {
    let joints = station.joints_rad.map(|j| fixed(j.to_degrees(), 1)).join(" ");
    format!("table {}°, joints {joints}°", fixed(station.table_angle_rad.to_degrees(), 1))
}

fn pose<To, From>(pose: &Pose<To, From>) -> String {
    let (x, z) = (pose.direction(&Vector3::x()), pose.direction(&Vector3::z()));
    format!("at {} mm, x {}, z {}", point(&pose.origin_mm()), axis(&x), axis(&z))
}

fn axis(v: &Vector3<f64>) -> String {
    format!("({} {} {})", fixed(v.x, 3), fixed(v.y, 3), fixed(v.z, 3))
}

fn point(p: &Point3<f64>) -> String {
    format!("({} {} {})", fixed(p.x, 1), fixed(p.y, 1), fixed(p.z, 1))
}

fn percent(fraction: f64) -> String {
    percent_below(fraction, 1.0, 2)
}

/// Share of a region that is measured, as a percentage without its sign: rounded up neither to a target nor to a whole that it
/// does not reach.
pub(crate) fn reached_percent(of_asked: f64, target: Option<f64>) -> String {
    let missed_target = target.filter(|target| of_asked < *target);
    percent_below(of_asked, missed_target.unwrap_or(1.0), 2)
}

/// Views with their verb.
fn measuring(views: usize) -> String {
    format!("{} {}", counted(views, "view"), if views == 1 { "measures" } else { "measure" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{Configuration, Contact};
    use crate::planning::params::PoseErrorParams;
    use crate::planning::plan::{Advice, Drawn, IndependentRegion, RegionCoverage, RegionKind, Robust, ViewId};
    use crate::wire::words::MEANING_OF_OPEN;

    /// The report told no error of a registration; the command line and the other report did.
    #[test]
    fn links_of_setups_and_of_views_are_told_with_the_expected_error() {
        let stability = Stability {
            shared_area_mm2: 1200.0,
            resistance: 0.05,
            turn_in_part: Vector3::zeros(),
            shift_in_part: Vector3::z(),
            centre_in_part_mm: Point3::origin(),
            expected_error_mm: Some(0.000_42),
        };
        let link = SetupLink { setups: [SetupId(0), SetupId(1)], stability };
        let setup = SetupPlan {
            table_from_part: Pose::identity(),
            views: Vec::new(),
            coverable_area_mm2: 0.0,
            measured_area_mm2: 0.0,
            sequence: None,
            weakest_link: Some(([ViewId(3), ViewId(7)], Stability { expected_error_mm: None, ..stability })),
        };
        let mut out = String::new();
        write_links(&mut out, &[link], &[setup]).expect("a String takes all");
        let told = stability_sentence(&StabilityDocument::from(&stability));
        assert!(told.contains("expected error at least 0.4 µm (1 σ, "), "{told}");
        assert!(out.contains(&format!("  setups 1 and 2 {told}\n")), "{out}");
        assert!(out.contains("setup 1: 3 and 7 share ") && out.ends_with("expected error unbounded\n"), "{out}");
        let coverage = Coverage { optically_coverable_area_mm2: 7.0, ..Coverage::default() };
        let mut out = String::new();
        write_coverage(&mut out, &coverage, &[], true).expect("a String takes all");
        assert!(out.contains("  7.00 mm²  at least one viewpoint measures it, whether the robot reaches that or not\n"), "{out}");
    }

    /// 4.96 mm were told as 5.0 mm apart, which is the clearance that they miss.
    #[test]
    fn bodies_closer_than_the_clearance_are_not_told_as_far_apart_as_it() {
        let bodies = Contact { a: "forearm".into(), b: "part".into() };
        let separation = Separation { bodies: bodies.clone(), distance_mm: 4.96, place_in_base_mm: Point3::origin() };
        let obstruction = Obstruction {
            bodies,
            without_station: 2,
            without_path: 0,
            configuration: Configuration { joints_rad: [0.0; 6], table_rad: 0.0 },
            separation: Some(separation),
            advice: Advice::ReduceClearance(4.96),
        };
        let mut out = String::new();
        write_obstructions(&mut out, &[obstruction]).expect("a String takes all");
        assert!(out.contains("without a path; 4.9 mm apart at ") && out.contains("--set motion.clearance_mm=4.9\n"), "{out}");
    }

    #[test]
    fn a_region_that_misses_its_target_is_not_told_with_the_share_of_the_target() {
        let told = |measured_area_mm2: f64| {
            let region = RegionCoverage {
                name: "rim".to_owned(),
                kind: RegionKind::Interest,
                samples: 1,
                asked_area_mm2: 1000.0,
                coverable_area_mm2: 1000.0,
                measured_area_mm2,
                target: Some(0.9),
                tolerance_mm: None,
                min_tolerance_mm: 0.1,
                missed_mm2: Vec::new(),
                beyond_noise_area_mm2: 0.0,
                independent: None,
            };
            let mut out = String::new();
            write_regions(&mut out, &Coverage { regions: vec![region], ..Coverage::default() }).expect("a String takes all");
            out
        };
        assert!(told(899.96).contains("89.99 %; target 90.00 %: NOT MET"), "{}", told(899.96));
        assert!(told(900.0).contains("90.00 %; target 90.00 %: met"), "{}", told(900.0));
        assert!(told(999.99).contains("99.99 %; target 90.00 %: met"), "{}", told(999.99));
        assert_eq!((reached_percent(0.999_999, None), reached_percent(1.0, None)), ("99.99".to_owned(), "100.00".to_owned()));
    }

    #[test]
    fn a_region_is_told_with_its_share_on_samples_that_the_views_were_not_chosen_on() {
        let told = |measured_of_400: u32| {
            let independent = IndependentRegion {
                samples: 400,
                asked_area_mm2: 80.0,
                measured_area_mm2: 0.2 * f64::from(measured_of_400),
                squares_mm4: 400.0 * 0.04,
            };
            let region = RegionCoverage {
                name: "seat".to_owned(),
                kind: RegionKind::Interest,
                samples: 100,
                asked_area_mm2: 80.0,
                coverable_area_mm2: 80.0,
                measured_area_mm2: 76.8,
                target: Some(0.95),
                tolerance_mm: None,
                min_tolerance_mm: 0.1,
                missed_mm2: Vec::new(),
                beyond_noise_area_mm2: 0.0,
                independent: Some(independent),
            };
            let mut out = String::new();
            write_regions(&mut out, &Coverage { regions: vec![region], ..Coverage::default() }).expect("a String takes all");
            out
        };
        let (refuted, held) = (told(360), told(384));
        assert!(
            refuted.ends_with(
                "96.00 %; target 95.00 %: met on the samples that views were chosen on; on 400 others 90.00 %, standard error 1.50 \
                 points: NOT CONFIRMED\n"
            ),
            "{refuted}"
        );
        assert!(held.ends_with("target 95.00 %: met (independent 96.00 %, standard error 0.99 points)\n"), "{held}");
    }

    #[test]
    fn a_plan_of_what_scans_left_open_says_so_and_judges_no_whole_region() {
        let region = |samples: usize, measured_area_mm2: f64| RegionCoverage {
            name: "rim".to_owned(),
            kind: RegionKind::Interest,
            samples,
            asked_area_mm2: samples as f64,
            coverable_area_mm2: samples as f64,
            measured_area_mm2,
            target: None,
            tolerance_mm: None,
            min_tolerance_mm: 0.1,
            missed_mm2: Vec::new(),
            beyond_noise_area_mm2: 0.0,
            independent: None,
        };
        let coverage = Coverage { is_of_open: true, regions: vec![region(0, 0.0), region(1000, 218.1)], ..Coverage::default() };
        let mut out = String::new();
        write_regions(&mut out, &coverage).expect("a String takes all");
        assert!(out.contains("features, of what earlier scans left open\n") && out.contains(NOTHING_OPEN), "{out}");
        assert!(out.ends_with(" mm² measured, 21.81 % of the open area\n"), "{out}");
        assert!(!out.contains("NOT MET") && !out.contains(NOTHING_IN_REGION), "{out}");
        let mut out = String::new();
        write_coverage(&mut out, &coverage, &[], true).expect("a String takes all");
        assert!(out.starts_with("\ncoverage of what earlier scans left open\n") && out.contains(MEANING_OF_OPEN), "{out}");
        assert!(out.contains("\n  measured of open ") && !out.contains("of asked"), "asked is what the job asks for: {out}");
        assert!(!out.contains("every face outside excluded regions"), "{out}");
    }

    #[test]
    fn a_part_that_would_tip_over_is_told_after_the_summary() {
        let warning = FieldWarning {
            code: crate::wire::warnings::WarningCode::PartUnstable,
            pointer: "/params/part/table_from_part".to_owned(),
            detail: "the part would tip over as it is placed".to_owned(),
            remedy: "turn it".to_owned(),
        };
        let told = "Warning (part_unstable), part.table_from_part: the part would tip over as it is placed\n  turn it\n\n";
        assert_eq!((warned_of_plan(&[warning]).as_str(), warned_of_plan(&[]).as_str()), (told, ""));
    }

    /// The list of areas had nothing between what is asked and what is visible.
    #[test]
    fn areas_that_are_asked_and_never_visible_are_listed_apart() {
        let missed = |cause, area_mm2| MissedCause { cause, area_mm2, spots: Vec::new() };
        let coverage = Coverage { asked_area_mm2: 100.0, visible_area_mm2: 45.0, ..Coverage::default() };
        let all = [missed(Cause::ExcludedResting, 15.0), missed(Cause::Enclosed, 40.0), missed(Cause::Facing, 5.0)];
        let mut out = String::new();
        write_coverage(&mut out, &coverage, &all, false).expect("a String takes all");
        let listed: Vec<&str> = out.lines().skip(3).take(4).map(str::trim).collect();
        let row = |name: &str, area: &str| format!("{name:<24} {area:>12} mm²");
        let expected =
            [("asked", "100.0"), ("the part stands on it", "15.0"), ("enclosed by the part", "40.0"), ("visible", "45.0")];
        assert_eq!(listed, expected.map(|(name, area)| row(name, area)));
    }

    /// The report listed a move home of 0 s, and bounds of 0 s that it met.
    #[test]
    fn a_tour_without_views_is_told_as_none() {
        let target = Station { table_angle_rad: 0.0, joints_rad: [0.0; 6] };
        let return_home = Leg { via_rad: Vec::new(), target, duration_secs: 0.0, passed_within_rad: None, turning_secs: 0.0 };
        let none = Sequence { visits: Vec::new(), return_home, ordered_secs: 0.0, lower_bound_secs: 0.0, moving_lower_secs: 0.0 };
        let mut out = String::new();
        write_sequence(&mut out, &none, Corners::Stop).expect("a String takes all");
        assert_eq!(out, "\nsequence: none, because no view is executed\n");
    }

    #[test]
    fn advice_that_keeps_a_pose_in_which_the_part_tips_over_says_so() {
        let warning = FieldWarning {
            code: WarningCode::PartUnstable,
            pointer: "/params/part/table_from_part".to_owned(),
            detail: "the part would tip over as it is placed".to_owned(),
            remedy: "turn it".to_owned(),
        };
        assert!(keeps_unstable_pose([false, true], std::slice::from_ref(&warning)));
        assert!(!keeps_unstable_pose([false], std::slice::from_ref(&warning)) && !keeps_unstable_pose([true], &[]));
    }

    #[test]
    fn area_without_a_path_is_mended_by_the_home_where_that_is_blocked() {
        let warning = FieldWarning {
            code: WarningCode::HomeBlocked,
            pointer: "/cell/home_deg".to_owned(),
            detail: "lets forearm and part collide".to_owned(),
            remedy: "give the cell another home (`vantage cell --home`)".to_owned(),
        };
        let told = Some("give the cell another home (vantage cell --home)".to_owned());
        assert_eq!(home_remedy(Cause::NoPath, std::slice::from_ref(&warning)), told);
        assert_eq!(home_remedy(Cause::ShadowLeft, &[warning]), None);
        assert_eq!(home_remedy(Cause::NoPath, &[]), None);
    }

    #[test]
    fn the_5th_percentile_under_pose_errors_is_told_of_20_draws_and_not_of_fewer() {
        let drawn = |draws: usize| Drawn::new(0.97, vec![0.95; draws]);
        let pose_error = PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 };
        let robust = Robust { pose_error, views: drawn(6), part: drawn(20), hand_eye: drawn(1) };
        let mut out = String::new();
        write_certificate(&mut out, &Coverage { robust: Some(robust), ..Coverage::default() }).expect("a String takes all");
        let told: Vec<&str> = out.lines().skip_while(|line| !line.ends_with("off by 1° and 1 mm")).skip(1).collect();
        assert_eq!(
            told,
            [
                "  every view       nominal 97.00 %, mean 95.00 %, worst of 6 draws 95.00 %",
                "  part and support nominal 97.00 %, mean 95.00 %, 5th percentile 95.00 %, worst of 20 draws 95.00 %",
                "  hand-eye         nominal 97.00 %, mean 95.00 %, worst of 1 draw 95.00 %",
            ]
        );
    }

    #[test]
    fn a_small_pose_error_keeps_its_digits_and_a_round_one_has_no_more() {
        let sizes = |angle_deg, translation_mm| pose_error_sizes(&PoseErrorParams { angle_deg, translation_mm });
        assert_eq!(sizes(1.0, 100.0), ["1", "100"]);
        assert_eq!(sizes(0.004_691_357_8, 0.063_245_553_2), ["0.00469", "0.0632"]);
        assert_eq!(sizes(0.0, 12.345), ["0", "12.3"]);
    }

    /// "at least 0 views needed, gap 4" was told of further views, whose bound is not computed.
    #[test]
    fn a_bound_of_views_that_was_not_computed_is_not_told() {
        let told = |bound: Bound| {
            let mut out = String::new();
            write_bound(&mut out, &bound, &PlanParams::default()).expect("a String takes all");
            out
        };
        assert_eq!(told(Bound { gap: 4, ..Bound::default() }), "");
        let computed = told(Bound { views_lower: 3, gap: 1, ..Bound::default() });
        assert!(computed.starts_with("bound: at least 3 views needed") && computed.ends_with(", gap 1\n"), "{computed}");
    }

    #[test]
    fn one_view_measures_and_several_measure() {
        assert_eq!([0, 1, 2].map(measuring), ["0 views measure", "1 view measures", "2 views measure"]);
    }
}
