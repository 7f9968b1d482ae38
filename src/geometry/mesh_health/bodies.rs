//! Connected bodies, and which closed ones are inside out.
//!
//! Pieces are connected by edges of exactly two triangles. Where shells touch along a loop of edges that four or more triangles share,
//! the loop cuts them into open pieces; these are joined by the wedges of material around such edges (`wedges`), if that leaves no edge
//! open.
//!
//! A closed body has a signed volume. One that lies in no other body, or in an even number of them, is solid and must be
//! positive; one in an odd number is the wall of a cavity, whose normals rightly point into it, so negative. A negative
//! body at even depth is therefore turned. A positive one at odd depth may be a part inside another part and is left
//! alone, unless the body around it was turned: then the file as a whole was inside out.
//! Depth counts the bodies whose winding number about a vertex is not zero (van Oosterom & Strackee, "The solid angle of
//! a plane triangle", IEEE Trans. Biomed. Eng. 30, 1983).

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};

use super::edges::{Edges, Side};
use super::wedges::wedges;
use crate::geometry::poll::{Interrupted, Poll};
use crate::geometry::side_by_side::{self, PIECE};
use crate::geometry::{Aabb, Mesh};

/// Triangles looked at to tell who lies in whom; about a second. Beyond it bodies are left as they are.
const NESTING_BUDGET: usize = 20_000_000;
/// Stands for the place of a body among the closed ones that is none of them.
const NOT_CLOSED: u32 = u32::MAX;
/// Vertices tried where the winding number is undecided because bodies touch.
const VERTICES_TRIED: usize = 8;
/// Volume of a tetrahedron, as a share of the product of the three edges at its tip, that rounding leaves of none.
const FLAT_SHARE: f64 = 1e-12;

/// Body of each triangle, and facts of each body.
pub(super) struct Bodies {
    of_face: Vec<u32>,
    closed: Vec<bool>,
    /// Piece of each face, and the number of pieces, where pieces were looked at to be joined at edges of more than two triangles.
    pieces: Option<(Vec<u32>, usize)>,
    /// True if open pieces were joined to closed bodies at edges of more than two triangles.
    are_joined: bool,
    /// Bodies that are closed, ascending.
    solid: Vec<u32>,
    /// Faces of those, ordered by body, and where each of them begins.
    faces: Vec<u32>,
    begin: Vec<u32>,
}

/// Result of turning bodies that were inside out.
pub(super) struct Turned {
    /// Bodies turned.
    pub(super) bodies: usize,
    /// Negative bodies left alone for want of budget.
    pub(super) unresolved: usize,
    /// Sum of the volumes of the closed bodies.
    pub(super) closed_mm3: f64,
    /// Bodies that are not closed.
    pub(super) not_closed: usize,
    /// True if bodies were turned where open pieces were joined to closed bodies.
    pub(super) among_joined: bool,
}

impl Bodies {
    pub(super) fn of(mesh: &Mesh, edges: &Edges, poll: &Poll<'_>) -> Result<Self, Interrupted> {
        let (of_face, count) = connect(mesh.faces.len(), edges, poll)?;
        let closed = closed_bodies(count, &of_face, edges, poll)?;
        let mut bodies =
            Self { of_face, closed, pieces: None, are_joined: false, solid: Vec::new(), faces: Vec::new(), begin: Vec::new() };
        if edges.counts.non_manifold > 0 && bodies.closed.contains(&false) {
            bodies.join_pieces(mesh, edges, poll)?;
        }
        bodies.list_solids(poll)?;
        Ok(bodies)
    }

    /// Joins open pieces that bound the same wedges of material, where all edges of what they make up are bounded so.
    fn join_pieces(&mut self, mesh: &Mesh, edges: &Edges, poll: &Poll<'_>) -> Result<(), Interrupted> {
        let count = self.closed.len();
        let mut parent: Vec<u32> = (0..count as u32).collect();
        let mut has_open_edge = vec![false; count];
        let mut open_sides: Vec<Side> = Vec::new();
        for edge in edges.iter() {
            poll.spend(10)?;
            if edge.pair().is_some_and(|[a, b]| a.is_ascending() != b.is_ascending()) {
                continue;
            }
            open_sides.clear();
            open_sides.extend(edge.sides().filter(|side| !self.closed[self.of_face(side.face())]));
            poll.spend(200 * open_sides.len())?;
            match wedges(mesh, edge.vertices(), &open_sides) {
                Some(pairs) => {
                    for pair in pairs {
                        let [a, b] = pair.map(|face| root(&mut parent, self.of_face(face)));
                        parent[a.max(b) as usize] = a.min(b);
                    }
                }
                None => open_sides.iter().for_each(|side| has_open_edge[self.of_face(side.face())] = true),
            }
        }
        for piece in 0..count {
            poll.spend(10)?;
            let first = root(&mut parent, piece) as usize;
            has_open_edge[first] |= has_open_edge[piece];
        }
        self.number_joined(&mut parent, &has_open_edge, poll)
    }

