//! Connected bodies, and which closed ones are inside out.
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
use crate::geometry::{Aabb, Mesh};

/// Triangles looked at to tell who lies in whom; about a second. Beyond it bodies are left as they are.
const NESTING_BUDGET: usize = 20_000_000;
/// Vertices tried where the winding number is undecided because bodies touch.
const VERTICES_TRIED: usize = 8;

/// Body of each triangle, and facts of each body.
pub(super) struct Bodies {
    of_face: Vec<u32>,
    /// Faces, ordered by body, and where each body begins in them.
    faces: Vec<u32>,
    begin: Vec<usize>,
    closed: Vec<bool>,
}

/// Result of turning bodies that were inside out.
pub(super) struct Turned {
    /// Bodies turned.
    pub(super) bodies: usize,
    /// Negative bodies left alone for want of budget.
    pub(super) unresolved: usize,
    /// Volume enclosed, where every body is closed.
    pub(super) volume_mm3: Option<f64>,
}

impl Bodies {
    pub(super) fn of(mesh: &Mesh, edges: &Edges) -> Self {
        let of_face = connect(mesh.faces.len(), edges);
        let count = of_face.iter().max().map_or(0, |&last| last as usize + 1);
        let closed = closed_bodies(count, &of_face, edges);
        let mut begin = vec![0; count + 1];
        of_face.iter().for_each(|&body| begin[body as usize + 1] += 1);
        (0..count).for_each(|body| begin[body + 1] += begin[body]);
        let (mut next, mut faces) = (begin.clone(), vec![0; of_face.len()]);
        for (&body, face) in of_face.iter().zip(0..) {
            faces[next[body as usize]] = face;
            next[body as usize] += 1;
        }
        Self { of_face, faces, begin, closed }
    }

    pub(super) fn count(&self) -> usize {
        self.closed.len()
    }

    pub(super) fn of_face(&self, face: usize) -> usize {
        self.of_face[face] as usize
    }

    /// Turns what is inside out (see the head of this module).
    pub(super) fn turn_inverted(&self, mesh: &mut Mesh) -> Turned {
        let origin = mesh.aabb().centre();
        let mut solids: Vec<Solid> = (0..self.count())
            .filter(|&body| self.closed[body])
            .map(|body| Solid::new(body, mesh, self.faces(body), &origin))
            .collect();
        let unresolved = Nesting { mesh, bodies: self, budget: NESTING_BUDGET }.mark_inverted(&mut solids);
        for solid in solids.iter().filter(|solid| solid.inverted) {
            self.faces(solid.body).iter().for_each(|&face| mesh.faces[face as usize].swap(1, 2));
        }
        let volume = || solids.iter().map(|solid| if solid.inverted { -solid.volume_mm3 } else { solid.volume_mm3 }).sum();
        Turned {
            bodies: solids.iter().filter(|solid| solid.inverted).count(),
            unresolved,
            volume_mm3: (solids.len() == self.count()).then(volume),
        }
    }

    /// Marks the faces of closed bodies with a positive volume.
    pub(super) fn outward_faces(&self, mesh: &Mesh) -> Vec<bool> {
        let origin = mesh.aabb().centre();
        let mut outward = vec![false; mesh.faces.len()];
        for body in (0..self.count()).filter(|&body| self.closed[body]) {
            if Solid::new(body, mesh, self.faces(body), &origin).volume_mm3 > 0.0 {
                self.faces(body).iter().for_each(|&face| outward[face as usize] = true);
            }
        }
        outward
    }

    fn faces(&self, body: usize) -> &[u32] {
        &self.faces[self.begin[body]..self.begin[body + 1]]
    }
}

