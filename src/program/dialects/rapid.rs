//! ABB RAPID (*Technical reference manual, RAPID Instructions, Functions and Data types*, 3HAC050917). `MoveAbsJ` with `fine`
//! stops at each joint target; its `\T` is the time of the move, which is how a share of the rated joint speeds is said in a
//! language whose speed data are those of the tool. It is the time at the acceleration that `AccSet` sets, whole percents of the
//! rated: at more the move would end later than is said. The table is an external axis of the joint target. `WaitDI` past
//! `\MaxTime` raises ERR_WAIT_MAXTIME, which stops the program since nothing handles it. `AliasIO` takes the name of a signal by
//! reference, from a constant: a string as it stands is none. Names have 32 characters at most.
//! Controllers of arms with a parallel rod count joint 3 from the ground; a robot's model without `joint_3_from_ground`
//! may have left that open, so the header tells how the program counts it, and how to try it on the arm.

use super::header::{commented, paragraphs};
use super::names::{NameRule, identifier};
use super::numbers::{DEGREE, angles, at_least};
use super::walk::{Action, Stretch, points, scanning, toward};
use super::{DialectFacts, DialectFile, DialectOutput, Job, listed, shortest, whole_percent};
use crate::cell::Configuration;

/// The procedure has the module's name and this, within 32 characters.
const RUN: &str = "_run";
const NAME: NameRule = NameRule { longest: 32 - RUN.len(), reserved: RESERVED, point: "" };
/// Reserved words, and what no module should be called.
const RESERVED: &[&str] = &[
    "ALIAS",
    "AND",
    "BACKWARD",
    "BASE",
    "CASE",
    "CONNECT",
    "CONST",
    "DEFAULT",
    "DIV",
    "DO",
    "ELSE",
    "ELSEIF",
    "ENDFOR",
    "ENDFUNC",
    "ENDIF",
    "ENDMODULE",
    "ENDPROC",
    "ENDRECORD",
    "ENDTEST",
    "ENDTRAP",
    "ENDWHILE",
    "ERROR",
    "EXIT",
    "FALSE",
    "FOR",
    "FROM",
    "FUNC",
    "GOTO",
    "IF",
    "INOUT",
    "LOCAL",
    "MAIN",
    "MOD",
    "MODULE",
    "NOSTEPIN",
    "NOT",
    "NOVIEW",
    "OR",
    "PERS",
    "PROC",
    "RAISE",
    "READONLY",
    "RECORD",
    "RETRY",
    "RETURN",
    "STEP",
    "SYSMODULE",
    "TASK",
    "TEST",
    "THEN",
    "TO",
    "TRAP",
    "TRUE",
    "TRYNEXT",
    "UNDO",
    "USER",
    "VAR",
    "VIEWONLY",
    "WHILE",
    "WITH",
    "XOR",
];
/// Comparison that finds zeros, signs and a joint 3 that the controller counts otherwise.
const HOME: &str = "Before anything moves by program: with the arm in the posture of home, compare the joint angles that the \
                    controller shows with those of p0.";
/// An external axis that is not there.
const ABSENT: &str = "9E9";
/// Smallest share of the rated acceleration that `AccSet` sets, percent: it takes less for this.
const MIN_ACCELERATION_PERCENT: u32 = 20;
/// Difference of a planned time from the one of its file, s: what angles lose there changes no digit.
const LOST_SECS: f64 = 1e-6;
/// Shortest time of a move: the least that three decimals say.
const MIN_MOVE_SECS: f64 = 1e-3;

