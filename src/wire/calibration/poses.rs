//! `vantage.calibration_poses/1`: poses from which to observe the board, chosen for what they tell.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::PoseSpec;

/// Name and version of the shape.
pub const CALIBRATION_POSES_SCHEMA: &str = "vantage.calibration_poses/1";

/// Planned calibration poses, in the order in which to go to them. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CalibrationPosesDocument {
    /// `vantage.calibration_poses/1`.
    pub schema: String,
    /// Name of the cell.
    pub cell: String,
    /// Board on the plate that the poses are planned for.
    pub plate_from_board: PoseSpec,
    /// Poses; those to hold out come last.
    pub poses: Vec<PlannedPoseDocument>,
    /// Number of them to hold out: `vantage calibrate cell --hold-out`.
    pub hold_out: usize,
    /// Candidates that the arm can take without a collision, with the board in view.
    pub candidates: usize,
    /// Predicted standard deviation of a turn of the scanner's pose, the largest of the three axes, degrees.
    pub rotation_sd_deg: f64,
    /// Predicted standard deviation of a shift of the scanner's pose, the largest of the three axes, mm.
    pub translation_sd_mm: f64,
    /// Predicted standard deviation of the axis, mm.
    pub axis_sd_mm: f64,
    /// Predicted standard deviation of a turn of the scanner's pose about the axis about which it is largest, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst_rotation_sd_deg: Option<f64>,
    /// Predicted standard deviation of a shift of the scanner's pose in the direction in which it is largest, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst_translation_sd_mm: Option<f64>,
}

/// One planned pose. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct PlannedPoseDocument {
    /// Name.
    pub id: String,
    /// Joints 1 to 6, degrees.
    #[schema(min_items = 6, max_items = 6)]
    pub joints_deg: [f64; 6],
    /// Angle of the table, degrees.
    pub table_angle_deg: f64,
    /// The board in the scanner, as it should be seen.
    pub scanner_from_board: PoseSpec,
    /// True if the observation from this pose is to be held out.
    pub hold_out: bool,
}
