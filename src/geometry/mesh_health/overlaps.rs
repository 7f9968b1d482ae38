//! Closed bodies that run into each other. The surface of one inside another is in no view, and still belongs to the area that is asked for.
//!
//! Two solid bodies overlap where an edge of one goes through a triangle of the other and a point of that edge just behind the triangle lies
//! inside: the winding number of the other body about it is ±1, and no triangle of it is nearer than rounding lets seem so. Bodies that
//! merely touch have no such point. Found are most pairs rather than all: none that is too shallow, and those alone that the budget
//! suffices for.
//!
//! A solid body that overlaps no other may lie wholly within one: then so do all of its vertices, of which a few are tried. What lies in a
//! cavity is not in the material around it: the walls of cavities that it lies in count against the solid bodies that it lies in.

use nalgebra::Point3;
use parry3d::bounding_volume::Aabb as Box3;
use parry3d::math::Vector as Vec3;
use parry3d::partitioning::{Bvh, BvhBuildStrategy};

use super::bodies::{Bodies, ClosedBody, encloses, winding_number};
use crate::geometry::poll::{Interrupted, Poll};
use crate::geometry::side_by_side::PIECE;
use crate::geometry::{Aabb, Mesh, nearest_of_triangle, sort_ascending};

/// Work on all pairs, in units of [`Poll`]; about a third of a second.
const OVERLAP_BUDGET: usize = 300_000_000;
/// Work on all bodies that may lie within others, in units of [`Poll`]; about a second.
const NESTING_BUDGET: usize = 1_000_000_000;
/// Vertices of a body that must all lie within another one. Our choice.
const VERTICES_TRIED: usize = 4;
/// Share of a full turn of the winding number that rounding leaves of none.
const MIN_TURN: f64 = 0.01;
/// Triangles of which a tree is grown at most: a few ten milliseconds.
const MAX_TREE_FACES: usize = 100_000;
/// Points that are held against a body for one pair; where bodies touch, none of them may lie inside.
const MAX_POINTS: usize = 100;
/// Minimum depth, as a share of the part's diagonal and largest coordinate: some units in the last place of a 32-bit float. Our
/// choice.
const MIN_DEPTH: f64 = 1e-6;
/// Depth of the point behind the triangle, in minimum depths; on a short edge it is half that of the edge's end.
const POINT_DEPTH: f64 = 4.0;
/// Distance by which an edge may pass beside a triangle, as a share of its size, so that none slips through between two of them.
const ROUNDING: f64 = 1e-9;

/// Finds pairs of closed bodies that overlap, as far as the budget goes; ascending, each by the places of its two among the closed ones.
pub(super) fn overlapping_pairs(mesh: &Mesh, bodies: &Bodies, poll: &Poll<'_>) -> Result<Vec<[usize; 2]>, Interrupted> {
    if bodies.closed() < 2 {
        return Ok(Vec::new());
    }
    let mut solids = bodies.solids(mesh, poll)?;
    solids.retain(|solid| solid.volume_mm3 > 0.0);
    sort_ascending(&mut solids, |solid| solid.aabb.min.x);
    let mut search = Search::new(mesh, bodies, OVERLAP_BUDGET, poll)?;
    let mut pairs = Vec::new();
    match search.find(&solids, &mut pairs) {
        Ok(()) | Err(End::Budget) => {
            pairs.sort_unstable();
            Ok(pairs)
        }
        Err(End::Interrupted(interrupted)) => Err(interrupted),
    }
}

/// Counts closed bodies of positive volume that lie wholly in the material of others, as far as the budget goes. Those of `overlapping`
/// pairs, as [`overlapping_pairs`] finds them, do not lie in each other.
pub(super) fn nested_bodies(
    mesh: &Mesh,
    bodies: &Bodies,
    overlapping: &[[usize; 2]],
    poll: &Poll<'_>,
) -> Result<usize, Interrupted> {
    if bodies.closed() < 2 {
        return Ok(0);
    }
    let solids = bodies.solids(mesh, poll)?;
    let mut search = Search::new(mesh, bodies, NESTING_BUDGET, poll)?;
    let mut nested = 0;
    for inner in solids.iter().filter(|solid| solid.volume_mm3 > 0.0) {
        match search.is_nested(inner, &solids, overlapping) {
            Ok(is_nested) => nested += usize::from(is_nested),
            Err(End::Budget) => break,
            Err(End::Interrupted(interrupted)) => return Err(interrupted),
        }
    }
    Ok(nested)
}

