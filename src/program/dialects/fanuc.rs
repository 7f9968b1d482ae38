//! FANUC TP program in ASCII, `.LS` (*R-30iB Operator's Manual*, B-83284EN). `J P[n] p% FINE ACCp` stops at each point; speed
//! and acceleration are whole percents. The table is the first axis of motion group 2, which the program takes along. Angles
//! are the controller's own, which counts joint 3 from the ground. The program's joint 3 is counted so where the robot's model has
//! `joint_3_from_ground`; where it is counted from the upper arm, as `dialects.fanuc_joint_3_from` tells, joint 2 is taken from it.
//! Every position is in joints, so that no frame changes the motion, but declares user frame 0 and tool frame 1: a controller
//! that compares their numbers refuses a position in other frames than those selected, one in joints too (INTP-253, on a
//! simulated controller). The program selects none, since that would outlast it; the operator does.
//! `WAIT ... TIMEOUT,LBL[n]` goes to the label when its condition has not come true within `$WAITTMOUT`, hundredths of a second,
//! 3000 as delivered (*HandlingTool Setup and Operations Manual*, wait instructions). The variable is the controller's, for every
//! program on it, and the program does not set it back: a register to keep it in would be one that another program may use. The
//! header says so.
//! Remarks have 32 characters, comments 16, positions three decimals.

use super::header::paragraphs;
use super::names::{NameRule, identifier, wrap};
use super::numbers::{DEGREE, at_least, fixed, rounded};
use super::walk::{Action, Stretch, points};
use super::{Dialect, DialectError, DialectFacts, DialectFile, DialectOutput, Job, percent};
use crate::cell::{Configuration, JointThreeOrigin};

/// Names that the controller refuses.
const RESERVED: [&str; 13] =
    ["CON", "PRN", "AUX", "NUL", "COM1", "COM2", "COM3", "COM4", "LPT1", "LPT2", "LPT3", "PROGRAM", "END"];
/// Largest length of a remark.
const REMARK_CHARS: usize = 32;
/// Decimals of an angle.
const DECIMALS: usize = 3;
/// Speed of the move home, where the arm already stands, percent; that of the slowest other move, if it is lower.
const HOMING_PERCENT: u32 = 5;
/// Label that the wait for the scanner jumps to.
const LATE: u32 = 99;
/// Label that the wait for the end of the answer before jumps to.
const HELD: u32 = 98;
/// Axis of motion group 2 that turns the table. Positions name every axis of a group, and this group's other axes are not known.
const TABLE_AXIS: u32 = 1;

/// Facts of the dialect.
pub(super) const FACTS: DialectFacts = DialectFacts {
    outputs: &[DialectOutput { format: "fanuc", extension: "ls", media_type: "text/x-fanuc-ls; charset=utf-8" }],
    has_table_axis: true,
    whole_percents_from: Some(0.0),
    tells_brightness: false,
    is_table: false,
    file_stem: None,
    name_length_param: Some("fanuc_name_chars"),
    before_first_run: Some(
        "select user frame 0 and tool frame 1 in both motion groups, and bring arm and table home by hand; the program's \
         first move goes there on a way that was not checked",
    ),
    render,
};

/// The program.
fn render(job: &Job<'_>) -> Result<Vec<DialectFile>, DialectError> {
    job.check_signals(Dialect::Fanuc, 1, 4096)?;
    check_table_axis(job)?;
    let joint_3_from = joint_3_from(job)?;
    let rule = NameRule { longest: job.params.fanuc_name_chars as usize, reserved: &RESERVED, point: "" };
    let name = identifier(&job.params.program_name, job.program.setup, &rule).to_ascii_uppercase();
    let body = body(job, &name)?;
    let mut lines = attributes(&name, job, body.len());
    lines.extend(body.iter().enumerate().map(|(index, line)| format!("{:>4}:{line} ;", index + 1)));
    lines.push("/POS".to_owned());
    for (index, point) in points(job.program, &job.actions).iter().enumerate() {
        lines.extend(position(index, point, joint_3_from, job));
    }
    lines.push("/END".to_owned());
    Ok(vec![Job::file(&name, "ls", &lines)])
}

/// Refuses another axis for the table than the program turns: the one that it turns would be something else, such as a tilt.
fn check_table_axis(job: &Job<'_>) -> Result<(), DialectError> {
    let axis = job.params.table_axis;
    if axis == TABLE_AXIS { Ok(()) } else { Err(DialectError::TableAxis(axis)) }
}

/// Link from which the program's joint 3 is counted. Another maker's arm is not converted: the header warns.
fn joint_3_from(job: &Job<'_>) -> Result<JointThreeOrigin, DialectError> {
    if job.foreign.is_some() || job.cell.robot.kinematics.counts_joint_3_from_ground() {
        return Ok(JointThreeOrigin::Ground);
    }
    job.params.fanuc_joint_3_from.ok_or(DialectError::JointThree)
}

