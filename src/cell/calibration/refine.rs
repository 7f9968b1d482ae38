//! Refinement: Levenberg & Marquardt on SE(3) (K. Madsen, H. B. Nielsen, O. Tingleff, *Methods for Non-Linear Least Squares Problems*,
//! 2004, section 3.2) over any of the unknowns, with residuals whitened by the propagated covariance S = J Σ_arm Jᵀ + Σ_board. With
//! weights that are the same for all, the refined hand-eye was measured to be worse than the closed form. Where the deviations are
//! not given they are estimated from the residuals (variance components: K. R. Koch, *Parameter Estimation and Hypothesis Testing in
//! Linear Models*, 1999, section 3.6.2). An iteration costs O(n); n observations.

use nalgebra::{Isometry3, Matrix6, SMatrix, SVector, Vector3};

use super::data::{ChainEstimate, Sighting, Sigma, Weighting};
use super::findings::{CalibrationFinding, Figures, FindingCode, Severity};
use super::se3::{Twist, adjoint, exp, log, right_jacobian_inverse};

/// Columns of the unknowns: hand-eye 6, table 4 (turns about x and y, shifts along x and y: the rest is gauge), board 6, scale.
pub const COLUMNS: usize = 17;
/// First column of the table.
pub const TABLE_COLUMN: usize = 6;
/// First column of the board.
pub const BOARD_COLUMN: usize = 10;
/// Column of the scale.
const SCALE_COLUMN: usize = 16;

/// Matrix over all unknowns.
pub type Square = SMatrix<f64, COLUMNS, COLUMNS>;
/// Increment of all unknowns: each a body increment, rad and mm.
pub type Increment = SVector<f64, COLUMNS>;
/// Derivative of one residual.
type Rows = SMatrix<f64, 6, COLUMNS>;

/// Iterations after which a refinement ends, converged or not.
pub const MAX_ITERATIONS: usize = 60;
/// Square of the last step, in standard deviations; convergence is quadratic, so what is left after it is less.
const CONVERGED: f64 = 1e-14;
/// Square of the step, in standard deviations, that a refinement which ended at its limit may have left before it: a thousandth of a
/// deviation changes no figure that is told, and lies far above what rounding leaves. Chosen, with no source.
const SETTLED: f64 = 1e-6;
/// Rounds in which the weights are computed anew at the refined unknowns.
const WEIGHT_ROUNDS: usize = 3;
/// Rounds in which the deviations are estimated anew.
const SIGMA_ROUNDS: usize = 6;
/// Largest change of a variance in a round, and the smallest share of the start that it may fall to.
const SIGMA_STEP: f64 = 30.0;
const MIN_VARIANCE_SHARE: f64 = 1e-6;

/// Unknowns that a refinement may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Free {
    /// The scanner.
    pub hand_eye: bool,
    /// The table's axis.
    pub table: bool,
    /// The board.
    pub board: bool,
    /// Ratio of the table's turn.
    pub scale: bool,
}

impl Free {
    /// Scanner and board, with a board that stands still.
    pub const HAND_EYE: Self = Self { hand_eye: true, table: false, board: true, scale: false };
    /// Table and board, with the scanner known.
    pub const TABLE: Self = Self { hand_eye: false, table: true, board: true, scale: false };
    /// Scanner, table and board.
    pub const JOINT: Self = Self { hand_eye: true, table: true, board: true, scale: false };

    fn is_free(self, column: usize) -> bool {
        match column {
            0..TABLE_COLUMN => self.hand_eye,
            TABLE_COLUMN..BOARD_COLUMN => self.table,
            BOARD_COLUMN..SCALE_COLUMN => self.board,
            _ => self.scale,
        }
    }

    /// Number of unknowns.
    #[must_use]
    pub fn count(self) -> usize {
        (0..COLUMNS).filter(|column| self.is_free(*column)).count()
    }
}