/// Facts of the dialect.
pub(super) const FACTS: DialectFacts = DialectFacts {
    outputs: &[DialectOutput { format: "rapid", extension: "mod", media_type: "text/x-rapid; charset=utf-8" }],
    has_table_axis: true,
    // Below, AccSet sets more than was planned, and a move takes its planned time.
    whole_percents_from: Some(MIN_ACCELERATION_PERCENT as f64 / 100.0),
    tells_brightness: false,
    is_table: false,
    file_stem: None,
    name_length_param: None,
    before_first_run: Some(
        "replace tool0, which carries no load, by the scanner's tool data, give the two signals their names in the controller, \
         and before anything moves compare the joint angles that it shows, the arm at home, with those of p0, joint 3 above all",
    ),
    render: |job| Ok(render(job)),
};

/// The module.
fn render(job: &Job<'_>) -> Vec<DialectFile> {
    let name = identifier(&job.params.program_name, job.program.setup, &NAME);
    let table = format!("external axis {} of the joint targets; it moves with the arm.", job.params.table_axis);
    let signals = format!(
        "Signals: scan_output and scan_input stand for the configured signals DO_{} and DI_{}; change the names below.",
        job.params.scan_output, job.params.scan_input
    );
    let load = "tool0 carries no load: replace it by the scanner's tool data before the first run.";
    let units = "deg, s.";
    let call = format!("Call {name}{RUN};");
    let acceleration = raised_acceleration(job);
    let mut extra = vec![signals.as_str(), load, HOME, joint_3(job)];
    extra.extend(acceleration.as_deref());
    extra.push(&call);
    let head = paragraphs(job, &format!("{name}.mod"), units, &table, &extra);
    let mut lines = vec![format!("MODULE {name}")];
    lines.extend(commented(&head, "  !"));
    for (index, point) in points(job.program, &job.actions).iter().enumerate() {
        lines.push(format!("  LOCAL CONST jointtarget p{index}:={};", joint_target(point, job)));
    }
    lines.extend(routines(job).lines().map(str::to_owned));
    lines.push(format!("  PROC {name}{RUN}()"));
    lines.extend(body(job));
    lines.extend(["  ENDPROC".to_owned(), "ENDMODULE".to_owned()]);
    vec![Job::file(&name, "mod", &lines)]
}

