//! The structured-light scanner: two cameras and a projector, a working depth, a body ([`crate::planning::method::scanner`]).

mod calibrated;
mod cloud_frame;
mod data_sheet;
mod depth_of_field;
mod device;
mod exposure;
mod material;
mod measurement_volume;
mod per_device;
mod planar_construction;
mod spec;
#[cfg(test)]
mod tests;
mod working_depth;

use nalgebra::{Point3, Vector3};

pub use calibrated::{CalibratedScannerSpec, ScannerResidualsSpec};
pub use cloud_frame::{CloudFrame, CloudFrameSpec};
pub use data_sheet::DataSheet;
pub use depth_of_field::{DepthOfField, hyperfocal_distance_mm};
pub use device::{DeviceName, Lens, OpticalDevice};
pub use exposure::{Exposure, ExposureFault, ExposureSpec, LEVELS, LevelRange, Lighting, REFERENCE_LEVEL, best_levels};
pub use material::{Finish, Material};
pub use measurement_volume::{Field, MeasurementVolume};
pub use per_device::PerDevice;
pub use planar_construction::PlanarConstruction;
pub(in crate::cell) use spec::left_from_scanner;
pub use spec::{BoardPoseSpec, BoardPosesSpec, DepthSpec, DeviceSpec, ScannerSpec};
pub use working_depth::{DepthBound, DepthBoundSource};

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
    /// Cameras and projector.
    pub devices: PerDevice<OpticalDevice>,
    /// Frame of the clouds, if it is known.
    pub cloud_frame: Option<CloudFrameSpec>,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass, scanner frame, mm, if it is known.
    pub centre_of_mass_mm: Option<[f64; 3]>,
    /// Envelope for collision tests, scanner frame.
    pub body: Vec<BodySpec>,
    /// Measurement volume as its source states it from optics alone, mm along x, y, z of the scanner.
    pub stated_volume_mm: Option<[f64; 3]>,
    /// Practical measurement volume, mm along x, y, z of the scanner.
    pub practical_volume_mm: [f64; 3],
    /// Edge of the cube that blocks of a large part must fit in ([`crate::planning::method::candidates`]), mm.
    pub block_cube_mm: f64,
    /// Brightness levels of the projector.
    pub exposure: Exposure,
    /// Provenance of lenses and poses, if they were calibrated.
    pub calibrated: Option<CalibratedScannerSpec>,
}

impl Scanner {
    /// Minimum distance between neighbouring points of a scan, mm: z_near / f of the coarser camera, on surface that it looks at
    /// squarely.
    #[must_use]
    pub fn min_point_spacing_mm(&self) -> f64 {
        let focal_px = self.devices.cameras().into_iter().map(|camera| camera.lens.focal_px()).fold(f64::INFINITY, f64::min);
        self.near_mm / focal_px
    }

    /// Distance between the cameras' optical centres, mm.
    #[must_use]
    pub fn baseline_mm(&self) -> f64 {
        let [left, right] = self.devices.cameras();
        (right.scanner_from_device.origin_mm() - left.scanner_from_device.origin_mm()).norm()
    }

    /// Angle between the cameras' optical axes, radians.
    #[must_use]
    pub fn axes_angle_rad(&self) -> f64 {
        let [left, right] = self.devices.cameras().map(|camera| camera.scanner_from_device.direction(&Vector3::z()));
        left.angle(&right)
    }

    /// The point (0, 0, F) of best focus, scanner frame.
    #[must_use]
    pub fn best_focus_mm(&self) -> Point3<f64> {
        Point3::new(0.0, 0.0, self.best_mm)
    }
}
