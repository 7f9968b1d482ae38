//! `vantage.calibration_data/1`: observations of a board from many poses of arm and table.

use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::pose::ObservedPose;
use crate::cell::calibration::data::{ChainEstimate, HandEyeSetup, Sighting, Sigma, Solve};
use crate::cell::calibration::findings::CalibrationFinding;
use crate::cell::calibration::lens::{LensError, LensParameters, board_in_camera};
use crate::cell::calibration::observability::UncertaintyLimits;
use crate::cell::calibration::placement::{self, Placement};
use crate::cell::calibration::solve::Task;
use crate::cell::calibration::table::FacePoint;
use crate::cell::calibration::witness::{self, Witnessed};
use crate::cell::{Cell, CloudFrame, CloudFrameSpec, FieldError, Findings, RangeGroup, field_ranges};
use crate::wire::UtcTime;
use crate::wire::schema_name::schema_name;
use crate::wire::words::counted;

/// Name and version of the shape.
pub const CALIBRATION_DATA_SCHEMA: &str = "vantage.calibration_data/1";
/// Observations that a calibration may have, and points that one of them may have.
const MAX_OBSERVATIONS: usize = 5000;
const MAX_POINTS: usize = 20_000;
/// Scans of the plate that observations may have.
const MAX_PLATE_SCANS: usize = 1000;
/// Largest number of points along an edge of a board.
const MAX_BOARD_POINTS: f64 = 1000.0;
/// Largest coordinate of a point, mm, and of a pixel.
const FARTHEST: f64 = 1e5;
/// Largest angle of a joint or of the table, degrees.
const MAX_ANGLE_DEG: f64 = 3600.0;
/// Standard deviation of a point where none is given, mm: a structured-light scanner's at best focus.
const POINT_SIGMA_MM: f64 = 0.02;
/// Standard deviation of a pixel where none is given.
const PIXEL_SIGMA_PX: f64 = 0.1;
/// Largest reprojection error of a board, rms, in standard deviations of a pixel: beyond it the points are not those of the board.
const MAX_REPROJECTION: f64 = 20.0;

schema_name!(CalibrationDataSchema, CALIBRATION_DATA_SCHEMA);

/// Observations. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CalibrationData {
    /// `vantage.calibration_data/1`.
    #[schema(value_type = CalibrationDataSchema)]
    pub schema: String,
    /// Name of the observed cell, for information only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell: Option<String>,
    /// Mounting of the scanner: `eye_in_hand`, on the flange (the default), or `eye_to_hand`, fixed in the cell with the board on
    /// the flange.
    #[serde(default = "in_hand")]
    pub setup: HandEyeSetup,
    /// Frame of the point clouds, in place of the one in the scanner's specification.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cloud_frame: Option<CloudFrameSpec>,
    /// Time of the observations, RFC 3339.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub taken_at: Option<UtcTime>,
    /// Temperature in the cell, °C, -50 to 100.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// The board.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board: Option<BoardDocument>,
    /// Camera in whose images the board was observed. Its frame counts as that of the clouds, which `cloud_frame` or the
    /// scanner's specification then has to name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraDocument>,
    /// Standard deviations of arm and board. Default: estimated from the observations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<SigmaDocument>,
    /// Observations, 1 to 5000.
    pub observations: Vec<ObservationDocument>,
    /// Scans of the bare plate, at most 1000. If given, the table's origin is placed on the face of the plate. Not allowed with
    /// `hand_eye`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plate: Vec<PlateScanDocument>,
}

/// A scan of the plate's bare face. Unknown fields are refused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct PlateScanDocument {
    /// Joints 1 to 6, degrees, -3600 to 3600 each.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 6, max_items = 6)]
    pub joints_deg: Option<[f64; 6]>,
    /// Pose of the flange as the controller reported it, instead of `joints_deg`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_from_flange: Option<ObservedPose>,
    /// Angle of the table, degrees, -3600 to 3600. Default 0.
    #[serde(default)]
    pub table_angle_deg: f64,
    /// Points of the face in the cloud, mm, 3 to 20000.
    pub points_mm: Vec<[f64; 3]>,
}

fn in_hand() -> HandEyeSetup {
    HandEyeSetup::EyeInHand
}

