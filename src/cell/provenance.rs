//! Origin of a cell's poses: the calibration that they were taken from.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::field_error::Findings;

/// Digits of a SHA-256 in hexadecimal.
const SHA256_DIGITS: usize = 64;

/// Calibration that a cell's poses were taken from. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CalibrationProvenance {
    /// Program and version that calibrated.
    pub by: String,
    /// Time at which the observations were taken, else of the calibration, RFC 3339.
    pub at: String,
    /// Identifier of the calibration: the SHA-256 of its document.
    pub calibration_id: String,
    /// SHA-256 of the observations.
    pub data_sha256: String,
    /// Root mean square of the residuals' turns, degrees.
    pub rms_rotation_deg: f64,
    /// Root mean square of the residuals' shifts, mm.
    pub rms_translation_mm: f64,
    /// Standard deviation of a scanned point at the depth of best focus, mm.
    pub point_sd_mm: f64,
    /// Largest standard deviation of a turn of the scanner's pose, degrees.
    pub rotation_sd_deg: f64,
    /// Largest standard deviation of a shift of the scanner's pose, mm.
    pub translation_sd_mm: f64,
    /// Temperature at which the observations were taken, °C.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// Identifier of the compensation in force: the SHA-256 of the check that gave it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compensation_sha256: Option<String>,
}

impl CalibrationProvenance {
    /// Records what is wrong, below `pointer`.
    pub fn check(&self, pointer: &str, findings: &mut Findings) {
        let digests = [
            ("calibration_id", Some(&self.calibration_id)),
            ("data_sha256", Some(&self.data_sha256)),
            ("compensation_sha256", self.compensation_sha256.as_ref()),
        ];
        for (field, digest) in digests {
            let Some(digest) = digest else { continue };
            let is_digest = digest.len() == SHA256_DIGITS && digest.bytes().all(|c| matches!(c, b'0'..=b'9' | b'a'..=b'f'));
            findings.require(is_digest, format!("{pointer}/{field}"), || {
                format!("is {digest:?}; a SHA-256 has {SHA256_DIGITS} digits, 0 to 9 and a to f")
            });
        }
        for (field, value) in [
            ("rms_rotation_deg", self.rms_rotation_deg),
            ("rms_translation_mm", self.rms_translation_mm),
            ("point_sd_mm", self.point_sd_mm),
            ("rotation_sd_deg", self.rotation_sd_deg),
            ("translation_sd_mm", self.translation_sd_mm),
        ] {
            let unit = if field.ends_with("_deg") { "°" } else { "mm" };
            findings.range(format!("{pointer}/{field}"), value, 0.0, 1e4, unit);
        }
    }
}
