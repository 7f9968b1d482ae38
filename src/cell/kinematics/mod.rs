//! Where the arm is: joints to frames, and back. Joints are in the vendor's convention, radians; lengths are mm.
//!
//! Frames of an arm: 0 is the foot, 1 to 6 move with joints 1 to 6 and each has its origin on its joint's axis; 6 is the
//! flange. Collision bodies of a link are given in these frames.

mod opw;

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use opw::{Opw, OpwSpec};

use super::field_error::Findings;
use crate::geometry::{Base, Flange, Pose};

/// Frames 0 to 6, each as base-from-frame.
pub type LinkFrames = [Isometry3<f64>; 7];

/// How an arm is built.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum KinematicsSpec {
    /// Ortho-parallel basis with spherical wrist.
    Opw(OpwSpec),
}

impl KinematicsSpec {
    /// Records what is wrong, below `pointer`.
    pub fn check(&self, pointer: &str, findings: &mut Findings) {
        match self {
            Self::Opw(spec) => spec.check(pointer, findings),
        }
    }

    /// The solver.
    #[must_use]
    pub fn build(&self) -> Kinematics {
        match self {
            Self::Opw(spec) => Kinematics::Opw(spec.build()),
        }
    }
}

/// Solver of one kind of arm.
#[derive(Clone, Debug, PartialEq)]
pub enum Kinematics {
    /// Ortho-parallel basis with spherical wrist.
    Opw(Opw),
}

impl Kinematics {
    /// Frames 0 to 6 at these joints.
    #[must_use]
    pub fn link_frames(&self, joints_rad: &[f64; 6]) -> LinkFrames {
        match self {
            Self::Opw(arm) => arm.link_frames(joints_rad),
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
    pub fn branches(&self, base_from_flange: &Pose<Base, Flange>) -> Vec<[f64; 6]> {
        match self {
            Self::Opw(arm) => arm.inverse(base_from_flange),
        }
    }
}

#[cfg(test)]
mod tests;
