//! Everything that goes on while a run is connected: states are read and held against the conditions of motion, watchdogs are
//! fed, lease, heartbeat and audit are looked at, and live events go out.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::{Instant, sleep};

use super::cause::{DeviceRole, StopCause};
use super::gate::{Safeguards, furthest_axis, unfit};
use super::handle::{Control, Halt};
use super::live::{Live, Measurement};
use super::machine::{Drive, MachineError, MachineState, Watch};
use super::state::{RunEvent, RunStatus};
use super::way::off_segment;
use crate::cell::{Cell, Configuration};
use crate::execution::audit::AuditLog;
use crate::execution::device::{DeviceError, FaultCode};

/// Time between two states.
const POLL: Duration = Duration::from_millis(20);
/// Shortest time between two states where the twin's time runs quickly.
const MIN_POLL: Duration = Duration::from_millis(1);
/// Time between two events of live state.
const TELL: Duration = Duration::from_millis(50);

/// Watches a machine.
pub(super) struct Watcher<M> {
    pub(super) machine: M,
    pub(super) control: Control,
    pub(super) live: Arc<Live>,
    pub(super) cell: Arc<Cell>,
    pub(super) safeguards: Safeguards,
    pub(super) audit: Option<Arc<AuditLog>>,
    pub(super) poll: Duration,
    /// Segment that is under way.
    pub(super) segment: Option<(Configuration, Configuration)>,
    /// Place in which the devices are to stand still, and states in a row in which they do not.
    pub(super) standstill: Option<(Configuration, u32)>,
    pub(super) last: Option<MachineState>,
    fed: Instant,
    told: Option<Instant>,
}

impl<M: Watch> Watcher<M> {
    pub(super) fn new(
        machine: M,
        control: Control,
        live: Arc<Live>,
        cell: Arc<Cell>,
        safeguards: Safeguards,
        audit: Option<Arc<AuditLog>>,
        time_factor: f64,
    ) -> Self {
        // Watchdogs are fed after a state, and four times in their time.
        let poll = POLL.min(safeguards.watchdog / 4).div_f64(time_factor).max(MIN_POLL);
        let (segment, standstill, last, fed, told) = (None, None, None, Instant::now(), None);
        Self { machine, control, live, cell, safeguards, audit, poll, segment, standstill, last, fed, told }
    }

    /// Reads a state and publishes it.
    pub(super) async fn read(&mut self) -> Result<MachineState, Halt> {
        let within = self.safeguards.state_max_age;
        let state = self.control.guard(self.machine.state(within)).await?.map_err(|error| of_machine(error, within))?;
        if state.configuration().axes_rad().iter().any(|angle| !angle.is_finite()) {
            let is_arm = state.arm.positions_rad.iter().any(|angle| !angle.is_finite());
            let device = if is_arm { DeviceRole::Arm } else { DeviceRole::Table };
            let error = DeviceError::Malformed { what: "a position that is not a number".into() };
            return Err(Halt::stop(StopCause::Device { device, error }));
        }
        self.last = Some(state);
        self.tell(&state);
        Ok(state)
    }

    /// Takes the status further, and notes it among the bytes.
    pub(super) fn happen(&self, event: RunEvent) {
        if self.live.happen(event)
            && let Some(audit) = &self.audit
        {
            let RunStatus { state, reason } = self.live.status();
            audit.mark(&format!("{}: {reason}", state.as_str()));
        }
    }

    /// Waits, and hears commands meanwhile.
    pub(super) async fn rest(&mut self, duration: Duration) -> Result<(), Halt> {
        self.control.guard(sleep(duration)).await
    }

    fn tell(&mut self, state: &MachineState) {
        if self.told.is_some_and(|told| told.elapsed() < TELL) {
            return;
        }
        self.told = Some(Instant::now());
        let here = state.configuration();
        let off_path_rad = self.segment.map(|(from, to)| off_segment(&from, &to, &here).1);
        let base_from_scanner = Some(self.cell.base_from_scanner(&here.joints_rad));
        self.live.measured(Measurement { measured: Some(here), base_from_scanner, off_path_rad });
    }
}

impl<M: Drive> Watcher<M> {
    /// Reads a state and holds it, and all else that motion needs, against the conditions.
    pub(super) async fn tick(&mut self) -> Result<MachineState, Halt> {
        let state = self.read().await?;
        let cause = self.objection(&state).or_else(|| self.off_place(&state));
        if let Some(cause) = cause {
            return Err(Halt::stop(self.with_words(cause)));
        }
        self.feed().await?;
        Ok(state)
    }

