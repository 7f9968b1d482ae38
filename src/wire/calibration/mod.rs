//! Documents of calibration: observations that users bring (`vantage.calibration_data/1`, CSV, and what other programs write),
//! results (`vantage.calibration/1`), checks before use (`vantage.calibration_check/1`), and the sentences of their findings.

mod brightness;
mod check;
mod conditions;
mod csv;
mod data;
mod foreign;
mod order;
mod placement;
mod pose;
mod poses;
mod result;
#[cfg(test)]
mod tests;
mod words;
mod yaml;

pub use brightness::{BRIGHTNESS_SCHEMA, BrightnessData, BrightnessDocument, LevelCaptureDocument};
pub use check::{CALIBRATION_CHECK_SCHEMA, CalibrationCheckDocument, CompensationDocument};
pub use conditions::use_conditions;
pub use csv::{CsvOptions, from_csv, rows_without_board};
pub(super) use data::OBSERVATION_RANGES;
pub use data::{
    BoardDocument, CALIBRATION_DATA_SCHEMA, CalibrationData, CameraDocument, ObservationDocument, PixelPairDocument,
    PlateScanDocument, PointPairDocument, SigmaDocument, SphereDocument,
};
pub use foreign::{RobotPoseKind, from_pose_samples};
pub use order::{CalibrationError, CalibrationJob, CalibrationPage, CalibrationRequest, CalibrationSelection, CalibrationState};
pub use placement::{PLACEMENT_SCHEMA, PlacementData, PlacementDocument};
pub use pose::ObservedPose;
pub use poses::{CALIBRATION_POSES_SCHEMA, CalibrationPosesDocument, PlannedPoseDocument};
pub use result::{
    BoardScaleDocument, CALIBRATION_SCHEMA, CalibrationDocument, FindingDocument, PlateFaceDocument, ResidualDocument,
    WeakestDocument,
};
pub use words::sentence;
pub use yaml::{from_easy_handeye, from_zivid};