fn attributes(name: &str, job: &Job<'_>, lines: usize) -> Vec<String> {
    let hash = &job.program.plan_sha256;
    let text = format!(
        "/PROG  {name}
/ATTR
OWNER\t\t= MNEDITOR;
COMMENT\t\t= \"PLAN {}\";
PROG_SIZE\t= 0;
CREATE\t\t= DATE 00-00-00  TIME 00:00:00;
MODIFIED\t= DATE 00-00-00  TIME 00:00:00;
FILE_NAME\t= ;
VERSION\t\t= 0;
LINE_COUNT\t= {lines};
MEMORY_SIZE\t= 0;
PROTECT\t\t= READ_WRITE;
TCD:  STACK_SIZE\t= 0,
      TASK_PRIORITY\t= 50,
      TIME_SLICE\t= 0,
      BUSY_LAMP_OFF\t= 0,
      ABORT_REQUEST\t= 0,
      PAUSE_REQUEST\t= 0;
DEFAULT_GROUP\t= 1,1,*,*,*;
CONTROL_CODE\t= 00000000 00000000;
/APPL
/MN",
        &hash[..hash.len().min(11)]
    );
    text.lines().map(str::to_owned).collect()
}

fn body(job: &Job<'_>, name: &str) -> Result<Vec<String>, DialectError> {
    let home = "Bring arm and table home by hand first: the first move goes there, slowly, on a way that was not checked.";
    let coupled = "Joints are the controller's own, J3 coupled to J2 where it is so.";
    let frames = "Positions are in joints, of UFRAME 0 and UTOOL 1: select these in both groups first. None is selected \
                  here, and a controller may refuse others (INTP-253).";
    let table = "axis 1 of motion group 2; it moves with the arm.";
    let waits = "Sets $WAITTMOUT, the time-out of waits in every program, and leaves it so: others have to set their own.";
    let head = paragraphs(job, &format!("{name}.LS"), "deg, percent of rated, s.", table, &[home, coupled, frames, waits]);
    let mut lines: Vec<String> = head.iter().flat_map(|paragraph| remark(paragraph)).collect();
    lines.push(format!("  $WAITTMOUT={}", at_least(100.0 * job.params.timeout_secs, 0)));
    let mut homing_percent = HOMING_PERCENT;
    for action in &job.actions {
        if let Action::Go(stretch) = action {
            homing_percent = homing_percent.min(percent(stretch.speed_fraction, Dialect::Fanuc)?);
        }
    }
    lines.push(format!("J P[1] {homing_percent}% FINE"));
    for action in &job.actions {
        match action {
            Action::Toward(view) => lines.extend(remark(&super::walk::toward(*view))),
            Action::Go(stretch) => lines.push(go(stretch)?),
            Action::Settle(secs) => lines.push(wait(*secs)),
            Action::Scan { view, brightness } => {
                lines.extend(remark(&format!("scan viewpoint {}, level {brightness}", view.0)));
                lines.extend(scan(job));
            }
        }
    }
    lines.extend([
        "  END".to_owned(),
        format!("  LBL[{LATE}:NO ANSWER]"),
        "  MESSAGE[SCANNER DID NOT ANSWER]".to_owned(),
        "  ABORT".to_owned(),
        format!("  LBL[{HELD}:STILL ON]"),
        "  MESSAGE[SCANNER INPUT STAYS ON]".to_owned(),
        "  ABORT".to_owned(),
    ]);
    Ok(lines)
}

/// A semicolon would end the line.
fn remark(text: &str) -> Vec<String> {
    wrap(&text.replace([';', '"'], "."), REMARK_CHARS).into_iter().map(|line| format!("  !{line}")).collect()
}

fn go(stretch: &Stretch) -> Result<String, DialectError> {
    let percent = percent(stretch.speed_fraction, Dialect::Fanuc)?;
    Ok(format!("J P[{}] {percent}% FINE ACC{percent}", stretch.point + 1))
}

/// Rounded up to hundredths, and without a zero before the point, as the controller writes it.
fn wait(secs: f64) -> String {
    let text = at_least(secs, 2);
    format!("  WAIT {:>6}(sec)", text.strip_prefix('0').unwrap_or(&text))
}

fn scan(job: &Job<'_>) -> [String; 5] {
    let (output, input) = (job.params.scan_output, job.params.scan_input);
    [
        format!("  WAIT DI[{input}]=OFF TIMEOUT,LBL[{HELD}]"),
        format!("  DO[{output}]=ON"),
        wait(job.params.pulse_secs),
        format!("  DO[{output}]=OFF"),
        format!("  WAIT DI[{input}]=ON TIMEOUT,LBL[{LATE}]"),
    ]
}

fn position(index: usize, point: &Configuration, joint_3_from: JointThreeOrigin, job: &Job<'_>) -> Vec<String> {
    let mut angles_deg = rounded(point, &job.axes, DEGREE, DECIMALS);
    if joint_3_from == JointThreeOrigin::UpperArm {
        angles_deg[2] -= angles_deg[1];
    }
    let [joints @ .., table] = angles_deg.map(|angle| fixed(angle, DECIMALS));
    let joint = |joint: usize| format!("J{}= {:>9} deg", joint + 1, joints[joint]);
    let text = format!(
        "P[{}{}]{{
   GP1:
\tUF : 0, UT : 1,
\t{},\t{},\t{},
\t{},\t{},\t{}
   GP2:
\tUF : 0, UT : 1,
\tJ1= {:>9} deg
}};",
        index + 1,
        if index == 0 { ":\"HOME\"" } else { "" },
        joint(0),
        joint(1),
        joint(2),
        joint(3),
        joint(4),
        joint(5),
        table
    );
    text.lines().map(str::to_owned).collect()
}
