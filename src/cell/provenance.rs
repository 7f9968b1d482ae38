//! Origin of a cell's poses: the calibration that they were taken from, the compensation in force, and what bounds their use. Pure:
//! ages and the temperature are handed in.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::closed_list;
use super::field_error::Findings;
use super::field_ranges;
use super::pose_spec::PoseSpec;
use crate::geometry::{Flange, Pose, ScannerFrame};

/// Digits of a SHA-256 in hexadecimal.
const SHA256_DIGITS: usize = 64;
/// Poses that went through a file differ by less.
const SAME_MM: f64 = 1e-3;
const SAME_RAD: f64 = 1e-6;
/// Largest difference between the clocks of two machines, h: five minutes, as Kerberos allows (RFC 4120, section 1.6).
const CLOCK_HOURS: f64 = 1.0 / 12.0;

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
    /// Hours after `at` for which the calibration may be used, 0.01 to 1000000. Default: without an end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_age_hours: Option<f64>,
    /// Change from `temperature_c` beyond which it may not be used, K, 0.1 to 100. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_temperature_change_k: Option<f64>,
    /// Identifier of the compensation in force: the SHA-256 of the check that gave it. Goes with `compensation`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compensation_sha256: Option<String>,
    /// Compensation in force, with what bounds its use.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compensation: Option<CompensationProvenance>,
}

/// Compensation of a cell's hand-eye that a check before use gave. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CompensationProvenance {
    /// Name of the cell that was checked.
    pub cell: String,
    /// Calibration that it corrects.
    pub calibration_id: String,
    /// Time at which the observations of the check were taken, RFC 3339.
    pub at: String,
    /// Temperature at which they were taken, °C.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// Pose that it puts into force: the cell's `flange_from_scanner`.
    pub flange_from_scanner: PoseSpec,
    /// Turn that it corrects, degrees.
    pub rotation_deg: f64,
    /// Shift that it corrects, mm.
    pub translation_mm: f64,
    /// Largest turn that may be corrected, degrees, 0 to 20.
    pub max_rotation_deg: f64,
    /// Largest shift that may be corrected, mm, 0 to 100.
    pub max_translation_mm: f64,
    /// Hours after `at` for which it may be used, 0.01 to 1000000.
    pub max_age_hours: f64,
    /// Change of temperature beyond which it may not be used, K, 0.1 to 100.
    pub max_temperature_change_k: f64,
}

closed_list! {
    /// Origin of a cell's poses.
    pub enum PoseOrigin {
        /// Calibration of the cell.
        Calibration = "calibration",
        /// Compensation of the cell.
        Compensation = "compensation",
    }
}

/// Conditions of use, as far as they are known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UseConditions {
    /// Time since the calibration's observations, h; negative if they are of the future.
    pub calibration_age_hours: Option<f64>,
    /// Time since those of the compensation, h.
    pub compensation_age_hours: Option<f64>,
    /// Temperature in the cell, °C.
    pub temperature_c: Option<f64>,
}

/// Reason for which a cell's calibrated poses may not be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationObjection {
    /// Older than it may be, or dated later than now.
    #[error("the {} is {hours:.1} h old; allowed is 0 to {max_hours} h: check the cell again", origin.as_str())]
    TooOld {
        /// Calibration or compensation.
        origin: PoseOrigin,
        /// Age, h.
        hours: f64,
        /// Largest age, h.
        max_hours: f64,
    },
    /// At another temperature than it may be.
    #[error(
        "the {} was taken at {then_c:.1} °C; at {now_c:.1} °C it may not be used: allowed is a change of {max_k} K. Check the cell \
         again at this temperature, or wait for the other",
        origin.as_str()
    )]
    Temperature {
        /// Calibration or compensation.
        origin: PoseOrigin,
        /// Temperature then, °C.
        then_c: f64,
        /// Temperature now, °C.
        now_c: f64,
        /// Largest change, K.
        max_k: f64,
    },
    /// Compensation of another cell.
    #[error("the compensation is of cell {compensation:?}, not of {cell:?}; check this cell, and write its own compensation")]
    OtherCell {
        /// Cell that was checked.
        compensation: String,
        /// Cell that it stands in.
        cell: String,
    },
    /// Compensation of another calibration.
    #[error("the compensation corrects calibration {compensation}, not {calibration}, which the cell has; check the cell again")]
    OtherCalibration {
        /// Calibration that it corrects.
        compensation: String,
        /// Calibration of the cell.
        calibration: String,
    },
    /// Hand-eye that is not the compensated one.
    #[error(
        "flange_from_scanner is not the pose that the compensation puts into force; give it as `vantage calibrate check \
         --write-cell` wrote it, or check the cell again"
    )]
    OtherPose,
    /// Correction larger than it may be.
    #[error("the compensation corrects {mm:.3} mm and {deg:.4}°; allowed are {max_mm} mm and {max_deg}°: calibrate again")]
    OutOfBounds {
        /// Shift, mm.
        mm: f64,
        /// Turn, degrees.
        deg: f64,
        /// Largest shift, mm.
        max_mm: f64,
        /// Largest turn, degrees.
        max_deg: f64,
    },
}

