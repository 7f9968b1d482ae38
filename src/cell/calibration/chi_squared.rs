//! χ² distribution for even degrees of freedom 2m, where its upper tail is a finite sum: Q(x) = exp(−x/2) Σ_{i<m} (x/2)^i / i!
//! (M. Abramowitz, I. A. Stegun, *Handbook of Mathematical Functions*, 1964, 26.4.21). Observations have six components and the unknowns
//! are even in number but for the table's ratio: odd degrees of freedom are taken for one more.

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

/// Probability that a sum of squares with `freedom` degrees, an even number, exceeds `value` where the deviations that it is counted
/// in were estimated with `estimated` degrees: it is `freedom` times Snedecor's F, whose upper tail is a finite sum as well, Q(F) =
/// xᵃ Σ_{i<m} a (a + 1) … (a + i − 1) (1 − x)^i / i! with a = ν/2, x = ν / (ν + value) (Abramowitz & Stegun 26.6.4).
#[must_use]
pub fn exceedance_estimated(value: f64, freedom: usize, estimated: f64) -> f64 {
    let (value, half) = (value.max(0.0), 0.5 * estimated);
    if half.is_nan() || half <= 0.0 || freedom == 0 {
        return 1.0;
    }
    let ln_rest = (value / (estimated + value)).max(f64::MIN_POSITIVE).ln();
    let mut log_term = -half * (value / estimated).ln_1p();
    let mut sum = log_term.exp();
    for i in 1..freedom.div_ceil(2) {
        log_term += ln_rest + ((half + (i - 1) as f64) / i as f64).ln();
        sum += log_term.exp();
    }
    sum.min(1.0)
}

/// Value that a sum of squares with `freedom` degrees, an even number, exceeds with this probability where its deviations were
/// estimated with `estimated` degrees; by bisection.
#[must_use]
pub fn quantile_estimated(probability: f64, freedom: usize, estimated: f64) -> f64 {
    let exceeds = |value: f64| exceedance_estimated(value, freedom, estimated) > probability;
    let (mut low, mut high) = (0.0, quantile(probability, freedom));
    while high < 1e300 && exceeds(high) {
        high *= 2.0;
    }
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if exceeds(middle) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Value that a sum of squares with `freedom` degrees, an even number, exceeds with this probability; `estimated` are the degrees
/// that its deviations were estimated with, none where they are known.
#[must_use]
pub fn quantile_of(probability: f64, freedom: usize, estimated: Option<f64>) -> f64 {
    estimated.map_or_else(|| quantile(probability, freedom), |known| quantile_estimated(probability, freedom, known))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six times the values of Abramowitz & Stegun, table 26.9, to more digits.
    #[test]
    fn quantiles_with_estimated_deviations_are_those_of_f() {
        for (probability, freedom, estimated, value) in [
            (0.05, 6, 10.0, 19.303_047),
            (0.01, 6, 15.0, 25.909_638),
            (0.01, 6, 2.0, 595.995_53),
            (0.01, 6, 1e9, 16.811_894),
            (0.001, 18, 22.5, 73.772_612),
        ] {
            let found = quantile_estimated(probability, freedom, estimated);
            assert!((found / value - 1.0).abs() < 1e-5, "{found} for {probability} {freedom} {estimated}");
        }
        assert!(exceedance_estimated(f64::INFINITY, 6, 10.0) < 1e-12 && (exceedance_estimated(0.0, 6, 10.0) - 1.0).abs() < 1e-15);
    }

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
