//! Python for RoboDK (package `robodk`, module `robolink`), which simulates the program, runs it on the robot, or writes it
//! for a controller that has no dialect here. The table is a synchronised external axis of the robot (Utilities, Synchronize
//! External Axes), so that `MoveJ` takes seven angles; the script stops where it is not. `setRounding(-1)` stops at each
//! point.

use super::header::{commented, paragraphs};
use super::names::{NameRule, comment, identifier};
use super::numbers::{DEGREE, angles, at_least, at_most};
use super::walk::{Action, scanning, toward};
use super::{DialectFacts, DialectFile, DialectOutput, Job};

/// A Python file's name should be a module's, and not that of the package it imports: Python would find the file in its place.
const NAME: NameRule = NameRule { longest: 64, reserved: &["ROBODK"], point: "" };

/// Facts of the dialect.
pub(super) const FACTS: DialectFacts = DialectFacts {
    outputs: &[DialectOutput { format: "robodk", extension: "py", media_type: "text/x-python; charset=utf-8" }],
    has_table_axis: true,
    whole_percents_from: None,
    tells_brightness: false,
    is_table: false,
    file_stem: None,
    name_length_param: None,
    before_first_run: None,
    render: |job| Ok(render(job)),
};

/// The script.
fn render(job: &Job<'_>) -> Vec<DialectFile> {
    let name = identifier(&job.params.program_name, job.program.setup, &NAME);
    let table = "a synchronised external axis of the robot, the seventh angle; it moves with the arm.";
    let needs = "The station has a robot of the name below; I/O numbers are the robot's.";
    let head = paragraphs(job, &format!("{name}.py"), "deg, deg/s, deg/s2, s.", table, &[needs]);
    let mut lines = commented(&head, "#");
    lines.extend(functions(job).lines().map(str::to_owned));
    for action in &job.actions {
        lines.push(match action {
            Action::Toward(view) => format!("# {}", toward(*view)),
            Action::Go(stretch) => {
                let lead = stretch.lead(&job.axes);
                let [speed, acceleration] = [lead.rad_per_s, lead.rad_per_s2].map(|value| at_most(value.to_degrees(), 4));
                format!("move([{}], {speed}, {acceleration})", angles(&stretch.to_rad, &job.axes, DEGREE, 6).join(", "))
            }
            Action::Settle(secs) => format!("robot.Pause({})", at_least(1000.0 * secs, 0)),
            Action::Scan { view, brightness } => format!("# {}\nscan()", scanning(*view, *brightness)),
        });
    }
    vec![Job::file(&name, "py", &lines)]
}

fn functions(job: &Job<'_>) -> String {
    let params = job.params;
    let (output, input) = (params.scan_output, params.scan_input);
    format!(
        "from robodk.robolink import ITEM_TYPE_ROBOT, Robolink

HOME = [{home}]
station = Robolink()
# A wait that times out has to stop the script; RoboDK may report it as a warning, which is only printed by default.
station._RAISE_EXCEPTION_ON_WARNING = True
robot = station.Item({robot}, ITEM_TYPE_ROBOT)
if not robot.Valid():
    raise SystemExit(\"the station has no robot of this name\")
here = robot.Joints().list()
if len(here) != 7:
    raise SystemExit(\"the robot has no table: synchronise it as an external axis\")
# The paths begin at home; from anywhere else they were not checked.
if max(abs(a - b) for a, b in zip(here, HOME)) > 0.5:
    raise SystemExit(\"arm and table are not at home; bring them there by hand\")
robot.setRounding(-1)


def move(angles_deg, speed, acceleration):
    robot.setSpeed(-1, speed, -1, acceleration)
    robot.MoveJ(angles_deg)


def scan():
    robot.waitDI({input}, 0, {timeout})
    robot.setDO({output}, 1)
    robot.Pause({pulse})
    robot.setDO({output}, 0)
    robot.waitDI({input}, 1, {timeout})

",
        home = angles(&job.program.home_rad, &job.axes, DEGREE, 6).join(", "),
        robot = literal(&job.program.robot),
        pulse = at_least(1000.0 * params.pulse_secs, 0),
        timeout = at_least(1000.0 * params.timeout_secs, 0)
    )
}

/// A Python string literal: what is not printable ASCII by its number.
fn literal(text: &str) -> String {
    let escaped = text.chars().map(|c| match c {
        '"' | '\\' => format!("\\{c}"),
        c if comment(&c.to_string()).starts_with(c) => c.to_string(),
        c => format!("\\U{:08x}", u32::from(c)),
    });
    format!("\"{}\"", escaped.collect::<String>())
}
