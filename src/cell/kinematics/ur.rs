//! Closed forms for arms whose axes 2, 3 and 4 are parallel and whose last three follow one another at right angles
//! (Universal Robots). Denavit–Hartenberg rows (θ, d, a, α): (θ1, d1, 0, 90°), (θ2, 0, a2, 0), (θ3, 0, a3, 0),
//! (θ4, d4, 0, 90°), (θ5, d5, 0, −90°), (θ6, d6, 0, 0), in the frame that the maker calls base.
//!
//! The inverse is that of K. P. Hawkins, "Analytic Inverse Kinematics for the Universal Robots UR-5/UR-10 Arms", Georgia
//! Institute of Technology 2013, with angles taken from pairs of sine and cosine, so that they keep their digits near 0 and
//! 180°. It takes about 1 µs for all eight branches.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{JointAxes, LinkFrames, principal, shift, turn_z};
use crate::cell::field_error::Findings;
use crate::cell::field_ranges;

/// A sine or cosine this far beyond 1 is rounding at the edge of the reach.
pub(super) const SLACK: f64 = 1e-12;
/// Below this sine of θ5 axes 4 and 6 are taken as parallel, and θ6 as 0.
const PARALLEL: f64 = 1e-9;

/// Dimensions of an arm with three parallel axes, as its maker lists them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct UrSpec {
    /// Foot to shoulder, mm, -5000 to 5000.
    pub d1_mm: f64,
    /// Shoulder to elbow, mm, -5000 to 5000, not within 1 of 0; negative for Universal Robots.
    pub a2_mm: f64,
    /// Elbow to axis 4, mm, -5000 to 5000, not within 1 of 0; negative for Universal Robots.
    pub a3_mm: f64,
    /// Along axis 4, mm, -5000 to 5000.
    pub d4_mm: f64,
    /// Along axis 5, mm, -5000 to 5000.
    pub d5_mm: f64,
    /// Along axis 6 to the flange, mm, -5000 to 5000.
    pub d6_mm: f64,
}

field_ranges! {
    UrSpec {
        D1_MM = "d1_mm", [-5000.0, 5000.0] "mm";
        A2_MM = "a2_mm", [-5000.0, 5000.0] "mm";
        A3_MM = "a3_mm", [-5000.0, 5000.0] "mm";
        D4_MM = "d4_mm", [-5000.0, 5000.0] "mm";
        D5_MM = "d5_mm", [-5000.0, 5000.0] "mm";
        D6_MM = "d6_mm", [-5000.0, 5000.0] "mm";
    }
}

impl UrSpec {
    /// Records what is wrong, below `pointer`.
    pub fn check(&self, pointer: &str, findings: &mut Findings) {
        Self::D1_MM.check(pointer, &self.d1_mm, findings);
        Self::A2_MM.check(pointer, &self.a2_mm, findings);
        Self::A3_MM.check(pointer, &self.a3_mm, findings);
        Self::D4_MM.check(pointer, &self.d4_mm, findings);
        Self::D5_MM.check(pointer, &self.d5_mm, findings);
        Self::D6_MM.check(pointer, &self.d6_mm, findings);
        for (name, value) in [("a2_mm", self.a2_mm), ("a3_mm", self.a3_mm)] {
            findings.require(value.abs() >= 1.0, format!("{pointer}/{name}"), || {
                format!("is {value} mm; allowed is at least 1 mm either way")
            });
        }
    }
}

/// FK of the rows: the frame that each joint turns, with its origin on the joint's axis z; frame 6 is the flange.
pub(super) fn link_frames(arm: &UrSpec, theta: &[f64; 6]) -> LinkFrames {
    let base_from_1 = shift(0.0, 0.0, arm.d1_mm) * turn_z(theta[0]);
    let base_from_2 = base_from_1 * turn_x(FRAC_PI_2) * turn_z(theta[1]);
    let base_from_3 = base_from_2 * shift(arm.a2_mm, 0.0, 0.0) * turn_z(theta[2]);
    let base_from_4 = base_from_3 * shift(arm.a3_mm, 0.0, 0.0) * turn_z(theta[3]);
    let base_from_5 = base_from_4 * shift(0.0, 0.0, arm.d4_mm) * turn_x(FRAC_PI_2) * turn_z(theta[4]);
    let base_from_6 = base_from_5 * shift(0.0, 0.0, arm.d5_mm) * turn_x(-FRAC_PI_2) * turn_z(theta[5]);
    let base_from_flange = base_from_6 * shift(0.0, 0.0, arm.d6_mm);
    [Isometry3::identity(), base_from_1, base_from_2, base_from_3, base_from_4, base_from_5, base_from_flange]
}

