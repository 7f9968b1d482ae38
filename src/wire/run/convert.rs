//! Words of the interfaces for those of a session.

use std::time::Duration;

use super::{
    DeviceIdentity, DeviceStopDocument, NOT_SAFETY_RATED, ReportedReason, ReportedState, Run, RunAudit, RunDevices, RunJitter,
    RunMode, RunRequest, RunStepOp, RunStepRecord, RunStop,
};
use crate::execution::audit::AuditHead;
use crate::execution::device::Identity;
use crate::execution::record::{DeviceStop, RunRecord, StepKind, StepRecord, StopReport};
use crate::execution::session::streamer::Jitter;
use crate::execution::session::{self, Identities, Mode};
use crate::program::Program;
use crate::wire::ids::{JobId, RunId};

impl From<session::RunState> for ReportedState {
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

impl ReportedReason {
    /// The reason by its name in the session; one that is not known here is internal.
    #[must_use]
    pub fn of(reason: &session::RunReason) -> Self {
        reason.code().parse().unwrap_or(Self::Internal)
    }
}

impl Run {
    /// A run that is about to begin: of a program with its hash, in a cell.
    #[must_use]
    pub fn new(request: &RunRequest, job_id: Option<JobId>, cell: &str, program: &Program, program_sha256: &str) -> Self {
        Self {
            id: RunId::generate(),
            state: ReportedState::Preparing,
            reason: ReportedReason::Connecting,
            detail: None,
            mode: request.mode,
            job_id,
            setup: program.setup,
            cell: cell.to_owned(),
            plan_sha256: program.plan_sha256.clone(),
            program_sha256: program_sha256.to_owned(),
            speed_override: request.speed_override,
            time_factor: request.time_factor,
            single_step: request.single_step,
            from_step: request.from_step,
            locate: request.locate,
            step: request.from_step,
            steps: program.steps.len(),
            scans: 0,
            planned_secs: program.cycle_secs,
            elapsed_secs: 0.0,
            stop: None,
            devices: None,
            objections: Vec::new(),
            jitter: None,
            last_measured: None,
            coverage: None,
            audit: None,
            armed_by: None,
            submitted_by: None,
            created_at: String::new(),
            ended_at: None,
            notice: NOT_SAFETY_RATED.to_owned(),
        }
    }

    /// Takes over how a session ended.
    pub fn conclude(&mut self, record: &RunRecord) {
        (self.state, self.reason) = (record.status.state.into(), ReportedReason::of(&record.status.reason));
        self.detail = Some(record.status.reason.to_string());
        (self.step, self.speed_override) = (record.next_step, record.speed_override);
        // Adding 0 turns −0, the sum of no steps, into 0.
        (self.scans, self.elapsed_secs) = (record.scans().count(), record.real_secs + 0.0);
        self.stop = record.stop.as_ref().map(Into::into);
        self.devices = record.identities.as_ref().map(Into::into);
        self.objections = record.objections.iter().map(ToString::to_string).collect();
        self.jitter = record.jitter.as_ref().map(Into::into);
        self.last_measured = record.last_measured.as_ref().map(Into::into);
    }
}

impl From<AuditHead> for RunAudit {
    fn from(AuditHead { lines, sha256 }: AuditHead) -> Self {
        Self { lines, sha256 }
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

impl From<&[DeviceStop; 2]> for RunStop {
    fn from([arm, table]: &[DeviceStop; 2]) -> Self {
        Self { arm: Some(arm.into()), table: Some(table.into()) }
    }
}

impl From<&DeviceStop> for DeviceStopDocument {
    fn from(stop: &DeviceStop) -> Self {
        let [sent_ms, acknowledged_ms, at_rest_ms] = [stop.sent, stop.acknowledged, stop.at_rest].map(|time| time.map(millis));
        Self { sent_ms, acknowledged_ms, at_rest_ms, error: stop.error.clone() }
    }
}

impl From<&Jitter> for RunJitter {
    fn from(jitter: &Jitter) -> Self {
        let [p50_ms, p99_ms, p999_ms] = [0.5, 0.99, 0.999].map(|share| millis(jitter.quantile(share)));
        let (period_ms, max_ms) = (millis(jitter.period), millis(jitter.max));
        Self { period_ms, periods: jitter.periods, missed: jitter.missed, p50_ms, p99_ms, p999_ms, max_ms }
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