/// A calibration board. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum BoardDocument {
    /// Chessboard; its origin is its first inner corner.
    Chessboard {
        /// Inner corners along x.
        columns: u16,
        /// Inner corners along y.
        rows: u16,
        /// Edge of a square, mm, 0.01 to 1000.
        square_mm: f64,
    },
    /// Chessboard with markers, which has an orientation; its origin is its corner.
    Charuco {
        /// Squares along x.
        columns: u16,
        /// Squares along y.
        rows: u16,
        /// Edge of a square, mm, 0.01 to 1000.
        square_mm: f64,
    },
    /// Grid of circles; its origin is the centre of the first.
    Circles {
        /// Circles along x.
        columns: u16,
        /// Circles along y.
        rows: u16,
        /// Distance between centres, mm, 0.01 to 1000.
        spacing_mm: f64,
    },
    /// Spheres with names, whose centres are given with the observations.
    Spheres {},
}

impl BoardDocument {
    /// Middle of a board without a mark for its orientation, mm; none for one that has such a mark.
    #[must_use]
    pub fn middle_mm(&self) -> Option<Vector3<f64>> {
        let middle = |columns: u16, rows: u16, pitch_mm: f64| {
            Vector3::new(f64::from(columns) - 1.0, f64::from(rows) - 1.0, 0.0) * (0.5 * pitch_mm)
        };
        match self {
            Self::Chessboard { columns, rows, square_mm } => Some(middle(*columns, *rows, *square_mm)),
            Self::Circles { columns, rows, spacing_mm } => Some(middle(*columns, *rows, *spacing_mm)),
            Self::Charuco { .. } | Self::Spheres {} => None,
        }
    }

    /// Edge of a square, or distance between points; none for spheres.
    #[must_use]
    pub fn pitch_mm(&self) -> Option<f64> {
        match self {
            Self::Chessboard { square_mm, .. } | Self::Charuco { square_mm, .. } => Some(*square_mm),
            Self::Circles { spacing_mm, .. } => Some(*spacing_mm),
            Self::Spheres {} => None,
        }
    }

    fn check(&self, findings: &mut Findings) {
        let (columns, rows, pitch, pitch_mm) = match self {
            Self::Chessboard { columns, rows, square_mm } | Self::Charuco { columns, rows, square_mm } => {
                (columns, rows, Self::SQUARE_MM, square_mm)
            }
            Self::Circles { columns, rows, spacing_mm } => (columns, rows, Self::SPACING_MM, spacing_mm),
            Self::Spheres {} => return,
        };
        Self::COLUMNS.check("/board", columns, findings);
        Self::ROWS.check("/board", rows, findings);
        pitch.check("/board", pitch_mm, findings);
    }
}

/// Standard deviations for each axis. Unknown fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct SigmaDocument {
    /// Rotation of the flange, degrees, 0.00001 to 5.
    pub robot_deg: f64,
    /// Position of the flange, mm, 0.0001 to 50.
    pub robot_mm: f64,
    /// Rotation of the board in the cloud, degrees, 0.00001 to 5.
    pub board_deg: f64,
    /// Position of the board in the cloud, mm, 0.0001 to 50.
    pub board_mm: f64,
}

impl From<SigmaDocument> for Sigma {
    fn from(document: SigmaDocument) -> Self {
        Self {
            robot_rad: document.robot_deg.to_radians(),
            robot_mm: document.robot_mm,
            board_rad: document.board_deg.to_radians(),
            board_mm: document.board_mm,
        }
    }
}

impl From<Sigma> for SigmaDocument {
    fn from(sigma: Sigma) -> Self {
        Self {
            robot_deg: sigma.robot_rad.to_degrees(),
            robot_mm: sigma.robot_mm,
            board_deg: sigma.board_rad.to_degrees(),
            board_mm: sigma.board_mm,
        }
    }
}

