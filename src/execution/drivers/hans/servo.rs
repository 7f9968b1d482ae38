//! Servo streaming (port 8892): joints pushed at the controller's own cycle from a thread with absolute deadlines, the rest
//! position too while nothing moves. The port has no replies and takes one client; the way to stop is to push no more, reset the
//! connection and say so on the text port.

use std::io::{self, Write as _};
use std::net::TcpStream;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::time::timeout;

use crate::cell::HansServoSpec;
use crate::execution::device::{DeviceError, Direction, Target};
use crate::execution::drivers::set_points::SetPoints;
use crate::execution::drivers::stream::{Connection, NOT_FED, Wiring, within};
use crate::execution::protocol::hans::HansRequest;
use crate::execution::protocol::hans_state::{HansRealtimeState, take_realtime};
use crate::execution::session::streamer::{Beat, Jitter, Streamer};

/// Longest wait for the servo port to connect.
const SERVO_TIMEOUT: Duration = Duration::from_millis(500);
/// Longest wait for the servo port to take a set point; shorter than that for the last beat, after which the stop is sent.
const PUSH_TIMEOUT: Duration = Duration::from_millis(20);
/// Longest wait for the last beat of a stream that is ended: several cycles.
const LAST_BEAT: Duration = Duration::from_millis(30);

/// A stream of joints.
#[derive(Debug)]
pub(super) struct ServoStream {
    streamer: Streamer,
    course: Arc<Mutex<ServoCourse>>,
}

/// Set points of the beats.
#[derive(Debug)]
pub(super) struct ServoCourse {
    points: SetPoints<6>,
    failure: Option<String>,
    watchdog: Duration,
    fed_at: Instant,
    /// True once the watchdog lapsed: nothing sets out any more.
    has_lapsed: bool,
}

impl ServoCourse {
    /// A course at rest, fed now.
    pub(super) fn still(at_rad: [f64; 6], watchdog: Duration, now: Instant) -> Self {
        Self { points: SetPoints::still(at_rad), failure: None, watchdog, fed_at: now, has_lapsed: false }
    }

    /// Set point of the next beat, radians. The thread beats on whatever the session does: an arm whose session gives no sign of life
    /// in time is led to rest.
    pub(super) fn advance(&mut self, period: Duration, now: Instant) -> [f64; 6] {
        if !self.has_lapsed && now.duration_since(self.fed_at) > self.watchdog {
            self.has_lapsed = true;
            self.points.ramp_down();
        }
        self.points.advance(period)
    }

    /// Takes a sign of life.
    fn feed(&mut self, now: Instant) {
        self.fed_at = now;
    }

    /// Sets out for a target.
    pub(super) fn lead(&mut self, target: &Target<6>) -> Result<(), DeviceError> {
        self.check()?;
        if self.points.is_moving() {
            return Err(DeviceError::NotReady { reason: "a target is under way; wait until it has arrived".into() });
        }
        self.points.go(target);
        Ok(())
    }

    /// Error of a stream that broke off, or was not fed.
    pub(super) fn check(&self) -> Result<(), DeviceError> {
        match &self.failure {
            Some(reason) => Err(DeviceError::Closed { reason: reason.clone() }),
            None if self.has_lapsed => Err(DeviceError::NotReady { reason: NOT_FED.to_owned() }),
            None => Ok(()),
        }
    }
}

