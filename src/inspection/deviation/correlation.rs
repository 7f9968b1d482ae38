//! Noise that neighbouring points of a scan share: the number of points of a footprint that count as one.
//!
//! The variance of the mean of n points whose noise is correlated is σ² c/n, c = Π_axis (1 + 2 Σ_h (1 − h/w) ρ(h)) for a footprint of
//! w × w cells, w = √n, and a correlation that is the product of those along rows and columns (G. V. Bayley, J. M. Hammersley, "The
//! 'effective' number of independent observations in an autocorrelated time series", Suppl. J. R. Stat. Soc. 8, 1946). No shape of ρ is
//! assumed: that of a first-order autoregression, (1 + ρ)/(1 − ρ), takes noise averaged over 3 × 3 cells for 25 points instead of 9.
//!
//! ρ is estimated from runs of [`RUN`] neighbouring distances, less the straight line through each: what a pose is off and how the part is
//! bent is no noise. The line takes some of the correlation with it. The mean products of residuals at lag h are M c, c the covariances at
//! lags up to [`MAX_LAG`] and M known from the projection: c is solved for, without bias where there is no correlation beyond that lag. A
//! longer one, or waviness of the surface longer than a run, is indistinguishable from form, and counts only in part; waviness within
//! a run counts as noise, on the safe side. Correlations below [`MIN_CORRELATION`] end the sum.
//!
//! All scans are taken together, each scaled by its own variance. Clouds that were merged are treated alike, on the grid that they have
//! been projected to. With fewer runs than [`MIN_RUNS`] along both axes points count as independent; with few along one, the other's
//! correlations stand for both.

use std::array;

use nalgebra::{DMatrix, DVector, Vector3};

use super::footprint::ViewDistances;
use super::sums::median;

/// Points of a run: three times the longest lag, so that a line takes little of it.
const RUN: usize = 24;
/// Longest lag at which a correlation is looked for, cells: structured light is taken to share noise over one to five pixels.
const MAX_LAG: usize = 8;
/// Runs of a scan along each axis, evenly chosen of all.
const MAX_RUNS: usize = 400;
/// Runs of all scans along an axis from which on their correlations count.
const MIN_RUNS: usize = 30;
/// Multiple of a scan's median variance of runs beyond which one crosses an edge or a flaw, and is left out.
const MAX_VARIANCES: f64 = 3.0;
/// Minimum correlation that counts; no source. It, and [`MIN_DEVIATIONS`], keep independent noise from seeming correlated.
const MIN_CORRELATION: f64 = 0.05;
/// Minimum correlation that counts, in standard deviations 1/√points of that of independent noise (M. S. Bartlett, "On the
/// theoretical specification and sampling properties of autocorrelated time-series", Suppl. J. R. Stat. Soc. 8, 1946).
const MIN_DEVIATIONS: f64 = 4.0;

/// Sums over runs along one axis.
#[derive(Clone, Copy, Default)]
struct LagSums {
    /// Mean products of residuals at each lag, in the scan's variance.
    products: [f64; MAX_LAG + 1],
    runs: usize,
}

/// Runs of all scans, along rows and along columns.
#[derive(Clone, Copy, Default)]
pub(super) struct NoiseRuns([LagSums; 2]);

impl NoiseRuns {
    /// Adds the runs of a scan.
    pub(super) fn add(&mut self, distances: &ViewDistances, normals: &[Vector3<f64>]) {
        for (sums, is_down) in self.0.iter_mut().zip([false, true]) {
            sums.add(&distances.runs::<RUN>(is_down, normals, MAX_RUNS));
        }
    }

    /// Correlations that they show.
    pub(super) fn correlation(&self) -> NoiseCorrelation {
        let [rows, columns] = self.0.map(|sums| sums.correlations());
        let either = rows.clone().or_else(|| columns.clone()).unwrap_or_default();
        NoiseCorrelation([rows, columns].map(|own| own.unwrap_or_else(|| either.clone())))
    }
}

impl LagSums {
    fn add(&mut self, runs: &[[f64; RUN]]) {
        let products: Vec<[f64; MAX_LAG + 1]> = runs.iter().map(|run| lagged(&without_line(run))).collect();
        let typical = median(products.iter().map(|own| own[0]).collect()).unwrap_or_default();
        if typical <= 0.0 {
            return;
        }
        for own in products.iter().filter(|own| own[0] <= MAX_VARIANCES * typical) {
            for (sum, product) in self.products.iter_mut().zip(own) {
                *sum += product / typical;
            }
            self.runs += 1;
        }
    }

    /// Correlations from lag 1 on, up to the first that does not count; `None` of too few runs.
    fn correlations(&self) -> Option<Vec<f64>> {
        if self.runs < MIN_RUNS {
            return None;
        }
        let covariances = products_of_covariances().lu().solve(&DVector::from_column_slice(&self.products))?;
        let least = MIN_CORRELATION.max(MIN_DEVIATIONS / ((self.runs * RUN) as f64).sqrt());
        let correlations = covariances.iter().skip(1).map(|covariance| covariance / covariances[0]);
        (covariances[0] > 0.0).then(|| correlations.take_while(|own| *own >= least).map(|own| own.min(1.0)).collect())
    }
}

