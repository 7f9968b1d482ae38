//! The arm: kinematics, joint limits, and for collision tests capsules around its links and, where they are known, the
//! surfaces inside.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::axis::{Axis, AxisSpec};
use super::body::{Body, Shape};
use super::dialect::Dialect;
use super::field_error::{FieldError, Findings};
use super::field_ranges;
use super::kinematics::{Kinematics, KinematicsSpec, LinkFrames};
use super::shape_spec::LinkBodySpec;
use crate::geometry::{Base, Flange, Pose};

/// A six-joint arm. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct RobotSpec {
    /// Name, unique among robots.
    pub name: String,
    /// Largest mass at the flange, kg, 0.1 to 2000.
    pub payload_kg: f64,
    /// Largest moment of what it carries about the flange's centre, N·m, 0.1 to 10000. Default: not checked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_flange_moment_nm: Option<f64>,
    /// Language of its controller: programs in the language of another maker are refused unless they are forced. `robodk` or
    /// `csv` where its maker's is not among them. Default: not known; programs may be in any language.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dialect: Option<Dialect>,
    /// Build of the arm.
    pub kinematics: KinematicsSpec,
    /// Joints 1 to 6.
    #[schema(min_items = 6, max_items = 6)]
    pub joints: [AxisSpec; 6],
    /// Envelope for collision tests; a link may have several.
    pub links: Vec<LinkSpec>,
    /// Surfaces of the links within their capsules: where a capsule comes too close, these decide. Each of their triangles lies
    /// within one capsule of its link. Default: none; the capsules decide.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<LinkBodySpec>,
}

/// A capsule around a part of one link.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct LinkSpec {
    /// Frame that it moves with: 0 the foot, 1 to 6 the joints, 6 the flange.
    pub link: u8,
    /// Name used in reports of collisions.
    pub name: String,
    /// Centre of one half ball, in the link's frame, mm, -5000 to 5000 each.
    #[schema(min_items = 3, max_items = 3)]
    pub from_mm: [f64; 3],
    /// Centre of the other half ball, mm, -5000 to 5000 each.
    #[schema(min_items = 3, max_items = 3)]
    pub to_mm: [f64; 3],
    /// Radius, mm, 1 to 1000.
    pub radius_mm: f64,
}

/// Windings of the joints with which an arm may stand at a pose: four joints of four turns each. All of them are looked at.
const MAX_WINDINGS: f64 = 256.0;

field_ranges! {
    RobotSpec {
        PAYLOAD_KG = "payload_kg", [0.1, 2000.0] "kg";
        MAX_FLANGE_MOMENT_NM = "max_flange_moment_nm", [0.1, 10_000.0] "N·m";
    }
}

field_ranges! {
    LinkSpec {
        LINK = "link", [0.0, 6.0] "";
        FROM_MM = "from_mm", [-5000.0, 5000.0] "mm";
        TO_MM = "to_mm", [-5000.0, 5000.0] "mm";
        RADIUS_MM = "radius_mm", [1.0, 1000.0] "mm";
    }
}

impl RobotSpec {
    /// Checks every field and builds the robot.
    ///
    /// # Errors
    /// All fields that are out of range or inconsistent.
    pub fn build(&self) -> Result<Robot, Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check(&mut findings);
        findings.into_result()?;
        Ok(Robot {
            name: self.name.clone(),
            payload_kg: self.payload_kg,
            max_flange_moment_nm: self.max_flange_moment_nm,
            dialect: self.dialect,
            kinematics: self.kinematics.build(),
            joints: self.joints.map(|joint| joint.build()),
            links: self.links.iter().map(LinkSpec::build).collect(),
        })
    }

    fn check(&self, findings: &mut Findings) {
        findings.require(!self.name.is_empty(), "/name", || "is empty; name the robot".into());
        Self::PAYLOAD_KG.check("", &self.payload_kg, findings);
        Self::MAX_FLANGE_MOMENT_NM.check("", &self.max_flange_moment_nm, findings);
        self.kinematics.check("/kinematics", findings);
        for (index, joint) in self.joints.iter().enumerate() {
            joint.check(&format!("/joints/{index}"), findings);
        }
        let windings =
            self.joints.iter().map(|joint| ((joint.max_deg - joint.min_deg) / 360.0).floor().max(1.0)).product::<f64>();
        findings.require(windings <= MAX_WINDINGS, "/joints", || {
            format!(
                "reach every pose in {windings} windings, the whole turns of their ranges multiplied; allowed are {MAX_WINDINGS}: give \
                 the joints no more turns than they need"
            )
        });
        findings.require(!self.links.is_empty(), "/links", || "is empty; collisions need at least one capsule".into());
        for (index, link) in self.links.iter().enumerate() {
            link.check(&format!("/links/{index}"), findings);
        }
        for (index, surface) in self.surfaces.iter().enumerate() {
            surface.check(&format!("/surfaces/{index}"), findings);
        }
    }
}

