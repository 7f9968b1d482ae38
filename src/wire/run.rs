//! Runs of a program on the controllers of a cell, or on a twin of them: requests, states, events and what was measured.
//!
//! Vantage is not safety-rated. Its stop asks a controller to stop in order; it is not an emergency stop.

mod convert;
mod event;
mod lease;
mod record;
mod request;
mod sample;

use std::str::FromStr;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use event::{RunEventDocument, RunEventKind};
pub use lease::{HeldLease, LeaseDocument, LeaseList, LeaseRequest};
pub use record::{RUN_RECORD_SCHEMA, RunCoverage, RunRecordDocument, RunStepOp, RunStepRecord};
pub use request::{ArmRequest, LocatedRequest, OverrideRequest, RunRequest};
pub use sample::{ConfigurationDocument, RunSample};

use super::ids::{JobId, RunId};
use super::utc_time::UtcTime;
use crate::cell::closed_list;

/// Sentence that stands wherever a robot may move.
pub const NOT_SAFETY_RATED: &str =
    "Vantage is not safety-rated, and its stop is not an emergency stop: keep the cell's own safety system active.";

closed_list! {
    /// Things that a run moves.
    pub enum RunMode {
        /// A kinematic twin of arm and table; no controller is connected.
        Simulate = "simulate",
        /// Nothing: controllers are connected and read, and no motion is sent.
        DryRun = "dry_run",
        /// Arm and table.
        Live = "live",
    }
}

closed_list! {
    /// State of a run.
    pub enum ReportedState {
        /// The program is checked, the devices are connected.
        Preparing = "preparing",
        /// Waits to be armed by the operator.
        Ready = "ready",
        /// Was armed, and is about to move.
        Armed = "armed",
        /// Carries out its steps.
        Running = "running",
        /// Holds at the end of a step or where it stopped, until it is resumed.
        Paused = "paused",
        /// Ended after its last step.
        Done = "done",
        /// Ended by a stop, in order.
        Stopped = "stopped",
        /// Ended by a fault.
        Failed = "failed",
    }
}

impl ReportedState {
    /// Returns true if the run has ended, in whichever way.
    #[must_use]
    pub fn is_ended(self) -> bool {
        match self {
            Self::Done | Self::Stopped | Self::Failed => true,
            Self::Preparing | Self::Ready | Self::Armed | Self::Running | Self::Paused => false,
        }
    }
}

impl FromStr for ReportedState {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|state| state.as_str() == text).ok_or_else(|| format!("unknown state of a run {text:?}"))
    }
}

impl FromStr for RunMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|mode| mode.as_str() == text)
            .ok_or_else(|| format!("unknown mode of a run {text:?}; use one of {}", Self::ALL.map(Self::as_str).join(", ")))
    }
}

closed_list! {
    /// Reason for which a run is in its state.
    pub enum ReportedReason {
        /// Preparing: connects to the devices and checks the program.
        Connecting = "connecting",
        /// Ready: an operator has to arm it.
        AwaitsArm = "awaits_arm",
        /// Armed: waits for its first step.
        AwaitsStart = "awaits_start",
        /// Running: carries out its steps.
        UnderWay = "under_way",
        /// A client asked for it.
        ByClient = "by_client",
        /// Paused: it was asked to pause after each step.
        SingleStep = "single_step",
        /// Paused, or stopped as nobody could resume: the scanner did not acknowledge a capture in time; the view is not skipped.
        TriggerSilent = "trigger_silent",
        /// Paused: the locating scan is taken, and the part's pose is awaited.
        Locating = "locating",
        /// A stop is asked for, to end or to pause the run, and arm and table are not yet known to be at rest: keep clear.
        Stopping = "stopping",
        /// Done: every step.
        AllSteps = "all_steps",
        /// Done: the devices were read, and nothing was moved.
        Read = "read",
        /// The client's heartbeat stayed away.
        HeartbeatLost = "heartbeat_lost",
        /// The lease of the cell was not renewed in time, or was given back.
        LeaseLost = "lease_lost",
        /// The server shut down while the run was under way.
        ServerGone = "server_gone",
        /// The server was restarted while the run was under way; it is never resumed by itself.
        ServerRestarted = "server_restarted",
        /// Armed, and not told to move for too long.
        ArmExpired = "arm_expired",
        /// An emergency stop is pressed.
        EmergencyStop = "emergency_stop",
        /// A guard is open.
        GuardOpen = "guard_open",
        /// A device is guided by hand.
        HandGuided = "hand_guided",
        /// A device is paused at its own controller.
        HeldAtDevice = "held_at_device",
        /// A device has no power, or its brakes are closed.
        PowerLost = "power_lost",
        /// The state of a device is too old.
        StateStale = "state_stale",
        /// The audit log cannot be written.
        AuditFailed = "audit_failed",
        /// The part lies too far from where the plan has it.
        PartMisplaced = "part_misplaced",
        /// The link to a device was lost, or it answers what it should not.
        DeviceError = "device_error",
        /// A device reports a fault.
        DeviceFault = "device_fault",
        /// Conditions for motion are not met.
        NotAllowed = "not_allowed",
        /// An axis left its straight way.
        OffPath = "off_path",
        /// An axis did not get to its target.
        NotReached = "not_reached",
        /// The program does not pass the checks.
        ProgramRefused = "program_refused",
        /// The server is at fault; its log has the cause.
        Internal = "internal",
    }
}

impl FromStr for ReportedReason {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|reason| reason.as_str() == text).ok_or_else(|| format!("unknown reason of a run {text:?}"))
    }
}

