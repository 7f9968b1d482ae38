//! Arm and table as one machine of seven axes, whether they have a controller each or share one. What can only be read
//! ([`Watch`]) and what can be moved ([`Drive`]) are two traits: a dry run is written for the first alone.

use std::time::Duration;

use tokio::sync::Notify;
use tokio::time::{Instant, timeout, timeout_at};

use super::cause::DeviceRole;
use super::runner::unless_panicking;
use super::streamer::Jitter;
use crate::cell::Configuration;
use crate::execution::device::{
    ArmState, Condition, DeviceError, DeviceState, FaultCode, Identity, MotionDevice, Observed, TableState, Target,
};

/// Time between two feeds of a device that waits for its partner: a fifth of the shortest watchdog that a cell file may have.
const FEED: Duration = Duration::from_millis(10);

/// States of both, read at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MachineState {
    /// The arm's.
    pub arm: ArmState,
    /// The table's.
    pub table: TableState,
}

impl MachineState {
    /// Measured configuration.
    #[must_use]
    pub fn configuration(&self) -> Configuration {
        Configuration { joints_rad: self.arm.positions_rad, table_rad: self.table.positions_rad[0] }
    }

    /// Conditions, each with its device.
    #[must_use]
    pub fn conditions(&self) -> [(DeviceRole, Condition); 2] {
        [(DeviceRole::Arm, self.arm.condition), (DeviceRole::Table, self.table.condition)]
    }

    /// Parts of a state of seven axes.
    #[must_use]
    pub fn of_seven(state: &DeviceState<7>) -> Self {
        let [j1, j2, j3, j4, j5, j6, table] = state.positions_rad;
        let (at, condition) = (state.at, state.condition);
        Self {
            arm: ArmState { at, positions_rad: [j1, j2, j3, j4, j5, j6], condition },
            table: TableState { at, positions_rad: [table], condition },
        }
    }
}

/// Error of one of the devices.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{device}: {error}")]
pub struct MachineError {
    /// Device.
    pub device: DeviceRole,
    /// Error of the device.
    pub error: DeviceError,
}

/// Identities of both.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identities {
    /// The arm's.
    pub arm: Identity,
    /// The table's; equal to the arm's where one controller has both.
    pub table: Identity,
}

/// Answers of both to a stop, the times at which they were read; `None` of one that was not asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StopAnswers {
    /// The arm's.
    pub arm: Option<Result<Instant, DeviceError>>,
    /// The table's.
    pub table: Option<Result<Instant, DeviceError>>,
    /// Times at which requests went out first, the arm's first, whatever was answered.
    pub sent_at: [Option<Instant>; 2],
}

/// Answers of both to being read.
#[derive(Clone, Debug, PartialEq)]
pub struct StateAnswers {
    /// The arm's.
    pub arm: Result<ArmState, DeviceError>,
    /// The table's.
    pub table: Result<TableState, DeviceError>,
}

/// A machine that can be read.
pub trait Watch: Send {
    /// Connects to both, each within that time.
    fn connect(&mut self, within: Duration) -> impl Future<Output = Result<Identities, MachineError>> + Send;

    /// Reads fresh states of both, each within that time and for itself.
    fn states(&mut self, within: Duration) -> impl Future<Output = StateAnswers> + Send;

    /// Reads fresh states of both, each within that time.
    fn state(&mut self, within: Duration) -> impl Future<Output = Result<MachineState, MachineError>> + Send {
        async move {
            let StateAnswers { arm, table } = self.states(within).await;
            both(arm, table).map(|(arm, table)| MachineState { arm, table })
        }
    }
}

/// A machine that can be moved.
pub trait Drive: Watch {
    /// Takes the right to move both, each within that time; the first to have it is kept alive until the other does.
    fn arm(&mut self, watchdog: Duration, within: Duration) -> impl Future<Output = Result<(), MachineError>> + Send;

    /// Starts those that the target moves, each within that time; the first to accept it is kept alive until the other has.
    fn start(&mut self, target: &Target<7>, within: Duration) -> impl Future<Output = Result<(), MachineError>> + Send;

    /// Feeds the watchdogs, each within that time.
    fn keep_alive(&mut self, within: Duration) -> impl Future<Output = Result<(), MachineError>> + Send;

    /// Reads fresh states of both as [`Watch::states`] does, and feeds the watchdogs of those that answer; the first to have answered is
    /// kept alive until the other has.
    fn states_fed(&mut self, within: Duration) -> impl Future<Output = StateAnswers> + Send;