    /// Makes one closed body of the pieces of each root that has no open edge.
    fn number_joined(&mut self, parent: &mut [u32], has_open_edge: &[bool], poll: &Poll<'_>) -> Result<(), Interrupted> {
        let (mut number, mut closed) = (vec![0; parent.len()], Vec::new());
        for piece in 0..parent.len() {
            poll.spend(10)?;
            let first = root(parent, piece) as usize;
            let is_closed = !has_open_edge[first];
            self.are_joined |= is_closed && !self.closed[piece];
            if is_closed && first != piece {
                // A root is the lowest piece of its own and has a number by now.
                number[piece] = number[first];
            } else {
                number[piece] = closed.len() as u32;
                closed.push(is_closed);
            }
        }
        self.pieces = Some((self.of_face.clone(), self.closed.len()));
        for body in &mut self.of_face {
            poll.spend(2)?;
            *body = number[*body as usize];
        }
        self.closed = closed;
        Ok(())
    }

    /// Brings the faces of each closed body together; of the others nobody asks for them.
    fn list_solids(&mut self, poll: &Poll<'_>) -> Result<(), Interrupted> {
        poll.spend(10 * self.closed.len())?;
        self.solid = (0..).zip(&self.closed).filter(|(_, closed)| **closed).map(|(body, _)| body).collect();
        let mut place = vec![NOT_CLOSED; self.closed.len()];
        self.solid.iter().zip(0..).for_each(|(body, index)| place[*body as usize] = index);
        let place_of = |body: &u32| Some(place[*body as usize]).filter(|place| *place != NOT_CLOSED).map(|place| place as usize);
        let mut begin = vec![0; self.solid.len() + 1];
        for body in &self.of_face {
            poll.spend(2)?;
            place_of(body).into_iter().for_each(|index| begin[index + 1] += 1);
        }
        (0..self.solid.len()).for_each(|index| begin[index + 1] += begin[index]);
        self.faces = vec![0; begin[self.solid.len()] as usize];
        let mut next = begin.clone();
        for (body, face) in self.of_face.iter().zip(0..) {
            poll.spend(2)?;
            if let Some(index) = place_of(body) {
                self.faces[next[index] as usize] = face;
                next[index] += 1;
            }
        }
        self.begin = begin;
        Ok(())
    }

    pub(super) fn count(&self) -> usize {
        self.closed.len()
    }

    /// Number of bodies that are closed.
    pub(super) fn closed(&self) -> usize {
        self.solid.len()
    }

    pub(super) fn of_face(&self, face: usize) -> usize {
        self.of_face[face] as usize
    }

    /// Number of pieces that are connected by edges of exactly two triangles.
    pub(super) fn pieces(&self) -> usize {
        self.pieces.as_ref().map_or(self.count(), |(_, count)| *count)
    }

    pub(super) fn piece_of_face(&self, face: usize) -> usize {
        self.pieces.as_ref().map_or(self.of_face(face), |(of_face, _)| of_face[face] as usize)
    }

    /// Turns what is inside out (see the head of this module).
    pub(super) fn turn_inverted(&self, mesh: &mut Mesh, poll: &Poll<'_>) -> Result<Turned, Interrupted> {
        let mut solids = self.solids(mesh, poll)?;
        let unresolved = Nesting { mesh, bodies: self, budget: NESTING_BUDGET, poll }.mark_inverted(&mut solids)?;
        for solid in solids.iter().filter(|solid| solid.inverted) {
            for face in self.faces(solid.index) {
                poll.spend(2)?;
                mesh.faces[*face as usize].swap(1, 2);
            }
        }
        let volumes = solids.iter().map(|solid| if solid.inverted { -solid.volume_mm3 } else { solid.volume_mm3 });
        let bodies = solids.iter().filter(|solid| solid.inverted).count();
        Ok(Turned {
            bodies,
            unresolved,
            closed_mm3: volumes.sum(),
            not_closed: self.count() - solids.len(),
            among_joined: bodies > 0 && self.are_joined,
        })
    }

    /// Marks the faces of closed bodies with a positive volume.
    pub(super) fn outward_faces(&self, mesh: &Mesh, poll: &Poll<'_>) -> Result<Vec<bool>, Interrupted> {
        let mut outward = vec![false; mesh.faces.len()];
        for solid in self.solids(mesh, poll)?.iter().filter(|solid| solid.volume_mm3 > 0.0) {
            for face in self.faces(solid.index) {
                poll.spend(2)?;
                outward[*face as usize] = true;
            }
        }
        Ok(outward)
    }

