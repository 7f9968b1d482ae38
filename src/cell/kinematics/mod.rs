//! Kinematics of the arm: joints to frames, and back. Joints are in the vendor's convention, radians; lengths are mm.
//!
//! Frames of an arm: 0 is the foot, 1 to 6 move with joints 1 to 6 and each has its origin on its joint's axis; 6 is the
//! flange. Collision bodies of a link are given in these frames.

mod chain;
mod classify;
mod opw;
mod ur;

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};
use serde::{Deserialize, Serialize};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

pub use chain::{Chain, ChainJointSpec, ChainSpec};
pub use opw::{Opw, OpwSpec};
pub use ur::UrSpec;

use super::field_error::Findings;
use crate::geometry::{Base, Flange, Pose};

/// Frames 0 to 6, each as base-from-frame.
pub type LinkFrames = [Isometry3<f64>; 7];

/// The axis of each joint in the frame that it turns.
type JointAxes = [[f64; 3]; 6];

/// Squared sine of the angle between two axes below which they are taken as parallel, and meet nowhere.
const PARALLEL: f64 = 1e-12;
/// Length that a maker's calibration may add where the design has none, mm: no sense of an axis is told by less. Our choice.
const CALIBRATED_MM: f64 = 5.0;
/// Cosine or length that rounding leaves where there is none.
const ROUNDING: f64 = 1e-9;

/// Build of an arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum KinematicsSpec {
    /// Ortho-parallel basis with spherical wrist.
    Opw(OpwSpec),
    /// Three parallel axes, then right angles.
    Ur(UrSpec),
    /// Any six turning joints.
    Chain(Box<ChainSpec>),
}

impl KinematicsSpec {
    /// Records what is wrong, below `pointer`.
    pub fn check(&self, pointer: &str, findings: &mut Findings) {
        match self {
            Self::Opw(spec) => spec.check(pointer, findings),
            Self::Ur(spec) => spec.check(pointer, findings),
            Self::Chain(spec) => spec.check(pointer, findings),
        }
    }

    /// The solver.
    #[must_use]
    pub fn build(&self) -> Kinematics {
        match self {
            Self::Opw(spec) => Kinematics::Opw(spec.build()),
            Self::Ur(spec) => Kinematics::Ur(spec.clone()),
            Self::Chain(spec) => Kinematics::Chain(Box::new(spec.build())),
        }
    }
}

/// Solver of one kind of arm.
#[derive(Clone, Debug, PartialEq)]
pub enum Kinematics {
    /// Ortho-parallel basis with spherical wrist.
    Opw(Opw),
    /// Three parallel axes, then right angles.
    Ur(UrSpec),
    /// Any six turning joints.
    Chain(Box<Chain>),
}

impl Kinematics {
    /// Frames 0 to 6 at these joints.
    #[must_use]
    pub fn link_frames(&self, joints_rad: &[f64; 6]) -> LinkFrames {
        match self {
            Self::Opw(arm) => arm.link_frames(joints_rad),
            Self::Ur(arm) => ur::link_frames(arm, joints_rad),
            Self::Chain(arm) => arm.link_frames(joints_rad),
        }
    }

    /// The flange at these joints.
    #[must_use]
    pub fn base_from_flange(&self, joints_rad: &[f64; 6]) -> Pose<Base, Flange> {
        Pose::claim(self.link_frames(joints_rad)[6])
    }

    /// Every joint vector that puts the flange there, one a branch, each angle in (−π, π]; limits are not looked at.
    /// At a singularity, where infinitely many would do, each branch gives one of them.
    #[must_use]
    pub fn ik_solutions(&self, base_from_flange: &Pose<Base, Flange>) -> Vec<[f64; 6]> {
        match self {
            Self::Opw(arm) => arm.inverse(base_from_flange, opw::COSINE_SLACK),
            Self::Ur(arm) => ur::inverse(arm, base_from_flange.isometry(), ur::SLACK),
            Self::Chain(arm) => arm.inverse(base_from_flange.isometry()),
        }
    }

