//! Health of a mesh, and the repairs that need no judgement: degenerate triangles go, and a closed body
//! that is inside out is turned.
//!
//! *Degenerate*: a repeated vertex, or an area below 1e-12 of the squared diagonal of the bounding box.
//! *Topology* (watertight, bodies, edges) is that of the welded triangles with three different vertices, thin ones
//! included: a triangle without area closes its edges, and dropping it makes no hole in the surface.
//! *Body*: triangles connected by edges that exactly two triangles share; so are bodies counted. Where closed shells touch along a loop of
//! edges, more triangles share these and each shell counts as several: for volume, orientation and nesting its pieces are one body, joined
//! by the wedges of material around the edges (`wedges`).
//! *Volume*: known where every body is closed, that is, where its triangles run along each of its edges as often in one direction as in
//! the other, so that the signed tetrahedra between them and any point add up to the same.
//! Cost: O(n) in the triangles, side by side on the threads of the caller's pool save for the joining of bodies, and at most 40
//! bytes each beside the mesh; nesting and overlap are looked at where boxes of two closed bodies lie within or upon each other, each up
//! to a budget.

mod bodies;
mod edges;
mod overlaps;
mod warning;
mod wedges;

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use super::poll::{Interrupted, Poll};
use super::side_by_side::{self, PIECE};
use super::sorted_lists::SortedLists;
use super::{Aabb, Mesh};
use bodies::{Bodies, Turned};
use edges::{EdgeCounts, Edges};
use overlaps::{nested_bodies, overlapping_pairs};

pub use warning::MeshWarning;

/// Smallest area of a triangle, as a share of the squared diagonal of the bounding box.
const MIN_AREA_SHARE: f64 = 1e-12;

/// Finds the faces that belong to a closed, consistently wound body of positive volume. Seen from outside such a
/// body its back faces hide nothing that its front faces do not hide.
///
/// # Errors
/// [`Interrupted`].
pub fn outward_faces(mesh: &Mesh, poll: &Poll<'_>) -> Result<Vec<bool>, Interrupted> {
    let edges = Edges::of(mesh, poll)?;
    let bodies = Bodies::of(mesh, &edges, poll)?;
    drop(edges);
    bodies.outward_faces(mesh, poll)
}

