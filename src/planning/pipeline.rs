//! The pipeline: mesh, scanner and cell in, an [`Outcome`] out. Pure: no clock, no I/O; the same input gives the same outcome
//! on any number of threads. Call it inside the thread pool that it shall use.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::adjust;
use super::advice::{self, AdviceScope, Basis};
use super::candidates::{Candidate, CandidateSet};
use super::certificate::{self, SetupViews};
use super::context::{Cancelled, Context, PlanError, Stage};
use super::demand::{Demand, DemandStop, FurtherViews};
use super::ids::{CandidateIndex, SetupId, SetupIndex};
use super::missed::CanExecute;
use super::missed::obstructions::{self, BlockedCandidate};
use super::outcome::{self, Surroundings};
use super::params::{PlanParams, SelectionGoal};
use super::plan::{Certificate, ChosenOn, Obstruction, Outcome, SetupPlan, StopReason};
use super::problem::{
    ChosenViews, EvaluatedSetups, ExpectedViews, PartlyKnown, SampledPart, SamplesToChooseOn, ViewPlanningProblem,
};
use super::scene::{PlanInput, PlanningScene};
use super::selection::FirstChoice;
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

/// Views with their order, and what was given up on the way to them.
struct OrderedViews<'a> {
    chosen: ChosenViews,
    /// One for each setup; none without a cell.
    ordered: Vec<Ordered>,
    /// Candidates that were given up for want of a path.
    excluded: BTreeSet<CandidateIndex>,
    /// Area that each view is expected to add, and the rule that ended their choice; of further views alone.
    expected: Option<(Vec<f64>, DemandStop)>,
    /// The last problem on every sample that was looked at.
    every: Option<ViewPlanningProblem<'a>>,
}

/// Plans: every stage in turn.
///
/// # Errors
/// [`PlanError`]. Area that cannot be measured is not an error: it is counted, with its cause, in the outcome.
pub fn plan(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Outcome, PlanError> {
    let sampled = SampledPart::new(input, params, ctx)?;
    let setups = sampled.setups(input, ctx)?;
    let mut problem = problem(input, &sampled, &setups, ctx)?;
    let views = select_and_order(&mut problem, &sampled, &setups, None, ctx)?;
    finish(problem, &sampled, &setups, views, None, ctx)
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
    let sampled = SampledPart::demanded(input, &params, Some(demand), ctx)?;
    let setups = sampled.setups(input, ctx)?;
    let mut problem = problem(input, &sampled, &setups, ctx)?;
    let ExpectedViews { chosen, left_mm2, stopped_because, .. } = problem.select_expected(demand, &BTreeSet::new(), ctx)?;
    if chosen.candidates.is_empty() {
        return Ok(FurtherViews { outcome: None, expected_mm2: Vec::new(), left_mm2, stopped_because });
    }
    let mut views = select_and_order(&mut problem, &sampled, &setups, Some(demand), ctx)?;
    let expected = views.expected.take();
    let outcome = Some(finish(problem, &sampled, &setups, views, Some(demand), ctx)?);
    let (expected_mm2, stopped_because) = expected.unwrap_or((Vec::new(), stopped_because));
    Ok(FurtherViews { outcome, expected_mm2, left_mm2, stopped_because })
}

/// Stages after the views are chosen and ordered.
fn finish<'a>(
    problem: ViewPlanningProblem<'a>,
    sampled: &'a SampledPart,
    setups: &[Setup<'_>],
    views: OrderedViews<'a>,
    demand: Option<&Demand<'_>>,
    ctx: &Context<'_>,
) -> Result<Outcome, PlanError> {
    let (chosen, bound) = (views.chosen.candidates.len(), Arc::clone(&views.chosen.selection.bound));
    let explained = || {
        let outcome = explained(problem, sampled, setups, views, demand, ctx)?;
        ctx.begin(Stage::Bound)?;
        Ok::<_, PlanError>(outcome)
    };
    let (outcome, bound) = rayon::join(explained, || bound.compute(ctx));
    let mut outcome = outcome?;
    let counts_all = outcome.plan.executed_views() == chosen && outcome.plan.params.realism.count_at_risk;
    let of_asked = counts_all.then(|| outcome.plan.coverage.of_asked());
    outcome.plan.bound = bound?.beside(chosen).of_plan(of_asked);
    Ok(outcome)
}

/// Stages after the views are chosen and ordered, but for the bound, which lasts as long as they do and depends on none of them.
fn explained<'a>(
    problem: ViewPlanningProblem<'a>,
    sampled: &'a SampledPart,
    setups: &[Setup<'_>],
    views: OrderedViews<'a>,
    demand: Option<&Demand<'_>>,
    ctx: &Context<'_>,
) -> Result<Outcome, PlanError> {
    let input = problem.input;
    let (shortened, part) =
        rayon::join(|| shorten(problem, sampled, setups, views, ctx), || sampled.part_alone(input, setups, ctx));
    let ((views, problem), part) = (shortened?, part?);
    let mut outcome = explain(problem, sampled, setups, views, (&part, demand.is_some()), ctx)?;
    let asked_as = demand.map(|_| Arc::clone(&outcome.surface));
    certify(&mut outcome, (input, &sampled.params), setups, (&part, asked_as.as_ref()), ctx)?;
    let scene_of = |plan: &SetupPlan| Some(setup_of(setups, plan)?.scene.as_ref()?.collision_scene().clone());
    outcome.scenes = outcome.plan.setups.iter().filter_map(scene_of).collect();
    Ok(outcome)
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
    let sampled = SampledPart::new(input, params, ctx)?;
    let setups = sampled.setups(input, ctx)?;
    let EvaluatedSetups { on: SamplesToChooseOn { surface, asked_area_mm2, .. }, mut evaluated, .. } =
        sampled.evaluate(input, &setups, ctx)?;
    evaluated.drop_unusable();
    Ok(Tabulated { surface, asked_area_mm2, candidates: evaluated.candidates, rows: evaluated.matrix.rows })
}

/// Stages candidates, stations and visibility, in as many rounds as the strategies take.
fn problem<'a>(
    input: &'a PlanInput<'a>,
    sampled: &'a SampledPart,
    setups: &[Setup<'_>],
    ctx: &Context<'_>,
) -> Result<ViewPlanningProblem<'a>, PlanError> {
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

/// Chosen views, and the last problem on every sample that was looked at.
type ChosenOnEvery<'a> = (ChosenViews, Option<ViewPlanningProblem<'a>>);

