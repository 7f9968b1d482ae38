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
use crate::geometry::{Part, Pose, RayScene, ScannerFrame, SimdLevel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::surface::{AskedPoint, Surface};
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
        let caster = Caster { surface, probe: Probe::new(optics, pose, scene, ctx.simd_level()), quality_scale };
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
    /// Level of the rays to many points.
    level: SimdLevel,
}

impl<'a> Probe<'a> {
    pub(in crate::planning) fn new(
        optics: &'a Optics,
        pose: &Pose<Part, ScannerFrame>,
        scene: &'a RayScene,
        level: SimdLevel,
    ) -> Self {
        Self { view: optics.at(pose), scene, level }
    }

    /// Finds for each of `points` the first step at which it fails, else its quality. Rays go in packets ([`RayScene::blocked_from`]).
    pub(in crate::planning) fn measure(&self, points: &[AskedPoint]) -> Vec<Result<f32, Cause>> {
        let mut results: Vec<Result<f32, Cause>> = points.iter().map(|point| self.before_shadow(point)).collect();
        let (mut passing, mut targets, mut hidden) = (Vec::new(), Vec::new(), Vec::new());
        for (centre, cause) in self.view.centres_mm.iter().zip(SHADOWS) {
            passing.clear();
            passing.extend((0..points.len()).filter(|place| results[*place].is_ok()));
            targets.clear();
            targets.extend(passing.iter().map(|place| points[*place].mm));
            self.scene.blocked_from(self.level, centre, &targets, RAY_END_SHARE, &mut hidden);
            passing.iter().zip(&hidden).filter(|(_, hidden)| **hidden).for_each(|(place, _)| results[*place] = Err(cause));
        }
        let counted = |(result, point): (&mut Result<f32, Cause>, &AskedPoint)| {
            let AskedPoint { mm, normal, kind } = point;
            *result = result.and_then(|quality| self.view.counted_quality(mm, normal, quality, *kind));
        };
        results.iter_mut().zip(points).for_each(counted);
        results
    }

    /// The first step at which a point fails, however well it is measured; else its quality.
    fn seen(&self, p: &Point3<f64>, normal: &Vector3<f64>, kind: u16) -> Result<f32, Cause> {
        let quality = self.view.before_shadow(p, normal, kind)?;
        for (centre, cause) in self.view.centres_mm.iter().zip(SHADOWS) {
            if self.scene.blocked(centre, p, RAY_END_SHARE) {
                return Err(cause);
            }
        }
        Ok(quality)
    }

    /// Returns true if a point faces all devices and nothing hides it from any, wherever their frames and the depth end.
    pub(in crate::planning) fn has_clear_lines(&self, point: &AskedPoint) -> bool {
        let AskedPoint { mm, normal, .. } = point;
        let clear = |centre: &Point3<f64>| normal.dot(&(centre - mm)) > 0.0 && !self.scene.blocked(centre, mm, RAY_END_SHARE);
        self.view.centres_mm.iter().all(clear)
    }

    /// The first step before any shadow at which a point fails; else its quality. Shadows cost a ray each.
    pub(in crate::planning) fn before_shadow(&self, point: &AskedPoint) -> Result<f32, Cause> {
        self.view.before_shadow(&point.mm, &point.normal, point.kind)
    }

    /// The angles at which the devices see a point.
    pub(in crate::planning) fn incidence_rad(&self, point: &AskedPoint) -> PerDevice<f64> {
        self.view.incidence_rad(&point.mm, &point.normal)
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
