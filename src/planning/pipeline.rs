//! The pipeline: mesh, scanner and cell in, an [`Outcome`] out, by the stages of [`Stage`] in turn. Each is a function of its
//! name: [`surface`]; candidates, stations and visibility, which take turns in rounds ([`Stages::problem`]); then
//! [`Stages::selection`], [`Stages::sequence`], [`Stages::missed`], [`Stages::certificate`] and [`Stages::bound`]. Collision
//! scene and roadmap are stages within others. Pure: no clock, no I/O; the same input gives the same outcome on any number of
//! threads. Call it inside the thread pool that it shall use.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::adjust;
use super::advice::better_grades::{self, BetterGrades};
use super::advice::{self, AdviceScope, Basis};
use super::candidates::{Candidate, CandidateSet};
use super::certificate::{self, SetupViews};
use super::context::{Cancelled, Context, PlanError, Stage};
use super::ids::{CandidateIndex, SetupId, SetupIndex};
use super::missed::CanExecute;
use super::missed::obstructions::{self, BlockedCandidate};
use super::outcome::{self, Surroundings};
use super::params::{PlanParams, SelectionGoal};
use super::plan::{Bound, Certificate, ChosenOn, Coverage, Obstruction, Outcome, SetupPlan, StopReason};
use super::problem::estimate::Estimate;
use super::problem::{
    ChosenViews, EvaluatedSetups, ExpectedViews, PartlyKnown, SampledPart, SamplesToChooseOn, ViewPlanningProblem,
};
use super::scene::demand::{Demand, DemandStop, FurtherViews};
use super::scene::{self, PlanInput, PlanningScene};
use super::selection::{FirstChoice, OpenBound};
use super::sequence::Ordered;
use super::setups::Setup;
use super::surface::Surface;
use super::visibility::{self, Occluders, Row};
use crate::cell::Configuration;
use crate::geometry::{Part, Pose, RayScene, ScannerFrame};

/// Times that views without a path are exchanged for others at most; views without one after that carry it as a rejection.
const MAX_RESELECTIONS: usize = 12;

/// Times that samples are added at most, where views meet their goals on those that they are chosen on and not on all.
const MAX_REFINEMENTS: u32 = 3;

/// Plans: every stage in turn.
///
/// # Errors
/// [`PlanError`]. Area that cannot be measured is not an error: it is counted, with its cause, in the outcome.
pub fn plan(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Outcome, PlanError> {
    let sampled = surface(input, params, None, ctx)?;
    let setups = sampled.setups(input, ctx)?;
    let stages = Stages { input, sampled: &sampled, setups: &setups, demand: None, ctx };
    let mut problem = stages.problem()?;
    let views = stages.ordered_views(&mut problem)?;
    stages.finish(problem, views)
}

/// Plans further views of a part that was planned with `params`: the fewest that are expected to measure what is still open. Stages
/// and files are those of [`plan()`], and the plan asks for the open samples alone.
///
/// # Errors
/// [`PlanError`], as of [`plan()`]; nothing open.
pub fn plan_further(
    input: &PlanInput<'_>,
    params: &PlanParams,
    demand: &Demand<'_>,
    ctx: &Context<'_>,
) -> Result<FurtherViews, PlanError> {
    let mut params = params.clone();
    // Views are chosen by what they are expected to add, and nothing else.
    (params.selection.goal, params.robust.select, params.missed.advice) = (SelectionGoal::FewestViews, false, false);
    let sampled = surface(input, &params, Some(demand), ctx)?;
    let setups = sampled.setups(input, ctx)?;
    let stages = Stages { input, sampled: &sampled, setups: &setups, demand: Some(demand), ctx };
    let mut problem = stages.problem()?;
    let ExpectedViews { chosen, left_mm2, stopped_because, .. } = problem.select_expected(demand, &BTreeSet::new(), ctx)?;
    if chosen.candidates.is_empty() {
        return Ok(FurtherViews { outcome: None, expected_mm2: Vec::new(), left_mm2, stopped_because });
    }
    let mut views = stages.ordered_views(&mut problem)?;
    let expected = views.expected.take();
    let outcome = Some(stages.finish(problem, views)?);
    let (expected_mm2, stopped_because) = expected.unwrap_or((Vec::new(), stopped_because));
    Ok(FurtherViews { outcome, expected_mm2, left_mm2, stopped_because })
}

/// Visibility matrix that the views of a plan are chosen from, for studies of candidates and solvers.
#[derive(Clone, Debug)]
pub struct Tabulated {
    /// The samples.
    pub surface: Arc<Surface>,
    /// Area of each sample, 0 where it is not asked for.
    pub asked_area_mm2: Vec<f64>,
    /// The candidates that may be chosen, and those that were dropped.
    pub candidates: CandidateSet,
    /// Samples that each of them measures; a problem of covering with them all has the same rows.
    pub rows: Vec<Row>,
}

/// [`plan()`] up to where views are chosen.
///
/// # Errors
/// [`PlanError`].
pub fn tabulate(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Tabulated, PlanError> {
    let sampled = surface(input, params, None, ctx)?;
    let setups = sampled.setups(input, ctx)?;
    let EvaluatedSetups { on: SamplesToChooseOn { surface, asked_area_mm2, .. }, mut evaluated, .. } =
        sampled.evaluate(input, &setups, ctx)?;
    evaluated.drop_unusable();
    Ok(Tabulated { surface, asked_area_mm2, candidates: evaluated.candidates, rows: evaluated.matrix.rows })
}

/// Stage surface: the part in samples, once the estimate of the plan is within its allowance.
fn surface(
    input: &PlanInput<'_>,
    params: &PlanParams,
    demand: Option<&Demand<'_>>,
    ctx: &Context<'_>,
) -> Result<SampledPart, PlanError> {
    params.check_of_plan()?;
    params.check_limits(input.scanner)?;
    ctx.check()?;
    Estimate::of(input, params, rayon::current_num_threads()).check(ctx.allowance())?;
    input.check_place()?;
    let params = scene::resolve(params, input);
    ctx.stage(Stage::Surface, || SampledPart::new(input, params, demand, ctx))
}

/// The stages after the surface, of one plan.
struct Stages<'a> {
    input: &'a PlanInput<'a>,
    sampled: &'a SampledPart,
    setups: &'a [Setup<'a>],
    /// Present where further views are planned.
    demand: Option<&'a Demand<'a>>,
    ctx: &'a Context<'a>,
}

