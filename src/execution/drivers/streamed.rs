//! Devices whose controller sets the pace: it reports in every cycle and takes a set point as the answer. A thread of its own with
//! its own runtime answers, so that no other work of the server delays it; the session's calls only leave word for it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{Instant, sleep, timeout};

use super::set_points::SetPoints;
use super::stream::{NOT_ARMED, NOT_FED, not_connected};
use crate::execution::device::{Condition, DeviceError, DeviceState, Identity, MotionDevice, STOP_ATTEMPT, Target};
use crate::execution::session::streamer::Jitter;

/// Longest wait for the first report.
const FIRST_REPORT_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest wait for a further report.
const REPORT_TIMEOUT: Duration = Duration::from_secs(1);
/// Longest wait for the right to move.
const ARM_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest wait for the thread to end: longer than [`CLOSE_TIMEOUT`] and an attempt to connect.
const END_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest time in which the arm is led to rest before the link is closed.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(3);
/// Pause after which the thread looks whether it is still wanted.
const CHECK_INTERVAL: Duration = Duration::from_millis(100);
/// Time for which a stop that the controller does not take is asked for anew: the rest of the attempt is for the last answer.
const STOP_RETRY_TIME: Duration = Duration::from_millis(STOP_ATTEMPT.as_millis() as u64 * 7 / 10);
/// Largest distance of an axis from its set point (following error) at which a move may begin, radians: half a degree.
pub(super) const MAX_FOLLOWING_ERROR_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// A protocol whose controller sets the pace.
pub trait StreamedProtocol<const N: usize>: Clone + Send + 'static {
    /// Open link.
    type Link: StreamedLink<N>;

    /// Opens the link.
    fn open(&self) -> impl Future<Output = Result<(Identity, Self::Link), DeviceError>>;
}

/// An open link to a controller that sets the pace.
pub trait StreamedLink<const N: usize> {
    /// True of a controller that follows the answers whether armed or not: what holds it is the last of them.
    const ALWAYS_FOLLOWS: bool;

    /// Cycle of the controller.
    fn cycle(&self) -> Duration;

    /// Waits for the next report; may be dropped while it waits. What is malformed is reported and skipped.
    fn report(&mut self) -> impl Future<Output = Result<StreamedReport<N>, DeviceError>>;

    /// Takes the right to move; dropped where a stop comes before it is had.
    fn arm(&mut self, watchdog: Duration) -> impl Future<Output = Result<(), DeviceError>>;

    /// Answers the report. [`DeviceError::NotReady`]: it does not follow any more, but reports on and may be armed again; other errors
    /// end the link.
    fn answer(&mut self, step: &StreamStep<N>) -> impl Future<Output = Result<(), DeviceError>>;

    /// Time at which the order to stop of the latest answer went out, of a link that then waits for its acknowledgement.
    fn stop_sent_at(&self) -> Option<Instant> {
        None
    }

    /// Gives the right to move back and closes.
    fn close(self) -> impl Future<Output = ()>;
}

/// Report of a controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamedReport<const N: usize> {
    /// Measured positions, radians.
    pub positions_rad: [f64; N],
    /// Positions that it is commanded to hold before the first answer, radians; those measured where it does not tell. Its servos
    /// stand a little beside, and an answer that has it where it was measured would move it.
    pub held_rad: [f64; N],
    /// Condition, as far as the controller tells it.
    pub condition: Condition,
    /// Reason why it would not follow now, and how to mend it.
    pub hindrance: Option<&'static str>,
    /// True if the answer to the report before came too late, by the controller's own count.
    pub is_behind: bool,
}

/// Answer to a report.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamStep<const N: usize> {
    /// Set point of this cycle, radians.
    pub set_point_rad: [f64; N],
    /// Word that was left since the last cycle.
    pub order: Option<StreamOrder<N>>,
}

/// Word for a controller that leads the way itself; one that follows set points has it in them.
#[derive(Clone, Debug, PartialEq)]
pub enum StreamOrder<const N: usize> {
    /// Go, from where the arm stands by its set points.
    Go {
        /// Goal and speed of the move.
        target: Target<N>,
        /// Positions at its beginning, radians.
        from_rad: [f64; N],
    },
    /// Stop by a ramp.
    Stop,
}

