//! Elements of a URDF document (Unified Robot Description Format) that an arm is made of; visual shapes, materials, inertias and
//! whatever else a file holds are passed over.
//!
//! Formats 1.0 to 1.2, as in `urdfdom` of ROS and its schema `urdf.xsd`: `quat_xyzw` of an origin counts from 1.1 on, and limits
//! that are left out of a joint are none from 1.2 on.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

use super::{JointKind, MM_OF_METRE, UrdfError};

/// Max number of nodes of a document. The largest arms of ROS-Industrial have about two thousand.
const MAX_NODES: u32 = 1_000_000;
/// Axis of a joint that has none.
const DEFAULT_AXIS: [f64; 3] = [1.0, 0.0, 0.0];

/// Root element of a document.
pub(super) struct RobotElement {
    /// Name of the robot; empty where it has none.
    pub name: String,
    /// Links, in the order of the document.
    pub links: Vec<LinkElement>,
    /// Joints, in the order of the document.
    pub joints: Vec<JointElement>,
}

/// Rigid body, or a mere frame.
pub(super) struct LinkElement {
    /// Name of the link.
    pub name: String,
    /// True if it has a visual shape.
    pub is_drawn: bool,
    /// Collision shapes.
    pub collision: Vec<Collision>,
}

/// Collision shape of a link.
pub(super) struct Collision {
    /// Pose in the link, mm.
    pub link_from_shape: Isometry3<f64>,
    /// Shape.
    pub geometry: Geometry,
}

/// Form of a collision shape, lengths in metres.
pub(super) enum Geometry {
    /// Cuboid.
    Box { size: [f64; 3] },
    /// Cylinder along z.
    Cylinder { radius: f64, length: f64 },
    /// Cylinder along z between two half balls.
    Capsule { radius: f64, length: f64 },
    /// Ball.
    Sphere { radius: f64 },
    /// Mesh in a file of its own.
    Mesh { file: String, scale: [f64; 3] },
}

/// Joint between two links.
pub(super) struct JointElement {
    /// Name of the joint.
    pub name: String,
    /// Motion.
    pub kind: JointKind,
    /// Pose in the parent link with the joint at zero, mm.
    pub parent_from_joint: Isometry3<f64>,
    /// Link that carries it.
    pub parent: String,
    /// Link that it moves.
    pub child: String,
    /// Axis of turn or shift, in the joint's frame.
    pub axis: [f64; 3],
    /// Lower limit, rad or m.
    pub lower: f64,
    /// Upper limit, rad or m.
    pub upper: f64,
    /// Largest speed, rad/s or m/s.
    pub speed: f64,
    /// Joint that it follows.
    pub mimics: Option<String>,
    /// Soft limits, lower and upper, rad or m.
    pub soft_limits: Option<(f64, f64)>,
}

/// Version of the format: major, minor.
type Version = (u32, u32);

/// Reads a document.
///
/// # Errors
/// [`UrdfError::Unreadable`] where the text is not XML, is not a robot's, or lacks what an element must have.
pub(super) fn read(text: &str) -> Result<RobotElement, UrdfError> {
    let options = ParsingOptions { nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options).map_err(|error| UrdfError::Unreadable(error.to_string()))?;
    let robot = document.root_element();
    if robot.tag_name().name() != "robot" {
        return Err(unreadable(robot, "is not <robot>"));
    }
    if robot.descendants().any(|node| node.tag_name().namespace().is_some_and(|name| name.contains("xacro"))) {
        return Err(unreadable(robot, "has macros of xacro; expand them first: xacro arm.urdf.xacro > arm.urdf"));
    }
    let version = version(robot);
    Ok(RobotElement {
        name: robot.attribute("name").unwrap_or_default().to_owned(),
        links: elements(robot, "link").map(|node| link(node, version)).collect::<Result<_, _>>()?,
        joints: elements(robot, "joint").map(|node| joint(node, version)).collect::<Result<_, _>>()?,
    })
}

/// Version that a document states; 1.0 where it states none.
fn version(robot: Node<'_, '_>) -> Version {
    let stated = robot.attribute("version").and_then(|text| {
        let (major, minor) = text.trim().split_once('.')?;
        Some((major.parse().ok()?, minor.parse().ok()?))
    });
    stated.unwrap_or((1, 0))
}

fn link(node: Node<'_, '_>, version: Version) -> Result<LinkElement, UrdfError> {
    let collision = |node| Ok(Collision { link_from_shape: origin(node, version)?, geometry: geometry(node)? });
    Ok(LinkElement {
        name: text(node, "name")?,
        is_drawn: element(node, "visual").is_some(),
        collision: elements(node, "collision").map(collision).collect::<Result<_, UrdfError>>()?,
    })
}

fn geometry(collision: Node<'_, '_>) -> Result<Geometry, UrdfError> {
    let shape = element(collision, "geometry").and_then(|node| node.children().find(Node::is_element));
    let shape = shape.ok_or_else(|| unreadable(collision, "has no geometry"))?;
    Ok(match shape.tag_name().name() {
        "box" => Geometry::Box { size: required(shape, "size", vector(shape, "size")?)? },
        "cylinder" => Geometry::Cylinder { radius: length(shape, "radius")?, length: length(shape, "length")? },
        "capsule" => Geometry::Capsule { radius: length(shape, "radius")?, length: length(shape, "length")? },
        "sphere" => Geometry::Sphere { radius: length(shape, "radius")? },
        "mesh" => Geometry::Mesh { file: text(shape, "filename")?, scale: vector(shape, "scale")?.unwrap_or([1.0; 3]) },
        _ => return Err(unreadable(shape, "is not a shape; allowed are box, capsule, cylinder, mesh and sphere")),
    })
}

