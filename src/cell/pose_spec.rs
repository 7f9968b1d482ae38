//! A pose as it is written in files and over HTTP: the rotation as a quaternion or as Euler angles. Outputs have the quaternion.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;

use super::field_error::Findings;
use super::field_ranges;
use crate::geometry::Pose;

/// Largest difference of a written quaternion's norm from 1.
const UNIT_TOLERANCE: f64 = 1e-6;
/// Largest distance that a written pose may contain: 100 m.
const REACH_MM: f64 = 1e5;
/// Largest Euler angle that may be written, degrees: ten turns, as for joints.
const MAX_EULER_DEG: f64 = 3600.0;

/// `{"translation_mm": [x, y, z], "quaternion_xyzw": [x, y, z, w]}`, named target-from-source by its key.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseSpec {
    /// Origin of the source frame in the target frame, mm, -100000 to 100000 each.
    #[schema(min_items = 3, max_items = 3)]
    pub translation_mm: [f64; 3],
    /// Unit quaternion, vector part first (norm 1); specifications and parameters may have `rpy_deg` in its place.
    #[schema(min_items = 4, max_items = 4)]
    pub quaternion_xyzw: [f64; 4],
}

/// `{"translation_mm": [x, y, z], "rpy_deg": [roll, pitch, yaw]}`: the same pose with Euler angles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct EulerPoseSpec {
    /// Origin of the source frame in the target frame, mm, -100000 to 100000 each.
    #[schema(min_items = 3, max_items = 3)]
    pub translation_mm: [f64; 3],
    /// Roll, pitch and yaw, degrees, -3600 to 3600 each: turns about the fixed axes X, then Y, then Z of the target frame, as in
    /// URDF; R = Rz(yaw) · Ry(pitch) · Rx(roll).
    #[schema(min_items = 3, max_items = 3)]
    pub rpy_deg: [f64; 3],
}

field_ranges! {
    EulerPoseSpec {
        TRANSLATION_MM = "translation_mm", [-REACH_MM, REACH_MM] "mm";
        RPY_DEG = "rpy_deg", [-MAX_EULER_DEG, MAX_EULER_DEG] "°";
    }
}

/// A pose as it may be given: with a quaternion or with Euler angles. Answers have the quaternion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum PoseInput {
    /// Rotation as a quaternion.
    Quaternion(PoseSpec),
    /// Rotation as Euler angles.
    Euler(EulerPoseSpec),
}

/// Fields of a pose, of which one of the two rotations is given.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
struct PoseFields {
    translation_mm: [f64; 3],
    quaternion_xyzw: Option<[f64; 4]>,
    rpy_deg: Option<[f64; 3]>,
}

impl<'de> Deserialize<'de> for PoseSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let PoseFields { translation_mm, quaternion_xyzw, rpy_deg } = PoseFields::deserialize(deserializer)?;
        match (quaternion_xyzw, rpy_deg) {
            (Some(quaternion_xyzw), None) => Ok(Self { translation_mm, quaternion_xyzw }),
            (None, Some(rpy_deg)) => match rpy_deg.iter().find(|angle| !angle.is_finite() || angle.abs() > MAX_EULER_DEG) {
                None => Ok(Self { translation_mm, quaternion_xyzw: quaternion_of(rpy_deg) }),
                Some(angle) => Err(D::Error::custom(format_args!(
                    "rpy_deg has {angle} °; allowed is -{MAX_EULER_DEG} to {MAX_EULER_DEG} ° for roll, pitch and yaw"
                ))),
            },
            (Some(_), Some(_)) => Err(D::Error::custom("gives both quaternion_xyzw and rpy_deg; give one of the two")),
            (None, None) => Err(D::Error::missing_field("quaternion_xyzw")),
        }
    }
}

/// Unit quaternion of Rz(yaw) · Ry(pitch) · Rx(roll).
fn quaternion_of(rpy_deg: [f64; 3]) -> [f64; 4] {
    let [roll, pitch, yaw] = rpy_deg.map(f64::to_radians);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), pitch)
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), roll);
    [turn.i, turn.j, turn.k, turn.w]
}

/// The translation in millimetres, where it looks like metres: every length below 3, one of them no whole number.
#[must_use]
pub fn metres_in_mm(translation: [f64; 3]) -> Option<[f64; 3]> {
    let is_broken = |length: f64| (length - length.round()).abs() > 1e-9;
    let looks_so = translation.iter().all(|length| length.abs() < 3.0) && translation.into_iter().any(is_broken);
    looks_so.then(|| translation.map(|metres| (metres * 1e6).round() / 1e3))
}

