//! Missed spots in groups: those of the same cause that the same fix would measure.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;

use super::percent;
use crate::cell::PoseSpec;
use crate::geometry::{Part, Pose, Table, sort_descending};
use crate::planning::params::{SelectionGoal, TargetOf};
use crate::planning::plan::{AdviceKind, Cause, MissedSpot, Plan, PlanAdvice, Remedy, RemedyKind, RemedyView, StopReason, share};
use crate::wire::plan::{AdviceDocument, options};
use crate::wire::total::total;
use crate::wire::words::{
    ChoiceRules, area_mm2, cause_phrase, counted, none_found, of_asked_phrase, partial_of_spots, percent_below, rounded_down_deg,
    rounded_to, turn_phrase, untried_remedy,
};

/// Largest number of setups of a plan: the range of `setups`.
const MAX_SETUPS: u32 = 4;
/// Largest number of views of a plan: the range of `selection.max_views`.
const MAX_VIEWS: usize = 1000;
/// Parameter that takes poses to consider.
const POSES: &str = "candidates.poses";
/// Parameter that says how the part lies.
const LIES: &str = "part.table_from_part";
/// Largest number of poses in a command; more are left to `missed.json`.
const MAX_POSES: usize = 2;
/// Parameters that end the choice of views.
const TARGET: &str = "selection.target";
pub(super) const VIEW_LIMIT: &str = "selection.max_views";
const GROWTH: &str = "selection.min_growth";
/// Parameters that limit the angle of incidence.
const CAMERA_LIMIT: &str = "limits.camera_deg";
const PROJECTOR_LIMIT: &str = "limits.projector_deg";
/// Fix of area that no view sees from outside.
const EXCLUDE_ENCLOSED: &str = "no view can see it; exclude it if it need not be measured (regions.exclude)";
/// Steps of a target in one: of a spot of 0.1 % of the asked area, rounding leaves out a tenth.
const TARGET_STEPS: f64 = 1e4;

/// Missed spots of the same cause and the same fix.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct MissedGroup {
    /// Cause for which the spots are missed.
    pub reason: Cause,
    /// Number of spots.
    pub spots: usize,
    /// Missed area of the spots.
    pub area_mm2: f64,
    /// Missed area of the spots as a share of the asked area.
    pub of_asked: f64,
    /// Kind of the fix: `none` if none was found, or only more views of a plan that left out views for want of a path; `null` if
    /// none was searched for, because larger spots come first, or because the home of the cell is blocked, which has to be fixed
    /// before anything else.
    pub fix: Option<RemedyKind>,
    /// True if the fix was simulated and measures at least 90 % of each of the spots.
    pub fix_known: bool,
    /// Fix in words, without its effect.
    pub fix_text: String,
    /// Share and area of the spots that the fix measures, in words, to be said before the fix: `null` if it measures at least 90 % of
    /// each of them, and if there is no fix.
    #[serde(default)]
    pub partial_text: Option<String>,
    /// Part of the missed area that the fix measures.
    pub recovers_mm2: f64,
    /// Upper bound on the number of views that the fix adds: one or more for each spot, although one view often does for several.
    pub added_views: usize,
    /// Parameters that apply the fix, by their dotted names; empty if no parameter of this plan does. With `selection.target` a plan
    /// measures as much more area, in these spots or elsewhere.
    pub set: BTreeMap<String, Value>,
    /// Group in one sentence, with the options that set the parameters.
    pub text: String,
}

/// The fix of a spot, as far as it makes a group.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Fix {
    kind: RemedyKind,
    works: bool,
    turn: Option<String>,
    /// Pose into which the part is turned, as options have it: two may be turned to in the same words.
    lies: Option<String>,
}

/// Parameters by their dotted names.
pub(crate) type OptionSet = BTreeMap<String, Value>;

/// Spots of one cause, with the same fix.
type SpotsOfFix<'a> = (Cause, Option<Fix>, Vec<&'a MissedSpot>);

/// The groups of a plan, the largest area first. Those that one command would fix are one: it has one effect.
pub(super) fn groups(plan: &Plan) -> Vec<MissedGroup> {
    merged(plan, spots_of_fixes(plan), |[(cause, set), (other_cause, other_set)]| {
        cause == other_cause && !set.is_empty() && is_same_command(set, other_set)
    })
}