    /// The work's output, while all else goes on. A state that is being read when the work ends is read to its end: a request
    /// whose answer nobody waits for would have to be sorted out by the driver.
    pub(super) async fn during<T>(&mut self, work: impl Future<Output = T>) -> Result<T, Halt> {
        tokio::pin!(work);
        let mut done = None;
        loop {
            {
                let tick = self.tick();
                tokio::pin!(tick);
                loop {
                    tokio::select! {
                        biased;
                        output = &mut work, if done.is_none() => done = Some(output),
                        ticked = &mut tick => {
                            ticked?;
                            break;
                        }
                    }
                }
            }
            if let Some(output) = done {
                return Ok(output);
            }
            tokio::select! {
                biased;
                output = &mut work => return Ok(output),
                rested = self.rest(self.poll) => rested?,
            }
        }
    }

    fn objection(&self, state: &MachineState) -> Option<StopCause> {
        let run = self.live.status().state;
        let lost = || if run.is_armed() { self.control.lost_client(self.safeguards.heartbeat_timeout) } else { None };
        unfit(state, run, Instant::now(), self.safeguards.state_max_age)
            .or_else(lost)
            .or_else(|| self.audit.as_ref().and_then(|audit| audit.failure()).map(StopCause::Audit))
            .or_else(|| self.off_path(state))
    }

    fn off_path(&self, state: &MachineState) -> Option<StopCause> {
        let (from, to) = self.segment?;
        let (axis, off_rad) = off_segment(&from, &to, &state.configuration());
        let (off_deg, allowed_deg) = (off_rad.to_degrees(), self.safeguards.path_tolerance_rad.to_degrees());
        // An angle that is not a number is not within.
        let is_within = off_deg <= allowed_deg;
        (!is_within).then_some(StopCause::OffPath { axis, off_deg, allowed_deg })
    }

    /// Objection to a motion of a device that is to stand still: it is not ours, and spoils the pose of a capture. As many states in a
    /// row tell it as tell that a target is reached.
    fn off_place(&mut self, state: &MachineState) -> Option<StopCause> {
        let (place, beyond) = self.standstill.as_mut()?;
        let (axis, off_rad) = furthest_axis(place, &state.configuration());
        *beyond = if off_rad <= self.safeguards.position_tolerance_rad { 0 } else { *beyond + 1 };
        let (off_deg, allowed_deg) = (off_rad.to_degrees(), self.safeguards.position_tolerance_rad.to_degrees());
        (*beyond >= self.safeguards.in_position_cycles.max(1)).then_some(StopCause::OffPath { axis, off_deg, allowed_deg })
    }

    /// The work's output, while the devices stand still where they are measured now.
    pub(super) async fn standing_still<T>(&mut self, work: impl Future<Output = T>) -> Result<T, Halt> {
        self.standstill = Some((self.tick().await?.configuration(), 0));
        let output = self.during(work).await;
        self.standstill = None;
        output
    }

    fn with_words(&self, cause: StopCause) -> StopCause {
        if let StopCause::Fault { device, code, .. } = cause {
            let text = self.machine.fault_text(device, FaultCode(code));
            return StopCause::Fault { device, code, text };
        }
        cause
    }

    async fn feed(&mut self) -> Result<(), Halt> {
        let is_due = self.fed.elapsed() * 4 >= self.safeguards.watchdog;
        if !(is_due && self.live.status().state.is_armed()) {
            return Ok(());
        }
        self.fed = Instant::now();
        let within = self.safeguards.state_max_age;
        let fed = self.control.guard(self.machine.keep_alive(within)).await?;
        fed.map_err(|error| of_machine(error, within))
    }
}

/// A machine's error as the end of a run. Silence up to the time that a state may be old is a stale state: a driver that waits less
/// for a reply has the `reply_timeout_ms` of its own section.
pub(super) fn of_machine(MachineError { device, error }: MachineError, max_age: Duration) -> Halt {
    let stale = match &error {
        DeviceError::Silent { waited } if *waited <= max_age => Some((*waited, *waited < max_age)),
        DeviceError::Stale { age } => Some((*age, false)),
        DeviceError::Silent { .. }
        | DeviceError::Unreachable { .. }
        | DeviceError::Unbound { .. }
        | DeviceError::Closed { .. }
        | DeviceError::Malformed { .. }
        | DeviceError::Refused { .. }
        | DeviceError::Fault { .. }
        | DeviceError::NotReady { .. }
        | DeviceError::OtherDevice { .. }
        | DeviceError::WordOrder { .. }
        | DeviceError::Unanswered { .. }
        | DeviceError::Unacknowledged { .. }
        | DeviceError::Unsupported { .. } => None,
    };
    Halt::stop(match stale {
        Some((age, by_reply_timeout)) => StopCause::Stale { device, age, by_reply_timeout },
        None => StopCause::Device { device, error },
    })
}