/// Knowledge of the unknowns before the observations.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    /// Expected values.
    pub at: ChainEstimate,
    /// Inverse of their covariance; zero where nothing is known.
    pub information: Square,
}

/// Refined unknowns.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// Values.
    pub estimate: ChainEstimate,
    /// Covariance of body increments; zero for what was held.
    pub covariance: Square,
    /// Unknowns that were free.
    pub free: Free,
    /// Weights of the residuals, with the deviations as estimated.
    pub weighting: Weighting,
    /// Sum of the whitened squares, with those of the prior.
    pub cost: f64,
    /// Whitened squares of each observation.
    pub chi2: Vec<f64>,
    /// True if the last minimisation ended where the cost is least, false if it ended at the limit of iterations before.
    pub is_converged: bool,
}

/// End of a minimisation.
pub(super) struct Minimum {
    /// Unknowns.
    pub(super) at: ChainEstimate,
    /// True if no further step would change the unknowns, set beside their deviations.
    pub(super) is_converged: bool,
}

/// A residual with its weight and derivative, at the unknowns of the time.
pub(super) struct Linear {
    pub(super) residual: Twist,
    pub(super) weight: Matrix6<f64>,
    pub(super) rows: Rows,
}

/// Residual and its derivative by all unknowns, free or not.
pub(super) fn linearised(at: &ChainEstimate, sighting: &Sighting) -> (Twist, Rows) {
    let predicted = at.predicted(sighting);
    let residual = log(&(sighting.cloud_from_board.inverse() * predicted));
    let of_body = right_jacobian_inverse(&residual);
    let turn = Isometry3::rotation(Vector3::z() * (at.scale * sighting.table_rad));
    let mut rows = Rows::zeros();
    rows.fixed_view_mut::<6, 6>(0, 0).copy_from(&(-of_body * adjoint(&predicted.inverse())));
    let of_table = of_body * adjoint(&(turn * at.plate_from_board).inverse());
    for (column, axis) in [0, 1, 3, 4].into_iter().enumerate() {
        rows.set_column(TABLE_COLUMN + column, &of_table.column(axis));
    }
    rows.fixed_view_mut::<6, 6>(0, BOARD_COLUMN).copy_from(&of_body);
    let of_turn = of_body * adjoint(&at.plate_from_board.inverse());
    rows.set_column(SCALE_COLUMN, &(of_turn.column(2) * sighting.table_rad));
    (residual, rows)
}

/// Unknowns after an increment.
#[must_use]
pub fn moved(at: &ChainEstimate, by: &Increment) -> ChainEstimate {
    let six = |first: usize| by.fixed_rows::<6>(first).into_owned();
    let table = Twist::new(by[6], by[7], 0.0, by[8], by[9], 0.0);
    ChainEstimate {
        flange_from_cloud: at.flange_from_cloud * exp(&six(0)),
        base_from_table: at.base_from_table * exp(&table),
        plate_from_board: at.plate_from_board * exp(&six(BOARD_COLUMN)),
        scale: at.scale + by[SCALE_COLUMN],
    }
}

/// Increment that leads from one set of unknowns to another.
#[must_use]
pub fn increment(from: &ChainEstimate, to: &ChainEstimate) -> Increment {
    let mut by = Increment::zeros();
    by.fixed_rows_mut::<6>(0).copy_from(&log(&(from.flange_from_cloud.inverse() * to.flange_from_cloud)));
    let table = log(&(from.base_from_table.inverse() * to.base_from_table));
    [0, 1, 3, 4].into_iter().enumerate().for_each(|(column, axis)| by[TABLE_COLUMN + column] = table[axis]);
    by.fixed_rows_mut::<6>(BOARD_COLUMN).copy_from(&log(&(from.plate_from_board.inverse() * to.plate_from_board)));
    by[SCALE_COLUMN] = to.scale - from.scale;
    by
}

