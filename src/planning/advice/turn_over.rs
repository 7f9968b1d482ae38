//! One more setup: the pose in which most of what is missed can be measured, with views chosen for it and ordered.

use std::sync::Arc;

use super::trial::{SetupsLink, Trial};
use super::{AdviceScope, Basis, MIN_RECOVERED, cycle_secs, views_of, within};
use crate::planning::candidates;
use crate::planning::context::{Cancelled, Context, PlanError};
use crate::planning::ids::SampleId;
use crate::planning::params::{Hemisphere, Registration};
use crate::planning::plan::{AdviceKind, Cause, Outcome, ParamChange, PlanAdvice, RegionCoverage, SHARE_SLACK, Turn, Verdict};
use crate::planning::problem::TriedSetup;
use crate::planning::setups::{FurtherPose, FurtherPoses};
use crate::planning::sky::stands_on;
use crate::planning::surface::systematic;
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
/// Further poses that are tried, the best first, while those before lead to nothing. No source.
const MAX_POSES: usize = 3;
/// Block cubes of a part for which it is tried: beyond them, comparing poses takes a large part of a plan's time.
const MAX_BLOCKS: f64 = 32.0;
/// Samples on which views are chosen for it: a share of the area is then known to half a point.
const TRIED_SAMPLES: usize = 10_000;

/// A region that misses its target.
pub(super) struct UnmetRegion {
    name: String,
    /// Asked area of each sample in it, 0 elsewhere.
    pub(super) area_mm2: Vec<f64>,
    pub(super) needed_mm2: f64,
}

/// Findings of a trial: what the chosen views measure of all samples.
struct Recovered {
    /// Samples that the plan's views and those of the further setup measure.
    measured: SampleSet,
    /// Area that meets the plan's target.
    enough_mm2: f64,
    added_views: usize,
    /// Time of their moves, 0 without a cell.
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
    let regions = unmet_regions(basis, outcome);
    let may_help = may_recover(basis, outcome) || !regions.is_empty();
    if !may_plan_another(scope) || !may_help {
        return Ok(None);
    }
    tried(basis, outcome, scope, &regions, &ctx.silent())
}

/// Tries the further poses, the best first, until one leads to advice.
fn tried(
    basis: &Basis,
    outcome: &Outcome,
    scope: &AdviceScope<'_>,
    regions: &[UnmetRegion],
    ctx: &Context<'_>,
) -> Result<Option<PlanAdvice>, PlanError> {
    let standing: Vec<_> = scope.setups.iter().map(|setup| setup.table_from_part).collect();
    let (sampled, part) = (scope.sampled, Occluders::of_part(scope.input.mesh, Arc::clone(scope.part), ctx)?);
    let pool = (sampled.resting_poses(scope.input), standing.as_slice());
    let Some(poses) = FurtherPoses::of(scope.input, &sampled.params, pool, &part, ctx)? else { return Ok(None) };
    let mut places = Vec::new();
    while places.len() < MAX_POSES
        && let Some(further) = poses.best(&places)
    {
        match tried_in(basis, outcome, scope, (&further, regions), &part, ctx) {
            // The part cannot lie like this in the cell, or a plan with one more setup would be refused.
            Ok(None) | Err(PlanError::BadParams(_)) => places.push(further.place),
            found => return found,
        }
    }
    Ok(None)
}

