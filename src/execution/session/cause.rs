//! Causes of pauses and ends, and the reason of each state: closed lists, with a code each and words for people.

use std::fmt;
use std::time::Duration;

use super::gate::Objection;
use super::lease::LeaseError;
use super::state::RunState;
use crate::execution::device::DeviceError;

/// Devices of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum DeviceRole {
    /// The arm.
    Arm,
    /// The table.
    Table,
    /// The scanner's trigger.
    Trigger,
}

impl DeviceRole {
    /// Name in interfaces and in the wire log.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Arm => "arm",
            Self::Table => "table",
            Self::Trigger => "trigger",
        }
    }
}

impl fmt::Display for DeviceRole {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Cause of a pause.
#[derive(Clone, Debug, PartialEq)]
pub enum PauseCause {
    /// A client asked for it.
    Client,
    /// A step is done, and steps are taken one by one.
    SingleStep,
    /// The scanner did not acknowledge a capture; the view is not skipped.
    Trigger {
        /// Step of the program, from 0.
        step: usize,
        /// Number of the view.
        view: u32,
        /// Words of the trigger.
        error: DeviceError,
    },
    /// The locating scan is taken, and the part's pose is awaited.
    Locating,
}

impl PauseCause {
    /// Name in interfaces.
    const fn code(&self) -> &'static str {
        match self {
            Self::Client => "by_client",
            Self::SingleStep => "single_step",
            Self::Trigger { .. } => "trigger_silent",
            Self::Locating => "locating",
        }
    }

    /// Command that ends the pause.
    const fn next(&self) -> &'static str {
        match self {
            Self::Client => "resume to go on",
            Self::SingleStep => "step or resume to go on",
            Self::Trigger { .. } => "resume to take it again",
            Self::Locating => "tell where the part lies",
        }
    }
}

impl fmt::Display for PauseCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Client => write!(f, "a pause was requested"),
            Self::SingleStep => write!(f, "takes steps one by one"),
            Self::Trigger { step, view, error } => {
                write!(f, "the capture of viewpoint {view} (step {step}) was not acknowledged: {error}")
            }
            Self::Locating => write!(f, "the locating scan is taken"),
        }
    }
}

/// Cause of an end before the last step.
#[derive(Clone, Debug, PartialEq)]
pub enum StopCause {
    /// A client asked for it.
    Client,
    /// Pause that nobody was there to end.
    Unattended(PauseCause),
    /// The client sent no heartbeat in time.
    HeartbeatLost {
        /// Time since the last.
        after: Duration,
    },
    /// The lease ran out, or another has it.
    LeaseLost(LeaseError),
    /// Whoever held the run is gone: the server ends.
    ServerGone,
    /// Armed, and not told to move for too long.
    ArmExpired,
    /// Emergency stop.
    EmergencyStop(DeviceRole),
    /// Guard open.
    GuardOpen(DeviceRole),
    /// Guided by hand.
    HandGuided(DeviceRole),
    /// Paused at the device.
    HeldAtDevice(DeviceRole),
    /// Drives without power, or brakes closed.
    PowerLost(DeviceRole),
    /// State not read in time.
    Stale {
        /// Device.
        device: DeviceRole,
        /// Age of its last state.
        age: Duration,
        /// True where its `reply_timeout_ms` ran out, and `state_max_age_ms` did not.
        by_reply_timeout: bool,
    },
    /// Log that can no longer be kept.
    Audit(String),
    /// Part too far from where it was planned.
    Misplaced(String),
    /// Link lost, or a malformed answer.
    Device {
        /// Device.
        device: DeviceRole,
        /// Error of the device, in words.
        error: DeviceError,
    },
    /// Fault that a device reports.
    Fault {
        /// Device.
        device: DeviceRole,
        /// Number.
        code: u32,
        /// Words, where they are known.
        text: Option<&'static str>,
    },
    /// Conditions for motion that are not met.
    Objections(Vec<Objection>),
    /// Measured positions off the straight way.
    OffPath {
        /// Axis, 1 to 6, or 7 for the table.
        axis: usize,
        /// Distance found, degrees.
        off_deg: f64,
        /// Distance allowed, degrees.
        allowed_deg: f64,
    },
    /// Target not reached in time.
    NotReached {
        /// Axis that is furthest from it, 1 to 6, or 7 for the table.
        axis: usize,
        /// Distance, degrees.
        off_deg: f64,
    },
    /// A fault of this program's own.
    Internal(String),
}