/// Reason for which the search ends early.
enum End {
    Interrupted(Interrupted),
    Budget,
}

impl From<Interrupted> for End {
    fn from(interrupted: Interrupted) -> Self {
        Self::Interrupted(interrupted)
    }
}

struct Search<'a> {
    mesh: &'a Mesh,
    bodies: &'a Bodies,
    /// Boxes of trees are relative to this, so that single precision is finest where the part is.
    centre_mm: Point3<f64>,
    min_depth_mm: f64,
    budget: usize,
    poll: &'a Poll<'a>,
}

impl<'a> Search<'a> {
    fn new(mesh: &'a Mesh, bodies: &'a Bodies, budget: usize, poll: &'a Poll<'a>) -> Result<Self, Interrupted> {
        let around = mesh.aabb_of_vertices(poll)?;
        let largest_mm = around.min.coords.amax().max(around.max.coords.amax());
        let (centre_mm, min_depth_mm) = (around.centre(), MIN_DEPTH * (around.extent_mm().norm() + largest_mm));
        Ok(Self { mesh, bodies, centre_mm, min_depth_mm, budget, poll })
    }

    fn spend(&mut self, units: usize) -> Result<(), End> {
        self.poll.spend(units)?;
        self.budget = self.budget.checked_sub(units).ok_or(End::Budget)?;
        Ok(())
    }

    /// Finds the pairs of solids, which are ordered by their lower ends along x.
    fn find(&mut self, solids: &[ClosedBody], pairs: &mut Vec<[usize; 2]>) -> Result<(), End> {
        for (place, one) in solids.iter().enumerate() {
            for other in solids[place + 1..].iter().take_while(|other| other.aabb.min.x < one.aabb.max.x) {
                self.spend(10)?;
                if let Some(common) = common(&one.aabb, &other.aabb)
                    && self.overlap([one, other], &common)?
                {
                    pairs.push([one.index.min(other.index), one.index.max(other.index)]);
                }
            }
        }
        Ok(())
    }

    /// Returns true if two solids overlap in the box that theirs have in common.
    fn overlap(&mut self, pair: [&ClosedBody; 2], common: &Aabb) -> Result<bool, End> {
        let mut sides = Vec::with_capacity(2);
        for solid in pair {
            let faces = self.faces_in(solid.index, common)?;
            if faces.is_empty() {
                return Ok(false);
            }
            sides.push((solid.index, faces));
        }
        sides.sort_by_key(|(_, faces)| faces.len());
        let [(few_of, few), (many_of, many)] = &sides[..] else { return Ok(false) };
        if few.len() > MAX_TREE_FACES {
            return Ok(false);
        }
        self.spend(300 * few.len())?;
        let boxes: Vec<Box3> = few.iter().map(|face| self.box_of(*face)).collect();
        let tree = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        let mut points = 0;
        for face in many {
            self.spend(100)?;
            let around = self.box_of(*face);
            for place in tree.intersect_aabb(&around) {
                self.spend(100)?;
                for (point, body) in self.points_behind([(*few_of, few[place as usize]), (*many_of, *face)]) {
                    if self.is_inside(&point, body)? {
                        return Ok(true);
                    }
                    points += 1;
                    if points == MAX_POINTS {
                        return Ok(false);
                    }
                }
            }
        }
        Ok(false)
    }

    /// Triangles of a closed body that may reach into a box.
    fn faces_in(&mut self, body: usize, around: &Aabb) -> Result<Vec<u32>, End> {
        let (mesh, mut found) = (self.mesh, Vec::new());
        let reaches = |face: &u32| {
            let own = Aabb::around(&mesh.corners(*face as usize));
            (0..3).all(|axis| own.min[axis] <= around.max[axis] && around.min[axis] <= own.max[axis])
        };
        for faces in self.bodies.faces(body).chunks(PIECE) {
            self.spend(10 * faces.len())?;
            found.extend(faces.iter().copied().filter(reaches));
        }
        Ok(found)
    }

    fn box_of(&self, face: u32) -> Box3 {
        let offset = |corner: Point3<f64>| {
            let offset = corner - self.centre_mm;
            Vec3::new(offset.x as f32, offset.y as f32, offset.z as f32)
        };
        Box3::from_points(self.mesh.corners(face as usize).map(offset))
    }

