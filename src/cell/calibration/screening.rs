//! Bad observations told from good ones: consensus of sets of four (M. A. Fischler, R. C. Bolles, *Random Sample Consensus*, Comm. ACM
//! 24(6), 1981, with the bounded cost of P. H. S. Torr, A. Zisserman, *MLESAC*, CVIU 78(1), 2000), then a gate on χ² of six degrees,
//! three times. A loss that bounds outliers alone was measured not to be enough. Costs 60 small refinements; where deviations are
//! estimated, also one of all observations for each dropped one that is tried again.

use super::chi_squared::{exceedance, quantile, quantile_of};
use super::data::{ChainEstimate, Sighting, Sigma, SigmaSource, Weighting};
use super::refine::{Adjustment, Free, Refined};
use crate::geometry::sort_ascending;

/// Sets of four that are tried: with three good observations of four, all 60 contain a bad one in 1 of 10⁹ cases.
const DRAWS: usize = 60;
/// Observations of a set.
const SET: usize = 4;
/// Probability with which a good observation is dropped.
const FALSE_DROP: f64 = 0.0005;
/// Rounds of gating.
const GATES: usize = 3;
/// Probability of the residuals below which the deviations that were given do not explain them.
const UNEXPLAINED_P: f64 = 1e-3;
/// Ratio to the gate up to which a dropped observation is tried again.
const MAX_READMITTED: f64 = 4.0;
/// Dropped observations refused in a row after which the rest, which fits worse, is not tried: each try refines from all others.
const MAX_REFUSED: usize = 32;
/// Ratio of the residuals' median to the one expected beyond which the given deviations are taken for too small.
const MAX_SCALE: f64 = 2.5;

/// Factor by which deviations that are estimated from more observations may be larger than those from fewer: wrong observations
/// make them many times as large.
const MAX_WIDENED: f64 = 3.0;

/// Outcome of the screening.
#[derive(Clone, Debug)]
pub struct Screened {
    /// Refined from the good observations alone.
    pub refined: Refined,
    /// Observations that were used.
    pub is_used: Vec<bool>,
    /// Factor by which the deviations that were given had to grow for most observations to agree; 1 if they did not.
    pub sigma_scale: f64,
    /// True if the deviations were estimated from the residuals: with too few observations they stay those that the estimate
    /// begins with, times one factor.
    pub is_sigma_estimated: bool,
}

impl Screened {
    /// Source of the deviations, where some were given and where none were.
    #[must_use]
    pub fn source(&self, is_given: bool) -> SigmaSource {
        match (is_given, self.is_sigma_estimated) {
            (true, _) if self.sigma_scale > 1.0 => SigmaSource::Enlarged,
            (true, _) => SigmaSource::Given,
            (false, true) => SigmaSource::Estimated,
            (false, false) => SigmaSource::Assumed,
        }
    }

    /// Degrees of freedom that the deviations were estimated with; none where they were given.
    #[must_use]
    pub fn sigma_freedom(&self, is_given: bool) -> Option<f64> {
        self.source(is_given).freedom(self.refined.freedom())
    }

    /// Whitened square up to which an observation that was not used agrees with the others: by how well the deviations are known.
    #[must_use]
    pub fn bound_of_others(&self, is_given: bool) -> f64 {
        quantile_of(FALSE_DROP, 6, self.sigma_freedom(is_given))
    }

    /// Number of observations used.
    fn used(&self) -> usize {
        self.is_used.iter().filter(|used| **used).count()
    }

    /// Deviations and covariance as large as the residuals of whole poses ask for, where those that were given do not explain them.
    /// Points of one cloud share errors that their own scatter does not show: poses are the clusters of the covariance (K.-Y. Liang,
    /// S. L. Zeger, *Longitudinal data analysis using generalized linear models*, Biometrika 73(1), 1986, section 3), and each is one
    /// observation here.
    #[must_use]
    pub fn inflated(self) -> Self {
        let (factor, freedom) = (self.refined.variance_factor(), self.refined.freedom());
        let p = exceedance(self.refined.chi2.iter().sum(), freedom);
        if p >= UNEXPLAINED_P || factor <= 1.0 {
            return self;
        }
        let sigma_scale = self.sigma_scale * factor.sqrt();
        Self { sigma_scale, ..self.scaled(factor) }
    }

