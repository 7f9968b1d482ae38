//! Health of a mesh, and the repairs that need no judgement: degenerate triangles go, and a closed body
//! that is inside out is turned.
//!
//! *Degenerate*: a repeated vertex, or an area below 1e-12 of the squared diagonal of the bounding box.
//! *Topology* (watertight, bodies, edges) is that of the welded triangles with three different vertices, thin ones
//! included: a triangle without area closes its edges, and dropping it makes no hole in the surface.
//! *Body*: triangles connected by edges that exactly two triangles share.
//! Cost: O(n) in the triangles, and at most 47 bytes each beside the mesh; nesting is only looked at when a closed body has
//! negative volume, and then up to a budget.

mod bodies;
mod edges;
mod warning;

use super::poll::{Interrupted, Poll};
use super::sort::sort_by_key;
use super::{Aabb, Mesh};
use bodies::{Bodies, Turned};
use edges::{EdgeCounts, Edges};

pub use warning::MeshWarning;

/// Smallest area of a triangle, as a share of the squared diagonal of the bounding box.
const MIN_AREA_SHARE: f64 = 1e-12;

/// Finds the faces that belong to a closed, consistently wound body of positive volume. Seen from outside such a
/// body its back faces hide nothing that its front faces do not hide.
///
/// # Errors
/// [`Interrupted`].
pub fn outward_faces(mesh: &Mesh, poll: &Poll<'_>) -> Result<Vec<bool>, Interrupted> {
    let edges = Edges::of(&mesh.faces, poll)?;
    let bodies = Bodies::of(mesh.faces.len(), &edges, poll)?;
    drop(edges);
    bodies.outward_faces(mesh, poll)
}

/// Calls `found` for every edge of exactly two triangles that run along it in opposite directions, with its vertices, the lower
/// first, and the two triangles.
///
/// # Errors
/// [`Interrupted`].
pub fn each_inner_edge(mesh: &Mesh, poll: &Poll<'_>, mut found: impl FnMut([u32; 2], [usize; 2])) -> Result<(), Interrupted> {
    for sides in Edges::of(&mesh.faces, poll)?.shared() {
        poll.spend(50)?;
        if let [a, b] = sides
            && a.is_ascending() != b.is_ascending()
        {
            found(a.vertices(), [a.face(), b.face()]);
        }
    }
    Ok(())
}

/// Is true if every edge belongs to exactly two triangles, which run along it in opposite directions: then no inner side can
/// come into sight.
///
/// # Errors
/// [`Interrupted`].
pub fn is_closed(mesh: &Mesh, poll: &Poll<'_>) -> Result<bool, Interrupted> {
    let EdgeCounts { boundary, non_manifold, inconsistent } = Edges::of(&mesh.faces, poll)?.counts;
    Ok(boundary + non_manifold + inconsistent == 0)
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
    let health = |poll: &Poll<'_>| clean(mesh.clone(), poll).map(|(_, health)| health);
    let Ok(health) = health(&Poll::never()) else { unreachable!("nobody interrupts it") };
    health
}

/// Drops degenerate triangles and unused vertices, turns closed bodies that are inside out, and reports. Equal vertices
/// must have been welded; the order of vertices and triangles is kept.
///
/// # Errors
/// [`Interrupted`].
pub(super) fn clean(mut mesh: Mesh, poll: &Poll<'_>) -> Result<(Mesh, MeshHealth), Interrupted> {
    let triangles_in_file = mesh.faces.len();
    mesh.keep_faces(|mesh, face| has_three_vertices(mesh.faces[face]), poll)?;
    let edges = Edges::of(&mesh.faces, poll)?;
    let (bodies, counts) = (Bodies::of(mesh.faces.len(), &edges, poll)?, edges.counts);
    drop(edges);
    let turned = bodies.turn_inverted(&mut mesh, poll)?;

    let used = mesh.aabb_of_faces(poll)?;
    let min_area_mm2 = MIN_AREA_SHARE * used.extent_mm().norm_squared();
    let mut body_has_area = vec![false; bodies.count()];
    let keep = |mesh: &Mesh, face: usize| {
        let keep = mesh.face_area_mm2(face) >= min_area_mm2;
        body_has_area[bodies.of_face(face)] |= keep;
        keep
    };
    mesh.keep_faces(keep, poll)?;
    let with_area = body_has_area.into_iter().filter(|&has| has).count();
    drop(bodies);
    mesh.drop_unused_vertices(poll)?;
    let health = report(&mesh, triangles_in_file, with_area, &counts, &turned, poll)?;
    Ok((mesh, health))
}

