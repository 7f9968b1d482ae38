//! What a mesh is and what is wrong with it, as answers tell it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::geometry::mesh_io::ReadMesh;

/// Facts of a mesh, and what a user should know before planning on it. Counts are after polygons were cut into fans.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeshHealth {
    /// `stl_binary`, `stl_ascii`, `obj` or `ply`, by the file's content.
    pub format: String,
    /// Triangles in the file.
    pub triangles_in_file: usize,
    /// Triangles kept.
    pub triangles: usize,
    /// Vertices that kept triangles use.
    pub vertices: usize,
    /// Bounding box of the kept triangles.
    pub bbox_mm: BoxMm,
    /// Area of the kept triangles.
    pub area_mm2: f64,
    /// Enclosed volume; only where every body is closed and consistently wound.
    pub volume_mm3: Option<f64>,
    /// Whether every edge belongs to exactly two triangles.
    pub watertight: bool,
    /// Connected bodies.
    pub bodies: usize,
    /// Triangles dropped for having no area.
    pub degenerate_triangles: usize,
    /// Kept triangles that are there already.
    pub duplicate_triangles: usize,
    /// Edges of one triangle.
    pub boundary_edges: usize,
    /// Edges of more than two triangles.
    pub non_manifold_edges: usize,
    /// Edges whose two triangles are wound against each other.
    pub inconsistent_edges: usize,
    /// Closed bodies that were inside out and have been turned.
    pub flipped_bodies: usize,
    /// What to know, the gravest first.
    pub warnings: Vec<MeshNote>,
}

/// Axis-aligned bounding box, part frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BoxMm {
    /// Lowest corner.
    pub min: [f64; 3],
    /// Highest corner.
    pub max: [f64; 3],
}

/// One thing to know about a mesh.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct MeshNote {
    /// Stable name, for programs.
    pub code: String,
    /// What was found.
    pub detail: String,
    /// What to do about it.
    pub remedy: String,
}

impl MeshHealth {
    /// The report in place of a stored one that cannot be read.
    #[must_use]
    pub fn unreadable(reason: &str) -> Self {
        let note = MeshNote {
            code: "health_unreadable".to_owned(),
            detail: format!("the stored health report cannot be read: {reason}"),
            remedy: "delete the mesh and upload it again for a new report; jobs read its file, not the report".to_owned(),
        };
        Self { warnings: vec![note], ..Self::default() }
    }

    /// The report of a mesh that was read.
    #[must_use]
    pub fn new(read: &ReadMesh) -> Self {
        let health = &read.health;
        let note = |warning: crate::geometry::MeshWarning| MeshNote {
            code: warning.code().to_owned(),
            detail: warning.to_string(),
            remedy: warning.remedy().to_owned(),
        };
        Self {
            format: read.format.as_str().to_owned(),
            triangles_in_file: health.triangles_in_file,
            triangles: health.triangles,
            vertices: health.vertices,
            bbox_mm: BoxMm { min: health.aabb.min.into(), max: health.aabb.max.into() },
            area_mm2: health.area_mm2,
            volume_mm3: health.volume_mm3,
            watertight: health.watertight,
            bodies: health.bodies,
            degenerate_triangles: health.degenerate_triangles,
            duplicate_triangles: health.duplicate_triangles,
            boundary_edges: health.boundary_edges,
            non_manifold_edges: health.non_manifold_edges,
            inconsistent_edges: health.inconsistent_edges,
            flipped_bodies: health.flipped_bodies,
            warnings: health.warnings().into_iter().map(note).collect(),
        }
    }
}
