//! Normal equations of points against planes, of one view and of the arrow that views and part make.

use nalgebra::linalg::Cholesky;
use nalgebra::{DMatrix, DVector, Dyn, Matrix6, Vector6};

use super::FREEDOMS;
use super::locate::STATED_TURN_REACH_MM;
use super::matching::MatchedPoint;
use crate::cell::calibration::se3::Twist;

/// Share of the largest eigenvalue below which a freedom of a part alone is taken for one that nothing fixes.
const MIN_CONDITION: f64 = 1e-9;

/// H δ = −g of a view, in its right perturbation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct NormalEquations {
    pub(super) matrix: Matrix6<f64>,
    pub(super) gradient: Vector6<f64>,
}

impl Default for NormalEquations {
    fn default() -> Self {
        Self { matrix: Matrix6::zeros(), gradient: Vector6::zeros() }
    }
}

impl NormalEquations {
    /// Equations of pairs, weighted after Tukey within `radius_mm`.
    pub(super) fn of(pairs: &[MatchedPoint], radius_mm: f64) -> Self {
        let mut sum = Self::default();
        for pair in pairs {
            let weight = pair.weight(radius_mm);
            let row = pair.row();
            sum.matrix += row * row.transpose() * weight;
            sum.gradient += row * (weight * pair.distance_mm);
        }
        sum
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.matrix += other.matrix;
        self.gradient += other.gradient;
    }

    /// Equations in a perturbation that `map` takes to this one.
    pub(super) fn seen_from(&self, map: &Matrix6<f64>) -> Self {
        Self { matrix: map.transpose() * self.matrix * map, gradient: map.transpose() * self.gradient }
    }

    /// Least-squares step; freedoms that nothing fixes stay.
    pub(super) fn step(&self) -> Option<Twist> {
        pseudo_inverse(&self.matrix).map(|inverse| -(inverse * self.gradient))
    }
}

/// Mean observation of a cell by one view.
pub(super) struct CellMean {
    /// Index of the view.
    pub(super) view: usize,
    /// ∂r/∂δ in the view's right perturbation.
    pub(super) row: Twist,
    /// Signed distance, mm.
    pub(super) distance_mm: f64,
    /// 1/τ², τ the standard deviation of this mean among those of other views, mm⁻².
    pub(super) weight: f64,
}

/// Sum Σw + 1/σ² of a cell.
fn weight_of(means: &[CellMean], deviation_sd_mm: f64) -> f64 {
    means.iter().map(|mean| mean.weight).sum::<f64>() + deviation_sd_mm.powi(-2)
}

/// Adds the gradient of a cell whose surface deviates by an unknown d ~ N(0, σ²).
pub(super) fn add_gradient(gradient: &mut DVector<f64>, means: &[CellMean], deviation_sd_mm: f64) {
    // wᵀr / (Σw + 1/σ²): the deviation that fits best.
    let weighted_mm = means.iter().map(|mean| mean.weight * mean.distance_mm).sum::<f64>();
    let deviation_mm = weighted_mm / weight_of(means, deviation_sd_mm);
    for mean in means {
        let mut own = gradient.fixed_rows_mut::<FREEDOMS>(FREEDOMS * mean.view);
        own += mean.row * (mean.weight * (mean.distance_mm - deviation_mm));
    }
}

/// Views, the part below them, and what they observed together.
pub(super) struct Arrow {
    /// Normal equations of all views, six rows a view, in their right perturbations.
    matrix: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Normal equations with the priors of the poses: A = H + Λ.
    posterior: Cholesky<f64, Dyn>,
    posterior_gradient: DVector<f64>,
    /// Takes a step of the part to the steps of the views that move their points alike, six rows a view.
    views_from_part: DMatrix<f64>,
}

