//! The edges of a triangle mesh and how many triangles share each.

use crate::geometry::poll::{Interrupted, Poll};
use crate::geometry::sort::sort_by_key;

/// Edges sorted by their vertices, each once a triangle, and what they tell. 36 bytes a triangle.
pub(super) struct Edges {
    sides: Vec<Side>,
    /// Numbers of unsound edges, by kind.
    pub(super) counts: EdgeCounts,
}

/// Counts the edges of each kind that is not sound.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct EdgeCounts {
    /// Edges of one triangle.
    pub(super) boundary: usize,
    /// Edges of more than two.
    pub(super) non_manifold: usize,
    /// Edges whose two triangles run along them in the same direction.
    pub(super) inconsistent: usize,
}

/// One side of one triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side {
    /// Both vertices, the lower one first.
    vertices: [u32; 2],
    /// Triangle, and in the lowest bit 1 if it runs from the lower vertex to the higher.
    face_and_way: u32,
}

impl Side {
    /// Most triangles that can be told apart.
    const MAX_FACES: usize = 1 << 31;

    fn new(from: u32, to: u32, face: u32) -> Self {
        Self { vertices: [from.min(to), from.max(to)], face_and_way: face << 1 | u32::from(from < to) }
    }

    pub(super) fn face(self) -> usize {
        (self.face_and_way >> 1) as usize
    }

    /// Both vertices, the lower one first.
    pub(super) fn vertices(self) -> [u32; 2] {
        self.vertices
    }

    pub(super) fn is_ascending(self) -> bool {
        self.face_and_way & 1 == 1
    }

    /// Orders by edge, then by triangle.
    fn key(&self) -> u128 {
        self.vertices.iter().chain([&self.face_and_way]).fold(0, |key, part| key << 32 | u128::from(*part))
    }
}

impl Edges {
    /// Edges of `faces`, which have three different vertices each.
    pub(super) fn of(faces: &[[u32; 3]], poll: &Poll<'_>) -> Result<Self, Interrupted> {
        assert!(faces.len() < Side::MAX_FACES, "a mesh has fewer than 2³¹ triangles");
        let mut sides = Vec::with_capacity(3 * faces.len());
        for (&[a, b, c], face) in faces.iter().zip(0..) {
            poll.spend(5)?;
            sides.extend([Side::new(a, b, face), Side::new(b, c, face), Side::new(c, a, face)]);
        }
        sort_by_key(&mut sides, Side::key, poll)?;
        let mut edges = Self { sides, counts: EdgeCounts::default() };
        let mut counts = EdgeCounts::default();
        for sides in edges.shared() {
            poll.spend(5 * sides.len())?;
            match sides {
                [_] => counts.boundary += 1,
                [a, b] => counts.inconsistent += usize::from(a.is_ascending() == b.is_ascending()),
                _ => counts.non_manifold += 1,
            }
        }
        edges.counts = counts;
        Ok(edges)
    }

    /// Sides that lie on each edge, ordered by triangle.
    pub(super) fn shared(&self) -> impl Iterator<Item = &[Side]> {
        self.sides.chunk_by(|a, b| a.vertices == b.vertices)
    }
}
