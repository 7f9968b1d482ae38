//! Any arm of six turning joints, given as a chain of joint origins and axes, as a URDF has it.
//!
//! Its inverse begins at the closed form of the ortho-parallel or three-parallel arm that the chain is, or nearly is
//! ([`super::classify`]), and where it is neither, at postures spread over all joints. Each beginning is led to the
//! chain's own solution by the damped Gauss–Newton steps of T. Sugihara, "Solvability-unconcerned inverse kinematics by the
//! Levenberg–Marquardt method", IEEE Trans. Robotics 27(5), 2011: damping in proportion to the remaining error. From a
//! closed form one or two steps do, 2 to 5 µs a branch; without one an inverse takes about half a millisecond and may miss a
//! branch, never invent one.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Matrix6, UnitQuaternion, UnitVector3, Vector3, Vector6};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::classify::{ClosedForm, classify};
use super::{JointAxes, LinkFrames, principal};
use crate::cell::field_error::Findings;
use crate::cell::halton::{PRIMES, halton};
use crate::cell::pose_spec::{PoseInput, PoseSpec};

/// Largest distance by which a solution is off, mm.
const PLACE_MM: f64 = 1e-7;
/// Largest angle by which a solution is off, radians.
const TURN_RAD: f64 = 1e-10;
/// Weight of a radian beside a millimetre while both are brought down together.
const MM_OF_RAD: f64 = 300.0;
/// Steps from a closed form, from anywhere.
const STEPS: [usize; 2] = [25, 60];
/// Damping as a share of the remaining error; Sugihara's bias, small enough to keep Newton's last steps quadratic.
const DAMPING: f64 = 1e-4;
/// Smallest damping, where joints have become one, mm² a rad².
const MIN_DAMPING: f64 = 1e-4;
/// Beginnings where no closed form is known.
const SEEDS: u32 = 32;
/// Solutions that differ less than this in every joint are one, radians.
const SAME_RAD: f64 = 1e-5;

/// A joint of a chain, as the joint before it stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ChainJointSpec {
    /// The joint's frame at angle zero in the frame of the joint before it; the first in the foot's.
    #[schema(value_type = PoseInput)]
    pub origin: PoseSpec,
    /// Axis in the joint's frame, any length but zero.
    #[schema(min_items = 3, max_items = 3)]
    pub axis: [f64; 3],
}

/// An arm as a chain of six turning joints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ChainSpec {
    /// Joints 1 to 6.
    #[schema(min_items = 6, max_items = 6)]
    pub joints: [ChainJointSpec; 6],
    /// The flange in the frame of joint 6.
    #[schema(value_type = PoseInput)]
    pub flange: PoseSpec,
}

impl ChainSpec {
    /// Records what is wrong, below `pointer`.
    pub fn check(&self, pointer: &str, findings: &mut Findings) {
        for (index, joint) in self.joints.iter().enumerate() {
            joint.origin.check(&format!("{pointer}/joints/{index}/origin"), findings);
            let length = Vector3::from(joint.axis).norm();
            findings.require(length.is_finite() && length > 1e-6, format!("{pointer}/joints/{index}/axis"), || {
                format!("is {:?}; an axis has a direction", joint.axis)
            });
        }
        self.flange.check(&format!("{pointer}/flange"), findings);
    }

    /// The solver.
    #[must_use]
    pub fn build(&self) -> Chain {
        let joints = self
            .joints
            .each_ref()
            .map(|joint| Joint { origin: isometry(&joint.origin), axis: UnitVector3::new_normalize(Vector3::from(joint.axis)) });
        let mut chain = Chain { joints, flange: isometry(&self.flange), closed_form: None };
        chain.closed_form = classify(&chain).map(Box::new);
        chain
    }
}

/// One joint of a chain.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Joint {
    pub(super) origin: Isometry3<f64>,
    pub(super) axis: UnitVector3<f64>,
}

/// An arm of six turning joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    pub(super) joints: [Joint; 6],
    pub(super) flange: Isometry3<f64>,
    closed_form: Option<Box<ClosedForm>>,
}

