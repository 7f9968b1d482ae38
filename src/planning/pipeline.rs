//! The one file that sees every stage: mesh, scanner and cell in, an [`Outcome`] out. Pure: no clock, no I/O; the same
//! input gives the same outcome on any number of threads. Call it inside the thread pool that it shall use.

use std::collections::BTreeSet;

use super::candidates::{self, Candidate, Scope};
use super::context::{Cancelled, Context, Stage};
use super::error::PlanError;
use super::estimate::Estimate;
use super::input::PlanInput;
use super::min_time;
use super::missed;
use super::obstructions::{self, BlockedCandidate, Obstruction};
use super::params::{Hemisphere, PlanParams, SelectionGoal};
use super::placement;
use super::plan::{Certificate, Outcome, SetupPlan};
use super::planning_scene::PlanningScene;
use super::requirements;
use super::robust::{self, SetupViews};
use super::rolls;
use super::rounds::{EvaluatedCandidates, Rounds};
use super::sequence::Ordered;
use super::setups::{self, Setup};
use super::surface::{self, Surface};
use super::view_planning_problem::{ChosenViews, ViewPlanningProblem, asked_area_mm2};
use super::visibility::{self, Row};
use crate::cell::{DeviceName, PoseSpec};
use crate::geometry::{Mesh, Part, Pose, ScannerFrame, Table};

/// Times that views without a path are exchanged for others at most; views without one after that carry it as a rejection.
const MAX_RESELECTIONS: usize = 4;

