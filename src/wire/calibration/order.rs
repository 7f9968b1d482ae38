//! Calibrations over HTTP: the request, and the calibration as a resource.

use std::str::FromStr;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use utoipa::ToSchema;

use super::data::CalibrationData;
use super::result::{CalibrationDocument, FindingDocument, ResidualSummary};
use crate::cell::calibration::data::{HandEyeSetup, Solve};
use crate::cell::calibration::findings::{CalibrationFinding, Severity};
use crate::cell::calibration::watch::{CalibrationStage, CalibrationWatch, Unwatched};
use crate::cell::{CalibrationProvenance, Cell, CellSpec, FieldError, Findings, Named, PoseSpec, closed_list, field_ranges};
use crate::wire::warnings::{FieldWarning, WarningCode};
use crate::wire::{CalibrationId, JobProblem, VERSION_LINE, hex, json_file_bytes};

/// Largest number of observations that may be held out.
const MAX_HELD_OUT: f64 = 1000.0;
/// Largest distance of a calibrated pose from the cell's that is told by nothing, mm: of a cell that was measured by hand.
const MAX_SHIFT_MM: f64 = 50.0;
/// Largest turn of a calibrated pose against the cell's that is told by nothing, degrees.
const MAX_TURN_DEG: f64 = 5.0;

closed_list! {
    /// State of a calibration.
    pub enum CalibrationState {
        /// Waits for its turn.
        Queued = "queued",
        /// Is being computed.
        Running = "running",
        /// Has a result.
        Succeeded = "succeeded",
        /// Has none; `problem` says why.
        Failed = "failed",
        /// Was cancelled before it had a result.
        Cancelled = "cancelled",
    }
}

impl CalibrationState {
    /// Returns true for a state that does not change any more.
    #[must_use]
    pub fn is_ended(self) -> bool {
        match self {
            Self::Succeeded | Self::Failed | Self::Cancelled => true,
            Self::Queued | Self::Running => false,
        }
    }
}

impl FromStr for CalibrationState {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let found = Self::ALL.into_iter().find(|state| state.as_str() == text);
        found.ok_or_else(|| format!("unknown state of a calibration {text:?}"))
    }
}

fn default_cell() -> Named<CellSpec> {
    Named::Name("e05-transcan".into())
}

fn default_solve() -> Solve {
    Solve::Joint
}

/// Request for a calibration. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CalibrationRequest {
    /// Cell that was observed: name of a stored one, or a specification. Default `e05-transcan`.
    #[serde(default = "default_cell")]
    pub cell: Named<CellSpec>,
    /// Unknowns. Default `joint`.
    #[serde(default = "default_solve")]
    pub solve: Solve,
    /// Number of observations at the end of the list that are held out and predicted, 0 to 1000. Default 0.
    #[serde(default)]
    pub hold_out: u16,
    /// Observations: poses of arm, table and board that belong together.
    pub data: CalibrationData,
}

field_ranges! {
    CalibrationRequest {
        HOLD_OUT = "hold_out", [0.0, MAX_HELD_OUT] "";
    }
}

impl CalibrationRequest {
    /// Checks what the shape alone does not.
    ///
    /// # Errors
    /// Fields that are out of range.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        Self::HOLD_OUT.check("", &self.hold_out, &mut findings);
        findings.into_result()
    }
}

/// A calibration as the server keeps it. It never changes once it has ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationJob {
    /// Id.
    pub id: CalibrationId,
    /// State.
    pub state: CalibrationState,
    /// Name of the cell.
    pub cell: String,
    /// Unknowns.
    pub solve: Solve,
    /// Number of observations that are held out.
    pub hold_out: u16,
    /// Number of observations.
    pub observations: usize,
    /// SHA-256 of the observations, as compact JSON.
    pub data_sha256: String,
    /// Name of the key that its sender presented; `null` without keys.
    pub submitted_by: Option<String>,
    /// Time at which it was accepted, UTC.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Time at which it ended, UTC.
    #[schema(format = DateTime)]
    pub ended_at: Option<String>,
    /// Residuals of the observations used; `null` without a result.
    pub summary: Option<ResidualSummary>,
    /// Standard deviation of a scanned point at the depth of best focus, mm; `null` without a result.
    pub point_at_best_focus_sd_mm: Option<f64>,
    /// Remarks on the observations.
    pub findings: Vec<FindingDocument>,
    /// Warnings about poses that were found far from those of the cell (`/cell/flange_from_scanner`, `/cell/base_from_table`):
    /// the observations may be of another cell, or its base may differ from the controller's.
    #[serde(default)]
    pub warnings: Vec<FieldWarning>,
    /// Reason for a failure.
    pub problem: Option<JobProblem>,
    /// Stage of the computation; absent unless it is running.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stage: Option<CalibrationStage>,
}

/// A page of calibrations, newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationPage {
    /// Calibrations on this page.
    pub items: Vec<CalibrationJob>,
    /// Token of the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_page_token: Option<String>,
}

/// Calibrations that all of the given fields fit.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct CalibrationSelection {
    /// State.
    pub state: Option<CalibrationState>,
    /// Name of the cell.
    pub cell: Option<String>,
}

