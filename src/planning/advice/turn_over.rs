//! One more setup: the poses in which most of what is missed can be measured, with views chosen for them and ordered.
//!
//! Poses are ranked by what can be measured in them from above the plate, whatever the cell takes, which the choice of setups knows
//! without a trial ([`FurtherPoses`]). The best of them is tried; others only where that leads to nothing, meets no region that it
//! should, or falls clearly short of its rank: then what the cell takes decides, and the trial that measures most is told.

use std::cmp::Ordering;
use std::sync::Arc;

use super::trial::{MAX_JOINING, OwnView, SetupsLink, Trial};
use super::{AdviceScope, Basis, MAX_VIEWS, MIN_RECOVERED, cycle_secs, exceeds_every_limit, is_in_poses, views_of, within};
use crate::geometry::{Part, Pose, Table};
use crate::planning::candidates;
use crate::planning::context::{Cancelled, Context, PlanError};
use crate::planning::ids::{SampleId, ViewId};
use crate::planning::params::{Hemisphere, PlanParams, Registration, SelectionGoal, SelectionParams, TargetOf};
use crate::planning::plan::{
    AdviceKind, AdvisedSetup, Cause, Outcome, ParamChange, Plan, PlanAdvice, RegionCoverage, SHARE_SLACK, StopReason, Turn,
    Verdict,
};
use crate::planning::problem::{EvaluatedCandidates, TriedSetup};
use crate::planning::setups::{FurtherPose, FurtherPoses, PosesAnew};
use crate::planning::sight::sky::stands_on;
use crate::planning::surface::{Surface, systematic};
use crate::planning::visibility::{Occluders, Optics, SampleSet, UnitedViews};

/// Setups that a plan may have.
const MAX_SETUPS: u32 = 4;
/// Candidates that are tried for each block cube of the part: the views of one see little of the others. No source: as many as a part of
/// four blocks is tried with.
const CANDIDATES_OF_A_BLOCK: usize = 20;
/// Candidates that are tried at least, of a part of few blocks.
const MIN_CANDIDATES: usize = 80;
/// Candidates that are tried at most, since each takes stations and a row. No source: four times those of a part of few blocks.
const MAX_CANDIDATES: usize = 320;
/// Choices of poses that are tried at most, the best first. No source.
const MAX_TRIALS: usize = 3;
/// Part of what its poses let measure from which on a trial is taken to have had it all, so that no other is tried beside it: that it has
/// fewer candidates than the comparison of poses costs it some percent. No source.
const MIN_REACHED: f64 = 0.95;
/// Share of the asked area by which trials of equal value differ at most: our choice, as much as a setup is worth.
const SAME_OF_ASKED: f64 = 0.002;
/// Part of a limit of views that those of a trial, and others that register its setups, take up at most where the limit stays: a plan
/// chooses all its views anew, by its own score, and may need more. No source.
const MAX_OF_LIMIT: f64 = 0.5;
/// Block cubes of a part for which it is tried: beyond them, comparing poses takes a large part of a plan's time.
const MAX_BLOCKS: f64 = 32.0;
/// Samples on which views are chosen for it: a share of the area is then known to half a point.
const TRIED_SAMPLES: usize = 10_000;

/// A region whose target an advised plan shall meet.
pub(super) struct WantedRegion {
    name: String,
    /// True if the plan meets it.
    is_met: bool,
    /// Asked area of each sample in it, 0 elsewhere.
    pub(super) area_mm2: Vec<f64>,
    pub(super) needed_mm2: f64,
}

/// Poses of a plan in one more setup.
struct SetupChoice {
    /// All of them.
    poses: Vec<Pose<Table, Part>>,
    /// The one that is added to those of the plan; `None` where not all of those are among them.
    further: Option<Pose<Table, Part>>,
    /// True if a plan in so many setups, registered like this, chooses them by itself.
    is_default: bool,
    registration: Registration,
    /// Share of the asked area that can be measured from above the plate in them.
    reachable_of_asked: f64,
}

/// Plan and part that trials start from.
#[derive(Clone, Copy)]
struct Start<'s, 'a> {
    basis: &'s Basis,
    outcome: &'s Outcome,
    scope: &'s AdviceScope<'a>,
    /// Occluders of the part alone.
    part: &'s Occluders,
}

/// Advice that a trial led to.
struct Found {
    advice: PlanAdvice,
    registration: Registration,
    /// Area that its poses let a plan measure at most.
    ceiling_mm2: f64,
}

/// Findings of a trial: what the chosen views measure of all samples.
struct Recovered {
    /// Samples that the views of the setups that stay and those of the further ones measure.
    measured: SampleSet,
    /// Area that meets the plan's target; infinite where it has none.
    enough_mm2: f64,
    /// Views that were chosen in the further setups.
    chosen_views: usize,
    /// Time that their moves add, 0 without a cell.
    moving_secs: f64,
}