/// Chosen views with their order, and what was given up on the way to them.
struct OrderedViews<'a> {
    chosen: ChosenViews,
    /// One for each setup; none without a cell, or before the sequence.
    ordered: Vec<Ordered>,
    /// Candidates that were given up for want of a path.
    excluded: BTreeSet<CandidateIndex>,
    /// Area that each view is expected to add, and the rule that ended their choice; of further views alone.
    expected: Option<(Vec<f64>, DemandStop)>,
    /// The last problem on every sample that was looked at.
    every: Option<ViewPlanningProblem<'a>>,
}

impl OrderedViews<'_> {
    /// Candidates of the views to which no path was found.
    fn without_path(&self) -> impl Iterator<Item = CandidateIndex> {
        self.ordered.iter().flat_map(move |ordered| self.chosen.candidates_of(&ordered.no_path))
    }
}

impl<'a> Stages<'a> {
    /// Stages candidates, stations and visibility, in as many rounds as the strategies take.
    fn problem(&self) -> Result<ViewPlanningProblem<'a>, PlanError> {
        let Self { input, sampled, setups, ctx, .. } = *self;
        let EvaluatedSetups { on, evaluated, robust_rows } = sampled.evaluate(input, setups, ctx)?;
        let of_samples = sampled.surface.sample_mm.len();
        Ok(ViewPlanningProblem {
            input,
            params: &sampled.params,
            chosen_on: ChosenOn { samples: on.surface.sample_mm.len(), of_samples, refinements: 0 },
            surface: on.surface,
            setups: setups.iter().map(|setup| setup.table_from_part).collect(),
            candidates: evaluated.candidates,
            matrix: evaluated.matrix,
            robust_rows,
            reach: evaluated.reach,
            hidden_by_cell: evaluated.hidden_by_cell,
            asked_area_mm2: on.asked_area_mm2,
            partly_known: PartlyKnown::default(),
            strata: on.strata,
            coverable_of_setup_mm2: None,
        })
    }

    /// Stages selection and sequence: a chosen view to which no path is found is excluded and both run again, a bounded number of
    /// times.
    fn ordered_views(&self, problem: &mut ViewPlanningProblem<'a>) -> Result<OrderedViews<'a>, PlanError> {
        let known = problem.known();
        let (mut excluded, mut reselections) = (BTreeSet::new(), 0);
        loop {
            let is_last = reselections == MAX_RESELECTIONS;
            let chosen = self.selection(problem, excluded, reselections == 0)?;
            let views = self.sequence(problem, chosen, !is_last)?;
            let no_path: Vec<CandidateIndex> = views.without_path().collect();
            if no_path.is_empty() || is_last {
                return Ok(views);
            }
            excluded = views.excluded;
            // Views beside one without a path mostly have none either: they are not looked for again.
            excluded.extend(no_path.into_iter().filter_map(|candidate| problem.original_of(candidate, known)));
            problem.forget_from(known);
            reselections += 1;
        }
    }

    /// Stage selection: the chosen views, slid.
    fn selection(
        &self,
        problem: &mut ViewPlanningProblem<'a>,
        excluded: BTreeSet<CandidateIndex>,
        looks_closer: bool,
    ) -> Result<OrderedViews<'a>, PlanError> {
        let ctx = self.ctx;
        ctx.stage(Stage::Selection, || {
            let (chosen, every, expected) = match self.demand {
                Some(demand) => {
                    let views = problem.select_expected(demand, &excluded, ctx)?;
                    (views.chosen, None, Some((views.expected_mm2, views.stopped_because)))
                }
                None => {
                    let Settled { chosen, every } = self.choose(problem, &excluded, looks_closer)?;
                    (chosen, every, None)
                }
            };
            if chosen.candidates.is_empty() && excluded.is_empty() {
                let in_the_way = obstructions(problem, self.setups, &excluded, ctx)?;
                return Err(PlanError::NoPlan(outcome::nothing_measured(problem, &self.setups[0].occluders, in_the_way, ctx)?));
            }
            Ok(OrderedViews { chosen, ordered: Vec::new(), excluded, expected, every })
        })
    }

    /// Stage sequence, with a cell: the views in order, setup by setup; some are exchanged where the shortest cycle is the goal.
    fn sequence(
        &self,
        problem: &ViewPlanningProblem<'a>,
        views: OrderedViews<'a>,
        require_all: bool,
    ) -> Result<OrderedViews<'a>, PlanError> {
        let Self { sampled, setups, ctx, .. } = *self;
        let scenes: Vec<_> = scenes(setups).collect();
        if scenes.is_empty() {
            return Ok(views);
        }
        ctx.stage(Stage::Sequence, || {
            let OrderedViews { chosen, excluded, expected, mut every, .. } = views;
            let order = |(setup, scene): (SetupIndex, &&PlanningScene<'_>)| {
                let in_sight = |view, station: &Configuration| problem.is_in_sight(scene, chosen.candidate(view), station, ctx);
                scene.order(&problem.stations_of(&chosen, setup), require_all, &in_sight, ctx)
            };
            let ordered: Vec<Ordered> = SetupIndex::number(&scenes).map(order).collect::<Result<_, _>>()?;
            let has_paths = ordered.iter().all(|ordered| ordered.no_path.is_empty());
            if !has_paths || problem.params.selection.goal != SelectionGoal::MinTime {
                return Ok(OrderedViews { chosen, ordered, excluded, expected, every });
            }
            let mut is_permitted = |chosen: &ChosenViews| {
                if is_settled(problem, chosen) {
                    return Ok(true);
                }
                let of_chosen = problem.on_every_sample(sampled, setups, &problem.at_any_station(chosen), every.take(), ctx)?;
                Ok(every.insert(of_chosen).meets_goals(&chosen.candidates, &excluded))
            };
            let known = (chosen, ordered);
            let (chosen, ordered) = adjust::exchange_views(problem, &scenes, known, &excluded, &mut is_permitted, ctx)?;
            Ok(OrderedViews { chosen, ordered, excluded, expected, every })
        })
    }

    /// Stages missed and certificate, with the bound beside them.
    fn finish(&self, problem: ViewPlanningProblem<'a>, views: OrderedViews<'a>) -> Result<Outcome, PlanError> {
        let (chosen, open) = (views.chosen.candidates.len(), Arc::clone(&views.chosen.selection.bound));
        let is_chosen_as_planned = !problem.tolerates_errors();
        let graded = (&views.chosen, &views.ordered[..]);
        let better_grades = better_grades::choose(&problem, graded, &views.excluded, self.ctx)?;
        let explained = || {
            let part_alone = || self.sampled.part_alone(self.input, self.setups, self.ctx);
            let (shortened, part) = rayon::join(|| self.shorten(problem, views), part_alone);
            let ((views, problem), part) = (shortened?, part?);
            let mut outcome = self.missed(problem, views, (&part, better_grades.as_ref()))?;
            let certificate = self.certificate(&outcome, &part)?;
            add_certificate(&mut outcome.plan.coverage, certificate);
            Ok::<_, PlanError>(outcome)
        };
        let (mut outcome, bound) = self.bound(&open, explained)?;
        let counts_all = outcome.plan.executed_views() == chosen && outcome.plan.params.realism.count_at_risk;
        let of_asked = (counts_all && is_chosen_as_planned).then(|| outcome.plan.coverage.of_asked());
        outcome.plan.bound = bound.beside(chosen).of_plan(of_asked);
        Ok(outcome)
    }

    /// Stage missed: verdicts, coverage, and the causes and remedies of what is missed.
    fn missed(
        &self,
        problem: ViewPlanningProblem<'_>,
        views: OrderedViews<'_>,
        (part, better_grades): (&Arc<RayScene>, Option<&BetterGrades>),
    ) -> Result<Outcome, PlanError> {
        let Self { input, sampled, setups, demand, ctx } = *self;
        ctx.stage(Stage::Missed, || {
            let can_execute = |view: &Pose<Part, ScannerFrame>| can_execute(setups, view, ctx);
            let can_execute = input.cell.is_some().then_some(&can_execute as &CanExecute<'_>);
            let all_excluded: BTreeSet<_> = views.without_path().chain(views.excluded.iter().copied()).collect();
            let obstructions = obstructions(&problem, setups, &all_excluded, ctx)?;
            let OrderedViews { chosen, ordered, excluded, .. } = views;
            let (occluders, is_of_open) = (sampled.occluders(setups), demand.is_some());
            let surroundings = Surroundings { sampled, setups, occluders, part, can_execute, is_of_open };
            let basis = Basis::of(&problem, &chosen, &ordered, &excluded, ctx)?;
            let mut outcome = outcome::assemble(problem, &chosen, ordered, &excluded, &surroundings, ctx)?;
            if let Some(basis) = basis {
                outcome.plan.advice =
                    advice::of((&basis, better_grades), &outcome, &AdviceScope { input, sampled, setups, part }, ctx)?;
            }
            if sampled.params.visibility.pixel_set {
                count_by_pixels(&mut outcome, input, occluders, ctx)?;
            }
            outcome.plan.obstructions = obstructions;
            add_clearances(&mut outcome, setups, ctx)?;
            let scene_of = |plan: &SetupPlan| Some(setup_of(setups, plan)?.scene.as_ref()?.collision_scene().clone());
            outcome.scenes = outcome.plan.setups.iter().filter_map(scene_of).collect();
            Ok(outcome)
        })
    }

    /// Stage certificate: coverage of the chosen views on a second set of samples, and with poses that are off.
    fn certificate(&self, outcome: &Outcome, part: &RayScene) -> Result<Certificate, PlanError> {
        let Self { input, sampled, setups, demand, ctx } = *self;
        ctx.stage(Stage::Certificate, || {
            let plan = &outcome.plan;
            let views = |(id, plan_of_setup): (SetupId, &SetupPlan)| {
                let setup = setup_of(setups, plan_of_setup)?;
                Some(SetupViews::of(&setup.occluders, setup.scene.as_ref().map(PlanningScene::sight), &plan.views, id))
            };
            let views: Vec<_> = SetupId::number(&plan.setups).filter_map(views).collect();
            let standing = setups.iter().filter(|setup| setup.scene.is_some()).map(|setup| setup.table_from_part);
            let standing: Vec<_> = standing.collect();
            // Regions do not tell what is asked of further views.
            let asked_as = demand.map(|_| &outcome.surface);
            certificate::certify((input, &sampled.params), &views, (part, asked_as), &standing, ctx)
        })
    }

    /// Stage bound: what is left to compute of it once the stages beside it are done. It lasts as long as they do and depends on none
    /// of them.
    fn bound<T: Send>(
        &self,
        open: &OpenBound,
        stages_beside: impl FnOnce() -> Result<T, PlanError> + Send,
    ) -> Result<(T, Bound), PlanError> {
        let beside = || stages_beside().and_then(|done| self.ctx.stage(Stage::Bound, || Ok(done)));
        let (done, bound) = rayon::join(beside, || open.compute(self.ctx));
        Ok((done?, bound?))
    }
}

