//! A second opinion on a plan: the area that views measure, from the part alone and by the reference engine, from whatever
//! poses a program really scans at.

use crate::geometry::{Part, Pose, ScannerFrame, Table};
use crate::planning::context::{Context, PlanError};
use crate::planning::estimate::Estimate;
use crate::planning::params::{Engine, PlanParams};
use crate::planning::scene::{PlanInput, plate};
use crate::planning::selection::coverable_mm2;
use crate::planning::surface::{check_asked, requirements};
use crate::planning::visibility::{self, Occluders};

/// Areas that views measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// All that is asked for.
    pub asked_mm2: f64,
    /// Asked area that at least one of the views measures.
    pub measured_mm2: f64,
}

/// Evaluates `views` of the part as it lies; `params` as a plan states them, its samples those of the plan. Every sample
/// is joined with every device by a ray: about a second for ten views of a hundred thousand samples.
///
/// # Errors
/// Parameters out of range, or nothing asked for; more than the context allows; [`PlanError::Cancelled`].
pub fn measured(
    input: &PlanInput<'_>,
    params: &PlanParams,
    table_from_part: &Pose<Table, Part>,
    views: &[Pose<Part, ScannerFrame>],
    ctx: &Context<'_>,
) -> Result<Measured, PlanError> {
    params.check()?;
    params.check_limits(input.scanner)?;
    Estimate::of(input, params, rayon::current_num_threads()).check(ctx.allowance())?;
    let mut params = params.clone();
    params.visibility.engine = Engine::Rays;
    let surface = requirements::sampled(input.mesh, &params, params.seed, ctx)?;
    let asked_area_mm2 = surface.asked_area_mm2();
    check_asked(&asked_area_mm2)?;
    let plate = input.cell.map(|cell| plate(cell, table_from_part));
    let occluders = Occluders::interruptible([input.mesh].into_iter().chain(input.fixture).chain(&plate), ctx)?;
    let usable = vec![true; views.len()];
    let table = visibility::cast(&surface, views, &usable, input.scanner, &occluders, &params, ctx)?;
    let rows: Vec<_> = table.rows.iter().collect();
    Ok(Measured { asked_mm2: asked_area_mm2.iter().sum(), measured_mm2: coverable_mm2(&rows, &asked_area_mm2) })
}
