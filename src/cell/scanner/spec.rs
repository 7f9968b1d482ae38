//! The scanner as it is written in TOML presets and over HTTP: ranges, consistency, and the way to a [`Scanner`](super::Scanner).

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::calibrated::CalibratedScannerSpec;
use super::cloud_frame::CloudFrameSpec;
use super::device::{DeviceName, Lens, OpticalDevice};
use super::exposure::ExposureSpec;
use super::per_device::PerDevice;
use crate::cell::field_error::{FieldError, Findings};
use crate::cell::pose_spec::{PoseInput, PoseSpec};
use crate::cell::shape_spec::BodySpec;
use crate::cell::{FieldRange, field_ranges};
use crate::geometry::{Device, Pose, ScannerFrame};

/// Largest deviation of the rows of a printed rotation from orthonormal.
const ROTATION_TOLERANCE: f64 = 1e-3;
/// Cameras closer than this, along x of the scanner, cannot triangulate.
const BASELINE_MIN_MM: f64 = 1.0;
/// Most pixels that an image may have along an edge.
const MAX_SIZE_PX: f64 = 1e5;
/// Range of the principal point of a projector along v, in heights of its image: the lens is often shifted, so that its picture
/// lies above or below its axis.
const SHIFT: [f64; 2] = [-2.0, 3.0];
/// Widest angle that a pinhole's image may show, degrees. Fisheyes beyond it need another model; a focal length in millimetres that
/// was taken for pixels shows nearly 180°.
const MAX_VIEW_DEG: f64 = 150.0;

/// A structured-light scanner. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ScannerSpec {
    /// Name, unique among scanners.
    pub name: String,
    /// Working depth.
    pub depth_mm: DepthSpec,
    /// Left camera.
    pub left: DeviceSpec,
    /// Right camera.
    pub right: DeviceSpec,
    /// Projector.
    pub projector: DeviceSpec,
    /// Poses of a calibration board seen by both cameras, instead of `scanner_from_device` on each camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board_poses: Option<BoardPosesSpec>,
    /// Frame that its clouds are in: `scanner`, `left`, `right`, `projector`, or the pose of that frame in the scanner. The
    /// calibration of a cell asks for it. Default: not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scanner_from_cloud: Option<CloudFrameSpec>,
    /// Mass, kg, 0.01 to 100.
    pub mass_kg: f64,
    /// Centre of mass, scanner frame, mm, -2000 to 2000 each. Default: the mean of the centres of its bodies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 3, max_items = 3)]
    pub centre_of_mass_mm: Option<[f64; 3]>,
    /// Envelope for collision tests, in the scanner frame.
    #[serde(default)]
    pub body: Vec<BodySpec>,
    /// Measurement volume as its source states it from optics alone, along x, y, z, mm, 1 to 10000 each; compared with
    /// the volume derived here, used for nothing else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 3, max_items = 3)]
    pub stated_volume_mm: Option<[f64; 3]>,
    /// Practical measurement volume along x, y, z, mm, 1 to 10000 each.
    #[schema(min_items = 3, max_items = 3)]
    pub practical_volume_mm: [f64; 3],
    /// Edge of the cube that blocks of a large part must fit in, mm, 1 to 10000. Default: the largest cube in the practical
    /// measurement volume, which is the shortest of its three edges.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub block_cube_mm: Option<f64>,
    /// Depth along z of the scanner at which `depth_mm` counts 0, mm, -1000 to 1000: 0 for distances from the cameras' optical
    /// centres, that of the housing's front for distances from there. Default 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_origin_mm: Option<f64>,
    /// Brightness levels of the projector. Default: assumed, each √2 times as bright as the one before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<ExposureSpec>,
    /// Origin of lenses and poses, where they were calibrated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrated: Option<CalibratedScannerSpec>,
}

/// Working depth along +z of the scanner: 1 ≤ near < best < far ≤ 10000 mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct DepthSpec {
    /// Nearest depth, mm, 1 to 10000, below `best`.
    pub near: f64,
    /// Depth of best focus, mm, 1 to 10000, between `near` and `far`.
    pub best: f64,
    /// Farthest depth, mm, 1 to 10000, beyond `best`.
    pub far: f64,
}