/// Normal equations under way.
pub(super) struct Observations {
    matrix: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl Observations {
    pub(super) fn of(views: usize) -> Self {
        let size = FREEDOMS * views;
        Self { matrix: DMatrix::zeros(size, size), gradient: DVector::zeros(size) }
    }

    /// Adds a cell whose surface deviates by an unknown d ~ N(0, σ²) that all views see alike. With d eliminated, the weight matrix of
    /// the means is W = diag(w) − w·wᵀ/(Σw + 1/σ²): one view alone counts 1/(τ² + σ²), the difference of two 1/(2τ²).
    pub(super) fn add(&mut self, means: &[CellMean], deviation_sd_mm: f64) {
        add_gradient(&mut self.gradient, means, deviation_sd_mm);
        let all = weight_of(means, deviation_sd_mm);
        for (index, mean) in means.iter().enumerate() {
            let at = FREEDOMS * mean.view;
            for other in &means[..=index] {
                let own = if mean.view == other.view { mean.weight } else { 0.0 };
                let block = mean.row * other.row.transpose() * (own - mean.weight * other.weight / all);
                let mut place = self.matrix.fixed_view_mut::<FREEDOMS, FREEDOMS>(at, FREEDOMS * other.view);
                place += block;
            }
        }
    }

    /// Arrow of these observations with priors, corrections so far, which the priors pull to zero, and the part's steps as each view
    /// sees them. `None` where a prior is none.
    pub(super) fn with(mut self, priors: &[Matrix6<f64>], corrections: &[Twist], from_part: &[Matrix6<f64>]) -> Option<Arrow> {
        self.matrix.fill_upper_triangle_with_lower_triangle();
        let (mut posterior, mut posterior_gradient) = (self.matrix.clone(), self.gradient.clone());
        let mut views_from_part = DMatrix::zeros(self.matrix.nrows(), FREEDOMS);
        for (view, (prior, correction)) in priors.iter().zip(corrections).enumerate() {
            let at = FREEDOMS * view;
            let mut block = posterior.fixed_view_mut::<FREEDOMS, FREEDOMS>(at, at);
            block += prior;
            let mut gradient = posterior_gradient.fixed_rows_mut::<FREEDOMS>(at);
            gradient += prior * correction;
            views_from_part.fixed_view_mut::<FREEDOMS, FREEDOMS>(at, 0).copy_from(&from_part[view]);
        }
        let (matrix, gradient, posterior) = (self.matrix, self.gradient, posterior.cholesky()?);
        Some(Arrow { matrix, gradient, posterior, posterior_gradient, views_from_part })
    }
}

/// Steps of part and views.
pub(super) struct Solved {
    pub(super) part_step: Twist,
    pub(super) steps: Vec<Twist>,
    part_covariance: Matrix6<f64>,
    /// Covariance of the part with the freedoms that no observation fixes.
    part_stated: Matrix6<f64>,
}

/// Covariances of the part and of each view's registered pose.
pub(super) struct Covariances {
    pub(super) part: Matrix6<f64>,
    /// Covariance of the part with the freedoms that no observation fixes.
    pub(super) part_stated: Matrix6<f64>,
    /// Covariance of the part by blocks of its surface.
    pub(super) part_by_blocks: Matrix6<f64>,
    pub(super) views: Vec<Matrix6<f64>>,
}

impl Arrow {
    /// Solves it: with B = H·M, the part sees Mᵀ(H − H A⁻¹ H)M. `None` where no observation is.
    pub(super) fn solve(&self, moves_part: bool) -> Option<Solved> {
        let seen = &self.matrix * &self.views_from_part;
        let follows = self.posterior.solve(&seen);
        let settled = self.posterior.solve(&self.posterior_gradient);
        let part = symmetric(&(self.views_from_part.tr_mul(&seen) - seen.tr_mul(&follows)));
        let gradient = self.views_from_part.tr_mul(&self.gradient) - seen.tr_mul(&settled);
        let (part_covariance, part_stated) = if moves_part {
            (pseudo_inverse(&part)?, bounded_inverse(&part, STATED_TURN_REACH_MM)?)
        } else {
            (Matrix6::zeros(), Matrix6::zeros())
        };
        let part_step = -(part_covariance * Twist::from_fn(|row, _| gradient[row]));
        let steps = -(settled + follows * part_step);
        let of_view = |view: usize| steps.fixed_rows::<FREEDOMS>(FREEDOMS * view).into_owned();
        Some(Solved { part_step, steps: (0..steps.len() / FREEDOMS).map(of_view).collect(), part_covariance, part_stated })
    }

