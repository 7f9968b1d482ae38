//! From the words of a session to those of the interfaces.

use std::time::Duration;

use super::{DeviceIdentity, DeviceStopDocument, RunDevices, RunMode, RunReason, RunState, RunStepOp, RunStepRecord, RunStop};
use crate::execution::device::Identity;
use crate::execution::record::{DeviceStop, StepKind, StepRecord, StopReport};
use crate::execution::session::{self, Identities, Mode};

impl From<session::RunState> for RunState {
    fn from(state: session::RunState) -> Self {
        match state {
            session::RunState::Preparing => Self::Preparing,
            session::RunState::Ready => Self::Ready,
            session::RunState::Armed => Self::Armed,
            session::RunState::Running => Self::Running,
            session::RunState::Paused => Self::Paused,
            session::RunState::Done => Self::Done,
            session::RunState::Stopped => Self::Stopped,
            session::RunState::Failed => Self::Failed,
        }
    }
}

impl From<Mode> for RunMode {
    fn from(mode: Mode) -> Self {
        match mode {
            Mode::Simulate => Self::Simulate,
            Mode::DryRun => Self::DryRun,
            Mode::Live => Self::Live,
        }
    }
}

impl RunReason {
    /// The reason by its name in the session; one that is not known here is internal.
    #[must_use]
    pub fn of(reason: &session::RunReason) -> Self {
        reason.code().parse().unwrap_or(Self::Internal)
    }
}

impl From<&Identities> for RunDevices {
    fn from(identities: &Identities) -> Self {
        Self { arm: (&identities.arm).into(), table: (&identities.table).into() }
    }
}

impl From<&Identity> for DeviceIdentity {
    fn from(identity: &Identity) -> Self {
        let Identity { maker, model, serial, firmware } = identity.clone();
        Self { maker, model, serial, firmware }
    }
}

impl From<&StopReport> for RunStop {
    fn from(report: &StopReport) -> Self {
        Self { arm: report.arm.as_ref().map(Into::into), table: report.table.as_ref().map(Into::into) }
    }
}

impl From<&DeviceStop> for DeviceStopDocument {
    fn from(stop: &DeviceStop) -> Self {
        let [sent_ms, acknowledged_ms, at_rest_ms] = [stop.sent, stop.acknowledged, stop.at_rest].map(|time| time.map(millis));
        Self { sent_ms, acknowledged_ms, at_rest_ms, error: stop.error.clone() }
    }
}

impl From<StepKind> for RunStepOp {
    fn from(kind: StepKind) -> Self {
        match kind {
            StepKind::Move => Self::MoveJoints,
            StepKind::Settle => Self::Settle,
            StepKind::Scan => Self::Scan,
            StepKind::Locate => Self::Locate,
        }
    }
}

impl From<&StepRecord> for RunStepRecord {
    fn from(step: &StepRecord) -> Self {
        Self {
            step: step.step,
            op: step.kind.into(),
            viewpoint: step.view.map(|view| view.0),
            commanded: (&step.commanded).into(),
            measured: (&step.measured).into(),
            axis_deviation_deg: step.deviation.max_axis_deg,
            optical_axis_deviation_deg: step.deviation.optical_axis_deg,
            position_deviation_mm: step.deviation.position_mm,
            planned_secs: step.planned_secs,
            actual_secs: step.real_secs,
            attempts: step.attempts,
            capture_secs: step.capture_took.map(|took| took.as_secs_f64()),
            capture_id: step.capture_id.clone(),
        }
    }
}

fn millis(time: Duration) -> f64 {
    1000.0 * time.as_secs_f64()
}