impl StopCause {
    /// State that it ends in from another: what was never armed has failed, save on command.
    #[must_use]
    pub fn ends_in(&self, state: RunState) -> RunState {
        let by_hand = matches!(self, Self::Client | Self::ServerGone | Self::ArmExpired);
        if !by_hand && !state.is_armed() {
            return RunState::Failed;
        }
        match self {
            Self::Client
            | Self::ServerGone
            | Self::ArmExpired
            | Self::Unattended(_)
            | Self::HeartbeatLost { .. }
            | Self::LeaseLost(_)
            | Self::EmergencyStop(_)
            | Self::GuardOpen(_)
            | Self::HandGuided(_)
            | Self::HeldAtDevice(_)
            | Self::PowerLost(_)
            | Self::Stale { .. }
            | Self::Audit(_)
            | Self::Misplaced(_) => RunState::Stopped,
            Self::Device { error, .. } => {
                if is_lost(error) {
                    RunState::Stopped
                } else {
                    RunState::Failed
                }
            }
            Self::Fault { .. } | Self::Objections(_) | Self::OffPath { .. } | Self::NotReached { .. } | Self::Internal(_) => {
                RunState::Failed
            }
        }
    }

    /// Name in interfaces.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Client => "by_client",
            Self::Unattended(cause) => cause.code(),
            Self::HeartbeatLost { .. } => "heartbeat_lost",
            Self::LeaseLost(_) => "lease_lost",
            Self::ServerGone => "server_gone",
            Self::ArmExpired => "arm_expired",
            Self::EmergencyStop(_) => "emergency_stop",
            Self::GuardOpen(_) => "guard_open",
            Self::HandGuided(_) => "hand_guided",
            Self::HeldAtDevice(_) => "held_at_device",
            Self::PowerLost(_) => "power_lost",
            Self::Stale { .. } => "state_stale",
            Self::Audit(_) => "audit_failed",
            Self::Misplaced(_) => "part_misplaced",
            Self::Device { .. } => "device_error",
            Self::Fault { .. } => "device_fault",
            Self::Objections(_) => "not_allowed",
            Self::OffPath { .. } => "off_path",
            Self::NotReached { .. } => "not_reached",
            Self::Internal(_) => "internal",
        }
    }
}

/// Returns true if the link or its answers are gone, rather than a request refused.
const fn is_lost(error: &DeviceError) -> bool {
    matches!(
        error,
        DeviceError::Unreachable { .. }
            | DeviceError::Unbound { .. }
            | DeviceError::Closed { .. }
            | DeviceError::Silent { .. }
            | DeviceError::Unanswered { .. }
            | DeviceError::Stale { .. }
    )
}

impl fmt::Display for StopCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Client => write!(f, "a stop was requested"),
            Self::Unattended(cause) => {
                write!(f, "{cause}; nobody could resume: mend the cause, then start a new run from this step")
            }
            Self::HeartbeatLost { after } => write!(
                f,
                "no heartbeat of the client for {} ms; see whether it still runs, then start a new run from the step that was \
                 reached",
                after.as_millis()
            ),
            Self::LeaseLost(error) => write!(f, "{error}"),
            Self::ServerGone => write!(f, "the server ended; start a new run from the step that was reached"),
            Self::ArmExpired => write!(f, "armed and not told to move; arm a new run when you are ready"),
            Self::EmergencyStop(device) => write!(f, "emergency stop at the {device}; release and reset it there"),
            Self::GuardOpen(device) => write!(f, "guard open at the {device}; close and reset it there"),
            Self::HandGuided(device) => write!(f, "the {device} is guided by hand; leave that mode there"),
            Self::HeldAtDevice(device) => write!(f, "the {device} is paused at its own controller; end that there"),
            Self::PowerLost(device) => write!(f, "the {device} has no power or its brakes are closed; switch it on there"),
            Self::Stale { device, age, by_reply_timeout: false } => {
                write!(f, "no state of the {device} for {} ms; check its network", age.as_millis())
            }
            Self::Stale { device, age, by_reply_timeout: true } => write!(
                f,
                "no reply of the {device} within its reply_timeout_ms = {} ms, which is below state_max_age_ms; check its network, \
                 or raise reply_timeout_ms",
                age.as_millis()
            ),
            Self::Audit(reason) => write!(f, "the audit log can no longer be written ({reason}); make room on its disk"),
            Self::Misplaced(how) => write!(f, "{how}"),
            Self::Device { device, error } => write!(f, "{device}: {error}"),
            Self::Fault { device, code, text } => {
                write!(f, "the {device} reports fault {code}{}; clear it there", Words(*text))
            }
            Self::Objections(objections) => write!(f, "{}", Listed(objections)),
            Self::OffPath { axis, off_deg, allowed_deg } => {
                let axis = AxisName(*axis);
                write!(
                    f,
                    "{axis} is {off_deg:.2}° from where it should be; allowed are {allowed_deg:.2}°: see what holds or moves it, \
                     then start a new run from this step"
                )
            }
            Self::NotReached { axis, off_deg } => {
                let axis = AxisName(*axis);
                write!(f, "{axis} stays {off_deg:.3}° off its target; see what holds it, then start a new run from this step")
            }
            Self::Internal(what) => write!(f, "a fault of this program's own: {what}; please report it"),
        }
    }
}