/// Chosen views, and the last problem on every sample that was looked at.
struct Settled<'a> {
    chosen: ChosenViews,
    every: Option<ViewPlanningProblem<'a>>,
}

/// Views whose grades set floors under those of the views that are chosen.
enum FloorSource {
    /// Greedy's views before they are slid.
    Unslid,
    /// A first choice.
    FirstChoice(FirstChoice),
    /// Greedy's views once they are slid, where they then have better grades than the chosen ones.
    Slid,
}

/// Parts of the stages.
impl<'a> Stages<'a> {
    /// Chooses views that meet their goals on every sample. With a closer look, candidates beside the views of a first choice join
    /// the others, unless fewer views are chosen without them; without it, greedy's views set the floors under grades once they are slid.
    fn choose(
        &self,
        problem: &mut ViewPlanningProblem<'a>,
        excluded: &BTreeSet<CandidateIndex>,
        looks_closer: bool,
    ) -> Result<Settled<'a>, PlanError> {
        if !(looks_closer && adjust::looks_closer(problem)) {
            return self.settle(problem, FloorSource::Slid, excluded);
        }
        let before = problem.strata.is_some().then(|| problem.clone());
        let first = problem.look_beside_first_choice(self.sampled, self.setups, excluded, self.ctx)?;
        let views_at_first = first.rows.len();
        let closer = self.settle(problem, FloorSource::FirstChoice(first), excluded)?;
        // Views that join several setups come on top.
        // So do those that tilted candidates give for more at grade A.
        let has_own = self.setups.len() > 1 || problem.params.selection.min_grade_a.is_some();
        let takes_more = !has_own && closer.chosen.candidates.len() > views_at_first;
        let Some(mut before) = before.filter(|_| takes_more) else { return Ok(closer) };
        let without = self.settle(&mut before, FloorSource::Unslid, excluded)?;
        if without.chosen.candidates.len() >= closer.chosen.candidates.len() {
            return Ok(closer);
        }
        *problem = before;
        Ok(without)
    }

    /// Selects views, joins and slides them; takes those that the selection falls back on, and then selects anew, while their goals are met
    /// on the samples that they are chosen on and not on every sample.
    fn settle(
        &self,
        problem: &mut ViewPlanningProblem<'a>,
        floors: FloorSource,
        excluded: &BTreeSet<CandidateIndex>,
    ) -> Result<Settled<'a>, PlanError> {
        let Self { sampled, setups, ctx, .. } = *self;
        let (mut first, slides_greedy) = match floors {
            FloorSource::Unslid => (None, false),
            FloorSource::FirstChoice(first) => (Some(first), false),
            FloorSource::Slid => (None, true),
        };
        let (mut every, mut known, mut views) = (None, problem.known(), Vec::new());
        loop {
            if views.is_empty() {
                known = problem.known();
                views = problem.select(excluded, first.as_ref(), ctx)?;
                // Views with more at grade A might take more to join the setups.
                views.truncate(if self.setups.len() > 1 { 1 } else { usize::MAX });
            }
            let Some(mut chosen) = views.pop() else { continue };
            if chosen.candidates.is_empty() {
                return Ok(Settled { chosen, every });
            }
            chosen = adjust::join_setups(problem, chosen, excluded, ctx)?;
            chosen = adjust::slide_views(problem, setups, chosen, excluded, ctx)?;
            if slides_greedy && first.is_none() {
                first = adjust::better_graded_choice(problem, setups, &chosen.candidates, excluded, ctx)?;
                if first.is_some() {
                    views.clear();
                    continue;
                }
            }
            if is_settled(problem, &chosen) {
                return Ok(Settled { chosen, every });
            }
            let of_chosen = problem.on_every_sample(sampled, setups, &problem.at_any_station(&chosen), every.take(), ctx)?;
            let of_chosen = every.insert(of_chosen);
            if of_chosen.meets_goals(&chosen.candidates, excluded) {
                return Ok(Settled { chosen, every });
            }
            if !views.is_empty() {
                problem.forget_from(known);
                continue;
            }
            let goes_on = problem.chosen_on.refinements < MAX_REFINEMENTS;
            if !goes_on || !problem.refine(of_chosen, setups, &chosen, ctx)? {
                let chosen = problem.topped_up(of_chosen, chosen, excluded, ctx)?;
                return Ok(Settled { chosen, every });
            }
            problem.forget_from(known);
        }
    }

    /// Bounds each setup's sequence, then rolls its views where that makes the moves shorter; returns the problem on every
    /// sample. Rolls with which the views meet their goals on the samples that they were chosen on, but not on all, are taken
    /// back. The time counts to the stage before.
    fn shorten(
        &self,
        mut problem: ViewPlanningProblem<'a>,
        mut views: OrderedViews<'a>,
    ) -> Result<(OrderedViews<'a>, ViewPlanningProblem<'a>), PlanError> {
        let Self { sampled, setups, ctx, .. } = *self;
        let known = match views.every.take() {
            Some(every) if every.is_of(&views.chosen, &problem) => return Ok((views, every)),
            known => known,
        };
        let bounded = scenes(setups).zip(views.ordered).map(|(scene, ordered)| scene.bounded(ordered, ctx));
        let ordered = bounded.collect::<Result<Vec<_>, _>>()?;
        let as_moved = |ordered: Vec<Ordered>| {
            let bounded = scenes(setups).zip(ordered).map(|(scene, ordered)| scene.bounded_as_moved(ordered, ctx));
            bounded.collect::<Result<Vec<_>, _>>()
        };
        let chosen = &views.chosen;
        let unrolled = problem.strata.is_some().then(|| (problem.poses_of(chosen), ordered.clone()));
        views.ordered = as_moved(adjust::roll_views(&mut problem, setups, chosen, ordered, ctx)?)?;
        let Some((poses, in_order)) = unrolled else { return Ok((views, problem)) };
        let mut every = problem.on_every_sample(sampled, setups, &problem.as_ordered(chosen, &views.ordered), known, ctx)?;
        let is_met =
            chosen.selection.stopped_because != StopReason::Target || every.meets_goals(&chosen.candidates, &views.excluded);
        if !is_met && problem.poses_of(chosen) != poses {
            problem.put_back(chosen, &poses);
            views.ordered = as_moved(in_order)?;
            every = problem.on_every_sample(sampled, setups, &problem.as_ordered(chosen, &views.ordered), Some(every), ctx)?;
        }
        Ok((views, every))
    }
}

