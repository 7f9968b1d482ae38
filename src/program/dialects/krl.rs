//! KUKA KRL (*KSS 8.x Operating and Programming Instructions for System Integrators*): a `.src` file with the program and a
//! `.dat` file with its points, both of the same name, at most 24 characters. `PTP` without approximation stops at each
//! point; speeds and accelerations are whole percents of each axis. The table is an external axis. The first motion is to
//! home, where the arm already stands: the controller wants its block coincidence there. Two inputs never change: as delivered,
//! 1025 is TRUE and 1026 is FALSE (*KSS 8.x System Variables*, `$IOSYS_IN_TRUE` and `$IOSYS_IN_FALSE`).
//! `$TIMER[n]` counts milliseconds, an INT that a program may set; it runs while `$TIMER_STOP[n]` is FALSE and stands while
//! that is TRUE (the same, `$TIMER` and `$TIMER_STOP`). The timers are the controller's: the header says which one is taken.

use super::header::{commented, origin, paragraphs};
use super::names::{NameRule, identifier};
use super::numbers::{DEGREE, angles, at_least};
use super::walk::{Action, points, scanning, toward};
use super::{Dialect, DialectError, DialectFacts, DialectFile, DialectOutput, Job, percent};
use crate::planning::params::DialectParams;

const NAME: NameRule = NameRule { longest: 24, reserved: RESERVED, point: POINT };
/// Beginning of the names of points: each is of the module's data list, which has the module's name.
const POINT: &str = "XP";
/// Keywords, names of the program's own, and those of modules that every controller has.
const RESERVED: &[&str] = &[
    "AND",
    "ANIN",
    "ANOUT",
    "AXIS",
    "BAS",
    "BOOL",
    "BRAKE",
    "B_AND",
    "B_EXOR",
    "B_NOT",
    "B_OR",
    "CASE",
    "CAST_FROM",
    "CAST_TO",
    "CCDLIST",
    "CCLOSE",
    "CELL",
    "CHANNEL",
    "CHAR",
    "CIOCTL",
    "CIRC",
    "CIRC_REL",
    "CONFIRM",
    "CONST",
    "CONTINUE",
    "COPEN",
    "CREAD",
    "CWRITE",
    "DECL",
    "DEF",
    "DEFAULT",
    "DEFDAT",
    "DEFFCT",
    "DELAY",
    "DIGIN",
    "DISTANCE",
    "DO",
    "E6AXIS",
    "E6POS",
    "ELSE",
    "END",
    "ENDDAT",
    "ENDFCT",
    "ENDFOR",
    "ENDIF",
    "ENDLOOP",
    "ENDSPLINE",
    "ENDSWITCH",
    "ENDWHILE",
    "ENUM",
    "EXIT",
    "EXOR",
    "EXT",
    "EXTFCT",
    "FALSE",
    "FOR",
    "FRAME",
    "GLOBAL",
    "GOTO",
    "HALT",
    "I",
    "IF",
    "IMPORT",
    "INT",
    "INTERRUPT",
    "IS",
    "IS_AWAY",
    "LIN",
    "LIN_REL",
    "LOOP",
    "MAXIMUM",
    "MINIMUM",
    "NOT",
    "OFF",
    "ON",
    "OR",
    "POS",
    "PRIO",
    "PTP",
    "PTP_REL",
    "PUBLIC",
    "PULSE",
    "REAL",
    "REPEAT",
    "RESUME",
    "RETURN",
    "SCAN_VIEW",
    "SCIRC",
    "SEC",
    "SIGNAL",
    "SLIN",
    "SPL",
    "SPLINE",
    "SPS",
    "SPTP",
    "SREAD",
    "STEP",
    "STRUC",
    "SWITCH",
    "SWRITE",
    "SYN",
    "THEN",
    "TO",
    "TRIGGER",
    "TRUE",
    "UNTIL",
    "WAIT",
    "WHEN",
    "WHILE",
    "XHOME",
];
/// The controller's timer that the waits for the scanner use.
const TIMER: u32 = 10;
/// Input that is always TRUE.
const INPUT_TRUE: u32 = 1025;
/// Input that is always FALSE.
const INPUT_FALSE: u32 = 1026;

/// Facts of the dialect.
pub(super) const FACTS: DialectFacts = DialectFacts {
    outputs: &[
        DialectOutput { format: "krl", extension: "src", media_type: "text/x-krl; charset=utf-8" },
        DialectOutput { format: "krl_dat", extension: "dat", media_type: "text/x-krl-dat; charset=utf-8" },
    ],
    has_table_axis: true,
    whole_percents_from: Some(0.0),
    tells_brightness: false,
    is_table: false,
    file_stem: Some(module_name),
    name_length_param: None,
    before_first_run: None,
    render,
};

/// Name of the module, which that of its files must be.
fn module_name(params: &DialectParams, setup: usize) -> String {
    identifier(&params.program_name, setup, &NAME).to_ascii_uppercase()
}