/// Axis of the cell, 1 to 6 of the arm, or 7 for the table, in words.
pub(super) struct AxisName(pub(super) usize);

impl fmt::Display for AxisName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == 7 { f.write_str("the table") } else { write!(f, "axis {} of the arm", self.0) }
    }
}

/// Words of a fault in brackets.
struct Words(Option<&'static str>);

impl fmt::Display for Words {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.map_or(Ok(()), |text| write!(f, " ({text})"))
    }
}

/// Objections, one after another.
struct Listed<'a>(&'a [Objection]);

impl fmt::Display for Listed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words: Vec<String> = self.0.iter().map(Objection::to_string).collect();
        f.write_str(&words.join("; "))
    }
}

/// Words of a run that is being stopped. Whether a stop went out, each device's own entry tells.
const AWAITS_REST: &str = "the run waits until arm and table are at rest: keep clear";

/// Reason of the state that a run is in.
#[derive(Clone, Debug, PartialEq)]
pub enum RunReason {
    /// Preparing: connecting and checking.
    Connecting,
    /// Ready: an operator has to arm.
    AwaitsArm,
    /// Armed: the first step is awaited.
    AwaitsStart,
    /// Running: on its way.
    UnderWay,
    /// Paused.
    Paused(PauseCause),
    /// Stop that is asked for, with the cause of the end that follows; with none for a pause. Rest of arm and table is awaited.
    Stopping(Option<StopCause>),
    /// Done: every step.
    AllSteps,
    /// Done: devices were read, as a dry run does.
    Read,
    /// Stopped or failed.
    Ended(StopCause),
}

impl RunReason {
    /// Name in interfaces.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Connecting => "connecting",
            Self::AwaitsArm => "awaits_arm",
            Self::AwaitsStart => "awaits_start",
            Self::UnderWay => "under_way",
            Self::Paused(cause) => cause.code(),
            Self::Stopping(_) => "stopping",
            Self::AllSteps => "all_steps",
            Self::Read => "read",
            Self::Ended(cause) => cause.code(),
        }
    }
}

