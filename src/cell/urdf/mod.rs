//! A robot's specification from its URDF file (Unified Robot Description Format; lengths in metres, angles in radians): the
//! six joints between two links as a chain, their limits and speeds, and the collision shapes of whatever moves with each
//! joint, as they are and in capsules.
//!
//! A URDF has no accelerations and no payload: the caller gives them.

mod capsules;
mod document;
mod remarks;

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Vector3};

use super::axis::AxisSpec;
use super::closed_list;
use super::dialect::Dialect;
use super::kinematics::{ChainJointSpec, ChainSpec, KinematicsSpec};
use super::pose_spec::PoseSpec;
use super::robot::{LinkSpec, RobotSpec};
use crate::geometry::{Mesh, Pose};
use capsules::{Capsule, around};
use document::{Geometry, JointElement, LinkElement};
pub(super) use remarks::joint_3_of_abb;

const MM_OF_METRE: f64 = 1000.0;
/// Names that the last link of an arm commonly has, the first preferred.
const TIPS: [&str; 4] = ["tool0", "flange", "ee_link", "tcp"];
/// Names that ROS gives to the flange alone.
const SURE_TIPS: [&str; 2] = [TIPS[0], TIPS[1]];
/// Limits of a joint that turns without end.
const ENDLESS_RAD: f64 = std::f64::consts::TAU;
/// Name that drivers of ROS give to the link whose frame is the controller's base.
const CONTROLLER_BASE: &str = "base";
/// Smallest turn between two bases that is more than rounding, degrees.
const MIN_TURN_DEG: f64 = 0.1;
/// Smallest distance between two links that is more than rounding, mm.
const MIN_SHIFT_MM: f64 = 0.1;
/// Corners of the circles that stand for the rims of cylinders and balls.
const CORNERS: usize = 24;

/// Choices that a URDF leaves open, and the links that are meant.
#[derive(Clone, Debug)]
pub struct UrdfOptions {
    /// Name of the robot; the file's where empty.
    pub name: Option<String>,
    /// Link that stands still; `base_link`, else the root, where empty.
    pub base_link: Option<String>,
    /// Link that is the flange; where empty, one of the usual names, else the first end in the file, that is six turning joints from
    /// the base.
    pub tip_link: Option<String>,
    /// Largest mass at the flange, kg.
    pub payload_kg: f64,
    /// Time in which a joint comes to its rated speed, s.
    pub ramp_secs: f64,
}

/// A robot from a URDF.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The robot; its links are capsules.
    pub robot: RobotSpec,
    /// Link of the file that stands still, whose frame is the robot's base.
    pub base_link: String,
    /// Link of the file that is the flange.
    pub flange_link: String,
    /// Surfaces inside the capsules.
    pub surfaces: Vec<LinkSurface>,
    /// Bodies of the file that the robot lacks, a base that nobody named and that is turned against the controller's, a flange that
    /// nobody named and that other links could be, joints that soft limits narrow, a flange whose z is off axis 6, and joint 3 of an
    /// arm that is named as ABB's.
    pub remarks: Vec<UrdfRemark>,
}

impl Imported {
    /// Sets the language of the robot's controller, and adds the remark that controllers of that language call for.
    pub fn set_dialect(&mut self, dialect: Option<Dialect>) {
        self.robot.dialect = dialect;
        let remark = dialect.and_then(Dialect::urdf_remark);
        self.remarks.extend(remark.filter(|remark| !self.remarks.contains(remark)));
    }
}

/// Remark on a robot from a URDF that is made all the same.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UrdfRemark {
    /// Finding.
    pub detail: String,
    /// Advice.
    pub remedy: String,
}

/// The collision shapes of one link.
#[derive(Clone, Debug)]
pub struct LinkSurface {
    /// Frame that it moves with: 0 the foot, 1 to 6 the joints, 6 the flange.
    pub link: u8,
    /// The link's name in the file.
    pub name: String,
    /// Mesh in that frame.
    pub mesh: Mesh,
}

closed_list! {
    /// Motion that a joint allows.
    pub enum JointKind {
        /// A turn between two limits.
        Revolute = "revolute",
        /// A turn without end.
        Continuous = "continuous",
        /// A shift.
        Prismatic = "prismatic",
        /// A joint that does not move.
        Fixed = "fixed",
        /// All six freedoms.
        Floating = "floating",
        /// A plane.
        Planar = "planar",
        /// Every turn about a point.
        Spherical = "spherical",
    }
}