    /// Covariance of each view's pose: that of ξ + M·η, of a view's own step and the part's. `block_gradients` are those of blocks of the
    /// surface.
    pub(super) fn covariances(&self, solved: &Solved, block_gradients: &[DVector<f64>]) -> Covariances {
        let part = solved.part_covariance;
        let inverse = self.posterior.inverse();
        // ξ = −A⁻¹(g + H M η): its noise beyond η's is A⁻¹, and it follows η by −A⁻¹ H M.
        let follows = &self.views_from_part - self.posterior.solve(&(&self.matrix * &self.views_from_part));
        let view = |at: usize| {
            let own = follows.fixed_view::<FREEDOMS, FREEDOMS>(at, 0);
            inverse.fixed_view::<FREEDOMS, FREEDOMS>(at, at) + own * part * own.transpose()
        };
        Covariances {
            part,
            part_stated: solved.part_stated,
            part_by_blocks: self.part_by_blocks(solved, block_gradients),
            views: (0..inverse.nrows()).step_by(FREEDOMS).map(view).collect(),
        }
    }

    /// Covariance of the part by what blocks of its surface say of its place against each other: Σ s·sᵀ·n/(n − 1) over the steps s by the
    /// gradients of n blocks (K.-Y. Liang, S. L. Zeger, "Longitudinal data analysis using generalized linear models", Biometrika 73(1),
    /// 1986, section 2). Where a surface deviates smoothly, its cells are far from independent, and their number says nothing.
    fn part_by_blocks(&self, solved: &Solved, gradients: &[DVector<f64>]) -> Matrix6<f64> {
        let seen = &self.matrix * &self.views_from_part;
        let mut sum = Matrix6::zeros();
        for gradient in gradients {
            let of_part = self.views_from_part.tr_mul(gradient) - seen.tr_mul(&self.posterior.solve(gradient));
            // A freedom that hardly anything fixes moves no farther than the part is known to lie.
            let step = solved.part_stated * Twist::from_fn(|row, _| of_part[row]);
            sum += step * step.transpose();
        }
        let blocks = gradients.len() as f64;
        if gradients.len() > 1 { sum * (blocks / (blocks - 1.0)) } else { Matrix6::zeros() }
    }

