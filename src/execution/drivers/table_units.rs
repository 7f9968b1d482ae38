//! Angles of a table in the units of its drive.

use std::f64::consts::TAU;
use std::time::Duration;

use crate::execution::device::DeviceError;

/// Time that a turn may take longer than predicted, beside half of the prediction: what a run waits for, less what the rest may take.
const LATE: Duration = Duration::from_secs(4);

/// Whole number of units of a speed, never above it.
///
/// # Errors
/// [`DeviceError::Unsupported`]: below 1 or above `max`, or so much slower once it is a whole number that a turn of `duration` comes too
/// late for the run that waits for it.
pub(super) fn whole_units(speed: f64, unit: &str, max: f64, duration: Duration) -> Result<u32, DeviceError> {
    // 8.999999 of 9 is rounding.
    let whole = (speed * (1.0 + 1e-9)).floor();
    let refuse = |reason: String| Err(DeviceError::Unsupported { what: format!("turn at {speed:.2} {unit}; {reason}") });
    if !(1.0..=max).contains(&whole) {
        return refuse(format!("allowed is 1 to {max}: change the speed of the run"));
    }
    let takes = duration.mul_f64(speed / whole);
    if takes > duration + duration / 2 + LATE {
        let [takes, predicted] = [takes, duration].map(|time| time.as_secs_f64());
        return refuse(format!(
            "it takes whole numbers, and at {whole} the turn would take {takes:.0} s in place of {predicted:.0} s: choose a speed that is \
             nearer to one"
        ));
    }
    Ok(whole as u32)
}

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
            return Err(DeviceError::Unsupported { what: format!("turn to {angle_rad} rad; plan again") });
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_speed_becomes_a_whole_number_or_is_refused() {
        let whole = |speed: f64, secs: u64| whole_units(speed, "r/min", 6500.0, Duration::from_secs(secs));
        for (speed, wanted) in [(180.0, 180), (0.05 * 180.0, 9), (8.999_999_999_9, 9), (100.9, 100), (1.2, 1), (1.0, 1)] {
            assert_eq!(whole(speed, 300), Ok(wanted), "{speed}");
        }
        for speed in [0.9, 6501.0, f64::NAN, f64::INFINITY, -3.0] {
            assert!(whole(speed, 1).is_err(), "{speed}");
        }
        assert_eq!(whole(1.875, 8), Ok(1), "late by no more than a run waits");
        let error = whole(1.8, 300).expect_err("late by four minutes").to_string();
        assert!(error.contains("1.80 r/min") && error.contains("540 s in place of 300 s"), "{error}");
    }
}
