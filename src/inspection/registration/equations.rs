//! Normal equations of points against planes, of one view and of the arrow that views and part make.

use nalgebra::{Matrix6, Vector6};

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
    /// Equations of pairs, weighted after Tukey within `radius_mm`. A step δ = (ω, v) moves a point s by ω × s + v, so that
    /// ∂r/∂δ = (s × n, n).
    pub(super) fn of(pairs: &[MatchedPoint], radius_mm: f64) -> Self {
        let mut sum = Self::default();
        for pair in pairs {
            let share = pair.distance_mm / radius_mm;
            let weight = (1.0 - share * share).max(0.0).powi(2);
            let turn = pair.point_mm.coords.cross(&pair.normal);
            let row = Twist::new(turn.x, turn.y, turn.z, pair.normal.x, pair.normal.y, pair.normal.z);
            sum.matrix += row * row.transpose() * weight;
            sum.gradient += row * (weight * pair.distance_mm);
        }
        sum
    }

    pub(super) fn scale(&mut self, factor: f64) {
        self.matrix *= factor;
        self.gradient *= factor;
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

/// A view in the arrow.
pub(super) struct Branch {
    /// Its observations, weighted.
    pub(super) normal: NormalEquations,
    /// Inverse covariance of its pose.
    pub(super) prior: Matrix6<f64>,
    /// Correction so far, which the prior pulls to zero.
    pub(super) correction: Twist,
    /// Takes a step of the part to the step of this view that moves its points alike.
    pub(super) view_from_part: Matrix6<f64>,
}

/// Steps of part and views.
pub(super) struct Solved {
    pub(super) part_step: Twist,
    pub(super) steps: Vec<Twist>,
    part_covariance: Matrix6<f64>,
}

/// Covariances of the part and of each view's registered pose.
pub(super) struct Covariances {
    pub(super) part: Matrix6<f64>,
    pub(super) views: Vec<Matrix6<f64>>,
}

/// Solves the arrow: with A = H + Λ and B = H·M of each view, the part sees Σ Mᵀ(H − H A⁻¹ H)M. `None` where no observation is.
pub(super) fn solve(arrow: &[Branch], moves_part: bool) -> Option<Solved> {
    let mut part = NormalEquations::default();
    for branch in arrow {
        let (inverse, gradient) = own(branch)?;
        let (h, m) = (branch.normal.matrix, branch.view_from_part);
        part.matrix += m.transpose() * (h - h * inverse * h) * m;
        part.gradient += m.transpose() * (branch.normal.gradient - h * inverse * gradient);
    }
    let part_covariance = if moves_part { pseudo_inverse(&part.matrix)? } else { Matrix6::zeros() };
    let part_step = -(part_covariance * part.gradient);
    let step = |branch: &Branch| {
        let (inverse, gradient) = own(branch)?;
        Some(-(inverse * (gradient + branch.normal.matrix * branch.view_from_part * part_step)))
    };
    Some(Solved { part_step, steps: arrow.iter().map(step).collect::<Option<_>>()?, part_covariance })
}

/// A⁻¹ of a view, and the gradient with that of its prior.
fn own(branch: &Branch) -> Option<(Matrix6<f64>, Vector6<f64>)> {
    let inverse = (branch.normal.matrix + branch.prior).cholesky()?.inverse();
    Some((inverse, branch.normal.gradient + branch.prior * branch.correction))
}

impl Solved {
    /// Covariance of each view's pose: that of ξ + M·η, of a view's own step and the part's.
    pub(super) fn covariances(&self, arrow: &[Branch]) -> Covariances {
        let part = self.part_covariance;
        let view = |branch: &Branch| {
            let Some((inverse, _)) = own(branch) else { return Matrix6::zeros() };
            let m = branch.view_from_part;
            // ξ = −A⁻¹(g + H M η): its noise beyond η's is A⁻¹, and it follows η by −A⁻¹ H M.
            let follows = m - inverse * branch.normal.matrix * m;
            inverse + follows * part * follows.transpose()
        };
        Covariances { part, views: arrow.iter().map(view).collect() }
    }
}

/// Inverse on the freedoms that observations fix; rotations are measured in steps that move points by millimetres.
fn pseudo_inverse(matrix: &Matrix6<f64>) -> Option<Matrix6<f64>> {
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
    let inverse = eigen.eigenvalues.map(|value| if value > MIN_CONDITION * largest { 1.0 / value } else { 0.0 });
    let plain = eigen.eigenvectors * Matrix6::from_diagonal(&inverse) * eigen.eigenvectors.transpose();
    debug_assert!((scale * inverse_scale - Matrix6::identity()).norm() < 1e-9);
    Some(inverse_scale * plain * inverse_scale)
}
