//! Simplified meshes for display, each of whose faces is traced back to the uploaded file. A mesh within the budget is passed
//! on unchanged; a larger one is simplified by vertex clustering on a grid whose cell size is searched for. Each cluster is
//! drawn at the point that best fits the planes of its triangles (Rossignac and Borrel 1993; Lindstrom, *Out-of-core
//! simplification of large polygonal models*, 2000, §3). Clustering needs no connectivity, so open, non-manifold and
//! self-intersecting meshes can be simplified too.
//!
//! Part frame, mm. Cost: O(triangles) time per trial cell size (about a dozen), then up to 64 preview faces tested for each
//! corner of a collapsed triangle. Memory: 12 bytes per triangle and 12 per vertex.

mod cluster;
mod glb;
#[cfg(test)]
mod tests;

pub use glb::glb;

use super::poll::{Interrupted, Poll};
use super::sort::sort_by_key;
use super::{FaceLists, Mesh};

/// Value in [`Preview::face_of_triangle`] of a triangle that the preview does not draw.
pub const NOT_DRAWN: u32 = u32::MAX;

/// A simplified mesh for display.
#[derive(Clone, Debug, PartialEq)]
pub struct Preview {
    /// Vertex positions, part frame, mm.
    pub positions_mm: Vec<[f32; 3]>,
    /// Vertex indices per face, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// Preview face that stands for each triangle of the mesh: the one it became, or, where it collapsed, a neighbour of the
    /// point to which it shrank; [`NOT_DRAWN`] for bodies smaller than a cell.
    pub face_of_triangle: Vec<u32>,
    /// Faces of the uploaded file behind each preview face, ascending.
    pub source_faces: FaceLists,
}

/// Simplifies `mesh` to at most `max_triangles` faces. The result is for display only: distances on it are off by up to a
/// cell, and sheets closer than a cell may touch.
///
/// # Errors
/// [`Interrupted`].
pub fn preview(mesh: &Mesh, max_triangles: usize, poll: &Poll<'_>) -> Result<Preview, Interrupted> {
    let drawn = if mesh.faces.len() <= max_triangles { identity(mesh) } else { cluster::decimate(mesh, max_triangles, poll)? };
    let source_faces = trace(mesh, &drawn.face_of_triangle, drawn.faces.len(), poll)?;
    Ok(Preview { positions_mm: drawn.positions_mm, faces: drawn.faces, face_of_triangle: drawn.face_of_triangle, source_faces })
}

/// A simplified mesh, before its faces are traced back to the file.
struct Simplified {
    positions_mm: Vec<[f32; 3]>,
    faces: Vec<[u32; 3]>,
    face_of_triangle: Vec<u32>,
}

fn identity(mesh: &Mesh) -> Simplified {
    Simplified {
        positions_mm: mesh.vertices_mm.iter().map(|p| p.coords.map(|c| c as f32).into()).collect(),
        faces: mesh.faces.clone(),
        face_of_triangle: (0..).take(mesh.faces.len()).collect(),
    }
}

/// Faces of the uploaded file behind each preview face.
fn trace(mesh: &Mesh, face_of_triangle: &[u32], faces: usize, poll: &Poll<'_>) -> Result<FaceLists, Interrupted> {
    poll.spend(5 * face_of_triangle.len())?;
    let drawn = face_of_triangle.iter().zip(&mesh.source_face).filter(|(face, _)| **face != NOT_DRAWN);
    let mut pairs: Vec<(u32, u32)> = drawn.map(|(face, source)| (*face, *source)).collect();
    sort_by_key(&mut pairs, |(face, source)| u128::from(*face) << 32 | u128::from(*source), poll)?;
    pairs.dedup();
    poll.spend(5 * pairs.len())?;
    Ok(FaceLists::group(&pairs, faces))
}
