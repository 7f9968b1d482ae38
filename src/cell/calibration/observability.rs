//! Judgement of how well observations determine the unknowns. Two axes of turn are needed, so the middle spread of the relative
//! rotation vectors goes with the error; but no angle decides: the predicted standard deviations do.

use nalgebra::{Isometry3, Matrix3, Matrix6, SMatrix, Vector3};

use crate::cell::closed_list;
use crate::geometry::sort_ascending;

/// Fewest observations that determine anything.
pub const MIN_OBSERVATIONS: usize = 3;
/// Middle spread below which there are no two axes of turn, rad (1°).
pub const MIN_SPREAD_RAD: f64 = std::f64::consts::PI / 180.0;

/// Largest standard deviations that a calibration may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UncertaintyLimits {
    /// Max deviation of a shift in any direction; beyond it the motion was degenerate.
    pub max_mm: f64,
    /// Max deviation of a turn about any axis.
    pub max_rad: f64,
    /// Deviation of a shift beyond which a warning is due.
    pub warn_mm: f64,
}

impl Default for UncertaintyLimits {
    /// Half the grade that a scan of 0.05 mm asks for is lost at 0.5 mm or 0.05°.
    fn default() -> Self {
        Self { max_mm: 0.5, max_rad: 0.05_f64.to_radians(), warn_mm: 0.2 }
    }
}

closed_list! {
    /// Kind of a freedom of a rigid body.
    pub enum Freedom {
        /// Turn about an axis.
        Turn = "turn",
        /// Shift along an axis.
        Shift = "shift",
    }
}

/// Direction that is known least.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weakest {
    /// Turn or shift, whichever is the larger part at the depth of best focus.
    pub freedom: Freedom,
    /// Unit vector, in the cloud.
    pub axis: Vector3<f64>,
    /// Standard deviation of it: rad for a turn, mm for a shift.
    pub sd: f64,
}

/// Judgement of observations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observability {
    /// Roots of the eigenvalues of the mean of v·vᵀ, v the relative rotation vectors of the flange, ascending, rad.
    pub spread_rad: [f64; 3],
    /// Axis that the motions turn about most, in the flange.
    pub main_axis: Vector3<f64>,
    /// Direction that is known least; none if the observations leave an unknown open altogether.
    pub weakest: Option<Weakest>,
    /// Largest standard deviation of a turn about any axis, rad; infinite if open.
    pub turn_sd_rad: f64,
    /// Largest standard deviation of a shift in any direction, mm.
    pub shift_sd_mm: f64,
}

impl Observability {
    /// Judges observations whose flange was at `frames` seen from the board's rest (base, or plate), with the covariance of the
    /// scanner's pose that they lead to, if they lead to one. `lever_mm` is the depth of best focus.
    #[must_use]
    pub fn new(frames: &[Isometry3<f64>], covariance: Option<&Matrix6<f64>>, lever_mm: f64) -> Self {
        let (spread_rad, main_axis) = spread(frames);
        // Along any direction, not only along the axes of the frame, whose choice says nothing about the observations.
        let worst = |first: usize| {
            covariance.map_or(f64::INFINITY, |all| {
                let block: Matrix3<f64> = all.fixed_view::<3, 3>(first, first).into_owned();
                block.symmetric_eigenvalues().max().max(0.0).sqrt()
            })
        };
        Self {
            spread_rad,
            main_axis,
            weakest: covariance.map(|covariance| weakest(covariance, lever_mm)),
            turn_sd_rad: worst(0),
            shift_sd_mm: worst(3),
        }
    }

    /// Returns true if the motions leave a freedom open, by these limits.
    #[must_use]
    pub fn is_degenerate(&self, limits: &UncertaintyLimits) -> bool {
        let is_known = self.turn_sd_rad <= limits.max_rad && self.shift_sd_mm <= limits.max_mm;
        self.spread_rad[1] < MIN_SPREAD_RAD || !is_known
    }

    /// Returns true if a warning is due.
    #[must_use]
    pub fn is_weak(&self, limits: &UncertaintyLimits) -> bool {
        self.shift_sd_mm > limits.warn_mm
    }

