//! Reflection of the projector's light into the cameras.

use nalgebra::{Point3, Vector3};

use crate::cell::{PerDevice, Scanner};
use crate::geometry::{Part, Pose, ScannerFrame};

/// Optical centres between which light is reflected, scanner frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reflection {
    centres_mm: PerDevice<Point3<f64>>,
}

impl Reflection {
    /// Reflection between the devices of a scanner.
    #[must_use]
    pub(super) fn new(scanner: &Scanner) -> Self {
        Self { centres_mm: scanner.devices.as_ref().map(|device| device.scanner_from_device.origin_mm()) }
    }

    /// The reflection seen from a viewpoint: centres in the part's frame.
    #[must_use]
    pub(super) fn at(&self, part_from_scanner: &Pose<Part, ScannerFrame>) -> Self {
        Self { centres_mm: self.centres_mm.as_ref().map(|centre| part_from_scanner.point(centre)) }
    }

    /// Smallest angle between the projector's light as a mirror at the point reflects it and the direction to a camera, rad.
    #[must_use]
    pub(super) fn mirror_rad(&self, point_mm: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        let light = self.centres_mm.projector - point_mm;
        let mirrored = normal * (2.0 * normal.dot(&light)) - light;
        let angles = self.centres_mm.cameras().map(|centre| mirrored.angle(&(centre - point_mm)));
        angles[0].min(angles[1])
    }
}
