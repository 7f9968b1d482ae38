//! Check before use: a few poses of the board that was left where the calibration saw it. The statistic is the growth of the cost when
//! the scanner's pose is held to the calibration, by its covariance; with no drift it is χ² of six degrees (likelihood ratio: S. M. Kay,
//! *Fundamentals of Statistical Signal Processing, Volume II: Detection Theory*, 1998, section 6.5), so the rate of false alarms is stated.
//! Where the deviations were estimated it is six times Snedecor's F: with the bound of χ² and a stated rate of 1 %, 9 % of checks by
//! calibrations from 6 observations raised a false alarm, and 3 % by those from 12 (simulated).

use nalgebra::Matrix6;

use super::chi_squared::{exceedance, exceedance_estimated, quantile_of};
use super::data::{ChainEstimate, Sighting, Weighting};
use super::refine::{Adjustment, BOARD_COLUMN, COLUMNS, Free, Prior, Square, TABLE_COLUMN, scaled_inverse};
use super::se3::{Twist, log, rotation_of, translation_of};
use crate::cell::closed_list;

closed_list! {
    /// Verdict of a check before use.
    pub enum CheckVerdict {
        /// No drift is seen.
        Ok = "ok",
        /// The scanner's pose has drifted; a correction is given.
        Compensate = "compensate",
        /// The drift is beyond its limits, or no drift of the scanner explains what is seen.
        Recalibrate = "recalibrate",
    }
}

/// Rates and bounds of a check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckLimits {
    /// Rate of false alarms.
    pub false_alarm: f64,
    /// Largest turn that is compensated, rad.
    pub max_rad: f64,
    /// Largest shift that is compensated, mm.
    pub max_mm: f64,
    /// Probability below which the residuals after compensation are too large.
    pub min_residual_p: f64,
}

impl Default for CheckLimits {
    /// One false alarm in a hundred checks; drifts up to the 1° that is met in practice after compensation by hand, and what it
    /// makes of a point 480 mm away, 8.4 mm.
    fn default() -> Self {
        Self { false_alarm: 0.01, max_rad: 1.0_f64.to_radians(), max_mm: 8.4, min_residual_p: 0.001 }
    }
}

/// Observations to check a calibration by.
#[derive(Clone, Copy)]
pub struct Check<'a> {
    /// Observations of the board where it stood.
    pub sightings: &'a [Sighting],
    /// Calibrated unknowns.
    pub calibrated: ChainEstimate,
    /// Covariance of the unknowns, zero for what was held.
    pub covariance: &'a Square,
    /// Deviations.
    pub weighting: Weighting,
    /// Degrees of freedom that the deviations were estimated with; none where they are known.
    pub sigma_freedom: Option<f64>,
    /// Rates and bounds.
    pub limits: CheckLimits,
}

/// Outcome of a check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Checked {
    /// Verdict.
    pub verdict: CheckVerdict,
    /// Growth of the cost.
    pub statistic: f64,
    /// Value that it exceeds at the stated rate without drift.
    pub threshold: f64,
    /// Probability of a statistic as large or larger without drift.
    pub p: f64,
    /// Drift as a body increment of the scanner's pose.
    pub drift: Twist,
    /// Drifted unknowns: what a compensation puts into force.
    pub compensated: ChainEstimate,
    /// Covariance of the compensated scanner's pose.
    pub covariance: Matrix6<f64>,
    /// Probability of residuals as large or larger after compensation.
    pub residual_p: f64,
    /// True if the search for the drift ended where the cost is least, false if it ended at the limit of iterations before.
    pub is_converged: bool,
}

impl Check<'_> {
    /// Checks. None for too few observations to tell the scanner's pose.
    #[must_use]
    pub fn check(&self) -> Option<Checked> {
        let held = self.prior(0)?;
        let drifted = self.prior(TABLE_COLUMN)?;
        // A scanner's pose that was held when the cell was calibrated has no covariance, and is held here too.
        let without = self.problem(&held, self.is_known(0)).refine(&self.calibrated, &self.weighting)?;
        let with = self.problem(&drifted, true).refine(&self.calibrated, &self.weighting)?;
        let statistic = (without.cost - with.cost).max(0.0);
        let threshold = quantile_of(self.limits.false_alarm, 6, self.sigma_freedom);
        // The prior tells as many numbers as it leaves unknowns besides the scanner's six.
        let residual_p = self.exceedance(with.cost, 6 * self.sightings.len().saturating_sub(1));
        let drift = log(&(self.calibrated.flange_from_cloud.inverse() * with.estimate.flange_from_cloud));
        let is_small = rotation_of(&drift).norm() <= self.limits.max_rad && translation_of(&drift).norm() <= self.limits.max_mm;
        // A search that has not ended leaves too large a cost, which would hide a drift.
        let verdict = if with.is_converged && statistic <= threshold {
            CheckVerdict::Ok
        } else if with.is_converged && is_small && residual_p >= self.limits.min_residual_p {
            CheckVerdict::Compensate
        } else {
            CheckVerdict::Recalibrate
        };
        let covariance = with.hand_eye_covariance();
        let p = self.exceedance(statistic, 6);
        let (compensated, is_converged) = (with.estimate, with.is_converged);
        Some(Checked { verdict, statistic, threshold, p, drift, compensated, covariance, residual_p, is_converged })
    }

    /// Probability that a sum of whitened squares with `freedom` degrees is larger by chance.
    fn exceedance(&self, value: f64, freedom: usize) -> f64 {
        self.sigma_freedom.map_or_else(|| exceedance(value, freedom), |known| exceedance_estimated(value, freedom, known))
    }

    fn problem<'p>(&'p self, prior: &'p Prior, hand_eye: bool) -> Adjustment<'p> {
        let free = Free { hand_eye, table: self.is_known(TABLE_COLUMN), board: true, scale: false };
        Adjustment { sightings: self.sightings, free, prior: Some(prior) }
    }

    fn is_known(&self, column: usize) -> bool {
        self.covariance[(column, column)] > 0.0
    }

    /// Prior that the calibration gives the unknowns from column `first` on, and nothing of those before.
    fn prior(&self, first: usize) -> Option<Prior> {
        let counts = |column: usize| column >= first && self.is_known(column);
        let kept = Square::from_fn(|row, column| match (counts(row), counts(column)) {
            (true, true) => self.covariance[(row, column)],
            _ if row == column => 1.0,
            _ => 0.0,
        });
        let mut information = scaled_inverse(&kept)?;
        for column in (0..COLUMNS).filter(|column| !counts(*column)) {
            information[(column, column)] = 0.0;
        }
        // A calibration without a board has nothing to be checked against.
        self.is_known(BOARD_COLUMN).then_some(Prior { at: self.calibrated, information })
    }
}
