//! Pose errors: against which ones a plan is certified, and whether views are chosen to tolerate them.

use super::knob::params;
use crate::cell::{CalibrationProvenance, Findings};

params! {
    /// Error of a pose: a rotation by the full angle about a random axis, and a translation by the full distance in a random
    /// direction.
    #[derive(Copy)]
    required PoseErrorParams {
        /// Rotation, degrees. The thesis accepts 1° (§4.1.2).
        angle_deg: f64, [0.0, 20.0] "°";
        /// Translation, mm.
        translation_mm: f64, [0.0, 100.0] "mm";
    }
}

params! {
    /// Evaluation of a plan under pose errors.
    RobustParams {
        /// Pose error under which coverage is evaluated again, on samples that the views were not chosen on; `null` skips that.
        /// The default rotation is the one that the thesis accepts (§4.1.2); the default translation has no source. In a cell
        /// whose poses are calibrated, twice the standard deviations of the calibration or twice its root mean square residuals,
        /// whichever are larger, replace the default, even where the default is written out.
        pose_error: Option<PoseErrorParams> = Some(PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 });
        /// Number of draws in which every view has a pose error of its own. Use a multiple of 6: six draws rotate and translate
        /// both ways along three axes; with fewer, some axes are not tried.
        draws: u32 = 6, [1.0, 1000.0] "";
        /// Number of draws in which the part and its support (fixture and plate) are off as one, as a wrong pose of the table
        /// puts them. Use a multiple of 6, as for `draws`.
        part_draws: u32 = 12, [1.0, 1000.0] "";
        /// Number of draws in which all views share one error in the scanner frame, as a wrong hand-eye calibration causes it.
        /// Use a multiple of 6, as for `draws`.
        hand_eye_draws: u32 = 12, [1.0, 1000.0] "";
        /// Chooses views by what they measure under each of twelve fixed pose errors as well: six of the scanner, rotated both
        /// ways about its x, y and z by the angle, and moved by the distance towards where the rotation takes the field; and six
        /// of the part, rotated both ways about the x, y and z through the centre of its bounding box, and moved by the distance
        /// across the axis. Computing visibility then takes thirteen times as long.
        select: bool = false;
    }
}

/// Standard deviations of a calibration that poses are taken to be off by: 95 % of a normal error.
const CALIBRATION_SIGMAS: f64 = 2.0;

impl PoseErrorParams {
    /// Error that a calibration leaves, with two significant digits. All views share that of the scanner's pose; each has its own
    /// besides, of the arm and of what is scanned, which the residuals of the calibration show and which no number of observations
    /// makes smaller.
    #[must_use]
    pub fn of_calibration(calibrated: &CalibrationProvenance) -> Self {
        let error = |sd: f64, rms: f64, most: f64| two_digits(CALIBRATION_SIGMAS * sd.max(rms)).min(most);
        Self {
            angle_deg: error(calibrated.rotation_sd_deg, calibrated.rms_rotation_deg, 20.0),
            translation_mm: error(calibrated.translation_sd_mm, calibrated.rms_translation_mm, 100.0),
        }
    }
}

/// Value with two significant digits.
fn two_digits(value: f64) -> f64 {
    // Division by a power of ten is exact to the digit, where multiplication by its inverse is not.
    let tens = 10.0_f64.powf(1.0 - value.abs().max(1e-9).log10().floor());
    (value * tens).round() / tens
}

impl RobustParams {
    /// Puts the error that a calibration leaves in the place of the default. An error that was given and equals the default is taken for
    /// it: parameters are stored with their defaults filled in, so that the two are one in every stored job.
    pub(in crate::planning) fn use_calibration(&mut self, calibrated: Option<&CalibrationProvenance>) {
        if let Some(calibrated) = calibrated
            && self.pose_error == Self::default().pose_error
        {
            self.pose_error = Some(PoseErrorParams::of_calibration(calibrated));
        }
    }

    /// Checks every range.
    pub(super) fn check(&self, findings: &mut Findings) {
        self.check_ranges("/robust", findings);
        if let Some(error) = &self.pose_error {
            error.check_ranges("/robust/pose_error", findings);
        }
        findings.require(!self.select || self.pose_error.is_some(), "/robust/select", || {
            "is true without an error to tolerate; give robust.pose_error".into()
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calibrated() -> CalibrationProvenance {
        CalibrationProvenance {
            by: "vantage".into(),
            at: "2026-11-20T09:00:00Z".into(),
            calibration_id: "ab".repeat(32),
            data_sha256: "cd".repeat(32),
            rms_rotation_deg: 0.01,
            rms_translation_mm: 0.1,
            point_sd_mm: 0.05,
            rotation_sd_deg: 0.005,
            translation_sd_mm: 0.04,
            temperature_c: None,
            max_age_hours: None,
            max_temperature_change_k: None,
            compensation_sha256: None,
            compensation: None,
        }
    }

    #[test]
    fn a_calibration_stands_in_for_the_default_and_for_nothing_that_was_asked_for() {
        let error_of = |given: RobustParams, calibrated: Option<&CalibrationProvenance>| {
            let mut robust = given;
            robust.use_calibration(calibrated);
            robust.pose_error.map(|error| [error.angle_deg, error.translation_mm])
        };
        let (known, default) = (calibrated(), RobustParams::default);
        assert_eq!(error_of(default(), None), Some([1.0, 1.0]));
        assert_eq!(error_of(default(), Some(&known)), Some([0.02, 0.2]), "twice the residuals: each view is off by its own");
        let many_residuals_or_few = |rms_rotation_deg, rms_translation_mm| {
            let known = CalibrationProvenance { rms_rotation_deg, rms_translation_mm, ..known.clone() };
            error_of(default(), Some(&known))
        };
        assert_eq!(many_residuals_or_few(0.001, 0.01), Some([0.01, 0.08]), "twice the deviations of the scanner's pose");
        assert_eq!(many_residuals_or_few(0.012_34, 0.134_56), Some([0.025, 0.27]), "two digits");
        let own = PoseErrorParams { angle_deg: 0.5, translation_mm: 1.0 };
        assert_eq!(error_of(RobustParams { pose_error: Some(own), ..default() }, Some(&known)), Some([0.5, 1.0]));
        let as_default = PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 };
        assert_eq!(error_of(RobustParams { pose_error: Some(as_default), ..default() }, Some(&known)), Some([0.02, 0.2]));
        assert_eq!(error_of(RobustParams { pose_error: None, ..default() }, Some(&known)), None);
        let poor = CalibrationProvenance { rotation_sd_deg: 30.0, translation_sd_mm: 1e3, ..known };
        assert_eq!(error_of(default(), Some(&poor)), Some([20.0, 100.0]), "within the ranges of the parameter");
    }
}