/// Reasons for which observations have no calibration.
#[derive(Clone, Debug)]
pub enum CalibrationError {
    /// Fields of the observations that cannot be read.
    Fields(Vec<FieldError>),
    /// Findings, one of which is an error.
    Findings(Vec<CalibrationFinding>),
    /// The calibration was cancelled.
    Cancelled,
}

impl CalibrationDocument {
    /// Calibrates a cell from observations, whose bytes have the digest `data_sha256`, at the time `now` (RFC 3339). The last
    /// `hold_out` observations are kept out and predicted.
    ///
    /// # Errors
    /// [`CalibrationError`].
    pub fn solved(
        data: &CalibrationData,
        cell: &Cell,
        (solve, hold_out): (Solve, usize),
        from: [&str; 2],
    ) -> Result<Self, CalibrationError> {
        Self::solved_watched(data, cell, (solve, hold_out), from, &Unwatched)
    }

    /// Calibrates as [`CalibrationDocument::solved`] does; `watch` is told of the stages and may end it.
    ///
    /// # Errors
    /// [`CalibrationError`].
    pub fn solved_watched(
        data: &CalibrationData,
        cell: &Cell,
        (solve, hold_out): (Solve, usize),
        [data_sha256, now]: [&str; 2],
        watch: &dyn CalibrationWatch,
    ) -> Result<Self, CalibrationError> {
        let (task, witness) = data.task(cell, solve, hold_out).map_err(CalibrationError::Fields)?;
        if witness.iter().any(|finding| finding.severity == Severity::Error) {
            return Err(CalibrationError::Findings(witness));
        }
        let found = task.calibrate_watched(watch);
        if watch.is_cancelled() {
            return Err(CalibrationError::Cancelled);
        }
        let mut found = found.map_err(CalibrationError::Findings)?;
        found.findings.splice(0..0, witness);
        let document = Self::new(&found, solve, data, cell, [data_sha256, now]);
        Ok(Self { id: hex(&Sha256::digest(json_file_bytes(&document))), ..document })
    }

    /// The cell with the calibrated poses, the runout of its turntable if that is written out, and their provenance; `None` with the setup `eye_to_hand`, since a cell has its scanner on
    /// the flange.
    #[must_use]
    pub fn calibrated(&self, mut spec: CellSpec) -> Option<CellSpec> {
        if self.setup == HandEyeSetup::EyeToHand {
            return None;
        }
        spec.flange_from_scanner = self.flange_from_scanner;
        spec.base_from_table = self.base_from_table.unwrap_or(spec.base_from_table);
        if let Named::Inline(turntable) = &mut spec.turntable
            && self.kind != Solve::HandEye
        {
            turntable.runout.clone_from(&self.turntable_runout);
        }
        spec.calibrated = Some(self.provenance());
        Some(spec)
    }

    /// Doubts about calibrated poses far from those of the cell that was observed. A cell may be a rough one; but it may be another one,
    /// or have another base than the controller.
    #[must_use]
    pub fn far_from(&self, spec: &CellSpec) -> Vec<FieldWarning> {
        if self.setup == HandEyeSetup::EyeToHand {
            // The scanner is not on the flange, where the cell has it.
            return Vec::new();
        }
        let scanner = far("/flange_from_scanner", &self.flange_from_scanner, &spec.flange_from_scanner);
        let table = self.base_from_table.as_ref().and_then(|table| far("/base_from_table", table, &spec.base_from_table));
        scanner.into_iter().chain(table).collect()
    }

    fn provenance(&self) -> CalibrationProvenance {
        CalibrationProvenance {
            by: format!("vantage {VERSION_LINE}"),
            at: self.taken_at.to_string(),
            calibration_id: self.id.clone(),
            data_sha256: self.data_sha256.clone(),
            rms_rotation_deg: self.summary.spread.rms_rotation_deg,
            rms_translation_mm: self.summary.spread.rms_translation_mm,
            point_sd_mm: self.point_at_best_focus_sd_mm,
            rotation_sd_deg: self.observability.rotation_sd_deg,
            translation_sd_mm: self.observability.translation_sd_mm,
            temperature_c: self.temperature_c,
            max_age_hours: None,
            max_temperature_change_k: None,
            compensation_sha256: None,
            compensation: None,
        }
    }
}

/// Doubt about a pose that is far from the one given.
fn far(pointer: &str, found: &PoseSpec, given: &PoseSpec) -> Option<FieldWarning> {
    let [found, given] = [found, given].map(|spec| *spec.pose::<(), ()>().isometry());
    let apart = given.inv_mul(&found);
    let (shift_mm, turn_deg) = (apart.translation.vector.norm(), apart.rotation.angle().to_degrees());
    (shift_mm > MAX_SHIFT_MM || turn_deg > MAX_TURN_DEG).then(|| FieldWarning {
        code: WarningCode::DoubtfulValue,
        pointer: pointer.to_owned(),
        detail: format!("is {shift_mm:.0} mm and {turn_deg:.1}° from the calibrated pose"),
        remedy: "check that the observations are of this cell and in its base; nothing needs to be done if the cell's pose was \
                 only rough"
            .to_owned(),
    })
}
