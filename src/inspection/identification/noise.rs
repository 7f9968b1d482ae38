//! Noise of the points: σ_F and g of [`crate::planning::surface::requirements`], from three neighbours of a row that lie on one
//! plane. Their second difference d = (p_b − (p_a + p_c) / 2) · n / √1.5 has the deviation of one point across the surface, whatever
//! the error of pose, shape or calibration. With w = d · cos i and u = ((z − F) / D)², w is normal with the deviation σ_F (1 + g·u):
//! maximum likelihood of both. For a given g the best σ_F² is the mean of (w / (1 + g·u))²; g is then found by golden section.
//!
//! The intervals are those of the profile likelihood (D. J. Venzon, S. H. Moolgavkar, *A Method for Computing
//! Profile-Likelihood-Based Confidence Intervals*, Applied Statistics 37(1), 1988, 87–94): of all values at which −ln of the
//! likelihood, least over the other unknown, exceeds its least by no more than half the 95 % quantile of χ² with one degree of
//! freedom. Those by the Fisher information at the estimate are far too short where that lies on its bound, g = 0. With λ(g) for
//! −ln of the likelihood a triple at the best σ_F of g, the interval of g ends where n (λ(g) − λ(ĝ)) is that half. At e^r times the
//! best σ_F, −ln of the likelihood is larger by n r², but for the third power of r: the interval of σ_F ends at the extremes of
//! σ_F(g) e^(±r(g)), where n r² is what n (λ(g) − λ(ĝ)) leaves of that half.
//!
//! Triples at one depth determine σ_F (1 + g·u) alone: the information is singular, and neither of the two is identified (T. J.
//! Rothenberg, *Identification in Parametric Models*, Econometrica 39, 1971, 577–591). σ_F then lies between its best values for
//! the least and the largest g. Its interval has these ends, widened by the deviation of ln σ_F for a given g, 1 / √(2n) (G. W.
//! Imbens, C. F. Manski, *Confidence Intervals for Partially Identified Parameters*, Econometrica 72, 2004, 1845–1857). The
//! profile likelihood gives the same, as λ is level.

use super::Identified;
use crate::cell::Scanner;

/// Fewest triples from which noise is identified: σ_F is then known to about 15 %.
pub const MIN_TRIPLES: usize = 100;
/// Largest g that is looked for: that of the parameter.
const MAX_DEPTH_GAIN: f64 = 100.0;
/// Deviations beyond which a triple is not noise but a step; of normal ones 7 in a million are beyond.
const OUTLIER_SIGMAS: f64 = 4.5;
/// Rounds in which such triples are left out.
const ROUNDS: usize = 8;
/// Deviations to either side that hold 95 % of a normal distribution.
const SIGMAS_OF_INTERVAL: f64 = 1.96;
/// Rise of −ln of the likelihood at the ends of an interval of 95 % confidence.
const RISE_OF_INTERVAL: f64 = 0.5 * SIGMAS_OF_INTERVAL * SIGMAS_OF_INTERVAL;
/// Largest deviation of a triple that may be noise at all, mm: beyond it, steps of depth begin.
const MAX_ACROSS_MM: f64 = 1.0;

/// Three neighbours on one plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseTriple {
    /// z of the middle one in the scanner's frame, mm.
    pub depth_mm: f64,
    /// Cosine of the incidence against the direction to the viewpoint.
    pub cos_incidence: f64,
    /// d, mm.
    pub across_mm: f64,
}

/// Identified noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseEstimate {
    /// σ_F, mm; that of the least g of the interval where g is not determined.
    pub best_mm: Identified,
    /// g; where it is not determined the least of its interval, which then reaches to the end of the parameter's range.
    pub depth_gain: Identified,
    /// False where the triples lie at one distance from the best focus, or nearly so, and set no upper end to g.
    pub is_gain_determined: bool,
    /// Triples that it is from.
    pub triples: usize,
    /// Triples left out as steps of the surface.
    pub outliers: usize,
}

/// w and u of a triple.
type Scaled = [f64; 2];