    /// Turns about this axis alone: the shift along it cannot be told. None if there are turns about two axes, or none at all.
    #[must_use]
    pub fn single_axis(&self) -> Option<Vector3<f64>> {
        (self.spread_rad[1] < MIN_SPREAD_RAD && self.spread_rad[2] >= MIN_SPREAD_RAD).then_some(self.main_axis)
    }
}

/// Spread of the relative rotation vectors, ascending, and the axis of the largest.
fn spread(frames: &[Isometry3<f64>]) -> ([f64; 3], Vector3<f64>) {
    let (mut sum, mut count) = (Matrix3::zeros(), 0.0_f64);
    for (index, a) in frames.iter().enumerate() {
        for b in &frames[..index] {
            let turn = (b.rotation.inverse() * a.rotation).scaled_axis();
            sum += turn * turn.transpose();
            count += 1.0;
        }
    }
    let eigen = (sum / count.max(1.0)).symmetric_eigen();
    let mut order = [0, 1, 2];
    sort_ascending(&mut order, |axis| eigen.eigenvalues[*axis]);
    (order.map(|index| eigen.eigenvalues[index].max(0.0).sqrt()), eigen.eigenvectors.column(order[2]).into_owned())
}

/// Eigenvector of the largest variance, turns times the lever.
fn weakest(covariance: &Matrix6<f64>, lever_mm: f64) -> Weakest {
    let scale = |axis: usize| if axis < 3 { lever_mm } else { 1.0 };
    let scaled = Matrix6::from_fn(|row, column| covariance[(row, column)] * scale(row) * scale(column));
    let eigen = scaled.symmetric_eigen();
    let vector = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    let (turn, shift) = (vector.fixed_rows::<3>(0).into_owned(), vector.fixed_rows::<3>(3).into_owned());
    let (freedom, first, axis) =
        if turn.norm() > shift.norm() { (Freedom::Turn, 0, turn.normalize()) } else { (Freedom::Shift, 3, shift.normalize()) };
    let block = covariance.fixed_view::<3, 3>(first, first);
    Weakest { freedom, axis, sd: (block * axis).dot(&axis).max(0.0).sqrt() }
}

/// Standard deviation of a scanned point, root of the sum over three axes, mm: of the point `in_cloud_mm` carried by a pose with
/// this covariance.
#[must_use]
pub fn point_sd_mm(covariance: &Matrix6<f64>, in_cloud_mm: &Vector3<f64>) -> f64 {
    let mut rows = SMatrix::<f64, 3, 6>::zeros();
    rows.fixed_view_mut::<3, 3>(0, 0).copy_from(&-in_cloud_mm.cross_matrix());
    rows.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
    (rows * covariance * rows.transpose()).trace().max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A freedom across the axes of the cloud was told by its part along one of them: 0.4 mm of 0.69 mm, within the limit.
    #[test]
    fn the_largest_deviation_is_that_of_the_worst_direction_whatever_the_frame() {
        let turned = |axis: Vector3<f64>| Isometry3::rotation(axis * 0.3);
        let frames = [Isometry3::identity(), turned(Vector3::x()), turned(Vector3::y())];
        let open = Vector3::new(1.0, 1.0, 1.0) * 0.4;
        let mut covariance = Matrix6::<f64>::identity() * 1e-10;
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&(open * open.transpose() + Matrix3::<f64>::identity() * 1e-10));
        let turn = Vector3::new(0.0, 1.0, -1.0) * 0.04_f64.to_radians();
        let across = Observability::new(&frames, Some(&covariance), 480.0);
        assert!((across.shift_sd_mm - open.norm()).abs() < 1e-6, "{across:?}");
        assert!(across.is_degenerate(&UncertaintyLimits::default()));
        covariance = Matrix6::<f64>::identity() * 1e-10;
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&(turn * turn.transpose() + Matrix3::<f64>::identity() * 1e-14));
        let across = Observability::new(&frames, Some(&covariance), 480.0);
        assert!((across.turn_sd_rad - turn.norm()).abs() < 1e-7, "{across:?}");
        assert!(across.is_degenerate(&UncertaintyLimits::default()), "0.057° of 0.05°");
        assert!(Observability::new(&frames, None, 480.0).shift_sd_mm.is_infinite());
    }
}