impl fmt::Display for RunReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connecting => write!(f, "connects to the devices and checks the program"),
            Self::AwaitsArm => write!(f, "waits for an operator to arm it"),
            Self::AwaitsStart => write!(f, "is armed and waits for its first step"),
            Self::UnderWay => write!(f, "carries out its steps"),
            Self::Paused(cause) => write!(f, "{cause}; {}", cause.next()),
            Self::Stopping(None) => write!(f, "stops for a pause; {AWAITS_REST}"),
            Self::Stopping(Some(cause)) => write!(f, "stops; {AWAITS_REST}. Cause: {cause}"),
            Self::AllSteps => write!(f, "every step is done"),
            Self::Read => write!(f, "the devices were read; nothing was moved"),
            Self::Ended(cause) => write!(f, "{cause}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::CalibrationObjection;
    use crate::execution::session::lease::Fence;

    /// Ctrl-C on the command line was told as "a client asked for it".
    #[test]
    fn a_stop_and_a_pause_on_request_are_told_alike_whoever_asks() {
        let [stop, pause] = [RunReason::Ended(StopCause::Client), RunReason::Paused(PauseCause::Client)];
        assert_eq!((stop.to_string().as_str(), stop.code()), ("a stop was requested", "by_client"));
        assert_eq!((pause.to_string().as_str(), pause.code()), ("a pause was requested; resume to go on", "by_client"));
    }

    /// "A stop was sent" was told of a stop for which no connection was left.
    #[test]
    fn a_run_that_is_being_stopped_does_not_claim_that_a_stop_was_sent() {
        for cause in [None, Some(StopCause::Client)] {
            let told = RunReason::Stopping(cause).to_string();
            assert!(told.starts_with("stops") && told.contains("keep clear") && !told.contains("sent"), "{told}");
        }
    }

    /// The axis of the table was "axis 7", and what to do next was left open.
    #[test]
    fn each_end_names_its_device_and_says_what_to_do_next() {
        let silent = DeviceError::Silent { waited: Duration::from_millis(200) };
        let reason = "the scanner is off".to_owned();
        let untaken = PauseCause::Trigger { step: 2, view: 7, error: DeviceError::NotReady { reason } };
        for (cause, device) in [
            (StopCause::OffPath { axis: 7, off_deg: 6.0, allowed_deg: 5.0 }, "the table is 6.00° from"),
            (StopCause::OffPath { axis: 2, off_deg: 6.0, allowed_deg: 5.0 }, "axis 2 of the arm is"),
            (StopCause::NotReached { axis: 7, off_deg: 0.5 }, "the table stays 0.500° off"),
            (StopCause::NotReached { axis: 6, off_deg: 0.5 }, "axis 6 of the arm stays"),
            (StopCause::HeartbeatLost { after: Duration::from_millis(600) }, "the client"),
            (StopCause::LeaseLost(LeaseError::Expired { cell: "one".to_owned(), token: Fence(1) }), "cell one"),
            (StopCause::EmergencyStop(DeviceRole::Table), "the table"),
            (StopCause::GuardOpen(DeviceRole::Arm), "the arm"),
            (StopCause::HandGuided(DeviceRole::Arm), "the arm"),
            (StopCause::HeldAtDevice(DeviceRole::Arm), "the arm"),
            (StopCause::PowerLost(DeviceRole::Table), "the table"),
            (
                StopCause::Stale { device: DeviceRole::Table, age: Duration::from_secs(1), by_reply_timeout: false },
                "no state of the table for 1000 ms",
            ),
            (
                StopCause::Stale { device: DeviceRole::Arm, age: Duration::from_millis(200), by_reply_timeout: true },
                "no reply of the arm within its reply_timeout_ms = 200 ms",
            ),
            (
                StopCause::Unattended(untaken),
                "viewpoint 7 (step 2) was not acknowledged: the device is not ready: the scanner is off",
            ),
            (StopCause::Device { device: DeviceRole::Trigger, error: silent }, "trigger: no answer within 200 ms"),
            (StopCause::Fault { device: DeviceRole::Arm, code: 5, text: None }, "the arm"),
            (StopCause::Objections(vec![Objection::Moves(DeviceRole::Table)]), "the table"),
            (StopCause::Objections(vec![Objection::OutsideLimits { axis: 7, angle_deg: 400.0 }]), "the table would go to"),
            (StopCause::Objections(vec![Objection::TooFast { axis: 3 }]), "axis 3 of the arm would be quicker"),
            (StopCause::Objections(vec![Objection::OutsideWorkspace { at_mm: [1.0, 2.0, 3.0] }]), "[1, 2, 3] mm"),
            (StopCause::Objections(vec![Objection::NoSuchStep { step: 9, steps: 3 }]), "no step 9"),
            (StopCause::Objections(vec![Objection::Calibration(CalibrationObjection::OtherPose)]), "flange_from_scanner"),
            (StopCause::Audit("full".to_owned()), "the audit log"),
            (StopCause::Internal("a panic".to_owned()), "this program's own"),
        ] {
            let told = cause.to_string();
            let next = told.split_once("; ").map(|(_, next)| next.trim());
            assert!(told.contains(device) && next.is_some_and(|next| !next.is_empty()), "{told}");
        }
    }
}