fn tried_in(
    basis: &Basis,
    outcome: &Outcome,
    scope: &AdviceScope<'_>,
    (further, regions): (&FurtherPose, &[UnmetRegion]),
    part: &Occluders,
    ctx: &Context<'_>,
) -> Result<Option<PlanAdvice>, PlanError> {
    let sampled = scope.sampled;
    let other = scope.setups.iter().find_map(|setup| setup.scene.as_ref());
    let scene = sampled.scene(scope.input, further.table_from_part, other, ctx)?;
    let some = systematic(&basis.asked_area_mm2, TRIED_SAMPLES);
    let surface = outcome.surface.of_samples(&some);
    // The plate hides nothing from above it.
    let setup =
        TriedSetup { table_from_part: further.table_from_part, surface: &surface, occluders: part, scene: scene.as_ref() };
    let candidates = sampled.evaluate_some(scope.input, &setup, max_candidates(blocks(scope)), ctx)?;
    let regions_of_some: Vec<UnmetRegion> = regions.iter().map(|region| region.on(&some)).collect();
    let on_some = basis.on(&some);
    let mut trial = Trial::new(&on_some, &setup, &candidates);
    trial.choose(&sampled.params, &regions_of_some, ctx)?;
    let links = (further.registration == Registration::Surface).then(|| SetupsLink::to_setups(outcome, &surface, &some));
    if trial.is_empty() || !trial.join(links.as_ref(), ctx)? {
        return Ok(None);
    }
    let moving_secs = trial.order(ctx)?;
    // Views without a path were dropped.
    if links.is_some_and(|links| !trial.is_joined(&links)) {
        return Ok(None);
    }
    let recovered = Recovered { moving_secs, ..recovered(basis, outcome, scope, &trial, ctx)? };
    Ok(into_advice(basis, outcome, scope, (further, recovered), regions))
}