/// The advice to plan in one more setup; `None` where that may not be, or recovers too little.
///
/// # Errors
/// [`PlanError::Cancelled`].
pub(super) fn advice(
    basis: &Basis,
    outcome: &Outcome,
    scope: &AdviceScope<'_>,
    ctx: &Context<'_>,
) -> Result<Option<PlanAdvice>, PlanError> {
    let misses_region = outcome.plan.coverage.regions.iter().any(may_be_met);
    let may_help = may_recover(basis, outcome) || misses_region;
    if !may_plan_another(scope) || !may_help {
        return Ok(None);
    }
    let ctx = ctx.silent();
    let standing: Vec<_> = scope.setups.iter().map(|setup| setup.table_from_part).collect();
    let (sampled, part) = (scope.sampled, Occluders::of_part(scope.input.mesh, Arc::clone(scope.part), &ctx)?);
    let pool = (sampled.resting_poses(scope.input, &ctx)?, standing.as_slice());
    let start = Start { basis, outcome, scope, part: &part };
    for registration in registrations(outcome) {
        let params = PlanParams { registration, ..sampled.params.clone() };
        let Some(poses) = FurtherPoses::of(scope.input, &params, pool, &part, &ctx)? else { continue };
        if let Some(advice) = best_of(&start, &choices(&poses, &standing), misses_region, &ctx)? {
            return Ok(Some(advice));
        }
    }
    Ok(None)
}

/// Ways to register the setups, tried in turn. With the best coverage as goal views may be left to register setups by the surface that they
/// share unless the limit of views ended the plan; where none are, markers register them.
fn registrations(outcome: &Outcome) -> Vec<Registration> {
    let Plan { params, stopped_because, .. } = &outcome.plan;
    if params.selection.goal != SelectionGoal::BestCoverage || params.registration != Registration::Surface {
        vec![params.registration]
    } else if *stopped_because == StopReason::MaxViews {
        vec![Registration::Markers]
    } else {
        vec![Registration::Surface, Registration::Markers]
    }
}

/// Choices of poses, the one first in which most can be measured from above the plate.
fn choices(poses: &FurtherPoses, standing: &[Pose<Table, Part>]) -> Vec<SetupChoice> {
    let mut choices: Vec<SetupChoice> = poses.anew().map(SetupChoice::anew).into_iter().collect();
    let mut places = Vec::new();
    while choices.len() < MAX_TRIALS
        && let Some(further) = poses.best(&places)
    {
        places.push(further.place);
        choices.push(SetupChoice::beside(standing, &further));
    }
    choices
}

/// Advice of the trial that is worth most, of those that are worth making.
fn best_of(
    start: &Start<'_, '_>,
    choices: &[SetupChoice],
    misses_region: bool,
    ctx: &Context<'_>,
) -> Result<Option<PlanAdvice>, PlanError> {
    let (basis, selection) = (start.basis, &start.scope.sampled.params.selection);
    let mut best: Option<Found> = None;
    for choice in choices {
        let ceiling_mm2 = ceiling_mm2(basis, choice.reachable_of_asked, selection);
        if best.as_ref().is_some_and(|best| !best.leaves_room_for(choice, ceiling_mm2, basis, misses_region)) {
            continue;
        }
        let advice = match tried(start, choice, ctx) {
            // The part cannot lie like this in the cell, or a plan with one more setup would be refused.
            Err(PlanError::BadParams(_)) => None,
            tried => tried?,
        };
        let found = advice.map(|advice| Found { advice, registration: choice.registration, ceiling_mm2 });
        let asked_mm2 = basis.asked_mm2();
        let wins = |found: &Found| best.as_ref().is_none_or(|best| is_better(&found.advice, &best.advice, asked_mm2));
        if let Some(found) = found.filter(wins) {
            best = Some(found);
        }
    }
    Ok(best.map(|found| found.advice))
}

/// Area that a plan measures at most where so large a share of the asked area can be measured: it ends at its target, if it has
/// one.
fn ceiling_mm2(basis: &Basis, reachable_of_asked: f64, params: &SelectionParams) -> f64 {
    let reachable_mm2 = reachable_of_asked * basis.asked_mm2();
    let whole_mm2 = match params.target_of {
        TargetOf::Coverable => reachable_mm2,
        TargetOf::Asked => basis.asked_mm2(),
        TargetOf::Total => basis.total_mm2,
    };
    match params.goal {
        SelectionGoal::BestCoverage => reachable_mm2,
        SelectionGoal::FewestViews | SelectionGoal::MinTime => reachable_mm2.min(params.target * whole_mm2),
    }
}

/// Returns true if advice is worth more than other advice: it meets more regions, or measures more, or measures as much with fewer views.
fn is_better(one: &PlanAdvice, other: &PlanAdvice, asked_mm2: f64) -> bool {
    let more_mm2 = one.measured_area_mm2 - other.measured_area_mm2;
    match one.regions_met.len().cmp(&other.regions_met.len()) {
        Ordering::Greater => true,
        Ordering::Less => false,
        Ordering::Equal if more_mm2.abs() <= SAME_OF_ASKED * asked_mm2 => one.views < other.views,
        Ordering::Equal => more_mm2 > 0.0,
    }
}

impl SetupChoice {
    fn anew(poses: PosesAnew) -> Self {
        let PosesAnew { table_from_part, registration, reachable_of_asked } = poses;
        Self { poses: table_from_part, further: None, is_default: true, registration, reachable_of_asked }
    }

    fn beside(standing: &[Pose<Table, Part>], further: &FurtherPose) -> Self {
        let FurtherPose { table_from_part, is_default, registration, reachable_of_asked, .. } = *further;
        let poses = [standing, &[table_from_part]].concat();
        Self { poses, further: Some(table_from_part), is_default, registration, reachable_of_asked }
    }
}

