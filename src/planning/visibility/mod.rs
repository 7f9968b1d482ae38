//! Viewpoints to the table of what each measures ([`crate::planning::method::visibility`]). A sample is measured from a
//! viewpoint iff for each device: it projects inside the image, nothing lies between it and the optical centre, the incidence
//! is within the limit; and its depth is within the working depth. All at the same point.
//!
//! Every engine answers by this one definition; [`cast`] is the seam at which they are chosen.

mod raster;
mod rays;
mod row;
mod sample_set;
#[cfg(test)]
mod tests;
mod united_views;
pub(super) mod view;

use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use rayon::prelude::*;

use super::context::{Cancelled, Context};
use super::ids::SampleId;
use super::params::{Engine, Objective, PlanParams};
use super::surface::Surface;
use super::verdict::Cause;
use crate::cell::Scanner;
use crate::geometry::{Mesh, Part, Pose, RayScene, ScannerFrame};

pub(super) use rays::Probe;
pub use rays::RAY_END_SHARE;
pub use row::{QualityScale, Row};
pub use sample_set::SampleSet;
pub(super) use sample_set::ones;
pub(super) use united_views::UnitedViews;
pub use view::{MeasuringPrecision, Optics, SightLine, View};

/// The visibility matrix: what every view measures, and how far the others get. Rows are in the order of the views.
#[derive(Clone, Debug, Default)]
pub struct VisibilityMatrix {
    /// Row of each view.
    pub rows: Vec<Row>,
    /// Cause of each sample that no view measures, of the view that gets furthest; for others any cause.
    pub furthest_cause: Vec<Cause>,
}

/// Everything that may lie between a sample and a device, ready for every engine.
pub struct Occluders {
    rays: Arc<RayScene>,
    clusters: raster::Clusters,
}

impl Occluders {
    /// Occluders of the part, and whatever stands around it, in one frame; the part comes first.
    #[must_use]
    pub fn new<'a>(meshes: impl IntoIterator<Item = &'a Mesh>) -> Self {
        let Ok(occluders) = Self::checked(meshes, || Ok::<(), Infallible>(()));
        occluders
    }

    /// [`Occluders::new`], given up when the job is cancelled.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn interruptible<'a>(meshes: impl IntoIterator<Item = &'a Mesh>, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        Self::checked(meshes, || ctx.check())
    }

    fn checked<'a, E: Send>(
        meshes: impl IntoIterator<Item = &'a Mesh>,
        check: impl Fn() -> Result<(), E> + Sync,
    ) -> Result<Self, E> {
        let meshes: Vec<_> = meshes.into_iter().collect();
        let rays = || RayScene::interruptible(meshes.iter().copied(), &check);
        let (rays, clusters) = rayon::join(rays, || raster::Clusters::new(&meshes, &check));
        Ok(Self { rays: Arc::new(rays?), clusters: clusters? })
    }

    /// Occluders of the part alone, of which `rays` is the scene.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(super) fn of_part(part: &Mesh, rays: Arc<RayScene>, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        Ok(Self { rays, clusters: raster::Clusters::new(&[part], &|| ctx.check())? })
    }

    /// The scene for single rays, to keep.
    pub(super) fn shared_rays(&self) -> Arc<RayScene> {
        Arc::clone(&self.rays)
    }

    /// The scene for single rays.
    #[must_use]
    pub fn rays(&self) -> &RayScene {
        &self.rays
    }
}

/// Computes for each triangle of `occluders`, the part's first, which devices hit it with at least one pixel of their images from
/// one viewpoint (the thesis's §3.2.1): bit 0 for the left camera, bit 1 for the right one, bit 2 for the projector.
/// Pixel rays pass the lens without distortion, whose only effect is on where the frame ends; limits of depth and
/// incidence do not enter. Cost: about 10 ms on two cores for a part of 70 000 triangles at 3 × 12 megapixels.
///
/// # Errors
/// [`Cancelled`].
pub fn pixel_set(
    occluders: &Occluders,
    scanner: &Scanner,
    view: &Pose<Part, ScannerFrame>,
    ctx: &Context<'_>,
) -> Result<Vec<u8>, Cancelled> {
    raster::pixel_set(&occluders.clusters, scanner, view, ctx)
}

