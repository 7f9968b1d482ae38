//! The candidates in rounds: those of the strategies that know the part alone, with their stations and what they measure;
//! then those that build on that, examined in the same way and added. What no candidate that the cell can use measures
//! counts as uncovered.

use super::evaluated::{EvaluatedCandidates, is_usable};
use crate::planning::candidates::{self, Candidate, CandidateSet, OpenSamples, Rejection, Scope};
use crate::planning::context::{Cancelled, Context, PlanError, Stage};
use crate::planning::ids::{CandidateIndex, SampleId};
use crate::planning::params::{Objective, PlanParams, ScoreParams, SelectionParams, Solver, Strategy, TargetOf};
use crate::planning::scene::{PlanningScene, Reach};
use crate::planning::selection::{self, CoverProblem};
use crate::planning::surface::Surface;
use crate::planning::visibility::{self, Occluders, Row, SampleSet};

/// A targeted view is worth keeping for this share of the open area.
const MIN_GAIN_OF_OPEN: f64 = 0.001;

/// Inputs that all rounds share.
pub(super) struct Rounds<'a> {
    pub(super) scope: Scope<'a>,
    pub(super) params: &'a PlanParams,
    pub(super) occluders: &'a Occluders,
    pub(super) scene: Option<&'a PlanningScene<'a>>,
    /// Area of each sample, 0 where it is not asked for.
    pub(super) asked_area_mm2: &'a [f64],
}

impl Rounds<'_> {
    /// Runs every round that the strategies ask for.
    ///
    /// # Errors
    /// The errors of [`candidates::generate`].
    pub(super) fn run(&self, ctx: &Context<'_>) -> Result<EvaluatedCandidates, PlanError> {
        let params = &self.params.candidates;
        ctx.begin(Stage::Candidates)?;
        let mut evaluated = self.evaluate(candidates::generate(&self.scope, params, ctx)?, ctx)?;
        let rounds = if params.uses(Strategy::Iterative) { params.iterative_rounds } else { 0 };
        for round in 0..rounds {
            ctx.begin(Stage::Candidates)?;
            let best = views_for_area(&evaluated, self.asked_area_mm2, self.params, ctx)?;
            let pose = |candidate: &CandidateIndex| evaluated.candidates[*candidate].part_from_scanner;
            let best: Vec<_> = best.iter().map(pose).collect();
            let more = candidates::around_best(&self.scope, params, &best, round, ctx)?;
            evaluated.append(self.evaluate(more, ctx)?);
        }
        if params.uses(Strategy::Targeted) {
            let targeted = self.targeted(&evaluated, ctx)?;
            evaluated.append(targeted);
        }
        evaluated.drop_what_measures_nothing(self.asked_area_mm2);
        Ok(evaluated)
    }

    /// Evaluates at most `max` of the candidates of the strategies that know the part alone, evenly spaced.
    ///
    /// # Errors
    /// The errors of [`candidates::generate`].
    pub(super) fn run_some(&self, max: usize, ctx: &Context<'_>) -> Result<EvaluatedCandidates, PlanError> {
        let some = candidates::generate_some(&self.scope, &self.params.candidates, max, ctx)?;
        Ok(self.evaluate(some, ctx)?)
    }

    /// Evaluates candidates beside views; `already` are generated.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(super) fn run_beside(
        &self,
        views: &[&Candidate],
        already: usize,
        ctx: &Context<'_>,
    ) -> Result<EvaluatedCandidates, Cancelled> {
        let beside = candidates::beside(&self.scope, &self.params.candidates, views, already, ctx)?;
        let mut evaluated = self.evaluate(beside, ctx)?;
        evaluated.drop_what_measures_nothing(self.asked_area_mm2);
        Ok(evaluated)
    }

    /// Evaluates candidates: their stations, and the samples that each measures.
    fn evaluate(&self, candidates: CandidateSet, ctx: &Context<'_>) -> Result<EvaluatedCandidates, Cancelled> {
        self.evaluate_on(self.scope.surface, candidates, ctx)
    }

    /// Evaluates candidates on another surface of the part.
    fn evaluate_on(
        &self,
        surface: &Surface,
        candidates: CandidateSet,
        ctx: &Context<'_>,
    ) -> Result<EvaluatedCandidates, Cancelled> {
        let candidates = match self.scene {
            Some(scene) => scene.drop_where_body_meets(scene.drop_inside_obstacles(candidates), ctx)?,
            None => candidates,
        };
        let poses: Vec<_> = candidates.remaining.iter().map(|candidate| candidate.part_from_scanner).collect();
        ctx.begin(Stage::Stations)?;
        let reach = self.scene.map(|scene| scene.reach(&poses, ctx)).transpose()?;
        ctx.begin(Stage::Visibility)?;
        self.seen(surface, candidates, reach, ctx)
    }

    /// Evaluates candidates whose stations are known.
    fn seen(
        &self,
        surface: &Surface,
        candidates: CandidateSet,
        reach: Option<Reach>,
        ctx: &Context<'_>,
    ) -> Result<EvaluatedCandidates, Cancelled> {
        let poses: Vec<_> = candidates.remaining.iter().map(|candidate| candidate.part_from_scanner).collect();
        let usable: Vec<bool> = candidates.indices().map(|candidate| is_usable(reach.as_ref(), candidate)).collect();
        let matrix = visibility::cast(surface, &poses, &usable, self.scope.scanner, self.occluders, self.params, ctx)?;
        let hidden_by_cell = SampleSet::none_of(surface.sample_mm.len());
        let mut evaluated = EvaluatedCandidates { candidates, matrix, reach, hidden_by_cell };
        if let Some(scene) = self.scene {
            evaluated.keep_in_sight(scene, surface, ctx)?;
        }
        Ok(evaluated)
    }

    /// Views of what is open, as few as it takes; views that are proposed are looked at on open samples alone. Those that the cell cannot take are added for what is then still open:
    /// they tell that reach, and not the part's shape, is what is missing.
    fn targeted(&self, so_far: &EvaluatedCandidates, ctx: &Context<'_>) -> Result<EvaluatedCandidates, Cancelled> {
        ctx.begin(Stage::Candidates)?;
        let mut area_mm2 = self.asked_area_mm2.to_vec();
        let usable = so_far.candidates.indices().filter(|candidate| so_far.is_usable(*candidate));
        usable.for_each(|candidate| close(&mut area_mm2, so_far.row(candidate)));
        let samples: Vec<SampleId> =
            SampleId::number(&area_mm2).filter(|(_, mm2)| **mm2 > 0.0).map(|(sample, _)| sample).collect();
        let incidence_max_rad = self.scope.scanner.devices.map(|device| self.params.limits.incidence_max_rad(&device));
        let open = OpenSamples { samples: &samples, occluders: self.occluders.rays(), incidence_max_rad };
        let (already, params) = (so_far.candidates.generated, &self.params.candidates);
        let proposed = candidates::aimed_at_open(&self.scope, params, &open, already, ctx)?;
        let open: Vec<(SampleId, f64)> = samples.iter().map(|sample| (*sample, area_mm2[sample.index()])).collect();
        let mut area_mm2: Vec<f64> = open.iter().map(|(_, mm2)| *mm2).collect();
        let mut proposed = self.evaluate_on(&self.scope.surface.of_samples(&open), proposed, ctx)?;
        let mut needed = vec![false; proposed.candidates.remaining.len()];
        let mut left = params.targeted_max;
        for usable in [true, false] {
            let params = SelectionParams { min_growth: MIN_GAIN_OF_OPEN, max_views: Some(left), ..for_area() };
            for candidate in fewest(&proposed, usable, &area_mm2, (&params, &self.params.score), ctx)? {
                close(&mut area_mm2, proposed.row(candidate));
                needed[candidate.index()] = true;
                left -= 1;
            }
        }
        proposed.drop_where(|_, candidate| (!needed[candidate.index()]).then_some(Rejection::NotNeeded));
        self.on_all_samples(proposed, &samples, ctx)
    }

    /// Candidates that were evaluated on `open` samples alone, evaluated on all.
    fn on_all_samples(
        &self,
        of_open: EvaluatedCandidates,
        open: &[SampleId],
        ctx: &Context<'_>,
    ) -> Result<EvaluatedCandidates, Cancelled> {
        let mut of_all = self.seen(self.scope.surface, of_open.candidates, of_open.reach, ctx)?;
        for (sample, cause) in open.iter().zip(of_open.matrix.furthest_cause) {
            let furthest = &mut of_all.matrix.furthest_cause[sample.index()];
            *furthest = (*furthest).max(cause);
        }
        of_open.hidden_by_cell.iter().for_each(|place| of_all.hidden_by_cell.insert(open[place.index()]));
        Ok(of_all)
    }
}