impl Found {
    /// Returns true if another choice is worth a trial beside this one.
    fn leaves_room_for(&self, choice: &SetupChoice, ceiling_mm2: f64, basis: &Basis, misses_region: bool) -> bool {
        // Other means of registration are for where those of the job do not do.
        let is_registered_alike = self.registration == choice.registration;
        let measured_mm2 = self.advice.measured_area_mm2;
        let falls_short = measured_mm2 < MIN_REACHED * self.ceiling_mm2;
        let may_add = ceiling_mm2 - measured_mm2 >= MIN_RECOVERED * basis.asked_mm2();
        let meets_none = misses_region && self.advice.regions_met.is_empty();
        is_registered_alike && (meets_none || falls_short && may_add)
    }
}

/// Tries a choice of poses.
fn tried(start: &Start<'_, '_>, choice: &SetupChoice, ctx: &Context<'_>) -> Result<Option<PlanAdvice>, PlanError> {
    let Start { basis, outcome, scope, part } = *start;
    let sampled = scope.sampled;
    let goal = sampled.params.selection.goal;
    let is_new = |pose: &Pose<Table, Part>| scope.setups.iter().all(|setup| setup.table_from_part != *pose);
    // Once its limit is raised, a plan that was ended by it takes more views in its own setups too, and they share more surface.
    let is_limited = outcome.plan.stopped_because == StopReason::MaxViews && goal != SelectionGoal::BestCoverage;
    let poses: Vec<Pose<Table, Part>> = choice.poses.iter().copied().filter(|pose| is_limited || is_new(pose)).collect();
    let other = scope.setups.iter().find_map(|setup| setup.scene.as_ref());
    let scene = |pose: &Pose<Table, Part>| sampled.scene(scope.input, *pose, other, ctx);
    let scenes = poses.iter().map(scene).collect::<Result<Vec<_>, PlanError>>()?;
    let some = systematic(&basis.asked_area_mm2, TRIED_SAMPLES);
    let surface = outcome.surface.of_samples(&some);
    // The plate hides nothing from above it.
    let setups: Vec<TriedSetup<'_>> = poses
        .iter()
        .zip(&scenes)
        .map(|(pose, scene)| TriedSetup { table_from_part: *pose, surface: &surface, occluders: part, scene: scene.as_ref() })
        .collect();
    let max = max_candidates(blocks(scope));
    let evaluated = setups.iter().map(|setup| sampled.evaluate_some(scope.input, setup, max, ctx));
    let candidates = evaluated.collect::<Result<Vec<_>, PlanError>>()?;
    let prepared = Prepared { setups: &setups, candidates: &candidates, surface: &surface, some: &some };
    // Regions may need every view that the plan has, and one that its limit ended takes more in its own setups once that is raised.
    let has_all = outcome.plan.coverage.regions.is_empty() && !is_limited;
    let may_give_up = goal != SelectionGoal::BestCoverage && choice.further.is_some() && has_all;
    let fewest = if may_give_up { attempted(start, choice, &prepared, OwnViews::Fewest, ctx)? } else { None };
    if fewest.is_some() { Ok(fewest) } else { attempted(start, choice, &prepared, OwnViews::All, ctx) }
}

/// Setups and candidates of a trial, on some of the samples.
struct Prepared<'s> {
    setups: &'s [TriedSetup<'s>],
    candidates: &'s [EvaluatedCandidates],
    surface: &'s Surface,
    some: &'s [(SampleId, f64)],
}

/// Views of the plan that a trial keeps in the setups that stay.
#[derive(Clone, Copy, PartialEq, Eq)]
enum OwnViews {
    /// All of them.
    All,
    /// The fewest that measure as much with those that are chosen beside them.
    Fewest,
}

/// Chooses views in the setups of a trial, joins and orders them; `None` where that leads to nothing.
fn attempted(
    start: &Start<'_, '_>,
    choice: &SetupChoice,
    prepared: &Prepared<'_>,
    own_views: OwnViews,
    ctx: &Context<'_>,
) -> Result<Option<PlanAdvice>, PlanError> {
    let Start { basis, outcome, scope, .. } = *start;
    let Prepared { setups, candidates, surface, some } = *prepared;
    let params = &scope.sampled.params;
    let is_new = |pose: &Pose<Table, Part>| scope.setups.iter().all(|setup| setup.table_from_part != *pose);
    // The views of setups that do not stay are given up.
    let mut views = views_in(outcome, &choice.poses);
    let mut staying = choice.further.is_none().then(|| Basis::of_views(outcome, &views));
    let regions = wanted_regions(basis, outcome, choice);
    let on_some = staying.as_ref().unwrap_or(basis).on(some);
    let mut trial = Trial::new(&on_some, setups, candidates);
    let own: Vec<OwnView<'_>> = views.iter().map(|view| OwnView::on(some, outcome, *view)).collect();
    match params.selection.goal {
        SelectionGoal::BestCoverage => {
            views = trial.choose_anew(&own, surface, params, ctx)?;
            staying = Some(Basis::of_views(outcome, &views));
        }
        SelectionGoal::FewestViews | SelectionGoal::MinTime => {
            let regions_of_some: Vec<WantedRegion> = regions.iter().map(|region| region.on(some)).collect();
            trial.choose(params, &regions_of_some, ctx)?;
        }
    }
    if own_views == OwnViews::Fewest {
        let Some(fewer) = trial.choose_fewer(&own, params, ctx)? else { return Ok(None) };
        // What the others measure can be measured all the same.
        staying = Some(Basis { coverable: basis.coverable.clone(), ..Basis::of_views(outcome, &fewer) });
        views = fewer;
    }
    let staying = staying.as_ref().unwrap_or(basis);
    let by_surface = choice.registration == Registration::Surface;
    let links = by_surface.then(|| SetupsLink::to_setups(outcome, (&choice.poses, &views), setups, (surface, some)));
    if !trial.has_views_where(is_new) || !trial.join(links.as_ref(), ctx)? {
        return Ok(None);
    }
    let moving_secs = trial.order(&outcome.plan, ctx)?;
    // Views without a path were dropped.
    if !trial.has_views_where(is_new) || links.is_some_and(|links| !trial.is_joined(&links)) {
        return Ok(None);
    }
    let recovered = Recovered { moving_secs, ..recovered(staying, start, &trial, ctx)? };
    Ok(into_advice(start, choice, (staying, &views), recovered, &regions))
}

