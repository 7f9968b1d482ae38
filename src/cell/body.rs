//! A rigid body with its mesh found, for collision tests.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3};

use super::body_meshes::BodyMeshes;
use super::closest::did_you_mean;
use super::field_error::Findings;
use super::library::{NotFound, SpecKind, SpecLibrary};
use super::shape_spec::{BodySpec, LinkBodySpec, ShapeSpec};
use crate::geometry::{Aabb, Mesh};

/// A rigid body and where it is in its owner's frame.
#[derive(Clone, Debug)]
pub struct Body {
    /// Name used in reports of collisions.
    pub name: String,
    /// Pose in the owner's frame, mm.
    pub owner_from_body: Isometry3<f64>,
    /// Shape of the body.
    pub shape: Shape,
}

/// A body that a link of the arm carries; the link's frame is the owner's.
#[derive(Clone, Debug)]
pub struct LinkBody {
    /// Frame that it moves with, 0 to 6.
    pub link: usize,
    /// The body.
    pub body: Body,
}

/// A shape centred on its own origin, mm.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Box with edges along the axes.
    Box {
        /// Edge lengths.
        size_mm: [f64; 3],
    },
    /// Cylinder along z.
    Cylinder {
        /// Radius.
        radius_mm: f64,
        /// Length along z.
        height_mm: f64,
    },
    /// Capsule along z.
    Capsule {
        /// Radius.
        radius_mm: f64,
        /// Distance between the centres of its half balls.
        length_mm: f64,
    },
    /// A surface.
    Mesh(Arc<Mesh>),
}

impl Body {
    /// Corners of the box around it along its own axes, owner's frame, mm.
    #[must_use]
    pub fn corners_mm(&self) -> Vec<Point3<f64>> {
        let half = |x: f64, y: f64, z: f64| Aabb { min: Point3::new(-x, -y, -z), max: Point3::new(x, y, z) };
        let own = match &self.shape {
            Shape::Box { size_mm: [x, y, z] } => half(0.5 * x, 0.5 * y, 0.5 * z),
            Shape::Cylinder { radius_mm, height_mm } => half(*radius_mm, *radius_mm, 0.5 * height_mm),
            Shape::Capsule { radius_mm, length_mm } => half(*radius_mm, *radius_mm, 0.5 * length_mm + radius_mm),
            Shape::Mesh(mesh) => mesh.aabb(),
        };
        let corner =
            |i: usize| Point3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { own.max[axis] } else { own.min[axis] }));
        (0..8).map(|i| self.owner_from_body * corner(i)).collect()
    }

    /// Bodies of checked specifications; a mesh that is not to be had is a finding below `pointer`.
    pub(super) fn resolve(specs: &[BodySpec], pointer: &str, meshes: &mut BodyMeshes<'_>, findings: &mut Findings) -> Vec<Self> {
        let found =
            specs.iter().enumerate().map(|(index, spec)| Self::find(spec, &format!("{pointer}/{index}"), meshes, findings));
        found.flatten().collect()
    }

    fn find(spec: &BodySpec, pointer: &str, meshes: &mut BodyMeshes<'_>, findings: &mut Findings) -> Option<Self> {
        let shape = Shape::resolve(&spec.shape, meshes).map_err(|detail| findings.push(format!("{pointer}/shape/mesh"), detail));
        let owner_from_body = *spec.owner_from_body.pose::<(), ()>().isometry();
        Some(Self { name: spec.name.clone(), owner_from_body, shape: shape.ok()? })
    }
}

impl LinkBody {
    /// Bodies of checked specifications, each with its link; see [`Body::resolve`].
    pub(super) fn resolve(
        specs: &[LinkBodySpec],
        pointer: &str,
        meshes: &mut BodyMeshes<'_>,
        findings: &mut Findings,
    ) -> Vec<Self> {
        let mut bodies = Vec::with_capacity(specs.len());
        for (index, spec) in specs.iter().enumerate() {
            let body = Body::find(&spec.body(), &format!("{pointer}/{index}"), meshes, findings);
            bodies.extend(body.map(|body| Self { link: usize::from(spec.link), body }));
        }
        bodies
    }
}

impl Shape {
    fn resolve(spec: &ShapeSpec, meshes: &mut BodyMeshes<'_>) -> Result<Self, String> {
        Ok(match spec {
            ShapeSpec::Box { size_mm } => Self::Box { size_mm: *size_mm },
            ShapeSpec::Cylinder { radius_mm, height_mm } => Self::Cylinder { radius_mm: *radius_mm, height_mm: *height_mm },
            ShapeSpec::Capsule { radius_mm, length_mm } => Self::Capsule { radius_mm: *radius_mm, length_mm: *length_mm },
            ShapeSpec::Mesh { mesh: name } => Self::Mesh(meshes.get(name)?),
        })
    }
}

/// The message for a name of which `library` gives nothing: why, or the names that it knows.
pub(super) fn not_found(error: &NotFound, kind: SpecKind, name: &str, library: &dyn SpecLibrary) -> String {
    let named = format!("is {name:?}, which {error}");
    if *error != NotFound::Unknown {
        return named;
    }
    let others = [SpecKind::Scanner, SpecKind::Robot, SpecKind::Turntable, SpecKind::Cell];
    let other = others.into_iter().find(|other| *other != kind && library.names(*other).iter().any(|known| known == name));
    let named = other.map_or(named, |other| format!("is {name:?}, which is a {}, not a {}", other.as_str(), kind.as_str()));
    let names = library.names(kind);
    let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    let question = did_you_mean(name, names.iter().map(String::as_str));
    format!("{named}; known {} names: {known}{question}", kind.as_str())
}