/// Evaluates the views of a trial on all samples that the plan leaves open; what its other candidates measure of those makes the
/// target's whole.
fn recovered(
    basis: &Basis,
    outcome: &Outcome,
    scope: &AdviceScope<'_>,
    trial: &Trial<'_>,
    ctx: &Context<'_>,
) -> Result<Recovered, Cancelled> {
    let params = &scope.sampled.params;
    let is_open = |sample: &SampleId| basis.asked_area_mm2[sample.index()] > 0.0 && !basis.measured.holds(*sample);
    let open = outcome.surface.samples().filter(is_open);
    let open: Vec<(SampleId, f64)> = open.map(|sample| (sample, basis.asked_area_mm2[sample.index()])).collect();
    let surface = outcome.surface.of_samples(&open);
    let optics = Optics::new(scope.input.scanner, params, &surface.requirements);
    let together = UnitedViews::new(&surface, &optics, trial.occluders(), params, ctx);
    let by_chosen = trial.measured_by_chosen(&together, &surface, ctx)?;
    let mut coverable = within(&basis.coverable, &open);
    coverable.insert_all(&by_chosen);
    trial.add_what_others_measure(&together, &mut coverable, ctx)?;
    let all = |open_ones: &SampleSet, of_plan: &SampleSet| {
        let mut all = of_plan.clone();
        open_ones.iter().for_each(|place| all.insert(open[place.index()].0));
        all
    };
    let whole_mm2 = basis.whole_mm2(&all(&coverable, &basis.coverable), params.selection.target_of);
    Ok(Recovered {
        measured: all(&by_chosen, &basis.measured),
        enough_mm2: params.selection.target * whole_mm2,
        added_views: trial.chosen_views(),
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

/// Regions that miss their target for causes that another pose may mend.
fn unmet_regions(basis: &Basis, outcome: &Outcome) -> Vec<UnmetRegion> {
    let requirements = &outcome.surface.requirements;
    let may_be_met = |region: &RegionCoverage| region.is_unmet() && region.missed_mm2.iter().any(|(cause, _)| may_mend(*cause));
    let unmet = outcome.plan.coverage.regions.iter().enumerate().filter(|(_, region)| may_be_met(region));
    let region = |(number, region): (usize, &RegionCoverage)| {
        let holds = |sample: SampleId| requirements.of(sample).regions.contains(&number);
        let area_mm2 = |sample: SampleId| if holds(sample) { basis.asked_area_mm2[sample.index()] } else { 0.0 };
        UnmetRegion {
            name: region.name.clone(),
            area_mm2: outcome.surface.samples().map(area_mm2).collect(),
            needed_mm2: (region.target.unwrap_or_default() - SHARE_SLACK) * region.asked_area_mm2,
        }
    };
    unmet.map(region).collect()
}

impl UnmetRegion {
    /// The region on some of the samples, each with the area that it stands for.
    fn on(&self, some: &[(SampleId, f64)]) -> Self {
        let area_mm2 = |(sample, area_mm2): &(SampleId, f64)| if self.area_mm2[sample.index()] > 0.0 { *area_mm2 } else { 0.0 };
        Self { name: self.name.clone(), area_mm2: some.iter().map(area_mm2).collect(), needed_mm2: self.needed_mm2 }
    }

    pub(super) fn measured_mm2(&self, measured: &SampleSet) -> f64 {
        measured.iter().map(|sample| self.area_mm2[sample.index()]).sum()
    }
}

/// The advice that follows from what was recovered; `None` where that is too little.
fn into_advice(
    basis: &Basis,
    outcome: &Outcome,
    scope: &AdviceScope<'_>,
    (further, recovered): (&FurtherPose, Recovered),
    regions: &[UnmetRegion],
) -> Option<PlanAdvice> {
    let (params, plan) = (&scope.sampled.params, &outcome.plan);
    let Recovered { measured, enough_mm2, added_views, moving_secs } = recovered;
    let met = regions.iter().filter(|region| region.measured_mm2(&measured) >= region.needed_mm2);
    let regions_met: Vec<String> = met.map(|region| region.name.clone()).collect();
    // A plan ends once it meets its target.
    let measured_mm2 = basis.area_mm2(&measured).min(enough_mm2.max(basis.measured_mm2()));
    if added_views == 0 || !basis.is_worth(measured_mm2) && regions_met.is_empty() {
        return None;
    }
    let pose = further.table_from_part;
    let is_freed = |sample: SampleId| {
        outcome.verdicts[sample.index()] == Verdict::Missed(Cause::ExcludedResting) && !stands_on(&outcome.surface, sample, &pose)
    };
    let freed = outcome.surface.samples().filter(|sample| is_freed(*sample));
    let freed_mm2: f64 = freed.map(|sample| basis.asked_area_mm2[sample.index()]).sum();
    Some(PlanAdvice {
        kind: AdviceKind::TurnOver,
        changes: changes(scope, further, views_of(outcome) + added_views),
        table_from_part: Some(pose),
        turn: plan.setups.first().map(|first| Turn::between(&first.table_from_part, &pose)),
        added_views,
        views: views_of(outcome) + added_views,
        measured_area_mm2: measured_mm2,
        visible_area_mm2: plan.coverage.visible_area_mm2 + freed_mm2,
        cycle_secs: cycle_secs(outcome, params, added_views, moving_secs),
        regions_met,
    })
}

/// Parameters of a plan with the further setup and so many views.
fn changes(scope: &AdviceScope<'_>, further: &FurtherPose, views: usize) -> Vec<ParamChange> {
    let params = &scope.sampled.params;
    let mut changes = vec![ParamChange::Setups(params.setups + 1)];
    if !further.is_default {
        let standing = scope.setups.iter().map(|setup| setup.table_from_part);
        changes.push(ParamChange::RestingPoses(standing.chain([further.table_from_part]).collect()));
    }
    if further.registration != params.registration {
        changes.push(ParamChange::Registration(further.registration));
    }
    if params.selection.max_views.is_some_and(|limit| (limit as usize) < views) {
        changes.push(ParamChange::MaxViews(views as u32));
    }
    changes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_of_more_blocks_is_tried_with_more_candidates_up_to_a_limit() {
        let tried = [1.0, 4.0, 5.0, 12.0, 16.0, MAX_BLOCKS].map(max_candidates);
        assert_eq!(tried, [80, 80, 100, 240, 320, 320]);
    }
}
