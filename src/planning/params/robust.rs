//! Poses that are not where they were planned: against which errors a plan is certified, and whether it is chosen so that
//! it bears them.

use super::knob::params;
use crate::cell::Findings;

params! {
    /// Error of a pose: turned by the whole angle and moved by the whole distance, each in a random direction.
    #[derive(Copy)]
    required PoseErrorParams {
        /// Turn, degrees. The thesis accepts 1 (§4.1.2).
        angle_deg: f64, [0.0, 20.0] "°";
        /// Shift, mm.
        translation_mm: f64, [0.0, 100.0] "mm";
    }
}

params! {
    /// Evaluation of a plan with poses that are off.
    RobustParams {
        /// Error of poses for which coverage is evaluated again, on samples that the views were not chosen on; `null` evaluates
        /// none. The default turn is the one that the thesis accepts (§4.1.2); the shift has no source.
        pose_error: Option<PoseErrorParams> = Some(PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 });
        /// Draws in which every view is put off by an error of its own.
        draws: u32 = 5, [1.0, 1000.0] "";
        /// Draws in which the part as a whole is put off.
        part_draws: u32 = 5, [1.0, 1000.0] "";
        /// Draws of one error that every view shares in the scanner frame: a wrong hand-eye calibration.
        hand_eye_draws: u32 = 5, [1.0, 1000.0] "";
        /// Chooses views by what they measure under each of six stated errors as well (`planning/problem/robust_rows.rs`): turned
        /// about x, y and z both ways by the angle, and moved by the distance to where the turn takes the field. Seven times
        /// the time for visibility.
        select: bool = false;
    }
}

impl RobustParams {
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
