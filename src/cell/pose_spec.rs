//! A pose as it is written in files and over HTTP.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::field_error::Findings;
use crate::geometry::Pose;

/// Largest difference of a written quaternion's norm from 1.
const UNIT_TOLERANCE: f64 = 1e-6;
/// Largest distance that a written pose may contain: 100 m.
const REACH_MM: f64 = 1e5;

/// `{"translation_mm": [x, y, z], "quaternion_xyzw": [x, y, z, w]}`, named target-from-source by its key.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct PoseSpec {
    /// Origin of the source frame in the target frame, millimetres.
    #[schema(min_items = 3, max_items = 3)]
    pub translation_mm: [f64; 3],
    /// Unit quaternion, vector part first.
    #[schema(min_items = 4, max_items = 4)]
    pub quaternion_xyzw: [f64; 4],
}

impl Default for PoseSpec {
    fn default() -> Self {
        Self { translation_mm: [0.0; 3], quaternion_xyzw: [0.0, 0.0, 0.0, 1.0] }
    }
}

impl PoseSpec {
    /// Records what is wrong with this pose, below `pointer`.
    pub fn check(&self, pointer: &str, findings: &mut Findings) {
        for (axis, value) in self.translation_mm.iter().enumerate() {
            findings.range(format!("{pointer}/translation_mm/{axis}"), *value, -REACH_MM, REACH_MM, "mm");
        }
        let norm = self.quaternion_xyzw.iter().map(|c| c * c).sum::<f64>().sqrt();
        findings.require((norm - 1.0).abs() <= UNIT_TOLERANCE, format!("{pointer}/quaternion_xyzw"), || {
            format!("has norm {norm}; a rotation needs a unit quaternion (norm 1 ± {UNIT_TOLERANCE})")
        });
    }

    /// The typed pose; the caller's key names the frames.
    #[must_use]
    pub fn pose<To, From>(&self) -> Pose<To, From> {
        let [x, y, z, w] = self.quaternion_xyzw;
        Pose::from_parts(Vector3::from(self.translation_mm), UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)))
    }
}

impl<To, From> std::convert::From<&Pose<To, From>> for PoseSpec {
    fn from(pose: &Pose<To, From>) -> Self {
        let q = pose.isometry().rotation.quaternion();
        // q and -q are the same rotation: w >= 0 is written, so that equal poses read equal.
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        // Adding 0 turns −0 into 0.
        Self {
            translation_mm: pose.isometry().translation.vector.add_scalar(0.0).into(),
            quaternion_xyzw: [q.i, q.j, q.k, q.w].map(|c| sign * c + 0.0),
        }
    }
}
