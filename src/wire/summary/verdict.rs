//! Verdict on a plan as a whole.

use super::missed::raised_target;
use super::{SummaryShares, no_path, percent, unmet_regions};
use crate::cell::closed_list;
use crate::geometry::sort_descending;
use crate::planning::params::{OverlapParams, SelectionGoal, TargetOf};
use crate::planning::plan::{Cause, MissedCause, Plan, RegionCoverage, Robust, StopReason, share};
use crate::wire::plan::options;
use crate::wire::total::total;
use crate::wire::words::{
    asked_name, cause_phrase, counted, fixed, fixed_nonzero, of_asked_phrase, percent_below, pose_error_sizes,
};

closed_list! {
    /// Verdict on a plan: the first of these that holds.
    pub enum PlanVerdict {
        /// The target of the plan is not reached.
        TargetMissed = "target_missed",
        /// The target of the plan is reached, or it has none; a region or feature does not reach its own, or independent samples refute
        /// that it does.
        RegionsUnmet = "regions_unmet",
        /// Nothing of the above, and no collision-free path was found to some of the chosen views, which are not executed; or none was
        /// found to any of them.
        ViewsWithoutPath = "views_without_path",
        /// Nothing of the above; wrong poses cost more than one point of the asked area in the worst draw (`coverage.robust`), and no
        /// less than what is not measured, unless the target leaves that open.
        Fragile = "fragile",
        /// Nothing of the above; more of the asked area is not measured than the target would allow of it, such as what the part
        /// stands on.
        PartlyMeasured = "partly_measured",
        /// The best coverage that was found with the views allowed: the plan has no target (`selection.goal` = `best_coverage`).
        BestCoverage = "best_coverage",
        /// Every target is reached.
        TargetMet = "target_met",
    }
}

closed_list! {
    /// Level of a verdict, which gives it its colour.
    pub enum PlanLevel {
        /// Every target is reached, and no more of the asked area is missing than the target allows.
        Ready = "ready",
        /// The part can be scanned as planned; something that was asked is missing, or is not certain. Or the part does not stand as it is
        /// placed.
        Limited = "limited",
        /// No view is executed.
        NotExecutable = "not_executable",
    }
}

impl PlanLevel {
    pub(super) fn of(plan: &Plan, verdict: PlanVerdict) -> Self {
        if plan.executed_views() == 0 {
            return Self::NotExecutable;
        }
        match verdict {
            PlanVerdict::TargetMet => Self::Ready,
            PlanVerdict::BestCoverage if is_asked_measured(plan) => Self::Ready,
            PlanVerdict::TargetMissed
            | PlanVerdict::RegionsUnmet
            | PlanVerdict::ViewsWithoutPath
            | PlanVerdict::Fragile
            | PlanVerdict::PartlyMeasured
            | PlanVerdict::BestCoverage => Self::Limited,
        }
    }
}

impl PlanVerdict {
    /// The verdict on a plan.
    #[must_use]
    pub fn of(plan: &Plan) -> Self {
        let is_partly_measured = !is_asked_measured(plan);
        // The larger loss is told first; the other is a clause.
        let is_missing_more = |loss: f64| is_partly_measured && 1.0 - plan.coverage.of_asked() > loss;
        let is_fragile = fragile_loss(plan).is_some_and(|loss| !is_missing_more(loss));
        let verdicts = [
            (plan.executed_views() == 0, Self::ViewsWithoutPath),
            (has_target(plan) && !is_target_met(plan), Self::TargetMissed),
            (plan.coverage.regions.iter().any(RegionCoverage::misses_target), Self::RegionsUnmet),
            (plan.executed_views() < plan.views.len(), Self::ViewsWithoutPath),
            (is_fragile, Self::Fragile),
            (has_target(plan) && is_partly_measured, Self::PartlyMeasured),
            (!has_target(plan), Self::BestCoverage),
        ];
        verdicts.into_iter().find_map(|(holds, verdict)| holds.then_some(verdict)).unwrap_or(Self::TargetMet)
    }
}

