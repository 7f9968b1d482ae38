//! The reference engine: every sample that passes the cheap steps is joined with the three optical centres by any-hit
//! rays. One view after the other; its samples run in parallel blocks, so that what is held besides the table is one row.
//!
//! Cost: at most 3 rays a sample and view, about 1 µs each on a mesh of 10⁵ triangles.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::VisibilityMatrix;
use super::row::{QualityScale, Row};
use super::view::{Optics, SHADOWS, View};
use crate::cell::PerDevice;
use crate::geometry::{Part, Pose, RayScene, ScannerFrame};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::surface::Surface;
use crate::planning::verdict::Cause;

/// Words of samples a block: 1024 samples, about 3 ms of rays, the interval at which cancelling is noticed.
const BLOCK_WORDS: usize = 16;
/// End of a ray from the optical centre before the sample, as a share of its length: 3 µm at 480 mm, so that a
/// sample is not hidden by its own facet.
pub const RAY_END_SHARE: f64 = 1.0 - 3e-3 / 480.0;

pub(super) fn cast(
    surface: &Surface,
    poses: &[Pose<Part, ScannerFrame>],
    optics: &Optics,
    quality_scale: Option<QualityScale>,
    scene: &RayScene,
    ctx: &Context<'_>,
) -> Result<VisibilityMatrix, Cancelled> {
    let mut furthest = vec![Cause::Facing; surface.sample_mm.len()];
    let mut rows = Vec::with_capacity(poses.len());
    for pose in poses {
        let caster = Caster { surface, probe: Probe::new(optics, pose, scene), quality_scale };
        rows.push(caster.cast(&mut furthest, ctx)?);
        ctx.progress(rows.len(), poses.len());
    }
    Ok(VisibilityMatrix { rows, furthest_cause: furthest })
}

/// One view, ready for many samples.
struct Caster<'a> {
    surface: &'a Surface,
    probe: Probe<'a>,
    quality_scale: Option<QualityScale>,
}

/// One viewpoint held against single points: what this engine asks of every sample, and others of a few.
pub(in crate::planning) struct Probe<'a> {
    view: View<'a>,
    scene: &'a RayScene,
}

impl<'a> Probe<'a> {
    pub(in crate::planning) fn new(optics: &'a Optics, pose: &Pose<Part, ScannerFrame>, scene: &'a RayScene) -> Self {
        Self { view: optics.at(pose), scene }
    }

    /// The first step at which a point fails that has this unit normal and kind of requirement; else its quality.
    pub(in crate::planning) fn measure(&self, p: &Point3<f64>, normal: &Vector3<f64>, kind: u16) -> Result<f32, Cause> {
        let quality = self.seen(p, normal, kind)?;
        self.view.counted_quality(p, normal, quality, kind).ok_or(Cause::BelowGrade)
    }

    /// The first step at which a point fails, however well it is measured; else its quality.
    fn seen(&self, p: &Point3<f64>, normal: &Vector3<f64>, kind: u16) -> Result<f32, Cause> {
        let quality = self.before_shadow(p, normal, kind)?;
        for (centre, cause) in self.view.centres_mm.iter().zip(SHADOWS) {
            if self.scene.blocked(centre, p, RAY_END_SHARE) {
                return Err(cause);
            }
        }
        Ok(quality)
    }

    /// Returns true if a point faces all devices and nothing hides it from any, wherever their frames and the depth end.
    pub(in crate::planning) fn has_clear_lines(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> bool {
        let clear = |centre: &Point3<f64>| normal.dot(&(centre - p)) > 0.0 && !self.scene.blocked(centre, p, RAY_END_SHARE);
        self.view.centres_mm.iter().all(clear)
    }

    /// The first step before any shadow at which a point fails; else its quality. Shadows cost a ray each.
    pub(in crate::planning) fn before_shadow(&self, p: &Point3<f64>, normal: &Vector3<f64>, kind: u16) -> Result<f32, Cause> {
        self.view.before_shadow(p, normal, kind)
    }

    /// The angles at which the devices see a point.
    pub(in crate::planning) fn incidence_rad(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> PerDevice<f64> {
        self.view.incidence_rad(p, normal)
    }
}

/// Words of a row, and the steps of quality that belong to their bits.
#[derive(Default)]
struct Piece {
    words: Vec<u64>,
    steps: Vec<i16>,
}

impl Caster<'_> {
    fn cast(&self, furthest: &mut [Cause], ctx: &Context<'_>) -> Result<Row, Cancelled> {
        let pieces = furthest
            .par_chunks_mut(64 * BLOCK_WORDS)
            .enumerate()
            .map(|(block, furthest)| {
                ctx.check()?;
                Ok(self.cast_block(64 * BLOCK_WORDS * block, furthest))
            })
            .collect::<Result<Vec<_>, Cancelled>>()?;
        let row = Row::new(pieces.iter().flat_map(|piece| &piece.words).copied().collect());
        Ok(match self.quality_scale {
            Some(scale) => row.with_quality(pieces.iter().flat_map(|piece| &piece.steps).copied().collect(), scale),
            None => row,
        })
    }

    /// Samples `first ..`, as many as `furthest` has.
    fn cast_block(&self, first: usize, furthest: &mut [Cause]) -> Piece {
        let mut piece = Piece::default();
        for (word_first, furthest) in (first..).step_by(64).zip(furthest.chunks_mut(64)) {
            let mut word = 0_u64;
            for (bit, furthest) in furthest.iter_mut().enumerate() {
                match self.measure(SampleId::at(word_first + bit)) {
                    Ok(quality) => {
                        word |= 1 << bit;
                        piece.steps.extend(self.quality_scale.map(|scale| scale.quantise(quality)));
                    }
                    Err(cause) => *furthest = (*furthest).max(cause),
                }
            }
            piece.words.push(word);
        }
        piece
    }

    fn measure(&self, sample: SampleId) -> Result<f32, Cause> {
        let normal = &self.surface.patch_of(sample).normal;
        self.probe.seen(&self.surface.sample_mm[sample.index()], normal, self.surface.requirements.kind(sample))
    }
}