/// Plans.
///
/// # Errors
/// [`PlanError`]. Area that cannot be measured is no error: it is counted, with its cause, in the outcome.
pub fn plan(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Outcome, PlanError> {
    let sampled = SampledPart::new(input, params, ctx)?;
    let setups = sampled.setups(input, ctx)?;
    let Tables { evaluated, robust_rows } = sampled.tables(input, &setups, ctx)?;
    let EvaluatedCandidates { candidates, matrix, reach } = evaluated;
    let poses = setups.iter().map(|setup| setup.table_from_part).collect();
    let SampledPart { params, surface, asked_area_mm2, .. } = &sampled;
    let (surface, asked_area_mm2) = (surface.clone(), asked_area_mm2.clone());
    let mut problem =
        ViewPlanningProblem { input, params, surface, setups: poses, candidates, matrix, robust_rows, reach, asked_area_mm2 };
    let (chosen, ordered, excluded) = choose(&problem, &setups, ctx)?;
    let scenes = setups.iter().filter_map(|setup| setup.scene.as_ref());
    let ordered = scenes.zip(ordered).map(|(scene, ordered)| scene.bounded(ordered, ctx)).collect::<Result<_, _>>()?;
    let ordered = rolls::improve(&mut problem, &setups, &chosen, ordered, ctx)?;
    ctx.begin(Stage::Missed)?;
    let can_execute = |view: &Pose<Part, ScannerFrame>| can_execute(&setups, view, ctx);
    let can_execute = input.cell.is_some().then_some(&can_execute as &missed::CanExecute<'_>);
    let without_path = ordered.iter().flat_map(|ordered| problem.candidates_behind(&chosen, &ordered.no_path));
    let obstructions = obstructions(&problem, &setups, &without_path.chain(excluded.iter().copied()).collect(), ctx)?;
    let mut outcome = problem.assemble_outcome(&chosen, ordered, &excluded, sampled.occluders(&setups), can_execute, ctx)?;
    if params.visibility.pixel_set {
        count_by_pixels(&mut outcome, input, sampled.occluders(&setups), ctx)?;
    }
    outcome.plan.obstructions = obstructions;
    add_clearances(&mut outcome, &setups);
    ctx.begin(Stage::Certificate)?;
    let setup_of = |plan: &SetupPlan| setup_of(&setups, plan);
    let setup_views: Vec<_> = (0..outcome.plan.setups.len())
        .filter_map(|number| {
            Some(SetupViews::of(&setup_of(&outcome.plan.setups[number])?.occluders, &outcome.plan.views, number))
        })
        .collect();
    let Certificate { independent, robust } = robust::certify(input, params, &setup_views, ctx)?;
    (outcome.plan.coverage.independent, outcome.plan.coverage.robust) = (independent, robust);
    Ok(outcome)
}

/// The setup that a plan's is.
fn setup_of<'s, 'a>(setups: &'s [Setup<'a>], plan: &SetupPlan) -> Option<&'s Setup<'a>> {
    setups.iter().find(|setup| setup.table_from_part == plan.table_from_part)
}

/// Finds the bodies that keep the cell from candidates; `without_path` are kept candidates that were excluded.
fn obstructions(
    problem: &ViewPlanningProblem<'_>,
    setups: &[Setup<'_>],
    without_path: &BTreeSet<usize>,
    ctx: &Context<'_>,
) -> Result<Vec<Obstruction>, Cancelled> {
    let blocked = |(candidate, stations)| {
        let candidate: &Candidate = candidate;
        Some(BlockedCandidate { scene: setups[candidate.setup].scene.as_ref()?, candidate, stations })
    };
    let blocked: Vec<_> = problem.obstructed(without_path).into_iter().filter_map(blocked).collect();
    obstructions::explain(&blocked, ctx)
}

/// Adds to each station how near anything comes there.
fn add_clearances(outcome: &mut Outcome, setups: &[Setup<'_>]) {
    let plans = &outcome.plan.setups;
    for view in &mut outcome.plan.views {
        let scene = plans.get(view.setup).and_then(|plan| setup_of(setups, plan)?.scene.as_ref());
        if let (Some(scene), Some(station), Some(stance)) = (scene, &view.station, &mut view.stance) {
            stance.clearance_mm = scene.clearance_mm(station);
        }
    }
}

/// Returns true if the cell can take a view in one of the setups.
fn can_execute(setups: &[Setup<'_>], view: &Pose<Part, ScannerFrame>, ctx: &Context<'_>) -> Result<bool, Cancelled> {
    for scene in setups.iter().filter_map(|setup| setup.scene.as_ref()) {
        if scene.can_execute(view, ctx)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Visibility matrix that the views of a plan are chosen from, for studies of candidates and solvers.
#[derive(Clone, Debug)]
pub struct Tabulated {
    /// The samples.
    pub surface: Surface,
    /// Area of each sample, 0 where it is not asked for.
    pub asked_area_mm2: Vec<f64>,
    /// The candidates that may be chosen.
    pub candidates: Vec<Candidate>,
    /// Samples that each of them measures.
    pub rows: Vec<Row>,
}

/// [`plan()`] up to where views are chosen.
///
/// # Errors
/// [`PlanError`].
pub fn tabulate(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Tabulated, PlanError> {
    let sampled = SampledPart::new(input, params, ctx)?;
    let setups = sampled.setups(input, ctx)?;
    let mut evaluated = sampled.tables(input, &setups, ctx)?.evaluated;
    evaluated.drop_unusable();
    let SampledPart { surface, asked_area_mm2, .. } = sampled;
    Ok(Tabulated { surface, asked_area_mm2, candidates: evaluated.candidates.kept, rows: evaluated.matrix.rows })
}

/// A part in samples, before it is known how it lies.
struct SampledPart {
    /// Defaults resolved.
    params: PlanParams,
    surface: Surface,
    /// Area of each sample, 0 where it is not asked for.
    asked_area_mm2: Vec<f64>,
    /// The part without a plate; with several setups, since none of their plates stands in all.
    alone: Option<visibility::Occluders>,
}

/// The candidates of all setups.
struct Tables {
    evaluated: EvaluatedCandidates,
    /// Rows that views are chosen by where they shall bear errors, see [`robust::rows`].
    robust_rows: Option<Vec<Row>>,
}

impl SampledPart {
    fn new(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Self, PlanError> {
        params.check().map_err(PlanError::BadParams)?;
        ctx.check()?;
        Estimate::of(input, params, rayon::current_num_threads()).check(ctx.allowance())?;
        let mut params = resolve(params, input);
        ctx.begin(Stage::Surface)?;
        let surface = requirements::sampled(input.mesh, &params, params.seed, ctx)?;
        let asked_area_mm2 = asked_area_mm2(&surface)?;
        let table_from_part = params.part.table_from_part.unwrap_or_default().pose();
        params.candidates = candidates::resolve(&scope(input, &surface, table_from_part, params.seed), &params.candidates);
        let alone = (params.setups > 1).then(|| visibility::Occluders::interruptible([input.mesh], ctx)).transpose()?;
        Ok(Self { params, surface, asked_area_mm2, alone })
    }

    fn setups<'a>(&'a self, input: &PlanInput<'a>, ctx: &Context<'_>) -> Result<Vec<Setup<'a>>, PlanError> {
        let poses = setups::poses(input, &self.params, ctx)?.into_iter();
        let setup = |table_from_part| {
            let plate = input.cell.map(|cell| placement::plate(cell, &table_from_part));
            let occluders = [input.mesh].into_iter().chain(input.fixture).chain(&plate);
            let occluders = visibility::Occluders::interruptible(occluders, ctx)?;
            input.cell.map_or(Ok(()), |cell| placement::check(cell, input, &table_from_part))?;
            let scene = input.cell.map(|cell| PlanningScene::new(cell, input, &self.params, table_from_part)).transpose()?;
            Ok(Setup { table_from_part, occluders, scene })
        };
        poses.map(setup).collect()
    }

    /// Every candidate with what it measures, the setups' candidates one after another.
    fn tables(&self, input: &PlanInput<'_>, setups: &[Setup<'_>], ctx: &Context<'_>) -> Result<Tables, PlanError> {
        let mut tables =
            Tables { evaluated: EvaluatedCandidates::none_of(&self.surface, input.cell.is_some()), robust_rows: None };
        for (number, setup) in setups.iter().enumerate() {
            let scope = scope(input, &self.surface, setup.table_from_part, self.params.seed);
            let (params, occluders, scene) = (&self.params, &setup.occluders, setup.scene.as_ref());
            let rounds = Rounds { scope, params, occluders, scene, asked_area_mm2: &self.asked_area_mm2 };
            let evaluated = rounds.run(ctx)?.in_setup(number);
            let scene = robust::VisibilityInput { surface: &self.surface, scanner: input.scanner, occluders, params };
            if let Some(rows) = robust::rows(&scene, &evaluated, ctx)? {
                tables.robust_rows.get_or_insert_default().extend(rows);
            }
            tables.evaluated.append(evaluated);
        }
        Ok(tables)
    }

    /// Occluders of views of any setup: with several, the part alone. A plate hides nothing from above it.
    fn occluders<'a>(&'a self, setups: &'a [Setup<'_>]) -> &'a visibility::Occluders {
        self.alone.as_ref().filter(|_| setups.len() > 1).unwrap_or(&setups[0].occluders)
    }
}

fn scope<'a>(input: &PlanInput<'a>, surface: &'a Surface, table_from_part: Pose<Table, Part>, seed: u64) -> Scope<'a> {
    Scope { part: input.mesh, surface, scanner: input.scanner, cell: input.cell, table_from_part, seed }
}

/// Adds the thesis's own answer: which triangles the views hit with pixels.
fn count_by_pixels(
    outcome: &mut Outcome,
    input: &PlanInput<'_>,
    occluders: &visibility::Occluders,
    ctx: &Context<'_>,
) -> Result<(), PlanError> {
    let views = outcome.plan.views.iter().filter(|view| view.rejected.is_none()).map(|view| &view.part_from_scanner);
    let hits = visibility::pixel_views(occluders, input.mesh.faces.len(), input.scanner, views, ctx)?;
    let area_mm2 = |(face, hits): (usize, &u32)| if *hits > 0 { input.mesh.face_area_mm2(face) } else { 0.0 };
    outcome.plan.coverage.pixel_set_area_mm2 = Some(hits.iter().enumerate().map(area_mm2).sum());
    outcome.pixel_views = Some(hits);
    Ok(())
}

/// Selection and sequence, setup by setup: a chosen view to which no path is found is excluded and selection runs again, a
/// bounded number of times.
fn choose(
    problem: &ViewPlanningProblem<'_>,
    setups: &[Setup<'_>],
    ctx: &Context<'_>,
) -> Result<(ChosenViews, Vec<Ordered>, BTreeSet<usize>), PlanError> {
    let mut excluded = BTreeSet::new();
    let mut reselections = 0;
    loop {
        ctx.begin(Stage::Selection)?;
        let chosen = problem.select(&excluded, ctx)?;
        let scenes: Vec<_> = setups.iter().filter_map(|setup| setup.scene.as_ref()).collect();
        if scenes.is_empty() {
            return Ok((chosen, Vec::new(), excluded));
        }
        ctx.begin(Stage::Sequence)?;
        let order = |(setup, scene): (usize, &&PlanningScene<'_>)| {
            scene.order(&problem.stations_of(&chosen, setup), reselections < MAX_RESELECTIONS, ctx)
        };
        let ordered: Vec<Ordered> = scenes.iter().enumerate().map(order).collect::<Result<_, _>>()?;
        let no_path: Vec<_> = ordered.iter().flat_map(|ordered| &ordered.no_path).copied().collect();
        if no_path.is_empty() && problem.params.selection.goal == SelectionGoal::MinTime {
            let (chosen, ordered) = min_time::improve(problem, &scenes, (chosen, ordered), &excluded, ctx)?;
            return Ok((chosen, ordered, excluded));
        }
        if no_path.is_empty() || reselections == MAX_RESELECTIONS {
            return Ok((chosen, ordered, excluded));
        }
        excluded.extend(problem.candidates_behind(&chosen, &no_path));
        reselections += 1;
    }
}

/// Part axes parallel to the table's, bottom of the bounding box on the plate, its centre on the axis
/// ([`crate::planning::method::frames`]).
#[must_use]
pub fn resting(mesh: &Mesh) -> Pose<Table, Part> {
    let aabb = mesh.aabb();
    let centre = aabb.centre();
    Pose::from_parts(-nalgebra::Vector3::new(centre.x, centre.y, aabb.min.z), nalgebra::UnitQuaternion::identity())
}

/// Fills in every default that depends on the part, the scanner or the presence of a cell.
fn resolve(params: &PlanParams, input: &PlanInput<'_>) -> PlanParams {
    let mut resolved = params.clone();
    resolved.part = surface::resolve(&params.part, input.mesh);
    resolved.part.table_from_part.get_or_insert_with(|| PoseSpec::from(&resting(input.mesh)));
    for device in &input.scanner.devices {
        let limit_deg = match device.name {
            DeviceName::Left | DeviceName::Right => &mut resolved.limits.camera_deg,
            DeviceName::Projector => &mut resolved.limits.projector_deg,
        };
        limit_deg.get_or_insert(device.incidence_max_rad.to_degrees());
    }
    let hemisphere = if input.cell.is_some() || params.setups > 1 { Hemisphere::AboveTable } else { Hemisphere::Full };
    resolved.candidates.hemisphere.get_or_insert(hemisphere);
    resolved
}