/// Program and points.
fn render(job: &Job<'_>) -> Result<Vec<DialectFile>, DialectError> {
    job.check_signals(Dialect::Krl, 1, 4096)?;
    check_input(job.params.scan_input)?;
    let name = module_name(job.params, job.program.setup);
    let access = ["&ACCESS RVP".to_owned(), "&REL 1".to_owned()];
    let mut src = access.to_vec();
    src.extend([format!("DEF {name}( )"), "DECL INT I".to_owned()]);
    src.extend(head(job, &name));
    src.extend(body(job)?);
    src.push("END".to_owned());
    src.extend(is_away(job));
    src.extend(scan(job).lines().map(str::to_owned));
    let mut dat = access.to_vec();
    dat.push(format!("DEFDAT {name}"));
    dat.extend(commented(&origin(job), ";"));
    dat.extend(points(job.program, &job.actions).iter().enumerate().map(|(index, point)| {
        let [j1, j2, j3, j4, j5, j6, table] = angles(point, &job.axes, DEGREE, 4);
        let axis = job.params.table_axis;
        format!("DECL E6AXIS {}={{A1 {j1},A2 {j2},A3 {j3},A4 {j4},A5 {j5},A6 {j6},E{axis} {table}}}", point_name(index))
    }));
    dat.push("ENDDAT".to_owned());
    Ok(vec![Job::file(&name, "src", &src), Job::file(&name, "dat", &dat)])
}

/// Refuses an input that never changes, and so tells nothing of the scanner.
fn check_input(number: u32) -> Result<(), DialectError> {
    let (level, effect) = match number {
        INPUT_TRUE => ("TRUE", "every scan would count as done at once"),
        INPUT_FALSE => ("FALSE", "no scan would ever count as done"),
        _ => return Ok(()),
    };
    Err(DialectError::ConstantInput { number, level, effect })
}

fn point_name(index: usize) -> String {
    if index == 0 { "XHOME".to_owned() } else { format!("{POINT}{index}") }
}

fn head(job: &Job<'_>, name: &str) -> Vec<String> {
    let axis = job.params.table_axis;
    let table = format!("external axis E{axis}; it moves with the arm (synchronous, not an asynchronous axis).");
    let timer = format!("Uses $TIMER[{TIMER}].");
    let paragraphs = paragraphs(job, &format!("{name}.src, with {name}.dat"), "deg, percent of rated, s.", &table, &[&timer]);
    commented(&paragraphs, ";")
}

fn body(job: &Job<'_>) -> Result<Vec<String>, DialectError> {
    let axis = job.params.table_axis;
    let mut lines = vec!["BAS(#INITMOV,0)".to_owned()];
    lines.push(
        "; The paths begin at home; from anywhere else they were not checked. Bring arm and table there by hand.".to_owned(),
    );
    lines.extend(["WHILE IS_AWAY( )", "HALT", "ENDWHILE"].map(str::to_owned));
    let mut speed = None;
    for action in &job.actions {
        match action {
            Action::Toward(view) => lines.push(format!("; {}", toward(*view))),
            Action::Go(stretch) => {
                let percent = percent(stretch.speed_fraction, Dialect::Krl)?;
                if speed.is_none() {
                    lines.extend(set_speed(percent, axis));
                    lines.push("PTP XHOME".to_owned());
                } else if speed != Some(percent) {
                    lines.extend(set_speed(percent, axis));
                }
                speed = Some(percent);
                lines.push(format!("PTP {}", point_name(stretch.point)));
            }
            Action::Settle(secs) => lines.push(format!("WAIT SEC {}", at_least(*secs, 3))),
            Action::Scan { view, brightness } => {
                lines.push(format!("; {}", scanning(*view, *brightness)));
                lines.push("SCAN_VIEW( )".to_owned());
            }
        }
    }
    Ok(lines)
}

fn set_speed(percent: u32, axis: u32) -> [String; 6] {
    [
        "FOR I=1 TO 6".to_owned(),
        format!("$VEL_AXIS[I]={percent}"),
        format!("$ACC_AXIS[I]={percent}"),
        "ENDFOR".to_owned(),
        format!("$VEL_EXTAX[{axis}]={percent}"),
        format!("$ACC_EXTAX[{axis}]={percent}"),
    ]
}

/// Returns true if arm or table is not at home.
fn is_away(job: &Job<'_>) -> Vec<String> {
    let axes = (1..=6).map(|joint| format!("A{joint}")).chain([format!("E{}", job.params.table_axis)]);
    let tests = axes.flat_map(|axis| {
        [format!("IF ABS($AXIS_ACT.{axis}-XHOME.{axis})>0.5 THEN"), "RETURN TRUE".to_owned(), "ENDIF".to_owned()]
    });
    let last = ["RETURN FALSE".to_owned(), "ENDFCT".to_owned()];
    std::iter::once("DEFFCT BOOL IS_AWAY( )".to_owned()).chain(tests).chain(last).collect()
}

/// Waits until the answer to the capture before is off, pulses, and waits for the answer. Waits in vain until the time is over,
/// then halts; started again, it waits once more.
fn scan(job: &Job<'_>) -> String {
    let params = job.params;
    let (output, input) = (params.scan_output, params.scan_input);
    format!(
        "DEF SCAN_VIEW( )
$TIMER[{TIMER}]=0
$TIMER_STOP[{TIMER}]=FALSE
WHILE $IN[{input}]
IF $TIMER[{TIMER}]>{timeout} THEN
; The scanner's input stays on.
HALT
$TIMER[{TIMER}]=0
ENDIF
ENDWHILE
$OUT[{output}]=TRUE
WAIT SEC {pulse}
$OUT[{output}]=FALSE
$TIMER[{TIMER}]=0
WHILE NOT $IN[{input}]
IF $TIMER[{TIMER}]>{timeout} THEN
; The scanner did not answer.
HALT
$TIMER[{TIMER}]=0
ENDIF
ENDWHILE
$TIMER_STOP[{TIMER}]=TRUE
END
",
        pulse = at_least(params.pulse_secs, 3),
        timeout = at_least(1000.0 * params.timeout_secs, 0)
    )
}