/// Camera in whose images the board was observed, in the model of Brown and Bouguet (OpenCV's with five coefficients). Unknown
/// fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CameraDocument {
    /// Image width, pixels, 16 to 100000.
    pub width_px: u32,
    /// Image height, pixels, 16 to 100000.
    pub height_px: u32,
    /// Focal length along u, pixels, 1 to 1e6.
    pub fx: f64,
    /// Focal length along v, pixels, 1 to 1e6.
    pub fy: f64,
    /// Principal point along u, pixels, counted in the same way as `px` of the observations.
    pub cx: f64,
    /// Principal point along v, pixels, counted in the same way as `px` of the observations.
    pub cy: f64,
    /// Skew coefficient α of Bouguet's model, -0.1 to 0.1. Default 0.
    #[serde(default)]
    pub skew: f64,
    /// k1, k2, p1, p2, k3, each -10 to 10. Default 0.
    #[serde(default)]
    #[schema(min_items = 5, max_items = 5)]
    pub distortion: [f64; 5],
    /// Standard deviation of an observed point of the board, pixels, including the error left by the camera's own calibration,
    /// 0.001 to 10. Default 0.1.
    #[serde(default = "pixel_sigma_px")]
    pub sigma_px: f64,
}

fn pixel_sigma_px() -> f64 {
    PIXEL_SIGMA_PX
}

impl CameraDocument {
    fn is_sound(&self) -> bool {
        let mut findings = Findings::default();
        self.check(&mut findings);
        findings.into_result().is_ok()
    }

    fn lens(&self) -> LensParameters {
        let Self { width_px, height_px, fx, fy, cx, cy, skew, distortion, .. } = *self;
        LensParameters { size_px: [width_px, height_px], fx, fy, cx, cy, skew, distortion }
    }

    /// Records what is wrong with the lens: its first fault alone, since the others may follow from it.
    fn check(&self, findings: &mut Findings) {
        if let Err(LensError { pointer, detail, .. }) = self.lens().check("/camera") {
            findings.push(pointer, detail);
        }
        Self::SIGMA_PX.check("/camera", &self.sigma_px, findings);
    }
}

/// One observation: the flange by `joints_deg`, `base_from_flange` or both, and the board by `cloud_from_board`, `points`, `spheres`
/// or `pixels`. Unknown fields are refused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ObservationDocument {
    /// Unique name.
    pub id: String,
    /// Joints 1 to 6, degrees, -3600 to 3600 each.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 6, max_items = 6)]
    pub joints_deg: Option<[f64; 6]>,
    /// Angle of the table, degrees, -3600 to 3600. Default 0.
    #[serde(default)]
    pub table_angle_deg: f64,
    /// Pose of the flange as the controller reported it, without a tool: a cross-check if given with `joints_deg`, otherwise the
    /// pose that is used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_from_flange: Option<ObservedPose>,
    /// Pose of the board in the cloud.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cloud_from_board: Option<ObservedPose>,
    /// Points of the board that were found in the cloud, three or more.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<PointPairDocument>,
    /// Centres of spheres that were found in the cloud, three or more.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub spheres: Vec<SphereDocument>,
    /// Points of the board that were found in the image of `camera`: four or more on a plane, or six or more in space.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pixels: Vec<PixelPairDocument>,
}

/// A point of the board and its pixel. Unknown fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct PixelPairDocument {
    /// Position on the board, mm.
    #[schema(min_items = 3, max_items = 3)]
    pub board_mm: [f64; 3],
    /// Pixel u, v.
    #[schema(min_items = 2, max_items = 2)]
    pub px: [f64; 2],
}

/// A point of the board and its position in the cloud. Unknown fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct PointPairDocument {
    /// Position on the board, mm.
    #[schema(min_items = 3, max_items = 3)]
    pub board_mm: [f64; 3],
    /// Position in the cloud, mm.
    #[schema(min_items = 3, max_items = 3)]
    pub cloud_mm: [f64; 3],
}

/// A sphere in the cloud. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct SphereDocument {
    /// Name.
    pub name: String,
    /// Centre in the cloud, mm.
    #[schema(min_items = 3, max_items = 3)]
    pub centre_mm: [f64; 3],
}

/// Observations read and checked, with what their comparison with the arm's model shows.
#[derive(Clone, Debug)]
pub struct ReadObservations {
    /// Observations.
    pub sightings: Vec<Sighting>,
    /// Joints of those that give some; all or none.
    pub joints_rad: Vec<[f64; 6]>,
    /// Findings of the comparison.
    pub findings: Vec<CalibrationFinding>,
}

