//! Requests for runs.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::RunMode;
use crate::cell::{FieldError, Findings, PoseInput, PoseSpec, field_ranges};
use crate::execution::session::OVERRIDES;
use crate::wire::ids::JobId;
use crate::wire::words::is_control;

/// Setups of a plan at most.
const MAX_SETUPS: f64 = 4.0;
/// Steps of a program at most.
const MAX_STEPS: f64 = 1e6;
/// Smallest and largest speed override.
const OVERRIDE_RANGE: [f64; 2] = [*OVERRIDES.start(), *OVERRIDES.end()];

/// A request for a run. Controllers, their addresses and their limits come from the operator's cell file alone. Unknown fields are
/// refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct RunRequest {
    /// Id of the job whose program is carried out; it must have succeeded.
    pub job_id: JobId,
    /// Setup of the plan, from 0 to 3. Default 0.
    #[serde(default)]
    pub setup: usize,
    /// Mode: what the run moves. Default `simulate`.
    #[serde(default = "default_mode")]
    pub mode: RunMode,
    /// Share of the program's speed at which it moves, 0.01 to 1. Default 1; the first live run is capped by the cell file.
    #[serde(default = "default_one")]
    pub speed_override: f64,
    /// Speed of the twin's clock, 1 to 100, real time = 1; only in the mode `simulate`. Default 1.
    #[serde(default = "default_one")]
    pub time_factor: f64,
    /// True to pause after each step. Default false.
    #[serde(default)]
    pub single_step: bool,
    /// Step to begin with, from 0: after a stop, the step that the stopped run was at. The measured pose is checked anew.
    #[serde(default)]
    pub from_step: usize,
    /// True to begin with a locating scan: an additional capture at the first viewpoint, after which the run waits to be told
    /// where the part lies (`POST /runs/{id}/located`). Default false.
    #[serde(default)]
    pub locate: bool,
    /// Temperature in the cell, °C, -50 to 100. A calibration that is valid only at other temperatures is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
}

fn default_mode() -> RunMode {
    RunMode::Simulate
}

fn default_one() -> f64 {
    1.0
}

field_ranges! {
    RunRequest {
        SETUP = "setup", [0.0, MAX_SETUPS - 1.0] "";
        SPEED_OVERRIDE = "speed_override", [OVERRIDE_RANGE[0], OVERRIDE_RANGE[1]] "";
        TIME_FACTOR = "time_factor", [1.0, 100.0] "";
        FROM_STEP = "from_step", [0.0, MAX_STEPS] "";
        TEMPERATURE_C = "temperature_c", [-50.0, 100.0] "°C";
    }
}

impl RunRequest {
    /// A request with the default of every field but the job.
    #[must_use]
    pub fn new(job_id: JobId) -> Self {
        let (mode, one) = (default_mode(), default_one());
        Self {
            job_id,
            setup: 0,
            mode,
            speed_override: one,
            time_factor: one,
            single_step: false,
            from_step: 0,
            locate: false,
            temperature_c: None,
        }
    }

    /// Checks the range of every field.
    ///
    /// # Errors
    /// All invalid fields.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        Self::SETUP.check("", &self.setup, &mut findings);
        Self::SPEED_OVERRIDE.check("", &self.speed_override, &mut findings);
        Self::TIME_FACTOR.check("", &self.time_factor, &mut findings);
        Self::FROM_STEP.check("", &self.from_step, &mut findings);
        Self::TEMPERATURE_C.check("", &self.temperature_c, &mut findings);
        let is_real = self.time_factor.total_cmp(&1.0).is_eq() || self.mode == RunMode::Simulate;
        findings.require(is_real, "/time_factor", || {
            format!("is {}; allowed is 1 in the mode {}, whose clock is real", self.time_factor, self.mode.as_str())
        });
        findings.into_result()
    }
}

/// Release of motion by the operator at the cell. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ArmRequest {
    /// Name of the operator, 1 to 128 characters.
    #[schema(min_length = 1, max_length = 128)]
    pub operator: String,
    /// Name of the cell, written by the operator: it must be that of the run.
    #[schema(min_length = 1, max_length = 128)]
    pub cell: String,
}

impl ArmRequest {
    /// Checks the lengths of the names.
    ///
    /// # Errors
    /// All invalid fields.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        for (pointer, text) in [("/operator", &self.operator), ("/cell", &self.cell)] {
            let is_name = (1..=128).contains(&text.chars().count()) && !text.chars().any(is_control) && !text.trim().is_empty();
            findings.require(is_name, pointer, || {
                "must have 1 to 128 characters, not all of them blank and none a control character".to_owned()
            });
        }
        findings.into_result()
    }
}

/// Speed of a run that is under way; it takes effect with the next segment. Unknown fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct OverrideRequest {
    /// Share of the program's speed, 0.01 to 1.
    pub speed_override: f64,
}

field_ranges! {
    OverrideRequest {
        SPEED_OVERRIDE = "speed_override", [OVERRIDE_RANGE[0], OVERRIDE_RANGE[1]] "";
    }
}

impl OverrideRequest {
    /// Checks the range.
    ///
    /// # Errors
    /// The finding.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        Self::SPEED_OVERRIDE.check("", &self.speed_override, &mut findings);
        findings.into_result()
    }
}

/// The part as a locating scan found it. Unknown fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct LocatedRequest {
    /// Pose of the part on the table, at table angle zero.
    #[schema(value_type = PoseInput)]
    pub table_from_part: PoseSpec,
}