/// The fixes of a plan, each as one group of all the spots that one command is for, whatever they are missed for: it measures them
/// all at once. Of rules and limits, the command has the values that are enough for all.
pub(super) fn fixes(plan: &Plan) -> Vec<MissedGroup> {
    let mut fixable = spots_of_fixes(plan);
    let is_fix = |fix: &Fix| fix.kind != RemedyKind::None && without_path(plan, fix.kind).is_none();
    fixable.retain(|(_, fix, _)| fix.as_ref().is_some_and(is_fix));
    merged(plan, fixable, |[(_, set), (_, other_set)]| is_one_command(set, other_set))
}

/// Spots of each cause and fix.
fn spots_of_fixes(plan: &Plan) -> Vec<SpotsOfFix<'_>> {
    let mut spots: BTreeMap<(Cause, Option<Fix>), Vec<&MissedSpot>> = BTreeMap::new();
    for missed in &plan.missed {
        for spot in &missed.spots {
            spots.entry((missed.cause, spot.remedy.as_ref().map(|remedy| Fix::of(plan, remedy)))).or_default().push(spot);
        }
    }
    spots.into_iter().map(|((cause, fix), spots)| (cause, fix, spots)).collect()
}

/// The groups, the largest area first, with those as one that have like fixes and of which `is_same` says so by their causes and
/// the parameters that apply the fixes.
fn merged<'a>(plan: &Plan, all: Vec<SpotsOfFix<'a>>, is_same: impl Fn([(Cause, &OptionSet); 2]) -> bool) -> Vec<MissedGroup> {
    let mut merged: Vec<SpotsOfFix<'a>> = Vec::new();
    for (cause, fix, spots) in all {
        let set = group(plan, cause, fix.as_ref(), &spots).set;
        let same = merged.iter_mut().find(|(other_cause, other_fix, other_spots)| {
            let other_set = || group(plan, *other_cause, other_fix.as_ref(), other_spots).set;
            Fix::is_like(other_fix.as_ref(), fix.as_ref()) && is_same([(cause, &set), (*other_cause, &other_set())])
        });
        match same {
            // If one of them works and the other does not, both together do not.
            Some((_, other_fix, other_spots)) => {
                other_fix.iter_mut().zip(&fix).for_each(|(other, fix)| other.works &= fix.works);
                other_spots.extend(spots);
            }
            None => merged.push((cause, fix, spots)),
        }
    }
    let mut groups: Vec<_> = merged.iter().map(|(cause, fix, spots)| group(plan, *cause, fix.as_ref(), spots)).collect();
    // Stable: of equal ones the order of causes stays.
    sort_descending(&mut groups, |group| group.area_mm2);
    groups
}

/// Groups of a plan whose home is blocked, from those that it has otherwise: all that is missed for want of a path is one group, whose
/// fix is the remedy of the home, whatever else was tried.
pub(super) fn with_home_remedy(groups: Vec<MissedGroup>, remedy: &str, is_of_open: bool) -> Vec<MissedGroup> {
    let (pathless, mut groups): (Vec<_>, Vec<_>) = groups.into_iter().partition(|group| group.reason == Cause::NoPath);
    if pathless.is_empty() {
        return groups;
    }
    let mut group = MissedGroup {
        reason: Cause::NoPath,
        spots: pathless.iter().map(|group| group.spots).sum(),
        area_mm2: total(pathless.iter().map(|group| group.area_mm2)),
        of_asked: total(pathless.iter().map(|group| group.of_asked)),
        fix: None,
        fix_known: false,
        fix_text: remedy.to_owned(),
        partial_text: None,
        recovers_mm2: 0.0,
        added_views: 0,
        set: OptionSet::new(),
        text: String::new(),
    };
    group.text = group.sentence(is_of_open);
    groups.push(group);
    sort_descending(&mut groups, |group| group.area_mm2);
    groups
}

/// Returns true if two groups ask for the same. The rules that end the choice follow from what a group recovers, so they tell two apart
/// only where there is nothing else to set.
fn is_same_command(one: &OptionSet, other: &OptionSet) -> bool {
    let [own, other_own] = [one, other].map(|set| without(set, &[TARGET, VIEW_LIMIT, GROWTH]));
    if own.is_empty() { one == other } else { own == other_own }
}

/// Returns true if one command can ask for all that two groups of like fixes ask for: rules and limits that are eased for one of them
/// are eased for the other too.
fn is_one_command(one: &OptionSet, other: &OptionSet) -> bool {
    let [own, other_own] = [one, other].map(|set| without(set, &[TARGET, VIEW_LIMIT, GROWTH, CAMERA_LIMIT, PROJECTOR_LIMIT]));
    own == other_own
}

