//! Health report of a mesh.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::closed_list;
use crate::geometry::mesh_io::ReadMesh;
use crate::geometry::{FaceGroup, MeshWarning};

/// Facts of a mesh, and warnings to read before planning on it. Polygons count as the triangles that they were split into.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = MeshHealth)]
pub struct MeshHealthReport {
    /// Format of the file, detected from its content.
    #[schema(value_type = MeshFile)]
    pub format: String,
    /// Number of triangles in the file.
    pub triangles_in_file: usize,
    /// Number of triangles kept.
    pub triangles: usize,
    /// Number of vertices that kept triangles use.
    pub vertices: usize,
    /// Bounding box of the kept triangles.
    pub bbox_mm: BoxMm,
    /// Area of the kept triangles.
    pub area_mm2: f64,
    /// Enclosed volume, the sum over bodies; `null` unless every body is closed and consistently wound. Bodies may touch each other and
    /// themselves along edges, if as many triangles run along each edge in one direction as in the other.
    pub volume_mm3: Option<f64>,
    /// True if bodies run into each other or one lies in another, so that the volume counts what they have in common more than once.
    #[serde(default)]
    pub volume_counts_overlaps: bool,
    /// True if every edge belongs to exactly two triangles.
    pub watertight: bool,
    /// Number of connected bodies.
    pub bodies: usize,
    /// Number of closed bodies found to lie wholly inside others with normals that point outwards: inner parts, or cavities with the
    /// wrong orientation. There may be more in meshes of many bodies.
    #[serde(default)]
    pub nested_bodies: usize,
    /// Number of triangles dropped because they have no area.
    pub degenerate_triangles: usize,
    /// Number of kept triangles that repeat another one.
    pub duplicate_triangles: usize,
    /// Number of edges of only one triangle.
    pub boundary_edges: usize,
    /// Number of edges of more than two triangles.
    pub non_manifold_edges: usize,
    /// Number of edges whose two triangles are wound in opposite senses.
    pub inconsistent_edges: usize,
    /// Number of closed bodies that were inside out and have been flipped.
    pub flipped_bodies: usize,
    /// Names of the groups of faces in the file (OBJ), which regions may name; `null` if there are more than 500, if they take more
    /// than 16 KiB together, or in a report of an earlier release.
    #[serde(default)]
    pub group_names: Option<Vec<String>>,
    /// Warnings, the most serious first.
    pub warnings: Vec<MeshNote>,
}

/// Max number of names of groups in a report, and their bytes together: a list of meshes has the reports of all of them.
const MAX_GROUP_NAMES: usize = 500;
const MAX_GROUP_NAMES_BYTES: usize = 16 << 10;

/// Names of the groups of a mesh; `None` if they are too many for a report.
fn group_names(groups: &[FaceGroup]) -> Option<Vec<String>> {
    let bytes: usize = groups.iter().map(|group| group.name.len()).sum();
    let is_listed = groups.len() <= MAX_GROUP_NAMES && bytes <= MAX_GROUP_NAMES_BYTES;
    is_listed.then(|| groups.iter().map(|group| group.name.clone()).collect())
}

/// Format of a mesh file.
#[derive(ToSchema)]
#[schema(rename_all = "snake_case")]
#[expect(dead_code, reason = "only its schema is used; the geometry room knows no schemas")]
enum MeshFile {
    StlBinary,
    StlAscii,
    Obj,
    Ply,
}

/// Axis-aligned bounding box, part frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BoxMm {
    /// Lowest corner.
    pub min: [f64; 3],
    /// Highest corner.
    pub max: [f64; 3],
}

