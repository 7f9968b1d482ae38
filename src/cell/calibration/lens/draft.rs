//! A scanner's specification from a rig: devices in the scanner frame, and for what a calibration does not say the values of a
//! specification to start from, or assumed ones, which are named.

use nalgebra::{Isometry3, Point3, Vector3};

use super::assemble::{Rig, RigDevice};
use super::fault::{LensError, LensFault};
use super::lit_rectangle::{LitRectangleSpec, lit_rectangle};
use crate::cell::closed_list::closed_list;
use crate::cell::scanner::left_from_scanner;
use crate::cell::{
    CalibratedScannerSpec, DataSheet, DeviceName, DeviceSpec, Field, PerDevice, PoseSpec, Scanner, ScannerSpec, ShapeSpec,
};
use crate::geometry::Pose;

/// Working depth on both sides of best focus that is assumed, as a share of it.
const DEPTH_SHARE: f64 = 0.15;
/// Axes that meet farther away than this cannot say where best focus is, mm.
const MAX_FOCUS_MM: f64 = 1e4;

closed_list! {
    /// Value that neither calibration nor options give, and that was therefore assumed.
    pub enum Assumption {
        /// Best focus where the cameras' optical axes come closest.
        BestFocus = "best_focus",
        /// Working depth of 15 % of best focus on both sides.
        Depth = "depth",
        /// Field at best focus as far as both cameras see.
        Field = "field",
        /// Projector as a pinhole at the middle of the baseline with the field as its image.
        Projector = "projector",
        /// Limits of incidence, mass and housing of an unknown scanner.
        Housing = "housing",
    }
}

/// Figures that a calibration does not give.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DraftFigures {
    /// Name of the scanner.
    pub name: Option<String>,
    /// Width and height of the field, and the working distance of best focus, mm.
    pub field_mm: Option<[f64; 3]>,
    /// Nearest and farthest working distance, mm.
    pub depth_mm: Option<[f64; 2]>,
    /// Depth from which working distances count, mm.
    pub depth_origin_mm: Option<f64>,
    /// Rectangle that the projector lights.
    pub lit_rectangle: Option<LitRectangleSpec>,
    /// Specification whose other fields are kept.
    pub like: Option<ScannerSpec>,
}

/// Figures to compare after an import.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DraftChecks {
    /// Distance between the cameras' optical centres, mm.
    pub baseline_mm: f64,
    /// Angle between the cameras' optical axes, degrees.
    pub axes_angle_deg: f64,
    /// Field that both cameras see at best focus, mm.
    pub cameras_field: Field,
    /// Field that all three devices see at best focus, mm.
    pub common_field: Field,
    /// Stated width and height of the field, mm.
    pub stated_field_mm: Option<[f64; 2]>,
    /// Depth of best focus, scanner frame, mm: there all three devices see the point on the axis.
    pub best_mm: f64,
}

/// A specification with what it rests on.
#[derive(Clone, Debug, PartialEq)]
pub struct ScannerDraft {
    /// The specification.
    pub spec: ScannerSpec,
    /// The projector, where it was found from the rectangle that it lights.
    pub lit: Option<RigDevice>,
    /// Values that were assumed.
    pub assumptions: Vec<Assumption>,
    /// Figures to compare.
    pub checks: DraftChecks,
}