impl Chain {
    /// Closed form that its inverse begins at: `opw`, `ur`, or `None` for postures spread over all joints.
    #[must_use]
    pub fn closed_form(&self) -> Option<&'static str> {
        self.closed_form.as_deref().map(ClosedForm::name)
    }

    /// Distance of the flange's origin from axis 6, mm.
    pub(super) fn flange_off_axis_mm(&self) -> f64 {
        let axis = Vector3::from(self.joint_axes()[5]);
        (self.flange.rotation.inverse() * self.flange.translation.vector).cross(&axis).norm()
    }

    /// Foot, joints 1 to 5, flange.
    pub(super) fn link_frames(&self, joints_rad: &[f64; 6]) -> LinkFrames {
        let mut frames = [Isometry3::identity(); 7];
        for (index, (joint, angle)) in self.joints.iter().zip(joints_rad).enumerate() {
            let turn = UnitQuaternion::from_axis_angle(&joint.axis, *angle);
            frames[index + 1] = frames[index] * joint.origin * turn;
        }
        frames[6] *= self.flange;
        frames
    }

    /// Axes in each joint's frame; the sixth as the flange has it.
    pub(super) fn joint_axes(&self) -> JointAxes {
        let mut axes = self.joints.each_ref().map(|joint| joint.axis.into_inner());
        axes[5] = self.flange.rotation.inverse() * axes[5];
        axes.map(Into::into)
    }

    /// Every solution found, angles in (−π, π].
    pub(super) fn inverse(&self, base_from_flange: &Isometry3<f64>) -> Vec<[f64; 6]> {
        let mut solutions: Vec<[f64; 6]> = Vec::with_capacity(8);
        let mut keep = |solution: Option<[f64; 6]>| {
            let found = solution.map(|joints| joints.map(principal));
            solutions.extend(found.filter(|joints| !solutions.iter().any(|other| is_same(joints, other))));
        };
        match &self.closed_form {
            Some(form) => {
                form.inverse(base_from_flange).into_iter().for_each(|from| keep(self.led(from, base_from_flange, STEPS[0])))
            }
            None => seeds().for_each(|from| keep(self.led(from, base_from_flange, STEPS[1]))),
        }
        solutions
    }

    /// The solution that steps from `joints_rad` lead to.
    fn led(&self, mut joints_rad: [f64; 6], goal: &Isometry3<f64>, steps: usize) -> Option<[f64; 6]> {
        for _ in 0..=steps {
            let frames = self.link_frames(&joints_rad);
            let error = residual(&frames[6], goal);
            let (place, turn) = (error.fixed_rows::<3>(0).norm(), error.fixed_rows::<3>(3).norm() / MM_OF_RAD);
            if place < PLACE_MM && turn < TURN_RAD {
                return Some(joints_rad);
            }
            let jacobian = self.jacobian(&frames);
            let transposed = jacobian.transpose();
            let damping = DAMPING * error.norm_squared().min(MM_OF_RAD * MM_OF_RAD) + MIN_DAMPING;
            let step = (transposed * jacobian + Matrix6::identity() * damping).cholesky()?.solve(&(transposed * error));
            (0..6).for_each(|joint| joints_rad[joint] += step[joint]);
        }
        None
    }

    /// Rows: flange's motion in mm, and its turn in rad · [`MM_OF_RAD`], base frame; columns: radians of each joint.
    fn jacobian(&self, frames: &LinkFrames) -> Matrix6<f64> {
        let tip = frames[6].translation.vector;
        let axes = self.joint_axes();
        Matrix6::from_columns(&std::array::from_fn::<_, 6, _>(|joint| {
            let axis = frames[joint + 1].rotation * Vector3::from(axes[joint]);
            // Frame 6 is the flange, which need not lie on axis 6.
            let on_axis = if joint == 5 {
                (frames[6] * self.flange.inverse()).translation.vector
            } else {
                frames[joint + 1].translation.vector
            };
            let moved = axis.cross(&(tip - on_axis));
            Vector6::new(moved.x, moved.y, moved.z, MM_OF_RAD * axis.x, MM_OF_RAD * axis.y, MM_OF_RAD * axis.z)
        }))
    }
}

/// Error of `flange` against `goal`, as in the rows of the Jacobian.
fn residual(flange: &Isometry3<f64>, goal: &Isometry3<f64>) -> Vector6<f64> {
    let place = goal.translation.vector - flange.translation.vector;
    let turn = (goal.rotation * flange.rotation.inverse()).scaled_axis() * MM_OF_RAD;
    Vector6::new(place.x, place.y, place.z, turn.x, turn.y, turn.z)
}

fn is_same(a: &[f64; 6], b: &[f64; 6]) -> bool {
    a.iter().zip(b).all(|(a, b)| principal(a - b).abs() < SAME_RAD)
}

/// Postures evenly spread over all joints, the same every time.
fn seeds() -> impl Iterator<Item = [f64; 6]> {
    (1..=SEEDS).map(|index| std::array::from_fn(|joint| TAU * (halton(index, PRIMES[joint]) - 0.5)))
}

fn isometry(spec: &PoseSpec) -> Isometry3<f64> {
    *spec.pose::<(), ()>().isometry()
}