/// Identifies the noise of a scanner; `None` from fewer than [`MIN_TRIPLES`]. Cost: about 170 passes over the triples.
#[must_use]
pub fn noise(triples: &[NoiseTriple], scanner: &Scanner) -> Option<NoiseEstimate> {
    let half_mm = |depth_mm: f64| {
        if depth_mm < scanner.best_mm { scanner.best_mm - scanner.near_mm } else { scanner.far_mm - scanner.best_mm }
    };
    let scaled = |triple: &NoiseTriple| -> Scaled {
        let off = (triple.depth_mm - scanner.best_mm) / half_mm(triple.depth_mm);
        [triple.across_mm * triple.cos_incidence, off * off]
    };
    let all: Vec<Scaled> = triples.iter().filter(|triple| triple.across_mm.abs() <= MAX_ACROSS_MM).map(scaled).collect();
    let mut kept = all.clone();
    let (mut best_mm, mut gain) = (0.0, 0.0);
    for _ in 0..ROUNDS {
        if kept.len() < MIN_TRIPLES {
            return None;
        }
        (best_mm, gain) = fit(&kept);
        let is_noise = |[w, u]: &&Scaled| w.abs() <= OUTLIER_SIGMAS * best_mm * (1.0 + gain * u);
        let within: Vec<Scaled> = all.iter().filter(is_noise).copied().collect();
        let is_settled = within.len() == kept.len();
        kept = within;
        if is_settled {
            break;
        }
    }
    let outliers = triples.len() - kept.len();
    let [interval_mm, gains] = intervals(&kept, gain);
    let is_gain_determined = gains[1] < MAX_DEPTH_GAIN;
    if !is_gain_determined {
        (best_mm, gain) = (profile(&kept, gains[0]).0, gains[0]);
    }
    Some(NoiseEstimate {
        best_mm: Identified { value: best_mm, interval: interval_mm },
        depth_gain: Identified { value: gain, interval: gains },
        is_gain_determined,
        triples: kept.len(),
        outliers,
    })
}

/// σ_F of greatest likelihood for a given g, mm, and −ln of the likelihood a triple there, but for a constant.
fn profile(triples: &[Scaled], gain: f64) -> (f64, f64) {
    let each = triples.iter().map(|[w, u]| (w, 1.0 + gain * u));
    let sums = each.fold([0.0; 2], |[squares, logs], (w, growth)| [squares + (w / growth).powi(2), logs + growth.ln()]);
    let [square, log]: [f64; 2] = sums.map(|sum| sum / triples.len() as f64);
    (square.sqrt(), 0.5 * square.max(f64::MIN_POSITIVE).ln() + log)
}

/// σ_F and g of greatest likelihood.
fn fit(triples: &[Scaled]) -> (f64, f64) {
    // On the logarithm of 1 + g, over which the likelihood is nearly even.
    let log_gain = golden_section(0.0, MAX_DEPTH_GAIN.ln_1p(), |log| profile(triples, log.exp_m1()).1);
    let gain = log_gain.exp_m1();
    (profile(triples, gain).0, gain)
}

/// Intervals of σ_F, mm, and of g, whose value of greatest likelihood is given.
fn intervals(triples: &[Scaled], gain: f64) -> [[f64; 2]; 2] {
    let most = profile(triples, gain).1 + RISE_OF_INTERVAL / triples.len() as f64;
    let gains = [0.0, MAX_DEPTH_GAIN].map(|bound| bisection(gain, bound, |gain| profile(triples, gain).1 <= most));
    let end_mm = |sign: f64| {
        let at = |log: f64| {
            let (best_mm, cost) = profile(triples, log.exp_m1());
            best_mm * (sign * (most - cost).max(0.0).sqrt()).exp()
        };
        at(golden_section(gains[0].ln_1p(), gains[1].ln_1p(), |log| -sign * at(log)))
    };
    [[end_mm(-1.0), end_mm(1.0)], gains]
}

/// End of an interval of g towards a bound, from a g within it, to 10⁻⁶ of the way on the logarithm of 1 + g.
fn bisection(mut within: f64, bound: f64, is_within: impl Fn(f64) -> bool) -> f64 {
    const STEPS: usize = 20;
    if is_within(bound) {
        return bound;
    }
    let mut beyond = bound;
    for _ in 0..STEPS {
        let middle = ((1.0 + within) * (1.0 + beyond)).sqrt() - 1.0;
        if is_within(middle) {
            within = middle;
        } else {
            beyond = middle;
        }
    }
    within
}

/// Place of the least value between two places, to 10⁻⁶ of their distance (Kiefer 1953).
fn golden_section(mut from: f64, mut to: f64, cost: impl Fn(f64) -> f64) -> f64 {
    const SHARE: f64 = 0.618_033_988_749_894_9;
    const STEPS: usize = 29;
    let (mut low, mut high) = (to - SHARE * (to - from), from + SHARE * (to - from));
    let (mut of_low, mut of_high) = (cost(low), cost(high));
    for _ in 0..STEPS {
        if of_low <= of_high {
            (to, high, of_high) = (high, low, of_low);
            low = to - SHARE * (to - from);
            of_low = cost(low);
        } else {
            (from, low, of_low) = (low, high, of_high);
            high = from + SHARE * (to - from);
            of_high = cost(high);
        }
    }
    0.5 * (from + to)
}
