//! One more setup: the pose in which most of what is missed can be measured, with views chosen for it and ordered.

use rayon::prelude::*;

use super::{AdviceScope, Basis, MIN_RECOVERED, Wanted, choose, cycle_secs, views_of};
use crate::cell::Configuration;
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::candidates;
use crate::planning::context::{Cancelled, Context, PlanError};
use crate::planning::ids::{CandidateIndex, SampleId, SetupId, ViewId};
use crate::planning::params::{Hemisphere, Registration};
use crate::planning::plan::{
    AdviceKind, Cause, Outcome, ParamChange, PlanAdvice, RegionCoverage, SHARE_SLACK, SetupPlan, Turn, Verdict,
};
use crate::planning::registration::{SharedSurface, shared, union_of};
use crate::planning::setups::{self, FurtherPose, Setup};
use crate::planning::sky::stands_on;
use crate::planning::stations::Station;
use crate::planning::surface::Surface;
use crate::planning::verdict::MIN_RESISTANCE;
use crate::planning::visibility::{Row, SampleSet};

/// Setups that a plan may have.
const MAX_SETUPS: u32 = 4;
/// Candidates that are tried.
const MAX_CANDIDATES: usize = 120;
/// Block cubes of a part for which it is tried: beyond them, comparing poses takes a large part of a plan's time.
const MAX_BLOCKS: f64 = 32.0;
/// Views that are added at most for what is missed.
const MAX_ADDED: usize = 60;
/// Views that are added at most to register the setup to the others.
const MAX_JOINING: usize = 12;

/// A region that misses its target.
struct UnmetRegion {
    name: String,
    /// Asked area of each sample in it, 0 elsewhere.
    area_mm2: Vec<f64>,
    needed_mm2: f64,
}

/// Views in a further setup.
struct Trial<'a> {
    basis: &'a Basis,
    poses: Vec<Pose<Part, ScannerFrame>>,
    rows: Vec<&'a Row>,
    stations: Vec<&'a [Station]>,
    /// Places of the views that were chosen.
    chosen: Vec<usize>,
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
    match tried(basis, outcome, scope, regions, &ctx.silent()) {
        // The part cannot lie like this in the cell, or a plan with one more setup would be refused.
        Err(PlanError::BadParams(_)) => Ok(None),
        found => found,
    }
}

fn tried(
    basis: &Basis,
    outcome: &Outcome,
    scope: &AdviceScope<'_>,
    regions: Vec<UnmetRegion>,
    ctx: &Context<'_>,
) -> Result<Option<PlanAdvice>, PlanError> {
    let standing: Vec<_> = scope.setups.iter().map(|setup| setup.table_from_part).collect();
    let further = setups::further(scope.input, &scope.sampled.params, &standing, ctx)?;
    let Some(further) = further else { return Ok(None) };
    let setup = scope.sampled.setup(scope.input, further.table_from_part, ctx)?;
    let some = scope.sampled.evaluate_some(scope.input, &setup, MAX_CANDIDATES, ctx)?;
    let stations = |candidate: CandidateIndex| match &some.reach {
        Some(reach) => reach[candidate.index()].as_deref().unwrap_or_default(),
        None => &[],
    };
    let (rows, stations) = (some.matrix.rows.iter().collect(), some.candidates.indices().map(stations).collect());
    let poses = some.candidates.remaining.iter().map(|candidate| candidate.part_from_scanner).collect();
    let mut trial = Trial { basis, poses, rows, stations, chosen: Vec::new() };
    let enough_mm2 = trial.choose(scope, &regions, ctx)?;
    let must_join = further.registration == Registration::Surface;
    if trial.chosen.is_empty() || (must_join && !trial.join(outcome, ctx)?) {
        return Ok(None);
    }
    let moving_secs = trial.order(&setup, &outcome.surface, ctx)?;
    // Views without a path were dropped.
    if must_join && !trial.is_joined(outcome) {
        return Ok(None);
    }
    Ok(trial.into_advice(scope, outcome, &further, regions, (enough_mm2, moving_secs)))
}