impl ScannerDraft {
    /// Makes the specification, and checks it: all devices see the point of best focus, no lens folds.
    ///
    /// # Errors
    /// [`LensError`]: figures out of range, a field that is not seen, a specification that cannot be built.
    pub fn new(rig: &Rig, figures: &DraftFigures, calibrated: CalibratedScannerSpec) -> Result<Self, LensError> {
        let (Some(left), Some(right)) = (&rig.devices.left, &rig.devices.right) else {
            return Err(LensError::new(LensFault::MissingDevice, "", "needs both cameras"));
        };
        let left_from_scanner = left_from_scanner(&rig.right_from_left.inverse());
        let scanner_from_left = left_from_scanner.inverse();
        let poses = PerDevice {
            left: scanner_from_left,
            right: scanner_from_left * rig.right_from_left.inverse(),
            projector: rig.projector_from_left.map_or(scanner_from_left, |pose| scanner_from_left * pose.inverse()),
        };
        let mut assumptions = Vec::new();
        let mut spec = base(rig, figures, &poses, &mut assumptions)?;
        spec.board_poses = None;
        spec.left = with(&spec.left, left, &poses.left);
        spec.right = with(&spec.right, right, &poses.right);
        let mut lit = None;
        if let Some(projector) = &rig.devices.projector {
            spec.projector = with(&spec.projector, projector, &poses.projector);
        } else if let Some(rectangle) = &figures.lit_rectangle {
            let (device, device_from_scanner) = lit_rectangle(rectangle)?;
            spec.projector = with(&spec.projector, &device, &device_from_scanner.inverse());
            lit = Some(device);
        } else if figures.like.is_none() {
            assumptions.push(Assumption::Projector);
        }
        spec.calibrated = Some(calibrated);
        let scanner = build(&spec)?;
        let checks = checks(&scanner, figures);
        Ok(Self { spec, lit, assumptions, checks })
    }
}

fn build(spec: &ScannerSpec) -> Result<Scanner, LensError> {
    spec.build().map_err(|errors| {
        let first = errors.into_iter().next();
        let (pointer, detail) = first.map_or_else(Default::default, |error| (error.pointer, error.detail));
        let code = if pointer.ends_with("/distortion") { LensFault::Folds } else { LensFault::OutOfRange };
        LensError::new(code, pointer, detail)
    })
}

/// Depth of the front of a scanner's housing, scanner frame, mm; `None` without a box.
#[must_use]
pub fn housing_front_mm(spec: &ScannerSpec) -> Option<f64> {
    let fronts = spec.body.iter().filter_map(|body| {
        let ShapeSpec::Box { size_mm } = &body.shape else { return None };
        Some(body.owner_from_body.translation_mm[2] + 0.5 * size_mm[2])
    });
    fronts.reduce(f64::max)
}

/// The specification to start from: the one given, else that of a data sheet with the rig's figures.
fn base(
    rig: &Rig,
    figures: &DraftFigures,
    poses: &PerDevice<Isometry3<f64>>,
    assumptions: &mut Vec<Assumption>,
) -> Result<ScannerSpec, LensError> {
    // Distances count from there; the cameras' axes meet at a depth of the scanner's frame.
    let origin_mm = figures.depth_origin_mm.unwrap_or_default();
    let mut spec = match &figures.like {
        Some(like) => like.clone(),
        None => {
            let best_mm = match figures.field_mm {
                Some([_, _, best_mm]) => best_mm,
                None => {
                    assumptions.push(Assumption::BestFocus);
                    meeting_mm(&poses.left, &poses.right)? - origin_mm
                }
            };
            let depth_of_best_mm = best_mm + origin_mm;
            let seen_mm = |assumptions: &mut Vec<Assumption>| seen_mm(rig, poses, depth_of_best_mm, assumptions);
            let field_mm = figures.field_mm.map_or_else(|| seen_mm(assumptions), |[w, h, _]| Ok([w, h]))?;
            let depth_mm = figures.depth_mm.unwrap_or_else(|| {
                assumptions.push(Assumption::Depth);
                [best_mm * (1.0 - DEPTH_SHARE), best_mm * (1.0 + DEPTH_SHARE)].map(|mm| mm.round())
            });
            assumptions.push(Assumption::Housing);
            let baseline_mm = rig.right_from_left.translation.vector.norm();
            let sheet = DataSheet::new(field_mm, depth_of_best_mm, depth_mm.map(|mm| mm + origin_mm), baseline_mm);
            let mut spec = sheet.spec().map_err(|errors| {
                let first = errors.into_iter().next();
                let (pointer, detail) = first.map_or_else(Default::default, |error| (error.pointer, error.detail));
                LensError::new(LensFault::OutOfRange, pointer, detail)
            })?;
            let depth = &mut spec.depth_mm;
            [&mut depth.near, &mut depth.best, &mut depth.far].into_iter().for_each(|mm| *mm -= origin_mm);
            spec
        }
    };
    if let Some(name) = &figures.name {
        spec.name.clone_from(name);
    }
    if let Some([_, _, best_mm]) = figures.field_mm {
        spec.depth_mm.best = best_mm;
    }
    if let Some([near, far]) = figures.depth_mm {
        (spec.depth_mm.near, spec.depth_mm.far) = (near, far);
    }
    if figures.depth_origin_mm.is_some() {
        spec.depth_origin_mm = figures.depth_origin_mm;
    }
    Ok(spec)
}

