//! Provenance of calibrated lenses and poses, as a scanner's specification has it and as plans carry it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::field_error::Findings;
use crate::cell::{FieldRange, field_ranges};

/// Provenance of calibrated lenses and poses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CalibratedScannerSpec {
    /// Method and program, in words.
    pub by: String,
    /// Time of the measurements, as their source writes it; `null` if it does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at: Option<String>,
    /// SHA-256 of the files that it was derived from, in their order, 64 hexadecimal digits.
    #[schema(min_length = 64, max_length = 64)]
    pub data_sha256: String,
    /// Residuals that remain; `null` if the source gives none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub residuals: Option<ScannerResidualsSpec>,
}

/// Residuals of a calibration of lenses and poses; `null` where unknown, never 0 for unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ScannerResidualsSpec {
    /// Root mean square length of the left camera's reprojection errors, px, 0 to 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_rms_px: Option<f64>,
    /// Root mean square length of the right camera's reprojection errors, px, 0 to 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub right_rms_px: Option<f64>,
    /// Root mean square length of the projector's reprojection errors, px, 0 to 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projector_rms_px: Option<f64>,
    /// Root mean square distance of points from their epipolar lines, px, 0 to 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epipolar_rms_px: Option<f64>,
    /// Root mean square error of triangulated distances between neighbouring points of the board, mm, 0 to 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board_pitch_rms_mm: Option<f64>,
}

field_ranges! {
    ScannerResidualsSpec {
        LEFT_RMS_PX = "left_rms_px", [0.0, 1000.0] "px";
        RIGHT_RMS_PX = "right_rms_px", [0.0, 1000.0] "px";
        PROJECTOR_RMS_PX = "projector_rms_px", [0.0, 1000.0] "px";
        EPIPOLAR_RMS_PX = "epipolar_rms_px", [0.0, 1000.0] "px";
        BOARD_PITCH_RMS_MM = "board_pitch_rms_mm", [0.0, 1000.0] "mm";
    }
}

impl CalibratedScannerSpec {
    /// Records what is out of range, below `/calibrated`.
    pub(super) fn check(&self, findings: &mut Findings) {
        let words = |text: &str| (1..=200).contains(&text.chars().count());
        findings.require(words(&self.by), "/calibrated/by", || {
            format!("has {} characters; allowed are 1 to 200", self.by.chars().count())
        });
        if let Some(at) = &self.at {
            let count = at.chars().count();
            findings.require(words(at), "/calibrated/at", || format!("has {count} characters; allowed are 1 to 200"));
        }
        let is_digest = self.data_sha256.len() == 64 && self.data_sha256.bytes().all(|byte| byte.is_ascii_hexdigit());
        findings.require(is_digest, "/calibrated/data_sha256", || {
            format!("is {:?}; give 64 hexadecimal digits", self.data_sha256.chars().take(80).collect::<String>())
        });
        let Some(residuals) = &self.residuals else { return };
        for (range, value) in residuals.in_ranges() {
            range.check("/calibrated/residuals", &value, findings);
        }
    }
}

impl ScannerResidualsSpec {
    /// Names, values and units of the residuals.
    #[must_use]
    pub fn named(&self) -> [(&'static str, Option<f64>, &'static str); 5] {
        self.in_ranges().map(|(range, value)| (range.field, value, range.unit))
    }

    /// Residuals, each with its range.
    fn in_ranges(&self) -> [(FieldRange, Option<f64>); 5] {
        [
            (Self::LEFT_RMS_PX, self.left_rms_px),
            (Self::RIGHT_RMS_PX, self.right_rms_px),
            (Self::PROJECTOR_RMS_PX, self.projector_rms_px),
            (Self::EPIPOLAR_RMS_PX, self.epipolar_rms_px),
            (Self::BOARD_PITCH_RMS_MM, self.board_pitch_rms_mm),
        ]
    }
}