/// Returns true if the plan may have one more setup, and one more lets views from above the plate see more.
fn may_plan_another(scope: &AdviceScope<'_>) -> bool {
    let params = &scope.sampled.params;
    let above_only = params.candidates.hemisphere == Some(Hemisphere::AboveTable);
    // A plan that may have more setups than it has gains nothing by another.
    let has_all = scope.setups.len() == params.setups as usize;
    let blocks = candidates::block_counts(&scope.input.mesh.aabb().extent_mm(), scope.input.scanner).product();
    above_only && has_all && params.setups < MAX_SETUPS && scope.input.fixture.is_none() && blocks <= MAX_BLOCKS
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
    fn measured_mm2(&self, measured: &SampleSet) -> f64 {
        measured.iter().map(|sample| self.area_mm2[sample.index()]).sum()
    }
}

impl Trial<'_> {
    fn rows_of(&self, places: &[usize]) -> SampleSet {
        union_of(places.iter().map(|place| self.rows[*place]), self.basis.asked_area_mm2.len())
    }

    /// Samples that the plan's views and those chosen here measure.
    fn measured(&self) -> SampleSet {
        let mut measured = self.basis.measured.clone();
        measured.insert_all(&self.rows_of(&self.chosen));
        measured
    }

    /// Chooses views until the target is met, then for each region that misses its own. Returns the area that meets the plan's
    /// target.
    fn choose(&mut self, scope: &AdviceScope<'_>, regions: &[UnmetRegion], ctx: &Context<'_>) -> Result<f64, PlanError> {
        let (basis, params) = (self.basis, &scope.sampled.params);
        let mut coverable = basis.coverable.clone();
        self.rows.iter().for_each(|row| coverable.insert_all(row.measured()));
        let enough_mm2 = params.selection.target * basis.whole_mm2(&coverable, params.selection.target_of);
        let open_mm2 = basis.open_area_mm2();
        let wanted = Wanted {
            open_mm2: &open_mm2,
            needed_mm2: enough_mm2 - basis.measured_mm2(),
            min_gain_mm2: params.selection.min_growth * basis.asked_mm2(),
            max_views: MAX_ADDED,
        };
        self.chosen = choose(&self.rows, &wanted, &params.score, ctx)?;
        for region in regions {
            let measured = self.measured();
            let mut open_mm2 = region.area_mm2.clone();
            measured.iter().for_each(|sample| open_mm2[sample.index()] = 0.0);
            let needed_mm2 = region.needed_mm2 - region.measured_mm2(&measured);
            let max_views = MAX_ADDED.saturating_sub(self.chosen.len());
            let wanted = Wanted { open_mm2: &open_mm2, needed_mm2, min_gain_mm2: 0.0, max_views };
            let more = choose(&self.rows, &wanted, &params.score, ctx)?;
            self.chosen.extend(more);
        }
        Ok(enough_mm2)
    }

    /// Adds views until the setup shares surface with another that fixes all freedoms, as [`crate::planning::adjust`] does between
    /// the setups of a plan. Returns false where none would.
    fn join(&mut self, outcome: &Outcome, ctx: &Context<'_>) -> Result<bool, Cancelled> {
        let link = SetupsLink::to_setups(outcome);
        for _ in 0..MAX_JOINING {
            let own = self.rows_of(&self.chosen);
            let now = link.resistance(&own);
            if now >= MIN_RESISTANCE {
                return Ok(true);
            }
            let free: Vec<usize> = (0..self.rows.len()).filter(|place| !self.chosen.contains(place)).collect();
            let with = |place: &usize| {
                ctx.check()?;
                let mut with = own.clone();
                with.insert_all(self.rows[*place].measured());
                Ok((*place, link.resistance(&with), link.shared_area_mm2(&with)))
            };
            let tried = free.par_iter().map(with).collect::<Result<Vec<_>, Cancelled>>()?;
            let stiffest = tried.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a }).filter(|best| best.1 > now + 1e-6);
            let widest = tried.iter().copied().reduce(|a, b| if b.2 > a.2 { b } else { a });
            let Some((place, ..)) = stiffest.or(widest) else { return Ok(false) };
            self.chosen.push(place);
        }
        Ok(self.is_joined(outcome))
    }

    /// Returns true if the setup shares surface with another that fixes all freedoms.
    fn is_joined(&self, outcome: &Outcome) -> bool {
        SetupsLink::to_setups(outcome).resistance(&self.rows_of(&self.chosen)) >= MIN_RESISTANCE
    }

    /// Orders the views that were chosen, and drops those without a path. Returns the time of their moves, 0 without a cell.
    fn order(&mut self, setup: &Setup<'_>, surface: &Surface, ctx: &Context<'_>) -> Result<f64, PlanError> {
        let Some(scene) = &setup.scene else { return Ok(0.0) };
        let views: Vec<(ViewId, &[Station])> = ViewId::number(self.chosen.iter().map(|place| self.stations[*place])).collect();
        let in_sight = |view: ViewId, station: &Configuration| {
            let place = self.chosen[view.index()];
            scene.is_in_sight(surface, &self.poses[place], self.rows[place], station.table_rad, ctx)
        };
        let ordered = scene.order(&views, false, &in_sight, ctx)?;
        let chosen = ViewId::number(std::mem::take(&mut self.chosen));
        self.chosen = chosen.filter(|(view, _)| !ordered.no_path.contains(view)).map(|(_, place)| place).collect();
        Ok(ordered.sequence.motion_secs())
    }

    fn into_advice(
        self,
        scope: &AdviceScope<'_>,
        outcome: &Outcome,
        further: &FurtherPose,
        mut regions: Vec<UnmetRegion>,
        (enough_mm2, moving_secs): (f64, f64),
    ) -> Option<PlanAdvice> {
        let (measured, params, plan) = (self.measured(), &scope.sampled.params, &outcome.plan);
        regions.retain(|region| region.measured_mm2(&measured) >= region.needed_mm2);
        // A plan ends once it meets its target.
        let measured_mm2 = self.basis.area_mm2(&measured).min(enough_mm2.max(self.basis.measured_mm2()));
        let is_worth = self.basis.is_worth(measured_mm2) || !regions.is_empty();
        if self.chosen.is_empty() || !is_worth {
            return None;
        }
        let pose = further.table_from_part;
        let is_freed = |sample: SampleId| {
            outcome.verdicts[sample.index()] == Verdict::Missed(Cause::ExcludedResting)
                && !stands_on(&outcome.surface, sample, &pose)
        };
        let freed = outcome.surface.samples().filter(|sample| is_freed(*sample));
        let freed_mm2: f64 = freed.map(|sample| self.basis.asked_area_mm2[sample.index()]).sum();
        let added_views = self.chosen.len();
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
            regions_met: regions.into_iter().map(|region| region.name).collect(),
        })
    }
}