/// Evaluates the views of a trial on all samples that the views which stay leave open; what its other candidates measure of those
/// makes the target's whole.
fn recovered(staying: &Basis, start: &Start<'_, '_>, trial: &Trial<'_>, ctx: &Context<'_>) -> Result<Recovered, Cancelled> {
    let Start { outcome, scope, part, .. } = *start;
    let params = &scope.sampled.params;
    let is_open = |sample: &SampleId| staying.asked_area_mm2[sample.index()] > 0.0 && !staying.measured.holds(*sample);
    let open = outcome.surface.samples().filter(is_open);
    let open: Vec<(SampleId, f64)> = open.map(|sample| (sample, staying.asked_area_mm2[sample.index()])).collect();
    let surface = outcome.surface.of_samples(&open);
    let optics = Optics::new(scope.input.scanner, params, &surface.requirements);
    let together = UnitedViews::new(&surface, &optics, part, params, ctx);
    let by_chosen = trial.measured_by_chosen(&together, &surface, ctx)?;
    let all = |open_ones: &SampleSet, of_plan: &SampleSet| {
        let mut all = of_plan.clone();
        open_ones.iter().for_each(|place| all.insert(open[place.index()].0));
        all
    };
    let enough_mm2 = match params.selection.goal {
        SelectionGoal::BestCoverage => f64::INFINITY,
        SelectionGoal::FewestViews | SelectionGoal::MinTime => {
            let mut coverable = within(&staying.coverable, &open);
            coverable.insert_all(&by_chosen);
            trial.add_what_others_measure(&together, &mut coverable, ctx)?;
            params.selection.target * staying.whole_mm2(&all(&coverable, &staying.coverable), params.selection.target_of)
        }
    };
    Ok(Recovered {
        measured: all(&by_chosen, &staying.measured),
        enough_mm2,
        chosen_views: trial.chosen_views(),
        moving_secs: 0.0,
    })
}

/// Returns true if the plan may have one more setup, and one more lets views from above the plate see more.
fn may_plan_another(scope: &AdviceScope<'_>) -> bool {
    let params = &scope.sampled.params;
    let above_only = params.candidates.hemisphere == Some(Hemisphere::AboveTable);
    // A plan that may have more setups than it has gains nothing by another.
    let has_all = scope.setups.len() == params.setups as usize;
    above_only && has_all && params.setups < MAX_SETUPS && scope.input.fixture.is_none() && blocks(scope) <= MAX_BLOCKS
}

/// Block cubes of the part.
fn blocks(scope: &AdviceScope<'_>) -> f64 {
    candidates::block_counts(&scope.input.mesh.aabb().extent_mm(), scope.input.scanner).product()
}

/// Candidates that are tried of a part of so many blocks.
fn max_candidates(blocks: f64) -> usize {
    (CANDIDATES_OF_A_BLOCK * blocks as usize).clamp(MIN_CANDIDATES, MAX_CANDIDATES)
}

/// Returns true if another pose may let the cell measure what is missed for a cause.
fn may_mend(cause: Cause) -> bool {
    !matches!(cause, Cause::Enclosed | Cause::NotChosen)
}

/// Returns true if enough is missed for causes that another pose may mend.
fn may_recover(basis: &Basis, outcome: &Outcome) -> bool {
    let is_open = |verdict: &Verdict| match verdict {
        Verdict::Missed(cause) => may_mend(*cause),
        Verdict::Measured(_) | Verdict::NotAsked => false,
    };
    let open = outcome.verdicts.iter().zip(&basis.asked_area_mm2).filter(|(verdict, _)| is_open(verdict));
    open.map(|(_, area_mm2)| area_mm2).sum::<f64>() >= MIN_RECOVERED * basis.asked_mm2()
}

/// Returns true if a region misses its target for causes that another pose may mend.
fn may_be_met(region: &RegionCoverage) -> bool {
    region.is_unmet() && region.missed_mm2.iter().any(|(cause, _)| may_mend(*cause))
}

