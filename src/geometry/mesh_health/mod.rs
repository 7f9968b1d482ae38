//! Health of a mesh, and the repairs that need no judgement: degenerate triangles go, and a closed body
//! that is inside out is turned.
//!
//! *Degenerate*: a repeated vertex, or an area below 1e-12 of the squared diagonal of the bounding box.
//! *Topology* (watertight, bodies, edges) is that of the welded triangles with three different vertices, thin ones
//! included: a triangle without area closes its edges, and dropping it makes no hole in the surface.
//! *Body*: triangles connected by edges that exactly two triangles share.
//! Cost: O(n log n) in the triangles for the edges; nesting is only looked at when a closed body has negative volume.

mod bodies;
mod edges;
mod warning;

use super::{Aabb, Mesh};
use bodies::Bodies;
use edges::Edges;

pub use warning::MeshWarning;

/// Smallest area of a triangle, as a share of the squared diagonal of the bounding box.
const MIN_AREA_SHARE: f64 = 1e-12;

/// Finds the faces that belong to a closed, consistently wound body of positive volume. Seen from outside such a
/// body its back faces hide nothing that its front faces do not hide.
#[must_use]
pub fn outward_faces(mesh: &Mesh) -> Vec<bool> {
    Bodies::of(mesh, &Edges::of(&mesh.faces)).outward_faces(mesh)
}

/// The health report of a mesh. Counts of triangles are after polygons were cut into fans.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshHealth {
    /// Triangles in the file.
    pub triangles_in_file: usize,
    /// Triangles kept.
    pub triangles: usize,
    /// Different vertices that kept triangles use.
    pub vertices: usize,
    /// Bounding box of the kept triangles.
    pub aabb: Aabb,
    /// Area of the kept triangles.
    pub area_mm2: f64,
    /// Enclosed volume; only where every body is closed and consistently wound.
    pub volume_mm3: Option<f64>,
    /// Every edge belongs to exactly two triangles.
    pub watertight: bool,
    /// Connected bodies with any area.
    pub bodies: usize,
    /// Triangles dropped for having no area.
    pub degenerate_triangles: usize,
    /// Kept triangles whose three vertices an earlier one has too, in any order.
    pub duplicate_triangles: usize,
    /// Edges of one triangle.
    pub boundary_edges: usize,
    /// Edges of more than two triangles.
    pub non_manifold_edges: usize,
    /// Edges whose two triangles are wound against each other.
    pub inconsistent_edges: usize,
    /// Closed bodies that were inside out and have been turned.
    pub flipped_bodies: usize,
    /// Closed bodies with negative volume that were left alone, because the nesting is too deep to tell cavities.
    pub unresolved_bodies: usize,
}

impl MeshHealth {
    /// Diagonal of the bounding box.
    #[must_use]
    pub fn diagonal_mm(&self) -> f64 {
        self.aabb.extent_mm().norm()
    }
}

/// Health of a mesh that is clean already; its triangles are not turned.
#[must_use]
pub fn assess(mesh: &Mesh) -> MeshHealth {
    clean(mesh.clone()).1
}

/// Drops degenerate triangles and unused vertices, turns closed bodies that are inside out, and reports. Equal vertices
/// must have been welded; the order of vertices and triangles is kept.
pub(super) fn clean(mut mesh: Mesh) -> (Mesh, MeshHealth) {
    let triangles_in_file = mesh.faces.len();
    mesh.keep_faces(|mesh, face| has_three_vertices(mesh.faces[face]));
    let edges = Edges::of(&mesh.faces);
    let bodies = Bodies::of(&mesh, &edges);
    let turned = bodies.turn_inverted(&mut mesh);

    let used = Aabb::around(mesh.faces.iter().flatten().map(|&v| &mesh.vertices_mm[v as usize]));
    let min_area_mm2 = MIN_AREA_SHARE * used.extent_mm().norm_squared();
    let mut body_has_area = vec![false; bodies.count()];
    mesh.keep_faces(|mesh, face| {
        let keep = mesh.face_area_mm2(face) >= min_area_mm2;
        body_has_area[bodies.of_face(face)] |= keep;
        keep
    });
    mesh.drop_unused_vertices();

    let health = MeshHealth {
        triangles_in_file,
        triangles: mesh.faces.len(),
        vertices: mesh.vertices_mm.len(),
        aabb: mesh.aabb(),
        area_mm2: mesh.area_mm2(),
        volume_mm3: turned.volume_mm3,
        watertight: edges.boundary == 0 && edges.non_manifold == 0,
        bodies: body_has_area.into_iter().filter(|&has| has).count(),
        degenerate_triangles: triangles_in_file - mesh.faces.len(),
        duplicate_triangles: duplicates(&mesh.faces),
        boundary_edges: edges.boundary,
        non_manifold_edges: edges.non_manifold,
        inconsistent_edges: edges.inconsistent,
        flipped_bodies: turned.bodies,
        unresolved_bodies: turned.unresolved,
    };
    (mesh, health)
}

fn has_three_vertices([a, b, c]: [u32; 3]) -> bool {
    a != b && b != c && c != a
}

fn duplicates(faces: &[[u32; 3]]) -> usize {
    let mut sorted: Vec<[u32; 3]> = faces.to_vec();
    sorted.iter_mut().for_each(|face| face.sort_unstable());
    sorted.sort_unstable();
    sorted.windows(2).filter(|pair| pair[0] == pair[1]).count()
}

impl Mesh {
    /// Keeps the faces that `keep` says yes to. It sees the mesh as it was and is asked once a face, in order.
    fn keep_faces(&mut self, mut keep: impl FnMut(&Self, usize) -> bool) {
        let kept: Vec<bool> = (0..self.faces.len()).map(|face| keep(self, face)).collect();
        if kept.iter().all(|&keep| keep) {
            return;
        }
        let (mut faces_kept, mut sources_kept) = (kept.iter(), kept.iter());
        self.faces.retain(|_| faces_kept.next() == Some(&true));
        self.source_face.retain(|_| sources_kept.next() == Some(&true));
    }

    fn drop_unused_vertices(&mut self) {
        let mut number = vec![u32::MAX; self.vertices_mm.len()];
        self.faces.iter().flatten().for_each(|&v| number[v as usize] = 0);
        let used = number.iter_mut().filter(|number| **number == 0);
        used.zip(0..).for_each(|(number, next)| *number = next);
        self.faces.iter_mut().flatten().for_each(|v| *v = number[*v as usize]);
        let mut numbers = number.iter();
        self.vertices_mm.retain(|_| numbers.next() != Some(&u32::MAX));
    }
}

#[cfg(test)]
mod tests;
