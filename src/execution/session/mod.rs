//! A session: one run of one program on one cell, from connecting to its record. It holds the order of things (state machine), the
//! conditions of motion, the right to move and the stop; it decides nothing about where to go.
//!
//! Begun by [`simulate()`], [`dry_run()`] or [`live()`], each of which needs a tokio runtime and answers at once with a [`RunHandle`].
//!
//! Every point of a move is a stop, of moves that pass points without stopping too: such a run takes longer than planned.
//!
//! No part of this is safety-rated. A stop from here is an operational stop of the kind of IEC 60204-1 category 2; emergency stops,
//! guards and the protection of people are the cell's own.

mod cause;
mod dry_run;
mod gate;
mod handle;
mod lease;
mod live;
mod machine;
mod runner;
mod state;
mod steps;
mod stop;
pub mod streamer;
mod watcher;
mod way;

use std::sync::Arc;
use std::time::Duration;

pub use cause::{DeviceRole, PauseCause, RunReason, StopCause};
pub use gate::{Hashes, OVERRIDES, Objection, RunJob, Safeguards, Workspace};
pub use handle::{Authority, CommandError, RunHandle};
pub use lease::{Fence, Lease, LeaseError, Leases, MAX_TTL, MIN_TTL};
pub use live::LiveEvent;
pub use machine::{
    Drive, Identities, Joined, MachineError, MachineState, ObservedJoined, ObservedPair, Pair, StateAnswers, StopAnswers, Watch,
};
pub use state::{RunEvent, RunState, RunStatus};

use super::device::Trigger;
use super::located::Relocate;
use super::twin::{Twin, TwinTrigger};
use crate::execution::audit::AuditLog;
use runner::Runner;

/// Watchdog of the devices of a simulated run.
const TWIN_WATCHDOG: Duration = Duration::from_secs(60);

/// Modes of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// A run on the kinematic twin.
    Simulate,
    /// A run on real devices, which are read and not moved.
    DryRun,
    /// A run on real devices.
    Live,
}

impl Mode {
    /// Name in interfaces.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Simulate => "simulate",
            Self::DryRun => "dry_run",
            Self::Live => "live",
        }
    }
}

/// Options of a run.
#[derive(Clone)]
pub struct RunOptions {
    /// Name of the run; captures carry it.
    pub run: String,
    /// Share of the program's speed, within [`OVERRIDES`].
    pub speed_override: f64,
    /// Pause after every step.
    pub single_step: bool,
    /// Step to begin with, from 0; the devices have to stand on its way.
    pub from_step: usize,
    /// Speed of the twin's time, 1 to 100; a simulated run alone has another than 1.
    pub time_factor: f64,
    /// First live run of this program: its speed is capped.
    pub is_first_live: bool,
    /// Limits that it keeps.
    pub safeguards: Safeguards,
    /// Locating scan: before its step, the first capture is taken once more, and the run waits for the part's pose.
    pub relocate: Option<Arc<dyn Relocate>>,
    /// Log of what its devices send and receive, whose end is the run's.
    pub audit: Option<Arc<AuditLog>>,
}

impl Default for RunOptions {
    fn default() -> Self {
        Self {
            run: String::new(),
            speed_override: 1.0,
            single_step: false,
            from_step: 0,
            time_factor: 1.0,
            is_first_live: false,
            safeguards: Safeguards::default(),
            relocate: None,
            audit: None,
        }
    }
}

/// Begins a run on the kinematic twin, which stands where the first step begins. It arms itself and needs no lease.
#[must_use]
pub fn simulate(job: RunJob, options: RunOptions) -> RunHandle {
    let factor = options.time_factor.clamp(1.0, 100.0);
    let here = way::commanded_before(&job.program, options.from_step);
    let machine = Pair { arm: Twin::at(here.joints_rad, factor), table: Twin::at([here.table_rad], factor) };
    // A twin has nothing to guard: a machine that is busy planning may not stop it, nor a state that is late for that.
    let safeguards = Safeguards { watchdog: TWIN_WATCHDOG, state_max_age: TWIN_WATCHDOG, ..options.safeguards };
    let options = RunOptions { time_factor: factor, safeguards, ..options };
    begin(Mode::Simulate, job, machine, TwinTrigger::new(factor), None, options)
}

/// Begins a simulated run on given twins, such as ones that faults are planted in.
#[must_use]
pub fn simulate_with<M, T>(job: RunJob, machine: M, trigger: T, options: RunOptions) -> RunHandle
where
    M: Drive + 'static,
    T: Trigger + 'static,
{
    begin(Mode::Simulate, job, machine, trigger, None, options)
}

/// Begins a run that connects to the devices, reads them and says what would stand against motion. A machine that can only be
/// watched is all it takes.
#[must_use]
pub fn dry_run<M: Watch + 'static>(job: RunJob, machine: M, options: RunOptions) -> RunHandle {
    let live = Arc::new(live::Live::new(job.program.steps.len(), options.speed_override));
    let (handle, control) = handle::handle_and_control(&live, None, (options.speed_override, 1.0), false);
    tokio::spawn(dry_run::read(job, machine, control, live, options));
    handle
}

/// Begins a run on real devices. It waits to be armed with the token of the cell's lease.
#[must_use]
pub fn live<M, T>(job: RunJob, machine: M, trigger: T, authority: Authority, options: RunOptions) -> RunHandle
where
    M: Drive + 'static,
    T: Trigger + 'static,
{
    let options = RunOptions { time_factor: 1.0, ..options };
    begin(Mode::Live, job, machine, trigger, Some(authority), options)
}

fn begin<M, T>(mode: Mode, job: RunJob, machine: M, trigger: T, authority: Option<Authority>, options: RunOptions) -> RunHandle
where
    M: Drive + 'static,
    T: Trigger + 'static,
{
    let capped = if options.is_first_live { options.safeguards.first_run_speed } else { 1.0 };
    let live = Arc::new(live::Live::new(job.program.steps.len(), options.speed_override.min(capped)));
    let (handle, control) = handle::handle_and_control(&live, authority, (options.speed_override, capped), options.single_step);
    tokio::spawn(Runner::new(mode, job, machine, trigger, control, live, options).run());
    handle
}

#[cfg(test)]
mod tests;
