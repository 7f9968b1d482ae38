//! The one file that sees every stage: mesh, scanner and cell in, an [`Outcome`] out. Pure: no clock, no I/O; the same
//! input gives the same outcome on any number of threads. Call it inside the thread pool that it shall use.

use std::collections::BTreeSet;

use super::candidates::{self, Candidate, Scope};
use super::context::{Cancelled, Context, Stage};
use super::demands;
use super::error::PlanError;
use super::input::PlanInput;
use super::missed;
use super::motion::Motion;
use super::params::{Hemisphere, PlanParams};
use super::placement;
use super::plan::{Certificate, Outcome};
use super::robust::{self, Setting};
use super::rounds::{Considered, Rounds};
use super::sequence::Ordered;
use super::study::{Chosen, Study, asked_area_mm2};
use super::surface::{self, Surface};
use super::visibility::{self, Row};
use crate::cell::{DeviceName, PoseSpec};
use crate::geometry::{Mesh, Part, Pose, Scanner as ScannerFrame, Table};

/// How often views without a path are given up for others; what then remains without one carries it as a rejection.
const MOST_RESELECTIONS: usize = 4;

/// Plans.
///
/// # Errors
/// [`PlanError`]. Area that cannot be measured is no error: it is counted, with its cause, in the outcome.
pub fn plan(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Outcome, PlanError> {
    let prepared = Prepared::new(input, params, ctx)?;
    let motion = motion(input, &prepared.params, prepared.table_from_part)?;
    let considered = prepared.considered(input, motion.as_ref(), ctx)?;
    let robust_rows = prepared.robust_rows(input, &considered, ctx)?;
    let Considered { generated, table, reach } = considered;
    let (params, table_from_part, occluders) = (&prepared.params, prepared.table_from_part, &prepared.occluders);
    let (surface, asked_area_mm2) = (prepared.surface, prepared.asked_area_mm2);
    let study = Study { input, params, surface, table_from_part, generated, table, robust_rows, reach, asked_area_mm2 };
    let (chosen, ordered, barred) = choose(&study, motion.as_ref(), ctx)?;
    ctx.begin(Stage::Missed)?;
    let takes = motion.as_ref().map(|motion| |view: &Pose<Part, ScannerFrame>| motion.takes(view, ctx));
    let takes = takes.as_ref().map(|takes| takes as &missed::Takes<'_>);
    let mut outcome = study.conclude(&chosen, ordered, &barred, occluders, takes, ctx)?;
    if params.visibility.pixel_set {
        count_by_pixels(&mut outcome, input, occluders, ctx)?;
    }
    ctx.begin(Stage::Certificate)?;
    let settings = [Setting::of(occluders, &outcome.plan.views)];
    let Certificate { independent, robust } = robust::certify(input, params, &settings, ctx)?;
    (outcome.plan.coverage.independent, outcome.plan.coverage.robust) = (independent, robust);
    Ok(outcome)
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
    let motion = motion(input, &prepared.params, prepared.table_from_part)?;
    let mut considered = prepared.considered(input, motion.as_ref(), ctx)?;
    considered.drop_unusable();
    let Prepared { surface, asked_area_mm2, .. } = prepared;
    Ok(Tabulated { surface, asked_area_mm2, candidates: considered.generated.kept, rows: considered.table.rows })
}

/// A part on its plate, in samples, with everything that hides one of them.
struct Prepared {
    /// Defaults resolved.
    params: PlanParams,
    surface: Surface,
    table_from_part: Pose<Table, Part>,
    occluders: visibility::Occluders,
    /// Area of each sample, 0 where it is not asked for.
    asked_area_mm2: Vec<f64>,
}

impl Prepared {
    fn new(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Self, PlanError> {
        params.check().map_err(PlanError::BadParams)?;
        let mut params = resolve(params, input);
        ctx.begin(Stage::Surface)?;
        let surface = demands::sampled(input.mesh, &params, params.seed).map_err(PlanError::BadParams)?;
        let asked_area_mm2 = asked_area_mm2(&surface)?;
        let table_from_part = params.part.table_from_part.unwrap_or_default().pose();
        let plate = input.cell.map(|cell| placement::plate(cell, &table_from_part));
        let occluders = visibility::Occluders::new([input.mesh].into_iter().chain(input.fixture).chain(&plate));
        input.cell.map_or(Ok(()), |cell| placement::check(cell, input, &table_from_part))?;
        params.candidates = candidates::resolve(&scope(input, &surface, table_from_part, params.seed), &params.candidates);
        Ok(Self { params, surface, table_from_part, occluders, asked_area_mm2 })
    }

    fn considered(&self, input: &PlanInput<'_>, motion: Option<&Motion<'_>>, ctx: &Context<'_>) -> Result<Considered, PlanError> {
        let scope = scope(input, &self.surface, self.table_from_part, self.params.seed);
        let (params, occluders, asked_area_mm2) = (&self.params, &self.occluders, &self.asked_area_mm2);
        Rounds { scope, params, occluders, motion, asked_area_mm2 }.run(ctx)
    }

    /// What views are chosen by where they shall bear errors, see [`robust::rows`].
    fn robust_rows(&self, input: &PlanInput<'_>, considered: &Considered, ctx: &Context<'_>) -> Result<Option<Vec<Row>>, Cancelled> {
        let (surface, params, occluders) = (&self.surface, &self.params, &self.occluders);
        robust::rows(&robust::Scene { surface, scanner: input.scanner, occluders, params }, considered, ctx)
    }
}

fn motion<'a>(
    input: &PlanInput<'a>,
    params: &'a PlanParams,
    table_from_part: Pose<Table, Part>,
) -> Result<Option<Motion<'a>>, PlanError> {
    input.cell.map(|cell| Motion::new(cell, input, params, table_from_part)).transpose()
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

/// Selection and sequence: a chosen view to which no path is found is barred and selection runs again, a bounded number
/// of times.
fn choose(
    study: &Study<'_>,
    motion: Option<&Motion<'_>>,
    ctx: &Context<'_>,
) -> Result<(Chosen, Option<Ordered>, BTreeSet<usize>), PlanError> {
    let mut barred = BTreeSet::new();
    let mut reselections = 0;
    loop {
        ctx.begin(Stage::Selection)?;
        let chosen = study.select(&barred, ctx)?;
        let Some(motion) = motion else { return Ok((chosen, None, barred)) };
        ctx.begin(Stage::Sequence)?;
        let ordered = motion.order(&study.stations_of(&chosen), ctx)?;
        if ordered.no_path.is_empty() || reselections == MOST_RESELECTIONS {
            return Ok((chosen, Some(ordered), barred));
        }
        barred.extend(study.candidates_behind(&chosen, &ordered.no_path));
        reselections += 1;
    }
}

/// Part axes parallel to the table's, bottom of the bounding box on the plate, its centre on the axis (method §1).
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
    let hemisphere = if input.cell.is_some() { Hemisphere::AboveTable } else { Hemisphere::Full };
    resolved.candidates.hemisphere.get_or_insert(hemisphere);
    resolved
}
