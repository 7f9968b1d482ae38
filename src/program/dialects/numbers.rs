//! Numbers as text: the same on every machine, with as many decimals as the language's own listings show.

use crate::cell::{Axes, Configuration};

/// Formats a number with so many decimals; never `-0`.
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(positive) if positive.bytes().all(|byte| matches!(byte, b'0' | b'.')) => positive.to_owned(),
        _ => text,
    }
}

/// The angles rounded to so many decimals of `unit_rad`, and kept within the axes' limits, which rounding could leave by
/// half a digit.
pub(super) fn rounded(at_rad: &Configuration, axes: &Axes, unit_rad: f64, decimals: usize) -> [f64; 7] {
    let scale = 10_f64.powi(decimals as i32) / unit_rad;
    let at_rad = at_rad.axes_rad();
    std::array::from_fn(|axis| {
        let limits = &axes.0[axis];
        // Limits that came from degrees are off by the last digit of a double.
        let lowest = (limits.min_rad * scale - 1e-6).ceil();
        let highest = (limits.max_rad * scale + 1e-6).floor();
        (at_rad[axis] * scale).round().clamp(lowest, highest) / 10_f64.powi(decimals as i32)
    })
}

/// Texts of the [`rounded`] angles.
pub(super) fn angles(at_rad: &Configuration, axes: &Axes, unit_rad: f64, decimals: usize) -> [String; 7] {
    rounded(at_rad, axes, unit_rad, decimals).map(|angle| fixed(angle, decimals))
}

/// One degree in radians: the unit of most languages.
pub(super) const DEGREE: f64 = std::f64::consts::PI / 180.0;