/// Returns true if chosen views are not held against every sample: they miss their goals on the samples that they are chosen on
/// already, tolerate errors, or are chosen on every sample.
fn is_settled(problem: &ViewPlanningProblem<'_>, chosen: &ChosenViews) -> bool {
    chosen.selection.stopped_because != StopReason::Target || problem.tolerates_errors() || problem.strata.is_none()
}

/// Adds to the coverage of a plan what it is on other samples.
fn add_certificate(coverage: &mut Coverage, certificate: Certificate) {
    let Certificate { independent, regions, robust } = certificate;
    (coverage.independent, coverage.robust) = (independent, robust);
    for (region, independent) in coverage.regions.iter_mut().zip(regions) {
        region.independent = Some(independent).filter(|independent| independent.samples > 0);
    }
}

fn scenes<'s, 'a>(setups: &'s [Setup<'a>]) -> impl Iterator<Item = &'s PlanningScene<'a>> {
    setups.iter().filter_map(|setup| setup.scene.as_ref())
}

/// The setup that a plan's is.
fn setup_of<'s, 'a>(setups: &'s [Setup<'a>], plan: &SetupPlan) -> Option<&'s Setup<'a>> {
    setups.iter().find(|setup| setup.table_from_part == plan.table_from_part)
}

/// Finds the bodies that keep the cell from candidates; `without_path` are usable ones that were given up.
fn obstructions(
    problem: &ViewPlanningProblem<'_>,
    setups: &[Setup<'_>],
    without_path: &BTreeSet<CandidateIndex>,
    ctx: &Context<'_>,
) -> Result<Vec<Obstruction>, Cancelled> {
    let blocked = |(candidate, stations)| {
        let candidate: &Candidate = candidate;
        Some(BlockedCandidate { scene: setups[candidate.setup.index()].scene.as_ref()?, candidate, stations })
    };
    let blocked: Vec<_> = problem.obstructed(without_path).into_iter().filter_map(blocked).collect();
    obstructions::explain(&blocked, ctx)
}

/// Adds to each station how near anything comes there.
fn add_clearances(outcome: &mut Outcome, setups: &[Setup<'_>], ctx: &Context<'_>) -> Result<(), Cancelled> {
    let scene_of = |plan: &SetupPlan| {
        let scene = setup_of(setups, plan).and_then(|setup| setup.scene.as_ref());
        scene.map(|scene| Ok((scene, scene.farthest(ctx)?))).transpose()
    };
    let scenes = outcome.plan.setups.iter().map(scene_of).collect::<Result<Vec<_>, Cancelled>>()?;
    for view in &mut outcome.plan.views {
        let scene = scenes.get(view.setup.index()).and_then(Option::as_ref);
        if let (Some((scene, farthest)), Some(station), Some(stance)) = (scene, &view.station, &mut view.stance) {
            stance.clearance_mm = scene.clearance_mm(station, farthest);
        }
    }
    Ok(())
}

/// Returns true if the cell can take a view in one of the setups.
fn can_execute(setups: &[Setup<'_>], view: &Pose<Part, ScannerFrame>, ctx: &Context<'_>) -> Result<bool, Cancelled> {
    for scene in scenes(setups) {
        if scene.can_execute(view, ctx)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Adds the thesis's own answer: which triangles the views hit with pixels.
fn count_by_pixels(
    outcome: &mut Outcome,
    input: &PlanInput<'_>,
    occluders: &Occluders,
    ctx: &Context<'_>,
) -> Result<(), PlanError> {
    let views = outcome.plan.views.iter().filter(|view| view.rejected.is_none()).map(|view| &view.part_from_scanner);
    let hits = visibility::pixel_views(occluders, input.mesh.faces.len(), input.scanner, views, ctx)?;
    let area_mm2 = |(face, hits): (usize, &u32)| if *hits > 0 { input.mesh.face_area_mm2(face) } else { 0.0 };
    outcome.plan.coverage.pixel_set_area_mm2 = Some(hits.iter().enumerate().map(area_mm2).sum());
    outcome.pixel_views = Some(hits);
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::planning::context::Silent;
    use crate::planning::params::{CandidateParams, Engine, PoseErrorParams};
    use crate::testing::{box_mesh, nominal_scanner, trough};

    /// The bound of what views measure under errors too was told as one of what they measure as planned.
    #[test]
    fn no_plan_of_views_that_tolerate_errors_has_a_bound_of_its_share() {
        let (mesh, scanner, cancel) = (trough(), nominal_scanner(), AtomicBool::new(false));
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.005), Some(20.0));
        (params.visibility.engine, params.missed.remedies, params.missed.advice) = (Engine::Rays, 0, false);
        (params.selection.goal, params.selection.max_views) = (SelectionGoal::BestCoverage, Some(2));
        params.robust.pose_error = Some(PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 });
        (params.robust.draws, params.robust.part_draws, params.robust.hand_eye_draws) = (1, 1, 1);
        for select in [false, true] {
            params.robust.select = select;
            let bound = plan(&input, &params, &Context::new(&cancel, &Silent)).expect("a plan").plan.bound;
            assert_eq!((bound.of_asked_upper.is_some(), bound.gap_of_asked.is_some()), (!select, !select), "{bound:?}");
            assert!(bound.views_lower >= 1, "{bound:?}");
        }
    }

    /// The part was planned, and its plan was then refused, as poses that are written may contain 100 m.
    #[test]
    fn a_part_that_lies_beyond_what_poses_may_contain_is_refused_at_the_part() {
        let scanner = nominal_scanner();
        let cancel = AtomicBool::new(false);
        let sampled = |x_mm: f64| {
            let mesh = box_mesh([x_mm, 0.0, 0.0], [x_mm + 60.0, 40.0, 30.0]);
            let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
            surface(&input, &PlanParams::default(), None, &Context::new(&cancel, &Silent)).map(drop)
        };
        assert!(sampled(90_000.0).is_ok() && sampled(-90_000.0).is_ok());
        for x_mm in [150_000.0, -150_000.0, 99_900.0] {
            let Err(PlanError::BadParams(errors)) = sampled(x_mm) else { panic!("{x_mm} mm was not refused") };
            let told = errors[0].to_string();
            assert!(
                told.starts_with("/part: reaches ") && told.contains("mm from the origin of its frame; allowed is "),
                "{told}"
            );
            assert!(told.contains("within 100000 mm: export the mesh"), "{told}");
        }
    }
}