/// Chooses views that meet their goals on every sample: among candidates beside a first choice too, unless fewer are chosen without;
/// or, without a closer look, once more where greedy's views have better grades once they are slid.
fn choose<'a>(
    problem: &mut ViewPlanningProblem<'a>,
    sampled: &'a SampledPart,
    setups: &[Setup<'_>],
    (excluded, looks_closer): (&BTreeSet<CandidateIndex>, bool),
    ctx: &Context<'_>,
) -> Result<ChosenOnEvery<'a>, PlanError> {
    if !(looks_closer && adjust::looks_closer(problem)) {
        return settle(problem, (sampled, setups), (None, true), excluded, ctx);
    }
    let at_first = problem.strata.is_some().then(|| problem.clone());
    let first = problem.look_beside_first_choice(sampled, setups, excluded, ctx)?;
    let views_at_first = first.rows.len();
    let chosen = settle(problem, (sampled, setups), (Some(first), false), excluded, ctx)?;
    // Views that join several setups come on top.
    let takes_more = setups.len() == 1 && chosen.0.candidates.len() > views_at_first;
    let Some(mut once) = at_first.filter(|_| takes_more) else { return Ok(chosen) };
    let at_once = settle(&mut once, (sampled, setups), (None, false), excluded, ctx)?;
    if at_once.0.candidates.len() >= chosen.0.candidates.len() {
        return Ok(chosen);
    }
    *problem = once;
    Ok(at_once)
}