/// Parameters without those of some names.
fn without(set: &OptionSet, names: &[&str]) -> OptionSet {
    let others = set.iter().filter(|(name, _)| !names.contains(&name.as_str()));
    others.map(|(name, value)| (name.clone(), value.clone())).collect()
}

impl Fix {
    fn of(plan: &Plan, remedy: &Remedy) -> Self {
        let works = remedy.works() && without_path(plan, remedy.kind).is_none();
        let lies = remedy.table_from_part.as_ref().map(|pose| json!(rounded(PoseSpec::from(pose))).to_string());
        Self { kind: remedy.kind, works, turn: remedy.turn.as_ref().map(turn_phrase), lies }
    }

    /// Returns true if two fixes are the same to do, whether or not they work.
    fn is_like(one: Option<&Self>, other: Option<&Self>) -> bool {
        let is_same = |(one, other): (&Self, &Self)| one.kind == other.kind && one.turn == other.turn && one.lies == other.lies;
        one.zip(other).is_some_and(is_same)
    }
}

/// Remedy in place of more views of a plan that views without a path were left out of: they are no fix. `None` for any other.
fn without_path(plan: &Plan, kind: RemedyKind) -> Option<&'static str> {
    ChoiceRules::of(plan).without_path().filter(|_| kind == RemedyKind::View)
}

fn group(plan: &Plan, cause: Cause, fix: Option<&Fix>, spots: &[&MissedSpot]) -> MissedGroup {
    let without_path = fix.and_then(|fix| without_path(plan, fix.kind));
    let found = spots.iter().filter_map(|spot| spot.remedy.as_ref());
    let remedies: Vec<&Remedy> = found.filter(|_| without_path.is_none()).collect();
    let area_mm2 = total(spots.iter().map(|spot| spot.area_mm2));
    let recovers_mm2 = total(remedies.iter().map(|remedy| remedy.area_mm2));
    let views = views_of(&remedies);
    // Further views of a part are planned with the first plan's parameters, and take none of their own.
    let settable = fix.filter(|_| !plan.coverage.is_of_open);
    let set = settable.map_or_else(OptionSet::new, |fix| settings(plan, fix, &remedies, &views));
    let fix_words = match (fix, without_path) {
        (Some(Fix { kind: RemedyKind::None, .. }), _) if cause == Cause::Enclosed => EXCLUDE_ENCLOSED.to_owned(),
        (Some(_), Some(instead)) => instead.to_owned(),
        (Some(fix), None) => fix_text(fix, &remedies, views.len()),
        (None, _) => "no fix searched for".to_owned(),
    };
    let kind = fix.map(|fix| if without_path.is_some() { RemedyKind::None } else { fix.kind });
    let is_partial = fix.is_some_and(|fix| !fix.works) && kind != Some(RemedyKind::None);
    let mends_nothing = fix.is_none_or(|fix| fix.kind == RemedyKind::None);
    let untried = if mends_nothing { untried_remedy(plan, cause) } else { None };
    let mut group = MissedGroup {
        reason: cause,
        spots: spots.len(),
        area_mm2,
        of_asked: share(area_mm2, plan.coverage.asked_area_mm2),
        fix: kind,
        fix_known: fix.is_some_and(|fix| fix.works),
        fix_text: untried.unwrap_or(fix_words) + own_plan_remark(&set),
        partial_text: is_partial.then(|| partial_of_spots(spots.len(), area_mm2, recovers_mm2)),
        recovers_mm2,
        added_views: views.len(),
        set,
        text: String::new(),
    };
    group.text = group.sentence(plan.coverage.is_of_open);
    group
}

/// Views of some remedies, each once.
fn views_of<'a>(remedies: &[&'a Remedy]) -> Vec<&'a RemedyView> {
    let mut views: Vec<&RemedyView> = Vec::new();
    for view in remedies.iter().flat_map(|remedy| &remedy.views) {
        if views.iter().all(|other| other.part_from_scanner != view.part_from_scanner) {
            views.push(view);
        }
    }
    views
}

