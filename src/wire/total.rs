//! Sums as documents give them.

/// Sum of some values; of none it is 0, not −0 as `sum` has it.
pub(crate) fn total(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |sum, value| sum + value)
}

#[cfg(test)]
mod tests {
    use super::total;

    #[test]
    fn the_sum_of_nothing_has_no_sign() {
        assert!(total(std::iter::empty()).is_sign_positive());
        assert!((total([0.5, 0.25].into_iter()) - 0.75).abs() < 1e-15);
    }
}
