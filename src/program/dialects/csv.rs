//! The program as a table (RFC 4180): a via point, a target or an action a row, with where arm and table are then and where the
//! scanner is in the robot's base. A move's time stands at its target. Angles at full precision, degrees; mm. The last column
//! names the plan, since a table has no comments. Numbers and words of ours only: nothing in it could be read as a formula.

use std::fmt::Write as _;

use super::{DialectFacts, DialectFile, DialectOutput, Job};
use crate::cell::Configuration;
use crate::program::Step;

const HEADER: &str = "step,op,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg,table_angle_deg,speed_fraction,secs,viewpoint,brightness,\
                      base_from_scanner_x_mm,base_from_scanner_y_mm,base_from_scanner_z_mm,\
                      base_from_scanner_qx,base_from_scanner_qy,base_from_scanner_qz,base_from_scanner_qw,plan_sha256";

/// A row.
#[derive(Default)]
struct Row {
    step: Option<usize>,
    op: &'static str,
    speed_fraction: Option<f64>,
    secs: Option<f64>,
    viewpoint: Option<u32>,
    brightness: Option<u8>,
}

/// Facts of the dialect.
pub(super) const FACTS: DialectFacts = DialectFacts {
    outputs: &[DialectOutput { format: "csv", extension: "csv", media_type: "text/csv; charset=utf-8" }],
    has_table_axis: true,
    whole_percents_from: None,
    tells_brightness: true,
    is_table: true,
    file_stem: None,
    name_length_param: None,
    before_first_run: None,
    render: |job| Ok(render(job)),
};

/// `program.csv`, and `program-2.csv` for the second setup: the names that a plan gives its tables.
fn render(job: &Job<'_>) -> Vec<DialectFile> {
    let mut text = format!("{HEADER}\r\n");
    let mut here = job.program.home_rad;
    let mut write = |row: Row, at: &Configuration| row.write(&mut text, job, at);
    write(Row { op: "home", ..Row::default() }, &here);
    for (index, step) in job.program.steps.iter().enumerate() {
        let row = Row { step: Some(index), secs: Some(step.secs()), ..Row::default() };
        match step {
            Step::Move(step) => {
                let speed_fraction = Some(step.speed_fraction);
                for point in &step.via_rad {
                    write(Row { op: "via", speed_fraction, secs: None, ..row }, point);
                }
                here = step.target_rad;
                write(Row { op: "move_joints", speed_fraction, ..row }, &here);
            }
            Step::Settle { .. } => write(Row { op: "settle", ..row }, &here),
            Step::Scan { view, brightness, .. } => {
                write(Row { op: "scan", viewpoint: Some(view.0), brightness: Some(*brightness), ..row }, &here);
            }
        }
    }
    let number = if job.program.setup == 0 { String::new() } else { format!("-{}", job.program.setup + 1) };
    vec![DialectFile { name: format!("program{number}.csv"), text }]
}

impl Row {
    fn write(&self, text: &mut String, job: &Job<'_>, at: &Configuration) {
        let angles = at.axes_rad().map(|angle| number(angle.to_degrees(), 1e9)).join(",");
        let base_from_scanner = job.cell.base_from_scanner(&at.joints_rad);
        let base_from_scanner = base_from_scanner.isometry();
        let [x, y, z] = base_from_scanner.translation.vector.into();
        let q = base_from_scanner.rotation.coords;
        let place = [x, y, z].map(|mm| number(mm, 1e6)).join(",");
        // Of the two signs of a quaternion the one with w ≥ 0.
        let turn = [q.x, q.y, q.z, q.w].map(|value| number(value * 1_f64.copysign(q.w), 1e9)).join(",");
        let (step, viewpoint, brightness) = (cell_of(self.step), cell_of(self.viewpoint), cell_of(self.brightness));
        let (speed, secs) = (cell_of(self.speed_fraction), cell_of(self.secs));
        let plan = &job.program.plan_sha256;
        // Writing to a String cannot fail.
        let _ = write!(text, "{step},{},{angles},{speed},{secs},{viewpoint},{brightness},{place},{turn},{plan}\r\n", self.op);
    }
}

fn cell_of(value: Option<impl ToString>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

/// Rounded to `1 / per`, and as short as it then can be; never −0.
fn number(value: f64, per: f64) -> String {
    ((value * per).round() / per + 0.0).to_string()
}