impl CalibrationData {
    /// Calibration that these observations of a cell ask for.
    ///
    /// # Errors
    /// Every field that is out of range.
    pub fn task(&self, cell: &Cell, solve: Solve, hold_out: usize) -> Result<(Task, Vec<CalibrationFinding>), Vec<FieldError>> {
        let read = self.read(cell, solve)?;
        let face = self.face(cell, solve)?;
        let scanner_from_cloud = *self.cloud_frame(cell).scanner_from_cloud(&cell.scanner.devices).isometry();
        let best = Point3::new(0.0, 0.0, cell.scanner.best_mm);
        let is_still = solve == Solve::HandEye && self.setup == HandEyeSetup::EyeInHand;
        let turned_rad =
            if is_still { self.observations.iter().map(|each| each.table_angle_deg.to_radians()).collect() } else { Vec::new() };
        let task = Task {
            sightings: read.sightings,
            joints_rad: read.joints_rad,
            solve,
            setup: self.setup,
            sigma: self.sigma.map(Sigma::from),
            nominal: ChainEstimate {
                flange_from_cloud: cell.flange_from_scanner.isometry() * scanner_from_cloud,
                base_from_table: *cell.base_from_table.isometry(),
                plate_from_board: Isometry3::identity(),
                scale: 1.0,
            },
            hold_out,
            best_in_cloud_mm: (scanner_from_cloud.inverse() * best).coords,
            best_mm: cell.scanner.best_mm,
            board_middle_mm: self.board.as_ref().and_then(BoardDocument::middle_mm),
            board_pitch_mm: self.board.as_ref().and_then(BoardDocument::pitch_mm),
            limits: UncertaintyLimits::default(),
            runout: cell.turntable.runout.clone(),
            face,
            turned_rad,
        };
        Ok((task, read.findings))
    }

    /// Frame of the clouds: by the data, else by the scanner's specification, else the scanner's own.
    #[must_use]
    pub fn cloud_frame(&self, cell: &Cell) -> CloudFrameSpec {
        self.cloud_frame.or(cell.scanner.cloud_frame).unwrap_or(CloudFrameSpec::Named(CloudFrame::Scanner))
    }

