//! Record of a run: for each step where the scanner was meant to be and where it was measured, and planned and real times; how the
//! run ended. Coverage at the measured poses is evaluated by the reference engine of planning.

use std::time::Duration;

use super::session::streamer::Jitter;
use super::session::{Identities, Mode, RunReason, RunState, RunStatus, StopCause};
use crate::cell::{Cell, Configuration};
use crate::geometry::{Part, Pose, Table, plate_from_placed};
use crate::planning::PlanInput;
use crate::planning::certificate::recheck::{self, Measured, TakenView};
use crate::planning::context::{Context, PlanError};
use crate::planning::params::PlanParams;
use crate::planning::plan::ViewId;

/// Kinds of steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepKind {
    /// Motion.
    Move,
    /// Standstill before a capture.
    Settle,
    /// Capture.
    Scan,
    /// Capture by which the part is located, before its step.
    Locate,
}

impl StepKind {
    /// Name in interfaces.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Move => "move",
            Self::Settle => "settle",
            Self::Scan => "scan",
            Self::Locate => "locate",
        }
    }
}

/// Distance of where the scanner was measured from where it was meant to be, as the plate sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseDeviation {
    /// Angle between the optical axes, degrees.
    pub optical_axis_deg: f64,
    /// Distance, mm.
    pub position_mm: f64,
    /// Largest turn of any axis, degrees.
    pub max_axis_deg: f64,
}

impl PoseDeviation {
    /// Deviation of a measured configuration.
    #[must_use]
    pub fn of(cell: &Cell, commanded: &Configuration, measured: &Configuration) -> Self {
        let [meant, found] = [commanded, measured].map(|configuration| cell.plate_from_scanner(configuration));
        let [meant_axis, found_axis] = [&meant, &found].map(|pose| pose.direction(&nalgebra::Vector3::z()));
        // Exact for small angles, where the cosine is not.
        let angle_rad = meant_axis.cross(&found_axis).norm().atan2(meant_axis.dot(&found_axis));
        Self {
            optical_axis_deg: angle_rad.to_degrees(),
            position_mm: (found.origin_mm() - meant.origin_mm()).norm(),
            max_axis_deg: commanded.max_turn_rad(measured).to_degrees(),
        }
    }
}

/// A step that was carried out.
#[derive(Clone, Debug, PartialEq)]
pub struct StepRecord {
    /// Number in the program, from 0.
    pub step: usize,
    /// Kind.
    pub kind: StepKind,
    /// View of a capture.
    pub view: Option<ViewId>,
    /// Commanded configuration at its end.
    pub commanded: Configuration,
    /// Measured configuration at its end; of a capture, when it was triggered.
    pub measured: Configuration,
    /// Distance of the measured configuration from the commanded one.
    pub deviation: PoseDeviation,
    /// Predicted time, at the program's speed.
    pub planned_secs: f64,
    /// Real time without pauses; of a simulated run, in the twin's time, with the host's own work at its real duration.
    pub real_secs: f64,
    /// Number of times that it was begun.
    pub attempts: u32,
    /// Name that the scanner gave a capture.
    pub capture_id: Option<String>,
    /// Time from trigger to acknowledgement.
    pub capture_took: Option<Duration>,
}

/// Times of the stop of a device, each since the stop was asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviceStop {
    /// Last byte of the first request handed to the wire, acknowledged or not.
    pub sent: Option<Duration>,
    /// Acknowledgement read.
    pub acknowledged: Option<Duration>,
    /// Found at rest in two states in a row.
    pub at_rest: Option<Duration>,
    /// Words of what went wrong with it.
    pub error: Option<String>,
}

/// Stop of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct StopReport {
    /// Cause.
    pub cause: StopCause,
    /// Time since the run was made at which it was asked for, seconds.
    pub asked_secs: f64,
    /// The arm's; `None` where nothing was armed, and nothing had to be stopped.
    pub arm: Option<DeviceStop>,
    /// The table's.
    pub table: Option<DeviceStop>,
}

/// Record of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct RunRecord {
    /// Status that it ended in.
    pub status: RunStatus,
    /// Mode.
    pub mode: Mode,
    /// Devices that were there.
    pub identities: Option<Identities>,
    /// Steps carried out, in the order of time.
    pub steps: Vec<StepRecord>,
    /// Step at which it ended, from 0: the one to begin from again.
    pub next_step: usize,
    /// Predicted time of the steps carried out.
    pub planned_secs: f64,
    /// Real time of the steps carried out.
    pub real_secs: f64,
    /// Speed override that it ended with.
    pub speed_override: f64,
    /// Stop that ended it.
    pub stop: Option<StopReport>,
    /// Objections that a dry run found to motion as things stand.
    pub objections: Vec<StopCause>,
    /// Measured configuration that it ended in, as far as it is known.
    pub last_measured: Option<Configuration>,
    /// Pose of the part that a locating scan found.
    pub located: Option<Pose<Table, Part>>,
    /// Jitter of streamed set points.
    pub jitter: Option<Jitter>,
}

impl RunRecord {
    /// Record of a run of which nothing is known but its status.
    #[must_use]
    pub fn lost(status: RunStatus) -> Self {
        let cause = StopCause::Internal("its task is gone".into());
        let status =
            if status.state.is_final() { status } else { RunStatus { state: RunState::Failed, reason: RunReason::Ended(cause) } };
        Self {
            status,
            mode: Mode::Simulate,
            identities: None,
            steps: Vec::new(),
            next_step: 0,
            planned_secs: 0.0,
            real_secs: 0.0,
            speed_override: 1.0,
            stop: None,
            objections: Vec::new(),
            last_measured: None,
            located: None,
            jitter: None,
        }
    }

    /// Captures in order.
    pub fn scans(&self) -> impl Iterator<Item = &StepRecord> {
        self.steps.iter().filter(|step| step.kind == StepKind::Scan)
    }

    /// Largest deviation of any capture, each figure for itself.
    #[must_use]
    pub fn max_deviation(&self) -> PoseDeviation {
        self.scans().fold(PoseDeviation::default(), |most, scan| PoseDeviation {
            optical_axis_deg: most.optical_axis_deg.max(scan.deviation.optical_axis_deg),
            position_mm: most.position_mm.max(scan.deviation.position_mm),
            max_axis_deg: most.max_axis_deg.max(scan.deviation.max_axis_deg),
        })
    }

    /// Views as they were taken, from the measured poses.
    #[must_use]
    pub fn taken_views(&self, cell: &Cell, table_from_part: &Pose<Table, Part>) -> Vec<TakenView> {
        let part_from_plate = plate_from_placed(table_from_part).inverse();
        let view = |scan: &StepRecord| TakenView {
            part_from_scanner: part_from_plate * cell.plate_from_scanner(&scan.measured),
            table_rad: Some(scan.measured.table_rad),
        };
        self.scans().map(view).collect()
    }

    /// Area that the captures measure from where they were really taken; beside the plan's `measured_area_mm2`.
    ///
    /// # Errors
    /// [`recheck::measured_in_cell`].
    pub fn measured(
        &self,
        input: &PlanInput<'_>,
        params: &PlanParams,
        cell: &Cell,
        table_from_part: &Pose<Table, Part>,
        ctx: &Context<'_>,
    ) -> Result<Measured, PlanError> {
        let lies = self.located.as_ref().unwrap_or(table_from_part);
        recheck::measured_in_cell(input, params, lies, &self.taken_views(cell, lies), ctx)
    }
}

#[cfg(test)]
mod tests;
