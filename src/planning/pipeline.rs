//! The one file that sees every stage: mesh, scanner and cell in, an [`Outcome`] out. Pure: no clock, no I/O; the same
//! input gives the same outcome on any number of threads. Call it inside the thread pool that it shall use.

use std::collections::BTreeSet;

use super::candidates::{self, Candidate, Scope};
use super::context::{Cancelled, Context, Stage};
use super::error::PlanError;
use super::input::PlanInput;
use super::min_time;
use super::missed;
use super::motion::Motion;
use super::obstructions::{self, BlockedCandidate, Obstruction};
use super::params::{Hemisphere, PlanParams, SelectionGoal};
use super::placement;
use super::plan::{Certificate, Outcome, SetupPlan};
use super::requirements;
use super::robust::{self, Setting};
use super::rolls;
use super::rounds::{Considered, Rounds};
use super::sequence::Ordered;
use super::setups::{self, Setup};
use super::study::{Chosen, Study, asked_area_mm2};
use super::surface::{self, Surface};
use super::visibility::{self, Row};
use crate::cell::{DeviceName, PoseSpec};
use crate::geometry::{Mesh, Part, Pose, ScannerFrame, Table};

/// How often views without a path are given up for others; what then remains without one carries it as a rejection.
const MAX_RESELECTIONS: usize = 4;