    /// Asks those to stop that `asks` is true of, the arm's first, each within that time; one that was not asked, and the first to
    /// have answered, is kept alive until the other has. A driver that panics is told as an error of its device alone.
    fn stop(&mut self, asks: [bool; 2], within: Duration) -> impl Future<Output = StopAnswers> + Send;

    /// Gives the right to move back.
    fn release(&mut self) -> impl Future<Output = Result<(), MachineError>> + Send;

    /// Words of a fault.
    fn fault_text(&self, device: DeviceRole, fault: FaultCode) -> Option<&'static str>;

    /// Jitter of what is streamed, the arm's first.
    fn jitter(&self) -> Option<Jitter>;
}

/// An arm and a table with a controller each.
#[derive(Debug)]
pub struct Pair<A, T> {
    /// The arm.
    pub arm: A,
    /// The table.
    pub table: T,
}

/// An arm whose controller turns the table as well.
#[derive(Debug)]
pub struct Joined<D>(pub D);

impl<A: MotionDevice<6>, T: MotionDevice<1>> Watch for Pair<A, T> {
    async fn connect(&mut self, within: Duration) -> Result<Identities, MachineError> {
        let (arm, table) = tokio::join!(in_time(within, self.arm.connect()), in_time(within, self.table.connect()));
        both(arm, table).map(|(arm, table)| Identities { arm, table })
    }

    async fn states(&mut self, within: Duration) -> StateAnswers {
        let (arm, table) = tokio::join!(in_time(within, self.arm.state()), in_time(within, self.table.state()));
        StateAnswers { arm, table }
    }
}

impl<A: MotionDevice<6>, T: MotionDevice<1>> Drive for Pair<A, T> {
    async fn arm(&mut self, watchdog: Duration, within: Duration) -> Result<(), MachineError> {
        let (arm_is_done, table_is_done, deadline) = (Notify::new(), Notify::new(), Instant::now() + within);
        let arm = async {
            let armed = in_time(within, self.arm.arm(watchdog)).await;
            let _ = timeout_at(deadline, await_partner(&mut self.arm, &arm_is_done, &table_is_done)).await;
            armed
        };
        let table = async {
            let armed = in_time(within, self.table.arm(watchdog)).await;
            let _ = timeout_at(deadline, await_partner(&mut self.table, &table_is_done, &arm_is_done)).await;
            armed
        };
        let (arm, table) = tokio::join!(arm, table);
        both(arm, table).map(|_| ())
    }

    async fn start(&mut self, target: &Target<7>, within: Duration) -> Result<(), MachineError> {
        let (arm, table) = halves(target);
        let (arm_is_done, table_is_done, deadline) = (Notify::new(), Notify::new(), Instant::now() + within);
        let start_arm = async {
            let started = if is_motion(&arm) { in_time(within, self.arm.start(&arm)).await } else { Ok(()) };
            let _ = timeout_at(deadline, await_partner(&mut self.arm, &arm_is_done, &table_is_done)).await;
            started
        };
        let start_table = async {
            let started = if is_motion(&table) { in_time(within, self.table.start(&table)).await } else { Ok(()) };
            let _ = timeout_at(deadline, await_partner(&mut self.table, &table_is_done, &arm_is_done)).await;
            started
        };
        let (arm, table) = tokio::join!(start_arm, start_table);
        both(arm, table).map(|_| ())
    }

    async fn keep_alive(&mut self, within: Duration) -> Result<(), MachineError> {
        let (arm, table) = tokio::join!(in_time(within, self.arm.keep_alive()), in_time(within, self.table.keep_alive()));
        both(arm, table).map(|_| ())
    }

    async fn states_fed(&mut self, within: Duration) -> StateAnswers {
        let (arm_is_done, table_is_done) = (Notify::new(), Notify::new());
        let (arm, table) = tokio::join!(
            read_and_feed(&mut self.arm, within, &arm_is_done, &table_is_done),
            read_and_feed(&mut self.table, within, &table_is_done, &arm_is_done),
        );
        StateAnswers { arm, table }
    }

    async fn stop(&mut self, [asks_arm, asks_table]: [bool; 2], within: Duration) -> StopAnswers {
        let (arm_is_done, table_is_done) = (Notify::new(), Notify::new());
        let mut sent_at = [None, None];
        let [arm_at, table_at] = &mut sent_at;
        let (arm, table) = tokio::join!(
            unless_panicking(stop_and_feed(&mut self.arm, asks_arm.then_some(arm_at), within, &arm_is_done, &table_is_done)),
            unless_panicking(stop_and_feed(
                &mut self.table,
                asks_table.then_some(table_at),
                within,
                &table_is_done,
                &arm_is_done
            )),
        );
        StopAnswers { arm: arm.unwrap_or_else(panicked), table: table.unwrap_or_else(panicked), sent_at }
    }

