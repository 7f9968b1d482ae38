//! Points of a sample over all views: their mean with its uncertainty, and those that do not count for it.

use super::correlation::NoiseCorrelation;
use super::footprint::{MeasuredFootprint, PointSum};
use super::{DeviationOptions, PoseError, SampleDeviation};
use crate::cell::calibration::se3::Twist;
use crate::inspection::student;

/// Points off the surface, or of a turned one, from which on they are more than stray ones.
pub(super) const MIN_OTHER_POINTS: u32 = 3;
/// Freedoms that the pooled variance counts for.
const POOLED_FREEDOMS: f64 = 10.0;
/// Points from which on a sample's own variance goes into the pool.
const POOLED_POINTS: f64 = 3.0;
/// Classes of incidence, by its cosine, and samples from which on one has a pool of its own.
const CLASSES: usize = 10;
const MIN_POOLED: usize = 30;

/// Points of a sample over all views.
#[derive(Clone, Copy, Default)]
pub(super) struct SampleSum {
    compared: PlacedPoints,
    /// Points off the surface.
    off: u32,
    /// Points of a surface that is turned too far.
    turned: PointSum,
}

impl SampleSum {
    /// Adds the points of a view. Views of a merged cloud show points again: of each use only the largest number is kept.
    pub(super) fn add(&mut self, footprint: &MeasuredFootprint, error: &PoseError, is_merged: bool) {
        let compared = PlacedPoints::of(&footprint.compared, error);
        if !is_merged {
            self.compared.add(&compared);
            self.off += footprint.off;
            self.turned.add(&footprint.turned);
            return;
        }
        if compared.count > self.compared.count {
            self.compared = compared;
        }
        self.off = self.off.max(footprint.off);
        if footprint.turned.points > self.turned.points {
            self.turned = footprint.turned;
        }
    }

    pub(super) fn finish(&self, pooled: &PooledVariance, options: &DeviationOptions) -> SampleDeviation {
        let Self { compared, off, turned } = self;
        let unmeasured = SampleDeviation {
            turned_points: turned.points,
            turned_mm: turned.mean_mm() as f32,
            is_off: *off >= MIN_OTHER_POINTS && f64::from(*off) > compared.count,
            ..SampleDeviation::default()
        };
        if compared.count < 1.0 {
            return unmeasured;
        }
        let shared = compared.shared_points(&pooled.correlation, options);
        let of_points_mm2 = compared.of_points_mm2(pooled.of_class[compared.class()], shared);
        SampleDeviation {
            distance_mm: compared.mean_mm() as f32,
            sigma_mm: compared.variance_mm2().sqrt() as f32,
            expanded_mm: (of_points_mm2 + compared.of_poses_mm2()).sqrt() as f32,
            of_points_mm: of_points_mm2.sqrt() as f32,
            points: compared.count as u32,
            ..unmeasured
        }
    }
}

/// Points with their distances, and the errors of the poses that they were seen from.
#[derive(Clone, Copy, Default)]
struct PlacedPoints {
    count: f64,
    /// Σ n_v² of the views' points.
    count_square: f64,
    sum_mm: f64,
    square_mm2: f64,
    /// Σ n_v times the cosine of the incidence.
    cos: f64,
    /// Σ n_v² σ_v² of the views' poses.
    pose: f64,
    /// Σ n_v times what all poses are off alike.
    shared_mm: Twist,
}