/// Depth at which the cameras' optical axes come closest, scanner frame.
fn meeting_mm(left: &Isometry3<f64>, right: &Isometry3<f64>) -> Result<f64, LensError> {
    let (a, b) = (left.rotation * Vector3::z(), right.rotation * Vector3::z());
    let between = right.translation.vector - left.translation.vector;
    let (ab, determinant) = (a.dot(&b), 1.0 - a.dot(&b).powi(2));
    let along = (between.dot(&a) - ab * between.dot(&b)) / determinant;
    let depth_mm = left.translation.vector.z + along * a.z;
    if (1.0..=MAX_FOCUS_MM).contains(&depth_mm) {
        return Ok(depth_mm.round());
    }
    let detail = "the optical axes do not meet in front of the cameras: give --field WIDTHxHEIGHT@DISTANCE";
    Err(LensError::new(LensFault::MissingField, "--field", detail))
}

/// Size of the largest field about the axis that both cameras see.
fn seen_mm(
    rig: &Rig,
    poses: &PerDevice<Isometry3<f64>>,
    best_mm: f64,
    assumptions: &mut Vec<Assumption>,
) -> Result<[f64; 2], LensError> {
    assumptions.push(Assumption::Field);
    let sees = |name: DeviceName, point: &Point3<f64>| {
        rig.devices[name].as_ref().is_none_or(|device| {
            let pixel = device.lens.project(&(poses[name].inverse() * point));
            let [width, height] = device.lens.size_px.map(f64::from);
            (0.0..width).contains(&pixel.x) && (0.0..height).contains(&pixel.y)
        })
    };
    let both = |point: &Point3<f64>| sees(DeviceName::Left, point) && sees(DeviceName::Right, point);
    let half = |along: Vector3<f64>| {
        let fits =
            |half_mm: f64| [1.0, -1.0].into_iter().all(|sign| both(&(Point3::new(0.0, 0.0, best_mm) + along * (sign * half_mm))));
        let (mut low, mut high) = (0.0, 3.0 * best_mm);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if fits(middle) { low = middle } else { high = middle }
        }
        low
    };
    let size_mm = [2.0 * half(Vector3::x()), 2.0 * half(Vector3::y())].map(|mm| mm.floor());
    if size_mm.iter().all(|mm| *mm >= 1.0) {
        return Ok(size_mm);
    }
    let detail =
        format!("the cameras do not both see the point (0, 0, {best_mm}) of best focus: is the right one's pose inverted?");
    Err(LensError::new(LensFault::Inconsistent, "/right", detail))
}

/// The specification of a device with another lens and pose; focal depth and pitch stay.
fn with(spec: &DeviceSpec, device: &RigDevice, scanner_from_device: &Isometry3<f64>) -> DeviceSpec {
    let lens = &device.lens;
    let pose: Pose<crate::geometry::ScannerFrame, crate::geometry::Device> = Pose::claim(*scanner_from_device);
    DeviceSpec {
        scanner_from_device: Some(PoseSpec::from(&pose)),
        width_px: lens.size_px[0],
        height_px: lens.size_px[1],
        fx: lens.fx,
        fy: lens.fy,
        cx: lens.cx,
        cy: lens.cy,
        skew: lens.skew,
        distortion: lens.distortion,
        ..*spec
    }
}

fn checks(scanner: &Scanner, figures: &DraftFigures) -> DraftChecks {
    let PerDevice { left, right, .. } = scanner.devices.map(|device| device.field_at(scanner.best_mm));
    DraftChecks {
        baseline_mm: scanner.baseline_mm(),
        axes_angle_deg: scanner.axes_angle_rad().to_degrees(),
        cameras_field: left.common(&right),
        common_field: scanner.common_field_at(scanner.best_mm),
        stated_field_mm: figures.field_mm.map(|[width, height, _]| [width, height]),
        best_mm: scanner.best_mm,
    }
}