    /// Reads and checks every observation.
    ///
    /// # Errors
    /// Every field that is out of range.
    pub fn read(&self, cell: &Cell, solve: Solve) -> Result<ReadObservations, Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check_head(&mut findings);
        let has_camera = self.camera.is_some_and(|camera| camera.is_sound());
        let has_frame = self.cloud_frame.is_some() || cell.scanner.cloud_frame.is_some();
        findings.require(self.camera.is_none() || has_frame, "/cloud_frame", || {
            "is not given; the pixels of a camera need it: `left` or `right` for a camera of the scanner, else the camera's pose in the \
             scanner"
                .into()
        });
        let forward = |joints: &[f64; 6]| *cell.robot.base_from_flange(joints).isometry();
        let (mut sightings, mut joints_rad, mut witnessed) = (Vec::new(), Vec::new(), Vec::new());
        let constellation = self.constellation();
        for (index, each) in self.observations.iter().enumerate() {
            let pointer = format!("/observations/{index}");
            each.check(&pointer, &self.observations[..index], &mut findings);
            let joints = each.joints_deg.map(|joints| joints.map(f64::to_radians));
            let reported =
                each.base_from_flange.as_ref().and_then(|pose| pose.pose(&format!("{pointer}/base_from_flange"), &mut findings));
            let seen = match &self.camera {
                Some(camera) if !each.pixels.is_empty() => {
                    has_camera.then(|| each.imaged(camera, &pointer, &mut findings)).flatten()
                }
                Some(_) | None => each.seen(&constellation, &pointer, self.board_sigma_mm(), &mut findings),
            };
            if let (Some(joints_rad), Some(base_from_flange)) = (joints, reported) {
                witnessed.push(Witnessed { id: &each.id, joints_rad, base_from_flange });
            }
            joints_rad.extend(joints);
            let flange = joints.map(|joints| forward(&joints)).or(reported);
            let (Some(flange), Some((cloud_from_board, seen_covariance, points_mm))) = (flange, seen) else { continue };
            let base_from_flange = if self.setup == HandEyeSetup::EyeToHand { flange.inverse() } else { flange };
            let table_rad = if solve == Solve::HandEye { 0.0 } else { each.table_angle_deg.to_radians() };
            let id = each.id.clone();
            sightings.push(Sighting { id, base_from_flange, table_rad, cloud_from_board, seen_covariance, points_mm });
        }
        findings.into_result()?;
        if joints_rad.len() != sightings.len() {
            joints_rad.clear();
        }
        Ok(ReadObservations { sightings, joints_rad, findings: witness::compare(&witnessed, &forward) })
    }

    /// Points of the plate's face with where the robot was.
    fn face(&self, cell: &Cell, solve: Solve) -> Result<Vec<FacePoint>, Vec<FieldError>> {
        let mut findings = Findings::default();
        findings.require(self.plate.len() <= MAX_PLATE_SCANS, "/plate", || {
            format!("has {} scans; allowed are {MAX_PLATE_SCANS}", self.plate.len())
        });
        findings.require(self.plate.is_empty() || solve != Solve::HandEye, "/plate", || {
            "is given, but hand_eye solves for no table; solve for table or joint".into()
        });
        findings.require(self.plate.is_empty() || self.setup == HandEyeSetup::EyeInHand, "/plate", || {
            "is given, but the scanner stands in the cell; a plate is located with the scanner on the flange".into()
        });
        let mut face = Vec::new();
        for (index, scan) in self.plate.iter().enumerate().take(MAX_PLATE_SCANS) {
            let Some(base_from_flange) = scan.base_from_flange(&format!("/plate/{index}"), cell, &mut findings) else { continue };
            let table_rad = scan.table_angle_deg.to_radians();
            let point = |point: &[f64; 3]| FacePoint { base_from_flange, table_rad, cloud_mm: Point3::from(*point) };
            face.extend(scan.points_mm.iter().map(point));
        }
        findings.into_result()?;
        Ok(face)
    }

    fn board_sigma_mm(&self) -> f64 {
        self.sigma.map_or(POINT_SIGMA_MM, |sigma| sigma.board_mm)
    }

    fn check_head(&self, findings: &mut Findings) {
        findings.require(self.schema == CALIBRATION_DATA_SCHEMA, "/schema", || {
            format!("is {:?}; this version reads {CALIBRATION_DATA_SCHEMA:?}", self.schema)
        });
        if let Some(board) = &self.board {
            board.check(findings);
        }
        if let Some(camera) = &self.camera {
            camera.check(findings);
        }
        let has_pixels = self.observations.iter().any(|each| !each.pixels.is_empty());
        findings.require(self.camera.is_some() || !has_pixels, "/camera", || {
            "is not given; observations with pixels need the camera in whose image they are".into()
        });
        Self::TEMPERATURE_C.check("", &self.temperature_c, findings);
        if let Some(CloudFrameSpec::Pose(pose)) = &self.cloud_frame {
            pose.check("/cloud_frame", findings);
        }
        if let Some(sigma) = &self.sigma {
            findings.range("/sigma/robot_deg", sigma.robot_deg, 1e-5, 5.0, "°");
            findings.range("/sigma/robot_mm", sigma.robot_mm, 1e-4, 50.0, "mm");
            findings.range("/sigma/board_deg", sigma.board_deg, 1e-5, 5.0, "°");
            findings.range("/sigma/board_mm", sigma.board_mm, 1e-4, 50.0, "mm");
        }
        let count = self.observations.len();
        findings.require((1..=MAX_OBSERVATIONS).contains(&count), "/observations", || {
            format!("has {count} observations; allowed are 1 to {MAX_OBSERVATIONS}")
        });
    }

    /// Centres of the spheres as the first observation with all of them has them: the board's frame is that cloud's.
    fn constellation(&self) -> Vec<SphereDocument> {
        let most = self.observations.iter().map(|each| each.spheres.len()).max().unwrap_or(0);
        self.observations.iter().find(|each| each.spheres.len() == most).map_or_else(Vec::new, |each| each.spheres.clone())
    }
}

