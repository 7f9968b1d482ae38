//! Numbers as text: the same on every machine, with as many decimals as the language's own listings show. Angles are rounded to
//! the nearest; speeds and accelerations down and times up, so that nothing is quicker than was planned.

use crate::cell::{Axes, Configuration};

/// Share of the last digit by which a product is off: 0.3 s are 300 ms, not 301.
const ROUNDING: f64 = 1e-6;

/// Formats a number with so many decimals; never `-0`.
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(positive) if positive.bytes().all(|byte| matches!(byte, b'0' | b'.')) => positive.to_owned(),
        _ => text,
    }
}

/// Formats a speed or an acceleration with so many decimals, never above it.
pub(super) fn at_most(value: f64, decimals: usize) -> String {
    let scale = 10_f64.powi(decimals as i32);
    fixed((value * scale + ROUNDING).floor() / scale, decimals)
}

/// Formats a time with so many decimals, never below it.
pub(super) fn at_least(value: f64, decimals: usize) -> String {
    let scale = 10_f64.powi(decimals as i32);
    fixed((value * scale - ROUNDING).ceil() / scale, decimals)
}

/// The angles, joints 1 to 6, then the table, in `unit_rad`, rounded to so many decimals and kept within the axes' limits, which
/// rounding could leave by half a digit. An axis whose limits have no such angle between them stays where rounding puts it.
pub(super) fn rounded(at_rad: &Configuration, axes: &Axes, unit_rad: f64, decimals: usize) -> [f64; 7] {
    let scale = 10_f64.powi(decimals as i32) / unit_rad;
    let at_rad = at_rad.axes_rad();
    std::array::from_fn(|axis| {
        let limits = &axes.0[axis];
        // Limits that came from degrees are off by the last digit of a double.
        let lowest = (limits.min_rad * scale - 1e-6).ceil();
        let highest = (limits.max_rad * scale + 1e-6).floor();
        let nearest = (at_rad[axis] * scale).round();
        let kept = if lowest <= highest { nearest.clamp(lowest, highest) } else { nearest };
        kept / 10_f64.powi(decimals as i32)
    })
}

/// Texts of the [`rounded`] angles.
pub(super) fn angles(at_rad: &Configuration, axes: &Axes, unit_rad: f64, decimals: usize) -> [String; 7] {
    rounded(at_rad, axes, unit_rad, decimals).map(|angle| fixed(angle, decimals))
}

/// One degree in radians: the unit of most languages.
pub(super) const DEGREE: f64 = std::f64::consts::PI / 180.0;

#[cfg(test)]
mod tests {
    use super::{Configuration, DEGREE, at_least, at_most, rounded};
    use crate::cell::{Presets, SpecLibrary};

    #[test]
    fn speeds_are_rounded_down_and_times_up_and_what_is_exact_stays() {
        for (value, decimals, down, up) in [
            (0.295_99, 2, "0.29", "0.30"),
            (0.300_1, 3, "0.300", "0.301"),
            (0.3, 3, "0.300", "0.300"),
            (0.1 + 0.2, 3, "0.300", "0.300"),
            (0.392_5, 5, "0.39250", "0.39250"),
            (100.0, 0, "100", "100"),
            (100.4, 0, "100", "101"),
            (0.0, 3, "0.000", "0.000"),
        ] {
            assert_eq!((at_most(value, decimals).as_str(), at_least(value, decimals).as_str()), (down, up), "{value}");
        }
    }

    #[test]
    fn limits_closer_than_the_decimals_round_without_a_panic() {
        let mut axes = Presets.cell("e05-transcan").expect("preset").build(&Presets).expect("builds").axes();
        (axes.0[0].min_rad, axes.0[0].max_rad) = (0.02 * DEGREE, 0.04 * DEGREE);
        let at = Configuration { joints_rad: [0.03 * DEGREE, 0.0, 0.0, 0.0, 0.0, 0.0], table_rad: 0.0 };
        let found = |decimals| rounded(&at, &axes, DEGREE, decimals)[0];
        assert!(found(1).abs() < 1e-12 && (found(2) - 0.03).abs() < 1e-12, "{} {}", found(1), found(2));
    }
}
