//! The edges of a triangle mesh and how many triangles share each.

/// Edges sorted by their vertices, each once a triangle, and what they tell.
pub(super) struct Edges {
    sides: Vec<Side>,
    /// Edges of one triangle.
    pub(super) boundary: usize,
    /// Edges of more than two.
    pub(super) non_manifold: usize,
    /// Edges whose two triangles run along them in the same direction.
    pub(super) inconsistent: usize,
}

/// One side of one triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Side {
    /// Vertices of the edge, the lower one in the high half.
    edge: u64,
    face: u32,
    /// Is true if the triangle runs from the lower vertex to the higher.
    pub(super) ascending: bool,
}

impl Side {
    fn new(from: u32, to: u32, face: u32) -> Self {
        let (low, high) = (from.min(to), from.max(to));
        Self { edge: u64::from(low) << 32 | u64::from(high), face, ascending: from < to }
    }

    pub(super) fn face(self) -> usize {
        self.face as usize
    }
}

impl Edges {
    /// Edges of `faces`, which have three different vertices each.
    pub(super) fn of(faces: &[[u32; 3]]) -> Self {
        let mut sides = Vec::with_capacity(3 * faces.len());
        for (&[a, b, c], face) in faces.iter().zip(0..) {
            sides.extend([Side::new(a, b, face), Side::new(b, c, face), Side::new(c, a, face)]);
        }
        sides.sort_unstable();
        let mut edges = Self { sides, boundary: 0, non_manifold: 0, inconsistent: 0 };
        let (mut boundary, mut non_manifold, mut inconsistent) = (0, 0, 0);
        for sides in edges.shared() {
            match sides {
                [_] => boundary += 1,
                [a, b] => inconsistent += usize::from(a.ascending == b.ascending),
                _ => non_manifold += 1,
            }
        }
        (edges.boundary, edges.non_manifold, edges.inconsistent) = (boundary, non_manifold, inconsistent);
        edges
    }

    /// Sides that lie on each edge, ordered by triangle.
    pub(super) fn shared(&self) -> impl Iterator<Item = &[Side]> {
        self.sides.chunk_by(|a, b| a.edge == b.edge)
    }
}
