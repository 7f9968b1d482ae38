//! Closed forms for arms with an ortho-parallel basis and a spherical wrist, after M. Brandstötter, A. Angerer and
//! M. Hofbaur, "An Analytical Solution of the Inverse Kinematics Problem of Industrial Serial Manipulators with an
//! Ortho-parallel Basis and a Spherical Wrist", Austrian Robotics Workshop 2014.
//!
//! Geometry with all model angles θ at zero: axis 1 along +z at the foot; shoulder at (a1, b, c1) with axes 2 and 3 along
//! +y, c2 apart along z; wrist centre at (a2, 0, c3) from the elbow; wrist axes z, y, z; flange c4 above the wrist centre.
//! Vendor joints q give θ = sign·q − offset. The inverse takes about 1 µs for all eight branches.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{JointAxes, LinkFrames, principal, shift, turn_z};
use crate::cell::field_error::Findings;
use crate::cell::field_ranges;
use crate::geometry::{Base, Flange, Pose};

/// A cosine this far beyond 1 is rounding at the stretched or folded arm; the wrist centre moves less than 1e-6 mm.
pub(super) const COSINE_SLACK: f64 = 1e-12;

/// Dimensions, signs and offsets of an ortho-parallel arm with a spherical wrist.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct OpwSpec {
    /// Axis 1 to shoulder, along x, mm, -5000 to 5000.
    pub a1_mm: f64,
    /// Elbow to wrist centre, along x, mm, -5000 to 5000.
    pub a2_mm: f64,
    /// Axis 1 to the arm's plane, along y, mm, -5000 to 5000.
    pub b_mm: f64,
    /// Foot to shoulder, along z, mm, -5000 to 5000.
    pub c1_mm: f64,
    /// Shoulder to elbow, mm, 1 to 5000.
    pub c2_mm: f64,
    /// Elbow to wrist centre, along z, mm, 1 to 5000.
    pub c3_mm: f64,
    /// Wrist centre to flange, mm, 0 to 5000.
    pub c4_mm: f64,
    /// 1 or -1 for each joint.
    #[schema(min_items = 6, max_items = 6)]
    pub sign_corrections: [i8; 6],
    /// Model angle at the vendor's zero, negated, degrees, -360 to 360 each.
    #[schema(min_items = 6, max_items = 6)]
    pub offsets_deg: [f64; 6],
    /// The vendor counts joint 3 from the ground instead of from the upper arm, as FANUC does, and others of arms with a
    /// parallel rod: turning joint 2 alone then leaves the forearm's slope as it is. Default `false`.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub joint_3_from_ground: bool,
}

field_ranges! {
    OpwSpec {
        A1_MM = "a1_mm", [-5000.0, 5000.0] "mm";
        A2_MM = "a2_mm", [-5000.0, 5000.0] "mm";
        B_MM = "b_mm", [-5000.0, 5000.0] "mm";
        C1_MM = "c1_mm", [-5000.0, 5000.0] "mm";
        C2_MM = "c2_mm", [1.0, 5000.0] "mm";
        C3_MM = "c3_mm", [1.0, 5000.0] "mm";
        C4_MM = "c4_mm", [0.0, 5000.0] "mm";
        OFFSETS_DEG = "offsets_deg", [-360.0, 360.0] "°";
    }
}

impl OpwSpec {
    /// Records what is wrong, below `pointer`.
    pub fn check(&self, pointer: &str, findings: &mut Findings) {
        Self::A1_MM.check(pointer, &self.a1_mm, findings);
        Self::A2_MM.check(pointer, &self.a2_mm, findings);
        Self::B_MM.check(pointer, &self.b_mm, findings);
        Self::C1_MM.check(pointer, &self.c1_mm, findings);
        Self::C2_MM.check(pointer, &self.c2_mm, findings);
        Self::C3_MM.check(pointer, &self.c3_mm, findings);
        Self::C4_MM.check(pointer, &self.c4_mm, findings);
        for (joint, sign) in self.sign_corrections.iter().enumerate() {
            findings.require(matches!(*sign, 1 | -1), format!("{pointer}/sign_corrections/{joint}"), || {
                format!("is {sign}; allowed is 1 or -1")
            });
        }
        Self::OFFSETS_DEG.check(pointer, &self.offsets_deg, findings);
    }

    /// The solver.
    #[must_use]
    pub fn build(&self) -> Opw {
        Opw {
            a1_mm: self.a1_mm,
            a2_mm: self.a2_mm,
            b_mm: self.b_mm,
            c1_mm: self.c1_mm,
            c2_mm: self.c2_mm,
            c3_mm: self.c3_mm,
            c4_mm: self.c4_mm,
            signs: self.sign_corrections.map(f64::from),
            offsets_rad: self.offsets_deg.map(f64::to_radians),
            joint_3_from_ground: self.joint_3_from_ground,
        }
    }
}

/// An ortho-parallel arm with a spherical wrist.
#[derive(Clone, Debug, PartialEq)]
pub struct Opw {
    pub(super) a1_mm: f64,
    pub(super) a2_mm: f64,
    pub(super) b_mm: f64,
    pub(super) c1_mm: f64,
    pub(super) c2_mm: f64,
    pub(super) c3_mm: f64,
    pub(super) c4_mm: f64,
    pub(super) signs: [f64; 6],
    pub(super) offsets_rad: [f64; 6],
    pub(super) joint_3_from_ground: bool,
}

impl Opw {
    /// Radians of joint 3 for a vendor's radian of joint 2.
    fn joint_3_of_2(&self) -> f64 {
        if self.joint_3_from_ground { self.signs[1] * self.signs[2] } else { 0.0 }
    }

