//! `vantage.placement/1`: where the part lies, from points, from a registered cloud, or from a seat of a fixture.

use nalgebra::{Isometry3, Matrix6, Point3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::pose::ObservedPose;
use crate::cell::calibration::placement::{
    Placement, Seat, StrayPoint, from_cloud, from_cloud_covariance, from_points, from_seat, rms_max_mm, stray_point,
};
use crate::cell::{Cell, CloudFrame, CloudFrameSpec, FieldError, Findings, PoseSpec};
use crate::geometry::{Part, Pose, Table};

/// Name and version of the shape.
pub const PLACEMENT_SCHEMA: &str = "vantage.placement/1";
/// Points that a placement may have.
const MAX_POINTS: usize = 10_000;
/// Residuals that a refusal lists.
const LISTED: usize = 20;
/// Depth below the plate's upper face at which a placed point is worth a warning, mm: more than points are measured off.
const SUNK_MM: f64 = 1.0;

/// Data that tell where the part lies. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "method", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum PlacementData {
    /// Points of the part and where they are on the table: three or more.
    Points {
        /// Points.
        points: Vec<PlacedPoint>,
        /// Standard deviation of a coordinate, mm, 0.0001 to 50. Default: by the residuals, whose root mean square may then be 1 mm.
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
    /// Position on the part, mm.
    #[schema(min_items = 3, max_items = 3)]
    pub part_mm: [f64; 3],
    /// Position on the table at angle zero, mm.
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
    /// Findings in words: a point that does not fit the others, a place beside the plate or below it.
    #[serde(default)]
    pub warnings: Vec<String>,
}

impl PlacementData {
    /// Place of the part in a cell.
    ///
    /// # Errors
    /// Every field that is out of range, and points that tell no pose.
    pub fn place(&self, cell: &Cell) -> Result<PlacementDocument, Vec<FieldError>> {
        let mut placed = self.placed(cell)?;
        let [x, y, _] = placed.table_from_part.translation_mm;
        let (off_mm, radius_mm) = (x.hypot(y), cell.turntable.plate_radius_mm);
        if off_mm > radius_mm {
            placed.warnings.push(format!(
                "the part's origin lies {off_mm:.1} mm from the table's axis, beyond the plate (radius {radius_mm:.1} mm): check the frame \
                 of the points and the cell"
            ));
        }
        Ok(placed)
    }

    fn placed(&self, cell: &Cell) -> Result<PlacementDocument, Vec<FieldError>> {
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
        warnings: Vec::new(),
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
    let warnings = judge(&pairs, &placed, sigma_mm, cell)?;
    let covariance = placed.covariance.as_ref().map_or_else(Vec::new, rows_of);
    let rms_mm = Some(placed.rms_mm);
    Ok(PlacementDocument { residuals_mm: placed.residuals_mm, rms_mm, covariance, warnings, ..document(&placed.pose) })
}

/// Warnings about a fit to points.
///
/// # Errors
/// A fit that is worse than its points may be, with the point that does not fit the others, if there is one.
fn judge(
    pairs: &[[Point3<f64>; 2]],
    placed: &Placement,
    sigma_mm: Option<f64>,
    cell: &Cell,
) -> Result<Vec<String>, Vec<FieldError>> {
    let stray = stray_point(pairs, placed, sigma_mm);
    let told =
        |stray: &StrayPoint| format!("lies {:.1} mm off where the others put it; measure it again or leave it out", stray.off_mm);
    let max_mm = rms_max_mm(pairs.len(), sigma_mm);
    if placed.rms_mm > max_mm {
        let listed: Vec<String> = placed.residuals_mm.iter().take(LISTED).map(|mm| format!("{mm:.2}")).collect();
        let more = if placed.residuals_mm.len() > LISTED { ", …" } else { "" };
        let limit = match sigma_mm {
            Some(sigma_mm) => format!("{max_mm:.4} mm, by sigma_mm = {sigma_mm}"),
            None => format!("{max_mm} mm, or more with a larger sigma_mm"),
        };
        let advice = if stray.is_some() { "" } else { "; are points swapped, or in another frame?" };
        let detail = format!(
            "do not fit: rms {:.3} mm; allowed is {limit}. Residuals in their order: {}{more} mm{advice}",
            placed.rms_mm,
            listed.join(", ")
        );
        let mut errors = vec![FieldError { pointer: "/points".into(), detail }];
        errors.extend(stray.map(|stray| FieldError { pointer: format!("/points/{}", stray.index), detail: told(&stray) }));
        return Err(errors);
    }
    let mut warnings: Vec<String> =
        stray.iter().map(|stray| format!("point {} (/points/{}) {}", stray.index + 1, stray.index, told(stray))).collect();
    let on_table = pairs.iter().map(|[from, _]| placed.pose * from);
    let over_plate = on_table.filter(|point| point.xy().coords.norm() <= cell.turntable.plate_radius_mm);
    let lowest_mm = over_plate.map(|point| point.z).fold(f64::INFINITY, f64::min);
    if lowest_mm < -SUNK_MM {
        warnings.push(format!(
            "the lowest point lies {:.1} mm below the plate's upper face: check the frame of the points and the cell",
            -lowest_mm
        ));
    }
    Ok(warnings)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{Presets, SpecLibrary};

    const CORNERS: [[f64; 3]; 5] =
        [[0.0, 0.0, 0.0], [120.0, 0.0, 5.0], [0.0, 80.0, 0.0], [110.0, 75.0, 30.0], [60.0, 20.0, 45.0]];

    /// Points of a part that is only shifted.
    fn data(shift_mm: [f64; 3], sigma_mm: Option<f64>, change: impl Fn(&mut Vec<[f64; 3]>)) -> PlacementData {
        let mut on_table = CORNERS.map(|corner| [0, 1, 2].map(|axis| corner[axis] + shift_mm[axis])).to_vec();
        change(&mut on_table);
        let place = |(part_mm, table_mm): (&[f64; 3], &[f64; 3])| PlacedPoint {
            part_mm: *part_mm,
            table_mm: Some(*table_mm),
            base_mm: None,
            table_angle_deg: 0.0,
        };
        PlacementData::Points { points: CORNERS.iter().zip(&on_table).map(place).collect(), sigma_mm }
    }

    fn placed(data: &PlacementData) -> Result<PlacementDocument, Vec<FieldError>> {
        data.place(&Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset"))
    }

    #[test]
    fn points_that_do_not_fit_are_refused_with_their_residuals_and_the_one_that_is_off() {
        let shift_mm = [-60.0, -40.0, 10.0];
        assert_eq!(placed(&data(shift_mm, None, |_| ())).expect("exact points").warnings, Vec::<String>::new());
        let errors = placed(&data(shift_mm, None, |points| points.swap(1, 2))).expect_err("two are swapped");
        assert_eq!(errors.len(), 1, "{errors:?}");
        let off = |by_mm: f64| move |points: &mut Vec<[f64; 3]>| points[3][0] += by_mm;
        let errors = placed(&data(shift_mm, None, off(8.0))).expect_err("one is off");
        let pointers: Vec<&str> = errors.iter().map(|error| error.pointer.as_str()).collect();
        assert_eq!(pointers, ["/points", "/points/3"], "{errors:?}");
        assert!(
            errors[0].detail.contains("Residuals in their order") && errors[1].detail.starts_with("lies 8.0 mm off"),
            "{errors:?}"
        );
        let warned = placed(&data(shift_mm, None, off(1.0))).expect("within the limit").warnings;
        assert!(warned.len() == 1 && warned[0].starts_with("point 4 (/points/3) lies 1.0 mm off"), "{warned:?}");
        placed(&data(shift_mm, Some(0.01), off(1.0))).expect_err("beyond three times the stated deviation");
        let warned = placed(&data(shift_mm, Some(5.0), off(8.0))).expect("points may be as coarse as is stated").warnings;
        assert_eq!(warned, Vec::<String>::new());
    }

    #[test]
    fn a_place_beside_the_plate_or_below_it_is_warned_of() {
        let beside = placed(&data([900.0, 0.0, 10.0], None, |_| ())).expect("points that fit").warnings;
        assert!(beside.len() == 1 && beside[0].contains("900.0 mm from the table's axis"), "{beside:?}");
        let below = placed(&data([-60.0, -40.0, -25.0], None, |_| ())).expect("points that fit").warnings;
        assert!(below.len() == 1 && below[0].contains("25.0 mm below the plate"), "{below:?}");
    }
}
