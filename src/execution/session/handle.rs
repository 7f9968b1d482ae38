//! Control of a run by any number of clients, and the run's side of it. Stopping overtakes everything else.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{broadcast, mpsc, oneshot, watch};
use tokio::time::{Instant, timeout};

use super::cause::{PauseCause, RunReason, StopCause};
use super::gate::{OVERRIDES, OverrideRefusal};
use super::lease::{Fence, LeaseError, Leases};
use super::live::{Live, LiveEvent};
use super::state::{RunState, RunStatus};
use crate::execution::record::{RunRecord, StepRecord};
use crate::geometry::{Part, Pose, Table};

/// Commands that may wait to be heard.
const COMMANDS: usize = 16;
/// Time between two looks at lease and heartbeat.
const LOOK: Duration = Duration::from_millis(20);

/// Reason why a command is not obeyed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CommandError {
    /// A command that the state does not allow.
    #[error("a run that is {} cannot be told to {command}", state.as_str())]
    NotNow {
        /// State of the run.
        state: RunState,
        /// Command, as a verb.
        command: &'static str,
    },
    /// A command to a run that is being stopped.
    #[error(
        "a run that is being stopped cannot be told to {command}; wait until it has ended, then start a new run from the step \
         that was reached. Cause of the stop: {cause}"
    )]
    Stopping {
        /// Cause of the stop.
        cause: StopCause,
        /// Command, as a verb.
        command: &'static str,
    },
    /// A token that does not hold the cell's lease.
    #[error(transparent)]
    Lease(#[from] LeaseError),
    /// Speed override outside of the range of [`OVERRIDES`].
    #[error("{}", OverrideRefusal(*.0))]
    Override(f64),
}

/// Lease that a live run needs; a simulated one needs none.
#[derive(Clone, Debug)]
pub struct Authority {
    /// Leases of all cells.
    pub leases: Leases,
    /// Name of the cell.
    pub cell: String,
}

#[derive(Debug)]
pub(super) enum Order {
    Arm(Fence),
    Pause,
    Resume(Option<Fence>),
    Step(Option<Fence>),
    Override(Option<Fence>, f64),
    Located(Option<Fence>, Box<Pose<Table, Part>>),
}

impl Order {
    const fn verb(&self) -> &'static str {
        match self {
            Self::Arm(_) => "arm",
            Self::Pause => "pause",
            Self::Resume(_) => "resume",
            Self::Step(_) => "step",
            Self::Override(..) => "change its speed",
            Self::Located(..) => "take the pose of the part",
        }
    }
}

#[derive(Debug)]
struct Command {
    order: Order,
    answer: oneshot::Sender<Result<(), CommandError>>,
}

/// Request to stop.
#[derive(Clone, Debug)]
pub(super) struct StopRequest {
    pub(super) cause: StopCause,
    pub(super) at: Instant,
}

/// A run that was begun. Clones control the same run; when the last is dropped, the run stops.
#[derive(Clone, Debug)]
pub struct RunHandle {
    commands: mpsc::Sender<Command>,
    stop: watch::Sender<Option<StopRequest>>,
    live: Arc<Live>,
    record: watch::Receiver<Option<Arc<RunRecord>>>,
    heartbeat: Arc<Mutex<Instant>>,
    authority: Option<Authority>,
}

impl RunHandle {
    /// Status now.
    #[must_use]
    pub fn status(&self) -> RunStatus {
        self.live.status()
    }

    /// Follows the status.
    #[must_use]
    pub fn watch_status(&self) -> watch::Receiver<RunStatus> {
        self.live.watch_status()
    }

    /// Speed override in force: a program's first live run is capped.
    #[must_use]
    pub fn speed_override(&self) -> f64 {
        self.live.speed_override()
    }

    /// Latest event.
    #[must_use]
    pub fn latest(&self) -> Option<LiveEvent> {
        self.live.latest()
    }

    /// Events after a number, as far as they are kept, and a receiver of all that follow them; none is lost between the two.
    #[must_use]
    pub fn events_after(&self, id: u64) -> (Vec<LiveEvent>, broadcast::Receiver<LiveEvent>) {
        self.live.events_after(id)
    }

