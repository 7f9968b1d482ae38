//! Angles as documents give them.

/// Converts to degrees, rounded to 10⁻⁹: this moves a scanner at 1 m by 2·10⁻⁸ mm, and 30° is written as 30.
pub(crate) fn degrees(angle_rad: f64) -> f64 {
    const PER_DEGREE: f64 = 1e9;
    // Adding 0 turns −0 into 0.
    (angle_rad.to_degrees() * PER_DEGREE).round() / PER_DEGREE + 0.0
}

#[cfg(test)]
mod tests {
    use super::degrees;

    #[test]
    fn round_angles_read_round() {
        for deg in [30.0_f64, -146.7, 0.1, 359.999_999_999] {
            assert_eq!(degrees(deg.to_radians()), deg);
        }
        assert!(degrees(-1e-15).is_sign_positive());
    }
}