    /// Foot, joints 1 to 5, flange. Frames 4 and 5 have their origin at the wrist centre, and frame 1 at the height of
    /// the shoulder.
    pub(super) fn link_frames(&self, joints_rad: &[f64; 6]) -> LinkFrames {
        let mut joints_rad = *joints_rad;
        joints_rad[2] -= self.joint_3_of_2() * joints_rad[1];
        let theta: [f64; 6] = std::array::from_fn(|i| self.signs[i] * joints_rad[i] - self.offsets_rad[i]);
        let base_from_1 = shift(0.0, 0.0, self.c1_mm) * turn_z(theta[0]);
        let base_from_2 = base_from_1 * shift(self.a1_mm, self.b_mm, 0.0) * turn_y(theta[1]);
        let base_from_3 = base_from_2 * shift(0.0, 0.0, self.c2_mm) * turn_y(theta[2]);
        let base_from_4 = base_from_3 * shift(self.a2_mm, 0.0, self.c3_mm) * turn_z(theta[3]);
        let base_from_5 = base_from_4 * turn_y(theta[4]);
        let base_from_6 = base_from_5 * turn_z(theta[5]) * shift(0.0, 0.0, self.c4_mm);
        [Isometry3::identity(), base_from_1, base_from_2, base_from_3, base_from_4, base_from_5, base_from_6]
    }

    /// Shoulder front and back × elbow both ways × wrist both ways. A pose beyond the reach by more than `slack` has none;
    /// with more than [`COSINE_SLACK`] the answers are near misses there, the elbow bent both ways.
    pub(super) fn inverse(&self, base_from_flange: &Pose<Base, Flange>, slack: f64) -> Vec<[f64; 6]> {
        let rotation = base_from_flange.isometry().rotation.to_rotation_matrix();
        let wrist = base_from_flange.origin_mm().coords - rotation * Vector3::z() * self.c4_mm;
        let mut solutions = Vec::with_capacity(8);
        for (theta1, x, z) in self.shoulders(&wrist, slack) {
            for (theta2, theta3) in self.elbows(x, z, slack) {
                let base_from_3 = Rotation3::from_axis_angle(&Vector3::z_axis(), theta1)
                    * Rotation3::from_axis_angle(&Vector3::y_axis(), theta2 + theta3);
                for [theta4, theta5, theta6] in wrists(&(base_from_3.inverse() * rotation)) {
                    let theta = [theta1, theta2, theta3, theta4, theta5, theta6];
                    let mut joints = std::array::from_fn(|i| self.signs[i] * (theta[i] + self.offsets_rad[i]));
                    joints[2] += self.joint_3_of_2() * joints[1];
                    solutions.push(joints.map(principal));
                }
            }
        }
        solutions
    }

    /// θ1 facing the wrist and facing away from it, each with the wrist as seen from the shoulder in the arm's plane.
    fn shoulders(&self, wrist: &Vector3<f64>, slack: f64) -> impl Iterator<Item = (f64, f64, f64)> + use<> {
        let forward2 = wrist.x * wrist.x + wrist.y * wrist.y - self.b_mm * self.b_mm;
        // Closer to axis 1 than the arm's plane can come: no solution, unless by rounding.
        let reachable = forward2 >= -slack * self.b_mm * self.b_mm;
        let forward = forward2.max((slack - COSINE_SLACK) * self.b_mm * self.b_mm).sqrt();
        let (azimuth, z, a1, b) = (wrist.y.atan2(wrist.x), wrist.z - self.c1_mm, self.a1_mm, self.b_mm);
        [forward, -forward].into_iter().filter(move |_| reachable).map(move |x| (azimuth - b.atan2(x), x - a1, z))
    }

    /// θ2 and θ3 of the planar two-bar chain to (x, z), elbow one way and the other.
    fn elbows(&self, x: f64, z: f64, slack: f64) -> impl Iterator<Item = (f64, f64)> + use<> {
        let forearm = self.a2_mm.hypot(self.c3_mm);
        let upper = self.c2_mm;
        let bend = self.a2_mm.atan2(self.c3_mm);
        let cosine = (x * x + z * z - upper * upper - forearm * forearm) / (2.0 * upper * forearm);
        let sine = (1.0 - cosine * cosine).max(slack - COSINE_SLACK).sqrt();
        [sine, -sine].into_iter().filter(move |_| cosine.abs() <= 1.0 + slack).map(move |sine| {
            let theta2 = x.atan2(z) - (forearm * sine).atan2(upper + forearm * cosine);
            (theta2, sine.atan2(cosine) - bend)
        })
    }
}

/// Axis of each joint in its frame; the joint turns against it where the vendor's sign is negative.
pub(super) const JOINT_AXES: JointAxes =
    [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// θ4, θ5, θ6 with Rz(θ4) Ry(θ5) Rz(θ6) = `rotation`, wrist one way and flipped. θ6 is read off what θ4 and θ5 leave over,
/// so that at θ5 = 0 or π, where only θ4 ± θ6 counts, the product still holds to the last digit (θ4 is 0 there, or π).
fn wrists(rotation: &Rotation3<f64>) -> [[f64; 3]; 2] {
    let r = rotation.matrix();
    let theta4 = r[(1, 2)].atan2(r[(0, 2)]);
    let theta5 = r[(0, 2)].hypot(r[(1, 2)]).atan2(r[(2, 2)]);
    let sine = Vector3::new(-theta4.sin(), theta4.cos(), 0.0);
    let theta6 = sine.dot(&r.column(0)).atan2(sine.dot(&r.column(1)));
    [[theta4, theta5, theta6], [theta4 + PI, -theta5, theta6 + PI]]
}

fn turn_y(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle_rad)
}
