//! Stability of a registration by shared surface ([`crate::planning::method::setups`]): which rigid motion of one measurement
//! against another the surface that both show resists least, and how much (Gelfand, Ikemoto, Rusinkiewicz and Levoy 2003,
//! *Geometrically Stable Sampling for the ICP Algorithm*).
//!
//! Part frame, mm. Cost: two passes over the shared samples; for the expected error one more, and one over all that is measured.

#[cfg(test)]
mod tests;

use nalgebra::{Matrix6, Point3, Vector3, Vector6};

use crate::geometry::parallel;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::surface::Surface;
pub(in crate::planning) use crate::planning::verdict::Stability;
use crate::planning::visibility::{Row, SampleSet, View};

/// Eigenvalue of the normal matrix, whose trace is 2 at most, that is 0 but for rounding.
const ROUNDING: f64 = 1e-12;

/// Samples that at least one of some rows' views measures, of so many.
pub(in crate::planning) fn union_of<'a>(rows: impl IntoIterator<Item = &'a Row>, samples: usize) -> SampleSet {
    let mut union = SampleSet::none_of(samples);
    rows.into_iter().for_each(|row| union.insert_all(row.measured()));
    union
}

/// Samples of both sets.
pub(in crate::planning) fn shared(a: &SampleSet, b: &SampleSet) -> SampleSet {
    let mut shared = a.clone();
    shared.retain_all(b);
    shared
}

/// Part of a surface that some views measure.
pub(in crate::planning) struct MeasuredSurface {
    samples: SampleSet,
    /// Information on the place of each sample's surface along its normal, mm⁻²; 0 where it is not measured.
    information: Vec<f64>,
}

/// A part by whose surface measurements are registered.
#[derive(Clone, Copy)]
pub(in crate::planning) struct SharedSurface<'a> {
    surface: &'a Surface,
    /// Radius of the part about its centre.
    radius_mm: f64,
}

impl<'a> SharedSurface<'a> {
    pub(in crate::planning) fn new(surface: &'a Surface) -> Self {
        let radius_mm = surface.sample_mm.iter().map(|p| (p - surface.centre_mm).norm()).fold(0.0, f64::max);
        Self { surface, radius_mm }
    }

    /// Evaluates a registration by the samples of `shared`.
    #[must_use]
    pub(in crate::planning) fn stability(&self, shared: &SampleSet) -> Stability {
        let surface = self.surface;
        let weighted = || shared.iter().map(|sample| (sample, surface.sample_area_mm2(sample)));
        let shared_area_mm2: f64 = weighted().map(|(_, area_mm2)| area_mm2).sum();
        if shared_area_mm2 <= 0.0 {
            return Stability {
                shared_area_mm2: 0.0,
                resistance: 0.0,
                turn_in_part: Vector3::zeros(),
                shift_in_part: Vector3::zeros(),
                centre_in_part_mm: surface.centre_mm,
                expected_error_mm: None,
            };
        }
        let moment: Vector3<f64> = weighted().map(|(sample, mm2)| surface.sample_mm[sample.index()].coords * mm2).sum();
        let centre_mm = Point3::from(moment / shared_area_mm2);
        let mut normal_matrix = Matrix6::<f64>::zeros();
        for (sample, area_mm2) in weighted() {
            let row = shift_along_normal(surface, sample, &centre_mm, self.radius_mm);
            normal_matrix.ger(area_mm2 / shared_area_mm2, &row, &row, 1.0);
        }
        let eigen = normal_matrix.symmetric_eigen();
        let least = eigen.eigenvalues.imin();
        let motion: Vector6<f64> = eigen.eigenvectors.column(least).into();
        let [turn, shift] = [0, 3].map(|first| motion.fixed_rows::<3>(first).into_owned());
        // An eigenvector has no sign of its own: its largest entry is made positive.
        let sign = if motion[motion.iamax()] < 0.0 { -1.0 } else { 1.0 };
        // Of a motion that nothing resists rounding leaves some 1e-17.
        let resistance = Some(eigen.eigenvalues[least]).filter(|value| *value > ROUNDING).unwrap_or_default();
        Stability {
            shared_area_mm2,
            resistance,
            turn_in_part: turn * sign,
            shift_in_part: shift * sign,
            centre_in_part_mm: centre_mm,
            expected_error_mm: None,
        }
    }