/// A device whose controller sets the pace.
#[derive(Debug)]
pub struct Streamed<const N: usize, P> {
    protocol: P,
    thread: Option<Arc<Shared<N>>>,
}

#[derive(Debug)]
struct Shared<const N: usize> {
    state: Mutex<SharedState<N>>,
    /// Cycles answered so far.
    cycles: watch::Sender<u64>,
}

/// State that the session and the thread share: orders of the one, reports of the other.
#[derive(Debug, Default)]
struct SharedState<const N: usize> {
    identity: Option<Identity>,
    report: Option<(StreamedReport<N>, Instant)>,
    points: Option<SetPoints<N>>,
    order: Option<StreamOrder<N>>,
    /// True from an order to go until the next order to stop is taken.
    is_under_order: bool,
    /// Time between reports, while a way is led.
    jitter: Option<Jitter>,
    /// Watchdog that the thread is to arm with, once.
    to_arm: Option<Duration>,
    armed: Option<Armed>,
    /// True from a commanded stop of what was armed until it is to be armed again: it needs no feeding, and nothing is wrong.
    is_stopped: bool,
    /// Reason why the right to move was lost, since it was armed last.
    disarmed_by: Option<String>,
    arm_outcome: Option<Result<(), DeviceError>>,
    /// Reason why the controller did not take the latest order to stop, which is then asked for anew.
    stop_not_taken: Option<DeviceError>,
    /// Time at which the latest order to stop went out; none where the link had no way to send it.
    stop_sent_at: Option<Instant>,
    failure: Option<DeviceError>,
    /// The latest report that could not be read, while none could since.
    malformed: Option<DeviceError>,
    /// Time from which the link is to close.
    closing_since: Option<Instant>,
    is_over: bool,
}

#[derive(Clone, Copy, Debug)]
struct Armed {
    watchdog: Duration,
    fed_at: Instant,
}

impl<const N: usize, P: StreamedProtocol<N>> Streamed<N, P> {
    /// A device that is not connected yet.
    pub fn new(protocol: P) -> Self {
        Self { protocol, thread: None }
    }

    fn shared(&self) -> Result<&Arc<Shared<N>>, DeviceError> {
        self.thread.as_ref().ok_or_else(not_connected)
    }
}

impl<const N: usize, P> Drop for Streamed<N, P> {
    fn drop(&mut self) {
        if let Some(shared) = &self.thread {
            shared.close();
        }
    }
}

impl<const N: usize, P: StreamedProtocol<N> + Sync> MotionDevice<N> for Streamed<N, P> {
    async fn connect(&mut self) -> Result<Identity, DeviceError> {
        if let Some(before) = self.thread.take() {
            before.close();
            before.wait(END_TIMEOUT, |state| state.is_over.then_some(Ok(()))).await?;
        }
        let shared = Arc::new(Shared { state: Mutex::new(SharedState::default()), cycles: watch::Sender::new(0) });
        self.thread = Some(shared.clone());
        let protocol = self.protocol.clone();
        std::thread::Builder::new().name("streaming".to_owned()).spawn(move || run_link(&protocol, &shared)).map_err(
            |error| DeviceError::NotReady { reason: format!("no thread for its cycle ({error}); free some resources") },
        )?;
        let shared = self.shared()?;
        shared.wait(FIRST_REPORT_TIMEOUT, |state| state.report.and(state.identity.clone()).map(Ok)).await
    }

    async fn state(&mut self) -> Result<DeviceState<N>, DeviceError> {
        let shared = self.shared()?;
        let asked_at = Instant::now();
        shared.wait(REPORT_TIMEOUT, |state| state.report.filter(|(_, at)| *at >= asked_at).map(|_| Ok(()))).await?;
        let state = shared.lock();
        let (report, at) = state.report.ok_or_else(not_connected)?;
        let moving = report.condition.moving || state.points.as_ref().is_some_and(SetPoints::is_moving);
        let condition = Condition { moving, in_position: !moving, ..report.condition };
        Ok(DeviceState { at, positions_rad: report.positions_rad, condition })
    }