/// Regions whose target a plan with a choice of poses shall meet: those that miss it and that another pose may mend, and, where views are
/// given up, those that meet it.
fn wanted_regions(basis: &Basis, outcome: &Outcome, choice: &SetupChoice) -> Vec<WantedRegion> {
    let requirements = &outcome.surface.requirements;
    let gives_up_views = choice.further.is_none() || outcome.plan.params.selection.goal == SelectionGoal::BestCoverage;
    let may_be_lost = |region: &RegionCoverage| gives_up_views && region.is_met() == Some(true);
    let regions = outcome.plan.coverage.regions.iter().enumerate();
    let wanted = regions.filter(|(_, region)| may_be_met(region) || may_be_lost(region));
    let region = |(number, region): (usize, &RegionCoverage)| {
        let holds = |sample: SampleId| requirements.of(sample).regions.contains(&number);
        let area_mm2 = |sample: SampleId| if holds(sample) { basis.asked_area_mm2[sample.index()] } else { 0.0 };
        WantedRegion {
            name: region.name.clone(),
            is_met: !region.is_unmet(),
            area_mm2: outcome.surface.samples().map(area_mm2).collect(),
            needed_mm2: (region.target.unwrap_or_default() - SHARE_SLACK) * region.asked_area_mm2,
        }
    };
    wanted.map(region).collect()
}

impl WantedRegion {
    /// The region on some of the samples, each with the area that it stands for.
    fn on(&self, some: &[(SampleId, f64)]) -> Self {
        let area_mm2 = |(sample, area_mm2): &(SampleId, f64)| if self.area_mm2[sample.index()] > 0.0 { *area_mm2 } else { 0.0 };
        Self {
            name: self.name.clone(),
            is_met: self.is_met,
            area_mm2: some.iter().map(area_mm2).collect(),
            needed_mm2: self.needed_mm2,
        }
    }

    pub(super) fn measured_mm2(&self, measured: &SampleSet) -> f64 {
        measured.iter().map(|sample| self.area_mm2[sample.index()]).sum()
    }

    fn is_met_by(&self, measured: &SampleSet) -> bool {
        self.measured_mm2(measured) >= self.needed_mm2
    }
}

/// The advice that follows from what was recovered beside the views that stay; `None` where that is too little, or a region is
/// lost for it.
fn into_advice(
    start: &Start<'_, '_>,
    choice: &SetupChoice,
    (staying, staying_views): (&Basis, &[ViewId]),
    recovered: Recovered,
    regions: &[WantedRegion],
) -> Option<PlanAdvice> {
    let Start { basis, outcome, scope, .. } = *start;
    let Recovered { measured, enough_mm2, chosen_views, moving_secs } = recovered;
    let met: Vec<&WantedRegion> = regions.iter().filter(|region| region.is_met_by(&measured)).collect();
    let kept = met.iter().filter(|region| region.is_met).count();
    let loses_region = kept < regions.iter().filter(|region| region.is_met).count();
    let regions_met: Vec<String> = met.iter().filter(|region| !region.is_met).map(|region| region.name.clone()).collect();
    // A plan ends once it meets its target.
    let measured_mm2 = basis.area_mm2(&measured).min(enough_mm2.max(staying.measured_mm2()));
    if chosen_views == 0 || loses_region || !basis.is_worth(measured_mm2) && regions_met.is_empty() {
        return None;
    }
    let (plan, poses) = (&outcome.plan, &choice.poses);
    let views = staying_views.len() + chosen_views;
    let selection = &scope.sampled.params.selection;
    let exceeds_limit = match selection.goal {
        // Those that register the setups come beside as many as the limit lets it choose.
        SelectionGoal::BestCoverage => selection.max_views.is_some_and(|limit| views > limit as usize),
        SelectionGoal::FewestViews | SelectionGoal::MinTime => exceeds_every_limit(selection.max_views, views),
    };
    if exceeds_limit {
        return None;
    }
    let turn = |pose: &Pose<Table, Part>| plan.setups.first().map(|first| Turn::between(&first.table_from_part, pose));
    let advised = |pose: &Pose<Table, Part>| Some(AdvisedSetup { table_from_part: *pose, turn: turn(pose)? });
    Some(PlanAdvice {
        kind: AdviceKind::TurnOver,
        changes: changes(scope, choice, views),
        table_from_part: choice.further,
        turn: choice.further.as_ref().and_then(turn),
        setups: if choice.further.is_some() { Vec::new() } else { poses.iter().filter_map(advised).collect() },
        added_views: views.saturating_sub(views_of(outcome)),
        views,
        measured_area_mm2: measured_mm2,
        grade_a_area_mm2: None,
        visible_area_mm2: plan.coverage.visible_area_mm2 + freed_mm2(start, choice),
        cycle_secs: cycle_secs(outcome, scope.input.cell, |view| staying_views.contains(&view), (chosen_views, moving_secs)),
        regions_met,
    })
}

/// Views of a plan that measure something, with the part in one of some poses.
fn views_in(outcome: &Outcome, poses: &[Pose<Table, Part>]) -> Vec<ViewId> {
    let views = ViewId::number(&outcome.plan.views);
    views.filter(|(_, view)| view.rejected.is_none() && is_in_poses(view, outcome, poses)).map(|(view, _)| view).collect()
}

