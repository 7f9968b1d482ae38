//! The program that runs on the controller: it takes commands from a socket that it opens itself, and stops by itself when none
//! comes in time.

use std::net::SocketAddr;
use std::time::Duration;

use super::UrCommand;
use crate::cell::UrMotion;

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
/// `reverse` is where it connects to. With a first command it waits for the next one no longer than `watchdog`: then it stops by
/// `stopj` and ends.
#[must_use]
pub fn program_text(motion: UrMotion, tuning: ServoTuning, reverse: SocketAddr, watchdog: Duration) -> String {
    let (host, port, count) = (reverse.ip(), reverse.port(), UrCommand::INTEGERS);
    let (watchdog_secs, lookahead_secs, gain) = (watchdog.as_secs_f64(), f64::from(tuning.lookahead_ms) / 1e3, tuning.gain);
    let led = match motion {
        UrMotion::Servoj => format!(
            "  thread vantage_lead():
    while vantage_on:
      servoj(vantage_q, 0, 0, get_steptime(), {lookahead_secs:.3}, {gain})
    end
  end
"
        ),
        UrMotion::Movej => "  thread vantage_lead():
    movej(vantage_q, vantage_a, vantage_v, 0, 0)
  end
"
        .to_owned(),
    };
    let (at_start, set_point, at_move) = match motion {
        UrMotion::Servoj => ("  vantage_leader = run vantage_lead()\n", "      vantage_q = vantage_target\n", ""),
        UrMotion::Movej => (
            "  vantage_leader = 0\n",
            "",
            "      vantage_q = vantage_target\n      vantage_v = c[9] / 1000000.0\n      vantage_a = c[10] / 1000000.0
      if vantage_moves:\n        kill vantage_leader\n      end
      vantage_moves = True\n      vantage_leader = run vantage_lead()\n      socket_send_int(c[2], \"vantage\")\n",
        ),
    };
    let set_point = if set_point.is_empty() { "      sync()\n" } else { set_point };
    let at_move = if at_move.is_empty() { "      sync()\n" } else { at_move };
    let halt = match motion {
        UrMotion::Servoj => "kill vantage_leader",
        UrMotion::Movej => "if vantage_moves:\n        kill vantage_leader\n        vantage_moves = False\n      end",
    };
    let again = match motion {
        UrMotion::Servoj => "      vantage_leader = run vantage_lead()\n",
        UrMotion::Movej => "",
    };
    format!(
        "def vantage():
  global vantage_on = True
  global vantage_moves = False
  global vantage_q = get_actual_joint_positions()
  global vantage_v = 0.1
  global vantage_a = 1.0
{led}  if not socket_open(\"{host}\", {port}, \"vantage\"):
    halt
  end
{at_start}  wait_secs = 5.0
  while vantage_on:
    c = socket_read_binary_integer({count}, \"vantage\", wait_secs)
    wait_secs = {watchdog_secs:.3}
    vantage_target = get_target_joint_positions()
    if c[0] == {count}:
      vantage_target = [c[3] / 1000000.0, c[4] / 1000000.0, c[5] / 1000000.0, c[6] / 1000000.0, c[7] / 1000000.0, c[8] / 1000000.0]
    end
    if c[0] != {count}:
      vantage_on = False
    elif c[1] == 1:
{set_point}    elif c[1] == 2:
{at_move}    elif c[1] == 3:
      {halt}
      stopj(c[10] / 1000000.0)
      vantage_q = get_target_joint_positions()
{again}      socket_send_int(c[2], \"vantage\")
    elif c[1] == 4:
      vantage_on = False
    end
  end
  {halt_at_end}
  stopj(vantage_a)
  socket_close(\"vantage\")
end
",
        halt_at_end = halt.replace("\n      ", "\n  "),
    )
}