    async fn arm(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
        let shared = self.shared()?;
        {
            let mut state = shared.lock();
            let (report, _) = state.report.ok_or_else(not_connected)?;
            if let Some(reason) = report.hindrance {
                return Err(DeviceError::NotReady { reason: reason.to_owned() });
            }
            (state.armed, state.is_stopped, state.disarmed_by, state.stop_not_taken) = (None, false, None, None);
            (state.arm_outcome, state.to_arm) = (None, Some(watchdog));
        }
        shared.wait(ARM_TIMEOUT, |state| state.points.as_ref().and(state.arm_outcome.clone())).await
    }

    async fn start(&mut self, target: &Target<N>) -> Result<(), DeviceError> {
        let shared = self.shared()?;
        shared.lock().set_out(target)?;
        shared.next_cycle().await?;
        // The controller may not have taken it.
        shared.lock().fail_if_not_armed()
    }

    async fn keep_alive(&mut self) -> Result<(), DeviceError> {
        let mut state = self.shared()?.lock();
        state.fail_if_failed()?;
        if let Some(armed) = &mut state.armed {
            armed.fed_at = Instant::now();
        }
        if state.is_stopped { Ok(()) } else { state.fail_if_not_armed() }
    }

    async fn stop(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        let shared = self.shared()?;
        let asked_at = Instant::now();
        loop {
            {
                let mut state = shared.lock();
                state.ramp_down();
                (state.to_arm, state.stop_not_taken, state.stop_sent_at) = (None, None, None);
                // A watchdog that lapsed before stays an error.
                state.is_stopped |= state.armed.take().is_some();
            }
            shared.next_cycle().await?;
            let answered_at = Instant::now();
            *sent_at = sent_at.or(shared.lock().stop_sent_at);
            // The controller reports on: it has the answer, or did not take it.
            shared.next_cycle().await?;
            *sent_at = sent_at.or(shared.lock().stop_sent_at);
            let not_taken = shared.lock().stop_not_taken.clone();
            match not_taken {
                None => {
                    // Of an arm that stands, every answer says that it is to.
                    sent_at.get_or_insert(answered_at);
                    return Ok(Instant::now());
                }
                Some(error) if asked_at.elapsed() >= STOP_RETRY_TIME => return Err(error),
                // Its own watchdog may stop it in the meantime.
                Some(_) => {}
            }
        }
    }

    fn jitter(&self) -> Option<Jitter> {
        self.thread.as_ref()?.lock().jitter.clone()
    }

    async fn release(&mut self) -> Result<(), DeviceError> {
        let Some(shared) = self.thread.take() else { return Ok(()) };
        shared.close();
        shared.wait(END_TIMEOUT, |state| state.is_over.then_some(Ok(()))).await
    }
}

impl<const N: usize> Shared<N> {
    fn lock(&self) -> MutexGuard<'_, SharedState<N>> {
        // A holder that panicked left whole values.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn close(&self) {
        let mut state = self.lock();
        state.ramp_down();
        (state.armed, state.to_arm) = (None, None);
        state.closing_since.get_or_insert_with(Instant::now);
    }

    /// Waits until `found` finds something, looking after every cycle.
    async fn wait<T>(
        &self,
        patience: Duration,
        found: impl Fn(&SharedState<N>) -> Option<Result<T, DeviceError>>,
    ) -> Result<T, DeviceError> {
        let mut cycles = self.cycles.subscribe();
        let search = async {
            loop {
                if let Some(outcome) = found(&self.lock()) {
                    return outcome;
                }
                self.lock().fail_if_failed()?;
                if cycles.changed().await.is_err() {
                    return Err(not_connected());
                }
            }
        };
        let silent = || self.lock().malformed.clone().unwrap_or(DeviceError::Silent { waited: patience });
        timeout(patience, search).await.unwrap_or_else(|_| Err(silent()))
    }

    /// Waits until it is no longer to be armed.
    async fn arming_given_up(&self) {
        while self.lock().to_arm.is_some() {
            sleep(CHECK_INTERVAL).await;
        }
    }

    /// Waits until a cycle that begins from now on was answered.
    async fn next_cycle(&self) -> Result<(), DeviceError> {
        let asked_at = Instant::now();
        let is_done = |state: &SharedState<N>| state.order.is_none() && state.report.is_some_and(|(_, at)| at >= asked_at);
        self.wait(REPORT_TIMEOUT, |state| is_done(state).then_some(Ok(()))).await
    }
}