/// Selects views, joins and slides them, and selects anew while every sample and those that views are chosen on disagree: beside
/// `first`, or, where `regrades` is true, beside greedy's views as soon as these have better grades once they are slid.
fn settle<'a>(
    problem: &mut ViewPlanningProblem<'a>,
    (sampled, setups): (&'a SampledPart, &[Setup<'_>]),
    (mut first, regrades): (Option<FirstChoice>, bool),
    excluded: &BTreeSet<CandidateIndex>,
    ctx: &Context<'_>,
) -> Result<ChosenOnEvery<'a>, PlanError> {
    let mut every = None;
    loop {
        let known = problem.known();
        let mut chosen = problem.select(excluded, first.as_ref(), ctx)?;
        if chosen.candidates.is_empty() {
            return Ok((chosen, every));
        }
        chosen = adjust::join_setups(problem, chosen, excluded, ctx)?;
        chosen = adjust::slide_views(problem, setups, chosen, excluded, ctx)?;
        if regrades && first.is_none() {
            first = adjust::better_graded_choice(problem, setups, &chosen.candidates, excluded, ctx)?;
            if first.is_some() {
                continue;
            }
        }
        let is_settled = chosen.selection.stopped_because != StopReason::Target || problem.tolerates_errors();
        if is_settled || problem.strata.is_none() {
            return Ok((chosen, every));
        }
        let of_chosen = problem.on_every_sample(sampled, setups, &problem.at_any_station(&chosen), every.take(), ctx)?;
        let of_chosen = every.insert(of_chosen);
        if of_chosen.meets_goals(&chosen.candidates, excluded) {
            return Ok((chosen, every));
        }
        let goes_on = problem.chosen_on.refinements < MAX_REFINEMENTS;
        if !goes_on || !problem.refine(of_chosen, setups, &chosen, ctx)? {
            return Ok((problem.topped_up(of_chosen, chosen, excluded, ctx)?, every));
        }
        problem.forget_from(known);
    }
}

/// Stages selection, with the chosen views slid, and sequence, setup by setup: a chosen view to which no path is found is
/// excluded and selection runs again, a bounded number of times.
fn select_and_order<'a>(
    problem: &mut ViewPlanningProblem<'a>,
    sampled: &'a SampledPart,
    setups: &[Setup<'_>],
    demand: Option<&Demand<'_>>,
    ctx: &Context<'_>,
) -> Result<OrderedViews<'a>, PlanError> {
    let mut excluded = BTreeSet::new();
    let (mut reselections, mut every) = (0, None);
    let known = problem.known();
    loop {
        ctx.begin(Stage::Selection)?;
        let (chosen, expected) = match demand {
            Some(demand) => {
                let views = problem.select_expected(demand, &excluded, ctx)?;
                (views.chosen, Some((views.expected_mm2, views.stopped_because)))
            }
            None => {
                let (chosen, of_chosen) = choose(problem, sampled, setups, (&excluded, reselections == 0), ctx)?;
                every = of_chosen;
                (chosen, None)
            }
        };
        if chosen.candidates.is_empty() && excluded.is_empty() {
            let in_the_way = obstructions(problem, setups, &BTreeSet::new(), ctx)?;
            return Err(PlanError::NoPlan(outcome::nothing_measured(problem, &setups[0].occluders, in_the_way, ctx)?));
        }
        let scenes: Vec<_> = scenes(setups).collect();
        if scenes.is_empty() {
            return Ok(OrderedViews { chosen, ordered: Vec::new(), excluded, expected, every });
        }
        ctx.begin(Stage::Sequence)?;
        let order = |(setup, scene): (SetupIndex, &&PlanningScene<'_>)| {
            let in_sight = |view, station: &Configuration| problem.is_in_sight(scene, chosen.candidate(view), station, ctx);
            scene.order(&problem.stations_of(&chosen, setup), reselections < MAX_RESELECTIONS, &in_sight, ctx)
        };
        let ordered: Vec<Ordered> = SetupIndex::number(&scenes).map(order).collect::<Result<_, _>>()?;
        let no_path: Vec<_> = ordered.iter().flat_map(|ordered| &ordered.no_path).copied().collect();
        if no_path.is_empty() && problem.params.selection.goal == SelectionGoal::MinTime {
            let mut is_permitted = |chosen: &ChosenViews| {
                if chosen.selection.stopped_because != StopReason::Target
                    || problem.strata.is_none()
                    || problem.tolerates_errors()
                {
                    return Ok(true);
                }
                let of_chosen = problem.on_every_sample(sampled, setups, &problem.at_any_station(chosen), every.take(), ctx)?;
                Ok(every.insert(of_chosen).meets_goals(&chosen.candidates, &excluded))
            };
            let known = (chosen, ordered);
            let (chosen, ordered) = adjust::exchange_views(problem, &scenes, known, &excluded, &mut is_permitted, ctx)?;
            return Ok(OrderedViews { chosen, ordered, excluded, expected, every });
        }
        if no_path.is_empty() || reselections == MAX_RESELECTIONS {
            return Ok(OrderedViews { chosen, ordered, excluded, expected, every });
        }
        // Views beside one without a path mostly have none either: they are not looked for again.
        excluded.extend(chosen.candidates_of(&no_path).filter_map(|candidate| problem.original_of(candidate, known)));
        problem.forget_from(known);
        reselections += 1;
    }
}

