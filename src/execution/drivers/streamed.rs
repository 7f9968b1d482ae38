//! Devices whose controller sets the pace: it reports in every cycle and takes a set point as the answer. A thread of its own with
//! its own runtime answers, so that no other work of the server delays it; the session's calls only leave word for it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{Instant, sleep, timeout};

use super::set_points::SetPoints;
use super::stream::{NOT_ARMED, not_connected};
use crate::execution::device::{
    Condition, DeviceError, DeviceState, Identity, MotionDevice, STOP_ATTEMPT, StopAcknowledged, Target,
};
use crate::execution::session::streamer::Jitter;

/// Longest wait for the first report.
const PATIENCE: Duration = Duration::from_secs(10);
/// Longest wait for a further report.
const SILENCE: Duration = Duration::from_secs(1);
/// Pause after which the thread looks whether it is still wanted.
const GLANCE: Duration = Duration::from_millis(100);
/// Time for which a stop that the controller does not take is asked for anew: the rest of the attempt is for the last answer.
const PERSISTENCE: Duration = Duration::from_millis(STOP_ATTEMPT.as_millis() as u64 * 7 / 10);
/// Largest distance of an axis from its set point at which it may set out, radians: half a degree.
pub(super) const ASTRAY_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Words for a watchdog that lapsed.
const NOT_FED: &str = "it was not kept alive in time, as this machine was too busy or stood still; arm it again";

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
    desk: Mutex<Desk<N>>,
    /// Cycles answered so far.
    cycles: watch::Sender<u64>,
}

/// Words that the session and the thread leave for each other.
#[derive(Debug, Default)]
struct Desk<const N: usize> {
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
    failure: Option<DeviceError>,
    /// The latest report that could not be read, while none could since.
    malformed: Option<DeviceError>,
    is_closing: bool,
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
            before.wait(PATIENCE, |desk| desk.is_over.then_some(Ok(()))).await?;
        }
        let shared = Arc::new(Shared { desk: Mutex::new(Desk::default()), cycles: watch::Sender::new(0) });
        self.thread = Some(shared.clone());
        let protocol = self.protocol.clone();
        std::thread::Builder::new().name("streaming".to_owned()).spawn(move || lead(&protocol, &shared)).map_err(|error| {
            DeviceError::NotReady { reason: format!("no thread for its cycle ({error}); free some resources") }
        })?;
        let shared = self.shared()?;
        shared.wait(PATIENCE, |desk| desk.report.and(desk.identity.clone()).map(Ok)).await
    }

    async fn state(&mut self) -> Result<DeviceState<N>, DeviceError> {
        let shared = self.shared()?;
        let asked_at = Instant::now();
        shared.wait(SILENCE, |desk| desk.report.filter(|(_, at)| *at >= asked_at).map(|_| Ok(()))).await?;
        let desk = shared.desk();
        let (report, at) = desk.report.ok_or_else(not_connected)?;
        let moving = report.condition.moving || desk.points.as_ref().is_some_and(SetPoints::is_moving);
        let condition = Condition { moving, in_position: !moving, ..report.condition };
        Ok(DeviceState { at, positions_rad: report.positions_rad, condition })
    }

    async fn arm(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
        let shared = self.shared()?;
        {
            let mut desk = shared.desk();
            let (report, _) = desk.report.ok_or_else(not_connected)?;
            if let Some(reason) = report.hindrance {
                return Err(DeviceError::NotReady { reason: reason.to_owned() });
            }
            (desk.armed, desk.is_stopped, desk.disarmed_by, desk.stop_not_taken) = (None, false, None, None);
            (desk.arm_outcome, desk.to_arm) = (None, Some(watchdog));
        }
        shared.wait(PATIENCE, |desk| desk.points.as_ref().and(desk.arm_outcome.clone())).await
    }

    async fn start(&mut self, target: &Target<N>) -> Result<(), DeviceError> {
        let shared = self.shared()?;
        shared.desk().set_out(target)?;
        shared.next_cycle().await?;
        // The controller may not have taken it.
        shared.desk().fail_if_not_armed()
    }

    async fn keep_alive(&mut self) -> Result<(), DeviceError> {
        let mut desk = self.shared()?.desk();
        desk.fail_if_failed()?;
        if let Some(armed) = &mut desk.armed {
            armed.fed_at = Instant::now();
        }
        if desk.is_stopped { Ok(()) } else { desk.fail_if_not_armed() }
    }

    async fn stop(&mut self) -> Result<StopAcknowledged, DeviceError> {
        let shared = self.shared()?;
        let asked_at = Instant::now();
        loop {
            {
                let mut desk = shared.desk();
                desk.ramp_down();
                (desk.to_arm, desk.stop_not_taken) = (None, None);
                // A watchdog that lapsed before stays an error.
                desk.is_stopped |= desk.armed.take().is_some();
            }
            shared.next_cycle().await?;
            let sent_at = Instant::now();
            // The controller reports on: it has the answer, or did not take it.
            shared.next_cycle().await?;
            let not_taken = shared.desk().stop_not_taken.clone();
            match not_taken {
                None => return Ok(StopAcknowledged { sent_at, acknowledged_at: Instant::now() }),
                Some(error) if asked_at.elapsed() >= PERSISTENCE => return Err(error),
                // Its own watchdog may stop it in the meantime.
                Some(_) => {}
            }
        }
    }

    fn jitter(&self) -> Option<Jitter> {
        self.thread.as_ref()?.desk().jitter.clone()
    }

    async fn release(&mut self) -> Result<(), DeviceError> {
        let Some(shared) = self.thread.take() else { return Ok(()) };
        shared.close();
        shared.wait(PATIENCE, |desk| desk.is_over.then_some(Ok(()))).await
    }
}