    /// Every closed body.
    pub(super) fn solids(&self, mesh: &Mesh, poll: &Poll<'_>) -> Result<Vec<ClosedBody>, Interrupted> {
        let origin = mesh.aabb_of_vertices(poll)?.centre();
        (0..self.solid.len()).map(|index| ClosedBody::new(index, mesh, self.faces(index), &origin, poll)).collect()
    }

    /// Faces of a closed body.
    pub(super) fn faces(&self, solid: usize) -> &[u32] {
        &self.faces[self.begin[solid] as usize..self.begin[solid + 1] as usize]
    }
}

/// Body number of each face, numbered by first face, and how many there are. Only edges of exactly two faces connect.
fn connect(faces: usize, edges: &Edges, poll: &Poll<'_>) -> Result<(Vec<u32>, usize), Interrupted> {
    let mut parent: Vec<u32> = (0..faces as u32).collect();
    for edge in edges.iter() {
        poll.spend(10)?;
        if let Some([a, b]) = edge.pair() {
            let (a, b) = (root(&mut parent, a.face()), root(&mut parent, b.face()));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    for face in 0..faces {
        poll.spend(5)?;
        parent[face] = root(&mut parent, face);
    }
    // A root is the lowest face of its body and still its own parent when its turn comes; those below it have numbers by then.
    let mut count = 0;
    for face in 0..faces {
        poll.spend(2)?;
        if parent[face] as usize == face {
            parent[face] = count;
            count += 1;
        } else {
            parent[face] = parent[parent[face] as usize];
        }
    }
    Ok((parent, count as usize))
}

fn root(parent: &mut [u32], face: usize) -> u32 {
    let mut face = face as u32;
    while parent[face as usize] != face {
        let grandparent = parent[parent[face as usize] as usize];
        parent[face as usize] = grandparent;
        face = grandparent;
    }
    face
}

/// A body is closed when on each of its edges one of its triangles runs up and one runs down.
fn closed_bodies(count: usize, of_face: &[u32], edges: &Edges, poll: &Poll<'_>) -> Result<Vec<bool>, Interrupted> {
    let mut closed = vec![true; count];
    if edges.counts.are_sound() {
        return Ok(closed);
    }
    // How many sides of each body run up and down the edge that is looked at, up to two.
    let mut ways = vec![[0_u8; 2]; count];
    let body = |side: Side| of_face[side.face()] as usize;
    for edge in edges.iter() {
        poll.spend(10)?;
        if let Some([a, b]) = edge.pair() {
            // Joined by this edge, they are of one body.
            closed[body(a)] &= a.is_ascending() != b.is_ascending();
            continue;
        }
        for side in edge.sides() {
            poll.spend(10)?;
            let way = &mut ways[body(side)][usize::from(side.is_ascending())];
            *way = (*way + 1).min(2);
        }
        for side in edge.sides() {
            closed[body(side)] &= ways[body(side)] == [1, 1];
        }
        edge.sides().for_each(|side| ways[body(side)] = [0, 0]);
    }
    Ok(closed)
}

/// A closed body.
pub(super) struct ClosedBody {
    /// Number of the body among the closed bodies.
    pub(super) index: usize,
    pub(super) aabb: Aabb,
    pub(super) volume_mm3: f64,
    inverted: bool,
}

impl ClosedBody {
    fn new(index: usize, mesh: &Mesh, faces: &[u32], origin: &Point3<f64>, poll: &Poll<'_>) -> Result<Self, Interrupted> {
        let extent = |faces: &&[u32]| {
            faces.iter().fold((Aabb::empty(), 0.0), |(aabb, sixfold_mm3), face| {
                let corners = mesh.corners(*face as usize);
                let [a, b, c] = corners.map(|corner| corner - origin);
                (corners.iter().fold(aabb, |aabb, corner| aabb.with(corner)), sixfold_mm3 + a.dot(&b.cross(&c)))
            })
        };
        poll.spend(10 * faces.len().min(PIECE))?;
        // Most of many bodies are small.
        let pieces = match faces.len() {
            0..=PIECE => vec![extent(&faces)],
            _ => side_by_side::map(&faces.chunks(PIECE).collect::<Vec<_>>(), extent, poll)?,
        };
        let (aabb, sixfold_mm3) = pieces.into_iter().fold((Aabb::empty(), 0.0), |(aabb, sum), (of_piece, sixfold_mm3)| {
            (aabb.with(&of_piece.min).with(&of_piece.max), sum + sixfold_mm3)
        });
        // What rounding leaves of a sheet that is folded onto itself is no volume.
        let rounding_mm3 = 1e-12 * aabb.extent_mm().norm().powi(3);
        let volume_mm3 = if sixfold_mm3.abs() > rounding_mm3 { sixfold_mm3 / 6.0 } else { 0.0 };
        Ok(Self { index, aabb, volume_mm3, inverted: false })
    }
}

/// Nesting of bodies, as far as the budget goes.
struct Nesting<'a> {
    mesh: &'a Mesh,
    bodies: &'a Bodies,
    budget: usize,
    poll: &'a Poll<'a>,
}

impl Nesting<'_> {
    /// Marks the solids to turn; returns how many negative ones it could not decide.
    fn mark_inverted(&mut self, solids: &mut [ClosedBody]) -> Result<usize, Interrupted> {
        let negative: Vec<usize> = (0..solids.len()).filter(|&i| solids[i].volume_mm3 < 0.0).collect();
        let mut unresolved = 0;
        for &i in &negative {
            match self.around(i, solids)? {
                Some(around) => solids[i].inverted = around.len().is_multiple_of(2),
                None => unresolved += 1,
            }
        }
        let turned: Vec<usize> = negative.into_iter().filter(|&i| solids[i].inverted).collect();
        if turned.is_empty() {
            return Ok(unresolved);
        }
        for i in 0..solids.len() {
            if solids[i].volume_mm3 > 0.0 {
                // Without budget for all of them, positive bodies stay as the file has them.
                let Some(around) = self.around(i, solids)? else { break };
                let next = around.iter().min_by(|&&a, &&b| solids[a].volume_mm3.abs().total_cmp(&solids[b].volume_mm3.abs()));
                let in_turned = next.is_some_and(|next| turned.binary_search(next).is_ok());
                solids[i].inverted = in_turned && !around.len().is_multiple_of(2);
            }
        }
        Ok(unresolved)
    }

    /// The solids that solid `i` lies in; `None` where the budget does not suffice to tell.
    fn around(&mut self, i: usize, solids: &[ClosedBody]) -> Result<Option<Vec<usize>>, Interrupted> {
        if !self.afford(solids.len()) {
            return Ok(None);
        }
        let mut around = Vec::new();
        for (j, other) in solids.iter().enumerate() {
            self.poll.spend(5)?;
            if j != i && encloses(&other.aabb, &solids[i].aabb) {
                match self.is_inside(i, j)? {
                    Some(true) => around.push(j),
                    Some(false) => {}
                    None => return Ok(None),
                }
            }
        }
        Ok(Some(around))
    }

    /// Returns true if body `inner` lies in body `outer`, by the first of its vertices that tells.
    fn is_inside(&mut self, inner: usize, outer: usize) -> Result<Option<bool>, Interrupted> {
        let outer_faces = self.bodies.faces(outer);
        for &face in self.bodies.faces(inner).iter().take(VERTICES_TRIED) {
            if !self.afford(outer_faces.len()) {
                return Ok(None);
            }
            let turns = winding_number(self.mesh, outer_faces, &self.mesh.corners(face as usize)[0], self.poll)?.abs();
            if (turns - turns.round()).abs() < 0.1 {
                return Ok(Some(turns > 0.5));
            }
        }
        Ok(Some(false))
    }

    /// Takes so many triangles from the budget, if it has them.
    fn afford(&mut self, triangles: usize) -> bool {
        let left = self.budget.checked_sub(triangles);
        self.budget = left.unwrap_or(self.budget);
        left.is_some()
    }
}

/// Returns true if a box holds another one that is not the same.
pub(super) fn encloses(outer: &Aabb, inner: &Aabb) -> bool {
    (0..3).all(|axis| outer.min[axis] <= inner.min[axis] && inner.max[axis] <= outer.max[axis]) && outer != inner
}

/// Winding number of the surface of `faces` about `point`: 0 outside, ±1 inside.
pub(super) fn winding_number(mesh: &Mesh, faces: &[u32], point: &Point3<f64>, poll: &Poll<'_>) -> Result<f64, Interrupted> {
    let mut half_angles = 0.0;
    for &face in faces {
        poll.spend(60)?;
        half_angles += half_solid_angle(mesh.corners(face as usize).map(|corner| corner - point));
    }
    Ok(half_angles / TAU)
}

/// Half the solid angle of a triangle; 0 where the point lies in its plane. On the triangle it would be ±π by mere rounding, and the
/// winding number a whole one; so it is ±½ there, which tells nothing.
fn half_solid_angle([a, b, c]: [Vector3<f64>; 3]) -> f64 {
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let volume = a.dot(&b.cross(&c));
    if volume.abs() <= FLAT_SHARE * la * lb * lc {
        return 0.0;
    }
    volume.atan2(la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb)
}