    /// Covariance of the views' steps at the part's place, and those steps.
    pub(super) fn of_views(&self) -> (DMatrix<f64>, DVector<f64>) {
        (self.posterior.inverse(), -self.posterior.solve(&self.posterior_gradient))
    }
}

/// Symmetric part of a matrix of six rows and columns.
fn symmetric(matrix: &DMatrix<f64>) -> Matrix6<f64> {
    Matrix6::from_fn(|row, column| 0.5 * (matrix[(row, column)] + matrix[(column, row)]))
}

/// Inverse on the freedoms that observations fix.
fn pseudo_inverse(matrix: &Matrix6<f64>) -> Option<Matrix6<f64>> {
    inverse_by(matrix, |value, largest| if value > MIN_CONDITION * largest { 1.0 / value } else { 0.0 })
}

/// Covariance of a part that is known to lie within so many millimetres, whatever the observations leave open.
fn bounded_inverse(matrix: &Matrix6<f64>, reach_mm: f64) -> Option<Matrix6<f64>> {
    let open_mm2 = reach_mm * reach_mm;
    inverse_by(matrix, |value, _| if value * open_mm2 > 1.0 { 1.0 / value } else { open_mm2 })
}

/// Matrix of the same axes with these values in place of the eigenvalues, of which `of` is given the largest too; rotations are measured
/// in steps that move points by millimetres.
fn inverse_by(matrix: &Matrix6<f64>, of: impl Fn(f64, f64) -> f64) -> Option<Matrix6<f64>> {
    let trace = |from: usize| (from..from + 3).map(|axis| matrix[(axis, axis)]).sum::<f64>();
    let (turn, shift) = (trace(0), trace(3));
    if !(turn > 0.0 && shift > 0.0 && turn.is_finite() && shift.is_finite()) {
        return None;
    }
    let arm = (turn / shift).sqrt();
    let scale = Matrix6::from_diagonal(&Vector6::new(arm, arm, arm, 1.0, 1.0, 1.0));
    let inverse_scale = Matrix6::from_diagonal(&Vector6::new(1.0 / arm, 1.0 / arm, 1.0 / arm, 1.0, 1.0, 1.0));
    let eigen = (inverse_scale * matrix * inverse_scale).symmetric_eigen();
    let largest = eigen.eigenvalues.max();
    let inverse = eigen.eigenvalues.map(|value| of(value, largest));
    let plain = eigen.eigenvectors * Matrix6::from_diagonal(&inverse) * eigen.eigenvectors.transpose();
    debug_assert!((scale * inverse_scale - Matrix6::identity()).norm() < 1e-9);
    Some(inverse_scale * plain * inverse_scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Standard deviation by which a cell deviates, mm.
    const DEVIATION_SD_MM: f64 = 0.18;

    /// Cell of a plate at z = 0, bent by 0.6 mm at x = ±50 mm, about its mean.
    fn bent(x_mm: f64, y_mm: f64) -> CellMean {
        let distance_mm = 0.6 * ((x_mm / 50.0).powi(2) - 0.33);
        CellMean { view: 0, row: Twist::new(y_mm, -x_mm, 0.0, 0.0, 0.0, 1.0), distance_mm, weight: 1e4 }
    }

    /// The place of a bent part was told as if each of its cells were off by itself.
    #[test]
    fn the_halves_of_a_bent_plate_leave_more_open_than_its_cells() {
        let along_mm = || (0..10).map(|number| 10.0 * f64::from(number) - 45.0);
        let mut observations = Observations::of(1);
        let mut gradients = [DVector::zeros(FREEDOMS), DVector::zeros(FREEDOMS)];
        for x_mm in along_mm() {
            for y_mm in along_mm() {
                observations.add(&[bent(x_mm, y_mm)], DEVIATION_SD_MM);
                add_gradient(&mut gradients[usize::from(x_mm > 0.0)], &[bent(x_mm, y_mm)], DEVIATION_SD_MM);
            }
            // Its edges hold it along x and y.
            for row in [Twist::new(0.0, 0.0, -x_mm, 1.0, 0.0, 0.0), Twist::new(0.0, 0.0, x_mm, 0.0, 1.0, 0.0)] {
                observations.add(&[CellMean { view: 0, row, distance_mm: 0.0, weight: 1e4 }], DEVIATION_SD_MM);
            }
        }
        let is_fixed = Matrix6::identity() * 1e15;
        let arrow = observations.with(&[is_fixed], &[Twist::zeros()], &[Matrix6::identity()]).expect("a prior");
        let found = arrow.covariances(&arrow.solve(true).expect("cells"), &gradients);
        let [of_cells, of_blocks] = [found.part_stated, found.part_by_blocks].map(|covariance| covariance[(1, 1)].sqrt());
        // Each half turns it by Σxr/Σx² = 120/82500 rad, one against the other.
        assert!((of_blocks - 240.0 / 82_500.0).abs() < 1e-5 && of_blocks > 4.0 * of_cells, "{of_cells} {of_blocks} rad");
    }
}