    /// Records of the steps carried out so far, from the `first` on.
    #[must_use]
    pub fn steps_from(&self, first: usize) -> Vec<StepRecord> {
        self.live.steps_from(first)
    }

    /// Gives a run that is ready the right to move.
    ///
    /// # Errors
    /// [`CommandError`].
    pub async fn arm(&self, token: Fence) -> Result<(), CommandError> {
        self.order(Order::Arm(token)).await
    }

    /// Brings a running run to rest, until it is resumed; one that is about to go on rests on. Needs no token.
    ///
    /// # Errors
    /// [`CommandError::NotNow`].
    pub async fn pause(&self) -> Result<(), CommandError> {
        self.order(Order::Pause).await
    }

    /// Takes an armed or paused run on; no steps one by one any more. A live run needs its token.
    ///
    /// # Errors
    /// [`CommandError`].
    pub async fn resume(&self, token: Option<Fence>) -> Result<(), CommandError> {
        self.order(Order::Resume(token)).await
    }

    /// Takes an armed or paused run one step on. A live run needs its token.
    ///
    /// # Errors
    /// [`CommandError`].
    pub async fn step(&self, token: Option<Fence>) -> Result<(), CommandError> {
        self.order(Order::Step(token)).await
    }

    /// Scales the speed of targets that go out from now on. A live run needs its token.
    ///
    /// # Errors
    /// [`CommandError`].
    pub async fn set_override(&self, token: Option<Fence>, value: f64) -> Result<(), CommandError> {
        self.order(Order::Override(token, value)).await
    }

    /// Tells a run that waits for it where the part lies. A live run needs its token.
    ///
    /// # Errors
    /// [`CommandError`].
    pub async fn located(&self, token: Option<Fence>, table_from_part: Pose<Table, Part>) -> Result<(), CommandError> {
        self.order(Order::Located(token, Box::new(table_from_part))).await
    }

    /// Takes a heartbeat of the client.
    ///
    /// # Errors
    /// [`CommandError::Lease`].
    pub fn heartbeat(&self, token: Option<Fence>) -> Result<(), CommandError> {
        self.authority.as_ref().map_or(Ok(()), |authority| authority.check(token))?;
        *self.heartbeat.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
        Ok(())
    }

    /// Stops the run, whatever it does; the first cause counts. Needs no token. [`RunHandle::ended`] says how it went.
    pub fn stop(&self, cause: StopCause) {
        request(&self.stop, cause);
    }

    /// Waits for the end of the run, without a handle: it does not keep the run going.
    pub fn end(&self) -> impl Future<Output = ()> + Send + use<> {
        let mut record = self.record.clone();
        async move { drop(record.wait_for(Option::is_some).await) }
    }

    /// Waits for the end; the record tells all.
    pub async fn ended(&self) -> Arc<RunRecord> {
        let mut record = self.record.clone();
        loop {
            if let Some(record) = record.borrow_and_update().clone() {
                return record;
            }
            if record.changed().await.is_err() {
                return Arc::new(RunRecord::lost(self.status()));
            }
        }
    }

    /// The record, once the run has ended.
    #[must_use]
    pub fn record(&self) -> Option<Arc<RunRecord>> {
        self.record.borrow().clone()
    }

    async fn order(&self, order: Order) -> Result<(), CommandError> {
        let command = order.verb();
        let refused = || match self.status() {
            RunStatus { reason: RunReason::Stopping(Some(cause)), .. } => CommandError::Stopping { cause, command },
            RunStatus { state, .. } => CommandError::NotNow { state, command },
        };
        if self.status().state.is_final() {
            return Err(refused());
        }
        let (answer, answered) = oneshot::channel();
        self.commands.send(Command { order, answer }).await.map_err(|_| refused())?;
        // The run may be stopped, or end, before it hears the order.
        answered.await.map_err(|_| refused())?
    }
}

impl Authority {
    fn check(&self, token: Option<Fence>) -> Result<(), CommandError> {
        let token = token.ok_or_else(|| LeaseError::NoToken { cell: self.cell.clone() })?;
        Ok(self.leases.check(&self.cell, token)?)
    }
}

/// Reason why what was under way does not go on.
#[derive(Clone, Debug)]
pub(super) enum Halt {
    Stop(StopRequest),
    Pause(PauseCause),
}