    async fn release(&mut self) -> Result<(), MachineError> {
        let (arm, table) = tokio::join!(self.arm.release(), self.table.release());
        both(arm, table).map(|_| ())
    }

    fn fault_text(&self, device: DeviceRole, fault: FaultCode) -> Option<&'static str> {
        match device {
            DeviceRole::Arm => self.arm.fault_text(fault),
            DeviceRole::Table => self.table.fault_text(fault),
            DeviceRole::Trigger => None,
        }
    }

    fn jitter(&self) -> Option<Jitter> {
        self.arm.jitter().or_else(|| self.table.jitter())
    }
}

impl<D: MotionDevice<7>> Watch for Joined<D> {
    async fn connect(&mut self, within: Duration) -> Result<Identities, MachineError> {
        let identity = in_time(within, self.0.connect()).await.map_err(of_arm)?;
        Ok(Identities { arm: identity.clone(), table: identity })
    }

    async fn states(&mut self, within: Duration) -> StateAnswers {
        let state = in_time(within, self.0.state()).await.map(|state| MachineState::of_seven(&state));
        StateAnswers { arm: state.clone().map(|state| state.arm), table: state.map(|state| state.table) }
    }
}

impl<D: MotionDevice<7>> Drive for Joined<D> {
    async fn arm(&mut self, watchdog: Duration, within: Duration) -> Result<(), MachineError> {
        in_time(within, self.0.arm(watchdog)).await.map_err(of_arm)
    }

    async fn start(&mut self, target: &Target<7>, within: Duration) -> Result<(), MachineError> {
        in_time(within, self.0.start(target)).await.map_err(of_arm)
    }

    async fn keep_alive(&mut self, within: Duration) -> Result<(), MachineError> {
        in_time(within, self.0.keep_alive()).await.map_err(of_arm)
    }

    async fn states_fed(&mut self, within: Duration) -> StateAnswers {
        let states = self.states(within).await;
        if states.arm.is_ok() {
            // What is not armed has nothing to feed.
            let _ = timeout(within, self.0.keep_alive()).await;
        }
        states
    }

    async fn stop(&mut self, asks: [bool; 2], within: Duration) -> StopAnswers {
        if asks == [false; 2] {
            return StopAnswers { arm: None, table: None, sent_at: [None; 2] };
        }
        let mut sent_at = None;
        let answer = unless_panicking(in_time(within, self.0.stop(&mut sent_at))).await.map_or_else(panicked, Some);
        StopAnswers { arm: answer.clone(), table: answer, sent_at: [sent_at; 2] }
    }

    async fn release(&mut self) -> Result<(), MachineError> {
        self.0.release().await.map_err(of_arm)
    }

    fn fault_text(&self, _device: DeviceRole, fault: FaultCode) -> Option<&'static str> {
        self.0.fault_text(fault)
    }

    fn jitter(&self) -> Option<Jitter> {
        self.0.jitter()
    }
}

/// An arm and a table that can only be read.
#[derive(Debug)]
pub struct ObservedPair<A, T> {
    arm: Observed<A>,
    table: Observed<T>,
}

impl<A, T> ObservedPair<A, T> {
    /// Takes the way to move from both.
    pub const fn new(arm: A, table: T) -> Self {
        Self { arm: Observed::new(arm), table: Observed::new(table) }
    }
}

/// An arm with the table on its controller that can only be read.
#[derive(Debug)]
pub struct ObservedJoined<D>(Observed<D>);

impl<D> ObservedJoined<D> {
    /// Takes the way to move from it.
    pub const fn new(device: D) -> Self {
        Self(Observed::new(device))
    }
}

impl<A: MotionDevice<6>, T: MotionDevice<1>> Watch for ObservedPair<A, T> {
    async fn connect(&mut self, within: Duration) -> Result<Identities, MachineError> {
        let (arm, table) = tokio::join!(in_time(within, self.arm.connect()), in_time(within, self.table.connect()));
        both(arm, table).map(|(arm, table)| Identities { arm, table })
    }

    async fn states(&mut self, within: Duration) -> StateAnswers {
        let (arm, table) = tokio::join!(in_time(within, self.arm.state()), in_time(within, self.table.state()));
        StateAnswers { arm, table }
    }
}