/// One optical device: pinhole with skew and distortion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct DeviceSpec {
    /// Pose of the device in the scanner frame; left out for cameras when `board_poses` is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<PoseInput>)]
    pub scanner_from_device: Option<PoseSpec>,
    /// Image width, pixels, 16 to 100000.
    pub width_px: u32,
    /// Image height, pixels, 16 to 100000.
    pub height_px: u32,
    /// Focal length along u, pixels (millimetres divided by the pixel pitch in mm), 1 to 1e6; the image may show up to 150°.
    pub fx: f64,
    /// Focal length along v, pixels, 1 to 1e6; the image may show up to 150°.
    pub fy: f64,
    /// Principal point, u, pixels from the outer corner of the first pixel, inside the image: 0 to `width_px`. OpenCV counts from
    /// the centre of that pixel: its value plus 0.5.
    pub cx: f64,
    /// Principal point, v, pixels from that corner, inside the image: 0 to `height_px`; of a projector, whose lens is often
    /// shifted, -2 to 3 times `height_px`.
    pub cy: f64,
    /// Bouguet's α, -0.1 to 0.1. Default 0.
    #[serde(default)]
    pub skew: f64,
    /// k1, k2, p1, p2, k3, each -10 to 10. Default 0.
    #[serde(default)]
    #[schema(min_items = 5, max_items = 5)]
    pub distortion: [f64; 5],
    /// Largest incidence at which the device works, degrees, 1 to 89.9.
    pub incidence_max_deg: f64,
    /// Distance between pixels on the sensor, µm, 0.1 to 100; only depth of field asks for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixel_pitch_um: Option<f64>,
    /// Effective f-number, 0.5 to 64; with `circle_of_confusion_um` and `pixel_pitch_um` it limits the working depth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub f_number: Option<f64>,
    /// Largest circle of confusion that can still be decoded, µm, 0.1 to 1000; given with `f_number`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub circle_of_confusion_um: Option<f64>,
    /// Distance in focus along the optical axis from the optical centre, mm, 10 to 10000; given with `f_number`. Default: that of
    /// the point of best focus.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focus_mm: Option<f64>,
    /// Nearest and farthest distance in focus along the optical axis from the optical centre, mm, 1 to 10000, as [380, 580] for a
    /// projector of 480 ± 100; instead of `f_number`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 2, max_items = 2)]
    pub in_focus_mm: Option<[f64; 2]>,
}

/// One board, seen by both cameras at the same time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct BoardPosesSpec {
    /// The board in the left camera.
    pub left: BoardPoseSpec,
    /// The board in the right camera.
    pub right: BoardPoseSpec,
}

/// `camera_from_board` as calibration tools print it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct BoardPoseSpec {
    /// Rows of the rotation matrix; orthonormal to 1e-3, projected onto the nearest rotation.
    #[schema(min_items = 3, max_items = 3)]
    pub rotation_rows: [[f64; 3]; 3],
    /// Origin of the board in the camera, mm.
    #[schema(min_items = 3, max_items = 3)]
    pub translation_mm: [f64; 3],
}

field_ranges! {
    ScannerSpec {
        MASS_KG = "mass_kg", [0.01, 100.0] "kg";
        CENTRE_OF_MASS_MM = "centre_of_mass_mm", [-2000.0, 2000.0] "mm";
        STATED_VOLUME_MM = "stated_volume_mm", [1.0, 1e4] "mm";
        PRACTICAL_VOLUME_MM = "practical_volume_mm", [1.0, 1e4] "mm";
        BLOCK_CUBE_MM = "block_cube_mm", [1.0, 1e4] "mm";
        DEPTH_ORIGIN_MM = "depth_origin_mm", [-1000.0, 1000.0] "mm";
    }
}

field_ranges! {
    DepthSpec {
        NEAR = "near", [1.0, 1e4] "mm";
        BEST = "best", [1.0, 1e4] "mm";
        FAR = "far", [1.0, 1e4] "mm";
    }
}

field_ranges! {
    DeviceSpec {
        WIDTH_PX = "width_px", [16.0, MAX_SIZE_PX] "px";
        HEIGHT_PX = "height_px", [16.0, MAX_SIZE_PX] "px";
        FX = "fx", [1.0, 1e6] "px";
        FY = "fy", [1.0, 1e6] "px";
        // The ranges of the largest image; the check is against the device's own.
        CX = "cx", [0.0, MAX_SIZE_PX] "px";
        CY = "cy", [SHIFT[0] * MAX_SIZE_PX, SHIFT[1] * MAX_SIZE_PX] "px";
        SKEW = "skew", [-0.1, 0.1] "";
        DISTORTION = "distortion", [-10.0, 10.0] "";
        INCIDENCE_MAX_DEG = "incidence_max_deg", [1.0, 89.9] "°";
        PIXEL_PITCH_UM = "pixel_pitch_um", [0.1, 100.0] "µm";
        F_NUMBER = "f_number", [0.5, 64.0] "";
        CIRCLE_OF_CONFUSION_UM = "circle_of_confusion_um", [0.1, 1000.0] "µm";
        FOCUS_MM = "focus_mm", [10.0, 1e4] "mm";
        IN_FOCUS_MM = "in_focus_mm", [1.0, 1e4] "mm";
    }
}