impl Halt {
    pub(super) fn stop(cause: StopCause) -> Self {
        Self::Stop(StopRequest { cause, at: Instant::now() })
    }
}

/// The run's side of its handles.
#[derive(Debug)]
pub(super) struct Control {
    commands: mpsc::Receiver<Command>,
    stop: watch::Receiver<Option<StopRequest>>,
    record: watch::Sender<Option<Arc<RunRecord>>>,
    heartbeat: Arc<Mutex<Instant>>,
    authority: Option<Authority>,
    live: Arc<Live>,
    /// Token that the run was armed with.
    token: Option<Fence>,
    speed_override: f64,
    /// The most that the override may be.
    speed_cap: f64,
    pub(super) single_step: bool,
    pub(super) go_on: bool,
    /// True from when a paused run is told to go on until it moves or comes to rest again: it takes the right to move meanwhile.
    pub(super) leaves_pause: bool,
    /// True once a pause was asked for in that time.
    pub(super) pauses_again: bool,
    pub(super) located: Option<Pose<Table, Part>>,
}

fn request(stop: &watch::Sender<Option<StopRequest>>, cause: StopCause) {
    stop.send_if_modified(|request| {
        let is_first = request.is_none();
        if is_first {
            *request = Some(StopRequest { cause, at: Instant::now() });
        }
        is_first
    });
}

/// Both sides of a new run.
pub(super) fn handle_and_control(
    live: &Arc<Live>,
    authority: Option<Authority>,
    (speed_override, speed_cap): (f64, f64),
    single_step: bool,
) -> (RunHandle, Control) {
    let (commands, orders) = mpsc::channel(COMMANDS);
    let (stop, stopped) = watch::channel(None);
    let (ended, record) = watch::channel(None);
    let heartbeat = Arc::new(Mutex::new(Instant::now()));
    let handle = RunHandle {
        commands,
        stop,
        live: Arc::clone(live),
        record,
        heartbeat: Arc::clone(&heartbeat),
        authority: authority.clone(),
    };
    let control = Control {
        commands: orders,
        stop: stopped,
        record: ended,
        heartbeat,
        authority,
        live: Arc::clone(live),
        token: None,
        speed_override,
        speed_cap,
        single_step,
        go_on: false,
        leaves_pause: false,
        pauses_again: false,
        located: None,
    };
    (handle, control)
}

impl Control {
    /// The work's output, unless the run is stopped or paused first; the work is then dropped.
    pub(super) async fn guard<T>(&mut self, work: impl Future<Output = T>) -> Result<T, Halt> {
        tokio::pin!(work);
        loop {
            tokio::select! {
                biased;
                request = stop_requested(&mut self.stop) => return Err(Halt::Stop(request)),
                command = self.commands.recv() => match command {
                    None => return Err(Halt::stop(StopCause::ServerGone)),
                    Some(command) => self.take(command)?,
                },
                output = &mut work => return Ok(output),
            }
        }
    }

    /// Refuses the commands that wait to be heard, and those to come, at once: a run that is being stopped hears none.
    pub(super) fn refuse_commands(&mut self) {
        self.commands.close();
        while self.commands.try_recv().is_ok() {}
    }

    /// Waits for a request to stop.
    pub(super) async fn stop_requested(&mut self) -> StopRequest {
        stop_requested(&mut self.stop).await
    }

    /// [`Control::guard`] of work that takes or uses the right to move: lease and heartbeat are looked at all the while, for
    /// on a slow network the work outlasts them.
    pub(super) async fn guard_motion<T>(
        &mut self,
        heartbeat_timeout: Duration,
        work: impl Future<Output = T>,
    ) -> Result<T, Halt> {
        tokio::pin!(work);
        loop {
            if let Some(cause) = self.lost_client(heartbeat_timeout) {
                return Err(Halt::stop(cause));
            }
            if let Ok(output) = self.guard(timeout(LOOK, &mut work)).await? {
                return Ok(output);
            }
        }
    }