impl<D: MotionDevice<7>> Watch for ObservedJoined<D> {
    async fn connect(&mut self, within: Duration) -> Result<Identities, MachineError> {
        let identity = in_time(within, self.0.connect()).await.map_err(of_arm)?;
        Ok(Identities { arm: identity.clone(), table: identity })
    }

    async fn states(&mut self, within: Duration) -> StateAnswers {
        let state = in_time(within, self.0.state()).await.map(|state| MachineState::of_seven(&state));
        StateAnswers { arm: state.clone().map(|state| state.arm), table: state.map(|state| state.table) }
    }
}

/// Says that a device is done, and keeps it alive until its partner is. A feed that has begun is waited for: on a serial line its answer
/// would hold up the next request.
async fn await_partner<const N: usize, D: MotionDevice<N>>(device: &mut D, is_done: &Notify, partner_is_done: &Notify) {
    is_done.notify_one();
    while timeout(FEED, partner_is_done.notified()).await.is_err() {
        // What is not armed has nothing to feed; a link that is lost, and a watchdog that lapsed, show in the next tick.
        let _ = device.keep_alive().await;
    }
}

/// Stops a device within that time, if it is to be asked: then there is a place for the time at which the request went out. Keeps it
/// alive until its partner has answered too, which has no longer either.
async fn stop_and_feed<const N: usize, D: MotionDevice<N>>(
    device: &mut D,
    asked: Option<&mut Option<Instant>>,
    within: Duration,
    is_done: &Notify,
    partner_is_done: &Notify,
) -> Option<Result<Instant, DeviceError>> {
    let deadline = Instant::now() + within;
    let stopped = match asked {
        Some(sent_at) => Some(in_time(within, device.stop(sent_at)).await),
        None => None,
    };
    let _ = timeout_at(deadline, await_partner(device, is_done, partner_is_done)).await;
    stopped
}

/// Answer of a device whose driver panicked.
fn panicked((): ()) -> Option<Result<Instant, DeviceError>> {
    let reason = "by a fault of this program's own; please report it".to_owned();
    Some(Err(DeviceError::Closed { reason }))
}

/// Reads a device within that time, feeds it if it answers, and keeps it alive until its partner has answered too.
async fn read_and_feed<const N: usize, D: MotionDevice<N>>(
    device: &mut D,
    within: Duration,
    is_done: &Notify,
    partner_is_done: &Notify,
) -> Result<DeviceState<N>, DeviceError> {
    let deadline = Instant::now() + within;
    let state = in_time(within, device.state()).await;
    let fed = async {
        if state.is_ok() {
            let _ = device.keep_alive().await;
        }
        await_partner(device, is_done, partner_is_done).await;
    };
    let _ = timeout_at(deadline, fed).await;
    state
}

/// The answer, or [`DeviceError::Silent`] where it takes longer.
pub(super) async fn in_time<T>(within: Duration, answer: impl Future<Output = Result<T, DeviceError>>) -> Result<T, DeviceError> {
    timeout(within, answer).await.unwrap_or(Err(DeviceError::Silent { waited: within }))
}

fn of_arm(error: DeviceError) -> MachineError {
    MachineError { device: DeviceRole::Arm, error }
}

fn both<A, T>(arm: Result<A, DeviceError>, table: Result<T, DeviceError>) -> Result<(A, T), MachineError> {
    let of_table = |error| MachineError { device: DeviceRole::Table, error };
    Ok((arm.map_err(of_arm)?, table.map_err(of_table)?))
}

fn halves(target: &Target<7>) -> (Target<6>, Target<1>) {
    let six = |[j1, j2, j3, j4, j5, j6, _]: [f64; 7]| [j1, j2, j3, j4, j5, j6];
    let (sequence, duration) = (target.sequence, target.duration);
    let arm = Target {
        sequence,
        positions_rad: six(target.positions_rad),
        max_speed_rad_s: six(target.max_speed_rad_s),
        max_acceleration_rad_s2: six(target.max_acceleration_rad_s2),
        duration,
    };
    let table = Target {
        sequence,
        positions_rad: [target.positions_rad[6]],
        max_speed_rad_s: [target.max_speed_rad_s[6]],
        max_acceleration_rad_s2: [target.max_acceleration_rad_s2[6]],
        duration,
    };
    (arm, table)
}

fn is_motion<const N: usize>(target: &Target<N>) -> bool {
    target.max_speed_rad_s.iter().any(|speed| *speed > 0.0)
}
