//! Stability of a registration by shared surface, which [`crate::planning::registration`] evaluates.

use nalgebra::{Point3, Vector3};

/// Resistance below which a freedom is open: a motion by 1 mm moves the surface along its normals by less than 0.1 mm (root mean
/// square). Our choice.
pub const MIN_RESISTANCE: f64 = 0.01;

/// Stability of a registration by shared surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stability {
    /// Shared area, mm².
    pub shared_area_mm2: f64,
    /// Smallest eigenvalue of the normal matrix: the mean square by which the shared surface moves along its normals when it
    /// makes the weakest motion by 1, turns measured at the radius of the part. 0 where nothing is shared.
    pub resistance: f64,
    /// Turning part of the weakest motion: its axis, as long as the motion at the radius of the part is a turn.
    pub turn: Vector3<f64>,
    /// Shifting part of the weakest motion.
    pub shift: Vector3<f64>,
    /// Centre of the shared surface, about which it turns.
    pub centre_mm: Point3<f64>,
}

impl Stability {
    /// Returns true if all six freedoms are fixed.
    #[must_use]
    pub fn is_fixed(&self) -> bool {
        self.resistance >= MIN_RESISTANCE
    }

    /// Expected error of a registration along the weakest motion, mm, if points of both measurements lie `spacing_mm` apart with
    /// independent noise of `noise_mm` (1 σ): √2 · σ / √(λ · number of points). `None` where that motion is not resisted at all.
    #[must_use]
    pub fn expected_error_mm(&self, noise_mm: f64, spacing_mm: f64) -> Option<f64> {
        let points = self.shared_area_mm2 / (spacing_mm * spacing_mm);
        let information = self.resistance * points;
        (information > 0.0).then(|| std::f64::consts::SQRT_2 * noise_mm / information.sqrt())
    }
}
