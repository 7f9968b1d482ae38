//! Lenses and poses of a scanner's three devices: read from the files of other programs, or estimated from points of a board that
//! the devices image. Pure: text and numbers in, a rig and its quality out.
//!
//! Data flows one way: files → [`ImportedFile`] → [`Rig`], or observations → [`Rig`] by [`adjust()`]; then
//! [`quality()`] judges the observations, and [`ScannerDraft`] makes a specification.

mod adjust;
mod assemble;
mod board_pose;
mod depth_origin;
mod draft;
mod equations;
mod fault;
mod import;
mod lit_rectangle;
mod model;
mod observations;
mod quality;
mod resect;
mod rich_lens;
mod start;
#[cfg(test)]
mod tests;

pub use adjust::{AdjustOptions, Adjusted, DeviceResiduals, PixelResidual, adjust};
pub use assemble::{BoardScatter, CoefficientFit, Rig, RigDevice, RigSigma, assemble};
pub use board_pose::{BoardInCamera, board_in_camera};
pub use depth_origin::{DepthDatum, DepthOrigin, MIN_PLANES, StatedPlane, depth_origin, stated_planes};
pub use draft::{Assumption, DraftChecks, DraftFigures, ScannerDraft, housing_front_mm};
pub use fault::{LensError, LensFault};
pub use import::{CalibrationFormat, ImportOptions, ImportedFile, ImportedLens, MAX_FILE_BYTES, detect, read, yaml};
pub use lit_rectangle::{LitPlaneSpec, LitRectangleSpec, lit_rectangle};
pub use model::{LensParameters, PARAMETER_NAMES};
pub use observations::{
    BoardObservations, BoardSpec, BoardView, DeviceImageSpec, DeviceSighting, OBSERVATIONS_SCHEMA, PixelOrigin,
    ScannerObservationsSpec, ViewSpec, read_csv,
};
pub use quality::{DeviceCoverage, Quality, ViewQuality, quality};
