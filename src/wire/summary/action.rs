//! The one best action: advice on the plan as a whole, else the fix that recovers the largest area.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;

use super::missed::{MissedGroup, VIEW_LIMIT, fixes, raised_target, rounded};
use super::verdict::{PlanVerdict, fragile_loss, shortest};
use crate::cell::PoseSpec;
use crate::geometry::{Part, Pose, Table};
use crate::planning::UpAxis;
use crate::planning::params::RobustParams;
use crate::planning::plan::{AdviceKind, Plan, RegionCoverage, RemedyKind, share};
use crate::wire::plan::{AdviceDocument, RobustDocument, options};
use crate::wire::words::{counted, fixed, limits_mm, listed, of_asked_phrase, percents_apart, pose_error_sizes, rounded_up_mm};

/// Action that would add the most measured area, tried in simulation: advice on the plan as a whole, or the fix of missed spots,
/// whose effect counts all spots that it is for. If pose errors cost the plan at least as much, it is to choose views that
/// tolerate them; if a region misses its target because a tolerance is finer than the scanner's noise allows, and no advice adds
/// a twentieth of the asked area, it is a coarser tolerance or a larger budget of noise; if the home of the cell is blocked, it
/// is another home; and if the part would tip over as it is placed, it is to place it so that it stands, before anything else.
/// The effects of these four are not estimated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct SummaryAction {
    /// Action in one sentence, with the options that set its parameters and its estimated effect.
    pub text: String,
    /// Parameters to set, by their dotted names; empty if no parameter of this plan does it.
    pub set: BTreeMap<String, Value>,
    /// Command-line options that set these parameters; `null` if there are none.
    pub command: Option<String>,
    /// Measured share of the asked area now, on the samples that views are chosen on.
    pub from_of_asked: f64,
    /// Share that it is estimated to give, on the same samples: a plan with the parameters chooses its views anew. Where no effect
    /// is estimated, the share now.
    pub to_of_asked: f64,
    /// Number of views that it adds: an estimate for advice on the whole plan (see `advice[].views` of `plan.json`), an upper
    /// bound for a fix of missed spots, and 0 if no effect is estimated.
    pub added_views: usize,
    /// Estimated change of the cycle time, s; turning the part over is not counted. `null` without a cell, or if it is not known.
    /// How far estimates are off is told with `advice[].cycle_secs` of `plan.json`.
    pub added_cycle_secs: Option<f64>,
}

/// Way to place a part so that it stands, which would tip over as it is placed.
#[derive(Clone, Debug, PartialEq)]
pub enum StandingRemedy {
    /// Axis of the part that goes up, and the pose in which the part then stands.
    WithAxisUp(UpAxis, Pose<Table, Part>),
    /// Pose in which it stands.
    InPose(Pose<Table, Part>),
    /// Poses that the planner chooses, in place of those that were given.
    InPosesOfPlanner,
}

/// Share of the asked area that the fix of missed spots recovers at least to be the best action, unless a region misses its target: our
/// choice.
const MIN_GAIN: f64 = 0.001;

/// Share of the asked area that advice on the whole plan adds at least to come before a coarser tolerance, whose effect is not estimated:
/// our choice.
const MIN_GAIN_BEFORE_TOLERANCE: f64 = 0.05;

/// Share of the missed area of a region above which the noise is the reason for it: our choice, as in the warning on the region.
const MAINLY: f64 = 0.5;
/// Features named in an action.
const NAMED: usize = 3;

