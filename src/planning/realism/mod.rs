//! Measured samples that a real scan may lack ([`crate::planning::method::realism`]): judged after the views are chosen, from what
//! they measure. What is measured in the simulation is decided elsewhere and stays as it is.
//!
//! A reason that depends on the view holds for a sample only if no view measures it without one. Views are looked at one after
//! the other and their samples in parallel blocks, so that the result does not depend on the number of threads.

mod concave;
mod margins;
#[cfg(test)]
mod tests;

use nalgebra::{Point3, Vector3};

use super::context::{Cancelled, Context};
use super::ids::SampleId;
use super::params::PlanParams;
use super::surface::Surface;
use super::verdict::RiskReason;
use super::visibility::{Row, SampleSet};
use crate::cell::Scanner;
use crate::geometry::parallel;
use crate::geometry::{Mesh, Part, Pose, RayScene, ScannerFrame};
pub use concave::ConcaveZone;
use concave::ZoneSample;
use margins::Margins;

/// Samples that a thread judges at a time.
const BLOCK: usize = 512;
/// Bit of a sample that some view measures outside of all margins.
const CLEARED: u8 = 1 << 7;

/// The part whose measured samples are judged.
pub(super) struct RiskInput<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) surface: &'a Surface,
    pub(super) scanner: &'a Scanner,
    pub(super) params: &'a PlanParams,
}

/// A chosen view.
pub(super) struct RiskView<'a> {
    pub(super) part_from_scanner: Pose<Part, ScannerFrame>,
    /// Samples that it measures.
    pub(super) row: &'a Row,
    /// Everything that it may see.
    pub(super) surfaces: &'a RayScene,
}

/// Reasons for which measured samples are at risk.
pub(super) struct Risks {
    /// A bit for each reason, sample by sample.
    bits: Vec<u8>,
}

fn bit(reason: RiskReason) -> u8 {
    1 << reason as u8
}

impl Risks {
    /// Returns true if a sample is at risk for a reason.
    pub(super) fn has(&self, sample: SampleId, reason: RiskReason) -> bool {
        self.bits[sample.index()] & bit(reason) != 0
    }

    /// The samples that are at risk.
    pub(super) fn samples(&self) -> SampleSet {
        let mut samples = SampleSet::none_of(self.bits.len());
        SampleId::number(&self.bits).filter(|(_, bits)| **bits != 0).for_each(|(sample, _)| samples.insert(sample));
        samples
    }
}

/// Judges what views measure together.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn risks(input: &RiskInput<'_>, views: &[RiskView<'_>], ctx: &Context<'_>) -> Result<Risks, Cancelled> {
    let samples = input.surface.sample_mm.len();
    let mut measured = SampleSet::none_of(samples);
    views.iter().for_each(|view| measured.insert_all(view.row.measured()));
    let mut bits = in_margins(input, views, ctx)?;
    let realism = &input.params.realism;
    if realism.concave_zone_mm > 0.0 {
        let edges = concave::concave_edges(input.mesh, realism.concave_dihedral_deg.to_radians(), ctx)?;
        let is_measured = |sample: SampleId| measured.holds(sample);
        let zone = concave::zone(input.surface, (input.mesh, &edges), realism.concave_zone_mm, is_measured, ctx)?;
        for near in &zone {
            ctx.check()?;
            let reflects = is_lit_by_reflection(input, views, near);
            let reflected = if reflects { bit(RiskReason::InterReflection) } else { 0 };
            bits[near.sample.index()] |= bit(RiskReason::ConcaveZone) | reflected;
        }
    }
    Ok(Risks { bits })
}

/// Bits of the samples that no view measures outside of the margins of its images.
fn in_margins(input: &RiskInput<'_>, views: &[RiskView<'_>], ctx: &Context<'_>) -> Result<Vec<u8>, Cancelled> {
    let mut bits = vec![0_u8; input.surface.sample_mm.len()];
    let realism = &input.params.realism;
    if realism.frame_margin_px <= 0.0 && realism.silhouette_margin_px <= 0.0 {
        return Ok(bits);
    }
    for view in views {
        let margins = Margins::new(input, view, ctx.simd_level());
        let open: Vec<SampleId> = view.row.samples().filter(|sample| bits[sample.index()] & CLEARED == 0).collect();
        let judged: Vec<Vec<Option<RiskReason>>> = parallel::try_map_chunks(&open, BLOCK, |samples| {
            ctx.check()?;
            Ok::<_, Cancelled>(margins.of(samples))
        })?;
        for (sample, reason) in open.iter().zip(judged.into_iter().flatten()) {
            bits[sample.index()] |= reason.map_or(CLEARED, bit);
        }
    }
    bits.iter_mut().filter(|bits| **bits & CLEARED != 0).for_each(|bits| *bits = 0);
    Ok(bits)
}

/// Returns true if, in every view that measures a sample of the zone, the light that the projector casts on it is mirrored
/// towards the plane of a face across an edge.
fn is_lit_by_reflection(input: &RiskInput<'_>, views: &[RiskView<'_>], near: &ZoneSample) -> bool {
    let point_mm = &input.surface.sample_mm[near.sample.index()];
    let normal = &input.surface.patch_of(near.sample).normal;
    let projector_mm = input.scanner.devices.projector.scanner_from_device.origin_mm();
    views.iter().filter(|view| view.row.holds(near.sample)).all(|view| {
        let mirrored = mirrored(&view.part_from_scanner.point(&projector_mm), point_mm, normal);
        near.opposite.iter().any(|face| mirrored.dot(face) < 0.0)
    })
}

/// Direction in which light from a point leaves a mirror that lies at `point_mm`.
fn mirrored(light_mm: &Point3<f64>, point_mm: &Point3<f64>, normal: &Vector3<f64>) -> Vector3<f64> {
    let towards = light_mm - point_mm;
    normal * (2.0 * normal.dot(&towards)) - towards
}

/// The rows less the samples that are not counted.
pub(super) fn without(rows: Vec<Row>, left_out: &SampleSet) -> Vec<Row> {
    rows.into_iter().map(|row| row.without(left_out)).collect()
}