    /// Points of the edges of each of two triangles behind the other one, with the body of that.
    fn points_behind(&self, pair: [(usize, u32); 2]) -> Vec<(Point3<f64>, usize)> {
        let mut points = Vec::new();
        for [(_, own), (body, other)] in [pair, [pair[1], pair[0]]] {
            let (own, other) = (self.mesh.corners(own as usize), self.mesh.corners(other as usize));
            let edges = [[own[0], own[1]], [own[1], own[2]], [own[2], own[0]]];
            points.extend(edges.iter().filter_map(|edge| self.point_behind(edge, &other)).map(|point| (point, body)));
        }
        points
    }

    /// Point of an edge just behind a triangle that the edge goes through.
    fn point_behind(&self, [from, to]: &[Point3<f64>; 2], [a, b, c]: &[Point3<f64>; 3]) -> Option<Point3<f64>> {
        let normal = (b - a).cross(&(c - a));
        let (square, depth) = (normal.norm_squared(), self.min_depth_mm * normal.norm());
        let [before, after] = [from, to].map(|end| normal.dot(&(end - a)));
        if before.min(after) >= -depth || before.max(after) <= depth {
            return None;
        }
        let met = from + (to - from) * (before / (before - after));
        let is_left = |[p, q]: [&Point3<f64>; 2]| (q - p).cross(&(met - p)).dot(&normal) >= -ROUNDING * square;
        let inner = if before < 0.0 { from } else { to };
        let step = (POINT_DEPTH * depth / before.min(after).abs()).min(0.5);
        [[a, b], [b, c], [c, a]].into_iter().all(is_left).then(|| met + (inner - met) * step)
    }

    /// Returns true if a point lies inside a body, and farther from its surface than the least depth.
    fn is_inside(&mut self, point: &Point3<f64>, body: usize) -> Result<bool, End> {
        let (mesh, bodies, min_depth_mm) = (self.mesh, self.bodies, self.min_depth_mm);
        let is_near = |face: &u32| (nearest_of_triangle(&mesh.corners(*face as usize), point).0 - point).norm() < min_depth_mm;
        for faces in bodies.faces(body).chunks(PIECE) {
            // This distance and the share of the winding number.
            self.spend(100 * faces.len())?;
            if faces.iter().any(is_near) {
                return Ok(false);
            }
        }
        let turns = winding_number(mesh, bodies.faces(body), point, self.poll)?;
        Ok((turns.abs() - 1.0).abs() < 0.1)
    }

    /// Returns true if a body lies in more solid bodies than walls of cavities.
    fn is_nested(&mut self, inner: &ClosedBody, solids: &[ClosedBody], overlapping: &[[usize; 2]]) -> Result<bool, End> {
        self.spend(10 * solids.len())?;
        let faces = self.bodies.faces(inner.index);
        let vertex = |nth: usize| self.mesh.corners(faces[nth * faces.len() / VERTICES_TRIED] as usize)[0];
        let vertices: [Point3<f64>; VERTICES_TRIED] = std::array::from_fn(vertex);
        let (mut solid, mut walls) = (0, 0);
        for outer in solids.iter().filter(|outer| encloses(&outer.aabb, &inner.aabb)) {
            let pair = [inner.index.min(outer.index), inner.index.max(outer.index)];
            if outer.volume_mm3 < 0.0 {
                walls += usize::from(self.may_hold(outer.index, &vertices)?);
            } else if overlapping.binary_search(&pair).is_err() {
                solid += usize::from(self.holds(outer.index, &vertices)?);
            }
        }
        Ok(solid > walls)
    }

    /// Returns true if all points lie inside a body, farther from its surface than the least depth.
    fn holds(&mut self, body: usize, points: &[Point3<f64>]) -> Result<bool, End> {
        for point in points {
            if !self.is_inside(point, body)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Returns true unless all points lie outside of a body and not on it.
    fn may_hold(&mut self, body: usize, points: &[Point3<f64>]) -> Result<bool, End> {
        let faces = self.bodies.faces(body);
        for point in points {
            self.spend(100 * faces.len())?;
            if winding_number(self.mesh, faces, point, self.poll)?.abs() > MIN_TURN {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

/// Box that two boxes have in common; `None` where they touch at most.
fn common(one: &Aabb, other: &Aabb) -> Option<Aabb> {
    let common = Aabb { min: one.min.sup(&other.min), max: one.max.inf(&other.max) };
    (0..3).all(|axis| common.min[axis] < common.max[axis]).then_some(common)
}