/// The best action for a plan; `None` where none is known. What no view can mend comes first, unless advice on the whole plan
/// adds [`MIN_GAIN_BEFORE_TOLERANCE`]. Of a plan that reaches its targets, an action that gains no more than pose errors cost
/// comes after the choice of views that stand them.
pub(super) fn best(plan: &Plan, verdict: PlanVerdict, cycle_secs: Option<f64>) -> Option<SummaryAction> {
    // Better grades add no measured area.
    let adds_area = |advice: &AdviceDocument| advice.kind != AdviceKind::BetterGrades.as_str();
    let advised = AdviceDocument::all_of(plan).into_iter().find(adds_area).map(|advice| advised(plan, &advice, cycle_secs));
    if let Some(coarser) = within_noise(plan) {
        let gains_much = |action: &SummaryAction| action.to_of_asked - action.from_of_asked >= MIN_GAIN_BEFORE_TOLERANCE;
        return advised.filter(gains_much).or(Some(coarser));
    }
    let fixed = || {
        // Of two that recover the same area, the one that mends its spots whole.
        let by_area =
            |a: &MissedGroup, b: &MissedGroup| a.recovers_mm2.total_cmp(&b.recovers_mm2).then(a.fix_known.cmp(&b.fix_known));
        let best = fixes(plan).into_iter().max_by(by_area).map(|group| fixed_group(plan, &group));
        // A small gain may be all that a region or the plan lacks.
        let lacks_region = plan.coverage.regions.iter().any(RegionCoverage::misses_target);
        let is_enough = |action: &SummaryAction| verdict == PlanVerdict::TargetMissed && reaches_target(plan, action);
        best.filter(|action| lacks_region || is_enough(action) || action.to_of_asked - action.from_of_asked >= MIN_GAIN)
    };
    let tolerant = fragile_loss(plan).filter(|_| meets_targets(verdict)).and_then(|loss| Some((loss, robust(plan)?)));
    if let Some((loss, tolerant)) = tolerant {
        // What a fragile plan misses is less than the loss, or what its target leaves open.
        let is_open = verdict != PlanVerdict::Fragile;
        let gains_more = |action: &SummaryAction| is_open && action.to_of_asked - action.from_of_asked > loss;
        return advised.filter(gains_more).or_else(|| fixed().filter(gains_more)).or(Some(tolerant));
    }
    advised.or_else(fixed).or_else(|| higher_target(plan))
}

/// Feature of a finer tolerance than the noise allows, by its place among the features.
struct TooFine<'a> {
    index: usize,
    name: &'a str,
    tolerance_mm: f64,
}

/// Coarser tolerances, or a larger budget of noise, for features because of which regions miss their targets: no view measures with so
/// little noise. `None` where there are none.
fn within_noise(plan: &Plan) -> Option<SummaryAction> {
    let noise = &plan.params.regions.noise;
    let too_fine = too_fine(plan);
    let finest_mm = too_fine.iter().map(|feature| feature.tolerance_mm).min_by(f64::total_cmp)?;
    let coarser = match &too_fine[..] {
        [TooFine { index, name, tolerance_mm }] => {
            let (own_mm, limits) = (shortest(*tolerance_mm), limits_mm(*tolerance_mm));
            format!("give {name:?} a coarser tolerance than {limits} mm (regions.features.{index}.tolerance_mm is {own_mm})")
        }
        several => {
            let named = |feature: &TooFine<'_>| format!("{:?} ({} mm)", feature.name, limits_mm(feature.tolerance_mm));
            let mut named: Vec<String> = several.iter().take(NAMED).map(named).collect();
            if several.len() > NAMED {
                named.push(counted(several.len() - NAMED, "more feature"));
            }
            format!("give {} coarser tolerances (tolerance_mm)", listed(&named))
        }
    };
    let budget = noise.budget * noise.min_tolerance_mm() / finest_mm;
    let budget = match budget <= 1.0 {
        true => {
            let least = rounded_up_mm(budget);
            format!("; or allow the noise a larger share of the tolerance (regions.noise.budget, at least {least})")
        }
        false => String::new(),
    };
    let [min_mm, limit_mm] = [1.0, 0.5].map(|share| rounded_up_mm(share * noise.min_tolerance_mm()));
    let text = format!(
        "{coarser}: the finest that this scanner's noise allows is ±{limit_mm} mm (tolerance_mm = {min_mm}), at best focus and \
         perpendicular to the surface{budget}; effect not estimated"
    );
    Some(without_estimate(plan, BTreeMap::new(), text))
}

/// Features because of whose tolerances regions miss their targets: their own, or those of regions that they overlap.
fn too_fine(plan: &Plan) -> Vec<TooFine<'_>> {
    let (params, regions) = (&plan.params.regions, &plan.coverage.regions);
    let is_for_noise = |region: &&RegionCoverage| {
        let missed_mm2 = region.asked_area_mm2 - region.measured_area_mm2;
        region.is_unmet() && region.beyond_noise_area_mm2 > MAINLY * missed_mm2
    };
    let unmet: Vec<&RegionCoverage> = regions.iter().filter(is_for_noise).collect();
    let is_own = |region: &RegionCoverage| region.tolerance_mm.is_some_and(|own_mm| own_mm < region.min_tolerance_mm);
    let is_of_others = unmet.iter().any(|region| !is_own(region));
    let features = params.beyond_noise().filter_map(|(index, feature)| {
        let name = regions.get(params.interest.len() + index)?.name.as_str();
        let counts = is_of_others || unmet.iter().any(|region| region.name == name);
        counts.then_some(TooFine { index, name, tolerance_mm: feature.tolerance_mm })
    });
    features.collect()
}

