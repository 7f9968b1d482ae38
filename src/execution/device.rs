//! Arms, tables and triggers as a session sees them, whatever their make: radians, seconds, one target at a time.

use std::time::Duration;

use tokio::time::Instant;

use super::session::streamer::Jitter;

/// Name that a controller gives itself, read at connect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Maker.
    pub maker: String,
    /// Model, in the maker's words.
    pub model: String,
    /// Serial number, where the controller tells it.
    pub serial: Option<String>,
    /// Version of its firmware, where the controller tells it.
    pub firmware: Option<String>,
}

/// State of a device with `N` axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceState<const N: usize> {
    /// Time of measurement, on this machine's monotonic clock.
    pub at: Instant,
    /// Measured positions of the axes, radians.
    pub positions_rad: [f64; N],
    /// Condition.
    pub condition: Condition,
}

/// State of an arm.
pub type ArmState = DeviceState<6>;
/// State of a table.
pub type TableState = DeviceState<1>;

/// Condition of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Condition {
    /// True if the drives have power.
    pub powered: bool,
    /// True if the brakes are open.
    pub brakes_open: bool,
    /// True if the device moves.
    pub moving: bool,
    /// True if the device says that it is where it was sent.
    pub in_position: bool,
    /// True if an emergency stop is pressed or not yet reset.
    pub emergency_stop: bool,
    /// True if a guard is open.
    pub guard_open: bool,
    /// True if the device is guided by hand.
    pub hand_guided: bool,
    /// True if the controller holds the motion, or a program on it.
    pub paused: bool,
    /// Fault that it reports.
    pub fault: Option<FaultCode>,
}

impl Condition {
    /// Condition of a device that is ready and stands still.
    pub const READY: Self = Self {
        powered: true,
        brakes_open: true,
        moving: false,
        in_position: true,
        emergency_stop: false,
        guard_open: false,
        hand_guided: false,
        paused: false,
        fault: None,
    };
}

/// Number that a device gives its fault; [`MotionDevice::fault_text`] has the words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultCode(pub u32);

/// One straight, synchronised segment in joint space that ends at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Target<const N: usize> {
    /// Number of the target in the run, strictly rising; correlates answers.
    pub sequence: u64,
    /// Positions at its end, radians.
    pub positions_rad: [f64; N],
    /// Speed that each axis reaches at most, rad/s, override already applied: the axes' own shares of one synchronised motion; 0
    /// for an axis that stays.
    pub max_speed_rad_s: [f64; N],
    /// Acceleration of each axis, rad/s², override already applied; shares of one synchronised motion, and 0 likewise.
    pub max_acceleration_rad_s2: [f64; N],
    /// Predicted time of the segment.
    pub duration: Duration,
}

/// Time of an attempt to stop a device.
pub const STOP_ATTEMPT: Duration = Duration::from_millis(500);

/// Time in which a trigger takes back what it left on.
pub const WITHDRAWAL: Duration = Duration::from_millis(150);

/// A motion device with `N` axes: an arm (6), a table (1), or an arm whose controller turns the table as well (7, the table last).
///
/// Futures are `Send` and may be dropped at any point; a device is then still able to `stop`, and to read its `state`.
pub trait MotionDevice<const N: usize>: Send {
    /// Connects and identifies the device. Sends no motion; may try again, with growing pauses, until the deadline of its
    /// configuration.
    fn connect(&mut self) -> impl Future<Output = Result<Identity, DeviceError>> + Send;

    /// Reads a fresh state.
    fn state(&mut self) -> impl Future<Output = Result<DeviceState<N>, DeviceError>> + Send;

    /// Takes the right to move: servo on, execution right, the device's watchdog set to `watchdog` where it has one. May take
    /// seconds, in which a device that has its right already is kept alive.
    fn arm(&mut self, watchdog: Duration) -> impl Future<Output = Result<(), DeviceError>> + Send;

    /// Puts one target on the wire; returns when the controller has accepted it, not when it is reached. A device that streams its
    /// way leads it there in the background, and no further once `stop` was called or the device was dropped.
    fn start(&mut self, target: &Target<N>) -> impl Future<Output = Result<(), DeviceError>> + Send;

    /// Feeds the device's watchdog; called at least every third of its time while armed. It is called after a stop too, until the
    /// device is armed again: that there is nothing to feed then is no error.
    fn keep_alive(&mut self) -> impl Future<Output = Result<(), DeviceError>> + Send;

