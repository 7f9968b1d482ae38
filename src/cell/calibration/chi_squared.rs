//! χ² distribution for even degrees of freedom 2m, where its upper tail is a finite sum: Q(x) = exp(−x/2) Σ_{i<m} (x/2)^i / i!
//! (M. Abramowitz, I. A. Stegun, *Handbook of Mathematical Functions*, 1964, 26.4.21). Observations have six components and the unknowns
//! are even in number, so no other case is met.

/// Probability that χ² with `freedom` degrees, an even number, exceeds `value`.
#[must_use]
pub fn exceedance(value: f64, freedom: usize) -> f64 {
    let half = 0.5 * value.max(0.0);
    if half.is_nan() || freedom == 0 {
        return 1.0;
    }
    let (mut log_term, mut sum) = (-half, (-half).exp());
    for i in 1..freedom.div_ceil(2) {
        log_term += half.max(f64::MIN_POSITIVE).ln() - (i as f64).ln();
        sum += log_term.exp();
    }
    sum.min(1.0)
}

/// Value that χ² with `freedom` degrees, an even number, exceeds with this probability; by bisection.
#[must_use]
pub fn quantile(probability: f64, freedom: usize) -> f64 {
    let (mut low, mut high) = (0.0, 10.0 * freedom as f64 + 200.0);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if exceedance(middle, freedom) > probability { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of Abramowitz & Stegun, table 26.8.
    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (probability, freedom, value) in
            [(0.05, 2, 5.991), (0.01, 6, 16.812), (0.0005, 6, 24.103), (0.5, 6, 5.348), (0.01, 100, 135.807)]
        {
            assert!((quantile(probability, freedom) - value).abs() < 1e-3, "{probability} {freedom}");
        }
        assert!((exceedance(0.0, 6) - 1.0).abs() < 1e-15 && exceedance(1e6, 6) < 1e-12);
    }
}
