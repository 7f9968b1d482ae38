//! Frame that a scanner's clouds are in. Vendors take the left camera's as often as one of their own; the hand-eye is solved for it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::device::OpticalDevice;
use super::per_device::PerDevice;
use crate::cell::closed_list;
use crate::cell::field_error::Findings;
use crate::cell::pose_spec::{PoseInput, PoseSpec};
use crate::geometry::{Cloud, Pose, ScannerFrame};

closed_list! {
    /// Frame of the scanner that clouds may be in.
    pub enum CloudFrame {
        /// The scanner's own: middle of the baseline.
        Scanner = "scanner",
        /// The left camera's.
        Left = "left",
        /// The right camera's.
        Right = "right",
        /// The projector's.
        Projector = "projector",
    }
}

/// Frame of the clouds: a name, `scanner`, `left`, `right` or `projector`, or its pose in the scanner.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged, expecting = "expected scanner, left, right, projector or a pose")]
pub enum CloudFrameSpec {
    /// One of the scanner's frames.
    Named(CloudFrame),
    /// Pose of the clouds' frame in the scanner.
    #[schema(value_type = PoseInput)]
    Pose(PoseSpec),
}

impl CloudFrameSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        if let Self::Pose(pose) = self {
            pose.check(pointer, findings);
        }
    }

    /// Pose of the clouds' frame in the scanner with these devices.
    #[must_use]
    pub fn scanner_from_cloud(&self, devices: &PerDevice<OpticalDevice>) -> Pose<ScannerFrame, Cloud> {
        let of = |device: &OpticalDevice| Pose::claim(*device.scanner_from_device.isometry());
        match self {
            Self::Named(CloudFrame::Scanner) => Pose::identity(),
            Self::Named(CloudFrame::Left) => of(&devices.left),
            Self::Named(CloudFrame::Right) => of(&devices.right),
            Self::Named(CloudFrame::Projector) => of(&devices.projector),
            Self::Pose(pose) => pose.pose(),
        }
    }
}