impl<const N: usize> SharedState<N> {
    fn fail_if_failed(&self) -> Result<(), DeviceError> {
        match &self.failure {
            Some(failure) => Err(failure.clone()),
            None if self.is_over => Err(not_connected()),
            None => Ok(()),
        }
    }

    fn fail_if_not_armed(&self) -> Result<(), DeviceError> {
        if self.armed.is_some() {
            return Ok(());
        }
        let reason = self.disarmed_by.clone().unwrap_or_else(|| NOT_ARMED.to_owned());
        Err(DeviceError::NotReady { reason })
    }

    fn set_out(&mut self, target: &Target<N>) -> Result<(), DeviceError> {
        self.fail_if_failed()?;
        self.fail_if_not_armed()?;
        let ((report, _), points) = (self.report.ok_or_else(not_connected)?, self.points.as_mut().ok_or_else(not_connected)?);
        let refuse = |reason: &str| Err(DeviceError::NotReady { reason: reason.to_owned() });
        if let Some(reason) = report.hindrance {
            return refuse(reason);
        }
        if points.is_moving() {
            return refuse("it is still under way; wait until it has arrived");
        }
        let from_rad = points.at_rad();
        if apart_rad(&from_rad, &report.positions_rad) > MAX_FOLLOWING_ERROR_RAD {
            return refuse("it is not where it was led; see what holds it, and arm again");
        }
        points.go(target);
        self.order = Some(StreamOrder::Go { target: target.clone(), from_rad });
        self.is_under_order = true;
        Ok(())
    }

    /// Returns true while the link is needed: once it is to close, until the arm rests. A garbled datagram cuts no ramp short, but
    /// garbage alone, or a controller that takes no set point in time, does not hold the link for ever.
    fn is_wanted(&self, hears_something: bool) -> bool {
        let Some(since) = self.closing_since else { return true };
        let is_moving = self.points.as_ref().is_some_and(SetPoints::is_moving);
        hears_something && is_moving && since.elapsed() < CLOSE_TIMEOUT
    }

    /// Leaves word to stop, armed or not; it stays until it is taken, and is left again where it was not.
    fn ramp_down(&mut self) {
        if let Some(points) = &mut self.points {
            points.ramp_down();
        }
        if self.is_under_order || self.armed.is_some() || self.stop_not_taken.is_some() {
            self.order = Some(StreamOrder::Stop);
        }
    }

    /// Takes the right to move away; the first reason is the one that is told.
    fn disarm(&mut self, reason: &str) {
        if self.armed.take().is_some() {
            self.disarmed_by = Some(reason.to_owned());
        }
    }

    /// Gives up the set points of an arm that does not follow: once it follows again, it neither jumps to them nor goes on by itself.
    fn abandon_points(&mut self, held_rad: [f64; N], reason: &str) {
        self.disarm(reason);
        self.points = Some(SetPoints::still(held_rad));
        let is_to_stop = self.is_under_order || self.order == Some(StreamOrder::Stop);
        self.order = is_to_stop.then_some(StreamOrder::Stop);
    }

    /// Takes a report, and gives the answer.
    fn step(&mut self, report: StreamedReport<N>, cycle: Duration) -> StreamStep<N> {
        let now = Instant::now();
        if self.armed.is_some_and(|armed| now.duration_since(armed.fed_at) > armed.watchdog) {
            self.ramp_down();
            self.disarm(NOT_FED);
        }
        if let Some(reason) = report.hindrance {
            self.abandon_points(report.held_rad, reason);
        }
        let points = self.points.get_or_insert_with(|| SetPoints::still(report.held_rad));
        if points.is_moving()
            && let Some((_, before)) = self.report
        {
            self.jitter.get_or_insert_with(|| Jitter::of(cycle)).add(now.duration_since(before));
        }
        if report.is_behind {
            points.take_back(cycle);
        }
        let set_point_rad = points.advance(cycle);
        (self.report, self.malformed) = (Some((report, now)), None);
        let order = self.order.take();
        self.is_under_order &= order != Some(StreamOrder::Stop);
        StreamStep { set_point_rad, order }
    }
}

