//! The definition of method §4 for one sample and one viewpoint, step by step in the order in which causes are named,
//! and the quality of method §5. What an engine adds is only how it decides that nothing lies between.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::cell::{DeviceName, Lens, Scanner};
use crate::geometry::{Part, Pose, Scanner as ScannerFrame};
use crate::planning::cause::Cause;
use crate::planning::params::{PlanParams, ScoreAngle};

const FRAMES: [Cause; 3] = [Cause::FrameLeft, Cause::FrameRight, Cause::FrameProjector];
const INCIDENCES: [Cause; 3] = [Cause::IncidenceLeft, Cause::IncidenceRight, Cause::IncidenceProjector];
/// What it is called when a device does not see a sample.
pub(super) const SHADOWS: [Cause; 3] = [Cause::ShadowLeft, Cause::ShadowRight, Cause::ShadowProjector];

/// The scanner and the limits of the job, ready for many samples.
pub struct Optics {
    near_mm: f64,
    best_mm: f64,
    far_mm: f64,
    devices: [DeviceOptics; 3],
    angle_weight: f64,
    distance_weight: f64,
    angle: ScoreAngle,
    /// δ_max of method §5: the projector's limit.
    incidence_reference_rad: f64,
}

struct DeviceOptics {
    device_from_scanner: Isometry3<f64>,
    centre_mm: Point3<f64>,
    lens: Lens,
    incidence_min_cos: f64,
}

impl Optics {
    /// Takes the limits from `params`, else from the scanner.
    #[must_use]
    pub fn new(scanner: &Scanner, params: &PlanParams) -> Self {
        let incidence_max_rad = |device: usize| {
            let limit_deg = match scanner.devices[device].name {
                DeviceName::Projector => params.limits.projector_deg,
                DeviceName::Left | DeviceName::Right => params.limits.camera_deg,
            };
            limit_deg.map_or(scanner.devices[device].incidence_max_rad, f64::to_radians)
        };
        let devices = [0, 1, 2].map(|d| DeviceOptics {
            device_from_scanner: *scanner.devices[d].scanner_from_device.inverse().isometry(),
            centre_mm: scanner.devices[d].scanner_from_device.origin_mm(),
            lens: scanner.devices[d].lens,
            incidence_min_cos: incidence_max_rad(d).cos(),
        });
        Self {
            near_mm: scanner.near_mm,
            best_mm: scanner.best_mm,
            far_mm: scanner.far_mm,
            devices,
            angle_weight: params.score.c,
            distance_weight: params.score.d,
            angle: params.score.angle,
            incidence_reference_rad: incidence_max_rad(2),
        }
    }

    /// The viewpoint's side of everything that does not depend on the sample.
    #[must_use]
    pub fn at<'a>(&'a self, part_from_scanner: &Pose<Part, ScannerFrame>) -> View<'a> {
        View {
            optics: self,
            scanner_from_part: *part_from_scanner.inverse().isometry(),
            centres_mm: [0, 1, 2].map(|d| part_from_scanner.point(&self.devices[d].centre_mm)),
        }
    }
}

/// One viewpoint.
pub struct View<'a> {
    optics: &'a Optics,
    scanner_from_part: Isometry3<f64>,
    /// Optical centres, part frame, mm.
    pub(super) centres_mm: [Point3<f64>; 3],
}

impl View<'_> {
    /// The first step before any shadow at which a sample fails; else its quality.
    pub(super) fn before_shadow(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> Result<f32, Cause> {
        let optics = self.optics;
        let towards = self.centres_mm.map(|centre| centre - p);
        let along_normal = towards.map(|direction| normal.dot(&direction));
        if along_normal.iter().any(|cos| *cos <= 0.0) {
            return Err(Cause::Facing);
        }
        let in_scanner = self.scanner_from_part * p;
        if !(optics.near_mm <= in_scanner.z && in_scanner.z <= optics.far_mm) {
            return Err(Cause::Depth);
        }
        for (device, step) in optics.devices.iter().zip(FRAMES) {
            device.lens.project(&(device.device_from_scanner * in_scanner)).ok_or(step)?;
        }
        for d in 0..3 {
            if along_normal[d] < optics.devices[d].incidence_min_cos * towards[d].norm() {
                return Err(INCIDENCES[d]);
            }
        }
        Ok(self.quality(&in_scanner, normal))
    }

    /// The quality of a sample that is measured.
    pub(super) fn quality_at(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> f32 {
        self.quality(&(self.scanner_from_part * p), normal)
    }

    /// c·Q_δ + d·Q_dis (method §5), each clamped to [−1, 1]. D is the half range on the sample's side of F.
    fn quality(&self, in_scanner: &Point3<f64>, normal: &Vector3<f64>) -> f32 {
        let optics = self.optics;
        let normal_in_scanner = self.scanner_from_part.rotation * normal;
        let against = match optics.angle {
            ScoreAngle::Ray => -in_scanner.coords.normalize(),
            ScoreAngle::OpticalAxis => -Vector3::z(),
        };
        let incidence_rad = normal_in_scanner.dot(&against).clamp(-1.0, 1.0).acos();
        let q_angle = (1.0 - 2.0 * incidence_rad / optics.incidence_reference_rad).clamp(-1.0, 1.0);
        let off_mm = in_scanner.z - optics.best_mm;
        let half_range_mm = if off_mm < 0.0 { optics.best_mm - optics.near_mm } else { optics.far_mm - optics.best_mm };
        let q_distance = (1.0 - 2.0 * off_mm.abs() / half_range_mm).clamp(-1.0, 1.0);
        (optics.angle_weight * q_angle + optics.distance_weight * q_distance) as f32
    }
}