    /// The arm configuration that a joint vector is in.
    #[must_use]
    pub fn posture(&self, joints_rad: &[f64; 6]) -> Posture {
        let (frames, senses) = (self.link_frames(joints_rad), self.axis_senses());
        let axes = self.axes_in_base(joints_rad);
        let axes: [Vector3<f64>; 6] = std::array::from_fn(|joint| axes[joint] * senses[joint]);
        let at = |frame: usize| frames[frame].translation.vector;
        let wrist = self.wrist_centre(&frames, &axes);
        // The forearm of three parallel axes ends at axis 4, wherever on it; the wrist stands off from there.
        let forearm_end = if self.has_three_parallel_axes() { at(4) } else { wrist };
        Posture {
            shoulder_back: axes[0].cross(&axes[1]).dot(&(wrist - at(1))) > 0.0,
            elbow_down: (at(3) - at(2)).cross(&(forearm_end - at(3))).dot(&axes[1]) < 0.0,
            wrist_flipped: axes[3].cross(&axes[5]).dot(&axes[4]) < 0.0,
        }
    }

    /// Senses, 1 or -1, that turn the axes as the closed forms have them, told by the arm with all joints at zero: a posture is then
    /// that of the arm, whichever way a file counts its angles. Axis 1 looks up in the base frame, axis 4 along the forearm or as
    /// axis 2, axis 5 as axis 2 or towards the wrist, axis 6 out of the flange.
    fn axis_senses(&self) -> [f64; 6] {
        let zero = [0.0; 6];
        let (frames, axes) = (self.link_frames(&zero), self.axes_in_base(&zero));
        let at = |frame: usize| frames[frame].translation.vector;
        let wrist = self.wrist_centre(&frames, &axes);
        let one = sense(axes[0].z);
        let up = axes[0] * one;
        let two = front_sense(&axes[1].cross(&up), &up, [at(1), at(2), wrist]);
        let across = axes[1] * two;
        let [four, five] = if self.has_three_parallel_axes() {
            [sense(axes[3].dot(&across)), sense(axes[4].dot(&(wrist - at(4))))]
        } else {
            [sense(axes[3].dot(&(wrist - at(3)))), sense(axes[4].dot(&across))]
        };
        let out_mm = axes[5].dot(&(at(6) - wrist));
        let flange_z = frames[6].rotation * Vector3::z();
        let six = if out_mm.abs() > CALIBRATED_MM { sense(out_mm) } else { sense(axes[5].dot(&flange_z)) };
        [one, two, 1.0, four, five, six]
    }

    /// Distance from a singularity: the smallest singular value of the flange's Jacobian, its lengths in parts of
    /// upper arm and forearm together; 0 at a singularity (T. Yoshikawa, "Manipulability of Robotic Mechanisms", Int. J. Robotics
    /// Research 4(2), 1985, section 3, of whose measure this is the last factor).
    #[must_use]
    pub fn singularity_margin(&self, joints_rad: &[f64; 6]) -> f64 {
        let (frames, axes) = (self.link_frames(joints_rad), self.axes_in_base(joints_rad));
        let at = |frame: usize| frames[frame].translation.vector;
        let length = (at(3) - at(2)).norm() + (at(5) - at(3)).norm();
        // Of the wrist's centre: how far the flange stands out is no matter of posture.
        let wrist = self.wrist_centre(&frames, &axes);
        let jacobian = Matrix6::from_columns(&std::array::from_fn::<_, 6, _>(|joint| {
            let (axis, on_axis) = (axes[joint], if joint == 5 { wrist } else { at(joint + 1) });
            let moved = axis.cross(&(wrist - on_axis)) / length.max(1.0);
            Vector6::new(moved.x, moved.y, moved.z, axis.x, axis.y, axis.z)
        }));
        jacobian.singular_values().min()
    }

    /// The joints' axes, base frame.
    fn axes_in_base(&self, joints_rad: &[f64; 6]) -> [Vector3<f64>; 6] {
        let frames = self.link_frames(joints_rad);
        let axes = match self {
            Self::Opw(_) => opw::JOINT_AXES,
            Self::Ur(_) => ur::JOINT_AXES,
            Self::Chain(arm) => arm.joint_axes(),
        };
        std::array::from_fn(|joint| frames[joint + 1].rotation * Vector3::from(axes[joint]))
    }

    /// Returns true if axes 2, 3 and 4 are parallel.
    fn has_three_parallel_axes(&self) -> bool {
        match self {
            Self::Opw(_) => false,
            Self::Ur(_) => true,
            Self::Chain(arm) => arm.closed_form() == Some("ur"),
        }
    }

