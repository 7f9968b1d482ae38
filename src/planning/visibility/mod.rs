//! Viewpoints to the table of what each measures (method §4). A sample is measured from a viewpoint iff for each device:
//! it projects inside the image, nothing lies between it and the optical centre, the incidence is within the limit; and
//! its depth is within the working depth. All at the same point.
//!
//! Every engine answers by this one definition; [`cast`] is the seam at which they are chosen.

mod raster;
mod rays;
#[cfg(test)]
mod tests;
mod view;

use rayon::prelude::*;

use super::cause::Cause;
use super::context::{Cancelled, Context};
use super::params::{Engine, PlanParams};
use super::surface::Surface;
use crate::cell::Scanner;
use crate::geometry::{Mesh, Part, Pose, RayScene, Scanner as ScannerFrame};

pub use view::Optics;

/// What one view measures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Samples measured, ascending.
    pub samples: Vec<u32>,
    /// c·Q_δ + d·Q_dis at each of them (method §5).
    pub quality: Vec<f32>,
}

/// What every view measures, and how far the others get. Rows are in the order of the views.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// One a view.
    pub rows: Vec<Row>,
    /// For each sample why it is not measured by the view that gets furthest, among those that do not measure it.
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
        let clusters = raster::Clusters::new(&meshes, &rays.leaf_order());
        Self { rays, clusters }
    }
}

/// Computes the table with the engine that `params` names.
///
/// # Errors
/// [`Cancelled`].
pub fn cast(
    surface: &Surface,
    views: &[Pose<Part, ScannerFrame>],
    scanner: &Scanner,
    occluders: &Occluders,
    params: &PlanParams,
    ctx: &Context<'_>,
) -> Result<Table, Cancelled> {
    let optics = Optics::new(scanner, params);
    match params.visibility.engine {
        Engine::Raster => raster::cast(surface, views, &optics, occluders, ctx),
        Engine::Rays => rays::cast(surface, views, &optics, &occluders.rays, ctx),
    }
}

/// Rebuilds the rows from blocks of samples: block-major pieces to view-major rows, in sample order.
fn assemble(views: usize, blocks: Vec<(Vec<Row>, Vec<Cause>)>) -> Table {
    let rows = (0..views)
        .into_par_iter()
        .map(|view| {
            let mut row = Row::default();
            for (pieces, _) in &blocks {
                row.samples.extend(&pieces[view].samples);
                row.quality.extend(&pieces[view].quality);
            }
            row
        })
        .collect();
    Table { rows, furthest: blocks.into_iter().flat_map(|(_, furthest)| furthest).collect() }
}