/// Asked area on which the part stands in every setup of the plan, and with a choice of poses not in all.
fn freed_mm2(start: &Start<'_, '_>, choice: &SetupChoice) -> f64 {
    let Start { basis, outcome, scope, .. } = *start;
    let plate_radius_mm = scope.input.cell.map_or(0.0, |cell| cell.turntable.plate_radius_mm);
    let poses = choice.further.as_ref().map_or(choice.poses.as_slice(), std::slice::from_ref);
    let is_freed = |sample: &SampleId| {
        let stands = |pose: &Pose<Table, Part>| stands_on(&outcome.surface, *sample, pose, plate_radius_mm);
        outcome.verdicts[sample.index()] == Verdict::Missed(Cause::ExcludedResting) && !poses.iter().all(stands)
    };
    outcome.surface.samples().filter(is_freed).map(|sample| basis.asked_area_mm2[sample.index()]).sum()
}

/// Parameters of a plan with a choice of poses and so many views.
fn changes(scope: &AdviceScope<'_>, choice: &SetupChoice, views: usize) -> Vec<ParamChange> {
    let params = &scope.sampled.params;
    let mut changes = vec![ParamChange::Setups(params.setups + 1)];
    if !choice.is_default {
        changes.push(ParamChange::RestingPoses(choice.poses.clone()));
    }
    if choice.registration != params.registration {
        changes.push(ParamChange::Registration(choice.registration));
    }
    changes.extend(ample_limit(&params.selection, views, choice.registration).map(ParamChange::MaxViews));
    changes
}

/// Limit of views for a plan in other setups, of which so many views were tried: the largest that there is, since the trial had none. The
/// plan ends at its target, and with the limit that was tried it may end before, as it chooses all its views anew. `None` where
/// there is none, or the one that there is suffices, as for the best coverage it does: views were tried with it.
fn ample_limit(params: &SelectionParams, views: usize, registration: Registration) -> Option<u32> {
    match params.goal {
        SelectionGoal::BestCoverage => None,
        SelectionGoal::FewestViews | SelectionGoal::MinTime => {
            let needed = f64::from(needed_views(views, registration));
            let limit = params.max_views.filter(|limit| *limit < MAX_VIEWS && needed > MAX_OF_LIMIT * f64::from(*limit));
            limit.map(|_| MAX_VIEWS)
        }
    }
}

/// Views that are told, and those that may be needed to register the setups.
fn needed_views(views: usize, registration: Registration) -> u32 {
    let joining = if registration == Registration::Surface { MAX_JOINING } else { 0 };
    ((views + joining) as u32).min(MAX_VIEWS)
}

