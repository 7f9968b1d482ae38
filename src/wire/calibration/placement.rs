//! `vantage.placement/1`: where the part lies, from points, from a registered cloud, or from a seat of a fixture.

use nalgebra::{Isometry3, Matrix6, Point3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::pose::ObservedPose;
use crate::cell::calibration::placement::{Seat, from_cloud, from_cloud_covariance, from_points, from_seat};
use crate::cell::{Cell, CloudFrame, CloudFrameSpec, FieldError, Findings, PoseSpec};
use crate::geometry::{Part, Pose, Table};

/// Name and version of the shape.
pub const PLACEMENT_SCHEMA: &str = "vantage.placement/1";
/// Points that a placement may have.
const MAX_POINTS: usize = 10_000;

/// Data that tell where the part lies. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "method", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum PlacementData {
    /// Points of the part and where they are on the table: three or more.
    Points {
        /// Points.
        points: Vec<PlacedPoint>,
        /// Standard deviation of a coordinate, mm, 0.0001 to 50. Default: by the residuals.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_mm: Option<f64>,
    },
    /// A cloud that was registered to the part.
    Cloud {
        /// Joints 1 to 6 when it was taken, degrees.
        #[schema(min_items = 6, max_items = 6)]
        joints_deg: [f64; 6],
        /// Angle of the table when it was taken, degrees. Default 0.
        #[serde(default)]
        table_angle_deg: f64,
        /// The part in the cloud, as the registration found it.
        cloud_from_part: ObservedPose,
        /// Covariance of it as a body increment of the part, rx ry rz tx ty tz, rad and mm: six rows of six. Default: not known.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        covariance: Vec<Vec<f64>>,
    },
    /// A seat of a fixture.
    Fixture {
        /// Seats of the fixture.
        seats: Vec<SeatDocument>,
        /// Name of the seat that the part lies in.
        seat: String,
        /// The seat's frame on the part.
        part_from_seat: ObservedPose,
    },
}

/// A point of the part: on the part, and on the table at angle zero or, measured by the arm, in the base. Unknown fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct PlacedPoint {
    /// On the part, mm.
    #[schema(min_items = 3, max_items = 3)]
    pub part_mm: [f64; 3],
    /// On the table at angle zero, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 3, max_items = 3)]
    pub table_mm: Option<[f64; 3]>,
    /// Position in the robot's base, mm, with the table at `table_angle_deg`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 3, max_items = 3)]
    pub base_mm: Option<[f64; 3]>,
    /// Angle of the table when it was measured in the base, degrees. Default 0.
    #[serde(default)]
    pub table_angle_deg: f64,
}

/// A seat. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct SeatDocument {
    /// Name.
    pub name: String,
    /// The seat on the table at angle zero.
    pub table_from_seat: ObservedPose,
}

/// Place of the part. Its pose is the parameter `part.table_from_part`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct PlacementDocument {
    /// `vantage.placement/1`.
    pub schema: String,
    /// Pose of the part on the table.
    pub table_from_part: PoseSpec,
    /// Distance of each point from where the pose puts it, mm.
    pub residuals_mm: Vec<f64>,
    /// Root mean square of them, mm; `null` without points.
    pub rms_mm: Option<f64>,
    /// Covariance as a body increment of the part: rx ry rz tx ty tz, rad and mm; empty if it is not known.
    pub covariance: Vec<Vec<f64>>,
}

impl PlacementData {
    /// Place of the part in a cell.
    ///
    /// # Errors
    /// Every field that is out of range, and points that tell no pose.
    pub fn place(&self, cell: &Cell) -> Result<PlacementDocument, Vec<FieldError>> {
        match self {
            Self::Points { points, sigma_mm } => of_points(points, *sigma_mm, cell),
            Self::Cloud { joints_deg, table_angle_deg, cloud_from_part, covariance } => {
                let mut findings = Findings::default();
                let cloud_from_part = cloud_from_part.pose("/cloud_from_part", &mut findings);
                findings.range("/table_angle_deg", *table_angle_deg, -3600.0, 3600.0, "°");
                joints_deg.iter().enumerate().for_each(|(joint, angle)| {
                    findings.range(format!("/joints_deg/{joint}"), *angle, -3600.0, 3600.0, "°");
                });
                let covariance = matrix_of(covariance, "/covariance", &mut findings);
                findings.into_result()?;
                let frame = cell.scanner.cloud_frame.unwrap_or(CloudFrameSpec::Named(CloudFrame::Scanner));
                let base_from_cloud =
                    cell.base_from_scanner(&joints_deg.map(f64::to_radians)) * frame.scanner_from_cloud(&cell.scanner.devices);
                let plate = cell.base_from_plate(table_angle_deg.to_radians());
                let part = cloud_from_part.unwrap_or_else(Isometry3::identity);
                let placed = document(&from_cloud(plate.isometry(), base_from_cloud.isometry(), &part));
                let covariance =
                    covariance.map(|of_part| from_cloud_covariance(&part, &of_part, scanner_covariance(cell).as_ref()));
                Ok(PlacementDocument { covariance: covariance.map_or_else(Vec::new, |all| rows_of(&all)), ..placed })
            }
            Self::Fixture { seats, seat, part_from_seat } => of_seat(seats, seat, part_from_seat),
        }
    }
}