/// The views that greedy takes for plain area, up to the target.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn views_for_area(
    evaluated: &EvaluatedCandidates,
    asked_area_mm2: &[f64],
    params: &PlanParams,
    ctx: &Context<'_>,
) -> Result<Vec<CandidateIndex>, Cancelled> {
    let SelectionParams { target, max_views, .. } = params.selection;
    let for_target = SelectionParams { target, max_views, ..for_area() };
    fewest(evaluated, true, asked_area_mm2, (&for_target, &params.score), ctx)
}

/// Candidates that greedy chooses for `area_mm2` among those that are usable or among those that are not.
fn fewest(
    evaluated: &EvaluatedCandidates,
    usable: bool,
    area_mm2: &[f64],
    (params, score): (&SelectionParams, &ScoreParams),
    ctx: &Context<'_>,
) -> Result<Vec<CandidateIndex>, Cancelled> {
    let all = evaluated.candidates.indices();
    let among: Vec<CandidateIndex> = all.filter(|candidate| evaluated.is_usable(*candidate) == usable).collect();
    if among.is_empty() || params.max_views == Some(0) {
        return Ok(Vec::new());
    }
    let rows = among.iter().map(|candidate| evaluated.row(*candidate)).collect();
    let cover = CoverProblem::new(rows, area_mm2, area_mm2.iter().sum(), params);
    let choices = selection::greedily(&cover, params, score, ctx)?;
    Ok(choices.iter().map(|choice| among[choice.row.index()]).collect())
}

/// Greedy for all the area that can be had.
fn for_area() -> SelectionParams {
    SelectionParams {
        solver: Solver::Greedy,
        objective: Objective::Coverage,
        target: 1.0,
        target_of: TargetOf::Coverable,
        ..SelectionParams::default()
    }
}

/// Marks the samples of `row` as covered.
fn close(area_mm2: &mut [f64], row: &Row) {
    row.samples().for_each(|sample| area_mm2[sample.index()] = 0.0);
}
