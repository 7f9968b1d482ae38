//! Poses that are not where they were planned: against which errors a plan is certified, and whether it is chosen so that
//! it bears them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::Findings;

/// Error of a pose: turned by the whole angle and moved by the whole distance, each in a random direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct PoseErrorParams {
    /// Turn, degrees, 0 to 20. The thesis accepts 1 (§4.1.2).
    pub angle_deg: f64,
    /// Shift, mm, 0 to 100.
    pub translation_mm: f64,
}

/// Evaluation of a plan with poses that are off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct RobustParams {
    /// Error of poses for which coverage is evaluated again, on samples that the views were not chosen on. Default: none,
    /// and nothing is evaluated.
    pub pose_error: Option<PoseErrorParams>,
    /// Draws in which every view is put off by an error of its own, 1 to 1000. Default 20.
    pub draws: u32,
    /// Draws in which the part as a whole is put off, 1 to 1000. Default 20.
    pub part_draws: u32,
    /// Chooses views by what they measure under each of six stated errors as well (`planning/robust`): turned
    /// about x, y and z both ways by the angle, and moved by the distance to where the turn takes the field. Seven times
    /// the time for visibility. Default false.
    pub select: bool,
}

impl Default for RobustParams {
    fn default() -> Self {
        Self { pose_error: None, draws: 20, part_draws: 20, select: false }
    }
}

impl RobustParams {
    /// Checks every range.
    pub(super) fn check(&self, findings: &mut Findings) {
        if let Some(error) = &self.pose_error {
            findings.range("/robust/pose_error/angle_deg", error.angle_deg, 0.0, 20.0, "°");
            findings.range("/robust/pose_error/translation_mm", error.translation_mm, 0.0, 100.0, "mm");
        }
        findings.range("/robust/draws", f64::from(self.draws), 1.0, 1000.0, "");
        findings.range("/robust/part_draws", f64::from(self.part_draws), 1.0, 1000.0, "");
        findings.require(!self.select || self.pose_error.is_some(), "/robust/select", || {
            "is true without an error to bear; give robust.pose_error".into()
        });
    }
}
