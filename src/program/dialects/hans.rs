//! Han's robots: commands of the CPS interface (TCP port 10003, vendor's Python SDK), one a line, to be sent by a driver or
//! an operator. `WayPoint` with `type` 0 and `isJoint` 1 takes the six joints as the target, degrees, speeds in degrees per
//! second; its first six numbers are then without effect. `TCP` and `Base` are names of a tool frame and a user frame of the
//! controller, those of the SDK's examples (`sTcpName` and `sUcsName` of `HRIF_WayPoint`): a target in joints is the same in
//! every frame, but the names have to be known there. Lines with `#` are comments. CPS has no command to wait or to turn a
//! table: lines with `@` say what the sender does, and the header what each means.

use super::header::{commented, paragraphs};
use super::names::{NameRule, identifier};
use super::numbers::{DEGREE, angles, at_least, at_most};
use super::walk::{Action, Stretch, scanning, toward};
use super::{Dialect, DialectError, DialectFacts, DialectFile, DialectOutput, Job};

/// Digital inputs and outputs of the box, from 0 (`nBit` of the SDK's `HRIF_SetBoxDO` and `HRIF_ReadBoxDI`).
const LAST_SIGNAL: u32 = 7;
/// Rule for the name, which is that of a file alone: no controller compiles the script.
const NAME: NameRule = NameRule { longest: 64, reserved: &[], point: "" };

const HOW_TO_SEND: [&str; 9] = [
    "Targets are joints: no frame changes the motion. Each WayPoint names tool frame TCP and user frame Base all the same; where \
     the controller has no frames of these names, put names of its own in their place.",
    "Send each line that begins with a letter as it stands, without the line end, and wait for its Name,OK,...,; before the \
     next; on Name,Fail,code,; stop. Lines with @ are for the sender:",
    "@home J1 J2 J3 J4 J5 J6 TABLE: stop unless ReadActPos,0,; and the table are within 0.5 deg of this.",
    "@motion: poll ReadRobotState,0,; until moving [0] is 0, blending done [11] is 1 and in position [12] is 1.",
    "@table A: turn the table to A deg and wait until it stands; the arm stands meanwhile.",
    "@wait S: wait S seconds.",
    "@off N S: poll ReadBoxDI,N,; until it is 0; stop when it is not within S seconds.",
    "@input N S: poll ReadBoxDI,N,; until it is 1; stop when it is not within S seconds.",
    "@scan N B: the next pulse captures viewpoint N; the scanner's brightness level has to be B.",
];

/// Facts of the dialect.
pub(super) const FACTS: DialectFacts = DialectFacts {
    outputs: &[DialectOutput { format: "hans", extension: "cps", media_type: "text/x-hans-cps; charset=utf-8" }],
    has_table_axis: false,
    whole_percents_from: None,
    tells_brightness: true,
    is_table: false,
    file_stem: None,
    name_length_param: None,
    before_first_run: None,
    render,
};

/// The script.
fn render(job: &Job<'_>) -> Result<Vec<DialectFile>, DialectError> {
    job.check_signals(Dialect::Hans, 0, LAST_SIGNAL)?;
    let name = identifier(&job.params.program_name, job.program.setup, &NAME);
    let table = "turned by the sender at each @table line, never while the arm moves.";
    let units = "deg, deg/s, deg/s2, s.";
    let head = paragraphs(job, &format!("{name}.cps"), units, table, &HOW_TO_SEND);
    let mut lines = commented(&head, "#");
    lines.push(format!("@home {}", angles(&job.program.home_rad, &job.axes, DEGREE, 4).join(" ")));
    for action in &job.actions {
        match action {
            Action::Toward(view) => lines.push(format!("# {}", toward(*view))),
            Action::Go(stretch) => lines.extend(go(stretch, job)),
            Action::Settle(secs) => lines.push(format!("@wait {}", at_least(*secs, 3))),
            Action::Scan { view, brightness } => {
                lines.push(format!("# {}", scanning(*view, *brightness)));
                lines.push(format!("@scan {} {brightness}", view.0));
                lines.extend(scan(job));
            }
        }
    }
    Ok(vec![Job::file(&name, "cps", &lines)])
}

/// Arm or table; never both, since the program is interlocked.
fn go(stretch: &Stretch, job: &Job<'_>) -> Vec<String> {
    let [j1, j2, j3, j4, j5, j6, table] = angles(&stretch.to_rad, &job.axes, DEGREE, 4);
    if stretch.moves_table() {
        return vec![format!("@table {table}")];
    }
    let lead = stretch.lead(&job.axes);
    let [speed, acceleration] = [lead.rad_per_s, lead.rad_per_s2].map(|value| at_most(value.to_degrees(), 4));
    let motion = format!("TCP,Base,{speed},{acceleration},0,0,1,0,0,0,{}", stretch.point);
    vec![format!("WayPoint,0,0,0,0,0,0,0,{j1},{j2},{j3},{j4},{j5},{j6},{motion},;"), "@motion".to_owned()]
}

fn scan(job: &Job<'_>) -> [String; 5] {
    let params = job.params;
    let timeout = at_least(params.timeout_secs, 3);
    [
        format!("@off {} {timeout}", params.scan_input),
        format!("SetBoxDO,{},1,;", params.scan_output),
        format!("@wait {}", at_least(params.pulse_secs, 3)),
        format!("SetBoxDO,{},0,;", params.scan_output),
        format!("@input {} {timeout}", params.scan_input),
    ]
}