impl Default for PoseSpec {
    fn default() -> Self {
        Self { translation_mm: [0.0; 3], quaternion_xyzw: [0.0, 0.0, 0.0, 1.0] }
    }
}

impl PoseSpec {
    /// Largest length along an axis that a written pose may contain, mm: 100 m.
    pub const REACH_MM: f64 = REACH_MM;

    /// Records what is wrong with this pose, below `pointer`.
    pub fn check(&self, pointer: &str, findings: &mut Findings) {
        // The range is that of poses that are given. Answers have this shape too, and may tell of places farther away.
        EulerPoseSpec::TRANSLATION_MM.check(pointer, &self.translation_mm, findings);
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

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::PoseSpec;
    use crate::geometry::{Base, Pose, Table};

    #[test]
    fn lengths_in_metres_are_recognised_and_millimetres_are_not() {
        assert_eq!(super::metres_in_mm([0.9, 0.0, 0.1]), Some([900.0, 0.0, 100.0]));
        for in_mm in [[0.0; 3], [0.0, 0.0, 1.0], [900.0, 0.0, 0.5]] {
            assert_eq!(super::metres_in_mm(in_mm), None, "{in_mm:?}");
        }
    }

    fn read(text: &str) -> Result<PoseSpec, String> {
        serde_json::from_str(text).map_err(|error| error.to_string())
    }

    fn turned(rpy_deg: [f64; 3]) -> Pose<Base, Table> {
        let text = format!(r#"{{"translation_mm": [10, 20, 30], "rpy_deg": {rpy_deg:?}}}"#);
        read(&text).expect("a pose").pose()
    }

    #[test]
    fn euler_angles_turn_about_fixed_axes_x_then_y_then_z() {
        let close = |a: Vector3<f64>, b: [f64; 3]| assert!((a - Vector3::from(b)).norm() < 1e-12, "{a} {b:?}");
        // Roll takes y to z, pitch z to x, yaw x to y.
        close(turned([90.0, 0.0, 0.0]).direction(&Vector3::y()), [0.0, 0.0, 1.0]);
        close(turned([0.0, 90.0, 0.0]).direction(&Vector3::z()), [1.0, 0.0, 0.0]);
        close(turned([0.0, 0.0, 90.0]).direction(&Vector3::x()), [0.0, 1.0, 0.0]);
        // In this order: y to z by roll, z to x by pitch, x to y by yaw. About moving axes it would end elsewhere.
        close(turned([90.0, 90.0, 90.0]).direction(&Vector3::y()), [0.0, 1.0, 0.0]);
        close(turned([90.0, 90.0, 0.0]).direction(&Vector3::y()), [1.0, 0.0, 0.0]);
        assert!((turned([1.0, 2.0, 3.0]).point(&Point3::origin()) - Point3::new(10.0, 20.0, 30.0)).norm() < 1e-12);
    }

    #[test]
    fn the_matrix_is_that_of_urdf() {
        let [r, p, y] = [0.3_f64, -0.7, 1.9];
        let pose = turned([r, p, y].map(f64::to_degrees));
        let ((sr, cr), (sp, cp), (sy, cy)) = (r.sin_cos(), p.sin_cos(), y.sin_cos());
        let columns = [
            [cy * cp, sy * cp, -sp],
            [cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr],
            [cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr],
        ];
        for (axis, column) in [Vector3::x(), Vector3::y(), Vector3::z()].iter().zip(columns) {
            assert!((pose.direction(axis) - Vector3::from(column)).norm() < 1e-12, "{axis} {column:?}");
        }
    }

    #[test]
    fn a_pose_has_one_rotation_and_is_written_with_a_quaternion() {
        let spec = read(r#"{"translation_mm": [0, 0, 1], "rpy_deg": [0, 0, 180]}"#).expect("a pose");
        let text = serde_json::to_string(&spec).expect("writes");
        assert!(text.contains("quaternion_xyzw") && !text.contains("rpy"), "{text}");
        assert_eq!(read(&text), Ok(spec));
        let refused = |rotation: &str| read(&format!(r#"{{"translation_mm": [0, 0, 1]{rotation}}}"#)).expect_err("refused");
        let both = refused(r#", "rpy_deg": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]"#);
        assert!(both.contains("gives both quaternion_xyzw and rpy_deg"), "{both}");
        assert!(refused("").contains("missing field `quaternion_xyzw`"));
        assert!(refused(r#", "rpy_deg": [0, 0, 3601]"#).contains("-3600 to 3600"));
        assert!(refused(r#", "rpy_deg": [0, 0]"#).contains("length 2"));
        assert!(refused(r#", "rpy": [0, 0, 0]"#).contains("unknown field"));
    }
}
