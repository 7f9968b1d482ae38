//! A rigid body with its mesh found, for collision tests.

use std::sync::Arc;

use nalgebra::Isometry3;

use super::field_error::Findings;
use super::library::{SpecKind, SpecLibrary};
use super::shape_spec::{BodySpec, ShapeSpec};
use crate::geometry::Mesh;

/// A rigid body and where it is in its owner's frame.
#[derive(Clone, Debug)]
pub struct Body {
    /// Name used in reports of collisions.
    pub name: String,
    /// Pose in the owner's frame, mm.
    pub owner_from_body: Isometry3<f64>,
    /// Its shape.
    pub shape: Shape,
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
    /// Bodies of checked specifications; a mesh that `library` lacks is a finding below `pointer`.
    pub(super) fn resolve(specs: &[BodySpec], pointer: &str, library: &dyn SpecLibrary, findings: &mut Findings) -> Vec<Self> {
        let mut bodies = Vec::with_capacity(specs.len());
        for (index, spec) in specs.iter().enumerate() {
            let Some(shape) = Shape::resolve(&spec.shape, library) else {
                findings.push(format!("{pointer}/{index}/shape/mesh"), unknown(SpecKind::Mesh, shape_mesh(&spec.shape), library));
                continue;
            };
            bodies.push(Self {
                name: spec.name.clone(),
                owner_from_body: *spec.owner_from_body.pose::<(), ()>().isometry(),
                shape,
            });
        }
        bodies
    }
}

impl Shape {
    fn resolve(spec: &ShapeSpec, library: &dyn SpecLibrary) -> Option<Self> {
        Some(match spec {
            ShapeSpec::Box { size_mm } => Self::Box { size_mm: *size_mm },
            ShapeSpec::Cylinder { radius_mm, height_mm } => Self::Cylinder { radius_mm: *radius_mm, height_mm: *height_mm },
            ShapeSpec::Capsule { radius_mm, length_mm } => Self::Capsule { radius_mm: *radius_mm, length_mm: *length_mm },
            ShapeSpec::Mesh { mesh } => Self::Mesh(Arc::new(library.mesh(mesh).filter(|mesh| !mesh.faces.is_empty())?)),
        })
    }
}

fn shape_mesh(spec: &ShapeSpec) -> &str {
    if let ShapeSpec::Mesh { mesh } = spec { mesh } else { "" }
}

/// The message for a name that `library` does not know.
pub(super) fn unknown(kind: SpecKind, name: &str, library: &dyn SpecLibrary) -> String {
    let names = library.names(kind);
    let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    format!("is {name:?}, which is unknown; known {} names: {known}", kind.as_str())
}