/// Header's words on how joint 3 is counted: jogging joint 2 alone shows it, whatever the angles on the display.
fn joint_3(job: &Job<'_>) -> &'static str {
    if job.cell.robot.kinematics.counts_joint_3_from_ground() {
        "Joint 3 is counted from the ground: when joint 2 is jogged alone, the forearm has to keep its slope. Else do not run."
    } else {
        "Joint 3 is counted from the upper arm: when joint 2 is jogged alone, the forearm has to turn with it. Else (ABB arms \
         with a parallel rod, such as IRB 2400, 4400, 6400) do not run: the robot's model needs joint_3_from_ground = true."
    }
}

/// Header's words on moves that accelerate harder than was planned, and which these are; `None` if none does.
fn raised_acceleration(job: &Job<'_>) -> Option<String> {
    let (mut raised, mut goal, mut moves_otherwise) = (Vec::new(), String::new(), false);
    let mut shares = [f64::INFINITY, f64::NEG_INFINITY];
    for action in &job.actions {
        match action {
            Action::Toward(view) => goal = toward(*view),
            Action::Go(stretch) if whole_percent(stretch.speed_fraction) < MIN_ACCELERATION_PERCENT => {
                let share = 100.0 * stretch.speed_fraction;
                shares = [shares[0].min(share), shares[1].max(share)];
                if !raised.contains(&goal) {
                    raised.push(goal.clone());
                }
            }
            Action::Go(_) => moves_otherwise = true,
            Action::Settle(_) | Action::Scan { .. } => {}
        }
    }
    let [least, most] = shares.map(shortest);
    let planned = if least == most { least } else { format!("{least} to {most}") };
    let which = match raised.as_slice() {
        [] => return None,
        _ if !moves_otherwise => "every move".to_owned(),
        [only] => format!("the move {only}"),
        several => format!("the moves {}", listed(several)),
    };
    Some(format!(
        "Acceleration: {MIN_ACCELERATION_PERCENT} % of the rated, not the {planned} % that were planned, since AccSet sets no \
         less. This concerns {which}; the planned times are kept all the same."
    ))
}

fn joint_target(point: &Configuration, job: &Job<'_>) -> String {
    let [j1, j2, j3, j4, j5, j6, table] = angles(point, &job.axes, DEGREE, 4);
    let external = (1..=6).map(|axis| if axis == job.params.table_axis { table.as_str() } else { ABSENT });
    format!("[[{j1},{j2},{j3},{j4},{j5},{j6}],[{}]]", external.collect::<Vec<_>>().join(","))
}

fn routines(job: &Job<'_>) -> String {
    let params = job.params;
    let eax = ["a", "b", "c", "d", "e", "f"][params.table_axis.clamp(1, 6) as usize - 1];
    let far: Vec<String> = (1..=6)
        .map(|axis| format!("Abs(now.robax.rax_{axis}-p0.robax.rax_{axis})>0.5"))
        .chain([format!("Abs(now.extax.eax_{eax}-p0.extax.eax_{eax})>0.5")])
        .collect();
    format!(
        "  LOCAL CONST string scan_output_name:=\"DO_{}\";
  LOCAL CONST string scan_input_name:=\"DI_{}\";
  LOCAL VAR signaldo scan_output;
  LOCAL VAR signaldi scan_input;
  ! The paths begin at home; from anywhere else they were not checked.
  LOCAL PROC require_home()
    VAR jointtarget now;
    now:=CJointT();
    IF {} THEN
      ErrWrite \"Vantage: not at home\",\"Bring arm and table to p0 by hand, then start again.\";
      EXIT;
    ENDIF
  ENDPROC
  LOCAL PROC scan()
    WaitDI scan_input,0\\MaxTime:={timeout};
    SetDO scan_output,1;
    WaitTime {};
    SetDO scan_output,0;
    WaitDI scan_input,1\\MaxTime:={timeout};
  ENDPROC
",
        params.scan_output,
        params.scan_input,
        far.join("\n      OR "),
        at_least(params.pulse_secs, 3),
        timeout = at_least(params.timeout_secs, 3)
    )
}

fn body(job: &Job<'_>) -> Vec<String> {
    let mut lines = vec![
        "    AliasIO scan_output_name,scan_output;".to_owned(),
        "    AliasIO scan_input_name,scan_input;".to_owned(),
        "    require_home;".to_owned(),
    ];
    let mut acceleration = None;
    for action in &job.actions {
        match action {
            Action::Toward(view) => lines.push(format!("    ! {}", toward(*view))),
            Action::Go(stretch) => {
                if acceleration.replace(stretch.speed_fraction) != Some(stretch.speed_fraction) {
                    lines.push(format!("    AccSet {},100;", share_of_acceleration(stretch.speed_fraction)));
                }
                lines.push(go(stretch, job));
            }
            Action::Settle(secs) => lines.push(format!("    WaitTime\\InPos,{};", at_least(*secs, 3))),
            Action::Scan { view, brightness } => {
                lines.push(format!("    ! {}", scanning(*view, *brightness)));
                lines.push("    scan;".to_owned());
            }
        }
    }
    lines.push("    AccSet 100,100;".to_owned());
    lines
}

/// Whole percents for `AccSet`, rounded down: never harder than was planned, save below its least.
fn share_of_acceleration(speed_fraction: f64) -> u32 {
    whole_percent(speed_fraction).clamp(MIN_ACCELERATION_PERCENT, 100)
}

fn go(stretch: &Stretch, job: &Job<'_>) -> String {
    let secs = (stretch.secs(&job.axes) - LOST_SECS).max(MIN_MOVE_SECS);
    format!("    MoveAbsJ p{}\\NoEOffs,vmax\\T:={},fine,tool0;", stretch.point, at_least(secs, 3))
}
