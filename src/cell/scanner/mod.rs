//! The structured-light scanner: two cameras and a projector, a working depth, a body (method §2).

mod device;
mod spec;

use nalgebra::Vector3;

pub use device::{DeviceName, Lens, OpticalDevice};
pub use spec::{BoardPoseSpec, BoardPosesSpec, DepthSpec, DeviceSpec, ScannerSpec};

use super::shape_spec::BodySpec;

/// A scanner, checked and in radians. Made from a [`ScannerSpec`].
#[derive(Clone, Debug, PartialEq)]
pub struct Scanner {
    /// Name of the specification.
    pub name: String,
    /// Nearest working depth, mm along +z of the scanner.
    pub near_mm: f64,
    /// Depth of best focus F, mm.
    pub best_mm: f64,
    /// Farthest working depth, mm.
    pub far_mm: f64,
    /// Left camera, right camera, projector, in this order.
    pub devices: [OpticalDevice; 3],
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass, scanner frame, mm.
    pub centre_of_mass_mm: Vector3<f64>,
    /// Envelope for collision tests, scanner frame.
    pub body: Vec<BodySpec>,
    /// Practical measurement volume, mm along x, y, z of the scanner.
    pub practical_volume_mm: [f64; 3],
    /// Edge of the cube that blocks of a large part must fit in (method §3), mm.
    pub block_cube_mm: f64,
}