    /// Deviations and covariance as large as the residuals ask for, and the assumed ones at least, where none were given and the
    /// observations are too few to tell their parts apart: of three poses with residuals of 2.1 mm the scanner's place was said to be known to
    /// 0.33 mm, by deviations of 0.1 mm that nobody had measured.
    #[must_use]
    pub fn widened(self) -> Self {
        let factor = self.refined.variance_factor().max(1.0);
        let chi2 = self.refined.chi2.iter().map(|square| square / factor).collect();
        let scaled = self.scaled(factor);
        let refined = Refined { chi2, cost: scaled.refined.cost / factor, ..scaled.refined };
        Self { refined, ..scaled }
    }

    /// Variances and covariance times a factor.
    fn scaled(self, factor: f64) -> Self {
        let weighting = self.refined.weighting.scaled(factor);
        let refined = Refined { covariance: self.refined.covariance * factor, weighting, ..self.refined };
        Self { refined, ..self }
    }
}

/// Stream of numbers that is the same everywhere: SplitMix64 (G. L. Steele, D. Lea, C. H. Flood, *Fast splittable pseudorandom number
/// generators*, OOPSLA 2014).
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % count.max(1) as u64) as usize
    }

    /// Indices below `count`, each once.
    fn set(&mut self, count: usize) -> Vec<usize> {
        let mut chosen = Vec::with_capacity(SET);
        while chosen.len() < SET.min(count) {
            let next = self.below(count);
            if !chosen.contains(&next) {
                chosen.push(next);
            }
        }
        chosen
    }
}

/// Question to a screening: observations, unknowns, how to start from some of them, and the deviations.
pub struct Screening<'a> {
    /// Observations.
    pub sightings: &'a [Sighting],
    /// Unknowns.
    pub free: Free,
    /// Closed form of a start.
    pub start: &'a dyn Fn(&[Sighting]) -> Option<ChainEstimate>,
    /// Deviations, or where their estimate begins.
    pub weighting: Weighting,
    /// Deviations are to be estimated.
    pub estimate_sigma: bool,
}