    /// Asks for a controlled stop; returns the time at which the acknowledgement was read, once it was. Unless `sent_at` has a time
    /// already, it gets that at which the last byte of the first request was handed to the wire, whatever becomes of it then. May
    /// be called in any state, and again: a session drops an attempt after [`STOP_ATTEMPT`] and makes another, so a link that may
    /// be dead is given up well within it. From then on no target is taken until the device is armed again, which a session does
    /// when a client resumes.
    fn stop(&mut self, sent_at: &mut Option<Instant>) -> impl Future<Output = Result<Instant, DeviceError>> + Send;

    /// Gives the right to move back, where it was taken, and closes. Sends nothing that moves.
    fn release(&mut self) -> impl Future<Output = Result<(), DeviceError>> + Send;

    /// Jitter of its set points so far, where it streams them.
    fn jitter(&self) -> Option<Jitter> {
        None
    }

    /// Words of a fault that this device reports, where they are known.
    fn fault_text(&self, fault: FaultCode) -> Option<&'static str> {
        let _ = fault;
        None
    }
}

/// A device that can be read but not moved: the type has no way to. A dry run holds its devices by it.
#[derive(Debug)]
pub struct Observed<D>(D);

impl<D> Observed<D> {
    /// Takes the way to move from a device.
    pub const fn new(device: D) -> Self {
        Self(device)
    }

    /// [`MotionDevice::connect`].
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn connect<const N: usize>(&mut self) -> Result<Identity, DeviceError>
    where
        D: MotionDevice<N>,
    {
        self.0.connect().await
    }

    /// [`MotionDevice::state`].
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn state<const N: usize>(&mut self) -> Result<DeviceState<N>, DeviceError>
    where
        D: MotionDevice<N>,
    {
        self.0.state().await
    }
}

/// A scanner's trigger.
pub trait Trigger: Send {
    /// Sets the projector's brightness level of the next capture.
    fn set_brightness(&mut self, level: u8) -> impl Future<Output = Result<(), DeviceError>> + Send;

    /// Triggers a capture and waits for its acknowledgement until its deadline; none is an error, never a skip.
    fn capture(&mut self, capture: &Capture) -> impl Future<Output = Result<Captured, DeviceError>> + Send;

    /// Takes back what a capture left on that was dropped, such as an output to the scanner. A session asks for it after the devices
    /// were stopped, and drops it after [`WITHDRAWAL`].
    fn withdraw(&mut self) -> impl Future<Output = ()> + Send {
        std::future::ready(())
    }
}

/// A capture that is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Capture {
    /// Name of the run.
    pub run: String,
    /// Step of the program, from 0.
    pub step: usize,
    /// Number of the view.
    pub view: u32,
    /// Projector brightness level.
    pub brightness: u8,
    /// Predicted time of the capture; a trigger that cannot tell the end of one waits it out.
    pub expected: Duration,
    /// Longest wait for the acknowledgement.
    pub deadline: Duration,
}

impl Capture {
    /// Error of a capture whose acknowledgement did not come by its deadline: `missing` says what did not come, as a clause, and
    /// `remedy` what to look at.
    #[must_use]
    pub fn unacknowledged(&self, missing: impl Into<String>, remedy: &'static str) -> DeviceError {
        let [exposure_ms, waited_ms] = [self.expected, self.deadline].map(|time| time.as_millis() as u64);
        let deadline_ms = waited_ms.saturating_sub(exposure_ms);
        DeviceError::Unacknowledged { missing: missing.into(), remedy, exposure_ms, deadline_ms }
    }
}

/// A capture that was acknowledged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Captured {
    /// Name that the scanner gave it.
    pub id: Option<String>,
    /// Time from trigger to acknowledgement.
    pub took: Duration,
}