/// Loss of a fragile plan in the worst draw, as a share of the asked area; `None` for one that stands pose errors, or without any.
pub(super) fn fragile_loss(plan: &Plan) -> Option<f64> {
    plan.coverage.robust.as_ref().filter(|robust| robust.is_fragile()).map(Robust::worst_loss)
}

fn has_target(plan: &Plan) -> bool {
    plan.params.selection.goal != SelectionGoal::BestCoverage
}

fn is_target_met(plan: &Plan) -> bool {
    match plan.stopped_because {
        // Views that tolerate errors are chosen on few samples, and not held against every sample.
        StopReason::Target => !plan.params.robust.select || plan.coverage.reaches_target(&plan.params.selection),
        StopReason::NoPath => false,
        StopReason::Growth | StopReason::MaxViews | StopReason::NoGain | StopReason::RegionsUnmet => {
            plan.coverage.reaches_target(&plan.params.selection)
        }
    }
}

/// Returns true if the asked area is measured but for the share that the target leaves open, whatever the target is a share of.
fn is_asked_measured(plan: &Plan) -> bool {
    plan.coverage.measures_of_asked(plan.params.selection.target)
}

/// The level in a sentence, with the measured shares of the visible and of the asked area.
pub(super) fn title(level: PlanLevel, verdict: PlanVerdict, plan: &Plan, shares: &SummaryShares) -> String {
    let [visible, asked] = [shares.of_visible, shares.of_asked].map(percent);
    let is_of_open = plan.coverage.is_of_open;
    let measured = match is_of_open {
        true => {
            format!("further views measure {asked} of the area that earlier scans left open, {visible} of what is visible of it")
        }
        false => format!("{visible} of the visible and {asked} of the asked area measured"),
    };
    let not_measured = not_measured(plan, 1.0 - shares.of_asked);
    match (level, verdict) {
        (PlanLevel::Ready, _) => format!("Ready to scan: {measured}"),
        (PlanLevel::NotExecutable, _) => "Cannot be scanned: no collision-free path leads to any view".to_owned(),
        // What they leave open says little: most of it no view sees.
        (PlanLevel::Limited, PlanVerdict::PartlyMeasured | PlanVerdict::BestCoverage) if is_of_open => {
            format!("Can be scanned: {measured}")
        }
        (PlanLevel::Limited, PlanVerdict::PartlyMeasured | PlanVerdict::BestCoverage) => {
            format!("Can be scanned, but {not_measured}: {measured}")
        }
        (PlanLevel::Limited, PlanVerdict::Fragile) => format!("Can be scanned, but small pose errors cost coverage: {measured}"),
        (PlanLevel::Limited, _) => {
            let enclosed = if is_of_open { 0.0 } else { enclosed(plan, 1.0 - shares.of_asked) };
            let apart =
                if enclosed < MIN_SHOWN { String::new() } else { format!(", and {}", no_setup_measures(enclosed, OF_ASKED)) };
            format!("Can be scanned, with gaps{apart}: {measured}")
        }
    }
}

/// Share that two decimals of a percentage do not show.
const MIN_SHOWN: f64 = 5e-5;
/// Whole that a share is of, after its figure.
const OF_ASKED: &str = " of what was asked";

/// Share of the asked area that the part encloses, at most `open`, which is not measured.
fn enclosed(plan: &Plan, open: f64) -> f64 {
    let enclosed_mm2 = total(plan.missed.iter().filter(|missed| missed.cause == Cause::Enclosed).map(|missed| missed.area_mm2));
    // On the samples that views are chosen on, beside a share on independent ones.
    share(enclosed_mm2, plan.coverage.asked_area_mm2).min(open)
}

/// Share that the part encloses, in a clause.
fn no_setup_measures(enclosed: f64, of: &str) -> String {
    format!("{}{of} is enclosed by the part, where no setup can measure it", percent(enclosed))
}

/// Share of the asked area that is not measured, in a clause; apart from it, what the part encloses: no setup measures that.
fn not_measured(plan: &Plan, open: f64) -> String {
    let enclosed = enclosed(plan, open);
    let setups = match plan.setups.len() {
        0 | 1 => "this setup".to_owned(),
        setups => format!("these {setups} setups"),
    };
    let rest = |share: f64| format!("{}{OF_ASKED} is not measured in {setups}", percent(share));
    if enclosed < MIN_SHOWN {
        rest(open)
    } else if open - enclosed < MIN_SHOWN {
        no_setup_measures(enclosed, OF_ASKED)
    } else {
        format!("{}, and {}", rest(open - enclosed), no_setup_measures(enclosed, ""))
    }
}

