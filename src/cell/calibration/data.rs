//! Observations of a calibration and the figures that weigh them. Each observation is one equation of the chain
//! FK(q) · X · C = B · Rz(s · a) · P with X = flange_from_cloud, C = cloud_from_board, B = base_from_table and
//! P = plate_from_board; with a board that stands still B · Rz is left out and P is base_from_board. With the scanner standing
//! still and the board on the flange, X is base_from_cloud, P is flange_from_board and the arm's pose is inverted: base and flange
//! change places in the names.

use nalgebra::{Isometry3, Matrix6, Point3, Vector3};

use super::se3::{Twist, adjoint};
use crate::cell::closed_list;

closed_list! {
    /// Place of the scanner.
    pub enum HandEyeSetup {
        /// The scanner is on the flange, the board stands in the cell.
        EyeInHand = "eye_in_hand",
        /// The scanner stands in the cell, the board is on the flange.
        EyeToHand = "eye_to_hand",
    }
}

closed_list! {
    /// Unknowns that a calibration solves for.
    pub enum Solve {
        /// The scanner on the flange, with a board that stands still.
        HandEye = "hand_eye",
        /// The table in the cell, with the scanner on the flange as the cell has it.
        Table = "table",
        /// Both, with the board on the plate.
        Joint = "joint",
    }
}

closed_list! {
    /// Source of standard deviations.
    pub enum SigmaSource {
        /// Deviations as they were given.
        Given = "given",
        /// Deviations that were given, times one factor that the residuals ask for.
        Enlarged = "enlarged",
        /// Deviations of a calibrated arm, times one factor where the residuals ask for it: none were given, and the observations
        /// are too few to estimate them.
        Assumed = "assumed",
        /// Deviations estimated from the residuals.
        Estimated = "estimated",
        /// Deviations without use: the points of each board tell its own.
        Unused = "unused",
    }
}

/// Parts into which the four deviations that are estimated together divide their degrees of freedom, for a statistic of six
/// components. With 3, checks with a stated rate of 1 % raised false alarms at 0.9, 0.4, 0.9 and 0.6 % after 6, 8, 12 and 16
/// observations, and with 2 at up to 2.4 % (simulated, 700 each).
const ESTIMATED_PARTS: f64 = 3.0;

impl SigmaSource {
    /// Degrees of freedom that deviations of this source are estimated with, of the `freedom` of the residuals; none where they
    /// were given.
    #[must_use]
    pub fn freedom(self, freedom: usize) -> Option<f64> {
        let parts = match self {
            Self::Estimated => ESTIMATED_PARTS,
            // One factor for all of them.
            Self::Assumed | Self::Enlarged => 1.0,
            Self::Given | Self::Unused => return None,
        };
        Some((freedom as f64 / parts).max(1.0))
    }
}

/// One observation: where the robot was, and where it saw the board.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// Name in the data.
    pub id: String,
    /// The flange in the base; the base in the flange with the scanner standing still.
    pub base_from_flange: Isometry3<f64>,
    /// Angle of the table; 0 where the board stands still.
    pub table_rad: f64,
    /// The board as it was seen.
    pub cloud_from_board: Isometry3<f64>,
    /// Covariance of that as a body increment of the board, where its points tell it.
    pub seen_covariance: Option<Matrix6<f64>>,
    /// Points that the pose was fitted to, on the board and in the cloud, mm.
    pub points_mm: Vec<[Point3<f64>; 2]>,
}

/// Standard deviations of arm and board, each the same on three axes, as body increments of flange and board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sigma {
    /// Turn of the flange.
    pub robot_rad: f64,
    /// Place of the flange.
    pub robot_mm: f64,
    /// Turn of the board in the cloud.
    pub board_rad: f64,
    /// Place of the board in the cloud.
    pub board_mm: f64,
}

impl Sigma {
    /// Arm that its maker has calibrated, board of a good scanner: the middle of the three levels that the method was measured at.
    /// Where no figures are given they set the proportions that the estimate begins with.
    pub const CALIBRATED_ARM: Self = Self {
        robot_rad: 0.01 * std::f64::consts::PI / 180.0,
        robot_mm: 0.1,
        board_rad: 0.005 * std::f64::consts::PI / 180.0,
        board_mm: 0.02,
    };

    /// The four, in this order: arm's turn, arm's place, board's turn, board's place.
    #[must_use]
    pub fn components(&self) -> [f64; 4] {
        [self.robot_rad, self.robot_mm, self.board_rad, self.board_mm]
    }