impl PlateScanDocument {
    /// Flange of a scan whose fields are in range.
    fn base_from_flange(&self, pointer: &str, cell: &Cell, findings: &mut Findings) -> Option<Isometry3<f64>> {
        Self::TABLE_ANGLE_DEG.check(pointer, &self.table_angle_deg, findings);
        Self::JOINTS_DEG.check(pointer, &self.joints_deg, findings);
        let count = self.points_mm.len();
        findings.require((3..=MAX_POINTS).contains(&count), format!("{pointer}/points_mm"), || {
            format!("has {}; allowed are 3 to {MAX_POINTS}", counted(count, "point"))
        });
        let is_point = |point: &[f64; 3]| point.iter().all(|value| value.is_finite() && value.abs() <= FARTHEST);
        findings.require(self.points_mm.iter().all(is_point), format!("{pointer}/points_mm"), || {
            "has a coordinate that is not a number within ±100000 mm".into()
        });
        match (&self.joints_deg, &self.base_from_flange) {
            (Some(joints_deg), None) => Some(*cell.robot.base_from_flange(&joints_deg.map(f64::to_radians)).isometry()),
            (None, Some(pose)) => pose.pose(&format!("{pointer}/base_from_flange"), findings),
            (Some(_), Some(_)) | (None, None) => {
                findings.push(pointer, "needs one of joints_deg and base_from_flange");
                None
            }
        }
    }
}

field_ranges! {
    CalibrationData {
        TEMPERATURE_C = "temperature_c", [-50.0, 100.0] "°C";
    }
}

field_ranges! {
    BoardDocument {
        COLUMNS = "columns", [2.0, MAX_BOARD_POINTS] "";
        ROWS = "rows", [2.0, MAX_BOARD_POINTS] "";
        SQUARE_MM = "square_mm", [0.01, 1000.0] "mm";
        SPACING_MM = "spacing_mm", [0.01, 1000.0] "mm";
    }
}

field_ranges! {
    CameraDocument {
        SIGMA_PX = "sigma_px", [1e-3, 10.0] "px";
    }
}

field_ranges! {
    PlateScanDocument {
        JOINTS_DEG = "joints_deg", [-MAX_ANGLE_DEG, MAX_ANGLE_DEG] "°";
        TABLE_ANGLE_DEG = "table_angle_deg", [-MAX_ANGLE_DEG, MAX_ANGLE_DEG] "°";
        POINTS_MM = "points_mm", [-FARTHEST, FARTHEST] "mm";
    }
}

field_ranges! {
    ObservationDocument {
        JOINTS_DEG = "joints_deg", [-MAX_ANGLE_DEG, MAX_ANGLE_DEG] "°";
        TABLE_ANGLE_DEG = "table_angle_deg", [-MAX_ANGLE_DEG, MAX_ANGLE_DEG] "°";
    }
}

field_ranges! {
    PixelPairDocument {
        BOARD_MM = "board_mm", [-FARTHEST, FARTHEST] "mm";
        PX = "px", [-FARTHEST, FARTHEST] "px";
    }
}

field_ranges! {
    PointPairDocument {
        BOARD_MM = "board_mm", [-FARTHEST, FARTHEST] "mm";
        CLOUD_MM = "cloud_mm", [-FARTHEST, FARTHEST] "mm";
    }
}

field_ranges! {
    SphereDocument {
        CENTRE_MM = "centre_mm", [-FARTHEST, FARTHEST] "mm";
    }
}

/// Ranges of the numbers of observations. The standard deviations of [`SigmaDocument`] have none in the API document: answers
/// have them too, and estimates may be smaller than what may be given.
pub(in crate::wire) const OBSERVATION_RANGES: [RangeGroup; 10] = [
    BoardDocument::RANGES,
    CalibrationData::RANGES,
    RangeGroup { name: "CameraDocument", ..LensParameters::RANGES },
    CameraDocument::RANGES,
    PlateScanDocument::RANGES,
    ObservationDocument::RANGES,
    PixelPairDocument::RANGES,
    PointPairDocument::RANGES,
    SphereDocument::RANGES,
    ObservedPose::RANGES,
];

/// A board in the cloud, with covariance and points where it was fitted to some.
type Seen = (Isometry3<f64>, Option<nalgebra::Matrix6<f64>>, Vec<[Point3<f64>; 2]>);