/// Covariance of six rows of six finite numbers; none where it is left out.
fn matrix_of(rows: &[Vec<f64>], pointer: &str, findings: &mut Findings) -> Option<Matrix6<f64>> {
    if rows.is_empty() {
        return None;
    }
    let is_square = rows.len() == 6 && rows.iter().all(|row| row.len() == 6 && row.iter().all(|value| value.is_finite()));
    if !is_square {
        findings.push(pointer, "is not 6 rows of 6 finite numbers");
        return None;
    }
    let matrix = Matrix6::from_fn(|row, column| rows[row][column]);
    let is_covariance = (matrix - matrix.transpose()).amax() <= 1e-6 * matrix.amax() && matrix.diagonal().min() >= 0.0;
    findings.require(is_covariance, pointer, || "is not a covariance: it has to be symmetric, its diagonal not negative".into());
    is_covariance.then_some(matrix)
}

fn rows_of(matrix: &Matrix6<f64>) -> Vec<Vec<f64>> {
    (0..6).map(|row| (0..6).map(|column| matrix[(row, column)]).collect()).collect()
}

/// Covariance of the scanner's pose by the cell's calibration: the largest deviations that it states, on every axis.
fn scanner_covariance(cell: &Cell) -> Option<Matrix6<f64>> {
    let known = cell.calibrated.as_ref()?;
    let (turn, shift) = (known.rotation_sd_deg.to_radians().powi(2), known.translation_sd_mm.powi(2));
    Some(Matrix6::from_diagonal(&nalgebra::Vector6::new(turn, turn, turn, shift, shift, shift)))
}

fn document(table_from_part: &Isometry3<f64>) -> PlacementDocument {
    PlacementDocument {
        schema: PLACEMENT_SCHEMA.to_owned(),
        table_from_part: PoseSpec::from(&Pose::<Table, Part>::claim(*table_from_part)),
        residuals_mm: Vec::new(),
        rms_mm: None,
        covariance: Vec::new(),
    }
}

fn of_points(points: &[PlacedPoint], sigma_mm: Option<f64>, cell: &Cell) -> Result<PlacementDocument, Vec<FieldError>> {
    let mut findings = Findings::default();
    findings.require(points.len() <= MAX_POINTS, "/points", || format!("has {} points; allowed are {MAX_POINTS}", points.len()));
    if let Some(sigma_mm) = sigma_mm {
        findings.range("/sigma_mm", sigma_mm, 1e-4, 50.0, "mm");
    }
    let mut pairs = Vec::new();
    for (index, point) in points.iter().enumerate().take(MAX_POINTS) {
        for value in point.part_mm.iter().chain(point.table_mm.iter().flatten()).chain(point.base_mm.iter().flatten()) {
            findings.range(format!("/points/{index}"), *value, -1e5, 1e5, "mm");
        }
        let on_plate = match (point.table_mm, point.base_mm) {
            (Some(table_mm), None) => Some(Point3::from(table_mm)),
            (None, Some(base_mm)) => {
                let base_from_plate = cell.base_from_plate(point.table_angle_deg.to_radians());
                Some(base_from_plate.inverse().point(&Point3::from(base_mm)))
            }
            (Some(_), Some(_)) | (None, None) => {
                findings.push(format!("/points/{index}"), "needs one of table_mm and base_mm");
                None
            }
        };
        pairs.extend(on_plate.map(|to| [Point3::from(point.part_mm), to]));
    }
    findings.into_result()?;
    let placed = from_points(&pairs, sigma_mm)
        .map_err(|error| vec![FieldError { pointer: "/points".into(), detail: error.to_string() }])?;
    let covariance = placed.covariance.as_ref().map_or_else(Vec::new, rows_of);
    Ok(PlacementDocument { residuals_mm: placed.residuals_mm, rms_mm: Some(placed.rms_mm), covariance, ..document(&placed.pose) })
}

fn of_seat(seats: &[SeatDocument], name: &str, part_from_seat: &ObservedPose) -> Result<PlacementDocument, Vec<FieldError>> {
    let mut findings = Findings::default();
    let known: Vec<Seat> = seats
        .iter()
        .enumerate()
        .filter_map(|(index, seat)| {
            let pose = seat.table_from_seat.pose(&format!("/seats/{index}/table_from_seat"), &mut findings)?;
            Some(Seat { name: seat.name.clone(), table_from_seat: pose })
        })
        .collect();
    let part_from_seat = part_from_seat.pose("/part_from_seat", &mut findings);
    findings.into_result()?;
    let names: Vec<&str> = seats.iter().map(|seat| seat.name.as_str()).collect();
    let placed = from_seat(&known, name, &part_from_seat.unwrap_or_else(Isometry3::identity)).map_err(|error| {
        vec![FieldError { pointer: "/seat".into(), detail: format!("is {name:?}: {error}; seats are {}", names.join(", ")) }]
    })?;
    Ok(document(&placed))
}