field_ranges! {
    BoardPoseSpec {
        TRANSLATION_MM = "translation_mm", [-1e5, 1e5] "mm";
    }
}

impl ScannerSpec {
    /// Checks every field and builds the scanner.
    ///
    /// # Errors
    /// All fields that are out of range; if none is, what the fields make together and should not.
    pub fn build(&self) -> Result<super::Scanner, Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check(&mut findings);
        findings.into_result()?;
        let mut findings = Findings::default();
        let (scanner_from_left, scanner_from_right) = self.camera_poses();
        let projector = self.projector.scanner_from_device.unwrap_or_default().pose();
        let origin_mm = self.depth_origin_mm.unwrap_or(0.0);
        let best = Point3::new(0.0, 0.0, self.depth_mm.best + origin_mm);
        let devices = PerDevice {
            left: self.left.build(DeviceName::Left, scanner_from_left, &best, &mut findings),
            right: self.right.build(DeviceName::Right, scanner_from_right, &best, &mut findings),
            projector: self.projector.build(DeviceName::Projector, projector, &best, &mut findings),
        };
        self.check_rig(&devices, &best, &mut findings);
        findings.into_result()?;
        Ok(super::Scanner {
            name: self.name.clone(),
            near_mm: self.depth_mm.near + origin_mm,
            best_mm: self.depth_mm.best + origin_mm,
            far_mm: self.depth_mm.far + origin_mm,
            devices,
            cloud_frame: self.scanner_from_cloud,
            mass_kg: self.mass_kg,
            centre_of_mass_mm: self.centre_of_mass_mm,
            body: self.body.clone(),
            stated_volume_mm: self.stated_volume_mm,
            practical_volume_mm: self.practical_volume_mm,
            block_cube_mm: self.block_cube_mm(),
            exposure: ExposureSpec::build(self.exposure.as_ref()),
            calibrated: self.calibrated.clone(),
        })
    }

    fn camera_poses(&self) -> (Pose<ScannerFrame, Device>, Pose<ScannerFrame, Device>) {
        match &self.board_poses {
            Some(boards) => boards.rig(),
            None => (
                self.left.scanner_from_device.unwrap_or_default().pose(),
                self.right.scanner_from_device.unwrap_or_default().pose(),
            ),
        }
    }

    /// The left camera is at −x of the right one, and all three devices see (0, 0, best).
    fn check_rig(&self, devices: &PerDevice<OpticalDevice>, best: &Point3<f64>, findings: &mut Findings) {
        let [left_mm, right_mm] = devices.cameras().map(|camera| camera.scanner_from_device.origin_mm().x);
        let baseline_mm = right_mm - left_mm;
        // Two equal board poses leave no baseline to lay x along: what comes out is not a number.
        if baseline_mm.is_nan() || baseline_mm < BASELINE_MIN_MM {
            let pointer = if self.board_poses.is_some() { "/board_poses" } else { "/right/scanner_from_device" };
            return findings.push(
                pointer,
                format!(
                    "the right camera must lie at least {BASELINE_MIN_MM} mm along +x of the scanner from the left one; it lies at \
                     {baseline_mm} mm (left x = {left_mm} mm, right x = {right_mm} mm): are the two swapped, or is the baseline in \
                     metres?"
                ),
            );
        }
        for device in devices {
            let in_device = device.scanner_from_device.inverse().point(best);
            let name = device.name.as_str();
            findings.require(device.lens.project(&in_device).is_some(), format!("/{name}"), || {
                format!("does not see the point (0, 0, {}) of best focus in the scanner frame", best.z)
            });
            let [near, far] = device.in_focus_mm;
            findings.require((near..=far).contains(&in_device.z), format!("/{name}"), || {
                format!(
                    "is in focus from {near:.1} to {far:.1} mm along its axis, but the point of best focus is at {:.1} mm",
                    in_device.z
                )
            });
        }
    }

    fn check(&self, findings: &mut Findings) {
        findings.require(!self.name.is_empty(), "/name", || "is empty; name the scanner".into());
        let DepthSpec { near, best, far } = self.depth_mm;
        DepthSpec::NEAR.check("/depth_mm", &near, findings);
        DepthSpec::BEST.check("/depth_mm", &best, findings);
        DepthSpec::FAR.check("/depth_mm", &far, findings);
        findings.require(near < best && best < far, "/depth_mm", || {
            format!("near {near}, best {best}, far {far}: must be near < best < far")
        });
        let devices = PerDevice { left: &self.left, right: &self.right, projector: &self.projector };
        for (device, name) in devices.into_iter().zip(DeviceName::ALL) {
            let from_board = self.board_poses.is_some() && name != DeviceName::Projector;
            device.check(name, findings);
            let name = name.as_str();
            findings.require(from_board != device.scanner_from_device.is_some(), format!("/{name}/scanner_from_device"), || {
                if from_board {
                    "is given beside board_poses; give one of the two".into()
                } else {
                    "is missing; give the device's pose".into()
                }
            });
        }
        if let Some(boards) = &self.board_poses {
            boards.check(findings);
        }
        if let Some(frame) = &self.scanner_from_cloud {
            frame.check("/scanner_from_cloud", findings);
        }
        Self::MASS_KG.check("", &self.mass_kg, findings);
        Self::CENTRE_OF_MASS_MM.check("", &self.centre_of_mass_mm, findings);
        for (index, body) in self.body.iter().enumerate() {
            body.check(&format!("/body/{index}"), findings);
        }
        Self::STATED_VOLUME_MM.check("", &self.stated_volume_mm, findings);
        Self::PRACTICAL_VOLUME_MM.check("", &self.practical_volume_mm, findings);
        Self::BLOCK_CUBE_MM.check("", &self.block_cube_mm, findings);
        Self::DEPTH_ORIGIN_MM.check("", &self.depth_origin_mm, findings);
        if let Some(exposure) = &self.exposure {
            exposure.check("/exposure", findings);
        }
        if let Some(calibrated) = &self.calibrated {
            calibrated.check(findings);
        }
    }

    /// Edge of the block cube: as given, else the shortest edge of the practical volume.
    fn block_cube_mm(&self) -> f64 {
        self.block_cube_mm.unwrap_or_else(|| self.practical_volume_mm.iter().copied().fold(f64::INFINITY, f64::min))
    }
}

