//! Record of a run, schema `vantage.run/1`: each step as commanded and as measured.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{ConfigurationDocument, Run};
use crate::cell::closed_list;
use crate::wire::csv::Csv;
use crate::wire::schema_name::schema_name;

/// Schema name in the document.
pub const RUN_RECORD_SCHEMA: &str = "vantage.run/1";

schema_name!(RunRecordSchema, RUN_RECORD_SCHEMA);

closed_list! {
    /// Kind of a step.
    pub enum RunStepOp {
        /// Arm and table move.
        MoveJoints = "move_joints",
        /// Everything stands still.
        Settle = "settle",
        /// The scanner captures.
        Scan = "scan",
        /// The scanner captures so that the part can be located; before its step.
        Locate = "locate",
    }
}

/// Record of a run: what was commanded and what was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RunRecordDocument {
    /// Schema name, `vantage.run/1`.
    #[schema(value_type = RunRecordSchema)]
    pub schema: String,
    /// The run.
    pub run: Run,
    /// Steps that were completed, in order.
    pub steps: Vec<RunStepRecord>,
}

/// A step that was completed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RunStepRecord {
    /// Number of the step in the program, from 0.
    pub step: usize,
    /// Kind of the step.
    pub op: RunStepOp,
    /// Id of the viewpoint in the plan, for a scan.
    pub viewpoint: Option<u32>,
    /// Joints and table angle where it ends, as commanded.
    pub commanded: ConfigurationDocument,
    /// Joints and table angle where it ended, as measured.
    pub measured: ConfigurationDocument,
    /// Largest deviation of an axis from its command, degrees.
    pub axis_deviation_deg: f64,
    /// Angle between the optical axis as measured and as commanded, degrees.
    pub optical_axis_deviation_deg: f64,
    /// Distance of the scanner from its commanded place relative to the table, mm.
    pub position_deviation_mm: f64,
    /// Predicted time at the program's speed, s.
    pub planned_secs: f64,
    /// Time that it took, without pauses, s; of the twin's clock in the mode `simulate`, with the host's own work at its
    /// real duration.
    pub actual_secs: f64,
    /// Number of times that it was begun.
    pub attempts: u32,
    /// Time from the trigger to its acknowledgement, s, for a scan.
    pub capture_secs: Option<f64>,
    /// Name that the scanner gave the capture, if it gave one.
    pub capture_id: Option<String>,
}

/// Coverage at the measured poses, on the samples that the views were chosen on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RunCoverage {
    /// Share of the asked area that the plan says the setup measures.
    pub planned_of_asked: f64,
    /// Share of the asked area that the scans measure from the measured poses.
    pub measured_of_asked: f64,
}

impl RunRecordDocument {
    /// A table of the steps as CSV (RFC 4180).
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut csv = Csv::new(&[
            "step",
            "op",
            "viewpoint",
            "commanded_j1_deg",
            "commanded_j2_deg",
            "commanded_j3_deg",
            "commanded_j4_deg",
            "commanded_j5_deg",
            "commanded_j6_deg",
            "commanded_table_deg",
            "measured_j1_deg",
            "measured_j2_deg",
            "measured_j3_deg",
            "measured_j4_deg",
            "measured_j5_deg",
            "measured_j6_deg",
            "measured_table_deg",
            "axis_deviation_deg",
            "optical_axis_deviation_deg",
            "position_deviation_mm",
            "planned_secs",
            "actual_secs",
            "attempts",
            "capture_secs",
            "capture_id",
        ]);
        self.steps.iter().for_each(|step| step.write(&mut csv));
        csv.finish()
    }
}

impl RunStepRecord {
    fn write(&self, csv: &mut Csv) {
        csv.number(self.step);
        csv.number(self.op.as_str());
        csv.optional(self.viewpoint);
        for ConfigurationDocument { joints_deg, table_angle_deg } in [&self.commanded, &self.measured] {
            joints_deg.iter().for_each(|joint| csv.number(joint));
            csv.number(table_angle_deg);
        }
        let deviations = [self.axis_deviation_deg, self.optical_axis_deviation_deg, self.position_deviation_mm];
        deviations.iter().chain(&[self.planned_secs, self.actual_secs]).for_each(|value| csv.number(value));
        csv.number(self.attempts);
        csv.optional(self.capture_secs);
        csv.text(self.capture_id.as_deref().unwrap_or_default());
        csv.end_row();
    }
}
