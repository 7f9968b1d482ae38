//! Angles as documents give them.

/// Converts to degrees, rounded as the planner rounds the table's angles: what it holds equal reads equal.
pub(crate) fn degrees(angle_rad: f64) -> f64 {
    crate::cell::rounded_deg(angle_rad)
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