/// Derivative of [`increment`] by an increment of `to`.
fn increment_jacobian(by: &Increment) -> Square {
    let mut jacobian = Square::identity();
    for first in [0, BOARD_COLUMN] {
        let block = right_jacobian_inverse(&by.fixed_rows::<6>(first).into_owned());
        jacobian.fixed_view_mut::<6, 6>(first, first).copy_from(&block);
    }
    jacobian
}

/// The problem: observations, unknowns and prior.
#[derive(Clone, Copy)]
pub struct Adjustment<'a> {
    /// Observations.
    pub sightings: &'a [Sighting],
    /// Unknowns that may change.
    pub free: Free,
    /// Knowledge before the observations.
    pub prior: Option<&'a Prior>,
}

impl Adjustment<'_> {
    /// Inverse covariances of the residuals at these unknowns.
    pub(super) fn weights(&self, at: &ChainEstimate, weighting: &Weighting) -> Option<Vec<Matrix6<f64>>> {
        self.sightings.iter().map(|each| Some(weighting.covariance(at, each).cholesky()?.inverse())).collect()
    }

    fn cost(&self, at: &ChainEstimate, weights: &[Matrix6<f64>]) -> f64 {
        let of_prior = self.prior.map_or(0.0, |prior| {
            let off = increment(&prior.at, at);
            off.dot(&(prior.information * off))
        });
        let residuals = self.sightings.iter().zip(weights).map(|(each, weight)| square(&at.residual(each), weight));
        of_prior + residuals.sum::<f64>()
    }

    /// Normal matrix and gradient; what is held has a row of the identity.
    fn normal(&self, at: &ChainEstimate, weights: &[Matrix6<f64>]) -> (Square, Increment) {
        let (mut normal, mut gradient) = (Square::zeros(), Increment::zeros());
        for (sighting, weight) in self.sightings.iter().zip(weights) {
            let (residual, rows) = linearised(at, sighting);
            let weighted = weight * rows;
            normal += rows.transpose() * weighted;
            gradient += weighted.transpose() * residual;
        }
        if let Some(prior) = self.prior {
            let off = increment(&prior.at, at);
            let jacobian = increment_jacobian(&off);
            normal += jacobian.transpose() * prior.information * jacobian;
            gradient += jacobian.transpose() * prior.information * off;
        }
        self.hold(&mut normal, &mut gradient);
        (normal, gradient)
    }

    fn hold(&self, normal: &mut Square, gradient: &mut Increment) {
        for column in (0..COLUMNS).filter(|column| !self.free.is_free(*column)) {
            normal.row_mut(column).fill(0.0);
            normal.column_mut(column).fill(0.0);
            normal[(column, column)] = 1.0;
            gradient[column] = 0.0;
        }
    }

    /// Unknowns at which the cost is least, with these weights, as far as so many iterations lead.
    pub(super) fn minimise(&self, start: &ChainEstimate, weights: &[Matrix6<f64>], iterations: usize) -> Option<Minimum> {
        let mut has_ended = false;
        let (mut at, mut cost, mut damping) = (*start, self.cost(start, weights), 1e-6_f64);
        for _ in 0..iterations {
            let (normal, gradient) = self.normal(&at, weights);
            let mut damped = normal;
            (0..COLUMNS).for_each(|column| damped[(column, column)] *= 1.0 + damping);
            let step = -damped.cholesky()?.solve(&gradient);
            let next = moved(&at, &step);
            let next_cost = self.cost(&next, weights);
            if !next_cost.is_finite() {
                return None;
            }
            // Half of it is the decrease that a step promises: its root is the step in standard deviations.
            let is_converged = gradient.dot(&step).abs() <= CONVERGED;
            if next_cost <= cost {
                (at, cost, damping) = (next, next_cost, (damping * 0.1).max(1e-12));
            } else {
                damping = (damping * 10.0).min(1e12);
            }
            if is_converged {
                has_ended = true;
                break;
            }
        }
        // A step that heavy damping made short tells nothing.
        let is_converged = (has_ended && damping <= 1.0) || self.is_settled(&at, weights);
        Some(Minimum { at, is_converged })
    }

    /// Tells if the undamped step from here is short beside the deviations of the unknowns.
    fn is_settled(&self, at: &ChainEstimate, weights: &[Matrix6<f64>]) -> bool {
        let (normal, gradient) = self.normal(at, weights);
        scaled_inverse(&normal).is_some_and(|inverse| gradient.dot(&(inverse * gradient)) <= SETTLED)
    }

    /// Refines from `start` with given deviations; the weights are computed anew at the refined unknowns.
    ///
    /// None if the observations leave an unknown open altogether.
    #[must_use]
    pub fn refine(&self, start: &ChainEstimate, weighting: &Weighting) -> Option<Refined> {
        self.refine_in_rounds(start, weighting, WEIGHT_ROUNDS)
    }

    /// Refines with the weights computed so many times.
    pub(super) fn refine_in_rounds(&self, start: &ChainEstimate, weighting: &Weighting, rounds: usize) -> Option<Refined> {
        let mut end = Minimum { at: *start, is_converged: false };
        for _ in 0..rounds {
            let weights = self.weights(&end.at, weighting)?;
            end = self.minimise(&end.at, &weights, MAX_ITERATIONS)?;
        }
        self.refined(&end, weighting)
    }

    /// Unknowns with covariance and residuals, where they are.
    fn refined(&self, end: &Minimum, weighting: &Weighting) -> Option<Refined> {
        let Minimum { at, is_converged } = *end;
        let weights = self.weights(&at, weighting)?;
        let (normal, _) = self.normal(&at, &weights);
        let mut covariance = scaled_inverse(&normal)?;
        (0..COLUMNS).filter(|column| !self.free.is_free(*column)).for_each(|column| covariance[(column, column)] = 0.0);
        let chi2 = self.sightings.iter().zip(&weights).map(|(each, weight)| square(&at.residual(each), weight)).collect();
        let cost = self.cost(&at, &weights);
        Some(Refined { estimate: at, covariance, free: self.free, weighting: *weighting, cost, chi2, is_converged })
    }

    /// Refines and estimates the deviations together: the proportions of `weighting` are where it begins.
    #[must_use]
    pub fn refine_with_sigma(&self, start: &ChainEstimate, weighting: &Weighting) -> Option<Refined> {
        let mut weighting = *weighting;
        let mut refined = self.refine(start, &weighting)?;
        let first = weighting.sigma.components().map(|sigma| sigma * sigma);
        for _ in 0..SIGMA_ROUNDS {
            let variances = self.variances(&refined);
            let kept: [f64; 4] = std::array::from_fn(|part| variances[part].max(MIN_VARIANCE_SHARE * first[part]).sqrt());
            weighting.sigma = Sigma::from_components(kept);
            refined = self.refine_in_rounds(&refined.estimate, &weighting, 1)?;
        }
        Some(refined)
    }

    /// One round of the estimate: σᵢ² ← σᵢ² · Σ eᵀ W Qᵢ W e / Σ tr(W Qᵢ − W A P Aᵀ W Qᵢ).
    fn variances(&self, at: &Refined) -> [f64; 4] {
        let (mut found, mut expected) = ([0.0; 4], [0.0; 4]);
        for sighting in self.sightings {
            let (residual, rows) = linearised(&at.estimate, sighting);
            let Some(cholesky) = at.weighting.covariance(&at.estimate, sighting).cholesky() else { continue };
            let weight = cholesky.inverse();
            let whitened = weight * residual;
            let projector = weight - weight * (rows * at.covariance * rows.transpose()) * weight;
            for (part, derivative) in at.weighting.parts(&at.estimate, sighting).iter().enumerate() {
                found[part] += whitened.dot(&(derivative * whitened));
                expected[part] += (projector * derivative).trace();
            }
        }
        let variances = at.weighting.sigma.components().map(|sigma| sigma * sigma);
        std::array::from_fn(|part| {
            // Nothing tells this one apart: it stays.
            let ratio = if expected[part] > 0.0 { found[part] / expected[part] } else { 1.0 };
            variances[part] * ratio.clamp(SIGMA_STEP.recip(), SIGMA_STEP)
        })
    }
}

