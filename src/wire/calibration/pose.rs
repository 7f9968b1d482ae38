//! A pose as calibration programs write it: with a quaternion, Euler angles or the rows of a rotation matrix. Faults are named by what
//! they look like.

use nalgebra::{Isometry3, Matrix3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::calibration::start::nearest_rotation;
use crate::cell::{Findings, field_ranges};
use crate::wire::words::counted;

/// Largest difference of a quaternion's norm from 1; what was written with three digits is made unit.
const NORM_TOLERANCE: f64 = 2e-3;
/// Largest deviation of a matrix's rows from orthonormal.
const ROTATION_TOLERANCE: f64 = 2e-3;
/// Largest distance that a pose may contain: 100 m.
const REACH_MM: f64 = 1e5;

/// A pose: `translation_mm` with one of `quaternion_xyzw`, `rpy_deg` and `rotation_rows`. Unknown fields are refused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ObservedPose {
    /// Origin of the source in the target, mm, -100000 to 100000 each.
    #[schema(min_items = 3, max_items = 3)]
    pub translation_mm: [f64; 3],
    /// Unit quaternion, vector part first; made unit where its norm is 0.998 to 1.002.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 4, max_items = 4)]
    pub quaternion_xyzw: Option<[f64; 4]>,
    /// Roll, pitch, yaw, degrees: turns about the fixed axes x, then y, then z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 3, max_items = 3)]
    pub rpy_deg: Option<[f64; 3]>,
    /// Rows of the rotation matrix, orthonormal to 0.002.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 3, max_items = 3)]
    pub rotation_rows: Option<[[f64; 3]; 3]>,
}

field_ranges! {
    ObservedPose {
        TRANSLATION_MM = "translation_mm", [-REACH_MM, REACH_MM] "mm";
        RPY_DEG = "rpy_deg", [-3600.0, 3600.0] "°";
    }
}

impl ObservedPose {
    /// Pose with a quaternion.
    #[must_use]
    pub fn of(pose: &Isometry3<f64>) -> Self {
        let q = pose.rotation.quaternion();
        let translation_mm = pose.translation.vector.into();
        Self { translation_mm, quaternion_xyzw: Some([q.i, q.j, q.k, q.w]), ..Self::default() }
    }

    /// The pose, or findings below `pointer`.
    #[must_use]
    pub fn pose(&self, pointer: &str, findings: &mut Findings) -> Option<Isometry3<f64>> {
        Self::TRANSLATION_MM.check(pointer, &self.translation_mm, findings);
        let rotation = match (&self.quaternion_xyzw, &self.rpy_deg, &self.rotation_rows) {
            (Some(quaternion), None, None) => of_quaternion(quaternion, &format!("{pointer}/quaternion_xyzw"), findings),
            (None, Some(rpy), None) => {
                Self::RPY_DEG.check(pointer, rpy, findings);
                of_rpy(rpy)
            }
            (None, None, Some(rows)) => of_rows(rows, &format!("{pointer}/rotation_rows"), findings),
            (None, None, None) => {
                findings.push(pointer, "has no rotation; give quaternion_xyzw, rpy_deg or rotation_rows");
                None
            }
            _ => {
                findings.push(pointer, "gives more than one rotation; give one of quaternion_xyzw, rpy_deg and rotation_rows");
                None
            }
        };
        let is_finite = self.translation_mm.iter().all(|value| value.is_finite());
        rotation.filter(|_| is_finite).map(|rotation| Isometry3::from_parts(Translation3::from(self.translation_mm), rotation))
    }
}

fn of_quaternion(xyzw: &[f64; 4], pointer: &str, findings: &mut Findings) -> Option<UnitQuaternion<f64>> {
    let norm = xyzw.iter().map(|c| c * c).sum::<f64>().sqrt();
    if norm.is_nan() || (norm - 1.0).abs() > NORM_TOLERANCE {
        findings.push(pointer, format!("has norm {norm}; a rotation needs a unit quaternion (norm 1 ± {NORM_TOLERANCE})"));
        return None;
    }
    let [x, y, z, w] = *xyzw;
    Some(UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)))
}

fn of_rpy(rpy_deg: &[f64; 3]) -> Option<UnitQuaternion<f64>> {
    let [roll, pitch, yaw] = rpy_deg.map(f64::to_radians);
    let is_finite = rpy_deg.iter().all(|angle| angle.is_finite());
    is_finite.then(|| UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

/// Rotation of rows that are one; tells a mirrored matrix from one that is no rotation.
pub(super) fn of_rows(rows: &[[f64; 3]; 3], pointer: &str, findings: &mut Findings) -> Option<UnitQuaternion<f64>> {
    let matrix = Matrix3::from_fn(|row, column| rows[row][column]);
    let off = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    if off.is_nan() || off > ROTATION_TOLERANCE {
        let lengths: Vec<f64> = (0..3).map(|row| matrix.row(row).norm()).collect();
        findings.push(
            pointer,
            format!("is not a rotation: its rows have lengths {lengths:.4?} and should be orthonormal to {ROTATION_TOLERANCE}"),
        );
        return None;
    }
    if matrix.determinant() < 0.0 {
        findings.push(pointer, "is mirrored (determinant −1): a left-handed frame; reverse one axis");
        return None;
    }
    nearest_rotation(&matrix)
}

/// Pose of a matrix of four rows, its lengths times `unit_mm`; a translation in the last row is told.
pub(super) fn of_matrix(values: &[f64], unit_mm: f64, pointer: &str, findings: &mut Findings) -> Option<Isometry3<f64>> {
    if values.len() != 16 || values.iter().any(|value| !value.is_finite()) {
        findings.push(pointer, format!("has {}; a pose has 16 finite ones, four rows of four", counted(values.len(), "number")));
        return None;
    }
    let at = |row: usize, column: usize| values[4 * row + column];
    let last = Vector3::new(at(3, 0), at(3, 1), at(3, 2));
    if last.amax() > 1e-9 || (at(3, 3) - 1.0).abs() > 1e-9 {
        findings.push(pointer, "has a last row other than 0 0 0 1: the matrix is transposed; write it row by row");
        return None;
    }
    let rows = std::array::from_fn(|row| std::array::from_fn(|column| at(row, column)));
    let rotation = of_rows(&rows, pointer, findings)?;
    let translation = Vector3::new(at(0, 3), at(1, 3), at(2, 3)) * unit_mm;
    if translation.amax() > REACH_MM {
        findings.push(pointer, format!("lies {:.0} mm away; allowed are {REACH_MM} mm: is the unit wrong?", translation.norm()));
        return None;
    }
    Some(Isometry3::from_parts(Translation3::from(translation), rotation))
}