/// Body number of each face, numbered by first face. Only edges of exactly two faces connect.
fn connect(faces: usize, edges: &Edges) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..faces as u32).collect();
    for sides in edges.shared() {
        if let [a, b] = sides {
            let (a, b) = (root(&mut parent, a.face()), root(&mut parent, b.face()));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut count = 0;
    let mut number = vec![0; faces];
    for face in 0..faces {
        // The root is the lowest face of its body, so it has its number already.
        let lowest = root(&mut parent, face) as usize;
        if lowest == face {
            number[face] = count;
            count += 1;
        }
        number[face] = number[lowest];
    }
    number
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
fn closed_bodies(count: usize, of_face: &[u32], edges: &Edges) -> Vec<bool> {
    let mut closed = vec![true; count];
    let body = |side: &Side| of_face[side.face()];
    for sides in edges.shared() {
        if let [a, b] = sides {
            closed[body(a) as usize] &= a.ascending != b.ascending;
            continue;
        }
        let mut sides = sides.to_vec();
        sides.sort_unstable_by_key(|side| (body(side), side.ascending));
        for own in sides.chunk_by(|a, b| body(a) == body(b)) {
            let pair = own.len() == 2 && own[0].ascending != own[1].ascending;
            closed[body(&own[0]) as usize] &= pair;
        }
    }
    closed
}

/// A closed body.
struct Solid {
    body: usize,
    aabb: Aabb,
    volume_mm3: f64,
    inverted: bool,
}

impl Solid {
    fn new(body: usize, mesh: &Mesh, faces: &[u32], origin: &Point3<f64>) -> Self {
        let (mut aabb, mut sixfold_mm3) = (Aabb::empty(), 0.0);
        for &face in faces {
            let corners = mesh.corners(face as usize);
            aabb = corners.iter().fold(aabb, |aabb, corner| aabb.with(corner));
            let [a, b, c] = corners.map(|corner| corner - origin);
            sixfold_mm3 += a.dot(&b.cross(&c));
        }
        // What rounding leaves of a sheet that is folded onto itself is no volume.
        let rounding_mm3 = 1e-12 * aabb.extent_mm().norm().powi(3);
        let volume_mm3 = if sixfold_mm3.abs() > rounding_mm3 { sixfold_mm3 / 6.0 } else { 0.0 };
        Self { body, aabb, volume_mm3, inverted: false }
    }
}

/// Nesting of bodies, as far as the budget goes.
struct Nesting<'a> {
    mesh: &'a Mesh,
    bodies: &'a Bodies,
    budget: usize,
}

impl Nesting<'_> {
    /// Marks the solids to turn; returns how many negative ones it could not decide.
    fn mark_inverted(&mut self, solids: &mut [Solid]) -> usize {
        let negative: Vec<usize> = (0..solids.len()).filter(|&i| solids[i].volume_mm3 < 0.0).collect();
        let mut unresolved = 0;
        for &i in &negative {
            match self.around(i, solids) {
                Some(around) => solids[i].inverted = around.len().is_multiple_of(2),
                None => unresolved += 1,
            }
        }
        let turned: Vec<usize> = negative.into_iter().filter(|&i| solids[i].inverted).collect();
        if turned.is_empty() {
            return unresolved;
        }
        for i in 0..solids.len() {
            if solids[i].volume_mm3 > 0.0 {
                // Without budget for all of them, positive bodies stay as the file has them.
                let Some(around) = self.around(i, solids) else { break };
                let next = around.iter().min_by(|&&a, &&b| solids[a].volume_mm3.abs().total_cmp(&solids[b].volume_mm3.abs()));
                let in_turned = next.is_some_and(|next| turned.binary_search(next).is_ok());
                solids[i].inverted = in_turned && !around.len().is_multiple_of(2);
            }
        }
        unresolved
    }

    /// The solids that solid `i` lies in.
    fn around(&mut self, i: usize, solids: &[Solid]) -> Option<Vec<usize>> {
        self.budget = self.budget.checked_sub(solids.len())?;
        let mut around = Vec::new();
        for (j, other) in solids.iter().enumerate() {
            if j != i && encloses(&other.aabb, &solids[i].aabb) && self.is_inside(solids[i].body, other.body)? {
                around.push(j);
            }
        }
        Some(around)
    }

    /// Returns true if body `inner` lies in body `outer`, by the first of its vertices that tells.
    fn is_inside(&mut self, inner: usize, outer: usize) -> Option<bool> {
        for &face in self.bodies.faces(inner).iter().take(VERTICES_TRIED) {
            let outer_faces = self.bodies.faces(outer);
            self.budget = self.budget.checked_sub(outer_faces.len())?;
            let turns = winding_number(self.mesh, outer_faces, &self.mesh.corners(face as usize)[0]).abs();
            if (turns - turns.round()).abs() < 0.1 {
                return Some(turns > 0.5);
            }
        }
        Some(false)
    }
}

fn encloses(outer: &Aabb, inner: &Aabb) -> bool {
    (0..3).all(|axis| outer.min[axis] <= inner.min[axis] && inner.max[axis] <= outer.max[axis]) && outer != inner
}

/// Winding number of the surface of `faces` about `point`: 0 outside, ±1 inside.
fn winding_number(mesh: &Mesh, faces: &[u32], point: &Point3<f64>) -> f64 {
    let half_angles = faces.iter().map(|&face| half_solid_angle(mesh.corners(face as usize).map(|corner| corner - point)));
    half_angles.sum::<f64>() / TAU
}

fn half_solid_angle([a, b, c]: [Vector3<f64>; 3]) -> f64 {
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let volume = a.dot(&b.cross(&c));
    volume.atan2(la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb)
}
