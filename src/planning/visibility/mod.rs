//! Viewpoints to the table of what each measures (method §4). A sample is measured from a viewpoint iff for each device:
//! it projects inside the image, nothing lies between it and the optical centre, the incidence is within the limit; and
//! its depth is within the working depth. All at the same point.
//!
//! Every engine answers by this one definition; [`cast`] is the seam at which they are chosen.

mod raster;
mod rays;
mod row;
mod sample_set;
#[cfg(test)]
mod tests;
mod view;

use super::cause::Cause;
use super::context::{Cancelled, Context};
use super::params::{Engine, Objective, PlanParams};
use super::surface::Surface;
use crate::cell::Scanner;
use crate::geometry::{Mesh, Part, Pose, RayScene, Scanner as ScannerFrame};

pub(super) use rays::Probe;
pub use row::{QualityScale, Row};
pub use sample_set::SampleSet;
pub(super) use sample_set::ones;
pub use view::Optics;

/// What every view measures, and how far the others get. Rows are in the order of the views.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// One a view.
    pub rows: Vec<Row>,
    /// For each sample that no view measures, why the view that gets furthest does not; for others any cause.
    pub furthest: Vec<Cause>,
}

/// Everything that may lie between a sample and a device, ready for every engine.
pub struct Occluders {
    rays: RayScene,
    clusters: raster::Clusters,
}

impl Occluders {
    /// Of the part, and whatever stands around it, in one frame; the part comes first.
    #[must_use]
    pub fn new<'a>(meshes: impl IntoIterator<Item = &'a Mesh>) -> Self {
        let meshes: Vec<_> = meshes.into_iter().collect();
        let rays = RayScene::new(meshes.iter().copied());
        let clusters = raster::Clusters::new(&meshes);
        Self { rays, clusters }
    }

    /// As the reference engine asks it.
    pub(super) fn rays(&self) -> &RayScene {
        &self.rays
    }
}

/// For each triangle of `occluders`, the part's first, which devices hit it with at least one pixel of their images from
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
) -> Result<Table, Cancelled> {
    let (optics, kept_quality) = (Optics::new(scanner, params), kept_quality(params));
    match params.visibility.engine {
        Engine::Raster => raster::cast(surface, &raster::Views { poses: views, usable }, &optics, kept_quality, occluders, ctx),
        Engine::Rays => rays::cast(surface, views, &optics, kept_quality, &occluders.rays, ctx),
    }
}

/// The scale of the quality in a table's rows; `None` where nothing is chosen by quality: that of the few chosen views is
/// then computed by [`grade`].
fn kept_quality(params: &PlanParams) -> Option<QualityScale> {
    let wanted = params.selection.objective == Objective::Score && params.score.b > 0.0;
    wanted.then(|| QualityScale::of(&params.score))
}

/// `row`, which is what `pose` measures, with its quality: the one that a table keeps, computed where this one did not.
/// Cost: about 50 ns a measured sample.
#[must_use]
pub fn grade(surface: &Surface, pose: &Pose<Part, ScannerFrame>, scanner: &Scanner, params: &PlanParams, row: &Row) -> Row {
    if row.quality().is_some() {
        return row.clone();
    }
    let (optics, scale) = (Optics::new(scanner, params), QualityScale::of(&params.score));
    let view = optics.at(pose);
    let step = |sample: u32| {
        let sample = sample as usize;
        scale.quantise(view.quality_at(&surface.sample_mm[sample], &surface.patch_of(sample).normal))
    };
    row.clone().with_quality(row.samples().map(step).collect(), scale)
}
