//! The edges of a triangle mesh and how many triangles share each.

use crate::geometry::Mesh;
use crate::geometry::poll::{Interrupted, Poll};
use crate::geometry::side_by_side;
use crate::geometry::sorted_lists::SortedLists;

/// Edges ordered by their vertices, each once a triangle, and what they tell. 24 bytes a triangle and 4 a vertex.
pub(super) struct Edges {
    /// Sides of triangles by the lower of their vertices.
    sides: SortedLists,
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
    /// Edges along which more triangles run in one direction than in the other.
    pub(super) unbalanced: usize,
}

impl EdgeCounts {
    /// Returns true if every edge belongs to two triangles that run along it in opposite directions.
    pub(super) fn are_sound(&self) -> bool {
        self.boundary + self.non_manifold + self.inconsistent == 0
    }

    fn with(self, edge: &Edge<'_>) -> Self {
        let Self { boundary, non_manifold, inconsistent, unbalanced } = self;
        let ascending = edge.sides().filter(|side| side.is_ascending()).count();
        let is_unbalanced = 2 * ascending != edge.sides.len();
        let counted = Self { unbalanced: unbalanced + usize::from(is_unbalanced), ..self };
        match edge.sides {
            [_] => Self { boundary: boundary + 1, ..counted },
            [_, _] => Self { inconsistent: inconsistent + usize::from(is_unbalanced), ..counted },
            _ => Self { non_manifold: non_manifold + 1, ..counted },
        }
    }

    fn plus(self, other: Self) -> Self {
        Self {
            boundary: self.boundary + other.boundary,
            non_manifold: self.non_manifold + other.non_manifold,
            inconsistent: self.inconsistent + other.inconsistent,
            unbalanced: self.unbalanced + other.unbalanced,
        }
    }
}

/// One side of one triangle: from the top 32 bits of the higher vertex, then the triangle, and in the lowest bit 1 if it runs from
/// the lower vertex to the higher.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side(u64);

impl Side {
    /// Most triangles whose sides can be told apart and counted.
    const MAX_FACES: usize = 1 << 30;

    /// The lower vertex, and the side.
    fn entry(from: u32, to: u32, face: usize) -> (u32, u64) {
        (from.min(to), u64::from(from.max(to)) << 32 | (face as u64) << 1 | u64::from(from < to))
    }

    pub(super) fn face(self) -> usize {
        (self.0 as u32 >> 1) as usize
    }

    pub(super) fn is_ascending(self) -> bool {
        self.0 & 1 == 1
    }
}

/// An edge with the sides of triangles that lie on it, ordered by triangle.
pub(super) struct Edge<'a> {
    low: u32,
    sides: &'a [u64],
}

impl Edge<'_> {
    /// Both vertices, the lower one first.
    pub(super) fn vertices(&self) -> [u32; 2] {
        [self.low, (self.sides[0] >> 32) as u32]
    }

    pub(super) fn sides(&self) -> impl Iterator<Item = Side> {
        self.sides.iter().map(|side| Side(*side))
    }

    /// The sides, if there are exactly two.
    pub(super) fn pair(&self) -> Option<[Side; 2]> {
        if let [a, b] = self.sides { Some([Side(*a), Side(*b)]) } else { None }
    }
}

impl Edges {
    /// Edges of the faces of a mesh, which have three different vertices each.
    pub(super) fn of(mesh: &Mesh, poll: &Poll<'_>) -> Result<Self, Interrupted> {
        assert!(mesh.faces.len() < Side::MAX_FACES, "a mesh has fewer than 2³⁰ triangles");
        let entries = |face: usize| {
            let [a, b, c] = mesh.faces[face];
            [Side::entry(a, b, face), Side::entry(b, c, face), Side::entry(c, a, face)]
        };
        let sides = SortedLists::new(mesh.faces.len(), mesh.vertices_mm.len(), entries, poll)?;
        let counts_of = |keys: &std::ops::Range<usize>| {
            edges(sides.of(keys.clone())).fold(EdgeCounts::default(), |counts, edge| counts.with(&edge))
        };
        let counts = side_by_side::map(&sides.pieces(), counts_of, poll)?;
        let counts = counts.into_iter().fold(EdgeCounts::default(), EdgeCounts::plus);
        Ok(Self { sides, counts })
    }

    /// Every edge, by its lower vertex, then by its higher.
    pub(super) fn iter(&self) -> impl Iterator<Item = Edge<'_>> {
        edges(self.sides.iter())
    }
}

/// Edges of lists of sides by vertex.
fn edges<'a>(lists: impl Iterator<Item = (u32, &'a [u64])>) -> impl Iterator<Item = Edge<'a>> {
    lists.flat_map(|(low, sides)| sides.chunk_by(|a, b| a >> 32 == b >> 32).map(move |sides| Edge { low, sides }))
}