/// Limit of views for a plan that takes so many; `None` where there is none, or the one that there is suffices. A plan that takes as many
/// views as it may has none left to register its setups by surface, without which there is no plan at all: there is room for those.
pub(super) fn raised_limit(limit: Option<u32>, views: usize, registration: Registration) -> Option<u32> {
    let needed = needed_views(views, registration);
    limit.filter(|limit| *limit < needed).map(|_| needed)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::cell::PoseSpec;
    use crate::planning::context::Silent;
    use crate::planning::params::{Solver, Strategy};
    use crate::planning::plan::Plan;
    use crate::planning::{PlanInput, plan};
    use crate::testing::{box_mesh, nominal_scanner};

    #[test]
    fn a_part_of_more_blocks_is_tried_with_more_candidates_up_to_a_limit() {
        let tried = [1.0, 4.0, 5.0, 12.0, 16.0, MAX_BLOCKS].map(max_candidates);
        assert_eq!(tried, [80, 80, 100, 240, 320, 320]);
    }

    /// A limit of as many views as were told left plates and boxes without a plan: their setups could not be registered.
    #[test]
    fn a_limit_of_views_is_raised_by_those_that_may_register_the_setups() {
        let raised = |limit: u32, registration: Registration| raised_limit(Some(limit), 4, registration);
        assert_eq!([1, 4, 15, 16].map(|limit| raised(limit, Registration::Surface)), [Some(16), Some(16), Some(16), None]);
        assert_eq!([1, 3, 4].map(|limit| raised(limit, Registration::Markers)), [Some(4), Some(4), None]);
        assert_eq!(raised_limit(None, 4, Registration::Surface), None);
    }

    /// The views of a trial were chosen for area and without a limit; a plan that chose by score ended at a limit of as many before.
    #[test]
    fn a_plan_in_one_more_setup_is_not_held_to_as_many_views_as_were_tried() {
        let ample = |goal: SelectionGoal, limit: Option<u32>| {
            let params = SelectionParams { goal, max_views: limit, ..SelectionParams::default() };
            ample_limit(&params, 9, Registration::Markers)
        };
        let limits = [None, Some(4), Some(9), Some(17), Some(18), Some(MAX_VIEWS)];
        for goal in [SelectionGoal::FewestViews, SelectionGoal::MinTime] {
            let told = limits.map(|limit| ample(goal, limit));
            assert_eq!(told, [None, Some(MAX_VIEWS), Some(MAX_VIEWS), Some(MAX_VIEWS), None, None], "{goal:?}");
        }
        let best = limits.map(|limit| ample(SelectionGoal::BestCoverage, limit));
        assert_eq!(best, [None; 6], "it would take as many views as it may");
    }

    /// 995 views with a limit of 990 led to a limit of 1007, which no plan takes.
    #[test]
    fn a_limit_of_views_is_raised_to_no_more_than_its_range_has() {
        let raised = |limit: u32, views: usize| raised_limit(Some(limit), views, Registration::Surface);
        assert_eq!([raised(980, 988), raised(990, 995), raised(1000, 995)], [Some(1000), Some(1000), None]);
        let are_allowed = |max_views: u32| {
            let selection = SelectionParams { max_views: Some(max_views), ..SelectionParams::default() };
            PlanParams { selection, ..PlanParams::default() }.check().is_ok()
        };
        assert!(are_allowed(MAX_VIEWS) && !are_allowed(MAX_VIEWS + 1));
        assert!(exceeds_every_limit(Some(990), 1001));
        assert!(!exceeds_every_limit(Some(990), 1000) && !exceeds_every_limit(None, 1001));
    }

    /// Advice that measures so much of 1000 mm² with so many views.
    fn advice(measured_area_mm2: f64, views: usize) -> PlanAdvice {
        PlanAdvice {
            kind: AdviceKind::TurnOver,
            changes: Vec::new(),
            table_from_part: None,
            turn: None,
            setups: Vec::new(),
            added_views: views,
            views,
            measured_area_mm2,
            grade_a_area_mm2: None,
            visible_area_mm2: 1000.0,
            cycle_secs: None,
            regions_met: Vec::new(),
        }
    }

    #[test]
    fn the_trial_that_meets_most_regions_then_measures_most_then_takes_fewest_views_is_told() {
        let better = |one: &PlanAdvice, other: &PlanAdvice| is_better(one, other, 1000.0);
        assert!(better(&advice(980.0, 9), &advice(930.0, 5)) && !better(&advice(930.0, 5), &advice(980.0, 9)));
        // As much as makes no setup worth it.
        assert!(better(&advice(979.0, 5), &advice(980.0, 6)) && !better(&advice(980.0, 6), &advice(979.0, 5)));
        assert!(!better(&advice(980.0, 5), &advice(980.0, 5)), "of equals the first stays");
        let meets = PlanAdvice { regions_met: vec!["bore".to_owned()], ..advice(700.0, 9) };
        assert!(better(&meets, &advice(980.0, 5)) && !better(&advice(980.0, 5), &meets));
    }

    fn choice(registration: Registration) -> SetupChoice {
        SetupChoice { poses: Vec::new(), further: None, is_default: true, registration, reachable_of_asked: 1.0 }
    }

    #[test]
    fn another_choice_of_poses_is_tried_only_beside_one_that_falls_short_of_what_it_could_measure() {
        let basis = Basis {
            measured: SampleSet::none_of(0),
            coverable: SampleSet::none_of(0),
            asked_area_mm2: vec![1000.0],
            total_mm2: 1000.0,
            more_views: None,
        };
        let selection = SelectionParams { target: 0.985, target_of: TargetOf::Coverable, ..SelectionParams::default() };
        let ceiling = |reachable_of_asked: f64| ceiling_mm2(&basis, reachable_of_asked, &selection);
        assert!((ceiling(0.9) - 886.5).abs() < 1e-9, "{}", ceiling(0.9));
        let best = SelectionParams { goal: SelectionGoal::BestCoverage, ..selection.clone() };
        assert!((ceiling_mm2(&basis, 0.9, &best) - 900.0).abs() < 1e-9, "it does not end at a target");
        let of_asked = SelectionParams { target_of: TargetOf::Asked, ..selection.clone() };
        assert!((ceiling_mm2(&basis, 0.9, &of_asked) - 900.0).abs() < 1e-9, "a target of 985 mm² cannot be had");
        let found = |measured_mm2: f64| Found {
            advice: advice(measured_mm2, 5),
            registration: Registration::Surface,
            ceiling_mm2: ceiling(1.0),
        };
        let leaves_room = |measured_mm2: f64, registration: Registration, reachable_of_asked: f64| {
            found(measured_mm2).leaves_room_for(&choice(registration), ceiling(reachable_of_asked), &basis, false)
        };
        let surface = Registration::Surface;
        assert!(!leaves_room(985.0, surface, 1.0) && !leaves_room(940.0, surface, 1.0), "it had what there is");
        assert!(leaves_room(800.0, surface, 0.95) && !leaves_room(800.0, surface, 0.8), "788 mm² are not more");
        assert!(!leaves_room(800.0, Registration::Markers, 1.0), "markers are for where surface does not do");
        assert!(found(985.0).leaves_room_for(&choice(surface), ceiling(0.5), &basis, true), "it meets no region");
    }

    /// A plan of few samples and of few viewpoints above the plate, with so many views.
    fn few_viewpoints(max_views: u32) -> PlanParams {
        let mut params = PlanParams::default();
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.2), Some(1000.0));
        (params.candidates.strategies, params.candidates.even_directions) = (vec![Strategy::Even], Some(30));
        params.candidates.hemisphere = Some(Hemisphere::AboveTable);
        (params.missed.remedies, params.robust.pose_error, params.selection.max_views) = (0, None, Some(max_views));
        params
    }

    /// The plan of a box of these edges.
    fn planned(edges_mm: [f64; 3], params: &PlanParams) -> Plan {
        let (mesh, scanner, cancel) = (box_mesh([0.0; 3], edges_mm), nominal_scanner(), AtomicBool::new(false));
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        plan(&input, params, &Context::new(&cancel, &Silent)).expect("a plan").plan
    }

    /// The advice on a plan to lay the part otherwise, and the parameters with it taken, without further advice.
    fn taken<'p>(plan: &'p Plan, params: &PlanParams) -> (&'p PlanAdvice, PlanParams) {
        let turn_over = plan.advice.iter().find(|advice| advice.kind == AdviceKind::TurnOver);
        let advice = turn_over.unwrap_or_else(|| panic!("{:?}", plan.advice));
        let mut params = params.clone();
        for change in &advice.changes {
            match change {
                ParamChange::Setups(setups) => params.setups = *setups,
                ParamChange::RestingPoses(poses) => params.part.resting_poses = poses.iter().map(PoseSpec::from).collect(),
                ParamChange::Registration(registration) => params.registration = *registration,
                ParamChange::Target(target) => params.selection.target = *target,
                ParamChange::MaxViews(views) => params.selection.max_views = Some(*views),
                ParamChange::MinGradeA(share) => params.selection.min_grade_a = Some(*share),
            }
        }
        params.missed.advice = false;
        (advice, params)
    }

    /// The goal being the best coverage by 2 views, 4 views and a limit of 16 were advised, up to the target; with the limit of 2
    /// its setups could not be registered by surface, and there was no plan.
    #[test]
    fn a_plan_for_the_best_coverage_keeps_its_limit_and_measures_as_much_as_is_told() {
        let edges_mm = [50.0, 40.0, 30.0];
        for solver in [Solver::Greedy, Solver::Local] {
            let mut params = few_viewpoints(2);
            (params.selection.goal, params.selection.solver) = (SelectionGoal::BestCoverage, solver);
            let before = planned(edges_mm, &params);
            let (advice, params) = taken(&before, &params);
            assert_eq!((advice.views, advice.added_views, params.selection.max_views), (2, 0, Some(2)), "{advice:?}");
            assert_eq!(params.registration, Registration::Markers, "two views leave none to register setups by surface");
            let after = planned(edges_mm, &params);
            let (told_mm2, measured_mm2) = (advice.measured_area_mm2, after.coverage.measured.area_mm2);
            let asked_mm2 = after.coverage.asked_area_mm2;
            assert!(told_mm2 > before.coverage.measured.area_mm2 + 0.05 * asked_mm2, "{advice:?}");
            // Views are slid once they are chosen.
            assert!(measured_mm2 >= told_mm2 - 0.002 * asked_mm2, "{measured_mm2} of {told_mm2} mm²");
            assert_eq!(after.views.len(), advice.views, "{solver:?}");
        }
    }

    /// Markers were advised, though the plan has views left that register its setups by surface.
    #[test]
    fn a_plan_for_the_best_coverage_that_its_limit_did_not_end_keeps_its_registration() {
        let mut params = few_viewpoints(20);
        params.selection.goal = SelectionGoal::BestCoverage;
        let before = planned([50.0, 40.0, 30.0], &params);
        assert_ne!(before.stopped_because, StopReason::MaxViews);
        let (advice, params) = taken(&before, &params);
        assert_eq!(params.registration, Registration::Surface, "{advice:?}");
        let after = planned([50.0, 40.0, 30.0], &params);
        let (told_mm2, measured_mm2) = (advice.measured_area_mm2, after.coverage.measured.area_mm2);
        assert!(measured_mm2 >= told_mm2 - 0.002 * after.coverage.asked_area_mm2, "{measured_mm2} of {told_mm2} mm²");
        assert!(advice.views <= 20 && after.views.len() <= 20, "{advice:?}");
    }

    /// A view of either side sees half of the box: one more setup was advised with 15 views.
    #[test]
    fn no_setup_is_advised_to_a_plan_of_one_view_for_the_best_coverage() {
        let mut params = few_viewpoints(1);
        params.selection.goal = SelectionGoal::BestCoverage;
        let plan = planned([50.0, 40.0, 30.0], &params);
        assert!(plan.advice.iter().all(|advice| advice.kind == AdviceKind::MoreViews), "{:?}", plan.advice);
    }

    /// Two views of a large box share too little surface with any in another pose, and no setup was advised: with the limit
    /// raised more views are taken in the first setup too.
    #[test]
    fn a_setup_is_advised_with_more_views_in_that_of_a_plan_which_its_limit_ended() {
        let edges_mm = [200.0, 150.0, 30.0];
        let params = few_viewpoints(2);
        let before = planned(edges_mm, &params);
        let (advice, params) = taken(&before, &params);
        assert_eq!((params.setups, params.selection.max_views), (2, Some(MAX_VIEWS)), "{advice:?}");
        assert_eq!(params.registration, Registration::Surface, "{advice:?}");
        let after = planned(edges_mm, &params);
        let share = |mm2: f64| mm2 / after.coverage.asked_area_mm2;
        // The underside is 37 % of its surface.
        assert!(share(advice.measured_area_mm2) > 0.9, "{advice:?}");
        assert!(after.coverage.of_asked() >= share(advice.measured_area_mm2) - 0.01, "{}", after.coverage.of_asked());
        assert!(after.views.len() <= advice.views + 2, "{} views, {} told", after.views.len(), advice.views);
    }
}