/// Plans.
///
/// # Errors
/// [`PlanError`]. Area that cannot be measured is no error: it is counted, with its cause, in the outcome.
pub fn plan(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Outcome, PlanError> {
    let prepared = Prepared::new(input, params, ctx)?;
    let setups = prepared.setups(input, ctx)?;
    let Tables { considered, robust_rows } = prepared.tables(input, &setups, ctx)?;
    let Considered { generated, table, reach } = considered;
    let poses = setups.iter().map(|setup| setup.table_from_part).collect();
    let Prepared { params, surface, asked_area_mm2, .. } = &prepared;
    let (surface, asked_area_mm2) = (surface.clone(), asked_area_mm2.clone());
    let mut study = Study { input, params, surface, setups: poses, generated, table, robust_rows, reach, asked_area_mm2 };
    let (chosen, ordered, barred) = choose(&study, &setups, ctx)?;
    let motions = setups.iter().filter_map(|setup| setup.motion.as_ref());
    let ordered = motions.zip(ordered).map(|(motion, ordered)| motion.bounded(ordered, ctx)).collect::<Result<_, _>>()?;
    let ordered = rolls::improve(&mut study, &setups, &chosen, ordered, ctx)?;
    ctx.begin(Stage::Missed)?;
    let takes = |view: &Pose<Part, ScannerFrame>| takes(&setups, view, ctx);
    let takes = input.cell.is_some().then_some(&takes as &missed::Takes<'_>);
    let without_path = ordered.iter().flat_map(|ordered| study.candidates_behind(&chosen, &ordered.no_path));
    let obstructions = obstructions(&study, &setups, &without_path.chain(barred.iter().copied()).collect(), ctx)?;
    let mut outcome = study.conclude(&chosen, ordered, &barred, prepared.hides(&setups), takes, ctx)?;
    if params.visibility.pixel_set {
        count_by_pixels(&mut outcome, input, prepared.hides(&setups), ctx)?;
    }
    outcome.plan.obstructions = obstructions;
    add_clearances(&mut outcome, &setups);
    ctx.begin(Stage::Certificate)?;
    let used = |lies: &SetupPlan| used(&setups, lies);
    let settings: Vec<_> = (0..outcome.plan.setups.len())
        .filter_map(|number| Some(Setting::of(&used(&outcome.plan.setups[number])?.occluders, &outcome.plan.views, number)))
        .collect();
    let Certificate { independent, robust } = robust::certify(input, params, &settings, ctx)?;
    (outcome.plan.coverage.independent, outcome.plan.coverage.robust) = (independent, robust);
    Ok(outcome)
}

/// The setup that a plan's is.
fn used<'s, 'a>(setups: &'s [Setup<'a>], lies: &SetupPlan) -> Option<&'s Setup<'a>> {
    setups.iter().find(|setup| setup.table_from_part == lies.table_from_part)
}

/// What keeps the cell from candidates; `without_path` are those kept that were given up.
fn obstructions(
    study: &Study<'_>,
    setups: &[Setup<'_>],
    without_path: &BTreeSet<usize>,
    ctx: &Context<'_>,
) -> Result<Vec<Obstruction>, Cancelled> {
    let blocked = |(candidate, stations)| {
        let candidate: &Candidate = candidate;
        Some(BlockedCandidate { motion: setups[candidate.setup].motion.as_ref()?, candidate, stations })
    };
    let blocked: Vec<_> = study.obstructed(without_path).into_iter().filter_map(blocked).collect();
    obstructions::explain(&blocked, ctx)
}

/// Adds to each station how near anything comes there.
fn add_clearances(outcome: &mut Outcome, setups: &[Setup<'_>]) {
    let lies = &outcome.plan.setups;
    for view in &mut outcome.plan.views {
        let motion = lies.get(view.setup).and_then(|lies| used(setups, lies)?.motion.as_ref());
        if let (Some(motion), Some(station), Some(stance)) = (motion, &view.station, &mut view.stance) {
            stance.clearance_mm = motion.clearance_mm(station);
        }
    }
}

/// Whether the cell can take a view in one of the setups.
fn takes(setups: &[Setup<'_>], view: &Pose<Part, ScannerFrame>, ctx: &Context<'_>) -> Result<bool, Cancelled> {
    for motion in setups.iter().filter_map(|setup| setup.motion.as_ref()) {
        if motion.takes(view, ctx)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// What the views of a plan are chosen from, for studies of candidates and solvers.
#[derive(Clone, Debug)]
pub struct Tabulated {
    /// The samples.
    pub surface: Surface,
    /// Area of each sample, 0 where it is not asked for.
    pub asked_area_mm2: Vec<f64>,
    /// The candidates that may be chosen.
    pub candidates: Vec<Candidate>,
    /// What each of them measures.
    pub rows: Vec<Row>,
}

/// [`plan()`] up to where views are chosen.
///
/// # Errors
/// [`PlanError`].
pub fn tabulate(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Tabulated, PlanError> {
    let prepared = Prepared::new(input, params, ctx)?;
    let setups = prepared.setups(input, ctx)?;
    let mut considered = prepared.tables(input, &setups, ctx)?.considered;
    considered.drop_unusable();
    let Prepared { surface, asked_area_mm2, .. } = prepared;
    Ok(Tabulated { surface, asked_area_mm2, candidates: considered.generated.kept, rows: considered.table.rows })
}

/// A part in samples, before it is known how it lies.
struct Prepared {
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
    considered: Considered,
    /// What views are chosen by where they shall bear errors, see [`robust::rows`].
    robust_rows: Option<Vec<Row>>,
}

impl Prepared {
    fn new(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Self, PlanError> {
        params.check().map_err(PlanError::BadParams)?;
        let mut params = resolve(params, input);
        ctx.begin(Stage::Surface)?;
        let surface = requirements::sampled(input.mesh, &params, params.seed).map_err(PlanError::BadParams)?;
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
            let motion = input.cell.map(|cell| Motion::new(cell, input, &self.params, table_from_part)).transpose()?;
            Ok(Setup { table_from_part, occluders, motion })
        };
        poses.map(setup).collect()
    }

    /// Every candidate with what it measures, the setups' candidates one after another.
    fn tables(&self, input: &PlanInput<'_>, setups: &[Setup<'_>], ctx: &Context<'_>) -> Result<Tables, PlanError> {
        let mut tables = Tables { considered: Considered::none_of(&self.surface, input.cell.is_some()), robust_rows: None };
        for (number, setup) in setups.iter().enumerate() {
            let scope = scope(input, &self.surface, setup.table_from_part, self.params.seed);
            let (params, occluders, motion) = (&self.params, &setup.occluders, setup.motion.as_ref());
            let rounds = Rounds { scope, params, occluders, motion, asked_area_mm2: &self.asked_area_mm2 };
            let considered = rounds.run(ctx)?.in_setup(number);
            let scene = robust::Scene { surface: &self.surface, scanner: input.scanner, occluders, params };
            if let Some(rows) = robust::rows(&scene, &considered, ctx)? {
                tables.robust_rows.get_or_insert_default().extend(rows);
            }
            tables.considered.append(considered);
        }
        Ok(tables)
    }

    /// What hides samples from views of any setup: with several, the part alone. A plate hides nothing from above it.
    fn hides<'a>(&'a self, setups: &'a [Setup<'_>]) -> &'a visibility::Occluders {
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

/// Selection and sequence, setup by setup: a chosen view to which no path is found is barred and selection runs again, a
/// bounded number of times.
fn choose(
    study: &Study<'_>,
    setups: &[Setup<'_>],
    ctx: &Context<'_>,
) -> Result<(Chosen, Vec<Ordered>, BTreeSet<usize>), PlanError> {
    let mut barred = BTreeSet::new();
    let mut reselections = 0;
    loop {
        ctx.begin(Stage::Selection)?;
        let chosen = study.select(&barred, ctx)?;
        let motions: Vec<_> = setups.iter().filter_map(|setup| setup.motion.as_ref()).collect();
        if motions.is_empty() {
            return Ok((chosen, Vec::new(), barred));
        }
        ctx.begin(Stage::Sequence)?;
        let order = |(setup, motion): (usize, &&Motion<'_>)| {
            motion.order(&study.stations_of(&chosen, setup), reselections < MAX_RESELECTIONS, ctx)
        };
        let ordered: Vec<Ordered> = motions.iter().enumerate().map(order).collect::<Result<_, _>>()?;
        let no_path: Vec<_> = ordered.iter().flat_map(|ordered| &ordered.no_path).copied().collect();
        if no_path.is_empty() && study.params.selection.goal == SelectionGoal::MinTime {
            let (chosen, ordered) = min_time::improve(study, &motions, (chosen, ordered), &barred, ctx)?;
            return Ok((chosen, ordered, barred));
        }
        if no_path.is_empty() || reselections == MAX_RESELECTIONS {
            return Ok((chosen, ordered, barred));
        }
        barred.extend(study.candidates_behind(&chosen, &no_path));
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
