//! The program that runs on the controller: it takes commands from a socket that it opens itself, and stops by itself when none
//! comes in time.

use std::net::SocketAddr;
use std::time::Duration;

use super::UrCommand;
use crate::cell::UrMotion;

/// Time within which the first command must come.
const FIRST_SECS: f64 = 5.0;
/// The joints of a command, in URScript.
const JOINTS: &str =
    "[c[3] / 1000000.0, c[4] / 1000000.0, c[5] / 1000000.0, c[6] / 1000000.0, c[7] / 1000000.0, c[8] / 1000000.0]";

/// Tuning of `servoj`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServoTuning {
    /// Look-ahead, 30 to 200 ms.
    pub lookahead_ms: u32,
    /// Gain, 100 to 2000.
    pub gain: u32,
}

/// Text of the program.
///
/// `reverse` is where it connects to. After the first command it waits for each no longer than `watchdog`: then it stops by `stopj`
/// and ends.
#[must_use]
pub fn program_text(motion: UrMotion, tuning: ServoTuning, reverse: SocketAddr, watchdog: Duration) -> String {
    let (leader, commands) = match motion {
        UrMotion::Servoj => (servoj(tuning), servoj_commands()),
        UrMotion::Movej => (MOVEJ.to_owned(), movej_commands()),
    };
    format!(
        "def vantage():
  global vantage_on = True
  global vantage_q = get_actual_joint_positions()
  global vantage_v = 0.1
  global vantage_a = 2.0
{leader}  if not socket_open(\"{host}\", {port}, \"vantage\"):
    halt
  end
  leader = run vantage_lead()
  wait_secs = {FIRST_SECS:.3}
  while vantage_on:
    c = socket_read_binary_integer({count}, \"vantage\", wait_secs)
    wait_secs = {watchdog_secs:.3}
    if c[0] != {count}:
      vantage_on = False
{commands}    elif c[1] == 4:
      vantage_on = False
    end
  end
  kill leader
  stopj(vantage_a)
  socket_close(\"vantage\")
end
",
        host = reverse.ip(),
        port = reverse.port(),
        count = UrCommand::INTEGERS,
        watchdog_secs = watchdog.as_secs_f64(),
    )
}

fn servoj(ServoTuning { lookahead_ms, gain }: ServoTuning) -> String {
    let lookahead_secs = f64::from(lookahead_ms) / 1e3;
    format!(
        "  thread vantage_lead():
    while vantage_on:
      servoj(vantage_q, 0, 0, get_steptime(), {lookahead_secs:.3}, {gain})
    end
  end
"
    )
}

fn servoj_commands() -> String {
    format!("    elif c[1] == 1:\n      vantage_q = {JOINTS}\n")
}

/// The first move goes to where the arm stands.
const MOVEJ: &str = "  thread vantage_lead():
    movej(vantage_q, vantage_a, vantage_v, 0, 0)
  end
";

/// A stop is acknowledged before the arm brakes, which takes its time.
fn movej_commands() -> String {
    format!(
        "    elif c[1] == 2:
      kill leader
      vantage_q = {JOINTS}
      vantage_v = c[9] / 1000000.0
      vantage_a = c[10] / 1000000.0
      leader = run vantage_lead()
      socket_send_int(c[2], \"vantage\")
    elif c[1] == 3:
      socket_send_int(c[2], \"vantage\")
      kill leader
      stopj(c[10] / 1000000.0)
"
    )
}
