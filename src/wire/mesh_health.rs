//! What a mesh is and what is wrong with it, as JSON: the answer to an upload and of `vantage inspect MESH --json`.

use serde::Serialize;
use utoipa::ToSchema;

use crate::geometry::mesh_io::ReadMesh;
use crate::geometry::{Aabb, MeshHealth, MeshWarning};

/// Health report of a mesh file. Lengths are millimetres in the file's own axes.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct MeshHealthReport {
    /// `stl_binary`, `stl_ascii`, `obj` or `ply`, found by content.
    pub format: String,
    /// The unit the file was taken to be in: `mm`, `cm`, `m` or `inch`.
    pub unit: String,
    /// Triangles in the file, after polygons are cut into fans.
    pub triangles_in_file: usize,
    /// Triangles kept, without degenerate ones.
    pub triangles: usize,
    /// Different vertices of the kept triangles.
    pub vertices: usize,
    /// Bounding box.
    pub bbox_mm: BboxMm,
    /// Area.
    pub area_mm2: f64,
    /// Enclosed volume, where every body is closed and consistently wound.
    pub volume_mm3: Option<f64>,
    /// Every edge belongs to exactly two triangles.
    pub watertight: bool,
    /// Connected bodies.
    pub bodies: usize,
    /// Triangles dropped for having no area.
    pub degenerate_triangles: usize,
    /// Triangles that are there more than once.
    pub duplicate_triangles: usize,
    /// Edges of one triangle.
    pub boundary_edges: usize,
    /// Edges of more than two triangles.
    pub non_manifold_edges: usize,
    /// Edges at which the winding of both triangles disagrees.
    pub inconsistent_edges: usize,
    /// Closed bodies that were inside out and have been turned.
    pub flipped_bodies: usize,
    /// What to know before planning, the gravest first.
    pub warnings: Vec<MeshWarningReport>,
}

/// Axis-aligned bounding box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct BboxMm {
    /// Lowest corner.
    pub min: [f64; 3],
    /// Highest corner.
    pub max: [f64; 3],
}

/// One thing to know about a mesh.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct MeshWarningReport {
    /// Stable code.
    pub code: String,
    /// What is found.
    pub detail: String,
    /// What to do about it.
    pub remedy: String,
}

impl From<&ReadMesh> for MeshHealthReport {
    fn from(read: &ReadMesh) -> Self {
        let MeshHealth { triangles_in_file, triangles, vertices, area_mm2, volume_mm3, watertight, bodies, .. } = read.health;
        Self {
            format: read.format.as_str().into(),
            unit: read.unit.as_str().into(),
            triangles_in_file,
            triangles,
            vertices,
            bbox_mm: read.health.aabb.into(),
            area_mm2,
            volume_mm3,
            watertight,
            bodies,
            degenerate_triangles: read.health.degenerate_triangles,
            duplicate_triangles: read.health.duplicate_triangles,
            boundary_edges: read.health.boundary_edges,
            non_manifold_edges: read.health.non_manifold_edges,
            inconsistent_edges: read.health.inconsistent_edges,
            flipped_bodies: read.health.flipped_bodies,
            warnings: read.health.warnings().into_iter().map(Into::into).collect(),
        }
    }
}

impl From<Aabb> for BboxMm {
    fn from(aabb: Aabb) -> Self {
        Self { min: aabb.min.into(), max: aabb.max.into() }
    }
}

impl From<MeshWarning> for MeshWarningReport {
    fn from(warning: MeshWarning) -> Self {
        Self { code: warning.code().into(), detail: warning.to_string(), remedy: warning.remedy().into() }
    }
}