/// Reason why a URDF gives no robot.
#[derive(Debug, thiserror::Error)]
pub enum UrdfError {
    /// The file is not a URDF.
    #[error("is not a URDF file: {0}")]
    Unreadable(String),
    /// The document has no link of this name.
    #[error("has no link {name:?}; {}", links_of(links))]
    NoLink {
        /// Name that was looked for.
        name: String,
        /// Names of the links that there are.
        links: Vec<String>,
    },
    /// A flange that is not carried by the base.
    #[error("link {tip:?} does not hang on {base:?}, nor on a link that {base:?} is fixed to; name others with --base and --tip")]
    Apart {
        /// Link that stands still.
        base: String,
        /// Link that was to be the flange.
        tip: String,
    },
    /// No end of the tree is six turning joints away.
    #[error("no end of it is six turning joints from {base:?}; its ends are {ends:?}: name the flange with --tip, and --base")]
    NoArm {
        /// Link at which the count began.
        base: String,
        /// Links without children.
        ends: Vec<String>,
    },
    /// A joint of another kind.
    #[error("joint {joint:?} between {base:?} and {tip:?} is {}; allowed are revolute, continuous and fixed ones", kind.as_str())]
    JointKind {
        /// Name of the joint.
        joint: String,
        /// Kind of the joint.
        kind: JointKind,
        /// First link of the chain.
        base: String,
        /// Last link of the chain.
        tip: String,
    },
    /// A joint of the arm that another one drives.
    #[error(
        "joint {joint:?} between {base:?} and {tip:?} follows joint {follows:?} (mimic): an arm is six joints that turn each by \
         itself; arms with fewer, such as palletisers, cannot be planned"
    )]
    Mimic {
        /// Name of the joint.
        joint: String,
        /// Joint that drives it.
        follows: String,
        /// First link of the chain.
        base: String,
        /// Last link of the chain.
        tip: String,
    },
    /// Soft limits that leave a joint no range.
    #[error(
        "joint {joint:?} has the soft limits {lower} to {upper} rad (safety_controller), which leave nothing of its limits; \
         correct them, or remove the safety_controller"
    )]
    SoftLimits {
        /// Name of the joint.
        joint: String,
        /// Lower soft limit, rad.
        lower: f64,
        /// Upper soft limit, rad.
        upper: f64,
    },
    /// A number that cannot be.
    #[error("joint {joint:?} has the {what} {value}")]
    Number {
        /// Name of the joint.
        joint: String,
        /// Kind of number.
        what: &'static str,
        /// The value.
        value: f64,
    },
    /// A mesh that cannot be had.
    #[error("the collision mesh {file:?} of link {link:?}: {detail}")]
    Mesh {
        /// File as the URDF names it.
        file: String,
        /// Name of the link that the mesh belongs to.
        link: String,
        /// Reason.
        detail: String,
    },
}

/// Links that a document has, and how to name one of them.
fn links_of(links: &[String]) -> String {
    match links {
        [] => "it has none".to_owned(),
        links => format!("its links are {links:?}: name one of them with --base or --tip"),
    }
}

/// The robot of a URDF. `load` finds a mesh by the name that the URDF gives it; its numbers count as they stand in the file.
///
/// # Errors
/// Every variant of [`UrdfError`].
pub fn import(
    text: &str,
    options: &UrdfOptions,
    load: &mut dyn FnMut(&str) -> Result<Mesh, String>,
) -> Result<Imported, UrdfError> {
    let robot = document::read(text)?;
    let tree = Tree::new(&robot);
    let arm = tree.arm(options)?;
    let (kinematics, moving) = chain(&arm)?;
    let mut joints = Vec::with_capacity(6);
    let mut narrowed = Vec::new();
    for joint in &moving {
        let axis = axis(joint, options.ramp_secs)?;
        narrowed.extend(remarks::narrowed(joint, &axis));
        joints.push(axis);
    }
    let joints = joints.try_into().map_err(|_| UrdfError::NoArm { base: arm.base.clone(), ends: tree.ends() })?;
    let (surfaces, mut remarks) = tree.surfaces(&arm, load)?;
    // A base that was named was chosen.
    remarks.extend(if options.base_link.is_none() { tree.turned_base(&arm) } else { None });
    let others = if options.tip_link.is_none() { tree.other_flanges(&arm) } else { Vec::new() };
    remarks.extend(remarks::of_several_flanges(&arm.tip, &others));
    remarks.extend(narrowed);
    remarks.extend(remarks::tilted_flange(&arm));
    remarks.extend(remarks::is_named_abb(&robot.name).then(joint_3_of_abb));
    let robot = RobotSpec {
        name: options.name.clone().unwrap_or_else(|| robot.name.clone()),
        payload_kg: options.payload_kg,
        max_flange_moment_nm: None,
        dialect: None,
        kinematics: KinematicsSpec::Chain(Box::new(kinematics)),
        joints,
        links: surfaces.iter().flat_map(capsules_of).collect(),
        surfaces: Vec::new(),
    };
    Ok(Imported { robot, base_link: arm.base, flange_link: arm.tip, surfaces, remarks })
}

