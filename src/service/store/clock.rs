//! Clock by which ages count. Times in the store are the machine's wall clock, and that may be set: what lies behind a jump would
//! look old at once. So nothing is deleted for its age once the wall clock has left the clock that nobody sets.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

/// Max difference of the two clocks. Corrections that stay below it move no age that matters: all are hours or days.
const TOLERANCE: Duration = Duration::from_secs(600);

/// The clocks at the start of the process.
pub(super) struct Clock {
    pub(super) wall: SystemTime,
    uptime: Option<Duration>,
    started: Instant,
    is_told: AtomicBool,
}

impl Clock {
    /// Both clocks, now.
    pub(super) fn start() -> Self {
        Self { wall: SystemTime::now(), uptime: uptime(), started: Instant::now(), is_told: AtomicBool::new(false) }
    }

    /// Returns true while the wall clock has advanced as far as the other one since the start. A change is logged once.
    pub(super) fn is_steady(&self) -> bool {
        let is_steady = self.jump().is_some_and(|jump| jump <= TOLERANCE);
        if self.is_told.swap(!is_steady, Ordering::Relaxed) == is_steady {
            if is_steady {
                tracing::info!("the machine's clock is steady again; what is too old is deleted again");
            } else {
                tracing::warn!(
                    "the machine's clock was set while the server was running; nothing is deleted for its age until the clock is \
                     back, or until the server is restarted with the right time"
                );
            }
        }
        is_steady
    }

    /// Difference of the two clocks since the start; `None` where one cannot be read.
    fn jump(&self) -> Option<Duration> {
        let elapsed = match self.uptime {
            Some(before) => uptime()?.checked_sub(before)?,
            None => self.started.elapsed(),
        };
        let expected = self.wall.checked_add(elapsed)?;
        let now = SystemTime::now();
        Some(now.duration_since(expected).unwrap_or_else(|earlier| earlier.duration()))
    }
}

/// Time since the machine was started, while it slept included: an [`Instant`] stands still meanwhile.
#[cfg(target_os = "linux")]
fn uptime() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/uptime").ok()?;
    Duration::try_from_secs_f64(text.split_whitespace().next()?.parse().ok()?).ok()
}

#[cfg(not(target_os = "linux"))]
fn uptime() -> Option<Duration> {
    None
}