/// Residuals of a run from the straight line through it, by least squares.
fn without_line(run: &[f64; RUN]) -> [f64; RUN] {
    let mean = run.iter().sum::<f64>() / RUN as f64;
    let slope = run.iter().enumerate().map(|(place, value)| from_middle(place) * value).sum::<f64>() / lever_squares();
    array::from_fn(|place| run[place] - mean - from_middle(place) * slope)
}

/// Place in a run, from its middle.
fn from_middle(place: usize) -> f64 {
    place as f64 - 0.5 * (RUN - 1) as f64
}

/// Sum of the squares of the places in a run.
fn lever_squares() -> f64 {
    (0..RUN).map(|place| from_middle(place).powi(2)).sum()
}

/// Mean products of a run's values at each lag.
fn lagged(run: &[f64; RUN]) -> [f64; MAX_LAG + 1] {
    array::from_fn(|lag| run.iter().zip(&run[lag..]).map(|(one, other)| one * other).sum::<f64>() / (RUN - lag) as f64)
}

/// Expected mean products of residuals at each lag, rows, by a covariance of 1 at each lag, columns.
fn products_of_covariances() -> DMatrix<f64> {
    let squares = lever_squares();
    let residual = DMatrix::from_fn(RUN, RUN, |row, column| {
        let own = if row == column { 1.0 } else { 0.0 };
        own - 1.0 / RUN as f64 - from_middle(row) * from_middle(column) / squares
    });
    let mut products = DMatrix::zeros(MAX_LAG + 1, MAX_LAG + 1);
    for from in 0..=MAX_LAG {
        let covariance = DMatrix::from_fn(RUN, RUN, |row, column| if row.abs_diff(column) == from { 1.0 } else { 0.0 });
        let of_residuals = &residual * covariance * &residual;
        for lag in 0..=MAX_LAG {
            let sum: f64 = (0..RUN - lag).map(|place| of_residuals[(place, place + lag)]).sum();
            products[(lag, from)] = sum / (RUN - lag) as f64;
        }
    }
    products
}

/// Correlations of the noise of neighbours, along rows and along columns: at lag 1, 2 and so on, 0 beyond the last.
#[derive(Clone, Debug, Default)]
pub(super) struct NoiseCorrelation([Vec<f64>; 2]);

impl NoiseCorrelation {
    /// Number of points of a footprint of so many that count as one: 1 of independent noise, and no more than there are.
    pub(super) fn shared_points(&self, points: f64) -> f64 {
        let width = points.sqrt();
        let along = |correlations: &Vec<f64>| -> f64 {
            let weighted = |(place, own): (usize, &f64)| (1.0 - (place + 1) as f64 / width).max(0.0) * own;
            1.0 + 2.0 * correlations.iter().enumerate().map(weighted).sum::<f64>()
        };
        self.0.iter().map(along).product::<f64>().clamp(1.0, points.max(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspection::shots::normal;

    /// Runs of a noise that is averaged over so many neighbours.
    fn averaged(over: usize) -> NoiseRuns {
        let value = |place: usize| (0..over).map(|beside| normal((place + beside) as u64)).sum::<f64>() / (over as f64).sqrt();
        // A slope is none of the noise.
        let run = |number: usize| array::from_fn(|place| value(number * 2 * RUN + place) + 0.3 * place as f64);
        let runs: Vec<[f64; RUN]> = (0..MAX_RUNS).map(run).collect();
        let mut sums = LagSums::default();
        sums.add(&runs);
        NoiseRuns([sums; 2])
    }

    #[test]
    fn noise_averaged_over_neighbours_counts_once_for_about_as_many() {
        let shared = |over: usize| averaged(over).correlation().shared_points(1e12);
        assert!((shared(1) - 1.0).abs() < 1e-12, "{}", shared(1));
        for (over, wanted) in [(2, 4.0), (3, 9.0), (5, 25.0)] {
            assert!((shared(over) / wanted - 1.0).abs() < 0.3, "{over}: {}", shared(over));
        }
    }

    #[test]
    fn no_more_points_are_shared_than_there_are() {
        let correlation = averaged(5).correlation();
        for points in [1.0, 2.0, 4.0, 9.0] {
            let shared = correlation.shared_points(points);
            assert!((1.0..=points).contains(&shared), "{shared} of {points}");
        }
    }

    #[test]
    fn few_runs_show_no_correlation_and_those_along_one_axis_stand_for_both() {
        assert!((NoiseRuns::default().correlation().shared_points(1e12) - 1.0).abs() < 1e-12);
        let NoiseRuns([known, _]) = averaged(3);
        for runs in [[known, LagSums::default()], [LagSums::default(), known]] {
            let shared = NoiseRuns(runs).correlation().shared_points(1e12);
            assert!((shared / 9.0 - 1.0).abs() < 0.3, "{shared}");
        }
    }
}