/// Way from the base to the flange.
struct Arm<'a> {
    base: String,
    tip: String,
    /// Link that carries the joints: the base, or one that it is fixed to.
    root: String,
    base_from_root: Isometry3<f64>,
    /// Joints from the root to the flange, in order.
    path: Vec<&'a JointElement>,
}

/// The file's links and joints, found by name.
struct Tree<'a> {
    robot: &'a document::RobotElement,
    /// The joint that carries each link.
    parent: BTreeMap<&'a str, &'a JointElement>,
}

impl<'a> Tree<'a> {
    fn new(robot: &'a document::RobotElement) -> Self {
        Self { robot, parent: robot.joints.iter().map(|joint| (joint.child.as_str(), joint)).collect() }
    }

    fn named(&self, name: &str) -> Result<String, UrdfError> {
        let known = self.robot.links.iter().any(|link| link.name == name);
        if known { Ok(name.to_owned()) } else { Err(self.no_link(name)) }
    }

    fn no_link(&self, name: &str) -> UrdfError {
        let links = self.robot.links.iter().map(|link| link.name.clone()).collect();
        UrdfError::NoLink { name: name.to_owned(), links }
    }

    fn base(&self, options: &UrdfOptions) -> Result<String, UrdfError> {
        match &options.base_link {
            Some(name) => self.named(name),
            None => {
                let root = self.robot.links.iter().find(|link| !self.parent.contains_key(link.name.as_str()));
                // "base_link" is what ROS calls the foot; a root above it, often "world", is a place and no part of the arm.
                let foot = self.robot.links.iter().find(|link| link.name == "base_link");
                foot.or(root).map(|link| link.name.clone()).ok_or_else(|| self.no_link("base_link"))
            }
        }
    }

    fn ends(&self) -> Vec<String> {
        let is_end = |name: &str| self.robot.joints.iter().all(|joint| joint.parent != name);
        self.robot.links.iter().map(|link| link.name.clone()).filter(|name| is_end(name)).collect()
    }