/// The verdict in a sentence, with its figures.
pub(super) fn text(verdict: PlanVerdict, plan: &Plan) -> String {
    let reached = reached(plan);
    match verdict {
        PlanVerdict::TargetMissed => {
            let regions = unmet_regions(&plan.coverage.regions);
            let regions = if regions.is_empty() { regions } else { format!("; regions below their targets: {regions}") };
            format!("Target missed: {reached}: {}{regions}", reason(plan))
        }
        PlanVerdict::RegionsUnmet => {
            let regions = &plan.coverage.regions;
            let unmet = regions.iter().filter(|region| region.misses_target()).count();
            let with_target = regions.iter().filter(|region| region.target.is_some()).count();
            format!(
                "Regions unmet: {unmet} of {with_target} regions and features with a target: {}; the part as a whole: {reached}",
                unmet_regions(regions)
            )
        }
        PlanVerdict::ViewsWithoutPath => {
            let executed = if plan.executed_views() == 0 { "No view is executed" } else { "Not every view is executed" };
            format!("{executed}: {}; {reached}", no_path(plan).unwrap_or_default())
        }
        PlanVerdict::Fragile => {
            let found = if has_target(plan) { target_met(plan) } else { "Best coverage found" };
            format!("{found}, but fragile: {reached}; {}", fragile(plan))
        }
        PlanVerdict::PartlyMeasured => {
            let causes = largest_causes(plan);
            let whole = if plan.coverage.is_of_open { "the open area" } else { "asked" };
            let causes = if causes.is_empty() { causes } else { format!("; not measured (shares of {whole}): {causes}") };
            format!("{}: {reached}{causes}{}", target_met(plan), fragile_clause(plan))
        }
        PlanVerdict::BestCoverage => {
            let bound = plan.bound.of_asked_upper.map_or_else(String::new, |upper| format!("; upper bound {}", percent(upper)));
            format!("Best coverage found: {reached}{bound}{}", fragile_clause(plan))
        }
        PlanVerdict::TargetMet => format!("{}: {reached}", target_met(plan)),
    }
}

/// Claim on a target that is reached; further views are only expected to reach it, together with the scans before.
fn target_met(plan: &Plan) -> &'static str {
    if plan.coverage.is_of_open { "Target expected to be met" } else { "Target met" }
}

/// Share reached and the target that it is held against: "98.52 % of coverable, target 98.50 %". The target of further views is that
/// of the part, to which earlier scans add.
fn reached(plan: &Plan) -> String {
    let (coverage, selection) = (&plan.coverage, &plan.params.selection);
    if !has_target(plan) {
        return format!("{} {}", percent(coverage.of_asked()), of_asked_phrase(coverage.is_of_open));
    }
    let of = match (selection.target_of, coverage.is_of_open) {
        (TargetOf::Coverable, false) => "of coverable",
        (TargetOf::Coverable, true) => "of coverable in the open area",
        (TargetOf::Asked, false) => "of asked",
        (TargetOf::Asked, true) => "of the open area",
        (TargetOf::Total, false) => "of the whole surface",
        (TargetOf::Total, true) => "of the whole surface beside what earlier scans measured",
    };
    let together = if coverage.is_of_open { " together with the earlier scans" } else { "" };
    let at_risk = match coverage.at_risk.is_counted {
        false if coverage.at_risk.area_mm2 > 0.0 => " with the area at risk",
        _ => "",
    };
    let (reached, target) = (coverage.of_target(selection.target_of), selection.target);
    format!("{} % {of}{at_risk}, target {}{together}", percent_below(reached, target, 2), percent(target))
}

