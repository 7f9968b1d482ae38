//! The one file that sees every stage: mesh, scanner and cell in, an [`Outcome`] out. Pure: no clock, no I/O; the same
//! input gives the same outcome on any number of threads. Call it inside the thread pool that it shall use.

use std::collections::BTreeSet;

use super::candidates::Scope;
use super::context::{Context, Stage};
use super::error::PlanError;
use super::input::PlanInput;
use super::motion::Motion;
use super::params::{Hemisphere, PlanParams};
use super::placement;
use super::plan::{Certificate, Outcome};
use super::robust::{self, Setting};
use super::rounds::{Considered, Rounds, is_usable};
use super::sequence::Ordered;
use super::study::{Chosen, Study, asked_area_mm2};
use super::surface;
use super::visibility;
use crate::cell::{DeviceName, PoseSpec};
use crate::geometry::{Mesh, Part, Pose, Table};

/// How often views without a path are given up for others; what then remains without one carries it as a rejection.
const MOST_RESELECTIONS: usize = 4;

/// Plans.
///
/// # Errors
/// [`PlanError`]. Area that cannot be measured is no error: it is counted, with its cause, in the outcome.
pub fn plan(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Outcome, PlanError> {
    params.check().map_err(PlanError::BadParams)?;
    let params = resolve(params, input);
    ctx.begin(Stage::Surface)?;
    let surface = surface::sample(input.mesh, &params.part, &params.regions, params.seed).map_err(PlanError::BadParams)?;
    let asked_area_mm2 = asked_area_mm2(&surface)?;
    let table_from_part = params.part.table_from_part.unwrap_or_default().pose();
    let plate = input.cell.map(|cell| placement::plate(cell, &table_from_part));
    let occluders = visibility::Occluders::new([input.mesh].into_iter().chain(input.fixture).chain(&plate));
    input.cell.map_or(Ok(()), |cell| placement::check(cell, input, &table_from_part))?;

    let motion = input.cell.map(|cell| Motion::new(cell, input, &params, table_from_part)).transpose()?;
    let (part, scanner, cell, seed) = (input.mesh, input.scanner, input.cell, params.seed);
    let scope = Scope { part, surface: &surface, scanner, cell, table_from_part, seed };
    let rounds =
        Rounds { scope, params: &params, occluders: &occluders, motion: motion.as_ref(), asked_area_mm2: &asked_area_mm2 };
    let Considered { generated, table, reach } = rounds.run(ctx)?;

    let scene = robust::Scene { surface: &surface, scanner: input.scanner, occluders: &occluders, params: &params };
    let usable: Vec<bool> = (0..table.rows.len()).map(|kept| is_usable(reach.as_ref(), kept)).collect();
    let robust_rows = robust::rows(&scene, &generated.kept, &usable, &table.rows, ctx)?;
    let study =
        Study { input, params: &params, surface, table_from_part, generated, table, robust_rows, reach, asked_area_mm2 };
    let (chosen, ordered, barred) = choose(&study, motion.as_ref(), ctx)?;
    ctx.begin(Stage::Missed)?;
    let mut outcome = study.conclude(&chosen, ordered, &barred);
    if params.visibility.pixel_set {
        count_by_pixels(&mut outcome, input, &occluders, ctx)?;
    }
    ctx.begin(Stage::Certificate)?;
    let settings = [Setting::of(&occluders, &outcome.plan.views)];
    let Certificate { independent, robust } = robust::certify(input, &params, &settings, ctx)?;
    (outcome.plan.coverage.independent, outcome.plan.coverage.robust) = (independent, robust);
    Ok(outcome)
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
pub(super) fn resolve(params: &PlanParams, input: &PlanInput<'_>) -> PlanParams {
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