impl MissedGroup {
    /// The group in one sentence: `12 spots, 7.80 % of asked, hidden from the left camera: …`. The share of a fix that does not work for
    /// each of the spots comes before the fix.
    fn sentence(&self, is_of_open: bool) -> String {
        let mut shown = self.set.clone();
        // Too long for a line that people read.
        shown.remove(POSES);
        let is_posed = matches!(self.fix, Some(RemedyKind::Roll | RemedyKind::Tilt | RemedyKind::Standoff));
        let left_out = if is_posed { " (candidates.poses: those in missed.json)" } else { "" };
        let command = if shown.is_empty() { left_out.to_owned() } else { format!("{left_out}: {}", options(&shown)) };
        let [partial, recovers] = match (self.fix, &self.partial_text) {
            (Some(RemedyKind::None) | None, _) => [String::new(), String::new()],
            (Some(_), Some(partial)) => [format!("{partial}{}: ", self.elsewhere()), String::new()],
            (Some(_), None) => [String::new(), format!("; recovers {}{}", self.recovers(), self.elsewhere())],
        };
        format!(
            "{}, {} {}, {}: {partial}{}{command}{recovers}",
            counted(self.spots, "spot"),
            percent(self.of_asked),
            of_asked_phrase(is_of_open),
            cause_phrase(self.reason),
            self.fix_text
        )
    }

    /// Remark on a fix that asks for more views by the rules that end a choice: a plan takes them for whatever surface is easiest to
    /// measure.
    fn elsewhere(&self) -> &'static str {
        let target = self.set.get(TARGET).and_then(Value::as_f64);
        let asks_for_more = [TARGET, VIEW_LIMIT, GROWTH].iter().any(|rule| self.set.contains_key(*rule));
        if asks_for_more && target.is_none_or(|target| target < 1.0) { ", there or elsewhere" } else { "" }
    }

    /// Options of the command line that ask for the fix; `None` if no parameter does.
    #[must_use]
    pub fn command(&self) -> Option<String> {
        (!self.set.is_empty()).then(|| options(&self.set))
    }

    /// Area that the fix measures, and its share of the group: `61.1 mm² (93 %)`.
    #[must_use]
    pub fn recovers(&self) -> String {
        let of_group = share(self.recovers_mm2, self.area_mm2);
        // What is left of a group is not rounded away.
        format!("{} mm² ({} %)", area_mm2(self.recovers_mm2), percent_below(of_group, 1.0, 0))
    }
}

/// The fix in words.
fn fix_text(fix: &Fix, remedies: &[&Remedy], views: usize) -> String {
    // Views are counted spot by spot; one view of a plan with the target often does for several spots.
    let of_one_spot = remedies.iter().map(|remedy| remedy.views.len()).max().unwrap_or_default();
    let more = if of_one_spot < views { format!("{of_one_spot} to {views} more views") } else { counted(views, "more view") };
    match fix.kind {
        RemedyKind::View => more,
        RemedyKind::Roll => format!("{more}, rolled"),
        RemedyKind::Tilt => format!("{more}, tilted"),
        RemedyKind::Standoff => format!("{more} from another distance"),
        RemedyKind::Setup => format!("{} and scan again", fix.turn.as_deref().unwrap_or("turn it onto another side")),
        // A plan with them chooses its views anew, mostly fewer that look at more of the part at a flat angle.
        RemedyKind::Limit => format!("{more} with larger limits of incidence, which lowers grades of the whole part"),
        RemedyKind::None => none_found(remedies.iter().map(|remedy| remedy.tried).max().unwrap_or_default()),
    }
}

/// Parameters that ask for a fix; empty where none does.
fn settings(plan: &Plan, fix: &Fix, remedies: &[&Remedy], views: &[&RemedyView]) -> OptionSet {
    let with_rules = |mut set: OptionSet| {
        if !set.is_empty() {
            set.extend(stop_rules(plan, remedies));
        }
        set
    };
    match fix.kind {
        RemedyKind::View => stop_rules(plan, remedies),
        RemedyKind::Roll | RemedyKind::Tilt | RemedyKind::Standoff => with_rules(poses(plan, views)),
        RemedyKind::Setup => turned_setup(plan, fix.turn.as_deref(), remedies),
        RemedyKind::Limit => with_rules(limits(remedies)),
        RemedyKind::None => OptionSet::new(),
    }
}