/// Returns true if a plan reaches its target with what an action recovers.
fn reaches_target(plan: &Plan, action: &SummaryAction) -> bool {
    let (coverage, selection) = (&plan.coverage, &plan.params.selection);
    let gained_mm2 = (action.to_of_asked - action.from_of_asked) * coverage.asked_area_mm2;
    let gained = share(gained_mm2, coverage.whole_mm2(selection.target_of));
    coverage.of_target(selection.target_of) + gained >= selection.target
}

/// Returns true if nothing comes before what is not measured and what pose errors cost.
fn meets_targets(verdict: PlanVerdict) -> bool {
    match verdict {
        PlanVerdict::Fragile | PlanVerdict::PartlyMeasured | PlanVerdict::BestCoverage | PlanVerdict::TargetMet => true,
        PlanVerdict::TargetMissed | PlanVerdict::RegionsUnmet | PlanVerdict::ViewsWithoutPath => false,
    }
}

/// A higher target for views that are chosen for pose errors too and miss theirs; `None` for any other plan.
fn higher_target(plan: &Plan) -> Option<SummaryAction> {
    let set = raised_target(plan)?;
    let text = format!("raise the target, so that more views are chosen: {}; effect not estimated", options(&set));
    Some(without_estimate(plan, set, text))
}

/// Another home for a plan whose home is blocked, in the words of that warning: no parameter of a plan sets it. The measured share of the
/// asked area is that on the samples that views are chosen on.
pub(super) fn another_home(remedy: &str, of_asked: f64) -> SummaryAction {
    unestimated(of_asked, BTreeMap::new(), format!("{remedy}; effect not estimated"))
}

/// Placement in which the part stands, for a plan in a setup of which it would tip over; the measured share of the asked area
/// is that on the samples that views are chosen on.
pub(super) fn placed_to_stand(remedy: &StandingRemedy, of_asked: f64) -> SummaryAction {
    let (name, value) = match remedy {
        StandingRemedy::WithAxisUp(_, pose) | StandingRemedy::InPose(pose) => {
            ("part.table_from_part", json!(rounded(PoseSpec::from(pose))))
        }
        StandingRemedy::InPosesOfPlanner => ("part.resting_poses", json!([])),
    };
    let set = BTreeMap::from([(name.to_owned(), value)]);
    let command = match remedy {
        StandingRemedy::WithAxisUp(up, _) => format!("--up {up}"),
        StandingRemedy::InPose(_) | StandingRemedy::InPosesOfPlanner => options(&set),
    };
    let text = match remedy {
        StandingRemedy::WithAxisUp(up, _) => {
            format!("place the part with its {up} axis up, so that it stands ({command}); effect not estimated")
        }
        StandingRemedy::InPose(_) => format!("place the part so that it stands: {command}; effect not estimated"),
        StandingRemedy::InPosesOfPlanner => {
            format!("let Vantage choose setups in which the part stands: {command}; effect not estimated")
        }
    };
    SummaryAction { command: Some(command), ..unestimated(of_asked, set, text) }
}

/// Action whose effect is not estimated.
fn without_estimate(plan: &Plan, set: BTreeMap<String, Value>, text: String) -> SummaryAction {
    unestimated(plan.coverage.of_asked(), set, text)
}

/// Action whose effect is not estimated, on a plan that measures this share of the asked area.
fn unestimated(of_asked: f64, set: BTreeMap<String, Value>, text: String) -> SummaryAction {
    SummaryAction {
        text,
        command: (!set.is_empty()).then(|| options(&set)),
        set,
        from_of_asked: of_asked,
        to_of_asked: of_asked,
        added_views: 0,
        added_cycle_secs: None,
    }
}

