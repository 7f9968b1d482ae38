//! Conditions under which a cell's calibrated poses are to be used: ages from times as they are written, by a clock that is handed in.

use crate::cell::{Cell, UseConditions};
use crate::wire::UtcTime;

/// Conditions at time `now` and this temperature, as far as they are known. A time that cannot be read counts as older than any limit.
#[must_use]
pub fn use_conditions(cell: &Cell, now: Option<&UtcTime>, temperature_c: Option<f64>) -> UseConditions {
    let age = |at: &str| now.map(|now| at.parse::<UtcTime>().map_or(f64::INFINITY, |at| now.hours_since(&at)));
    let calibrated = cell.calibrated.as_ref();
    UseConditions {
        calibration_age_hours: calibrated.and_then(|known| age(&known.at)),
        compensation_age_hours: calibrated.and_then(|known| age(&known.compensation.as_ref()?.at)),
        temperature_c,
    }
}