    /// The arm between base and flange. A base without joints of its own is a mark on a link of the arm, such as `base` of UR.
    fn arm(&self, options: &UrdfOptions) -> Result<Arm<'a>, UrdfError> {
        let base = self.base(options)?;
        let (root, base_from_root) = self.fixed_to(&base, &|link| self.carries_joints(link));
        let tip = self.tip(options, &base, &root)?;
        let path = self.path(&root, &tip).ok_or_else(|| UrdfError::Apart { base: base.clone(), tip: tip.clone() })?;
        Ok(Arm { base, tip, root, base_from_root, path })
    }

    /// The first link that `is_wanted` among `link` and those above that it is fixed to, else the topmost; and where it is in `link`.
    fn fixed_to(&self, link: &str, is_wanted: &dyn Fn(&str) -> bool) -> (String, Isometry3<f64>) {
        let mut at = link;
        let mut at_from_link: Isometry3<f64> = Isometry3::identity();
        // A file may be wound into a circle.
        for _ in 0..self.robot.joints.len() {
            let above = self.parent.get(at).filter(|joint| joint.kind == JointKind::Fixed);
            let Some(joint) = above.filter(|_| !is_wanted(at)) else { break };
            at_from_link = joint.parent_from_joint * at_from_link;
            at = &joint.parent;
        }
        (at.to_owned(), at_from_link.inverse())
    }

    /// Returns true if a joint that turns hangs on a link.
    fn carries_joints(&self, link: &str) -> bool {
        self.robot.joints.iter().any(|joint| turns(joint) && self.path(link, &joint.parent).is_some())
    }

    /// The flange: six turning joints from the base, by its usual name if it has one.
    fn tip(&self, options: &UrdfOptions, base: &str, root: &str) -> Result<String, UrdfError> {
        if let Some(name) = &options.tip_link {
            return self.named(name);
        }
        let is_arm = |name: &str| self.path(root, name).is_some_and(|path| path.iter().filter(|joint| turns(joint)).count() == 6);
        let usual = TIPS.iter().map(|name| (*name).to_owned()).filter(|name| self.named(name).is_ok());
        let found = usual.chain(self.ends()).find(|name| is_arm(name));
        found.ok_or_else(|| UrdfError::NoArm { base: base.to_owned(), ends: self.ends() })
    }

    /// Links that move with the flange and could be meant by it, each with its pose in the flange's frame, where no name tells the
    /// flange and they are elsewhere, or turned.
    fn other_flanges(&self, arm: &Arm<'_>) -> Vec<(&'a str, Isometry3<f64>)> {
        if SURE_TIPS.contains(&arm.tip.as_str()) {
            return Vec::new();
        }
        let from_root = |path: &[&JointElement]| -> Isometry3<f64> {
            path.iter().fold(Isometry3::identity(), |at, joint| at * joint.parent_from_joint)
        };
        let root_from_flange = from_root(&arm.path);
        let in_flange = |name: &'a str| {
            let path = self.path(&arm.root, name)?;
            // Another arm on the same base has joints of its own.
            let shared = path.iter().zip(&arm.path).take_while(|(a, b)| std::ptr::eq(**a, **b)).count();
            let turned = path[..shared].iter().filter(|joint| turns(joint)).count();
            let is_rigid = path[shared..].iter().all(|joint| joint.kind == JointKind::Fixed);
            let at = root_from_flange.inv_mul(&from_root(&path));
            let is_apart = at.translation.vector.norm() > MIN_SHIFT_MM || at.rotation.angle().to_degrees() > MIN_TURN_DEG;
            (turned == 6 && is_rigid && is_apart).then_some((name, at))
        };
        self.robot.links.iter().filter_map(|link| in_flange(&link.name)).collect()
    }

    /// The joints from one link to another, in order; `None` where it does not hang on it.
    fn path(&self, base: &str, tip: &str) -> Option<Vec<&'a JointElement>> {
        let (mut path, mut at) = (Vec::new(), tip);
        while at != base {
            let joint = *self.parent.get(at)?;
            // A file may be wound into a circle.
            if path.len() > self.robot.joints.len() {
                return None;
            }
            path.push(joint);
            at = &joint.parent;
        }
        path.reverse();
        Some(path)
    }

    /// Everything that hangs on the base, on the frame that carries it, and remarks on the bodies that are left out.
    fn surfaces(
        &self,
        arm: &Arm<'_>,
        load: &mut dyn FnMut(&str) -> Result<Mesh, String>,
    ) -> Result<(Vec<LinkSurface>, Vec<UrdfRemark>), UrdfError> {
        let frames = zero_frames(arm);
        let (mut surfaces, mut remarks) = (Vec::new(), Vec::new());
        for link in &self.robot.links {
            let (frame, frame_from_link) = match self.carried(&link.name, arm, &frames) {
                Ok(carried) => carried,
                Err(reason) => {
                    remarks.extend(left_out(link, &reason, "if it is there, give the cell a mount or an obstacle in its place"));
                    continue;
                }
            };
            let (mut vertices_mm, mut faces) = (Vec::new(), Vec::new());
            for collision in &link.collision {
                let pose = frame_from_link * collision.link_from_shape;
                let shape = shape(&collision.geometry, &link.name, load)?;
                let first = vertices_mm.len() as u32;
                vertices_mm.extend(shape.vertices_mm.iter().map(|vertex| pose * vertex));
                faces.extend(shape.faces.iter().map(|face| face.map(|vertex| first + vertex)));
            }
            if faces.is_empty() {
                let reason =
                    if link.collision.is_empty() { "has no collision shape" } else { "has a collision shape without faces" };
                remarks.extend(left_out(link, reason, "give it one in the URDF, or capsules in the robot's links"));
            } else {
                surfaces.push(LinkSurface { link: frame as u8, name: link.name.clone(), mesh: mesh_of(vertices_mm, faces) });
            }
        }
        Ok((surfaces, remarks))
    }

    /// The frame, 0 to 6, that a link moves with, and where it is in it.
    ///
    /// # Errors
    /// The reason for a link that does not hang on the base, or moves by a joint of its own.
    fn carried(&self, name: &str, arm: &Arm<'_>, frames: &[Isometry3<f64>; 7]) -> Result<(usize, Isometry3<f64>), String> {
        let way = self.path(&arm.root, name).ok_or_else(|| format!("does not hang on {:?}", arm.base))?;
        let shared = way.iter().zip(&arm.path).take_while(|(a, b)| std::ptr::eq(**a, **b)).count();
        if let Some(joint) = way[shared..].iter().find(|joint| joint.kind != JointKind::Fixed) {
            return Err(format!("moves by joint {:?}, which is none of the arm's", joint.name));
        }
        let turned = way.iter().filter(|joint| turns(joint)).count();
        // What the flange carries is given in the flange's own frame.
        let frame = if name == arm.tip && turned == 6 { 6 } else { turned };
        let base_from_link = way.iter().fold(arm.base_from_root, |at, joint| at * joint.parent_from_joint);
        Ok((frame, frames[frame].inverse() * base_from_link))
    }

    /// Remark on a base that is turned against the link that has the controller's, as `base_link` of UR is.
    fn turned_base(&self, arm: &Arm<'_>) -> Option<UrdfRemark> {
        let controller = self.named(CONTROLLER_BASE).ok()?;
        let [(top, base_from_top), (other_top, controller_from_top)] =
            [&arm.base, &controller].map(|link| self.fixed_to(link, &|_| false));
        let (axis, turn_rad) = (controller_from_top * base_from_top.inverse()).rotation.axis_angle()?;
        (top == other_top && turn_rad.to_degrees() > MIN_TURN_DEG).then(|| {
            let (base, turn) = (&arm.base, turn_about(&axis, turn_rad));
            UrdfRemark {
                detail: format!(
                    "base {base:?} is turned against the controller's, the file's link {CONTROLLER_BASE:?}, by {turn}"
                ),
                remedy: format!(
                    "name the base in which the cell's poses are given: --base {CONTROLLER_BASE}, in which the controller shows \
                     poses, or --base {base}"
                ),
            }
        })
    }
}