/// Rules that end the choice of views, changed where they would end it before the views of some remedies of one kind are chosen: the
/// target, the limit of views and the growth that a view has to bring. Empty for further views of a part, which take no parameters.
pub(crate) fn stop_rules(plan: &Plan, remedies: &[&Remedy]) -> OptionSet {
    let first = remedies.first().filter(|_| !plan.coverage.is_of_open);
    let Some(kind) = first.map(|remedy| remedy.kind) else { return OptionSet::new() };
    let is_candidate = match kind {
        // None of the rules ended the choice where a candidate has no path, or is not worth its cost.
        RemedyKind::View if matches!(choice_ended_by(plan), StopReason::NoPath | StopReason::NoGain) => return OptionSet::new(),
        RemedyKind::View => true,
        RemedyKind::Roll | RemedyKind::Tilt | RemedyKind::Standoff | RemedyKind::Limit => false,
        RemedyKind::Setup | RemedyKind::None => return OptionSet::new(),
    };
    let (coverage, selection) = (&plan.coverage, &plan.params.selection);
    let (views, recovers_mm2) = (views_of(remedies), total(remedies.iter().map(|remedy| remedy.area_mm2)));
    let mut set = OptionSet::new();
    let whole_mm2 = coverage.whole_mm2(selection.target_of);
    // What only new candidates measure is coverable with them.
    let grown_mm2 = if is_candidate || selection.target_of != TargetOf::Coverable { 0.0 } else { recovers_mm2 };
    let measured_mm2 = coverage.of_target(selection.target_of) * whole_mm2 + recovers_mm2;
    let target = ((share(measured_mm2, whole_mm2 + grown_mm2) * TARGET_STEPS).floor() / TARGET_STEPS).min(1.0);
    let target = raised_share(plan).map_or(target, |raised| raised.max(target));
    if selection.goal != SelectionGoal::BestCoverage && target > selection.target {
        set.insert(TARGET.to_owned(), json!(target));
    }
    let needed = plan.views.len() + views.len();
    if selection.max_views.is_some_and(|limit| (limit as usize) < needed) && needed <= MAX_VIEWS {
        set.insert(VIEW_LIMIT.to_owned(), json!(needed));
    }
    let min_gain_mm2 = selection.min_growth * coverage.asked_area_mm2;
    let has_ended = is_candidate && plan.stopped_because == StopReason::Growth;
    if has_ended || views.iter().any(|view| view.area_mm2 < min_gain_mm2) {
        set.insert(GROWTH.to_owned(), json!(0.0));
    }
    set
}

/// Rule that ended the choice of views, also where a plan tells in its place that regions miss their targets: one that is short of its own
/// target was ended by none of those that a parameter holds, since nothing could be gained.
pub(crate) fn choice_ended_by(plan: &Plan) -> StopReason {
    // Views that tolerate errors reach their target on few samples, and may be short of it on all.
    let is_short = !plan.params.robust.select && !plan.coverage.reaches_target(&plan.params.selection);
    let is_without_gain = plan.stopped_because == StopReason::RegionsUnmet && is_short;
    if is_without_gain { StopReason::NoGain } else { plan.stopped_because }
}

/// Target that makes up for what views chosen for pose errors too miss of theirs on every sample, though they reach it on those that they
/// were chosen on: higher by as much as is missed, an estimate without a source. `None` where another rule ended the choice.
pub(super) fn raised_target(plan: &Plan) -> Option<OptionSet> {
    raised_share(plan).map(|target| BTreeMap::from([(TARGET.to_owned(), json!(target))]))
}

/// Share in [`raised_target`], above that of the plan.
fn raised_share(plan: &Plan) -> Option<f64> {
    /// Part of a step that is taken for rounding.
    const SLACK: f64 = 1e-6;
    let (coverage, selection) = (&plan.coverage, &plan.params.selection);
    let ended_there = plan.stopped_because == StopReason::Target && plan.params.robust.select;
    let takes_target = selection.goal != SelectionGoal::BestCoverage && !coverage.is_of_open;
    if !ended_there || !takes_target || coverage.reaches_target(selection) {
        return None;
    }
    let wanted = 2.0 * selection.target - coverage.of_target(selection.target_of);
    let target = ((wanted * TARGET_STEPS - SLACK).ceil() / TARGET_STEPS).min(1.0);
    (target > selection.target).then_some(target)
}

/// Poses to consider besides the candidates of the plan, where they are few and the plan was given none of its own.
fn poses(plan: &Plan, views: &[&RemedyView]) -> OptionSet {
    if views.len() > MAX_POSES || !plan.params.candidates.poses.is_empty() {
        return OptionSet::new();
    }
    let poses: Vec<PoseSpec> = views.iter().map(|view| rounded(PoseSpec::from(&view.part_from_scanner))).collect();
    BTreeMap::from([(POSES.to_owned(), json!(poses))])
}