fn report(
    mesh: &Mesh,
    triangles_in_file: usize,
    bodies: usize,
    edges: &EdgeCounts,
    turned: &Turned,
    poll: &Poll<'_>,
) -> Result<MeshHealth, Interrupted> {
    Ok(MeshHealth {
        triangles_in_file,
        triangles: mesh.faces.len(),
        vertices: mesh.vertices_mm.len(),
        aabb: mesh.aabb_of_faces(poll)?,
        area_mm2: area_mm2(mesh, poll)?,
        volume_mm3: turned.volume_mm3,
        watertight: edges.boundary == 0 && edges.non_manifold == 0,
        bodies,
        degenerate_triangles: triangles_in_file - mesh.faces.len(),
        duplicate_triangles: duplicates(&mesh.faces, poll)?,
        boundary_edges: edges.boundary,
        non_manifold_edges: edges.non_manifold,
        inconsistent_edges: edges.inconsistent,
        flipped_bodies: turned.bodies,
        unresolved_bodies: turned.unresolved,
    })
}

fn has_three_vertices([a, b, c]: [u32; 3]) -> bool {
    a != b && b != c && c != a
}

fn area_mm2(mesh: &Mesh, poll: &Poll<'_>) -> Result<f64, Interrupted> {
    let mut sum_mm2 = 0.0;
    for face in 0..mesh.faces.len() {
        poll.spend(10)?;
        sum_mm2 += mesh.face_area_mm2(face);
    }
    Ok(sum_mm2)
}

fn duplicates(faces: &[[u32; 3]], poll: &Poll<'_>) -> Result<usize, Interrupted> {
    let mut sorted: Vec<[u32; 3]> = faces.to_vec();
    for face in &mut sorted {
        poll.spend(5)?;
        face.sort_unstable();
    }
    let key = |face: &[u32; 3]| face.iter().fold(0, |key, vertex| key << 32 | u128::from(*vertex));
    sort_by_key(&mut sorted, key, poll)?;
    poll.spend(sorted.len())?;
    Ok(sorted.windows(2).filter(|pair| pair[0] == pair[1]).count())
}

impl Mesh {
    /// Keeps the faces that `keep` says yes to. It sees the mesh as it was and is asked once a face, in order.
    fn keep_faces(&mut self, mut keep: impl FnMut(&Self, usize) -> bool, poll: &Poll<'_>) -> Result<(), Interrupted> {
        let mut kept = Vec::with_capacity(self.faces.len());
        for face in 0..self.faces.len() {
            poll.spend(10)?;
            kept.push(keep(self, face));
        }
        if kept.iter().all(|&keep| keep) {
            return Ok(());
        }
        let (mut faces_kept, mut sources_kept) = (kept.iter(), kept.iter());
        self.faces.retain(|_| faces_kept.next() == Some(&true));
        self.source_face.retain(|_| sources_kept.next() == Some(&true));
        Ok(())
    }

    /// Box around the vertices that triangles use.
    fn aabb_of_faces(&self, poll: &Poll<'_>) -> Result<Aabb, Interrupted> {
        let mut aabb = Aabb::empty();
        for &vertex in self.faces.iter().flatten() {
            poll.spend(3)?;
            aabb = aabb.with(&self.vertices_mm[vertex as usize]);
        }
        Ok(aabb)
    }

    /// Box around all vertices.
    fn aabb_of_vertices(&self, poll: &Poll<'_>) -> Result<Aabb, Interrupted> {
        let mut aabb = Aabb::empty();
        for vertex in &self.vertices_mm {
            poll.spend(2)?;
            aabb = aabb.with(vertex);
        }
        Ok(aabb)
    }

    fn drop_unused_vertices(&mut self, poll: &Poll<'_>) -> Result<(), Interrupted> {
        let mut number = vec![u32::MAX; self.vertices_mm.len()];
        for &vertex in self.faces.iter().flatten() {
            poll.spend(2)?;
            number[vertex as usize] = 0;
        }
        let used = number.iter_mut().filter(|number| **number == 0);
        used.zip(0..).for_each(|(number, next)| *number = next);
        for vertex in self.faces.iter_mut().flatten() {
            poll.spend(2)?;
            *vertex = number[*vertex as usize];
        }
        let mut numbers = number.iter();
        self.vertices_mm.retain(|_| numbers.next() != Some(&u32::MAX));
        self.vertices_mm.shrink_to_fit();
        Ok(())
    }
}

#[cfg(test)]
mod tests;