/// Remark on a link that the robot lacks; `None` for a mere frame, which has no body.
fn left_out(link: &LinkElement, reason: &str, remedy: &str) -> Option<UrdfRemark> {
    let has_body = !link.collision.is_empty() || link.is_drawn;
    has_body.then(|| UrdfRemark {
        detail: format!("leaves out link {:?}, which {reason}: nothing keeps clear of it", link.name),
        remedy: remedy.to_owned(),
    })
}

/// A turn in words, its axis by name where it is one of the frame's.
fn turn_about(axis: &Vector3<f64>, turn_rad: f64) -> String {
    let largest = axis.iamax();
    let turn_deg = (turn_rad.to_degrees() * 10.0).round() / 10.0;
    if axis[largest].abs() < 0.9999 {
        return format!("{turn_deg}° about ({:.2} {:.2} {:.2})", axis.x, axis.y, axis.z);
    }
    // Half a turn is the same to either side.
    let sign = if axis[largest] < 0.0 && turn_deg < 180.0 { "-" } else { "" };
    format!("{sign}{turn_deg}° about {}", ["x", "y", "z"][largest])
}

fn turns(joint: &JointElement) -> bool {
    matches!(joint.kind, JointKind::Revolute | JointKind::Continuous)
}

/// Foot, joints 1 to 5 and the flange with all joints at zero, base frame.
fn zero_frames(arm: &Arm<'_>) -> [Isometry3<f64>; 7] {
    let (mut frames, mut at, mut turned) = ([Isometry3::identity(); 7], arm.base_from_root, 0);
    for joint in &arm.path {
        at *= joint.parent_from_joint;
        if turns(joint) {
            turned += 1;
            frames[turned.min(6)] = at;
        }
    }
    frames[6] = at;
    frames
}

