//! The meshes that the bodies of a cell name, while it is built: each is asked of the library once, however many bodies
//! name it, and all bodies together are bounded, since what the library gives may take long to read and much to hold.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::body::not_found;
use super::field_error::Findings;
use super::library::{NotFound, SpecKind, SpecLibrary};
use super::shape_spec::ShapeSpec;
use crate::geometry::Mesh;

/// Maximum number of bodies of a cell: robot, mount, scanner, cable, table and obstacles together.
pub const MAX_BODIES: usize = 2_000;
/// Maximum number of those that are meshes.
pub const MAX_MESH_BODIES: usize = 200;
/// Maximum number of triangles of all different meshes of a cell; collision tests hold about 130 bytes for each.
pub const MAX_TRIANGLES: usize = 5_000_000;

/// Meshes of the bodies of one cell, each read once and counted against the limits.
pub(super) struct BodyMeshes<'a> {
    library: &'a dyn SpecLibrary,
    read: BTreeMap<String, Result<Arc<Mesh>, NotFound>>,
    triangles: usize,
}

impl<'a> BodyMeshes<'a> {
    pub(super) fn new(library: &'a dyn SpecLibrary) -> Self {
        Self { library, read: BTreeMap::new(), triangles: 0 }
    }

    /// The mesh of this name, or what is wrong with the name.
    pub(super) fn get(&mut self, name: &str) -> Result<Arc<Mesh>, String> {
        if !self.read.contains_key(name) {
            let found = self.library.mesh(name);
            self.triangles += found.as_ref().map_or(0, |mesh| mesh.faces.len());
            self.read.insert(name.to_owned(), found);
        }
        match &self.read[name] {
            Ok(mesh) if mesh.faces.is_empty() => Err(format!("is {name:?}, which has no faces")),
            Ok(_) if self.triangles > MAX_TRIANGLES => Err(format!(
                "is {name:?}, with which the meshes of the cell have {} triangles; allowed are {MAX_TRIANGLES}: simplify them",
                self.triangles
            )),
            Ok(mesh) => Ok(Arc::clone(mesh)),
            Err(error) => Err(not_found(error, SpecKind::Mesh, name, self.library)),
        }
    }
}

/// Refuses more bodies than a cell may have, before any mesh is read. `shapes` are those of all bodies, each with its
/// pointer.
pub(super) fn check_count<'s>(shapes: impl Iterator<Item = (String, &'s ShapeSpec)>, findings: &mut Findings) -> bool {
    let (mut bodies, mut meshes) = (0, 0);
    let (mut first_body, mut first_mesh) = (None, None);
    for (pointer, shape) in shapes {
        bodies += 1;
        meshes += usize::from(matches!(shape, ShapeSpec::Mesh { .. }));
        if bodies > MAX_BODIES {
            first_body.get_or_insert(pointer);
        } else if meshes > MAX_MESH_BODIES {
            first_mesh.get_or_insert(pointer);
        }
    }
    for (first, count, what, most) in
        [(first_body, bodies, "bodies", MAX_BODIES), (first_mesh, meshes, "bodies that are meshes", MAX_MESH_BODIES)]
    {
        if let Some(pointer) = first {
            findings.push(pointer, format!("is one of {count} {what} of the cell; allowed are {most}: join some of them"));
        }
    }
    bodies <= MAX_BODIES && meshes <= MAX_MESH_BODIES
}