    /// Surface that views measure, each with its row.
    #[must_use]
    pub(in crate::planning) fn measured<'v>(&self, views: impl IntoIterator<Item = (View<'v>, &'v Row)>) -> MeasuredSurface {
        let (surface, count) = (self.surface, self.surface.sample_mm.len());
        let mut measured = MeasuredSurface { samples: SampleSet::none_of(count), information: vec![0.0; count] };
        for (view, row) in views {
            measured.samples.insert_all(row.measured());
            for sample in row.samples() {
                let precision = view.precision_at(&surface.sample_mm[sample.index()], &surface.patch_of(sample).normal);
                measured.information[sample.index()] += surface.sample_area_mm2(sample) * precision.information();
            }
        }
        measured
    }

    /// Evaluates a registration by what both measurements show, with the error that is expected of it.
    #[must_use]
    pub(in crate::planning) fn registration(&self, a: &MeasuredSurface, b: &MeasuredSurface) -> Stability {
        let shared = shared(&a.samples, &b.samples);
        let stability = self.stability(&shared);
        // The difference of two places has the variance of both.
        let of_difference = |sample: SampleId| {
            let [a, b] = [a, b].map(|measured| measured.information[sample.index()]);
            if a > 0.0 && b > 0.0 { a * b / (a + b) } else { 0.0 }
        };
        let weighted = shared.iter().map(|sample| (sample, of_difference(sample)));
        Stability { expected_error_mm: self.expected_error_mm(&stability, weighted), ..stability }
    }

    /// Standard deviation along the weakest motion of the least-squares registration by samples with their information.
    fn expected_error_mm(&self, stability: &Stability, weighted: impl Iterator<Item = (SampleId, f64)>) -> Option<f64> {
        if stability.resistance <= 0.0 {
            return None;
        }
        let mut normal_matrix = Matrix6::<f64>::zeros();
        for (sample, information) in weighted {
            let row = shift_along_normal(self.surface, sample, &stability.centre_in_part_mm, self.radius_mm);
            normal_matrix.ger(information, &row, &row, 1.0);
        }
        let (turn, shift) = (stability.turn_in_part, stability.shift_in_part);
        let motion = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
        let variances = normal_matrix.cholesky()?.solve(&motion);
        Some(motion.dot(&variances).sqrt())
    }

    /// The pair of sets that is the weakest link where all are joined one to another, each by the strongest link there is: the
    /// weakest edge of a maximum spanning tree (Prim 1957). `None` for fewer than two sets.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn weakest_link(&self, sets: &[SampleSet], ctx: &Context<'_>) -> Result<Option<Link>, Cancelled> {
        let link = |a: usize, b: usize| {
            ctx.check()?;
            Ok(([a, b], self.stability(&shared(&sets[a], &sets[b]))))
        };
        let mut best: Vec<Link> =
            parallel::try_map_range::<_, Cancelled>(sets.len().saturating_sub(1), |other| link(0, other + 1))?;
        let mut weakest: Option<Link> = None;
        while !best.is_empty() {
            let strongest = (1..best.len()).fold(0, |a, b| if best[b].1.resistance > best[a].1.resistance { b } else { a });
            let (pair, found) = best.swap_remove(strongest);
            if weakest.is_none_or(|(_, weakest)| found.resistance < weakest.resistance) {
                weakest = Some((pair, found));
            }
            let through = |other: &Link| {
                let through = link(pair[1], other.0[1])?;
                Ok(if through.1.resistance > other.1.resistance { through } else { *other })
            };
            best = parallel::try_map::<_, _, Cancelled>(&best, through)?;
        }
        Ok(weakest)
    }
}

/// Two sets, and what they share.
pub(in crate::planning) type Link = ([usize; 2], Stability);

/// Shift of a sample along its normal by a turn of 1 mm at the radius about each axis, and by 1 mm along each: [p × n; n].
fn shift_along_normal(surface: &Surface, sample: SampleId, centre_mm: &Point3<f64>, radius_mm: f64) -> Vector6<f64> {
    let normal = surface.patch_of(sample).normal;
    let turn = (surface.sample_mm[sample.index()] - centre_mm).cross(&normal) / radius_mm;
    Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z)
}