/// The joints that turn, with whatever is fixed before each, and the flange behind the last.
fn chain<'a>(arm: &Arm<'a>) -> Result<(ChainSpec, Vec<&'a JointElement>), UrdfError> {
    let (base, tip) = (&arm.base, &arm.tip);
    let (mut at, mut joints, mut moving) = (arm.base_from_root, Vec::new(), Vec::new());
    for joint in &arm.path {
        at *= joint.parent_from_joint;
        match joint.kind {
            JointKind::Fixed => {}
            JointKind::Revolute | JointKind::Continuous => {
                if let Some(follows) = &joint.mimics {
                    let (joint, follows) = (joint.name.clone(), follows.clone());
                    return Err(UrdfError::Mimic { joint, follows, base: base.to_owned(), tip: tip.to_owned() });
                }
                joints.push(ChainJointSpec { origin: written(&at), axis: joint.axis });
                moving.push(*joint);
                at = Isometry3::identity();
            }
            kind @ (JointKind::Prismatic | JointKind::Floating | JointKind::Planar | JointKind::Spherical) => {
                let joint = joint.name.clone();
                return Err(UrdfError::JointKind { joint, kind, base: base.to_owned(), tip: tip.to_owned() });
            }
        }
    }
    let joints = joints.try_into().map_err(|_| UrdfError::NoArm { base: base.to_owned(), ends: vec![tip.to_owned()] })?;
    Ok((ChainSpec { joints, flange: written(&at) }, moving))
}

/// Limits of a joint without its soft ones, rad.
fn own_range_rad(joint: &JointElement) -> (f64, f64) {
    let turns_endlessly = joint.kind == JointKind::Continuous;
    if turns_endlessly { (-ENDLESS_RAD, ENDLESS_RAD) } else { (joint.lower, joint.upper) }
}

/// Part of a joint's range that is within its soft limits, rad.
fn within_soft_limits(joint: &JointElement, (min_rad, max_rad): (f64, f64)) -> Result<(f64, f64), UrdfError> {
    let Some((lower, upper)) = joint.soft_limits else { return Ok((min_rad, max_rad)) };
    // Both are 0 by default, which is to say that there are none.
    if lower == 0.0 && upper == 0.0 {
        return Ok((min_rad, max_rad));
    }
    let (low_rad, high_rad) = (min_rad.max(lower), max_rad.min(upper));
    if low_rad >= high_rad {
        return Err(UrdfError::SoftLimits { joint: joint.name.clone(), lower, upper });
    }
    Ok((low_rad, high_rad))
}

fn axis(joint: &JointElement, ramp_secs: f64) -> Result<AxisSpec, UrdfError> {
    let (min_rad, max_rad) = own_range_rad(joint);
    let bad = |what: &'static str, value: f64| UrdfError::Number { joint: joint.name.clone(), what, value };
    if !min_rad.is_finite() {
        return Err(bad("lower limit", min_rad));
    }
    if max_rad <= min_rad {
        return Err(bad("upper limit", max_rad));
    }
    if !(joint.speed.is_finite() && joint.speed > 0.0) {
        return Err(bad("speed", joint.speed));
    }
    let (min_rad, max_rad) = within_soft_limits(joint, (min_rad, max_rad))?;
    if !max_rad.is_finite() {
        return Err(bad("upper limit", max_rad));
    }
    let speed_deg_per_s = joint.speed.to_degrees();
    Ok(AxisSpec {
        min_deg: min_rad.to_degrees(),
        max_deg: max_rad.to_degrees(),
        max_speed_deg_per_s: speed_deg_per_s,
        max_acceleration_deg_per_s2: speed_deg_per_s / ramp_secs,
    })
}