/// The pose to a micrometre and 10⁻⁷ of a unit quaternion: what a command line can hold.
pub(super) fn rounded(pose: PoseSpec) -> PoseSpec {
    PoseSpec {
        translation_mm: pose.translation_mm.map(|mm| rounded_to(mm, 3)),
        quaternion_xyzw: pose.quaternion_xyzw.map(|part| rounded_to(part, 7)),
    }
}

/// Parameters of one more setup, in which the part is turned as said, into this pose if one is known, or onto any other side: as the
/// advice on the plan has it. Where no advice was tried, those of any one more setup; empty where advice was tried and does not turn the
/// part so.
pub(crate) fn further_setup(plan: &Plan, turn: Option<&str>, pose: Option<&Pose<Table, Part>>) -> OptionSet {
    let mut all = plan.advice.iter().zip(AdviceDocument::all_of(plan));
    let advised = all.find(|(advice, _)| advice.kind == AdviceKind::TurnOver && lays_so(advice, turn, pose));
    let uses_all = plan.setups.len() == plan.params.setups as usize;
    // A plan with one more setup chooses its pose itself: where advice was tried, not this one.
    let is_untried = turn.is_none() || !plan.params.tries_advice();
    match advised {
        Some((_, document)) => document.set,
        // A fixture holds one setup.
        None if is_untried
            && uses_all
            && plan.params.setups < MAX_SETUPS
            && plan.params.part.fixture_mesh.is_none()
            && !plan.coverage.is_of_open =>
        {
            BTreeMap::from([("setups".to_owned(), json!(plan.params.setups + 1))])
        }
        None => OptionSet::new(),
    }
}

/// Returns true if advice lays the part in a pose; where one of the two is not known, if it turns the part as said, or at all.
fn lays_so(advice: &PlanAdvice, turn: Option<&str>, pose: Option<&Pose<Table, Part>>) -> bool {
    let mut poses = advice.table_from_part.iter().chain(advice.setups.iter().map(|setup| &setup.table_from_part)).peekable();
    if let Some(pose) = pose.filter(|_| poses.peek().is_some()) {
        return poses.any(|advised| advised == pose);
    }
    let mut turns = advice.turn.iter().chain(advice.setups.iter().map(|setup| &setup.turn));
    turn.is_none_or(|turn| turns.any(|advised| turn_phrase(advised) == turn))
}

/// Parameters of a setup in which some remedies turn the part: as the advice on the plan has it; else those of a plan of its own in that
/// pose, or of one more setup where no advice was tried. Empty with a fixture, which holds the part in one pose, and for further views
/// of a part.
pub(crate) fn turned_setup(plan: &Plan, turn: Option<&str>, remedies: &[&Remedy]) -> OptionSet {
    let pose = remedies.iter().find_map(|remedy| remedy.table_from_part.as_ref());
    let advised = further_setup(plan, turn, pose);
    let is_possible = plan.params.part.fixture_mesh.is_none() && !plan.coverage.is_of_open;
    let Some(pose) = pose.filter(|_| advised.is_empty() && is_possible) else { return advised };
    let mut set = BTreeMap::from([(LIES.to_owned(), json!(rounded(PoseSpec::from(pose))))]);
    if plan.params.setups > 1 {
        set.insert("setups".to_owned(), json!(1));
    }
    set
}

/// Remark on parameters that plan a setup by itself; empty for others.
pub(crate) fn own_plan_remark(set: &OptionSet) -> &'static str {
    if set.contains_key(LIES) { ", in a plan of its own" } else { "" }
}

/// Limits of incidence, as large as the remedies need them.
fn limits(remedies: &[&Remedy]) -> OptionSet {
    let largest = |limit: fn(&Remedy) -> Option<f64>| {
        remedies.iter().filter_map(|remedy| limit(remedy)).max_by(f64::total_cmp).map(rounded_down_deg)
    };
    let camera = largest(|remedy| remedy.camera_deg).map(|deg| (CAMERA_LIMIT.to_owned(), json!(deg)));
    let projector = largest(|remedy| remedy.projector_deg).map(|deg| (PROJECTOR_LIMIT.to_owned(), json!(deg)));
    camera.into_iter().chain(projector).collect()
}