impl ServoStream {
    /// Connects to the servo port and streams the joints where the arm stands; `watchdog` is the longest time between two signs of life
    /// of the session.
    pub(super) async fn begin(
        spec: &HansServoSpec,
        joints_deg: [f64; 6],
        watchdog: Duration,
        wiring: &Wiring,
    ) -> Result<Self, DeviceError> {
        let unreachable = |reason: String| DeviceError::Unreachable { address: spec.address.clone(), reason };
        let mut stream = connect(&spec.address).await.map_err(|error| unreachable(error.to_string()))?;
        let start = HansRequest::StartServo { argument: spec.start_argument, lookahead_secs: spec.lookahead_secs };
        push(&mut stream, &start, wiring).map_err(|error| unreachable(error.to_string()))?;
        let course = Arc::new(Mutex::new(ServoCourse::still(joints_deg.map(f64::to_radians), watchdog, Instant::now())));
        let (shared, wiring, period) = (Arc::clone(&course), wiring.clone(), Duration::from_millis(spec.period_ms.into()));
        // A deadline that was left out makes the way longer, not its next step.
        let beat = move |_: Beat| {
            let joints_deg = lock(&shared).advance(period, Instant::now()).map(f64::to_degrees);
            match push(&mut stream, &HansRequest::PushServoJ { joints_deg }, &wiring) {
                Ok(()) => ControlFlow::Continue(()),
                Err(error) => {
                    lock(&shared).failure = Some(error.to_string());
                    ControlFlow::Break(())
                }
            }
        };
        let streamer = Streamer::start("hans-servo", period, beat);
        Ok(Self { streamer: streamer.map_err(|error| unreachable(error.to_string()))?, course })
    }

    /// Leads the joints to a target.
    pub(super) fn lead(&self, target: &Target<6>) -> Result<(), DeviceError> {
        lock(&self.course).lead(target)
    }

    /// Takes a sign of life of the session.
    pub(super) fn feed(&self) {
        lock(&self.course).feed(Instant::now());
    }

    /// Time of the last sign of life.
    #[cfg(test)]
    pub(super) fn fed_at(&self) -> Instant {
        lock(&self.course).fed_at
    }

    /// Ends the stream, and waits for the beat under way; not longer than [`LAST_BEAT`], so that a port that takes no bytes holds up
    /// no stop.
    pub(super) async fn end(self) {
        // Whenever a thread is free to wait for it: a stop follows.
        self.streamer.cancel();
        let ended = tokio::task::spawn_blocking(move || drop(self));
        // It ends by itself then.
        let _ = timeout(LAST_BEAT, ended).await;
    }

    /// Returns true while a target is under way.
    pub(super) fn is_under_way(&self) -> bool {
        lock(&self.course).points.is_moving()
    }

    /// Error of a stream that broke off, or was not fed.
    pub(super) fn check(&self) -> Result<(), DeviceError> {
        lock(&self.course).check()
    }

    /// Histogram of the period.
    pub(super) fn jitter(&self) -> Jitter {
        self.streamer.jitter()
    }
}

/// Cycle and state of the controller, from its binary feed.
pub(super) async fn realtime_state(
    spec: &HansServoSpec,
    wiring: &Wiring,
    wait: Duration,
) -> Result<HansRealtimeState, DeviceError> {
    let mut connection = wiring.connect(&spec.state_address, wait).await?;
    let state = within(wait, first_state(&mut connection)).await?;
    connection.close().await;
    Ok(state)
}

async fn first_state(connection: &mut Connection) -> Result<HansRealtimeState, DeviceError> {
    let mut held = Vec::new();
    loop {
        if let Some(state) = take_realtime(&mut held).map_err(|error| DeviceError::Malformed { what: error.to_string() })? {
            return Ok(state);
        }
        connection.receive(&mut held).await?;
    }
}

/// Connects. The stream is reset where it is dropped: set points that the network has not taken by then are never sent, or they
/// would arrive after the stop that went over the text port.
async fn connect(address: &str) -> io::Result<TcpStream> {
    let connecting = timeout(SERVO_TIMEOUT, tokio::net::TcpStream::connect(address));
    let stream = connecting.await.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()))?;
    stream.set_nodelay(true)?;
    stream.set_zero_linger()?;
    let stream = stream.into_std()?;
    stream.set_nonblocking(false)?;
    stream.set_write_timeout(Some(PUSH_TIMEOUT))?;
    Ok(stream)
}

fn push(stream: &mut TcpStream, request: &HansRequest, wiring: &Wiring) -> io::Result<()> {
    let message = request.encode();
    stream.write_all(message.as_bytes())?;
    wiring.log.record(wiring.device, Direction::Sent, message.as_bytes());
    Ok(())
}

fn lock(course: &Mutex<ServoCourse>) -> MutexGuard<'_, ServoCourse> {
    course.lock().unwrap_or_else(PoisonError::into_inner)
}