/// The surface of a collision shape, in its own frame, mm.
fn shape(geometry: &Geometry, link: &str, load: &mut dyn FnMut(&str) -> Result<Mesh, String>) -> Result<Mesh, UrdfError> {
    Ok(match geometry {
        Geometry::Mesh { file, scale } => {
            let bad = |detail| UrdfError::Mesh { file: file.clone(), link: link.to_owned(), detail };
            let mut mesh = load(file).map_err(bad)?;
            for vertex in &mut mesh.vertices_mm {
                *vertex = Point3::from([0, 1, 2].map(|axis| vertex[axis] * scale[axis] * MM_OF_METRE));
            }
            mesh
        }
        Geometry::Box { size } => {
            let [x, y] = [0, 1].map(|axis| 0.5 * size[axis] * MM_OF_METRE);
            let ends = [-0.5, 0.5].map(|end| end * size[2] * MM_OF_METRE);
            rings(&ends.map(|z| vec![[x, y, z], [-x, y, z], [-x, -y, z], [x, -y, z]]))
        }
        Geometry::Cylinder { radius, length } => rings(&[-0.5, 0.5].map(|end| ring(*radius, end * length))),
        Geometry::Capsule { radius, length } => rings(&ball_rings(*radius, *length)),
        Geometry::Sphere { radius } => rings(&ball_rings(*radius, 0.0)),
    })
}

/// A surface through rings of as many corners each, one above the other, closed at both ends.
fn rings(rings: &[Vec<[f64; 3]>]) -> Mesh {
    let vertices_mm: Vec<Point3<f64>> = rings.iter().flatten().map(|corner| Point3::from(*corner)).collect();
    let (count, top) = (rings[0].len() as u32, (vertices_mm.len() - rings[0].len()) as u32);
    let between = |low: u32| {
        let quad = move |i: u32| [low + i, low + (i + 1) % count, low + count + i, low + count + (i + 1) % count];
        (0..count).map(quad).flat_map(|[a, b, above_a, above_b]| [[a, b, above_b], [a, above_b, above_a]])
    };
    let sides = (0..rings.len() as u32 - 1).flat_map(|ring| between(ring * count));
    let caps = (1..count - 1).flat_map(|i| [[0, i + 1, i], [top, top + i, top + i + 1]]);
    mesh_of(vertices_mm, sides.chain(caps).collect())
}

fn mesh_of(vertices_mm: Vec<Point3<f64>>, faces: Vec<[u32; 3]>) -> Mesh {
    Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), groups: Vec::new(), faces }
}

/// A regular polygon around a circle at a height, both in metres, mm.
fn ring(radius: f64, z: f64) -> Vec<[f64; 3]> {
    let corner = |i: usize| {
        let angle = std::f64::consts::TAU * i as f64 / CORNERS as f64;
        // Corners of a polygon around the circle, not in it.
        let out = radius * MM_OF_METRE / (std::f64::consts::PI / CORNERS as f64).cos();
        [out * angle.cos(), out * angle.sin(), z * MM_OF_METRE]
    };
    (0..CORNERS).map(corner).collect()
}

/// Rings around two half balls, a length apart, such that each band between two rings touches its ball, as do the ends.
fn ball_rings(radius: f64, length: f64) -> Vec<Vec<[f64; 3]>> {
    let bands = CORNERS / 4;
    let half_band = std::f64::consts::FRAC_PI_4 / bands as f64;
    let out = radius / half_band.cos();
    let latitude = |band: usize| half_band * (2 * band + 1) as f64;
    let up: Vec<(f64, f64)> =
        (0..bands).map(|band| (out * latitude(band).cos(), 0.5 * length + out * latitude(band).sin())).collect();
    let down = up.iter().rev().map(|(across, z)| ring(*across, -z));
    down.chain(up.iter().map(|(across, z)| ring(*across, *z))).collect()
}

fn capsules_of(surface: &LinkSurface) -> Vec<LinkSpec> {
    let corner = |vertex: u32| surface.mesh.vertices_mm[vertex as usize];
    let triangles: Vec<_> = surface.mesh.faces.iter().map(|face| face.map(corner)).collect();
    let capsules = around(&triangles);
    let name = |index: usize| if capsules.len() == 1 { surface.name.clone() } else { format!("{} {}", surface.name, index + 1) };
    let spec = |(index, capsule): (usize, &Capsule)| LinkSpec {
        link: surface.link,
        name: name(index),
        from_mm: capsule.from_mm.into(),
        to_mm: capsule.to_mm.into(),
        radius_mm: capsule.radius_mm,
    };
    capsules.iter().enumerate().map(spec).collect()
}

fn written(pose: &Isometry3<f64>) -> PoseSpec {
    PoseSpec::from(&Pose::<(), ()>::claim(*pose))
}

#[cfg(test)]
mod tests;