impl DeviceSpec {
    fn check(&self, name: DeviceName, findings: &mut Findings) {
        let pointer = &format!("/{}", name.as_str());
        if let Some(pose) = &self.scanner_from_device {
            pose.check(&format!("{pointer}/scanner_from_device"), findings);
        }
        let (width, height) = (f64::from(self.width_px), f64::from(self.height_px));
        Self::WIDTH_PX.check(pointer, &self.width_px, findings);
        Self::HEIGHT_PX.check(pointer, &self.height_px, findings);
        self.check_focal_length(&Self::FX, pointer, self.fx, width, findings);
        self.check_focal_length(&Self::FY, pointer, self.fy, height, findings);
        findings.range(format!("{pointer}/cx"), self.cx, 0.0, width, "px");
        let [low, high] = if name == DeviceName::Projector { SHIFT } else { [0.0, 1.0] };
        findings.range(format!("{pointer}/cy"), self.cy, low * height, high * height, "px");
        Self::SKEW.check(pointer, &self.skew, findings);
        Self::DISTORTION.check(pointer, &self.distortion, findings);
        Self::INCIDENCE_MAX_DEG.check(pointer, &self.incidence_max_deg, findings);
        Self::PIXEL_PITCH_UM.check(pointer, &self.pixel_pitch_um, findings);
        self.check_focus(pointer, findings);
    }

    /// Records a focal length that is out of range, or with which the image shows more than [`MAX_VIEW_DEG`]: 2·atan(size / 2f).
    fn check_focal_length(&self, range: &FieldRange, at: &str, focal_px: f64, size_px: f64, findings: &mut Findings) {
        let min_px = 0.5 * size_px / (0.5 * MAX_VIEW_DEG.to_radians()).tan();
        // A size or a length that is out of range has its own finding.
        let ([shortest_px, longest_px], [fewest_px, most_px]) = (range.range, Self::WIDTH_PX.range);
        let is_wide = (shortest_px..min_px).contains(&focal_px) && (fewest_px..=most_px).contains(&size_px);
        if !is_wide {
            return range.check(at, &focal_px, findings);
        }
        let view_deg = 2.0 * (0.5 * size_px / focal_px).atan().to_degrees();
        let pitch_um = self.pixel_pitch_um.filter(|pitch_um| *pitch_um > 0.0);
        let advice = pitch_um.map_or_else(
            || "if it is in millimetres, divide it by the pixel pitch in mm".to_owned(),
            |pitch_um| {
                let in_px = focal_px * 1000.0 / pitch_um;
                format!("if it is in millimetres, {focal_px} mm at {pitch_um} µm a pixel are {in_px:.1} px")
            },
        );
        let min_px = min_px.ceil();
        findings.push(
            format!("{at}/{}", range.field),
            format!(
                "is {focal_px} px, with which {size_px} px show {view_deg:.1} °; allowed is {min_px} to {longest_px} px \
                 (up to {MAX_VIEW_DEG} °): {advice}"
            ),
        );
    }