    /// Inverse of [`Sigma::components`].
    #[must_use]
    pub fn from_components([robot_rad, robot_mm, board_rad, board_mm]: [f64; 4]) -> Self {
        Self { robot_rad, robot_mm, board_rad, board_mm }
    }

    /// Each times `factor`.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self::from_components(self.components().map(|sigma| sigma * factor))
    }
}

/// Values of the unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChainEstimate {
    /// The cloud on the flange; in the base with the scanner standing still.
    pub flange_from_cloud: Isometry3<f64>,
    /// The table; the identity without one.
    pub base_from_table: Isometry3<f64>,
    /// The board on the plate; without a table in the base, and on the flange with the scanner standing still.
    pub plate_from_board: Isometry3<f64>,
    /// Ratio of the table's turn to the angle that it reports: 1, or −1 where its sign is the other.
    pub scale: f64,
}

impl ChainEstimate {
    /// Plate after the table reports `table_rad`.
    #[must_use]
    pub fn base_from_plate(&self, table_rad: f64) -> Isometry3<f64> {
        self.base_from_table * Isometry3::rotation(Vector3::z() * (self.scale * table_rad))
    }

    /// Pose of the board in the cloud that the chain predicts.
    #[must_use]
    pub fn predicted(&self, sighting: &Sighting) -> Isometry3<f64> {
        let cloud_from_base = self.flange_from_cloud.inverse() * sighting.base_from_flange.inverse();
        cloud_from_base * self.base_from_plate(sighting.table_rad) * self.plate_from_board
    }

    /// Residual: body increment from the board that was seen to the one predicted.
    #[must_use]
    pub fn residual(&self, sighting: &Sighting) -> Twist {
        super::se3::log(&(sighting.cloud_from_board.inverse() * self.predicted(sighting)))
    }
}

/// Weights of a residual: place of the scanner, and the deviations of arm and board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weighting {
    /// Place of the scanner.
    pub setup: HandEyeSetup,
    /// Deviations.
    pub sigma: Sigma,
    /// Factor on the covariances that the points of boards tell; 1 unless residuals ask for more.
    pub points_factor: f64,
}

impl Weighting {
    /// Weights with these deviations, and the covariances of points as they are told.
    #[must_use]
    pub fn new(setup: HandEyeSetup, sigma: Sigma) -> Self {
        Self { setup, sigma, points_factor: 1.0 }
    }

    /// Weights with all variances times a factor.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self { sigma: self.sigma.scaled(factor.sqrt()), points_factor: self.points_factor * factor, ..self }
    }

    /// Propagates an error of the arm to the residual: the adjoint of the flange seen from the board, times a sign.
    #[must_use]
    pub fn arm_jacobian(&self, at: &ChainEstimate, sighting: &Sighting) -> Matrix6<f64> {
        match self.setup {
            HandEyeSetup::EyeInHand => adjoint(&(at.flange_from_cloud * sighting.cloud_from_board).inverse()),
            HandEyeSetup::EyeToHand => {
                -adjoint(&(sighting.base_from_flange * at.flange_from_cloud * sighting.cloud_from_board).inverse())
            }
        }
    }

    /// Derivatives of the residual's covariance by the four variances. A board whose points tell its covariance has that,
    /// whatever the figures of the board say.
    #[must_use]
    pub fn parts(&self, at: &ChainEstimate, sighting: &Sighting) -> [Matrix6<f64>; 4] {
        let jacobian = self.arm_jacobian(at, sighting);
        let of = |first: usize| {
            let columns = jacobian.fixed_view::<6, 3>(0, first);
            columns * columns.transpose()
        };
        let board = |first: usize| {
            let mut part = Matrix6::zeros();
            if sighting.seen_covariance.is_none() {
                (first..first + 3).for_each(|axis| part[(axis, axis)] = 1.0);
            }
            part
        };
        [of(0), of(3), board(0), board(3)]
    }

    /// Covariance of a residual: S = J Σ_arm Jᵀ + Σ_board.
    #[must_use]
    pub fn covariance(&self, at: &ChainEstimate, sighting: &Sighting) -> Matrix6<f64> {
        let parts = self.parts(at, sighting);
        let variances = self.sigma.components().map(|sigma| sigma * sigma);
        let sum: Matrix6<f64> = parts.iter().zip(variances).map(|(part, variance)| part * variance).sum();
        sum + sighting.seen_covariance.map_or_else(Matrix6::zeros, |points| points * self.points_factor)
    }
}