/// Views that are chosen for what they measure under pose errors too; `None` if they are, or if no errors are evaluated.
fn robust(plan: &Plan) -> Option<SummaryAction> {
    let robust = plan.coverage.robust.as_ref().filter(|_| !plan.params.robust.select)?;
    let (error, costliest) = (robust.pose_error, RobustDocument::from(robust).costliest());
    let set = BTreeMap::from([("robust.select".to_owned(), Value::Bool(true))]);
    // Neither given nor that of a calibration: the error of no cell.
    let is_default = RobustParams::default().pose_error == Some(error);
    let or_own =
        if is_default { "; or set the cell's own error in place of the default: --set robust.pose_error=…" } else { "" };
    let [angle_deg, shift_mm] = pose_error_sizes(&error);
    let text = format!(
        "choose views that tolerate pose errors of {angle_deg}° and {shift_mm} mm (costliest: {}, {} percentage points): {}; \
         effect not estimated{or_own}",
        costliest.kind,
        fixed(100.0 * costliest.loss(), 2),
        options(&set)
    );
    Some(without_estimate(plan, set, text))
}

fn advised(plan: &Plan, advice: &AdviceDocument, cycle_secs: Option<f64>) -> SummaryAction {
    let laying = advice.laying();
    let views = laying.as_ref().map(|_| match advice.added_views {
        0 => "no more views".to_owned(),
        added => format!("about +{}", counted(added, "view")),
    });
    let what = laying.unwrap_or_else(|| format!("choose {}", counted(advice.added_views, "more view")));
    let regions = advice.regions_clause();
    let mut action = SummaryAction {
        text: String::new(),
        command: Some(options(&advice.set)),
        set: advice.set.clone(),
        from_of_asked: plan.coverage.of_asked(),
        to_of_asked: advice.of_asked,
        added_views: advice.added_views,
        added_cycle_secs: advice.cycle_secs.zip(cycle_secs).map(|(then_secs, now_secs)| then_secs - now_secs),
    };
    let remark = if advice.laying().is_some() { " (without laying it anew)" } else { "" };
    action.text = action.sentence(&what, views, (plan.coverage.is_of_open, remark)) + &regions;
    action
}

fn fixed_group(plan: &Plan, group: &MissedGroup) -> SummaryAction {
    let from_of_asked = plan.coverage.of_asked();
    // A limit of views that the command does not raise holds for its plan too.
    let limit = plan.params.selection.max_views.filter(|_| !group.set.contains_key(VIEW_LIMIT));
    let left = limit.map_or(usize::MAX, |limit| (limit as usize).saturating_sub(plan.views.len()));
    let added_views = group.added_views.min(left);
    let mut action = SummaryAction {
        text: String::new(),
        command: group.command(),
        set: group.set.clone(),
        from_of_asked,
        // No more than is missing: sums over spots are not exact to the last bit.
        to_of_asked: (from_of_asked + share(group.recovers_mm2, plan.coverage.asked_area_mm2)).min(1.0),
        added_views,
        added_cycle_secs: None,
    };
    // Every other fix says how many views it adds.
    let is_setup = group.fix == Some(RemedyKind::Setup);
    let views = is_setup.then(|| match added_views {
        0 => "no more views".to_owned(),
        added => format!("up to +{}", counted(added, "view")),
    });
    action.text = action.sentence(&group.fix_text, views, (plan.coverage.is_of_open, ""));
    action
}

impl SummaryAction {
    /// The action with its command and its effect: `turn it upside down and scan again: --set setups=2; estimated effect: 70.1 →
    /// 97.9 % of asked, about +2 views, about +9 s (without laying it anew)`. `views` are those that a plan with the parameters
    /// adds, where `what` does not say so.
    fn sentence(&self, what: &str, views: Option<String>, (is_of_open, remark): (bool, &str)) -> String {
        let command = self.command.as_ref().map_or_else(String::new, |command| format!(": {command}"));
        let [from, to] = percents_apart([self.from_of_asked, self.to_of_asked]);
        let of = of_asked_phrase(is_of_open);
        let effect = if from == to { format!("{from} % {of}, unchanged") } else { format!("{from} → {to} % {of}") };
        let cycle = self.added_cycle_secs.map_or_else(String::new, |secs| format!(", {}{remark}", cycle_change(secs)));
        let views = views.map_or_else(String::new, |views| format!(", {views}"));
        format!("{what}{command}; estimated effect: {effect}{views}{cycle}")
    }
}

/// A change of the cycle with its sign, in whole seconds: an estimate.
fn cycle_change(secs: f64) -> String {
    let text = fixed(secs, 0);
    match text.as_str() {
        "0" => "about the same cycle time".to_owned(),
        shorter if shorter.starts_with('-') => format!("about {shorter} s"),
        longer => format!("about +{longer} s"),
    }
}