field_ranges! {
    CalibrationProvenance {
        RMS_ROTATION_DEG = "rms_rotation_deg", [0.0, 1e4] "°";
        RMS_TRANSLATION_MM = "rms_translation_mm", [0.0, 1e4] "mm";
        POINT_SD_MM = "point_sd_mm", [0.0, 1e4] "mm";
        ROTATION_SD_DEG = "rotation_sd_deg", [0.0, 1e4] "°";
        TRANSLATION_SD_MM = "translation_sd_mm", [0.0, 1e4] "mm";
        MAX_AGE_HOURS = "max_age_hours", [0.01, 1e6] "h";
        MAX_TEMPERATURE_CHANGE_K = "max_temperature_change_k", [0.1, 100.0] "K";
    }
}

field_ranges! {
    CompensationProvenance {
        ROTATION_DEG = "rotation_deg", [0.0, 180.0] "°";
        TRANSLATION_MM = "translation_mm", [0.0, 1e4] "mm";
        MAX_ROTATION_DEG = "max_rotation_deg", [0.0, 20.0] "°";
        MAX_TRANSLATION_MM = "max_translation_mm", [0.0, 100.0] "mm";
        MAX_AGE_HOURS = "max_age_hours", [0.01, 1e6] "h";
        MAX_TEMPERATURE_CHANGE_K = "max_temperature_change_k", [0.1, 100.0] "K";
    }
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
        Self::RMS_ROTATION_DEG.check(pointer, &self.rms_rotation_deg, findings);
        Self::RMS_TRANSLATION_MM.check(pointer, &self.rms_translation_mm, findings);
        Self::POINT_SD_MM.check(pointer, &self.point_sd_mm, findings);
        Self::ROTATION_SD_DEG.check(pointer, &self.rotation_sd_deg, findings);
        Self::TRANSLATION_SD_MM.check(pointer, &self.translation_sd_mm, findings);
        Self::MAX_AGE_HOURS.check(pointer, &self.max_age_hours, findings);
        Self::MAX_TEMPERATURE_CHANGE_K.check(pointer, &self.max_temperature_change_k, findings);
        let is_paired = self.compensation.is_some() == self.compensation_sha256.is_some();
        findings.require(is_paired, format!("{pointer}/compensation"), || {
            "goes with compensation_sha256: give both, as `vantage calibrate check --write-cell` writes them, or none".into()
        });
        if let Some(compensation) = &self.compensation {
            compensation.check(&format!("{pointer}/compensation"), findings);
        }
    }

    /// Reasons for which the poses of cell `cell`, whose hand-eye is `flange_from_scanner`, may not be used. A condition that is not
    /// known forbids nothing.
    #[must_use]
    pub fn objections(
        &self,
        cell: &str,
        flange_from_scanner: &Pose<Flange, ScannerFrame>,
        conditions: &UseConditions,
    ) -> Vec<CalibrationObjection> {
        let origin = PoseOrigin::Calibration;
        let own_age = too_old(origin, conditions.calibration_age_hours, self.max_age_hours);
        let own_temperature = too_far(origin, [self.temperature_c, conditions.temperature_c], self.max_temperature_change_k);
        let of_compensation = self.compensation.iter().flat_map(|compensation| {
            let identity = compensation.identity(cell, &self.calibration_id, flange_from_scanner);
            identity.into_iter().chain(compensation.staleness(conditions))
        });
        own_age.into_iter().chain(own_temperature).chain(of_compensation).collect()
    }
}

