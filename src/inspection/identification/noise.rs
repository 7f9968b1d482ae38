//! Noise of the points: σ_F and g of [`crate::planning::surface::requirements`], from three neighbours of a row that lie on one
//! plane. Their second difference d = (p_b − (p_a + p_c) / 2) · n / √1.5 has the deviation of one point across the surface, whatever
//! the error of pose, shape or calibration. With w = d · cos i and u = ((z − F) / D)², w is normal with the deviation σ_F (1 + g·u):
//! maximum likelihood of both. For a given g the best σ_F² is the mean of (w / (1 + g·u))²; g is then found by golden section, and
//! the intervals follow from the Fisher information, [2n, 2Σa; 2Σa, 2Σa²] of (ln σ_F, g) with a = u / (1 + g·u).
//!
//! Triples at one depth determine σ_F (1 + g·u) alone: the information is singular, and neither of the two is identified (T. J.
//! Rothenberg, *Identification in Parametric Models*, Econometrica 39, 1971, 577–591). σ_F then lies between its best values for
//! the least and the largest g. Its interval has these ends, widened by the deviation of ln σ_F for a given g, 1 / √(2n) (G. W.
//! Imbens, C. F. Manski, *Confidence Intervals for Partially Identified Parameters*, Econometrica 72, 2004, 1845–1857). An interval
//! by the Fisher information is cut to that one, as it is far beyond where the depths are nearly the same.

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
pub(super) const SIGMAS_OF_INTERVAL: f64 = 1.96;
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
    /// σ_F, mm; the largest that fits where g is not determined.
    pub best_mm: Identified,
    /// g; 0, with an interval as wide as the range of the parameter, where it is not determined.
    pub depth_gain: Identified,
    /// False where the triples lie at one depth, or nearly so, and do not determine g.
    pub is_gain_determined: bool,
    /// Triples that it is from.
    pub triples: usize,
    /// Triples left out as steps of the surface.
    pub outliers: usize,
}

/// w and u of a triple.
type Scaled = [f64; 2];

/// Identifies the noise of a scanner; `None` from fewer than [`MIN_TRIPLES`]. Cost: about 60 passes over the triples.
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
    let [mut of_log, mut of_gain] = deviations(&kept, gain);
    let [largest_mm, least_mm] = [0.0, MAX_DEPTH_GAIN].map(|gain| squared(&kept, gain).sqrt());
    let is_gain_determined = SIGMAS_OF_INTERVAL * of_gain < gain.max(MAX_DEPTH_GAIN - gain);
    if !is_gain_determined {
        (best_mm, gain, of_log, of_gain) = (largest_mm, 0.0, f64::INFINITY, f64::INFINITY);
    }
    let spread = (SIGMAS_OF_INTERVAL * of_log).exp();
    let of_ends = (SIGMAS_OF_INTERVAL / (2.0 * kept.len() as f64).sqrt()).exp();
    let interval_mm = [(best_mm / spread).max(least_mm / of_ends), (best_mm * spread).min(largest_mm * of_ends)];
    let reach = (SIGMAS_OF_INTERVAL * of_gain).min(MAX_DEPTH_GAIN);
    Some(NoiseEstimate {
        best_mm: Identified { value: best_mm, interval: interval_mm },
        depth_gain: Identified { value: gain, interval: [(gain - reach).max(0.0), (gain + reach).min(MAX_DEPTH_GAIN)] },
        is_gain_determined,
        triples: kept.len(),
        outliers,
    })
}

/// σ_F² of greatest likelihood for a given g.
fn squared(triples: &[Scaled], gain: f64) -> f64 {
    triples.iter().map(|[w, u]| (w / (1.0 + gain * u)).powi(2)).sum::<f64>() / triples.len() as f64
}

/// σ_F and g of greatest likelihood.
fn fit(triples: &[Scaled]) -> (f64, f64) {
    let cost = |gain: f64| {
        let logs: f64 = triples.iter().map(|[_, u]| (1.0 + gain * u).ln()).sum();
        0.5 * squared(triples, gain).max(f64::MIN_POSITIVE).ln() + logs / triples.len() as f64
    };
    // On the logarithm of 1 + g, over which the likelihood is nearly even.
    let log_gain = golden_section(0.0, MAX_DEPTH_GAIN.ln_1p(), |log| cost(log.exp_m1()));
    let gain = log_gain.exp_m1();
    (squared(triples, gain).sqrt(), gain)
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

/// Standard deviations of ln σ_F and of g; infinite where the triples lie at one depth.
fn deviations(triples: &[Scaled], gain: f64) -> [f64; 2] {
    let n = triples.len() as f64;
    let a = triples.iter().map(|[_, u]| u / (1.0 + gain * u));
    let (sum, squares) = a.fold((0.0, 0.0), |(sum, squares), a| (sum + a, squares + a * a));
    let determinant = 4.0 * (n * squares - sum * sum);
    // At one depth neither can be told from the other.
    if determinant <= 1e-9 * n * n {
        return [f64::INFINITY; 2];
    }
    [(2.0 * squares / determinant).sqrt(), (2.0 * n / determinant).sqrt()]
}