impl ObservationDocument {
    fn check(&self, pointer: &str, before: &[Self], findings: &mut Findings) {
        findings.require(!self.id.is_empty(), format!("{pointer}/id"), || "is empty; name the observation".into());
        findings.require(before.iter().all(|other| other.id != self.id), format!("{pointer}/id"), || {
            format!("{:?} is the name of another observation", self.id)
        });
        Self::TABLE_ANGLE_DEG.check(pointer, &self.table_angle_deg, findings);
        Self::JOINTS_DEG.check(pointer, &self.joints_deg, findings);
        let has_flange = self.joints_deg.is_some() || self.base_from_flange.is_some();
        findings.require(has_flange, pointer, || "has no pose of the arm; give joints_deg, base_from_flange or both".into());
        let forms = [self.cloud_from_board.is_some(), !self.points.is_empty(), !self.spheres.is_empty(), !self.pixels.is_empty()];
        findings.require(forms.into_iter().filter(|given| *given).count() == 1, pointer, || {
            "has to give the board in one form: cloud_from_board, points, spheres or pixels".into()
        });
        let points = self.points.len().max(self.spheres.len()).max(self.pixels.len());
        findings.require(points <= MAX_POINTS, pointer, || format!("has {points} points; allowed are {MAX_POINTS}"));
    }

    /// Board as the pixels of its points show it.
    fn imaged(&self, camera: &CameraDocument, pointer: &str, findings: &mut Findings) -> Option<Seen> {
        let pointer = format!("{pointer}/pixels");
        let is_sound = |value: &f64| value.is_finite() && value.abs() <= FARTHEST;
        if !self.pixels.iter().all(|pair| pair.board_mm.iter().chain(&pair.px).all(is_sound)) {
            findings.push(pointer, "has a coordinate that is not a number within ±100000");
            return None;
        }
        let points: Vec<_> = self.pixels.iter().map(|pair| (Point3::from(pair.board_mm), Vector2::from(pair.px))).collect();
        let found = board_in_camera(&camera.lens(), &points);
        let Some(found) = found else {
            findings.push(
                pointer,
                "give no pose of the board in front of the camera; give four points or more on a plane, not all on a line, or \
                 six in space",
            );
            return None;
        };
        let is_near = found.rms_px <= MAX_REPROJECTION * camera.sigma_px;
        findings.require(is_near, pointer, || {
            format!(
                "are off by {:.2} px rms from the best pose of the board, with a sigma_px of {}; is the board's size, the order of its \
                 points, or the camera wrong?",
                found.rms_px, camera.sigma_px
            )
        });
        is_near.then(|| (found.camera_from_board, Some(found.unit_covariance * camera.sigma_px.powi(2)), Vec::new()))
    }

    fn seen(&self, constellation: &[SphereDocument], pointer: &str, sigma_mm: f64, findings: &mut Findings) -> Option<Seen> {
        if let Some(pose) = &self.cloud_from_board {
            let seen = pose.pose(&format!("{pointer}/cloud_from_board"), findings)?;
            return Some((seen, None, Vec::new()));
        }
        let of_sphere = |sphere: &SphereDocument| {
            let known = constellation.iter().find(|known| known.name == sphere.name)?;
            Some([known.centre_mm, sphere.centre_mm].map(Point3::from))
        };
        let field = if self.points.is_empty() { "spheres" } else { "points" };
        let mut pairs: Vec<[Point3<f64>; 2]> =
            self.points.iter().map(|pair| [pair.board_mm, pair.cloud_mm].map(Point3::from)).collect();
        pairs.extend(self.spheres.iter().filter_map(of_sphere));
        if pairs.is_empty() {
            return None;
        }
        if pairs.iter().flatten().any(|point| point.iter().any(|value| !value.is_finite() || value.abs() > FARTHEST)) {
            findings.push(format!("{pointer}/{field}"), "has a coordinate that is not a number within ±100000 mm");
            return None;
        }
        match placement::from_points(&pairs, Some(sigma_mm)) {
            Ok(Placement { pose, covariance, .. }) => Some((pose, covariance, pairs)),
            Err(error) => {
                findings.push(format!("{pointer}/{field}"), error.to_string());
                None
            }
        }
    }
}