impl CompensationProvenance {
    fn check(&self, pointer: &str, findings: &mut Findings) {
        self.flange_from_scanner.check(&format!("{pointer}/flange_from_scanner"), findings);
        Self::ROTATION_DEG.check(pointer, &self.rotation_deg, findings);
        Self::TRANSLATION_MM.check(pointer, &self.translation_mm, findings);
        Self::MAX_ROTATION_DEG.check(pointer, &self.max_rotation_deg, findings);
        Self::MAX_TRANSLATION_MM.check(pointer, &self.max_translation_mm, findings);
        Self::MAX_AGE_HOURS.check(pointer, &self.max_age_hours, findings);
        Self::MAX_TEMPERATURE_CHANGE_K.check(pointer, &self.max_temperature_change_k, findings);
    }

    /// Objections that concern whose compensation it is, and its size.
    fn identity(
        &self,
        cell: &str,
        calibration_id: &str,
        flange_from_scanner: &Pose<Flange, ScannerFrame>,
    ) -> Vec<CalibrationObjection> {
        let other_cell = (self.cell != cell)
            .then(|| CalibrationObjection::OtherCell { compensation: self.cell.clone(), cell: cell.to_owned() });
        let other_calibration = (self.calibration_id != calibration_id).then(|| CalibrationObjection::OtherCalibration {
            compensation: self.calibration_id.clone(),
            calibration: calibration_id.to_owned(),
        });
        let by = self.flange_from_scanner.pose::<Flange, ScannerFrame>().inverse() * *flange_from_scanner;
        let is_other_pose = by.origin_mm().coords.norm() > SAME_MM || by.isometry().rotation.angle() > SAME_RAD;
        let is_large = self.translation_mm > self.max_translation_mm || self.rotation_deg > self.max_rotation_deg;
        let out_of_bounds = is_large.then_some(CalibrationObjection::OutOfBounds {
            mm: self.translation_mm,
            deg: self.rotation_deg,
            max_mm: self.max_translation_mm,
            max_deg: self.max_rotation_deg,
        });
        let other_pose = is_other_pose.then_some(CalibrationObjection::OtherPose);
        other_cell.into_iter().chain(other_calibration).chain(other_pose).chain(out_of_bounds).collect()
    }

    fn staleness(&self, conditions: &UseConditions) -> impl Iterator<Item = CalibrationObjection> + use<> {
        let origin = PoseOrigin::Compensation;
        let age = too_old(origin, conditions.compensation_age_hours, Some(self.max_age_hours));
        let temperatures = [self.temperature_c, conditions.temperature_c];
        age.into_iter().chain(too_far(origin, temperatures, Some(self.max_temperature_change_k)))
    }
}

fn too_old(origin: PoseOrigin, hours: Option<f64>, max_hours: Option<f64>) -> Option<CalibrationObjection> {
    let (hours, max_hours) = (hours?, max_hours?);
    // Clocks of two machines differ by a little: an age below zero is one of the future beyond that.
    let is_allowed = (-CLOCK_HOURS..=max_hours).contains(&hours);
    (!is_allowed).then_some(CalibrationObjection::TooOld { origin, hours, max_hours })
}

fn too_far(origin: PoseOrigin, [then_c, now_c]: [Option<f64>; 2], max_k: Option<f64>) -> Option<CalibrationObjection> {
    let (then_c, now_c, max_k) = (then_c?, now_c?, max_k?);
    let is_allowed = (now_c - then_c).abs() <= max_k;
    (!is_allowed).then_some(CalibrationObjection::Temperature { origin, then_c, now_c, max_k })
}

#[cfg(test)]
mod tests;
