//! Universal Robots URScript (*The URScript Programming Language*, e-Series). `movej(q, a, v, t, r)`: q in rad, a and v those
//! of the leading axis in rad/s² and rad/s, r = 0 stops at the point. A controller has no table axis: the script calls
//! `vantage_table(angle_deg)`, which stops the program until the integrator has filled it in. One function holds all, so that
//! the script runs when it is sent to port 30002.

use super::header::{commented, paragraphs};
use super::names::{NameRule, identifier};
use super::numbers::{angles, at_least, at_most};
use super::walk::{Action, Stretch, scanning, toward};
use super::{Dialect, DialectError, DialectFacts, DialectFile, DialectOutput, Job};

/// Standard digital inputs and outputs, from 0 (`n` of `set_standard_digital_out` and `get_standard_digital_in`).
const LAST_SIGNAL: u32 = 7;
/// `_program` behind the name keeps it apart from keywords and functions of the language.
const SUFFIX: &str = "_program";
const NAME: NameRule = NameRule { longest: 32, reserved: &[], point: "" };

/// Facts of the dialect.
pub(super) const FACTS: DialectFacts = DialectFacts {
    outputs: &[DialectOutput { format: "urscript", extension: "script", media_type: "text/x-urscript; charset=utf-8" }],
    has_table_axis: false,
    whole_percents_from: None,
    tells_brightness: false,
    is_table: false,
    file_stem: None,
    name_length_param: None,
    before_first_run: Some("fill in vantage_table(angle_deg), which turns the table; until then the program stops there"),
    render,
};

/// The script.
fn render(job: &Job<'_>) -> Result<Vec<DialectFile>, DialectError> {
    job.check_signals(Dialect::Urscript, 0, LAST_SIGNAL)?;
    let name = identifier(&job.params.program_name, job.program.setup, &NAME);
    let table = "FILL IN vantage_table below; until then the program stops there. Arm and table never move together.";
    let units = "rad, rad/s, rad/s2, s; table angles deg.";
    let how = format!("Send it to port 30002, or insert it as a script and call {name}{SUFFIX}().");
    let [.., start] = angles(&job.program.home_rad, &job.axes, super::numbers::DEGREE, 4);
    let begin = format!(
        "Before each start: arm at home, table within 0.5 deg of {start} deg. The script cannot read the table's angle and \
         asks the operator to confirm it before anything moves."
    );
    let head = paragraphs(job, &format!("{name}.script"), units, table, &[&how, &begin]);
    let mut lines = commented(&head, "#");
    lines.push(format!("def {name}{SUFFIX}():"));
    lines.extend(functions(job).lines().map(|line| if line.is_empty() { String::new() } else { format!("  {line}") }));
    lines.push("  vantage_require_home()".to_owned());
    for action in &job.actions {
        lines.push(match action {
            Action::Toward(view) => format!("  # {}", toward(*view)),
            Action::Go(stretch) => go(stretch, job),
            Action::Settle(secs) => format!("  sleep({})", at_least(*secs, 3)),
            Action::Scan { view, brightness } => format!("  # {}\n  vantage_scan()", scanning(*view, *brightness)),
        });
    }
    lines.push("end".to_owned());
    Ok(vec![Job::file(&name, "script", &lines)])
}

fn functions(job: &Job<'_>) -> String {
    let params = job.params;
    let (output, input) = (params.scan_output, params.scan_input);
    let (pulse, timeout) = (at_least(params.pulse_secs, 3), at_least(params.timeout_secs, 3));
    let [j1, j2, j3, j4, j5, j6, _] = angles(&job.program.home_rad, &job.axes, 1.0, 7);
    let [.., table] = angles(&job.program.home_rad, &job.axes, super::numbers::DEGREE, 4);
    // A turn from another angle was not checked: with the arm at home a wide part may hit the scanner on the way.
    let ask =
        format!("Turn the table to {table} deg by hand, within 0.5 deg. Continue when it stands there; else stop the program");
    format!(
        "def vantage_stop(reason):
  popup(reason, title=\"Vantage\", error=True, blocking=True)
  halt
end

# Turn the table to angle_deg and return when it stands. Put the calls for your table here, and take the stop away.
def vantage_table(angle_deg):
  vantage_stop(\"vantage_table has to be filled in for this table\")
end

def vantage_scan():
  local waited = 0.0
  while get_standard_digital_in({input}):
    if waited >= {timeout}:
      vantage_stop(\"The scanner's input stays on\")
    end
    sleep(0.01)
    waited = waited + 0.01
  end
  set_standard_digital_out({output}, True)
  sleep({pulse})
  set_standard_digital_out({output}, False)
  waited = 0.0
  while not get_standard_digital_in({input}):
    if waited >= {timeout}:
      vantage_stop(\"The scanner did not answer\")
    end
    sleep(0.01)
    waited = waited + 0.01
  end
end

# The paths begin at home; from anywhere else, arm or table, they were not checked. The table's angle cannot be read here.
def vantage_require_home():
  local home = [{j1}, {j2}, {j3}, {j4}, {j5}, {j6}]
  local here = get_actual_joint_positions()
  local joint = 0
  while joint < 6:
    local off = here[joint] - home[joint]
    if off > 0.00873 or off < -0.00873:
      vantage_stop(\"The arm is not at home; bring it there by hand\")
    end
    joint = joint + 1
  end
  popup(\"{ask}\", title=\"Vantage\", warning=True, blocking=True)
  vantage_table({table})
end
"
    )
}

/// Arm or table; never both, since the program is interlocked.
fn go(stretch: &Stretch, job: &Job<'_>) -> String {
    if stretch.moves_table() {
        let [.., table] = angles(&stretch.to_rad, &job.axes, super::numbers::DEGREE, 4);
        return format!("  vantage_table({table})");
    }
    let [j1, j2, j3, j4, j5, j6, _] = angles(&stretch.to_rad, &job.axes, 1.0, 7);
    let lead = stretch.lead(&job.axes);
    let (a, v) = (at_most(lead.rad_per_s2, 5), at_most(lead.rad_per_s, 5));
    format!("  movej([{j1}, {j2}, {j3}, {j4}, {j5}, {j6}], a={a}, v={v}, t=0, r=0)")
}
