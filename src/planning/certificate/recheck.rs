//! A second opinion on a plan: the area that views measure, from the part alone and by the reference engine or the plan's own,
//! from whatever poses a program really scans at.

use crate::geometry::{Part, Pose, ScannerFrame, Table};
use crate::planning::context::{Context, PlanError};
use crate::planning::params::{Engine, PlanParams};
use crate::planning::problem::estimate::Estimate;
use crate::planning::realism::{self, RiskInput, RiskView};
use crate::planning::scene::{PlanInput, plate};
use crate::planning::selection::coverable_mm2;
use crate::planning::sight::Sight;
use crate::planning::surface::{Surface, check_asked, requirements};
use crate::planning::visibility::{self, Occluders, Row};

/// Areas that views measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// All that is asked for.
    pub asked_mm2: f64,
    /// Asked area that at least one of the views measures.
    pub measured_mm2: f64,
}

/// A view as it is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TakenView {
    /// Pose of the scanner in the part frame.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Angle of the table, by which obstacles of the cell may hide what it looks at; `None` leaves them out.
    pub table_rad: Option<f64>,
}

/// Evaluates `views` of the part as it lies, whatever stands in the cell around it; see [`measured_in_cell`].
///
/// # Errors
/// The errors of [`measured_in_cell`].
pub fn measured(
    input: &PlanInput<'_>,
    params: &PlanParams,
    table_from_part: &Pose<Table, Part>,
    views: &[Pose<Part, ScannerFrame>],
    ctx: &Context<'_>,
) -> Result<Measured, PlanError> {
    let views: Vec<_> = views.iter().map(|view| TakenView { part_from_scanner: *view, table_rad: None }).collect();
    measured_in_cell(input, params, table_from_part, &views, ctx)
}

/// Samples of a plan, cut anew, and what views measure of them.
#[derive(Clone, Debug)]
pub struct Rechecked {
    /// The samples: those of the plan.
    pub surface: Surface,
    /// Area of each sample, 0 where it is not asked for.
    pub asked_area_mm2: Vec<f64>,
    /// Samples that each view measures.
    pub rows: Vec<Row>,
}

/// Evaluates `views` of the part as it lies, past the obstacles of the cell; `params` as a plan states them, its samples those of
/// the plan. Every sample is joined with every device by a ray: about a second for ten views of a hundred thousand samples.
///
/// # Errors
/// Parameters out of range, or nothing asked for; more than the context allows; [`PlanError::Cancelled`].
pub fn measured_in_cell(
    input: &PlanInput<'_>,
    params: &PlanParams,
    table_from_part: &Pose<Table, Part>,
    views: &[TakenView],
    ctx: &Context<'_>,
) -> Result<Measured, PlanError> {
    let Rechecked { asked_area_mm2, rows, .. } = recheck(input, params, table_from_part, views, ctx)?;
    let rows: Vec<_> = rows.iter().collect();
    Ok(Measured { asked_mm2: asked_area_mm2.iter().sum(), measured_mm2: coverable_mm2(&rows, &asked_area_mm2) })
}

/// Evaluates each of `views`, as [`measured_in_cell`] does all of them together.
///
/// # Errors
/// The errors of [`measured_in_cell`].
pub fn recheck(
    input: &PlanInput<'_>,
    params: &PlanParams,
    table_from_part: &Pose<Table, Part>,
    views: &[TakenView],
    ctx: &Context<'_>,
) -> Result<Rechecked, PlanError> {
    recheck_by(Engine::Rays, input, params, table_from_part, views, ctx)
}

/// Evaluates each of `views` as [`recheck`] does, by another engine. By the engine of a plan, `params.visibility.engine`, its own
/// views measure exactly what it states. The engines differ by what lies less than 0.003 mm before the plane of a facet, which `raster` passes over.
///
/// # Errors
/// The errors of [`measured_in_cell`].
pub fn recheck_by(
    engine: Engine,
    input: &PlanInput<'_>,
    params: &PlanParams,
    table_from_part: &Pose<Table, Part>,
    views: &[TakenView],
    ctx: &Context<'_>,
) -> Result<Rechecked, PlanError> {
    params.check_of_plan()?;
    params.check_limits(input.scanner)?;
    Estimate::of(input, params, rayon::current_num_threads()).check(ctx.allowance())?;
    let mut params = params.clone();
    params.visibility.engine = engine;
    let surface = requirements::sampled(input.mesh, &params, params.seed, ctx)?;
    let asked_area_mm2 = surface.asked_area_mm2();
    check_asked(&asked_area_mm2)?;
    let plate = input.cell.map(|cell| plate(cell, table_from_part));
    let occluders = Occluders::interruptible([input.mesh].into_iter().chain(input.fixture).chain(&plate), ctx)?;
    let (poses, usable): (Vec<_>, Vec<_>) = views.iter().map(|view| (view.part_from_scanner, true)).unzip();
    let mut rows = visibility::cast(&surface, &poses, &usable, input.scanner, &occluders, &params, ctx)?.rows;
    if let Some(cell) = input.cell {
        let sight = Sight::new(cell, &input.mesh.aabb(), table_from_part, ctx)?;
        for (row, view) in rows.iter_mut().zip(views) {
            let Some(table_rad) = view.table_rad else { continue };
            if let Some(hidden) = sight.hidden(&surface, &view.part_from_scanner, row.measured(), table_rad, ctx)? {
                *row = row.without(&hidden);
            }
        }
    }
    if !params.realism.count_at_risk {
        let surfaces = occluders.rays();
        let risk_view = |(view, row): (&TakenView, _)| RiskView { part_from_scanner: view.part_from_scanner, row, surfaces };
        let risk_views: Vec<RiskView<'_>> = views.iter().zip(&rows).map(risk_view).collect();
        let part = RiskInput { mesh: input.mesh, surface: &surface, scanner: input.scanner, params: &params };
        let left_out = realism::risks(&part, &risk_views, ctx)?.samples();
        rows = realism::without(rows, &left_out);
    }
    Ok(Rechecked { surface, asked_area_mm2, rows })
}
