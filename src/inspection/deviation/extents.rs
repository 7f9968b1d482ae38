//! Extents of the part along its axes: nominal ones from the mesh; measured ones moved by the mean deviation of the samples at both ends.
//! A surface whose normal has the cosine c with the axis and that deviates by d ends d/c farther along it: its plane meets the axis there.

use super::{Nominal, SampleDeviation};

/// Samples within this distance of an end belong to it, mm, and within this share of the extent.
const END_MM: f64 = 0.2;
const END_SHARE: f64 = 0.002;
/// Minimum cosine between a sample's normal and the axis.
const END_COS: f64 = 0.7;
/// Fewer measured samples say nothing.
const MIN_SAMPLES: usize = 5;

/// Extent along one axis of the part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Extent of the mesh, mm.
    pub nominal_mm: f64,
    /// Extent as measured, mm; none where an end was not measured.
    pub measured_mm: Option<f64>,
    /// Upper bound of its expanded uncertainty, mm; none likewise: what poses leave open may move both ends apart.
    pub max_expanded_mm: Option<f64>,
}

pub(super) fn extents(samples: &[SampleDeviation], nominal: &Nominal<'_>) -> [Extent; 3] {
    let around = nominal.mesh.aabb();
    [0, 1, 2].map(|axis| {
        let nominal_mm = around.extent_mm()[axis];
        let end = |is_high: bool| {
            let (sign, limit) = if is_high { (1.0, around.max[axis]) } else { (-1.0, around.min[axis]) };
            let within = END_MM.max(END_SHARE * nominal_mm);
            let (mut area, mut sum, mut expanded, mut count) = (0.0, 0.0, 0.0, 0);
            for sample in nominal.surface.samples() {
                let (at, found) = (nominal.surface.sample_mm[sample.index()], samples[sample.index()]);
                let cos = sign * nominal.surface.patch_of(sample).normal[axis];
                if found.points > 0 && (at[axis] - limit).abs() <= within && cos >= END_COS {
                    let own = nominal.surface.sample_area_mm2(sample);
                    (area, sum, count) = (area + own, sum + own * f64::from(found.distance_mm) / cos, count + 1);
                    // Samples of an end may share their errors.
                    expanded += own * f64::from(found.expanded_mm) / cos;
                }
            }
            (count >= MIN_SAMPLES).then(|| [sum / area, expanded / area])
        };
        let [moved_mm, max_expanded_mm] = match end(false).zip(end(true)) {
            Some((low, high)) => [0, 1].map(|place| Some(low[place] + high[place])),
            None => [None; 2],
        };
        Extent { nominal_mm, measured_mm: moved_mm.map(|moved_mm| nominal_mm + moved_mm), max_expanded_mm }
    })
}
