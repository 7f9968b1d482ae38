//! Observations as a table: one row each, the columns named. `id`, `j1_deg` to `j6_deg`, `table_angle_deg`, `flange_x`, `flange_y`,
//! `flange_z` with `flange_r1` to `flange_r3` or `flange_r4` in the convention of the controller, and `board_x`, `board_y`, `board_z` with
//! `board_qx`, `board_qy`, `board_qz`, `board_qw`. Either joints or flange may be left out.

use super::data::{CalibrationData, ObservationDocument};
use super::foreign::{RobotPoseKind, of_observations};
use super::pose::ObservedPose;
use crate::cell::calibration::data::HandEyeSetup;
use crate::cell::{FieldError, Findings, decimal_comma_advice, did_you_mean};
use crate::wire::words::counted;

/// Columns that are read.
const COLUMNS: [&str; 22] = [
    "id",
    "j1_deg",
    "j2_deg",
    "j3_deg",
    "j4_deg",
    "j5_deg",
    "j6_deg",
    "table_angle_deg",
    "flange_x",
    "flange_y",
    "flange_z",
    "flange_r1",
    "flange_r2",
    "flange_r3",
    "flange_r4",
    "board_x",
    "board_y",
    "board_z",
    "board_qx",
    "board_qy",
    "board_qz",
    "board_qw",
];
/// Rows that a table may have.
const MAX_ROWS: usize = 5000;

/// Conventions of a table.
#[derive(Clone, Copy, Debug)]
pub struct CsvOptions {
    /// Convention of the flange's rotation.
    pub robot_pose: RobotPoseKind,
    /// Millimetres in a unit of its lengths.
    pub unit_mm: f64,
    /// Mounting of the scanner.
    pub setup: HandEyeSetup,
}

/// Reads a table; commas, semicolons or tabs separate.
///
/// # Errors
/// A table of too many rows, every column that is unknown and every cell that is not a number, by row and column.
pub fn from_csv(text: &str, options: &CsvOptions) -> Result<CalibrationData, Vec<FieldError>> {
    let mut findings = Findings::default();
    let mut lines = filled_lines(text);
    let header = lines.next().unwrap_or_default();
    let separator = [';', '\t'].into_iter().find(|separator| header.trim().contains(*separator)).unwrap_or(',');
    let names = cells(header, separator, 1);
    let count = lines.clone().count();
    findings.require(count <= MAX_ROWS, "", || format!("has {count} rows; allowed are {MAX_ROWS}: delete the rows beyond"));
    for name in names.iter().filter(|name| !COLUMNS.contains(name)) {
        findings.push("", format!("unknown column {name:?}{}; known are {}", did_you_mean(name, COLUMNS), COLUMNS.join(", ")));
    }
    for (column, name) in names.iter().enumerate().filter(|(column, name)| names[..*column].contains(name)) {
        findings.push("", format!("column {} is {name:?} a second time; give each column once", column + 1));
    }
    findings.into_result()?;
    let mut findings = Findings::default();
    let mut observations = Vec::new();
    for (row, line) in lines.enumerate() {
        let cells = cells(line, separator, names.len());
        let table = Row { names: &names, cells: &cells, row };
        findings.require(cells.len() == names.len(), format!("/{row}"), || {
            format!("has {}; the header has {}", counted(cells.len(), "cell"), names.len())
        });
        observations.extend(table.observation(options, &mut findings));
    }
    findings.into_result()?;
    Ok(of_observations(observations, options.setup))
}

/// Number of rows of a table that [`from_csv`] left out of `data`, since no board was found there: its pose is empty.
#[must_use]
pub fn rows_without_board(text: &str, data: &CalibrationData) -> usize {
    filled_lines(text).skip(1).count().saturating_sub(data.observations.len())
}

/// Header and rows, without empty lines and comments. Blanks at the ends of a line stay: a tab there separates an empty cell.
fn filled_lines(text: &str) -> impl Iterator<Item = &str> + Clone {
    let is_filled = |line: &&str| !line.trim().is_empty() && !line.trim_start().starts_with('#');
    text.trim_start_matches('\u{feff}').lines().filter(is_filled)
}