/// Reason why a device does not do what it was asked, and what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    /// A controller that cannot be reached.
    #[error("{address} cannot be reached ({reason}); check that the controller is on and that the cell file has its address")]
    Unreachable {
        /// Address of the cell file.
        address: String,
        /// Words of the operating system.
        reason: String,
    },
    /// This machine does not listen where its cell file wants it to.
    #[error(
        "this machine cannot listen at {address} ({reason}); give one of its own addresses in the cell file, with a port that no \
         other program has"
    )]
    Unbound {
        /// Address of the cell file.
        address: String,
        /// Words of the operating system.
        reason: String,
    },
    /// The connection ended.
    #[error("the connection to the controller ended ({reason}); see what the controller says, then connect anew")]
    Closed {
        /// Words of the operating system.
        reason: String,
    },
    /// The device did not answer in time.
    #[error("no answer within {} ms; check its network and whether another client holds it", waited.as_millis())]
    Silent {
        /// Time waited.
        waited: Duration,
    },
    /// A trigger that did not acknowledge a capture in time.
    #[error(
        "{missing} within {} ms, the exposure of {exposure_ms} ms and deadline_ms = {deadline_ms} ms; {remedy}",
        exposure_ms + deadline_ms
    )]
    Unacknowledged {
        /// Clause that says what did not come.
        missing: String,
        /// Things to look at.
        remedy: &'static str,
        /// Predicted time of the capture.
        exposure_ms: u64,
        /// Time of the cell file beyond it.
        deadline_ms: u64,
    },
    /// A gateway that gives no first answer, as one that takes other frames or passes them to another node.
    #[error("{error}; check framing and node in the cell file too, now {framing} and {node}")]
    Unanswered {
        /// Silence, or the end of the connection.
        error: Box<DeviceError>,
        /// Frames of the cell file.
        framing: &'static str,
        /// Node of the cell file.
        node: u8,
    },
    /// A malformed answer.
    #[error("the controller answered what this protocol does not know ({what}); check the protocol that the cell file names")]
    Malformed {
        /// Description of what was read.
        what: String,
    },
    /// A request that the device refused.
    #[error("it refused with code {code} ({text}); clear that at the device, then try again")]
    Refused {
        /// Number that the device gives.
        code: i64,
        /// Words of the device.
        text: String,
    },
    /// The device has a fault.
    #[error("the device is in fault {code} ({text}); clear it at the device, then arm again")]
    Fault {
        /// Number of the fault.
        code: u32,
        /// Words for the fault.
        text: String,
    },
    /// The device cannot take motion now.
    #[error("the device is not ready: {reason}")]
    NotReady {
        /// Words for what is missing, and how to mend it.
        reason: String,
    },
    /// The state is too old to go by.
    #[error("the last state of the device is {} ms old; check its network", age.as_millis())]
    Stale {
        /// Age of the last state.
        age: Duration,
    },
    /// Another device than the cell file names.
    #[error("there is {found}, where the cell file has {expected}; check address and model in the cell file")]
    OtherDevice {
        /// Device of the cell file.
        expected: String,
        /// Device that is there.
        found: String,
    },
    /// Numbers of 32 bits come in another order than configured.
    #[error("32-bit numbers of the device read {found} in the order {configured:?}; set word_order to {other:?}")]
    WordOrder {
        /// Order of the cell file.
        configured: String,
        /// Order that would give the value expected.
        other: String,
        /// Value read.
        found: i64,
    },
    /// The protocol has no way to do it.
    #[error("this controller cannot {what}")]
    Unsupported {
        /// Deed, as a verb, and what to do instead.
        what: String,
    },
}

/// Way of bytes on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Leaves here, for the device.
    Sent,
    /// Arrives here, from the device.
    Received,
}

/// A log of every byte on the wire. Neither blocks nor fails where it is called: a log that cannot be kept ends the run by itself.
pub trait WireLog: Send + Sync {
    /// Notes bytes that were sent or received just now; `device` is `arm`, `table` or `trigger`.
    fn record(&self, device: &'static str, direction: Direction, bytes: &[u8]);

    /// Notes words about a device among its bytes, such as whose connection was refused; a log of bytes alone leaves them out.
    fn note(&self, device: &'static str, words: &str) {
        let _ = (device, words);
    }
}

/// A log that keeps nothing.
impl WireLog for () {
    fn record(&self, _device: &'static str, _direction: Direction, _bytes: &[u8]) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Refusals and silence were told in words for controllers, of triggers too.
    #[test]
    fn each_error_says_what_to_do_next_whatever_the_device() {
        let words = || "x".to_owned();
        let refused = DeviceError::Refused { code: 503, text: "busy".to_owned() };
        assert_eq!(refused.to_string(), "it refused with code 503 (busy); clear that at the device, then try again");
        for error in [
            refused,
            DeviceError::Unreachable { address: words(), reason: words() },
            DeviceError::Unbound { address: words(), reason: words() },
            DeviceError::Closed { reason: words() },
            DeviceError::Silent { waited: STOP_ATTEMPT },
            DeviceError::Unacknowledged { missing: words(), remedy: "check its cable", exposure_ms: 1_000, deadline_ms: 10_000 },
            DeviceError::Unanswered { error: Box::new(DeviceError::Silent { waited: STOP_ATTEMPT }), framing: "rtu", node: 1 },
            DeviceError::Malformed { what: words() },
            DeviceError::Fault { code: 1, text: words() },
            DeviceError::Stale { age: STOP_ATTEMPT },
            DeviceError::OtherDevice { expected: words(), found: words() },
            DeviceError::WordOrder { configured: words(), other: words(), found: 1 },
        ] {
            let told = error.to_string();
            assert!(told.split_once("; ").is_some_and(|(_, next)| next.len() > 10), "{told}");
        }
    }
}
