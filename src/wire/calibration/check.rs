//! `vantage.calibration_check/1`: a check before use, with the compensation that it leads to.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::result::{CalibrationDocument, FindingDocument};
use crate::cell::calibration::check::{CheckLimits, CheckVerdict, Checked};
use crate::cell::calibration::findings::{CalibrationFinding, Figures, FindingCode, Severity};
use crate::cell::calibration::refine::MAX_ITERATIONS;
use crate::cell::calibration::se3::{rotation_of, translation_of};
use crate::cell::{CalibrationProvenance, CompensationProvenance, PoseSpec};
use crate::geometry::{Cloud, Flange, Pose, ScannerFrame};
use crate::wire::UtcTime;

/// Name and version of the shape.
pub const CALIBRATION_CHECK_SCHEMA: &str = "vantage.calibration_check/1";
/// Change of temperature beyond which a calibration is stale, K: 800 mm of aluminium arm grow by 0.09 mm.
const MAX_TEMPERATURE_CHANGE_K: f64 = 5.0;

/// A check before use. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CalibrationCheckDocument {
    /// `vantage.calibration_check/1`.
    pub schema: String,
    /// SHA-256 of this document with an empty id; the compensation goes by it.
    pub id: String,
    /// Calibration that was checked.
    pub calibration_id: String,
    /// Name of the cell.
    pub cell: String,
    /// SHA-256 of the observations.
    pub data_sha256: String,
    /// Time of the observations, else of the check.
    pub taken_at: UtcTime,
    /// Temperature, °C; `null` if not known.
    pub temperature_c: Option<f64>,
    /// Verdict.
    pub verdict: CheckVerdict,
    /// Growth of the cost when the scanner's pose is held to the calibration.
    pub statistic: f64,
    /// Value that it exceeds without drift at the rate `false_alarm`.
    pub threshold: f64,
    /// Rate of false alarms.
    pub false_alarm: f64,
    /// Probability of a statistic as large or larger without drift.
    pub p: f64,
    /// Probability of residuals as large or larger after compensation.
    pub residual_p: f64,
    /// Turn by which the scanner's pose is off the calibration, degrees.
    pub drift_rotation_deg: f64,
    /// Shift by which it is off, mm.
    pub drift_translation_mm: f64,
    /// Correction; only with the verdict `compensate`.
    pub compensation: Option<CompensationDocument>,
    /// Remarks.
    pub findings: Vec<FindingDocument>,
}

/// Correction of a calibration. It belongs to that calibration and to nothing else. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CompensationDocument {
    /// Pose of the scanner on the flange that goes into force.
    pub flange_from_scanner: PoseSpec,
    /// Covariance of it as a body increment: rx ry rz tx ty tz, rad and mm.
    pub covariance: Vec<Vec<f64>>,
    /// Largest turn that may be compensated, degrees.
    pub max_rotation_deg: f64,
    /// Largest shift that may be compensated, mm.
    pub max_translation_mm: f64,
    /// Hours after `taken_at` for which it may be used.
    pub max_age_hours: f64,
    /// Change of temperature beyond which it may not be used, K.
    pub max_temperature_change_k: f64,
}

/// Hours that a compensation holds: a working day of three shifts, as for photogrammetry that is used again.
const MAX_AGE_HOURS: f64 = 24.0;

impl CalibrationCheckDocument {
    /// Document of a check; its id is empty.
    #[must_use]
    pub fn new(
        checked: &Checked,
        limits: &CheckLimits,
        calibration: &CalibrationDocument,
        scanner_from_cloud: &Pose<ScannerFrame, Cloud>,
        [data_sha256, taken_at]: [&str; 2],
        temperature_c: Option<f64>,
    ) -> Self {
        let flange_from_cloud = Pose::<Flange, Cloud>::claim(checked.compensated.flange_from_cloud);
        let compensation = CompensationDocument {
            flange_from_scanner: PoseSpec::from(&(flange_from_cloud * scanner_from_cloud.inverse())),
            covariance: (0..6).map(|row| (0..6).map(|column| checked.covariance[(row, column)]).collect()).collect(),
            max_rotation_deg: limits.max_rad.to_degrees(),
            max_translation_mm: limits.max_mm,
            max_age_hours: MAX_AGE_HOURS,
            max_temperature_change_k: MAX_TEMPERATURE_CHANGE_K,
        };
        let findings = unfinished(checked).into_iter().chain(stale(calibration.temperature_c, temperature_c));
        let findings: Vec<CalibrationFinding> = findings.collect();
        Self {
            schema: CALIBRATION_CHECK_SCHEMA.to_owned(),
            id: String::new(),
            calibration_id: calibration.id.clone(),
            cell: calibration.cell.clone(),
            data_sha256: data_sha256.to_owned(),
            taken_at: taken_at.parse().unwrap_or_else(|_| calibration.taken_at.clone()),
            temperature_c,
            verdict: checked.verdict,
            statistic: checked.statistic,
            threshold: checked.threshold,
            false_alarm: limits.false_alarm,
            p: checked.p,
            residual_p: checked.residual_p,
            drift_rotation_deg: rotation_of(&checked.drift).norm().to_degrees(),
            drift_translation_mm: translation_of(&checked.drift).norm(),
            compensation: (checked.verdict == CheckVerdict::Compensate).then_some(compensation),
            findings: findings.iter().map(FindingDocument::from).collect(),
        }
    }

    /// Provenance of the cell's poses with the compensation in force; none without a compensation.
    #[must_use]
    pub fn in_force(&self, calibrated: CalibrationProvenance) -> Option<CalibrationProvenance> {
        let compensation = self.compensation.as_ref()?;
        let provenance = CompensationProvenance {
            cell: self.cell.clone(),
            calibration_id: self.calibration_id.clone(),
            at: self.taken_at.to_string(),
            temperature_c: self.temperature_c,
            flange_from_scanner: compensation.flange_from_scanner,
            rotation_deg: self.drift_rotation_deg,
            translation_mm: self.drift_translation_mm,
            max_rotation_deg: compensation.max_rotation_deg,
            max_translation_mm: compensation.max_translation_mm,
            max_age_hours: compensation.max_age_hours,
            max_temperature_change_k: compensation.max_temperature_change_k,
        };
        let compensation_sha256 = Some(self.id.clone());
        Some(CalibrationProvenance { compensation_sha256, compensation: Some(provenance), ..calibrated })
    }
}

/// Finding on a check whose own search did not converge: its verdict is `recalibrate`, whatever the drift may be.
fn unfinished(checked: &Checked) -> Option<CalibrationFinding> {
    let figures = Figures { count: Some(MAX_ITERATIONS), ..Figures::default() };
    let finding = || CalibrationFinding::new(FindingCode::NotConverged, Severity::Error).with(figures);
    (!checked.is_converged).then(finding)
}

/// Finding on a calibration that was taken at another temperature.
fn stale(then_c: Option<f64>, now_c: Option<f64>) -> Option<CalibrationFinding> {
    let (then, now) = (then_c?, now_c?);
    let figures = Figures { temperatures_c: Some([now, then]), ..Figures::default() };
    ((now - then).abs() > MAX_TEMPERATURE_CHANGE_K)
        .then(|| CalibrationFinding::new(FindingCode::Stale, Severity::Warning).with(figures))
}