    /// Objection of lease or heartbeat to going on, once armed.
    pub(super) fn lost_client(&self, timeout: Duration) -> Option<StopCause> {
        let (authority, token) = (self.authority.as_ref()?, self.token?);
        let after = self.heartbeat.lock().unwrap_or_else(PoisonError::into_inner).elapsed();
        match authority.leases.check(&authority.cell, token) {
            Err(error) => Some(StopCause::LeaseLost(error)),
            Ok(()) => (after > timeout).then_some(StopCause::HeartbeatLost { after }),
        }
    }

    pub(super) fn needs_arm(&self) -> bool {
        self.authority.is_some()
    }

    pub(super) fn is_armed_by_client(&self) -> bool {
        self.token.is_some()
    }

    /// Publishes the record.
    pub(super) fn end(&self, record: RunRecord) {
        self.record.send_replace(Some(Arc::new(record)));
    }

    fn take(&mut self, command: Command) -> Result<(), Halt> {
        let Command { order, answer } = command;
        let verdict = self.may(&order);
        let is_allowed = verdict.is_ok();
        // Whoever asked may be gone.
        let _ = answer.send(verdict);
        if is_allowed { self.obey(order) } else { Ok(()) }
    }

    fn may(&self, order: &Order) -> Result<(), CommandError> {
        let status = self.live.status();
        let is_locating = status.reason == RunReason::Paused(PauseCause::Locating);
        let is_between = matches!(status.state, RunState::Armed | RunState::Paused);
        let (fits, token) = match order {
            Order::Arm(token) => (status.state == RunState::Ready && self.needs_arm() && self.token.is_none(), Some(*token)),
            Order::Pause => return self.fits(status.state == RunState::Running || self.is_to_go_on(status.state), order),
            Order::Resume(token) | Order::Step(token) => (is_between && !is_locating, *token),
            Order::Override(token, value) if OVERRIDES.contains(value) => (!status.state.is_final(), *token),
            Order::Override(_, value) => return Err(CommandError::Override(*value)),
            // A pose is taken once: the program is made for it meanwhile.
            Order::Located(token, _) => (is_locating && !self.leaves_pause, *token),
        };
        self.fits(fits, order)?;
        let Some(authority) = &self.authority else { return Ok(()) };
        authority.check(token)?;
        // A newer lease of the same cell does not take a run over.
        match (self.token, token) {
            (Some(own), Some(shown)) if own != shown => {
                Err(LeaseError::WrongToken { cell: authority.cell.clone(), token: shown }.into())
            }
            (Some(_) | None, Some(_) | None) => Ok(()),
        }
    }

    /// Returns true for a run that is paused and was told to go on: it does not move yet, and would without a further word.
    fn is_to_go_on(&self, state: RunState) -> bool {
        state == RunState::Paused && (self.go_on || self.located.is_some() || self.leaves_pause)
    }

    /// Speed override, capped.
    pub(super) fn speed_in_force(&self) -> f64 {
        self.speed_override.min(self.speed_cap)
    }

    fn fits(&self, fits: bool, order: &Order) -> Result<(), CommandError> {
        let refused = || CommandError::NotNow { state: self.live.status().state, command: order.verb() };
        if fits { Ok(()) } else { Err(refused()) }
    }

    fn obey(&mut self, order: Order) -> Result<(), Halt> {
        match order {
            Order::Arm(token) => {
                self.token = Some(token);
                *self.heartbeat.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
            }
            // It rests, and is kept from going on.
            Order::Pause if self.live.status().state == RunState::Paused => (self.go_on, self.pauses_again) = (false, true),
            Order::Pause => return Err(Halt::Pause(PauseCause::Client)),
            Order::Resume(_) => (self.single_step, self.go_on, self.pauses_again) = (false, true, false),
            Order::Step(_) => (self.single_step, self.go_on, self.pauses_again) = (true, true, false),
            Order::Override(_, value) => {
                self.speed_override = value;
                self.live.at_override(self.speed_in_force());
            }
            Order::Located(_, table_from_part) => self.located = Some(*table_from_part),
        }
        Ok(())
    }
}

/// Waits for a request to stop.
async fn stop_requested(stop: &mut watch::Receiver<Option<StopRequest>>) -> StopRequest {
    let request = stop.wait_for(Option::is_some).await.ok().and_then(|request| request.clone());
    request.unwrap_or_else(|| StopRequest { cause: StopCause::ServerGone, at: Instant::now() })
}

#[cfg(test)]
mod tests;