/// Link of a further setup to those of a plan.
struct SetupsLink<'a> {
    surface: &'a Surface,
    part: SharedSurface<'a>,
    /// Samples that the views of each setup measure.
    measured: Vec<SampleSet>,
}

impl<'a> SetupsLink<'a> {
    fn to_setups(outcome: &'a Outcome) -> Self {
        let (surface, samples) = (&outcome.surface, outcome.surface.sample_mm.len());
        let measured = |(id, _): (SetupId, &SetupPlan)| {
            let views = outcome.plan.views.iter().zip(&outcome.measured_by_view);
            union_of(views.filter(|(view, _)| view.setup == id).map(|(_, row)| row), samples)
        };
        let measured = SetupId::number(&outcome.plan.setups).map(measured).collect();
        Self { surface, part: SharedSurface::new(surface), measured }
    }

    /// Resistance of the strongest link of a setup whose views measure these samples.
    fn resistance(&self, own: &SampleSet) -> f64 {
        let links = self.measured.iter().map(|other| self.part.stability(&shared(own, other)));
        links.map(|stability| stability.resistance).fold(0.0, f64::max)
    }

    /// Area that it shares with any of the others.
    fn shared_area_mm2(&self, own: &SampleSet) -> f64 {
        let is_shared = |sample: &SampleId| self.measured.iter().any(|other| other.holds(*sample));
        own.iter().filter(is_shared).map(|sample| self.surface.sample_area_mm2(sample)).sum()
    }
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