/// Cells of a line, without empty ones at its end beyond so many: a spreadsheet writes them for columns that once were filled.
fn cells(line: &str, separator: char, count: usize) -> Vec<&str> {
    let mut cells: Vec<&str> = line.split(separator).map(str::trim).collect();
    while cells.len() > count && cells.last().is_some_and(|cell| cell.is_empty()) {
        cells.pop();
    }
    cells
}

struct Row<'a> {
    names: &'a [&'a str],
    cells: &'a [&'a str],
    row: usize,
}

impl Row<'_> {
    fn cell(&self, name: &str) -> Option<&str> {
        let column = self.names.iter().position(|known| *known == name)?;
        self.cells.get(column).copied().filter(|cell| !cell.is_empty())
    }

    /// Number in a column, if the table has the column and the cell is not empty.
    fn number(&self, name: &str, findings: &mut Findings) -> Option<f64> {
        let cell = self.cell(name)?;
        let number = cell.parse::<f64>().ok().filter(|number| number.is_finite());
        findings.require(number.is_some(), format!("/{}/{name}", self.row), || {
            format!("is {cell:?}; a finite number is needed{}", decimal_comma_advice(cell))
        });
        number
    }

    /// Numbers of columns: all, or none of them.
    fn numbers<const COUNT: usize>(&self, names: [&str; COUNT], findings: &mut Findings) -> Option<[f64; COUNT]> {
        let numbers = names.map(|name| self.number(name, findings));
        let given = numbers.iter().filter(|number| number.is_some()).count();
        findings
            .require(given == 0 || given == COUNT, format!("/{}", self.row), || format!("gives {given} of {}", names.join(", ")));
        let all: Vec<f64> = numbers.into_iter().flatten().collect();
        all.try_into().ok()
    }

    /// Requires the place of a pose whose rotation is given: without it the pose would be left out silently.
    fn require_place(&self, of: &str, first: &str, has_place: bool, findings: &mut Findings) {
        let is_partial = self.cell(first).is_some();
        findings.require(has_place || is_partial, format!("/{}/{first}", self.row), || {
            format!("is empty, but the row has the rotation of the {of}; give {of}_x, {of}_y and {of}_z too, or neither")
        });
    }

    fn observation(&self, options: &CsvOptions, findings: &mut Findings) -> Option<ObservationDocument> {
        let joints_deg = self.numbers(["j1_deg", "j2_deg", "j3_deg", "j4_deg", "j5_deg", "j6_deg"], findings);
        let table_angle_deg = self.number("table_angle_deg", findings).unwrap_or(0.0);
        let place = self.numbers(["flange_x", "flange_y", "flange_z"], findings);
        let first = self.numbers(["flange_r1", "flange_r2", "flange_r3"], findings);
        let fourth = self.number("flange_r4", findings);
        let rotation: Vec<f64> = first.into_iter().flatten().chain(fourth).collect();
        self.require_place("flange", "flange_x", place.is_some() || rotation.is_empty(), findings);
        let base_from_flange = place.and_then(|place| {
            let pose = options.robot_pose.pose(place.map(|length| length * options.unit_mm), &rotation);
            findings.require(pose.is_some(), format!("/{}/flange_r1", self.row), || {
                let (count, kind) = (options.robot_pose.count(), options.robot_pose.as_str());
                format!("with its columns is {rotation:?}; {kind} has {count} numbers, a quaternion of norm 1")
            });
            pose.as_ref().map(ObservedPose::of)
        });
        let place = self.numbers(["board_x", "board_y", "board_z"], findings);
        let quaternion = self.numbers(["board_qx", "board_qy", "board_qz", "board_qw"], findings);
        self.require_place("board", "board_x", place.is_some() || quaternion.is_none(), findings);
        let translation_mm = place?.map(|length| length * options.unit_mm);
        let cloud_from_board = ObservedPose { translation_mm, quaternion_xyzw: quaternion, ..ObservedPose::default() };
        let id = self.cell("id").map_or_else(|| format!("p{:02}", self.row + 1), str::to_owned);
        let cloud_from_board = Some(cloud_from_board);
        Some(ObservationDocument {
            id,
            joints_deg,
            table_angle_deg,
            base_from_flange,
            cloud_from_board,
            ..ObservationDocument::default()
        })
    }
}