    fn build(
        &self,
        name: DeviceName,
        pose: Pose<ScannerFrame, Device>,
        best: &Point3<f64>,
        findings: &mut Findings,
    ) -> OpticalDevice {
        let size_px = [self.width_px, self.height_px].map(f64::from);
        let flat = Lens::without_field(size_px, [self.fx, self.fy, self.cx, self.cy], self.skew, self.distortion);
        let lens = flat.with_field();
        findings.require(lens.is_some(), format!("/{}/distortion", name.as_str()), || {
            let radius = flat.fold_radius_px();
            let at = radius.map_or_else(String::new, |[fold, corner]| {
                format!(" at {fold:.0} px from the principal point; the image reaches {corner:.0} px")
            });
            format!("{:?} folds the image over itself{at}; a lens images every direction of its field once", self.distortion)
        });
        OpticalDevice {
            name,
            scanner_from_device: pose,
            lens: lens.unwrap_or(flat),
            incidence_max_rad: self.incidence_max_deg.to_radians(),
            pixel_pitch_mm: self.pixel_pitch_um.map(|um| um / 1000.0),
            in_focus_mm: self.in_focus_mm(pose.inverse().point(best).z),
        }
    }
}

impl BoardPoseSpec {
    fn matrix(&self) -> Matrix3<f64> {
        let [a, b, c] = self.rotation_rows;
        Matrix3::new(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2])
    }

    fn check(&self, pointer: &str, findings: &mut Findings) {
        let matrix = self.matrix();
        let residual = (matrix * matrix.transpose() - Matrix3::identity()).amax();
        findings.require(
            residual <= ROTATION_TOLERANCE && matrix.determinant() > 0.0,
            format!("{pointer}/rotation_rows"),
            || {
                format!(
                    "is not a rotation: R·Rᵀ is off identity by {residual}, determinant {}; allowed is {ROTATION_TOLERANCE}",
                    matrix.determinant()
                )
            },
        );
        Self::TRANSLATION_MM.check(pointer, &self.translation_mm, findings);
    }

    /// The pose, with the printed rotation projected onto SO(3) (nearest in the Frobenius norm, by SVD).
    fn camera_from_board(&self) -> Isometry3<f64> {
        let svd = self.matrix().svd(true, true);
        let rotation = match (svd.u, svd.v_t) {
            (Some(u), Some(v_t)) => Rotation3::from_matrix_unchecked(u * v_t),
            _ => Rotation3::identity(),
        };
        Isometry3::from_parts(
            Translation3::from(Vector3::from(self.translation_mm)),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }
}

impl BoardPosesSpec {
    fn check(&self, findings: &mut Findings) {
        self.left.check("/board_poses/left", findings);
        self.right.check("/board_poses/right", findings);
    }

    /// Camera poses in the scanner frame.
    fn rig(&self) -> (Pose<ScannerFrame, Device>, Pose<ScannerFrame, Device>) {
        let left_from_right = self.left.camera_from_board() * self.right.camera_from_board().inverse();
        let scanner_from_left = left_from_scanner(&left_from_right).inverse();
        (Pose::claim(scanner_from_left), Pose::claim(scanner_from_left * left_from_right))
    }
}

/// The scanner frame in the left camera: origin = middle of the baseline, x along it, z = mean optical axis made perpendicular to
/// x ([`crate::planning::method::scanner`]).
pub(in crate::cell) fn left_from_scanner(left_from_right: &Isometry3<f64>) -> Isometry3<f64> {
    let baseline = left_from_right.translation.vector;
    let x = baseline.normalize();
    let mean_axis = Vector3::z() + left_from_right.rotation * Vector3::z();
    let z = (mean_axis - x * x.dot(&mean_axis)).normalize();
    let axes = Rotation3::from_basis_unchecked(&[x, z.cross(&x), z]);
    Isometry3::from_parts(Translation3::from(baseline * 0.5), UnitQuaternion::from_rotation_matrix(&axes))
}