impl LinkSpec {
    fn check(&self, pointer: &str, findings: &mut Findings) {
        Self::LINK.check(pointer, &self.link, findings);
        findings.require(!self.name.is_empty(), format!("{pointer}/name"), || "is empty; name the link".into());
        Self::FROM_MM.check(pointer, &self.from_mm, findings);
        Self::TO_MM.check(pointer, &self.to_mm, findings);
        Self::RADIUS_MM.check(pointer, &self.radius_mm, findings);
    }

    fn build(&self) -> LinkCapsule {
        LinkCapsule {
            link: usize::from(self.link),
            name: self.name.clone(),
            from_mm: self.from_mm.into(),
            to_mm: self.to_mm.into(),
            radius_mm: self.radius_mm,
        }
    }
}

/// An arm, checked and in radians. Made from a [`RobotSpec`], whose surfaces are with its cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Name of the specification.
    pub name: String,
    /// Largest mass at the flange, kg.
    pub payload_kg: f64,
    /// Largest moment of what it carries about the flange's centre, N·m, if known.
    pub max_flange_moment_nm: Option<f64>,
    /// Language of its controller, if known.
    pub dialect: Option<Dialect>,
    /// Joints to frames, and back.
    pub kinematics: Kinematics,
    /// Limits of joints 1 to 6.
    pub joints: [Axis; 6],
    /// Envelope.
    pub links: Vec<LinkCapsule>,
}

/// A capsule that moves with one link.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkCapsule {
    /// Frame that it moves with, 0 to 6.
    pub link: usize,
    /// Name used in reports of collisions.
    pub name: String,
    /// Centre of one half ball, link frame.
    pub from_mm: Point3<f64>,
    /// Centre of the other half ball.
    pub to_mm: Point3<f64>,
    /// Radius.
    pub radius_mm: f64,
}

impl LinkCapsule {
    /// The capsule as a body of its link.
    #[must_use]
    pub fn body(&self) -> Body {
        let axis = self.to_mm - self.from_mm;
        // No rotation is found for −z and for no length at all; a capsule is the same either way round.
        let along = UnitQuaternion::rotation_between(&Vector3::z(), &axis).unwrap_or_default();
        let middle = Translation3::from(nalgebra::center(&self.from_mm, &self.to_mm).coords);
        Body {
            name: self.name.clone(),
            owner_from_body: Isometry3::from_parts(middle, along),
            shape: Shape::Capsule { radius_mm: self.radius_mm, length_mm: axis.norm() },
        }
    }

    /// Distance of a point of the link's frame from the capsule, mm; below zero inside.
    #[must_use]
    pub fn outside_mm(&self, point_mm: &Point3<f64>) -> f64 {
        let (along, out) = (self.to_mm - self.from_mm, point_mm - self.from_mm);
        let share = (out.dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (out - along * share).norm() - self.radius_mm
    }
}

impl Robot {
    /// Returns true unless the robot's specification names another language.
    #[must_use]
    pub fn takes(&self, dialect: Dialect) -> bool {
        dialect.is_neutral() || self.dialect.is_none_or(|own| own == dialect)
    }

    /// Returns true if the limits of a joint, in degrees, lie within ±2π: they are hardly in degrees.
    #[must_use]
    pub fn has_limits_in_radians(&self, joint: usize) -> bool {
        let largest_rad = self.joints.get(joint).map(|joint| joint.min_rad.abs().max(joint.max_rad.abs()));
        largest_rad.is_some_and(|largest_rad| largest_rad.to_degrees() <= TAU + 0.01)
    }

    /// Frames 0 to 6 at these joints.
    #[must_use]
    pub fn link_frames(&self, joints_rad: &[f64; 6]) -> LinkFrames {
        self.kinematics.link_frames(joints_rad)
    }

    /// Shoulder, a point that does not move, base frame, and an upper bound of the distance of the flange from it, mm: the arm
    /// stretched. Neighbouring origins of [`Robot::link_frames`] keep their distance, whatever the joints.
    #[must_use]
    pub fn max_reach_mm(&self) -> (Point3<f64>, f64) {
        let origins = self.link_frames(&[0.0; 6]).map(|frame| Point3::from(frame.translation.vector));
        let stretched = origins[1..].windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        (origins[1], stretched)
    }

    /// The flange at these joints.
    #[must_use]
    pub fn base_from_flange(&self, joints_rad: &[f64; 6]) -> Pose<Base, Flange> {
        self.kinematics.base_from_flange(joints_rad)
    }
}