/// Counts for each of the part's triangles by how many of `views` it is hit with at least one pixel of each device: the thesis's
/// own answer, see [`pixel_set`].
///
/// # Errors
/// [`Cancelled`].
pub fn pixel_views<'a>(
    occluders: &Occluders,
    triangles: usize,
    scanner: &Scanner,
    views: impl IntoIterator<Item = &'a Pose<Part, ScannerFrame>>,
    ctx: &Context<'_>,
) -> Result<Vec<u32>, Cancelled> {
    const ALL_DEVICES: u8 = 0b111;
    let mut hits = vec![0; triangles];
    for view in views {
        let devices = pixel_set(occluders, scanner, view, ctx)?;
        hits.iter_mut().zip(devices).for_each(|(hits, devices)| *hits += u32::from(devices == ALL_DEVICES));
    }
    Ok(hits)
}

/// Computes the table with the engine that `params` names. A view that is not `usable` cannot be chosen: an engine may
/// leave out of its row the samples that some usable view measures, which changes neither the choice, nor what is
/// coverable with and without reach, nor why anything is missed.
///
/// # Errors
/// [`Cancelled`].
pub fn cast(
    surface: &Surface,
    views: &[Pose<Part, ScannerFrame>],
    usable: &[bool],
    scanner: &Scanner,
    occluders: &Occluders,
    params: &PlanParams,
    ctx: &Context<'_>,
) -> Result<VisibilityMatrix, Cancelled> {
    let (optics, scale) = (Optics::new(scanner, params, &surface.requirements), quality_scale(params, surface));
    let hold = surface.requirements.any_requires_quality();
    // What some usable view measures is not yet known to be measured well.
    let all = vec![true; views.len()];
    let usable = if hold { &all } else { usable };
    let mut table = match params.visibility.engine {
        Engine::Raster => raster::cast(surface, &raster::Views { poses: views, usable }, &optics, scale, occluders, ctx)?,
        Engine::Rays => rays::cast(surface, views, &optics, scale, &occluders.rays, ctx)?,
    };
    if hold {
        apply_requirements(&mut table, surface, views, &optics, ctx)?;
    }
    Ok(table)
}

/// Takes out of the rows what is not measured as well as is asked.
fn apply_requirements(
    table: &mut VisibilityMatrix,
    surface: &Surface,
    views: &[Pose<Part, ScannerFrame>],
    optics: &Optics,
    ctx: &Context<'_>,
) -> Result<(), Cancelled> {
    let furthest: Vec<AtomicU8> = table.furthest_cause.iter().map(|cause| AtomicU8::new(*cause as u8)).collect();
    let held = table.rows.par_iter().zip(views).map(|(row, pose)| {
        ctx.check()?;
        let view = optics.at(pose);
        Ok(row.regraded(|sample, quality| {
            let (mm, normal) = (&surface.sample_mm[sample.index()], &surface.patch_of(sample).normal);
            let counted = view.counted_quality(mm, normal, quality, surface.requirements.kind(sample));
            counted.map_err(|cause| furthest[sample.index()].fetch_max(cause as u8, Ordering::Relaxed)).ok()
        }))
    });
    table.rows = held.collect::<Result<Vec<_>, Cancelled>>()?;
    table.furthest_cause = furthest.into_iter().map(|cause| Cause::ALL[usize::from(cause.into_inner())]).collect();
    Ok(())
}

/// The scale of the quality in a table's rows; `None` where nothing is chosen by quality: that of the few chosen views is
/// then computed by [`grade`].
fn quality_scale(params: &PlanParams, surface: &Surface) -> Option<QualityScale> {
    let chosen_by = params.selection.objective == Objective::Score && params.score.b > 0.0;
    let wanted = chosen_by || surface.requirements.any_requires_quality();
    wanted.then(|| QualityScale::of(&params.score))
}

/// `row`, which is what `pose` measures, with its quality: the one that a table keeps, computed where this one did not.
/// Cost: about 50 ns a measured sample.
#[must_use]
pub fn grade(surface: &Surface, pose: &Pose<Part, ScannerFrame>, scanner: &Scanner, params: &PlanParams, row: &Row) -> Row {
    if row.quality().is_some() {
        return row.clone();
    }
    let (optics, scale) = (Optics::new(scanner, params, &surface.requirements), QualityScale::of(&params.score));
    let view = optics.at(pose);
    let step =
        |sample: SampleId| scale.quantise(view.quality_at(&surface.sample_mm[sample.index()], &surface.patch_of(sample).normal));
    row.clone().with_quality(row.samples().map(step).collect(), scale)
}
