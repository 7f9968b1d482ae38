//! The loop closed: scans as they were taken, where they lie, what they measured beside what was planned, how the surface
//! deviates, and what that teaches.

pub mod coverage;
pub mod deviation;
pub mod identification;
pub mod ingest;
pub mod losses;
mod mirror;
mod params;
mod pipeline;
mod pixel_grid;
pub mod registration;
#[cfg(test)]
mod rehearsal;
pub mod rescan;
#[cfg(test)]
mod shots;
pub mod simulated_scanner;
mod student;

pub use params::{AlignParams, InspectionParams};
pub use pipeline::{DeviationFigures, InspectedView, Inspection, InspectionInput, MAX_SPOTS, inspect};
pub use pixel_grid::PixelGrid;

use nalgebra::{DMatrix, DVector, Matrix6};

use crate::geometry::{Part, PointCloud, Pose, ScannerFrame};

/// One capture of the scanner.
#[derive(Clone, Debug)]
pub struct ViewScan {
    /// Number of its viewpoint in the plan.
    pub viewpoint: u32,
    /// Pose at which it was taken, as far as the robot knows: the plan's, or that of a run's record.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Points in the scanner's frame. Cell (c, r) of an organised cloud of W/n × H/n cells is the ray of the left camera's
    /// pixel position ((c + ½)·n, (r + ½)·n), in the convention of [`crate::cell::Lens`].
    pub scanner_cloud: PointCloud,
}

/// Registered pose of a capture.
#[derive(Clone, Debug)]
pub struct RegisteredView {
    /// Number of its viewpoint in the plan.
    pub viewpoint: u32,
    /// Pose after registration.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Covariance of the pose: order rx ry rz tx ty tz, in the scanner's frame (right perturbation), rad and mm.
    pub covariance: Matrix6<f64>,
    /// True if the correction lies within the prior that the calibration gives.
    pub is_in_prior: bool,
}

/// Motions of poses that neither their priors nor surface that several views see rule out. By so much a surface that deviates as a whole
/// may have been taken for poses that are off. Six rows a view, in the frame of each scanner (right perturbation), rad and mm.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenPoses {
    /// Covariance of the poses that priors and surface of several views give, with what all of them are off alike; of a pose that was kept
    /// its own.
    pub covariance: DMatrix<f64>,
    /// Motions by which the mesh pulled the views from those poses, or as long ones back to them.
    pub pulled: DVector<f64>,
    /// Covariance of the place of the whole part, as its points on the mesh give it: left perturbation in the mesh's frame.
    pub part: Matrix6<f64>,
}
