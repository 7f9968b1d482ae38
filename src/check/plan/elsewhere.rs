//! A plan held against the surroundings that it is checked in: that it was made there, by names, optics, poses and calibration.

use crate::cell::{Cell, FieldError, PoseSpec, Scanner};
use crate::check::place::CheckPlace;
use crate::geometry::Pose;
use crate::program::ProgramCalibration;
use crate::wire::plan::{CellDocument, PlanDocument};

/// Largest distance between poses of one cell, mm, and largest angle, °: those by which a station may be off its viewpoint. No
/// published source.
const SAME_POSE: (f64, f64) = (0.1, 0.01);
/// End of a finding.
const GIVE_CELL: &str = "give the cell that it was made in, or plan again";

/// Findings of a plan that was made in other surroundings than `place`, or with another scanner than that has.
pub(super) fn found(document: &PlanDocument, place: CheckPlace<'_>) -> Vec<FieldError> {
    let at = |pointer: &str, detail: String| vec![FieldError { pointer: pointer.to_owned(), detail }];
    match (&document.cell, place) {
        (Some(planned_in), CheckPlace::Cell(cell)) => in_another_cell(document, planned_in, cell),
        (Some(planned_in), CheckPlace::NoCell(_)) => {
            at("/cell/name", format!("is {:?}; it is checked without a cell: {GIVE_CELL}", planned_in.name))
        }
        (None, CheckPlace::Cell(cell)) => {
            let name = &cell.name;
            at(
                "/cell",
                format!("is null, made without a cell; it is checked in cell {name:?}: check it without one, or plan again"),
            )
        }
        (None, CheckPlace::NoCell(None)) => Vec::new(),
        (None, CheckPlace::NoCell(Some(scanner))) => {
            let next = "give the scanner that it was made with, or plan again";
            if document.scanner.name != scanner.name {
                let (planned, given) = (&document.scanner.name, &scanner.name);
                return at("/scanner/name", format!("is {planned:?}; the given scanner is {given:?}: {next}"));
            }
            other_optics(document, scanner, "in the given scanner", next)
        }
    }
}

fn in_another_cell(document: &PlanDocument, planned_in: &CellDocument, cell: &Cell) -> Vec<FieldError> {
    let names = [
        ("/cell/name", &planned_in.name, &cell.name),
        ("/cell/robot", &planned_in.robot, &cell.robot.name),
        ("/cell/turntable", &planned_in.turntable, &cell.turntable.name),
        ("/scanner/name", &document.scanner.name, &cell.scanner.name),
    ];
    let other = names.into_iter().filter(|(_, planned, present)| planned != present);
    let mut found: Vec<FieldError> = other
        .map(|(pointer, planned, present)| FieldError {
            pointer: pointer.to_owned(),
            detail: format!("is {planned:?}; the given cell has {present:?}: {GIVE_CELL}"),
        })
        .collect();
    // A scanner of another name differs in everything.
    if document.scanner.name == cell.scanner.name {
        found.extend(other_optics(document, &cell.scanner, "in the given cell", GIVE_CELL));
    }
    // Of a cell of another name every pose differs.
    if planned_in.name == cell.name {
        found.extend(other_calibration(planned_in, cell));
        found.extend(other_pose("base_from_table", &planned_in.base_from_table, &cell.base_from_table));
        found.extend(other_pose("flange_from_scanner", &planned_in.flange_from_scanner, &cell.flange_from_scanner));
    }
    found
}

fn other_optics(document: &PlanDocument, scanner: &Scanner, place: &str, next: &str) -> Vec<FieldError> {
    let differences = document.scanner_differences(scanner).into_iter();
    differences
        .map(|FieldError { pointer, detail }| FieldError { pointer, detail: format!("{place} it {detail}: {next}") })
        .collect()
}

fn other_calibration(planned_in: &CellDocument, cell: &Cell) -> Option<FieldError> {
    let planned = planned_in.calibrated.as_ref().map(|calibrated| ProgramCalibration {
        calibration_id: calibrated.calibration_id.clone(),
        compensation_sha256: calibrated.compensation_sha256.clone(),
    });
    let present = ProgramCalibration::of(cell);
    let named =
        |calibration: &Option<ProgramCalibration>| calibration.as_ref().map_or_else(|| "none".to_owned(), ToString::to_string);
    (planned != present).then(|| FieldError {
        pointer: "/cell/calibrated".to_owned(),
        detail: format!("is calibration {}; the given cell has {}: {GIVE_CELL}", named(&planned), named(&present)),
    })
}

fn other_pose<To, From>(field: &str, planned: &PoseSpec, present: &Pose<To, From>) -> Option<FieldError> {
    let (mm, deg) = offset(&planned.pose(), present);
    // A pose that is none is the same as no other.
    let is_same = mm <= SAME_POSE.0 && deg <= SAME_POSE.1;
    (!is_same).then(|| FieldError {
        pointer: format!("/cell/{field}"),
        detail: format!("is {mm:.3} mm and {deg:.4} ° off that of the given cell: {GIVE_CELL}"),
    })
}

/// Distance between the origins of two poses, mm, and angle between their axes, °.
pub(super) fn offset<To, From>(one: &Pose<To, From>, other: &Pose<To, From>) -> (f64, f64) {
    let mm = (one.origin_mm() - other.origin_mm()).norm();
    (mm, one.isometry().rotation.angle_to(&other.isometry().rotation).to_degrees())
}