impl Screening<'_> {
    /// Finds the observations that agree, and refines from them. None where no set of observations determines the unknowns.
    ///
    /// A set of four may leave the unknowns so open that all others agree with it, and nothing comes of it: then all begin together.
    /// So they do where deviations are estimated and some were dropped: which few agree by chance, and so which deviations come out,
    /// would else depend on the order of the observations.
    #[must_use]
    pub fn screen(&self) -> Option<Screened> {
        let Some(chosen) = self.consensus().and_then(|(set, median)| self.screened_from(&set, median)) else {
            return self.screened_together();
        };
        if !self.estimate_sigma || chosen.used() == self.sightings.len() {
            return Some(chosen);
        }
        let widened = |together: &Screened| self.mean_deviation(together) / self.mean_deviation(&chosen);
        let is_better = |together: &Screened| together.used() > chosen.used() && widened(together) <= MAX_WIDENED;
        Some(self.screened_together().filter(is_better).unwrap_or(chosen))
    }

    /// Gates, from all observations.
    fn screened_together(&self) -> Option<Screened> {
        let all: Vec<usize> = (0..self.sightings.len()).collect();
        let refined = self.refined_by(self.sightings, &self.weighting)?;
        let mut squares: Vec<f64> = self.sightings.iter().map(|each| self.own_square(&refined, each)).collect();
        squares.sort_by(f64::total_cmp);
        self.screened_from(&all, squares[all.len() / 2])
    }

    /// Geometric mean of the six deviations of an observation, over all observations; only its ratio to another has a meaning.
    fn mean_deviation(&self, screened: &Screened) -> f64 {
        let Refined { estimate, weighting, .. } = &screened.refined;
        let ln_det = |each: &Sighting| weighting.covariance(estimate, each).determinant().max(f64::MIN_POSITIVE).ln();
        let mean = self.sightings.iter().map(ln_det).sum::<f64>() / self.sightings.len().max(1) as f64;
        (mean / 12.0).exp()
    }

    /// Gates, from observations that agree; `median` is that of all whitened squares beside them.
    ///
    /// Four observations may fit better by chance than their deviations allow, and the others would be dropped by the deviations of
    /// those four. Where they stay too few to estimate deviations from, no smaller ones than assumed are taken.
    fn screened_from(&self, first: &[usize], median: f64) -> Option<Screened> {
        let expected = quantile(0.5, 6);
        let scale = (median / expected).sqrt();
        let sigma_scale = if self.estimate_sigma || scale > MAX_SCALE { scale.max(1e-9) } else { 1.0 };
        let screened = self.gated(first, sigma_scale)?;
        if !self.estimate_sigma {
            return self.gated_as_explained(screened);
        }
        let is_below_assumed = !screened.is_sigma_estimated && sigma_scale < 1.0;
        let screened = if is_below_assumed { self.gated(first, 1.0)? } else { screened };
        let screened = if screened.is_sigma_estimated { screened } else { screened.widened() };
        Some(self.readmitted(Screened { sigma_scale: 1.0, ..screened }))
    }

    /// Gates, from observations that agree, with the deviations times a factor until they are estimated.
    fn gated(&self, first: &[usize], sigma_scale: f64) -> Option<Screened> {
        let weighting = self.weighting.scaled(sigma_scale.powi(2));
        let mut is_used = vec![false; self.sightings.len()];
        first.iter().for_each(|index| is_used[*index] = true);
        let refined = self.refined_by(&self.chosen(first), &weighting)?;
        let mut screened = Screened { refined, is_used, sigma_scale, is_sigma_estimated: false };
        for round in 0..GATES {
            let is_used = self.gate(&screened);
            let used: Vec<Sighting> =
                self.sightings.iter().zip(&is_used).filter(|(_, used)| **used).map(|(each, _)| each.clone()).collect();
            // With few observations the four deviations are not told apart.
            let is_sigma_estimated = self.estimate_sigma && 6 * used.len() >= self.free.count() + 12 && round > 0;
            let problem = Adjustment { sightings: &used, free: self.free, prior: None };
            let (at, weighting) = (&screened.refined.estimate, &screened.refined.weighting);
            let refined =
                if is_sigma_estimated { problem.refine_with_sigma(at, weighting)? } else { problem.refine(at, weighting)? };
            screened = Screened { refined, is_used, sigma_scale, is_sigma_estimated };
        }
        Some(screened)
    }

    /// Gates anew with deviations that explain the observations used, where those that were given do not: too small ones drop good
    /// observations.
    fn gated_as_explained(&self, mut screened: Screened) -> Option<Screened> {
        for _ in 0..GATES {
            let before = screened.sigma_scale;
            screened = screened.inflated();
            if screened.sigma_scale <= before {
                break;
            }
            let is_used = self.gate(&screened);
            if is_used == screened.is_used {
                break;
            }
            let used: Vec<Sighting> =
                self.sightings.iter().zip(&is_used).filter(|(_, used)| **used).map(|(each, _)| each.clone()).collect();
            let problem = Adjustment { sightings: &used, free: self.free, prior: None };
            let refined = problem.refine(&screened.refined.estimate, &screened.refined.weighting)?;
            screened = Screened { refined, is_used, ..screened };
        }
        Some(screened)
    }

    /// Takes dropped observations back, the nearest first, that agree once the deviations are estimated with them: deviations that
    /// were estimated without the larger residuals are too small, and would keep good ones out for ever.
    fn readmitted(&self, mut screened: Screened) -> Screened {
        let mut dropped: Vec<(f64, usize)> = (0..self.sightings.len())
            .filter(|index| !screened.is_used[*index])
            .map(|index| (screened.refined.chi2_of_other(&self.sightings[index]), index))
            .filter(|(square, _)| *square < MAX_READMITTED * quantile(FALSE_DROP, 6))
            .collect();
        sort_ascending(&mut dropped, |sighting| sighting.0);
        offer(dropped.into_iter().map(|(_, index)| index), |index| {
            let mut is_used = screened.is_used.clone();
            is_used[index] = true;
            let used: Vec<Sighting> =
                self.sightings.iter().zip(&is_used).filter(|(_, used)| **used).map(|(each, _)| each.clone()).collect();
            let problem = Adjustment { sightings: &used, free: self.free, prior: None };
            let refined = problem.refine_with_sigma(&screened.refined.estimate, &screened.refined.weighting);
            let is_inside = |refined: &Refined| self.own_square(refined, &self.sightings[index]) < quantile(FALSE_DROP, 6);
            let Some(refined) = refined.filter(is_inside) else { return false };
            screened = Screened { refined, is_used, sigma_scale: screened.sigma_scale, is_sigma_estimated: true };
            true
        });
        screened
    }

    fn chosen(&self, indices: &[usize]) -> Vec<Sighting> {
        indices.iter().map(|index| self.sightings[*index].clone()).collect()
    }

    fn refined_by(&self, set: &[Sighting], weighting: &Weighting) -> Option<Refined> {
        Adjustment { sightings: set, free: self.free, prior: None }.refine_in_rounds(&(self.start)(set)?, weighting, 1)
    }

    /// Set of four that most observations agree with, and the median of all whitened squares there.
    fn consensus(&self) -> Option<(Vec<usize>, f64)> {
        let count = self.sightings.len();
        let (bound, mut numbers) = (quantile(FALSE_DROP, 6), Numbers(0));
        let draws = (0..DRAWS).filter_map(|_| {
            let set = numbers.set(count);
            let refined = self.refined_by(&self.chosen(&set), &self.weighting)?;
            let predictions: Option<Vec<_>> = self.sightings.iter().map(|each| refined.prediction(each)).collect();
            let (mut squares, mut widths): (Vec<f64>, Vec<f64>) = predictions?.into_iter().unzip();
            squares.sort_by(f64::total_cmp);
            widths.sort_by(f64::total_cmp);
            let median = squares[count / 2];
            let cost = if self.estimate_sigma {
                // −2 ln of the likelihood of an observation in the middle, at the scale of the deviations that makes it largest. The
                // square alone would choose a set that leaves the unknowns open, with which everything agrees.
                6.0 * median.max(f64::MIN_POSITIVE).ln() + widths[count / 2]
            } else {
                squares.iter().map(|square| square.min(bound)).sum()
            };
            // Of sets that all fail the bound the median decides.
            let spread = refined.covariance.fixed_view::<6, 6>(0, 0).trace() + refined.covariance.trace();
            spread.is_finite().then_some((cost, median, set))
        });
        let best = draws.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)))?;
        Some((best.2, best.1))
    }

    /// Observations within the gate; those that were not used have the uncertainty of the unknowns added, and are judged by how
    /// well the deviations are known: of a few observations they are often too small, and would keep good ones out.
    fn gate(&self, screened: &Screened) -> Vec<bool> {
        let refined = &screened.refined;
        let (own, other) = (quantile(FALSE_DROP, 6), screened.bound_of_others(!self.estimate_sigma));
        let inside = |(sighting, used): (&Sighting, &bool)| match *used {
            true => self.own_square(refined, sighting) < own,
            false => refined.chi2_of_other(sighting) < other,
        };
        let found: Vec<bool> = self.sightings.iter().zip(&screened.is_used).map(inside).collect();
        // Fewer than a set determine nothing: stay.
        if found.iter().filter(|used| **used).count() >= SET.min(self.sightings.len()) { found } else { screened.is_used.clone() }
    }

    fn own_square(&self, refined: &Refined, sighting: &Sighting) -> f64 {
        refined.linear(sighting).map_or(f64::INFINITY, |each| each.residual.dot(&(each.weight * each.residual)))
    }
}

/// Offers observations in turn, until [`MAX_REFUSED`] in a row are not taken.
fn offer(indices: impl Iterator<Item = usize>, mut is_taken: impl FnMut(usize) -> bool) {
    let mut refused = 0;
    for index in indices {
        refused = if is_taken(index) { 0 } else { refused + 1 };
        if refused == MAX_REFUSED {
            break;
        }
    }
}

/// Deviations that a screening begins with where none are given.
#[must_use]
pub fn sigma_or_default(sigma: Option<Sigma>) -> Sigma {
    sigma.unwrap_or(Sigma::CALIBRATED_ARM)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dropped_observations_are_tried_again_until_many_in_a_row_are_refused() {
        let tried = |is_taken: &dyn Fn(usize) -> bool| {
            let mut count = 0_usize;
            offer(0..1000, |index| {
                count += 1;
                is_taken(index)
            });
            count
        };
        assert_eq!(tried(&|_| false), MAX_REFUSED, "the rest fits worse");
        assert_eq!(tried(&|index| index == 20), 21 + MAX_REFUSED, "one that is taken changes what fits");
        assert_eq!(tried(&|index| index % MAX_REFUSED == 0), 1000);
    }
}
