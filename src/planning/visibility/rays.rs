//! The reference engine: every sample that passes the cheap steps is joined with the three optical centres by any-hit
//! rays. Blocks of samples run in parallel; within a block every view is tried, so that the samples stay in cache.
//!
//! Cost: at most 3 rays a sample and view, about 1 µs each on a mesh of 10⁵ triangles.

use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::view::{Optics, SHADOWS, View};
use super::{Row, Table, assemble};
use crate::geometry::{Part, Pose, RayScene, Scanner as ScannerFrame};
use crate::planning::cause::Cause;
use crate::planning::context::{Cancelled, Context};
use crate::planning::surface::Surface;

/// Samples a block: about 5 ms of rays a view, the interval at which cancelling is noticed.
const BLOCK: usize = 2048;
/// Where a ray from the optical centre ends before the sample, as a share of its length: 3 µm at 480 mm, so that a
/// sample is not hidden by its own facet.
pub(super) const RAY_END_SHARE: f64 = 1.0 - 3e-3 / 480.0;

pub(super) fn cast(
    surface: &Surface,
    poses: &[Pose<Part, ScannerFrame>],
    optics: &Optics,
    scene: &RayScene,
    ctx: &Context<'_>,
) -> Result<Table, Cancelled> {
    let views: Vec<_> = poses.iter().map(|pose| optics.at(pose)).collect();
    let samples = surface.sample_mm.len();
    let done = AtomicUsize::new(0);
    let blocks = (0..samples)
        .into_par_iter()
        .step_by(BLOCK)
        .map(|first| {
            let block = cast_block(surface, &views, scene, first..(first + BLOCK).min(samples), ctx)?;
            ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, samples.div_ceil(BLOCK));
            Ok(block)
        })
        .collect::<Result<Vec<_>, Cancelled>>()?;
    Ok(assemble(views.len(), blocks))
}

fn cast_block(
    surface: &Surface,
    views: &[View<'_>],
    scene: &RayScene,
    samples: std::ops::Range<usize>,
    ctx: &Context<'_>,
) -> Result<(Vec<Row>, Vec<Cause>), Cancelled> {
    let mut furthest = vec![Cause::Facing; samples.len()];
    let mut rows = Vec::with_capacity(views.len());
    for view in views {
        ctx.check()?;
        let mut row = Row::default();
        for sample in samples.clone() {
            match measure(surface, view, scene, sample) {
                Ok(quality) => {
                    row.samples.push(sample as u32);
                    row.quality.push(quality);
                }
                Err(cause) => {
                    let furthest = &mut furthest[sample - samples.start];
                    *furthest = (*furthest).max(cause);
                }
            }
        }
        rows.push(row);
    }
    Ok((rows, furthest))
}

fn measure(surface: &Surface, view: &View<'_>, scene: &RayScene, sample: usize) -> Result<f32, Cause> {
    let p = &surface.sample_mm[sample];
    let quality = view.before_shadow(p, &surface.patch_of(sample).normal)?;
    for (centre, cause) in view.centres_mm.iter().zip(SHADOWS) {
        if scene.blocked(centre, p, RAY_END_SHARE) {
            return Err(cause);
        }
    }
    Ok(quality)
}
