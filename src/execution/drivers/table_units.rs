//! Angles of a table in the units of its drive.

use std::f64::consts::TAU;

use crate::execution::device::DeviceError;

/// Units of a table's drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TableUnits {
    /// Units of one turn.
    pub(super) per_turn: f64,
    /// Position at angle zero.
    pub(super) home: i64,
    /// True if positions rise against the table frame's +z.
    pub(super) is_reversed: bool,
}

impl TableUnits {
    fn per_rad(&self) -> f64 {
        let per_rad = self.per_turn / TAU;
        if self.is_reversed { -per_rad } else { per_rad }
    }

    /// Angle of a position.
    pub(super) fn angle_rad(&self, position: i64) -> f64 {
        (position - self.home) as f64 / self.per_rad()
    }

    /// Position of an angle.
    pub(super) fn position(&self, angle_rad: f64) -> Result<i64, DeviceError> {
        let units = (angle_rad * self.per_rad()).round();
        // Half of what 64 bits hold: differences of two positions fit as well.
        if units.is_nan() || units.abs() >= 4e18 {
            return Err(DeviceError::Unsupported { what: format!("turn to {angle_rad} rad") });
        }
        Ok(self.home + units as i64)
    }

    /// Position that reads `raw` where positions repeat with every turn: the one nearest to `near`.
    pub(super) fn unwrapped(&self, raw: i64, near: i64) -> i64 {
        let turn = self.per_turn as i64;
        let ahead = (raw - near).rem_euclid(turn);
        near + if 2 * ahead > turn { ahead - turn } else { ahead }
    }
}
