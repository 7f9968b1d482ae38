//! Observations as other programs write them: MoveIt's `pose_samples.json`, and poses of the arm in the conventions of controllers.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;

use super::data::{CALIBRATION_DATA_SCHEMA, CalibrationData, ObservationDocument};
use super::pose::{ObservedPose, of_matrix};
use crate::cell::calibration::data::HandEyeSetup;
use crate::cell::{FieldError, Findings, closed_list};

/// Metres in millimetres: MoveIt's unit.
pub(super) const METRE_MM: f64 = 1000.0;

closed_list! {
    /// Convention of a controller for the rotation of the flange.
    pub enum RobotPoseKind {
        /// Universal Robots: rotation vector, rad.
        Urscript = "urscript",
        /// KUKA: A, B, C, degrees, about z, then the new y, then the new x.
        KukaAbc = "kuka_abc",
        /// ABB: q1 to q4, the scalar first.
        AbbQuat = "abb_quat",
        /// FANUC: W, P, R, degrees, about the fixed x, y, z.
        FanucWpr = "fanuc_wpr",
        /// Stäubli: rx, ry, rz, degrees, about x, then the new y, then the new z.
        Staubli = "staubli",
        /// Han's: rx, ry, rz, degrees, about the fixed x, y, z.
        HansRpy = "hans_rpy",
        /// Quaternion x, y, z, w.
        Quaternion = "quaternion",
    }
}

impl RobotPoseKind {
    /// Numbers that a rotation takes.
    #[must_use]
    pub fn count(self) -> usize {
        match self {
            Self::AbbQuat | Self::Quaternion => 4,
            Self::Urscript | Self::KukaAbc | Self::FanucWpr | Self::Staubli | Self::HansRpy => 3,
        }
    }

    /// Rotation of these numbers; none if a quaternion is not one.
    #[must_use]
    pub fn rotation(self, numbers: &[f64]) -> Option<UnitQuaternion<f64>> {
        if numbers.len() != self.count() || numbers.iter().any(|number| !number.is_finite()) {
            return None;
        }
        let about = |axis: Vector3<f64>, angle_deg: f64| UnitQuaternion::from_scaled_axis(axis * angle_deg.to_radians());
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        let unit = |quaternion: Quaternion<f64>| {
            ((quaternion.norm() - 1.0).abs() < 2e-3).then(|| UnitQuaternion::from_quaternion(quaternion))
        };
        match *numbers {
            [a, b, c] => Some(match self {
                Self::Urscript => UnitQuaternion::from_scaled_axis(Vector3::new(a, b, c)),
                Self::KukaAbc => about(z, a) * about(y, b) * about(x, c),
                Self::Staubli => about(x, a) * about(y, b) * about(z, c),
                Self::FanucWpr | Self::HansRpy | Self::AbbQuat | Self::Quaternion => about(z, c) * about(y, b) * about(x, a),
            }),
            [a, b, c, d] => unit(if self == Self::AbbQuat { Quaternion::new(a, b, c, d) } else { Quaternion::new(d, a, b, c) }),
            _ => None,
        }
    }

    /// Pose of a place and a rotation.
    #[must_use]
    pub fn pose(self, translation_mm: [f64; 3], numbers: &[f64]) -> Option<Isometry3<f64>> {
        Some(Isometry3::from_parts(Translation3::from(translation_mm), self.rotation(numbers)?))
    }
}

/// Observations of MoveIt's `pose_samples.json`: pairs of base_from_flange and cloud_from_board, each of 16 numbers or four rows,
/// metres.
///
/// # Errors
/// Every pair that is not one.
pub fn from_pose_samples(value: &Value, setup: HandEyeSetup) -> Result<CalibrationData, Vec<FieldError>> {
    let mut findings = Findings::default();
    let pairs = value.as_array().map_or(&[][..], Vec::as_slice);
    findings.require(!pairs.is_empty(), "", || "has no pairs of poses".into());
    let mut observations = Vec::new();
    for (index, pair) in pairs.iter().enumerate() {
        let mut pose = |side: usize| {
            let numbers = flat(&pair[side]);
            of_matrix(&numbers, METRE_MM, &format!("/{index}/{side}"), &mut findings)
        };
        if let (Some(flange), Some(board)) = (pose(0), pose(1)) {
            observations.push(ObservationDocument {
                id: format!("p{:02}", index + 1),
                base_from_flange: Some(ObservedPose::of(&flange)),
                cloud_from_board: Some(ObservedPose::of(&board)),
                ..ObservationDocument::default()
            });
        }
    }
    findings.into_result()?;
    Ok(of_observations(observations, setup))
}

/// Numbers of a list, or of its rows.
pub(super) fn flat(value: &Value) -> Vec<f64> {
    let of_row = |row: &Value| match row.as_array() {
        Some(numbers) => numbers.iter().filter_map(Value::as_f64).collect(),
        None => row.as_f64().into_iter().collect::<Vec<f64>>(),
    };
    value.as_array().into_iter().flatten().take(17).flat_map(of_row).collect()
}

/// Data with these observations and nothing else known.
pub(super) fn of_observations(observations: Vec<ObservationDocument>, setup: HandEyeSetup) -> CalibrationData {
    CalibrationData {
        schema: CALIBRATION_DATA_SCHEMA.to_owned(),
        cell: None,
        setup,
        cloud_frame: None,
        taken_at: None,
        temperature_c: None,
        board: None,
        camera: None,
        sigma: None,
        observations,
        plate: Vec::new(),
    }
}
