//! Student's distribution, by which what few observations tell is stated.

/// 97.5 % quantile of the normal distribution.
const NORMAL: f64 = 1.959_964;
/// 97.5 % quantiles of Student's distribution for 1 to 9 degrees of freedom (M. Abramowitz, I. A. Stegun, *Handbook of Mathematical
/// Functions*, 1964, table 26.10).
const OF_FEW: [f64; 9] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262];

/// 97.5 % quantile of Student's distribution: of ten degrees of freedom and more by its expansion about the normal quantile z,
/// z + (z³ + z)/4ν + (5z⁵ + 16z³ + 3z)/96ν² (Abramowitz & Stegun, 26.7.5), within 0.004; of fewer that of the whole number below, at
/// least 1.
pub(super) fn quantile(freedoms: f64) -> f64 {
    if freedoms < 10.0 {
        return OF_FEW[(freedoms as usize).clamp(1, 9) - 1];
    }
    let second = (5.0 * NORMAL.powi(5) + 16.0 * NORMAL.powi(3) + 3.0 * NORMAL) / (96.0 * freedoms * freedoms);
    NORMAL + (NORMAL.powi(3) + NORMAL) / (4.0 * freedoms) + second
}