impl<const N: usize> Shared<N> {
    fn desk(&self) -> MutexGuard<'_, Desk<N>> {
        // A holder that panicked left whole values.
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn close(&self) {
        let mut desk = self.desk();
        desk.ramp_down();
        (desk.armed, desk.to_arm, desk.is_closing) = (None, None, true);
    }

    /// Waits until `found` finds something, looking after every cycle.
    async fn wait<T>(
        &self,
        patience: Duration,
        found: impl Fn(&Desk<N>) -> Option<Result<T, DeviceError>>,
    ) -> Result<T, DeviceError> {
        let mut cycles = self.cycles.subscribe();
        let search = async {
            loop {
                if let Some(outcome) = found(&self.desk()) {
                    return outcome;
                }
                self.desk().fail_if_failed()?;
                if cycles.changed().await.is_err() {
                    return Err(not_connected());
                }
            }
        };
        let silent = || self.desk().malformed.clone().unwrap_or(DeviceError::Silent { waited: patience });
        timeout(patience, search).await.unwrap_or_else(|_| Err(silent()))
    }

    /// Waits until it is no longer to be armed.
    async fn arming_given_up(&self) {
        while self.desk().to_arm.is_some() {
            sleep(GLANCE).await;
        }
    }

    /// Waits until a cycle that begins from now on was answered.
    async fn next_cycle(&self) -> Result<(), DeviceError> {
        let asked_at = Instant::now();
        let is_done = |desk: &Desk<N>| desk.order.is_none() && desk.report.is_some_and(|(_, at)| at >= asked_at);
        self.wait(SILENCE, |desk| is_done(desk).then_some(Ok(()))).await
    }
}

impl<const N: usize> Desk<N> {
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
        if apart_rad(&from_rad, &report.positions_rad) > ASTRAY_RAD {
            return refuse("it is not where it was led; see what holds it, and arm again");
        }
        points.go(target);
        self.order = Some(StreamOrder::Go { target: target.clone(), from_rad });
        self.is_under_order = true;
        Ok(())
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

    /// Gives up what does not follow: nothing is led on that it would jump to, nor goes on by itself once it follows again.
    fn let_go(&mut self, held_rad: [f64; N], reason: &str) {
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
            self.let_go(report.held_rad, reason);
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

/// The thread, until the session closes or the link breaks.
fn lead<const N: usize, P: StreamedProtocol<N>>(protocol: &P, shared: &Shared<N>) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let outcome = match runtime {
        Ok(runtime) => runtime.block_on(answer_all(protocol, shared)),
        Err(error) => Err(DeviceError::NotReady { reason: format!("no runtime for its cycle ({error}); free some resources") }),
    };
    let mut desk = shared.desk();
    desk.failure = outcome.err().or(desk.failure.take());
    (desk.armed, desk.to_arm, desk.is_over) = (None, None, true);
    drop(desk);
    shared.cycles.send_modify(|cycles| *cycles += 1);
}

async fn answer_all<const N: usize, P: StreamedProtocol<N>>(protocol: &P, shared: &Shared<N>) -> Result<(), DeviceError> {
    let (identity, mut link) = protocol.open().await?;
    shared.desk().identity = Some(identity);
    let cycle = link.cycle();
    loop {
        let report = timeout(GLANCE, link.report()).await;
        let is_wanted = {
            let desk = shared.desk();
            !desk.is_closing || report.is_ok() && desk.points.as_ref().is_some_and(SetPoints::is_moving)
        };
        if !is_wanted {
            link.close().await;
            return Ok(());
        }
        match report {
            Ok(Ok(report)) => answer_one(&mut link, shared, report, cycle).await?,
            Ok(Err(malformed @ DeviceError::Malformed { .. })) => shared.desk().malformed = Some(malformed),
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
    let to_arm = shared.desk().to_arm;
    if let Some(watchdog) = to_arm {
        arm_one(link, shared, &report, watchdog).await;
        if !L::ALWAYS_FOLLOWS {
            return Ok(());
        }
    }
    let step = shared.desk().step(report, cycle);
    match link.answer(&step).await {
        Err(DeviceError::NotReady { reason }) => {
            let mut desk = shared.desk();
            desk.let_go(report.held_rad, &reason);
            if step.order == Some(StreamOrder::Stop) {
                desk.stop_not_taken = Some(DeviceError::NotReady { reason });
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
    let led_rad = shared.desk().points.as_ref().filter(|_| L::ALWAYS_FOLLOWS).map(SetPoints::at_rad);
    let is_astray = led_rad.is_some_and(|led_rad| apart_rad(&led_rad, &report.positions_rad) > ASTRAY_RAD);
    let outcome = if is_astray {
        not_ready("it is not where it was led; bring it there, or connect anew")
    } else {
        tokio::select! {
            biased;
            () = shared.arming_given_up() => not_ready(NOT_ARMED),
            outcome = link.arm(watchdog) => outcome,
        }
    };
    let mut desk = shared.desk();
    if desk.to_arm.take().is_some() && outcome.is_ok() {
        desk.armed = Some(Armed { watchdog, fed_at: Instant::now() });
    }
    desk.arm_outcome = Some(outcome);
    if !L::ALWAYS_FOLLOWS {
        // Arming takes its time: the arm holds what it reports next, not what was reported before.
        desk.points = None;
    }
}

#[cfg(test)]
mod tests;