/// Rule of the rescan that ended the choice of further views, in a clause; `None` of any other plan, and where none of its rules did.
pub(crate) fn rescan_ended(plan: &Plan) -> Option<String> {
    if !plan.coverage.is_of_open {
        return None;
    }
    match plan.stopped_because {
        StopReason::Target => Some("the target of the plan is expected to be met together with the earlier scans".to_owned()),
        StopReason::Growth => Some("the next best view is expected to add less than min_gain of the rescan".to_owned()),
        StopReason::MaxViews => Some(format!("the rescan has as many views as its max_views allows, {}", plan.views.len())),
        StopReason::NoGain | StopReason::NoPath | StopReason::RegionsUnmet => None,
    }
}

/// Rule that ended the choice of views before the target, in a clause.
fn reason(plan: &Plan) -> String {
    // Further views are chosen by the rules of the rescan, whatever the parameters of the plan say.
    if let Some(ended) = rescan_ended(plan) {
        return ended;
    }
    let selection = &plan.params.selection;
    match plan.stopped_because {
        StopReason::Growth => {
            format!("the next best view would add less than {} % of asked", shortest(100.0 * selection.min_growth))
        }
        StopReason::MaxViews => match selection.max_views {
            Some(limit) => format!("the limit of {} is reached", counted(limit as usize, "view")),
            None => "the limit of views is reached".to_owned(),
        },
        StopReason::NoPath => no_path(plan).unwrap_or_else(|| "no collision-free path was found to some candidates".to_owned()),
        StopReason::Target if plan.params.robust.select => {
            let higher =
                raised_target(plan).map_or_else(String::new, |set| format!(" (a higher target adds views: {})", options(&set)));
            format!("views were chosen to tolerate pose errors, and on the samples of that choice they reach it{higher}")
        }
        StopReason::Target | StopReason::NoGain | StopReason::RegionsUnmet => no_gain(plan),
    }
}

/// Reason for which nothing could be gained any more, in a clause: all that can be measured falls short of the target, or no view is
/// worth what it costs.
fn no_gain(plan: &Plan) -> String {
    let (coverage, selection) = (&plan.coverage, &plan.params.selection);
    let coverable = share(coverage.coverable_area_mm2, coverage.whole_mm2(selection.target_of));
    if coverable < selection.target {
        return format!("all candidates together measure {}", percent(coverable));
    }
    let cost = if selection.view_cost_mm2_per_s > 0.0 { " worth its cost" } else { "" };
    let overlaps = selection.overlap != OverlapParams::default();
    let overlapping = if overlaps { " and overlaps the others as selection.overlap requires" } else { "" };
    format!("no further view adds anything{cost}{overlapping}")
}

/// Causes for which most of the asked area is missed, with their shares of it.
fn largest_causes(plan: &Plan) -> String {
    const NAMED: usize = 2;
    let mut missed: Vec<&MissedCause> = plan.missed.iter().collect();
    sort_descending(&mut missed, |missed| missed.area_mm2);
    let (named, rest) = missed.split_at(missed.len().min(NAMED));
    let of_asked = |area_mm2: f64| percent(share(area_mm2, plan.coverage.asked_area_mm2));
    let mut told: Vec<String> =
        named.iter().map(|missed| format!("{} ({})", cause_phrase(missed.cause), of_asked(missed.area_mm2))).collect();
    if !rest.is_empty() {
        told.push(format!("other causes ({})", of_asked(rest.iter().map(|missed| missed.area_mm2).sum())));
    }
    told.join(", ")
}

/// A number with as many decimals as it takes, at most six unless it is smaller.
pub(super) fn shortest(value: f64) -> String {
    let text = fixed_nonzero(value, 6);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Loss of a fragile plan in a clause that follows another; empty for one that stands pose errors.
fn fragile_clause(plan: &Plan) -> String {
    fragile_loss(plan).map_or_else(String::new, |_| format!("; {}", fragile(plan)))
}

/// Loss under pose errors in a clause.
fn fragile(plan: &Plan) -> String {
    plan.coverage.robust.as_ref().map_or_else(String::new, |robust| {
        let [angle_deg, shift_mm] = pose_error_sizes(&robust.pose_error);
        format!(
            "pose errors of {angle_deg}° and {shift_mm} mm cost {} percentage points of the {} area in the worst draw",
            fixed(100.0 * robust.worst_loss(), 2),
            asked_name(plan.coverage.is_of_open)
        )
    })
}