    /// Point of axis 6 that is nearest to axis 5, base frame: the wrist's centre, where the two meet. The origin of frame 5 is on
    /// axis 5, and beside axis 6 where the wrist is no spherical one.
    fn wrist_centre(&self, frames: &LinkFrames, axes: &[Vector3<f64>; 6]) -> Vector3<f64> {
        let at = |frame: usize| frames[frame].translation.vector;
        let on_axis_6 = match self {
            Self::Opw(_) => return at(5),
            Self::Ur(_) => at(6),
            // The flange need not lie on axis 6.
            Self::Chain(arm) => (frames[6] * arm.flange.inverse()).translation.vector,
        };
        let normal = axes[4].cross(&axes[5]);
        let square = normal.norm_squared();
        if square < PARALLEL {
            return on_axis_6;
        }
        on_axis_6 + axes[5] * ((on_axis_6 - at(5)).cross(&axes[4]).dot(&normal) / square)
    }

    /// Returns true if joint 3 is counted from the ground: it keeps its slope as joint 2 turns.
    #[must_use]
    pub(crate) fn counts_joint_3_from_ground(&self) -> bool {
        matches!(self, Self::Opw(arm) if arm.joint_3_from_ground)
    }

    /// Motion bounds for a radian of each of the vendor's joints, where `motion_bound_mm` is that of the joints of the chain.
    #[must_use]
    pub(super) fn of_vendor_joints(&self, mut motion_bound_mm: [f64; 7]) -> [f64; 7] {
        if self.counts_joint_3_from_ground() {
            motion_bound_mm[1] += motion_bound_mm[2];
        }
        motion_bound_mm
    }

    /// Distance of the flange's origin from axis 6, mm.
    #[must_use]
    pub(super) fn flange_off_axis_mm(&self) -> f64 {
        match self {
            Self::Opw(_) | Self::Ur(_) => 0.0,
            Self::Chain(arm) => arm.flange_off_axis_mm(),
        }
    }
}

/// Arm configuration: which way shoulder, elbow and wrist are bent, as makers tell solutions apart. The front is where the shoulder
/// stands off axis 1; of an arm whose shoulder does not, where it lies with all joints at zero, or +x of its base where it stands
/// upright then.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Posture {
    /// The wrist is behind axis 1.
    pub shoulder_back: bool,
    /// The elbow hangs below the line from shoulder to wrist, the arm reaching forward.
    pub elbow_down: bool,
    /// Axis 5 is turned to its negative side.
    pub wrist_flipped: bool,
}

impl Posture {
    fn all() -> impl Iterator<Item = Self> {
        let of_bits = |bits: u8| Self { shoulder_back: bits & 4 != 0, elbow_down: bits & 2 != 0, wrist_flipped: bits & 1 != 0 };
        (0..8).map(of_bits)
    }
}

impl PartialSchema for Posture {
    fn schema() -> RefOr<Schema> {
        ObjectBuilder::new()
            .schema_type(Type::String)
            .description(Some("Arm configuration: which way shoulder, elbow and wrist are bent."))
            .enum_values(Some(Self::all().map(|posture| posture.to_string())))
            .into()
    }
}

impl ToSchema for Posture {}

impl std::fmt::Display for Posture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (shoulder, elbow) =
            (if self.shoulder_back { "back" } else { "front" }, if self.elbow_down { "elbow down" } else { "elbow up" });
        write!(f, "{shoulder}, {elbow}, {}", if self.wrist_flipped { "flip" } else { "no flip" })
    }
}

/// Returns -1 for what is below zero by more than rounding, else 1.
fn sense(value: f64) -> f64 {
    if value < -ROUNDING { -1.0 } else { 1.0 }
}

/// Returns 1 if `forward` looks to the front of an arm with all joints at zero, else -1. The points are one of axis 1, one of axis 2
/// and the wrist's centre.
fn front_sense(forward: &Vector3<f64>, up: &Vector3<f64>, [foot, shoulder, wrist]: [Vector3<f64>; 3]) -> f64 {
    let offset_mm = (shoulder - foot).dot(forward);
    let (ahead_mm, height_mm) = ((wrist - foot).dot(forward), (wrist - shoulder).dot(up));
    if offset_mm.abs() > CALIBRATED_MM {
        sense(offset_mm)
    } else if ahead_mm.abs() > height_mm.abs() + CALIBRATED_MM {
        sense(ahead_mm)
    } else {
        sense(forward.x)
    }
}

/// The angle of the same direction in (−π, π].
fn principal(angle_rad: f64) -> f64 {
    let turned = angle_rad.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

fn shift(x: f64, y: f64, z: f64) -> Translation3<f64> {
    Translation3::new(x, y, z)
}

fn turn_z(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
}

#[cfg(test)]
mod tests;