closed_list! {
    /// Kind of a warning about a mesh.
    pub enum MeshNoteCode {
        /// The size is not that of a part to scan: the unit may be wrong.
        UnitSuspect = "unit_suspect",
        /// The surface has holes.
        OpenSurface = "open_surface",
        /// More than two triangles meet at an edge.
        NonManifoldEdges = "non_manifold_edges",
        /// Neighbouring triangles are wound against each other.
        InconsistentWinding = "inconsistent_winding",
        /// Closed bodies run into each other.
        BodiesOverlap = "bodies_overlap",
        /// Closed bodies lie within the material of others.
        BodiesNested = "bodies_nested",
        /// Polygons cross themselves or are too large, and were not cut into triangles that lie beside each other.
        PolygonsNotCut = "polygons_not_cut",
        /// Triangles without area were dropped.
        DegenerateTrianglesDropped = "degenerate_triangles_dropped",
        /// Triangles repeat others.
        DuplicateTriangles = "duplicate_triangles",
        /// Bodies were inside out and have been flipped.
        BodiesFlipped = "bodies_flipped",
        /// The nesting of bodies is too deep to tell which are inside out.
        OrientationUnresolved = "orientation_unresolved",
        /// The stored report cannot be read.
        HealthUnreadable = "health_unreadable",
    }
}

impl From<MeshWarning> for MeshNoteCode {
    fn from(warning: MeshWarning) -> Self {
        match warning {
            MeshWarning::Size { .. } => Self::UnitSuspect,
            MeshWarning::Open { .. } => Self::OpenSurface,
            MeshWarning::NonManifold { .. } => Self::NonManifoldEdges,
            MeshWarning::Inconsistent { .. } => Self::InconsistentWinding,
            MeshWarning::Overlap { .. } => Self::BodiesOverlap,
            MeshWarning::Nested { .. } => Self::BodiesNested,
            MeshWarning::Uncut { .. } => Self::PolygonsNotCut,
            MeshWarning::Degenerate { .. } => Self::DegenerateTrianglesDropped,
            MeshWarning::Duplicate { .. } => Self::DuplicateTriangles,
            MeshWarning::Flipped { .. } => Self::BodiesFlipped,
            MeshWarning::Unresolved { .. } => Self::OrientationUnresolved,
        }
    }
}

/// A warning about a mesh.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct MeshNote {
    /// Stable code, for programs.
    #[schema(value_type = MeshNoteCode)]
    pub code: String,
    /// Description of the finding.
    pub detail: String,
    /// Advice on what to do about it.
    pub remedy: String,
}

impl MeshHealthReport {
    /// Report in place of a stored one that cannot be read.
    #[must_use]
    pub fn unreadable(reason: &str) -> Self {
        let note = MeshNote {
            code: MeshNoteCode::HealthUnreadable.as_str().to_owned(),
            detail: format!("the stored health report cannot be read: {reason}"),
            remedy: "delete the mesh and upload it again for a new report; jobs read its file, not the report".to_owned(),
        };
        Self { warnings: vec![note], ..Self::default() }
    }

    /// Report on a mesh that was read.
    #[must_use]
    pub fn new(read: &ReadMesh) -> Self {
        let health = &read.health;
        let note = |warning: MeshWarning| MeshNote {
            code: MeshNoteCode::from(warning).as_str().to_owned(),
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
            volume_counts_overlaps: health.volume_counts_overlaps,
            watertight: health.watertight,
            bodies: health.bodies,
            nested_bodies: health.nested_bodies,
            degenerate_triangles: health.degenerate_triangles,
            duplicate_triangles: health.duplicate_triangles,
            boundary_edges: health.boundary_edges,
            non_manifold_edges: health.non_manifold_edges,
            inconsistent_edges: health.inconsistent_edges,
            flipped_bodies: health.flipped_bodies,
            group_names: group_names(&read.mesh.groups),
            warnings: health.warnings().into_iter().map(note).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A list of meshes would have had a million names.
    #[test]
    fn names_of_groups_are_left_out_of_a_report_where_they_are_too_many_or_too_long() {
        let told = |count: usize, length: usize| {
            let name = |number: usize| format!("{number:0length$}");
            let groups: Vec<FaceGroup> =
                (0..count).map(|number| FaceGroup { name: name(number), source_faces: vec![0] }).collect();
            group_names(&groups).map(|names| names.len())
        };
        assert_eq!([told(0, 1), told(MAX_GROUP_NAMES, 8), told(16, 1000)], [Some(0), Some(MAX_GROUP_NAMES), Some(16)]);
        assert_eq!([told(MAX_GROUP_NAMES + 1, 8), told(17, 1000)], [None, None]);
    }
}