/// Largest distance of an axis.
pub(super) fn apart_rad<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Work of the thread, until the session closes or the link breaks.
fn run_link<const N: usize, P: StreamedProtocol<N>>(protocol: &P, shared: &Shared<N>) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let outcome = match runtime {
        // A thread that is gone is not to be taken for a controller that is silent.
        Ok(runtime) => catch_unwind(AssertUnwindSafe(|| runtime.block_on(answer_all(protocol, shared)))).unwrap_or_else(|_| {
            Err(DeviceError::Closed { reason: "by a fault of this program's own; please report it".to_owned() })
        }),
        Err(error) => Err(DeviceError::NotReady { reason: format!("no runtime for its cycle ({error}); free some resources") }),
    };
    let mut state = shared.lock();
    state.failure = outcome.err().or(state.failure.take());
    (state.armed, state.to_arm, state.is_over) = (None, None, true);
    drop(state);
    shared.cycles.send_modify(|cycles| *cycles += 1);
}

async fn answer_all<const N: usize, P: StreamedProtocol<N>>(protocol: &P, shared: &Shared<N>) -> Result<(), DeviceError> {
    let (identity, mut link) = protocol.open().await?;
    shared.lock().identity = Some(identity);
    let cycle = link.cycle();
    loop {
        let report = timeout(CHECK_INTERVAL, link.report()).await;
        if !shared.lock().is_wanted(report.is_ok()) {
            link.close().await;
            return Ok(());
        }
        match report {
            Ok(Ok(report)) => answer_one(&mut link, shared, report, cycle).await?,
            Ok(Err(malformed @ DeviceError::Malformed { .. })) => shared.lock().malformed = Some(malformed),
            Ok(Err(error)) => return Err(error),
            Err(_) => {}
        }
    }
}

async fn answer_one<const N: usize, L: StreamedLink<N>>(
    link: &mut L,
    shared: &Shared<N>,
    report: StreamedReport<N>,
    cycle: Duration,
) -> Result<(), DeviceError> {
    let to_arm = shared.lock().to_arm;
    if let Some(watchdog) = to_arm {
        arm_one(link, shared, &report, watchdog).await;
        if !L::ALWAYS_FOLLOWS {
            return Ok(());
        }
    }
    let step = shared.lock().step(report, cycle);
    let answered = link.answer(&step).await;
    if step.order == Some(StreamOrder::Stop) {
        let sent_at = link.stop_sent_at().or_else(|| answered.is_ok().then(Instant::now));
        shared.lock().stop_sent_at = sent_at;
    }
    match answered {
        Err(DeviceError::NotReady { reason }) => {
            let mut state = shared.lock();
            state.abandon_points(report.held_rad, &reason);
            if step.order == Some(StreamOrder::Stop) {
                state.stop_not_taken = Some(DeviceError::NotReady { reason });
            }
        }
        answered => answered?,
    }
    shared.cycles.send_modify(|cycles| *cycles += 1);
    Ok(())
}

/// Takes the right to move, unless a stop comes before it is had.
async fn arm_one<const N: usize, L: StreamedLink<N>>(
    link: &mut L,
    shared: &Shared<N>,
    report: &StreamedReport<N>,
    watchdog: Duration,
) {
    let not_ready = |reason: &str| Err(DeviceError::NotReady { reason: reason.to_owned() });
    let commanded_rad = shared.lock().points.as_ref().filter(|_| L::ALWAYS_FOLLOWS).map(SetPoints::at_rad);
    let is_off = commanded_rad.is_some_and(|at_rad| apart_rad(&at_rad, &report.positions_rad) > MAX_FOLLOWING_ERROR_RAD);
    let outcome = if is_off {
        not_ready("it is not where it was led; bring it there, or connect anew")
    } else {
        tokio::select! {
            biased;
            () = shared.arming_given_up() => not_ready(NOT_ARMED),
            outcome = link.arm(watchdog) => outcome,
        }
    };
    let mut state = shared.lock();
    if state.to_arm.take().is_some() && outcome.is_ok() {
        state.armed = Some(Armed { watchdog, fed_at: Instant::now() });
    }
    state.arm_outcome = Some(outcome);
    if !L::ALWAYS_FOLLOWS {
        // Arming takes its time: the arm holds what it reports next, not what was reported before.
        state.points = None;
    }
}

#[cfg(test)]
mod tests;