impl Refined {
    /// Warning of a refinement that ended at the limit of iterations.
    #[must_use]
    pub fn not_converged(&self) -> Option<CalibrationFinding> {
        let figures = Figures { count: Some(MAX_ITERATIONS), ..Figures::default() };
        (!self.is_converged).then(|| CalibrationFinding::new(FindingCode::NotConverged, Severity::Warning).with(figures))
    }

    /// Numbers of observation equations beyond those that the unknowns take.
    #[must_use]
    pub fn freedom(&self) -> usize {
        (6 * self.chi2.len()).saturating_sub(self.free.count())
    }

    /// Mean of the whitened squares for a degree of freedom: 1 where the deviations are right.
    #[must_use]
    pub fn variance_factor(&self) -> f64 {
        self.chi2.iter().sum::<f64>() / self.freedom().max(1) as f64
    }

    /// Covariance of the scanner's pose, body increments.
    #[must_use]
    pub fn hand_eye_covariance(&self) -> Matrix6<f64> {
        self.covariance.fixed_view::<6, 6>(0, 0).into_owned()
    }

    /// Covariance of the table: turns about x and y, shifts along x and y.
    #[must_use]
    pub fn table_covariance(&self) -> nalgebra::Matrix4<f64> {
        self.covariance.fixed_view::<4, 4>(TABLE_COLUMN, TABLE_COLUMN).into_owned()
    }