/// Axis of each joint: +z of its frame.
pub(super) const JOINT_AXES: JointAxes = [[0.0, 0.0, 1.0]; 6];

/// Shoulder left and right × wrist both ways × elbow both ways, angles in (−π, π]. A pose beyond the reach by more than
/// `slack` has none; with more than [`SLACK`] the answers are near misses there, the elbow bent both ways.
pub(super) fn inverse(arm: &UrSpec, base_from_flange: &Isometry3<f64>, slack: f64) -> Vec<[f64; 6]> {
    let mut solutions = Vec::with_capacity(8);
    let wrist = base_from_flange * Point3::new(0.0, 0.0, -arm.d6_mm);
    for theta1 in shoulders(arm, &wrist, slack) {
        // Axes 2, 3 and 4 in the flange's frame.
        let axis = Vector3::new(theta1.sin(), -theta1.cos(), 0.0);
        let axis = base_from_flange.rotation.inverse() * axis;
        let sine = axis.x.hypot(axis.y);
        for theta5 in [sine.atan2(axis.z), (-sine).atan2(axis.z)] {
            let theta6 = if sine < PARALLEL { 0.0 } else { (-axis.y * theta5.signum()).atan2(axis.x * theta5.signum()) };
            let from_1 = (shift(0.0, 0.0, arm.d1_mm) * turn_z(theta1) * turn_x(FRAC_PI_2)).inverse();
            let beyond_4 = shift(0.0, 0.0, arm.d4_mm)
                * turn_x(FRAC_PI_2)
                * turn_z(theta5)
                * shift(0.0, 0.0, arm.d5_mm)
                * turn_x(-FRAC_PI_2)
                * turn_z(theta6)
                * shift(0.0, 0.0, arm.d6_mm);
            let planar = from_1 * base_from_flange * beyond_4.inverse();
            for [theta2, theta3, theta4] in planes(arm, &planar, slack) {
                solutions.push([theta1, theta2, theta3, theta4, theta5, theta6].map(principal));
            }
        }
    }
    solutions
}

/// θ1 with axis 4 passing the wrist at d4, on one side and on the other.
fn shoulders(arm: &UrSpec, wrist: &Point3<f64>, slack: f64) -> impl Iterator<Item = f64> + use<> {
    let (away, azimuth, offset) = (wrist.x.hypot(wrist.y), wrist.y.atan2(wrist.x), arm.d4_mm);
    let reachable = away > 0.0 && offset.abs() <= away * (1.0 + slack);
    let max = 1.0 - (slack - SLACK);
    let turn = (offset / away).clamp(-max, max).asin();
    [azimuth + turn, azimuth + PI - turn].into_iter().filter(move |_| reachable)
}

/// θ2, θ3, θ4 of the chain in the plane across axis 2, elbow one way and the other.
fn planes(arm: &UrSpec, planar: &Isometry3<f64>, slack: f64) -> impl Iterator<Item = [f64; 3]> + use<> {
    let (x, y) = (planar.translation.x, planar.translation.y);
    let turned = planar.rotation * Vector3::x();
    let whole = turned.y.atan2(turned.x);
    let (a2, a3) = (arm.a2_mm, arm.a3_mm);
    let cosine = (x * x + y * y - a2 * a2 - a3 * a3) / (2.0 * a2 * a3);
    let sine = (1.0 - cosine * cosine).max(slack - SLACK).sqrt();
    [sine, -sine].into_iter().filter(move |_| cosine.abs() <= 1.0 + slack).map(move |sine| {
        let theta3 = sine.atan2(cosine);
        let theta2 = y.atan2(x) - (a3 * sine).atan2(a2 + a3 * cosine);
        [theta2, theta3, whole - theta2 - theta3]
    })
}

fn turn_x(angle_rad: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle_rad))
}