/// Bounds each setup's sequence, then rolls its views where that makes the moves shorter; returns the problem on every sample.
/// Rolls with which the views meet their goals on the samples that they were chosen on, but not on all, are taken back.
fn shorten<'a>(
    mut problem: ViewPlanningProblem<'a>,
    sampled: &'a SampledPart,
    setups: &[Setup<'_>],
    mut views: OrderedViews<'a>,
    ctx: &Context<'_>,
) -> Result<(OrderedViews<'a>, ViewPlanningProblem<'a>), PlanError> {
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
    let is_met = chosen.selection.stopped_because != StopReason::Target || every.meets_goals(&chosen.candidates, &views.excluded);
    if !is_met && problem.poses_of(chosen) != poses {
        problem.put_back(chosen, &poses);
        views.ordered = as_moved(in_order)?;
        every = problem.on_every_sample(sampled, setups, &problem.as_ordered(chosen, &views.ordered), Some(every), ctx)?;
    }
    Ok((views, every))
}

/// Stage missed: verdicts, coverage, and the causes and remedies of what is missed. `is_of_open` is true where asked is only what earlier
/// scans left open.
fn explain(
    problem: ViewPlanningProblem<'_>,
    sampled: &SampledPart,
    setups: &[Setup<'_>],
    views: OrderedViews<'_>,
    (part, is_of_open): (&Arc<RayScene>, bool),
    ctx: &Context<'_>,
) -> Result<Outcome, PlanError> {
    ctx.begin(Stage::Missed)?;
    let OrderedViews { chosen, ordered, excluded, .. } = views;
    let input = problem.input;
    let can_execute = |view: &Pose<Part, ScannerFrame>| can_execute(setups, view, ctx);
    let can_execute = input.cell.is_some().then_some(&can_execute as &CanExecute<'_>);
    let without_path = ordered.iter().flat_map(|ordered| chosen.candidates_of(&ordered.no_path));
    let obstructions = obstructions(&problem, setups, &without_path.chain(excluded.iter().copied()).collect(), ctx)?;
    let occluders = sampled.occluders(setups);
    let surroundings = Surroundings { sampled, setups, occluders, part, can_execute, is_of_open };
    let basis = Basis::of(&problem, &chosen, &ordered, &excluded, ctx)?;
    let mut outcome = outcome::assemble(problem, &chosen, ordered, &excluded, &surroundings, ctx)?;
    if let Some(basis) = basis {
        outcome.plan.advice = advice::of(&basis, &outcome, &AdviceScope { input, sampled, setups, part }, ctx)?;
    }
    if sampled.params.visibility.pixel_set {
        count_by_pixels(&mut outcome, input, occluders, ctx)?;
    }
    outcome.plan.obstructions = obstructions;
    add_clearances(&mut outcome, setups, ctx)?;
    Ok(outcome)
}

/// Stage certificate: coverage of the chosen views on a second set of samples, and with poses that are off. `asked_as` are the samples
/// that tell what is asked, where that is not what the regions say.
fn certify(
    outcome: &mut Outcome,
    (input, params): (&PlanInput<'_>, &PlanParams),
    setups: &[Setup<'_>],
    (part, asked_as): (&RayScene, Option<&Arc<Surface>>),
    ctx: &Context<'_>,
) -> Result<(), PlanError> {
    ctx.begin(Stage::Certificate)?;
    let plan = &mut outcome.plan;
    let views = |(id, plan_of_setup): (SetupId, &SetupPlan)| {
        let setup = setup_of(setups, plan_of_setup)?;
        Some(SetupViews::of(&setup.occluders, setup.scene.as_ref().map(PlanningScene::sight), &plan.views, id))
    };
    let views: Vec<_> = SetupId::number(&plan.setups).filter_map(views).collect();
    let standing: Vec<_> = setups.iter().filter(|setup| setup.scene.is_some()).map(|setup| setup.table_from_part).collect();
    let Certificate { independent, regions, robust } =
        certificate::certify((input, params), &views, (part, asked_as), &standing, ctx)?;
    (plan.coverage.independent, plan.coverage.robust) = (independent, robust);
    for (region, independent) in plan.coverage.regions.iter_mut().zip(regions) {
        region.independent = Some(independent).filter(|independent| independent.samples > 0);
    }
    Ok(())
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