    /// Standard deviation of the table's ratio; 0 where it was held.
    #[must_use]
    pub fn scale_sd(&self) -> f64 {
        self.covariance[(SCALE_COLUMN, SCALE_COLUMN)].max(0.0).sqrt()
    }

    /// Whitened square of an observation that was not used: its covariance has that of the unknowns added.
    #[must_use]
    pub fn chi2_of_other(&self, sighting: &Sighting) -> f64 {
        self.prediction(sighting).map_or(f64::INFINITY, |(square, _)| square)
    }

    /// Whitened square of an observation that was not used, and the logarithm of the determinant of its covariance.
    pub(super) fn prediction(&self, sighting: &Sighting) -> Option<(f64, f64)> {
        let (residual, rows) = linearised(&self.estimate, sighting);
        let covariance = self.weighting.covariance(&self.estimate, sighting) + rows * self.covariance * rows.transpose();
        let cholesky = covariance.cholesky()?;
        Some((residual.dot(&cholesky.solve(&residual)), cholesky.ln_determinant()))
    }

    /// The terms that the observations add to the normal equations.
    pub(super) fn linear(&self, sighting: &Sighting) -> Option<Linear> {
        let (residual, rows) = linearised(&self.estimate, sighting);
        let weight = self.weighting.covariance(&self.estimate, sighting).cholesky()?.inverse();
        Some(Linear { residual, weight, rows })
    }
}

/// Square of a residual in its weight.
fn square(residual: &Twist, weight: &Matrix6<f64>) -> f64 {
    residual.dot(&(weight * residual))
}

/// Inverse of a positive matrix whose diagonal spans many orders of size: scaled to a unit diagonal before.
pub(super) fn scaled_inverse(matrix: &Square) -> Option<Square> {
    let scale = Increment::from_fn(|row, _| matrix[(row, row)].max(f64::MIN_POSITIVE).sqrt().recip());
    let unit = Square::from_fn(|row, column| matrix[(row, column)] * scale[row] * scale[column]);
    let inverse = unit.cholesky()?.inverse();
    Some(Square::from_fn(|row, column| inverse[(row, column)] * scale[row] * scale[column]))
}
