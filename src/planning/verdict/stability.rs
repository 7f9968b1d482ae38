//! Stability of a registration by shared surface, which [`crate::planning::setups::registration`] evaluates.

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
    pub turn_in_part: Vector3<f64>,
    /// Shifting part of the weakest motion.
    pub shift_in_part: Vector3<f64>,
    /// Centre of the shared surface, about which it turns.
    pub centre_in_part_mm: Point3<f64>,
    /// Expected error of the registration along the weakest motion, mm (1 σ), from the noise of independent points alone. `None`
    /// where that motion is not resisted at all, where its error cannot be computed, and where no views are known that measure
    /// the surface.
    pub expected_error_mm: Option<f64>,
}

impl Stability {
    /// Returns true if all six freedoms are fixed.
    #[must_use]
    pub fn is_fixed(&self) -> bool {
        self.resistance >= MIN_RESISTANCE
    }
}