/// Calls `found` for every edge of exactly two triangles that run along it in opposite directions, with its vertices, the lower
/// first, and the two triangles.
///
/// # Errors
/// [`Interrupted`].
pub fn each_inner_edge(mesh: &Mesh, poll: &Poll<'_>, mut found: impl FnMut([u32; 2], [usize; 2])) -> Result<(), Interrupted> {
    for edge in Edges::of(mesh, poll)?.iter() {
        poll.spend(50)?;
        if let Some([a, b]) = edge.pair()
            && a.is_ascending() != b.is_ascending()
        {
            found(edge.vertices(), [a.face(), b.face()]);
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
    Ok(Edges::of(mesh, poll)?.counts.are_sound())
}

/// The health report of a mesh. Counts of triangles are after polygons were cut into them.
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
    /// Enclosed volume, a sum over bodies; only where every body is closed and consistently wound. Bodies may touch each other and
    /// themselves along edges, if as many triangles run along each in one direction as in the other.
    pub volume_mm3: Option<f64>,
    /// True if the volume counts space that bodies have in common more than once, because they run into each other or one lies in
    /// another.
    pub volume_counts_overlaps: bool,
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
    /// Pairs of closed bodies that were found to run into each other.
    pub overlapping_pairs: usize,
    /// Closed bodies that were found to lie wholly in the material of others while their surface faces outward: inner parts, or cavities
    /// with the wrong orientation.
    pub nested_bodies: usize,
    /// Polygons of the file that were left as fans, since they cross or fold over themselves or are too large to be cut otherwise.
    pub uncut_polygons: usize,
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
    let edges = Edges::of(&mesh, poll)?;
    let (bodies, counts) = (Bodies::of(&mesh, &edges, poll)?, edges.counts);
    drop(edges);
    let turned = bodies.turn_inverted(&mut mesh, poll)?;
    let overlapping = overlapping_pairs(&mesh, &bodies, poll)?;
    // Nesting that is too deep to tell what is inside out is too deep to tell this.
    let nested_bodies = if turned.unresolved == 0 { nested_bodies(&mesh, &bodies, &overlapping, poll)? } else { 0 };

    let used = mesh.aabb_of_faces(poll)?;
    let min_area_mm2 = MIN_AREA_SHARE * used.extent_mm().norm_squared();
    let kept = mesh.keep_faces(|mesh, face| mesh.face_area_mm2(face) >= min_area_mm2, poll)?;
    let mut piece_has_area = vec![kept.is_none(); bodies.pieces()];
    for face in kept.iter().flatten().enumerate().filter_map(|(face, kept)| kept.then_some(face)) {
        poll.spend(5)?;
        piece_has_area[bodies.piece_of_face(face)] = true;
    }
    let with_area = piece_has_area.into_iter().filter(|&has| has).count();
    drop(bodies);
    mesh.drop_unused_vertices(poll)?;
    let health = report(&mesh, triangles_in_file, with_area, &counts, &turned, poll)?;
    let overlapping_pairs = overlapping.len();
    let volume_counts_overlaps = overlapping_pairs + nested_bodies > 0 && health.volume_mm3.is_some();
    Ok((mesh, MeshHealth { overlapping_pairs, nested_bodies, volume_counts_overlaps, ..health }))
}

fn report(
    mesh: &Mesh,
    triangles_in_file: usize,
    bodies: usize,
    edges: &EdgeCounts,
    turned: &Turned,
    poll: &Poll<'_>,
) -> Result<MeshHealth, Interrupted> {
    let duplicate_triangles = duplicates(mesh, poll)?;
    let volume_mm3 = if turned.not_closed == 0 {
        // A shell that was there twice, once inside out, would count twice.
        let counts_twice = turned.among_joined && duplicate_triangles > 0;
        (!counts_twice).then_some(turned.closed_mm3)
    } else if turned.not_closed == 1 && edges.unbalanced == 0 && duplicate_triangles == 0 {
        // Of several bodies one may be inside out and cancel another; a shell that is there twice would count twice.
        balanced_volume_mm3(mesh, turned.closed_mm3, poll)?
    } else {
        None
    };
    Ok(MeshHealth {
        triangles_in_file,
        triangles: mesh.faces.len(),
        vertices: mesh.vertices_mm.len(),
        aabb: mesh.aabb_of_vertices(poll)?,
        area_mm2: area_mm2(mesh, poll)?,
        volume_mm3,
        volume_counts_overlaps: false,
        watertight: edges.boundary == 0 && edges.non_manifold == 0,
        bodies,
        degenerate_triangles: triangles_in_file - mesh.faces.len(),
        duplicate_triangles,
        boundary_edges: edges.boundary,
        non_manifold_edges: edges.non_manifold,
        inconsistent_edges: edges.inconsistent,
        flipped_bodies: turned.bodies,
        unresolved_bodies: turned.unresolved,
        // Who has the bodies and the file's polygons tells these.
        overlapping_pairs: 0,
        nested_bodies: 0,
        uncut_polygons: 0,
    })
}

fn has_three_vertices([a, b, c]: [u32; 3]) -> bool {
    a != b && b != c && c != a
}

/// Area of all triangles: sums of pieces, added in their order.
fn area_mm2(mesh: &Mesh, poll: &Poll<'_>) -> Result<f64, Interrupted> {
    let of_piece = |faces: &Range<usize>| faces.clone().map(|face| mesh.face_area_mm2(face)).sum::<f64>();
    Ok(side_by_side::map(&side_by_side::ranges(mesh.faces.len()), of_piece, poll)?.into_iter().sum())
}

/// Volume by the divergence theorem: where each edge is run along as often in one direction as in the other, the signed
/// tetrahedra between the triangles and a point add up to the same about any point. `None` if what is not of the closed
/// bodies is inside out.
fn balanced_volume_mm3(mesh: &Mesh, closed_mm3: f64, poll: &Poll<'_>) -> Result<Option<f64>, Interrupted> {
    let around = mesh.aabb_of_vertices(poll)?;
    let origin = around.centre();
    let sixfold_mm3 = |face: usize| {
        let [a, b, c] = mesh.corners(face).map(|corner| corner - origin);
        a.dot(&b.cross(&c))
    };
    let of_piece = |faces: &Range<usize>| faces.clone().map(sixfold_mm3).sum::<f64>();
    let pieces = side_by_side::map(&side_by_side::ranges(mesh.faces.len()), of_piece, poll)?;
    let volume_mm3 = pieces.into_iter().sum::<f64>() / 6.0;
    let rounding_mm3 = 1e-12 * around.extent_mm().norm().powi(3);
    Ok((volume_mm3 - closed_mm3 > rounding_mm3).then_some(volume_mm3))
}

/// Number of triangles with the same three vertices as another before them.
fn duplicates(mesh: &Mesh, poll: &Poll<'_>) -> Result<usize, Interrupted> {
    let entry = |face: usize| {
        let mut vertices = mesh.faces[face];
        vertices.sort_unstable();
        let [low, middle, high] = vertices;
        [(low, u64::from(middle) << 32 | u64::from(high))]
    };
    let lists = SortedLists::new(mesh.faces.len(), mesh.vertices_mm.len(), entry, poll)?;
    let repeated = |list: &[u64]| list.windows(2).filter(|pair| pair[0] == pair[1]).count();
    let of_piece = |keys: &Range<usize>| lists.of(keys.clone()).map(|(_, list)| repeated(list)).sum::<usize>();
    Ok(side_by_side::map(&lists.pieces(), of_piece, poll)?.into_iter().sum())
}

/// Smallest box around the boxes of pieces.
fn join(boxes: Vec<Aabb>) -> Aabb {
    boxes.iter().fold(Aabb::empty(), |all, aabb| all.with(&aabb.min).with(&aabb.max))
}

impl Mesh {
    /// Keeps the faces that `keep` says yes to; which of them, or `None` where all are kept.
    fn keep_faces(
        &mut self,
        keep: impl Fn(&Self, usize) -> bool + Sync,
        poll: &Poll<'_>,
    ) -> Result<Option<Vec<bool>>, Interrupted> {
        let of_piece = |faces: &Range<usize>| faces.clone().map(|face| keep(self, face)).collect::<Vec<_>>();
        let kept = side_by_side::map(&side_by_side::ranges(self.faces.len()), of_piece, poll)?.concat();
        if kept.iter().all(|&keep| keep) {
            return Ok(None);
        }
        let (mut faces_kept, mut sources_kept) = (kept.iter(), kept.iter());
        self.faces.retain(|_| faces_kept.next() == Some(&true));
        self.source_face.retain(|_| sources_kept.next() == Some(&true));
        Ok(Some(kept))
    }

    /// Box around the vertices that triangles use.
    fn aabb_of_faces(&self, poll: &Poll<'_>) -> Result<Aabb, Interrupted> {
        let pieces: Vec<_> = self.faces.chunks(PIECE).collect();
        let around = |faces: &&[[u32; 3]]| Aabb::around(faces.iter().flatten().map(|vertex| &self.vertices_mm[*vertex as usize]));
        Ok(join(side_by_side::map(&pieces, around, poll)?))
    }

    /// Box around all vertices.
    fn aabb_of_vertices(&self, poll: &Poll<'_>) -> Result<Aabb, Interrupted> {
        let pieces: Vec<_> = self.vertices_mm.chunks(PIECE).collect();
        Ok(join(side_by_side::map(&pieces, |vertices| Aabb::around(*vertices), poll)?))
    }

    fn drop_unused_vertices(&mut self, poll: &Poll<'_>) -> Result<(), Interrupted> {
        let used: Vec<AtomicBool> = std::iter::repeat_with(|| AtomicBool::new(false)).take(self.vertices_mm.len()).collect();
        let mark = |faces: &&[[u32; 3]]| {
            faces.iter().flatten().for_each(|vertex| used[*vertex as usize].store(true, Ordering::Relaxed));
        };
        side_by_side::map(&self.faces.chunks(PIECE).collect::<Vec<_>>(), mark, poll)?;
        let used: Vec<bool> = used.into_iter().map(AtomicBool::into_inner).collect();
        if used.iter().all(|used| *used) {
            self.vertices_mm.shrink_to_fit();
            return Ok(());
        }
        let mut next = 0;
        let numbered = |used: &bool| {
            next += u32::from(*used);
            next - u32::from(*used)
        };
        let number: Vec<u32> = used.iter().map(numbered).collect();
        side_by_side::change(&mut self.faces, |face| *face = face.map(|vertex| number[vertex as usize]), poll)?;
        let mut used = used.iter();
        self.vertices_mm.retain(|_| used.next() == Some(&true));
        self.vertices_mm.shrink_to_fit();
        Ok(())
    }
}

#[cfg(test)]
mod tests;