fn joint(node: Node<'_, '_>, version: Version) -> Result<JointElement, UrdfError> {
    let kind = text(node, "type")?;
    let kind = JointKind::ALL.into_iter().find(|known| known.as_str() == kind).ok_or_else(|| {
        unreadable(node, &format!("has the type {kind:?}; allowed are {}", JointKind::ALL.map(JointKind::as_str).join(", ")))
    })?;
    let linked =
        |name| element(node, name).ok_or_else(|| unreadable(node, &format!("has no {name}"))).and_then(|node| text(node, "link"));
    let of_limit = |name, left_out| {
        element(node, "limit").map_or(Ok(None), |limit| number(limit, name)).map(|limit| limit.unwrap_or(left_out))
    };
    // Up to 1.1 a limit that is left out is 0.
    let unlimited = if version >= (1, 2) { f64::INFINITY } else { 0.0 };
    let soft_limits = |node| {
        let limit = |name| Ok::<_, UrdfError>(number(node, name)?.unwrap_or(0.0));
        Ok::<_, UrdfError>((limit("soft_lower_limit")?, limit("soft_upper_limit")?))
    };
    Ok(JointElement {
        name: text(node, "name")?,
        kind,
        parent_from_joint: origin(node, version)?,
        parent: linked("parent")?,
        child: linked("child")?,
        axis: element(node, "axis").map_or(Ok(None), |axis| vector(axis, "xyz"))?.unwrap_or(DEFAULT_AXIS),
        lower: of_limit("lower", -unlimited)?,
        upper: of_limit("upper", unlimited)?,
        speed: of_limit("velocity", unlimited)?,
        mimics: element(node, "mimic").map(|mimic| text(mimic, "joint")).transpose()?,
        soft_limits: element(node, "safety_controller").map(soft_limits).transpose()?,
    })
}

/// Pose of the `origin` of an element, mm; the identity where it has none.
fn origin(node: Node<'_, '_>, version: Version) -> Result<Isometry3<f64>, UrdfError> {
    let Some(origin) = element(node, "origin") else { return Ok(Isometry3::identity()) };
    let xyz_m = vector(origin, "xyz")?.unwrap_or_default();
    let quaternion = if version >= (1, 1) { vector(origin, "quat_xyzw")? } else { None };
    let rotation = match (quaternion, vector(origin, "rpy")?) {
        (Some(_), Some(_)) => return Err(unreadable(origin, "has both rpy and quat_xyzw; remove one")),
        (Some([x, y, z, w]), None) => UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9)
            .ok_or_else(|| unreadable(origin, "has a quat_xyzw of length 0"))?,
        (None, rpy) => {
            let [roll, pitch, yaw] = rpy.unwrap_or_default();
            UnitQuaternion::from_euler_angles(roll, pitch, yaw)
        }
    };
    Ok(Isometry3::from_parts(Translation3::from(Vector3::from(xyz_m) * MM_OF_METRE), rotation))
}

fn elements<'a, 'input>(node: Node<'a, 'input>, name: &'static str) -> impl Iterator<Item = Node<'a, 'input>> {
    node.children().filter(move |child| child.is_element() && child.tag_name().name() == name)
}

fn element<'a, 'input>(node: Node<'a, 'input>, name: &'static str) -> Option<Node<'a, 'input>> {
    elements(node, name).next()
}

/// Text of an attribute that an element must have.
fn text(node: Node<'_, '_>, name: &str) -> Result<String, UrdfError> {
    required(node, name, node.attribute(name).map(str::to_owned))
}

fn required<T>(node: Node<'_, '_>, name: &str, value: Option<T>) -> Result<T, UrdfError> {
    value.ok_or_else(|| unreadable(node, &format!("has no {name}")))
}

/// Number of an attribute, or infinity.
fn number(node: Node<'_, '_>, name: &str) -> Result<Option<f64>, UrdfError> {
    let Some(text) = node.attribute(name) else { return Ok(None) };
    let value = text.trim().parse().ok().filter(|value: &f64| !value.is_nan());
    value.map(Some).ok_or_else(|| unreadable(node, &format!("has the {name} {text:?}, which is not a number")))
}

/// Length that an element must have, metres.
fn length(node: Node<'_, '_>, name: &str) -> Result<f64, UrdfError> {
    let value = required(node, name, number(node, name)?)?;
    if value.is_finite() { Ok(value) } else { Err(unreadable(node, &format!("has the {name} {value}, which is not finite"))) }
}

/// Numbers of an attribute, finite and as many as `N`.
fn vector<const N: usize>(node: Node<'_, '_>, name: &str) -> Result<Option<[f64; N]>, UrdfError> {
    let Some(text) = node.attribute(name) else { return Ok(None) };
    let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
    let vector = numbers.ok().filter(|numbers| numbers.iter().all(|number| number.is_finite()));
    let vector = vector.and_then(|numbers| numbers.try_into().ok());
    vector.map(Some).ok_or_else(|| unreadable(node, &format!("has the {name} {text:?}, which is not {N} finite numbers")))
}

/// Error at an element: its line and tag, the name of the link or joint around it, and the fault.
fn unreadable(node: Node<'_, '_>, fault: &str) -> UrdfError {
    let line = node.document().text_pos_at(node.range().start).row;
    let tag = node.tag_name().name();
    let named = node.ancestors().find(|above| above.is_element() && above.has_attribute("name"));
    let of = named.filter(|above| matches!(above.tag_name().name(), "link" | "joint")).map_or_else(String::new, |above| {
        let (kind, name) = (above.tag_name().name(), above.attribute("name").unwrap_or_default());
        if node == above { format!(" {name:?}") } else { format!(" of {kind} {name:?}") }
    });
    UrdfError::Unreadable(format!("line {line}: <{tag}>{of} {fault}"))
}