/// A run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Run {
    /// Id of the run.
    pub id: RunId,
    /// State of the run.
    pub state: ReportedState,
    /// Reason for its state.
    pub reason: ReportedReason,
    /// Reason in words, with what to do; `null` where there is nothing to add.
    pub detail: Option<String>,
    /// Mode: what the run moves.
    pub mode: RunMode,
    /// Id of the job whose program it carries out; `null` for a run of the command line.
    pub job_id: Option<JobId>,
    /// Setup of the plan, from 0.
    pub setup: usize,
    /// Name of the cell.
    pub cell: String,
    /// SHA-256 of the plan, lower-case hexadecimal.
    pub plan_sha256: String,
    /// SHA-256 of the program, lower-case hexadecimal.
    pub program_sha256: String,
    /// Share of the program's speed at which it moves.
    pub speed_override: f64,
    /// Speed of the twin's clock, real time = 1; only in the mode `simulate`.
    pub time_factor: f64,
    /// True if it pauses after each step.
    pub single_step: bool,
    /// Step that it began with, from 0.
    pub from_step: usize,
    /// True if it begins with a locating scan.
    pub locate: bool,
    /// Step that it is at, or that comes next, from 0; the number of steps once it is done.
    pub step: usize,
    /// Number of steps of the program.
    pub steps: usize,
    /// Number of scans acknowledged.
    pub scans: usize,
    /// Predicted time of the whole program at full speed, s.
    pub planned_secs: f64,
    /// Time that the finished steps have taken, s; not that of a step under way or cut short. Of the twin's clock in the mode
    /// `simulate`, with the host's own work at its real duration.
    pub elapsed_secs: f64,
    /// Stop that ends it or has ended it, as far as it has got; `null` if there was none.
    pub stop: Option<RunStop>,
    /// Devices that it was connected to; `null` before.
    pub devices: Option<RunDevices>,
    /// Conditions for motion that a dry run found unmet.
    pub objections: Vec<String>,
    /// Jitter of streamed set points; `null` where none were streamed.
    pub jitter: Option<RunJitter>,
    /// Joints and table angle that were measured last, once the run has ended: where it left arm and table. `null` before that,
    /// if nothing was measured, and for a run that a restart of the server interrupted; its record has those of the last step.
    pub last_measured: Option<ConfigurationDocument>,
    /// Coverage at the measured poses beside the plan's, once the run is done.
    pub coverage: Option<RunCoverage>,
    /// End of its audit log, once the run has ended; `null` if no log is kept. It reveals a log whose last entries are missing.
    /// For a run that a restart interrupted, it is the last complete entry that was then on the disk.
    pub audit: Option<RunAudit>,
    /// Operator who armed it; `null` if nobody did.
    pub armed_by: Option<String>,
    /// Name of the key with which it was started; `null` without a key.
    pub submitted_by: Option<String>,
    /// Time at which it was accepted, UTC.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Time at which it ended, UTC; `null` before.
    #[schema(format = DateTime)]
    pub ended_at: Option<String>,
    /// Reminder for the operator: this software is not safety-rated.
    pub notice: String,
}

/// End of the audit log of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct RunAudit {
    /// Number of the last entry, from 1.
    pub lines: u64,
    /// SHA-256 of its line without the line break, lower-case hexadecimal.
    pub sha256: String,
}

/// Stop that ends a run, as each device carries it out; `null` for a device that had nothing to stop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RunStop {
    /// The arm.
    pub arm: Option<DeviceStopDocument>,
    /// The table.
    pub table: Option<DeviceStopDocument>,
}

/// Stop of a device, with the time from the request to each stage; `null` for a stage that was not reached.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeviceStopDocument {
    /// The request was first put on the wire, acknowledged or not, ms.
    pub sent_ms: Option<f64>,
    /// The controller acknowledged it, ms.
    pub acknowledged_ms: Option<f64>,
    /// The device was measured at rest, ms.
    pub at_rest_ms: Option<f64>,
    /// Fault of the stop; `null` if there was none.
    pub error: Option<String>,
}

/// Devices that a run was connected to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RunDevices {
    /// The arm's controller.
    pub arm: DeviceIdentity,
    /// The table's controller; that of the arm if it turns the table.
    pub table: DeviceIdentity,
}

/// Identity of a controller, as reported by itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DeviceIdentity {
    /// Maker.
    pub maker: String,
    /// Model.
    pub model: String,
    /// Serial number, if reported.
    pub serial: Option<String>,
    /// Firmware version, if reported.
    pub firmware: Option<String>,
}

/// Deviations of the periods between streamed set points from the requested period.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RunJitter {
    /// Requested period, ms.
    pub period_ms: f64,
    /// Number of periods.
    pub periods: u64,
    /// Number of missed deadlines.
    pub missed: u64,
    /// Deviation that half of the periods do not exceed, ms.
    pub p50_ms: f64,
    /// Deviation that 99 % of the periods do not exceed, ms.
    pub p99_ms: f64,
    /// Deviation that 99.9 % of the periods do not exceed, ms.
    pub p999_ms: f64,
    /// Largest deviation, ms.
    pub max_ms: f64,
}

/// A page of runs, newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RunPage {
    /// Runs on this page.
    pub items: Vec<Run>,
    /// Token of the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_page_token: Option<String>,
}

/// Runs that all of the given fields fit.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RunSelection {
    /// State.
    pub state: Option<ReportedState>,
    /// Mode.
    pub mode: Option<RunMode>,
    /// Name of the cell.
    pub cell: Option<String>,
    /// The job.
    pub job_id: Option<JobId>,
    /// Accepted at this time or later.
    pub created_after: Option<UtcTime>,
    /// Accepted before this time.
    pub created_before: Option<UtcTime>,
}

#[cfg(test)]
mod tests;