impl PlacedPoints {
    /// Points of one view.
    fn of(points: &PointSum, error: &PoseError) -> Self {
        let count = f64::from(points.points);
        Self {
            count,
            count_square: count * count,
            sum_mm: points.sum_mm,
            square_mm2: points.square_mm2,
            cos: count * error.cos,
            pose: count * count * error.own_mm2,
            shared_mm: count * error.shared_mm,
        }
    }

    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.count_square += other.count_square;
        self.sum_mm += other.sum_mm;
        self.square_mm2 += other.square_mm2;
        self.cos += other.cos;
        self.pose += other.pose;
        self.shared_mm += other.shared_mm;
    }

    fn mean_mm(&self) -> f64 {
        self.sum_mm / self.count
    }

    /// Class of their mean incidence; the first is the flattest.
    fn class(&self) -> usize {
        ((CLASSES as f64 * self.cos / self.count).max(0.0) as usize).min(CLASSES - 1)
    }

    /// Variance about their mean.
    fn variance_mm2(&self) -> f64 {
        let mean = self.mean_mm();
        (self.square_mm2 / self.count - mean * mean).max(0.0) * self.count / (self.count - 1.0).max(1.0)
    }

    /// Number of points that count as one. Noise is shared within a view: a point's own has Σ n_v²/n points in the mean.
    fn shared_points(&self, correlation: &NoiseCorrelation, options: &DeviationOptions) -> f64 {
        correlation.shared_points(self.count_square / self.count).max(options.correlated_points)
    }

    /// Variance of the noise: about a mean that takes part of what points share, they scatter by (n − shared)/(n − 1) of it. Where nearly
    /// all is shared they show little of it, and the factor is bounded.
    fn noise_mm2(&self, shared: f64) -> f64 {
        self.variance_mm2() * ((self.count - 1.0) / (self.count - shared).max(0.5 * self.count))
    }

    /// Number of independent points whose mean would be known as well.
    fn effective(&self, shared: f64) -> f64 {
        (self.count / shared).max(1.0)
    }

    /// Square of the expanded uncertainty of their mean by their own spread.
    fn of_points_mm2(&self, pooled_mm2: f64, shared: f64) -> f64 {
        let effective = self.effective(shared);
        let freedoms = effective - 1.0 + POOLED_FREEDOMS;
        let variance = ((effective - 1.0) * self.noise_mm2(shared) + POOLED_FREEDOMS * pooled_mm2) / freedoms;
        student_factor(freedoms).powi(2) * variance / effective
    }

    /// Square of the expanded uncertainty by the poses.
    fn of_poses_mm2(&self) -> f64 {
        4.0 * (self.pose + self.shared_mm.norm_squared()) / (self.count * self.count)
    }
}

/// Variances of points by the class of incidence at which they are seen: across a surface that is seen more flatly, they scatter more.
pub(super) struct PooledVariance {
    of_class: [f64; CLASSES],
    correlation: NoiseCorrelation,
}

impl PooledVariance {
    /// Median variances of the samples with enough points, each divided by the median of χ²/ν, (1 − 2/9ν)³ (E. B. Wilson, M. M. Hilferty,
    /// "The distribution of chi-square", PNAS 17, 1931). A class of few samples has that of the nearest one, of two the flatter; where all
    /// have few, that of all together; and without any the expected noise counts. Points that share noise have the freedoms of those that
    /// would be independent, and one at least.
    pub(super) fn of(sums: &[SampleSum], correlation: NoiseCorrelation, options: &DeviationOptions) -> Self {
        let unbiased = |points: &PlacedPoints| {
            let shared = points.shared_points(&correlation, options);
            let freedoms = (points.effective(shared) - 1.0).max(1.0);
            points.noise_mm2(shared) / (1.0 - 2.0 / (9.0 * freedoms)).powi(3)
        };
        let mut variances: [Vec<f64>; CLASSES] = std::array::from_fn(|_| Vec::new());
        for points in sums.iter().map(|sum| &sum.compared).filter(|points| points.count >= POOLED_POINTS) {
            variances[points.class()].push(unbiased(points));
        }
        let of_all = median(variances.concat()).unwrap_or_else(|| options.noise_mm.powi(2));
        let known = variances.map(|own| if own.len() >= MIN_POOLED { median(own) } else { None });
        let nearest =
            |class: usize| (0..CLASSES).filter(|other| known[*other].is_some()).min_by_key(|other| other.abs_diff(class));
        let of_class = std::array::from_fn(|class| nearest(class).and_then(|class| known[class]).unwrap_or(of_all));
        Self { of_class, correlation }
    }
}

/// Middle one of some numbers.
pub(super) fn median(mut numbers: Vec<f64>) -> Option<f64> {
    let middle = numbers.len() / 2;
    (!numbers.is_empty()).then(|| *numbers.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Student's 97.5 % quantile, at least 2.
pub(super) fn student_factor(freedoms: f64) -> f64 {
    student::quantile(freedoms).max(2.0)
}
