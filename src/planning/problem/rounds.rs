//! The candidates in rounds: those of the strategies that know the part alone, with their stations and what they measure;
//! then those that build on that, examined in the same way and added. What no candidate that the cell can use measures
//! counts as uncovered.

use super::evaluated::{EvaluatedCandidates, is_usable};
use crate::geometry::{Part, Pose, ScannerFrame};
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
    pub(super) ctx: &'a Context<'a>,
}

impl Rounds<'_> {
    /// Runs every round that the strategies ask for.
    ///
    /// # Errors
    /// The errors of [`candidates::generate`].
    pub(super) fn run(&self) -> Result<EvaluatedCandidates, PlanError> {
        let params = &self.params.candidates;
        let mut evaluated = self.round(|| candidates::generate(&self.scope, params, self.ctx), None)?;
        let rounds = if params.uses(Strategy::Iterative) { params.iterative_rounds } else { 0 };
        for round in 0..rounds {
            let more = self.round(|| self.around_best(&evaluated, round), None)?;
            evaluated.append(more);
        }
        if params.uses(Strategy::Targeted) {
            let (open, already) = (self.open_after(&evaluated), evaluated.candidates.generated);
            let targeted = self.round(|| self.aimed_at_open(&open, already), Some(open.as_slice()))?;
            evaluated.append(targeted);
        }
        evaluated.drop_what_measures_nothing(self.asked_area_mm2);
        Ok(evaluated)
    }

    /// Evaluates at most `max` of the candidates of the strategies that know the part alone, evenly spaced.
    ///
    /// # Errors
    /// The errors of [`candidates::generate`].
    pub(super) fn run_some(&self, max: usize) -> Result<EvaluatedCandidates, PlanError> {
        self.round(|| candidates::generate_some(&self.scope, &self.params.candidates, max, self.ctx), None)
    }

    /// Evaluates candidates beside views; `already` are generated.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(super) fn run_beside(&self, views: &[&Candidate], already: usize) -> Result<EvaluatedCandidates, Cancelled> {
        let beside = || candidates::beside(&self.scope, &self.params.candidates, views, already, self.ctx);
        let mut evaluated = self.round(beside, None)?;
        evaluated.drop_what_measures_nothing(self.asked_area_mm2);
        Ok(evaluated)
    }

    /// Runs one round, its stages in turn: the candidates that `generate` gives, with their stations and what they measure; given
    /// samples that are `open`, those candidates that these need.
    fn round<E: From<Cancelled>>(
        &self,
        generate: impl FnOnce() -> Result<CandidateSet, E>,
        open: Option<&[(SampleId, f64)]>,
    ) -> Result<EvaluatedCandidates, E> {
        let candidates = self.candidates(generate)?;
        let reach = self.stations(&candidates)?;
        Ok(self.visibility(candidates, reach, open)?)
    }

    /// Stage candidates: those generated, but for those that bodies rule out wherever arm and table are.
    fn candidates<E: From<Cancelled>>(&self, generate: impl FnOnce() -> Result<CandidateSet, E>) -> Result<CandidateSet, E> {
        self.ctx.stage(Stage::Candidates, || {
            let candidates = generate()?;
            Ok(match self.scene {
                Some(scene) => scene.drop_where_body_meets(scene.drop_inside_obstacles(candidates), self.ctx)?,
                None => candidates,
            })
        })
    }

    /// Stage stations: those of each candidate; `None` without a cell.
    fn stations(&self, candidates: &CandidateSet) -> Result<Option<Reach>, Cancelled> {
        self.ctx.stage(Stage::Stations, || self.scene.map(|scene| scene.reach(&poses(candidates), self.ctx)).transpose())
    }

    /// Stage visibility: the samples that each candidate measures.
    fn visibility(
        &self,
        candidates: CandidateSet,
        reach: Option<Reach>,
        open: Option<&[(SampleId, f64)]>,
    ) -> Result<EvaluatedCandidates, Cancelled> {
        self.ctx.stage(Stage::Visibility, || match open {
            Some(open) => self.needed_for(open, candidates, reach),
            None => self.seen(self.scope.surface, candidates, reach),
        })
    }

    /// Evaluates candidates whose stations are known.
    fn seen(&self, surface: &Surface, candidates: CandidateSet, reach: Option<Reach>) -> Result<EvaluatedCandidates, Cancelled> {
        let poses = poses(&candidates);
        let usable: Vec<bool> = candidates.indices().map(|candidate| is_usable(reach.as_ref(), candidate)).collect();
        let matrix = visibility::cast(surface, &poses, &usable, self.scope.scanner, self.occluders, self.params, self.ctx)?;
        let hidden_by_cell = SampleSet::none_of(surface.sample_mm.len());
        let mut evaluated = EvaluatedCandidates { candidates, matrix, reach, hidden_by_cell };
        if let Some(scene) = self.scene {
            evaluated.keep_in_sight(scene, surface, self.ctx)?;
        }
        Ok(evaluated)
    }

    /// Random viewpoints around the best views so far.
    fn around_best(&self, so_far: &EvaluatedCandidates, round: u32) -> Result<CandidateSet, Cancelled> {
        let best = views_for_area(so_far, self.asked_area_mm2, self.params, self.ctx)?;
        let pose = |candidate: &CandidateIndex| so_far.candidates[*candidate].part_from_scanner;
        let best: Vec<_> = best.iter().map(pose).collect();
        candidates::around_best(&self.scope, &self.params.candidates, &best, round, self.ctx)
    }

    /// Samples that no candidate so far measures which the cell can use, each with its area.
    fn open_after(&self, so_far: &EvaluatedCandidates) -> Vec<(SampleId, f64)> {
        let mut area_mm2 = self.asked_area_mm2.to_vec();
        let usable = so_far.candidates.indices().filter(|candidate| so_far.is_usable(*candidate));
        usable.for_each(|candidate| close(&mut area_mm2, so_far.row(candidate)));
        SampleId::number(area_mm2).filter(|(_, mm2)| *mm2 > 0.0).collect()
    }

    /// Viewpoints aimed at what is open; `already` are generated.
    fn aimed_at_open(&self, open: &[(SampleId, f64)], already: usize) -> Result<CandidateSet, Cancelled> {
        let samples: Vec<SampleId> = open.iter().map(|(sample, _)| *sample).collect();
        let incidence_max_rad = self.scope.scanner.devices.map(|device| self.params.limits.incidence_max_rad(&device));
        let open = OpenSamples { samples: &samples, occluders: self.occluders.rays(), incidence_max_rad };
        candidates::aimed_at_open(&self.scope, &self.params.candidates, &open, already, self.ctx)
    }

    /// Candidates for what is open, as few as it takes; they are looked at on open samples alone. Those that the cell cannot take
    /// are added for what is then still open: they tell that reach, and not the part's shape, is what is missing.
    fn needed_for(
        &self,
        open: &[(SampleId, f64)],
        candidates: CandidateSet,
        reach: Option<Reach>,
    ) -> Result<EvaluatedCandidates, Cancelled> {
        let mut proposed = self.seen(&self.scope.surface.of_samples(open), candidates, reach)?;
        let mut area_mm2: Vec<f64> = open.iter().map(|(_, mm2)| *mm2).collect();
        let mut needed = vec![false; proposed.candidates.remaining.len()];
        let mut left = self.params.candidates.targeted_max;
        for usable in [true, false] {
            let params = SelectionParams { min_growth: MIN_GAIN_OF_OPEN, max_views: Some(left), ..for_area() };
            for candidate in fewest(&proposed, usable, &area_mm2, (&params, &self.params.score), self.ctx)? {
                close(&mut area_mm2, proposed.row(candidate));
                needed[candidate.index()] = true;
                left -= 1;
            }
        }
        proposed.drop_where(|_, candidate| (!needed[candidate.index()]).then_some(Rejection::NotNeeded));
        self.on_all_samples(proposed, open)
    }

    /// Candidates that were evaluated on `open` samples alone, evaluated on all.
    fn on_all_samples(&self, of_open: EvaluatedCandidates, open: &[(SampleId, f64)]) -> Result<EvaluatedCandidates, Cancelled> {
        let mut of_all = self.seen(self.scope.surface, of_open.candidates, of_open.reach)?;
        for ((sample, _), cause) in open.iter().zip(of_open.matrix.furthest_cause) {
            let furthest = &mut of_all.matrix.furthest_cause[sample.index()];
            *furthest = (*furthest).max(cause);
        }
        of_open.hidden_by_cell.iter().for_each(|place| of_all.hidden_by_cell.insert(open[place.index()].0));
        Ok(of_all)
    }
}

/// Poses of the candidates that remain.
fn poses(candidates: &CandidateSet) -> Vec<Pose<Part, ScannerFrame>> {
    candidates.remaining.iter().map(|candidate| candidate.part_from_scanner).collect()
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
