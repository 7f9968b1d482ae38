//! The ways in which a body can stand on a plane: the facets of its convex hull on which the centre of mass has its foot, the
//! point straight below it, and from which it takes a tilt to topple the body.
//!
//! A tilt of the body by `θ` = [`TIPPING_RAD`] towards any side has to lift the centre of mass from its height `H` to `H / cos θ`
//! or more, as an edge at the distance `H tan θ` from the foot does. A corner of the hull at the offset `m` from the foot and `b`
//! above the plane does so if `m sin θ + (H − b) cos θ ≥ H / cos θ`; with `a = H tan² θ`, that is `m a / (a + b) ≥ H tan θ`. So
//! the offsets of all corners, shortened by the factor `a / (a + b)`, have to enclose the foot by `H tan θ`. No tolerance says
//! which corners touch: uneven legs and a warped plate stand, a round underside does from a radius of `2 H` on, the side of a
//! fine cylinder or ball does not.
//!
//! The likelihood that a body comes to rest on a facet grows with the solid angle under which its centre of mass sees that facet
//! (K. Goldberg, B. Mirtich, Y. Zhuang, J. Craig, B. Carlisle, J. Canny 1999, *Part pose statistics: estimators and
//! experiments*, IEEE Transactions on Robotics and Automation 15(5)); facets from which it tips over are left out here,
//! not counted for the facet it ends on. Part frame, millimetres. Cost: O(n log n) for n vertices, the hull's, and for each facet
//! that may be stood on, up to a thousand of a ball and a few of most bodies, a look at each facet or at each corner near it.

mod corner_blocks;
mod quickhull;

use std::cmp::Reverse;
use std::sync::{Arc, OnceLock};

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use self::corner_blocks::CornerBlocks;
use self::quickhull::{ExactFacet, LatticePoint, MAX_STEP, quickhull};
use super::mesh::{Aabb, Mesh};
use super::poll::{Interrupted, Poll};
use super::side_by_side::{self, PIECE};

#[cfg(test)]
mod tests;

/// A body that tips over within this angle does not stand, radians (3°).
const TIPPING_RAD: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// Rounding of a file's 32-bit numbers, as a share of the body's size; no source.
const ROUNDING: f64 = 1e-6;
/// Steps of the hull's grid along the body's size, the diagonal of its box: half of them either way from the middle.
const GRID: f64 = 2.0 * MAX_STEP as f64;

/// A way to stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StablePose {
    /// Unit normal of the face it stands on: the direction that points down.
    pub down: Vector3<f64>,
    /// Share of the full solid angle under which the centre of mass sees that face: the facets of the hull within 3° of it.
    pub share: f64,
}

/// Ways in which a body can stand, computed when somebody asks. Clones know them together.
#[derive(Clone, Debug, Default)]
pub struct LazyStablePoses(Arc<OnceLock<Vec<StablePose>>>);

impl LazyStablePoses {
    /// [`stable_poses`] of the body, the same one in every call; computed in the first.
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn of(&self, mesh: &Mesh, poll: &Poll<'_>) -> Result<&[StablePose], Interrupted> {
        if let Some(known) = self.0.get() {
            return Ok(known);
        }
        // Two that ask at once both compute: one that waited, in a pool, could keep the other from ending.
        let found = stable_poses(mesh, poll)?;
        Ok(self.0.get_or_init(|| found))
    }

    /// Takes over what is known of the same body elsewhere.
    pub fn learn_from(&self, other: &Self) {
        if let Some(known) = other.0.get() {
            self.0.get_or_init(|| known.clone());
        }
    }

    /// Returns true once they were computed.
    #[must_use]
    pub fn are_known(&self) -> bool {
        self.0.get().is_some()
    }
}

/// The ways in which a body can stand, the likeliest first. None for what has no volume.
///
/// # Errors
/// [`Interrupted`].
pub fn stable_poses(mesh: &Mesh, poll: &Poll<'_>) -> Result<Vec<StablePose>, Interrupted> {
    poll.check()?;
    let aabb = mesh.aabb();
    let Some(hull) = Hull::of(mesh, &aabb, poll)? else { return Ok(Vec::new()) };
    let centre = match centre_of_mass(mesh, &aabb, poll)? {
        Some(centre) => centre,
        None => hull.centre(poll)?,
    };
    let rests = hull.rests(&centre, poll)?;
    let blocks = CornerBlocks::of(&hull.corners, rests.len());
    let are_stable = side_by_side::map(&rests, |rest| hull.is_stable(rest, &centre, &blocks), poll)?;
    let stable: Vec<_> = rests.iter().zip(are_stable).filter(|(_, is_stable)| *is_stable).map(|(rest, _)| rest.down).collect();
    let pose = |down: &Vector3<f64>| StablePose { down: *down, share: hull.share(down, &centre) };
    let mut poses = side_by_side::map(&stable, pose, poll)?;
    // Shares that are equal but for rounding are in the order of their directions, so that rounding decides nothing.
    let digits = |value: f64| (value * 1e6).round() as i64;
    poses.sort_by_key(|pose| (Reverse(digits(pose.share)), digits(pose.down.z), digits(pose.down.y), digits(pose.down.x)));
    Ok(poses)
}

/// Centre of mass of the enclosed volume; `None` for a surface that encloses none.
fn centre_of_mass(mesh: &Mesh, aabb: &Aabb, poll: &Poll<'_>) -> Result<Option<Point3<f64>>, Interrupted> {
    let (volume, centre) = centroid((0..mesh.faces.len()).map(|face| mesh.corners(face)), &aabb.centre(), poll)?;
    let box_volume: f64 = aabb.extent_mm().iter().product();
    // An open surface gives a volume that means nothing; one within the box's is taken.
    let is_sensible = volume > 6e-3 * box_volume && volume <= 6.0 * box_volume && aabb.holds(&centre);
    Ok(is_sensible.then_some(centre))
}

/// Six times the volume that triangles enclose, and its centre, by tetrahedra from a point near them.
fn centroid(
    triangles: impl Iterator<Item = [Point3<f64>; 3]>,
    near: &Point3<f64>,
    poll: &Poll<'_>,
) -> Result<(f64, Point3<f64>), Interrupted> {
    let (mut volume, mut moment) = (0.0, Vector3::zeros());
    for corners in triangles {
        poll.spend(10)?;
        let [a, b, c] = corners.map(|corner| corner - near);
        let sixth = a.dot(&b.cross(&c));
        volume += sixth;
        moment += (a + b + c) * (sixth / 4.0);
    }
    Ok((volume, near + moment / volume))
}

/// Vertices of a mesh on the hull's grid, sorted, no two equal.
fn on_grid(mesh: &Mesh, middle: &Point3<f64>, size_mm: f64, poll: &Poll<'_>) -> Result<Vec<LatticePoint>, Interrupted> {
    let limit = f64::from(MAX_STEP);
    let on_grid =
        |p: &Point3<f64>| <[f64; 3]>::from((p - middle) * (GRID / size_mm)).map(|c| c.round().clamp(-limit, limit) as i32);
    let mut points = vec![[0; 3]; mesh.vertices_mm.len()];
    let pieces: Vec<_> = mesh.vertices_mm.chunks(PIECE).zip(points.chunks_mut(PIECE)).collect();
    let fill = |(vertices_mm, points): &mut (&[Point3<f64>], &mut [LatticePoint])| {
        points.iter_mut().zip(vertices_mm.iter()).for_each(|(point, vertex_mm)| *point = on_grid(vertex_mm));
    };
    side_by_side::for_each(pieces, fill, poll)?;
    points.par_sort_unstable();
    points.dedup();
    poll.check()?;
    Ok(points)
}

/// Corners of a closed hull, sorted, each once.
fn corners_of(facets: &[ExactFacet]) -> Vec<LatticePoint> {
    // Of the facets around a corner one at least has its other two in ascending order: half of the work is saved.
    let ascending = |facet: &ExactFacet| {
        let [a, b, c] = facet.corners;
        [(a, b, c), (b, c, a), (c, a, b)].into_iter().filter(|(_, next, last)| next < last).map(|(corner, ..)| corner)
    };
    let mut corners: Vec<LatticePoint> = facets.iter().flat_map(ascending).collect();
    corners.par_sort_unstable();
    corners.dedup();
    corners
}

/// A convex hull.
struct Hull {
    facets: Vec<ExactFacet>,
    /// Sorted along the axes.
    corners: Vec<Point3<f64>>,
    /// Middle of the grid.
    middle: Point3<f64>,
    size_mm: f64,
}

/// A triangle of the hull, computed when it is looked at: a ball's would take a hundred bytes for each.
struct Facet {
    /// Counter-clockwise seen from outside.
    corners: [Point3<f64>; 3],
    /// Unit normal, outward: exact also where the triangle is a sliver.
    down: Vector3<f64>,
}

/// A pose with the centre of mass lower than in any other nearby.
#[derive(Clone)]
struct Rest {
    down: Vector3<f64>,
    /// Height of the centre of mass above the plane.
    height_mm: f64,
}

impl Hull {
    fn of(mesh: &Mesh, aabb: &Aabb, poll: &Poll<'_>) -> Result<Option<Self>, Interrupted> {
        let (middle, size_mm) = (aabb.centre(), aabb.extent_mm().norm());
        let Some(facets) = quickhull(&on_grid(mesh, &middle, size_mm, poll)?, poll)? else { return Ok(None) };
        let mut hull = Self { facets, corners: Vec::new(), middle, size_mm };
        poll.check()?;
        hull.corners = corners_of(&hull.facets).iter().map(|corner| hull.point_mm(corner)).collect();
        Ok(Some(hull))
    }

    fn point_mm(&self, point: &LatticePoint) -> Point3<f64> {
        self.middle + Vector3::from(point.map(f64::from)) * (self.size_mm / GRID)
    }

    fn facet(&self, exact: &ExactFacet) -> Facet {
        Facet {
            corners: exact.corners.each_ref().map(|corner| self.point_mm(corner)),
            down: Vector3::from(exact.normal().map(|c| c as f64)).normalize(),
        }
    }

    /// Centre of the hull's volume.
    fn centre(&self, poll: &Poll<'_>) -> Result<Point3<f64>, Interrupted> {
        Ok(centroid(self.facets.iter().map(|facet| self.facet(facet).corners), &self.corners[0], poll)?.1)
    }

    /// Facets that hold the foot of the centre of mass, the lowest first. Of those within twice [`TIPPING_RAD`] of one another
    /// the lowest alone: the height above the supporting plane is sublinear in its normal, so that a body tips over from the
    /// others.
    fn rests(&self, centre: &Point3<f64>, poll: &Poll<'_>) -> Result<Vec<Rest>, Interrupted> {
        let rounding_mm = ROUNDING * self.size_mm;
        let rest = |facet: &ExactFacet| self.facet(facet).rest(centre, rounding_mm);
        let of_piece = |piece: &&[ExactFacet]| -> Vec<Rest> { piece.iter().filter_map(rest).collect() };
        let pieces: Vec<&[ExactFacet]> = self.facets.chunks(PIECE).collect();
        let mut rests = side_by_side::map(&pieces, of_piece, poll)?.concat();
        rests.par_sort_by(|a, b| a.height_mm.total_cmp(&b.height_mm));
        let mut lowest: Vec<Rest> = Vec::new();
        let apart = (2.0 * TIPPING_RAD).cos();
        for rest in rests {
            poll.spend(lowest.len())?;
            if lowest.iter().all(|lower| lower.down.dot(&rest.down) < apart) {
                lowest.push(rest);
            }
        }
        Ok(lowest)
    }

    /// Returns true if it takes a tilt by more than [`TIPPING_RAD`] to topple the body: the condition at the head of the module.
    fn is_stable(&self, rest: &Rest, centre: &Point3<f64>, blocks: &CornerBlocks<'_>) -> bool {
        let margin_mm = rest.height_mm * TIPPING_RAD.tan();
        let depth_mm = margin_mm * TIPPING_RAD.tan();
        let across = rest.down.cross(&Vector3::ith(rest.down.iamin(), 1.0)).normalize();
        let along = rest.down.cross(&across);
        let shortened = |corner: &Point3<f64>| {
            let offset = corner - centre;
            let above_mm = (rest.height_mm - offset.dot(&rest.down)).max(0.0);
            [across, along].map(|axis| offset.dot(&axis) * depth_mm / (depth_mm + above_mm))
        };
        // Nearer ones are no corners of an outline that encloses the foot by the margin.
        let is_far = |[x, y]: &[f64; 2]| x * x + y * y >= margin_mm * margin_mm;
        // With the condition at the head of the module: b ≤ m tan θ − a for what is far. All rounding is less than is added.
        let may_be_far = |middle: &Point3<f64>, radius_mm: f64| {
            let offset = middle - centre;
            let along_mm = offset.dot(&rest.down);
            let aside_mm = (offset - rest.down * along_mm).norm();
            let above_mm = rest.height_mm - along_mm - radius_mm;
            above_mm <= (aside_mm + radius_mm) * TIPPING_RAD.tan() - depth_mm + ROUNDING * self.size_mm
        };
        let supports: Vec<[f64; 2]> = blocks.of_balls(may_be_far).map(shortened).filter(is_far).collect();
        encloses_origin(supports, margin_mm + ROUNDING * self.size_mm)
    }

    /// Share of the full solid angle under which the centre of mass sees the facets within [`TIPPING_RAD`] of a direction.
    fn share(&self, down: &Vector3<f64>, centre: &Point3<f64>) -> f64 {
        let alike = TIPPING_RAD.cos();
        let face = self.facets.iter().map(|facet| self.facet(facet)).filter(|facet| facet.down.dot(down) >= alike);
        face.map(|facet| solid_angle(&facet.corners, centre)).sum::<f64>() / (4.0 * std::f64::consts::PI)
    }
}

impl Facet {
    /// The pose of a body on it, if it holds the foot of the centre of mass.
    fn rest(&self, centre: &Point3<f64>, rounding_mm: f64) -> Option<Rest> {
        let [a, b, c] = &self.corners;
        let height_mm = (a - centre).dot(&self.down);
        let foot = centre + self.down * height_mm;
        let is_inside = |from: &Point3<f64>, to: &Point3<f64>| {
            let edge = to - from;
            edge.cross(&(foot - from)).dot(&self.down) >= -rounding_mm * edge.norm()
        };
        let rests = height_mm > rounding_mm && is_inside(a, b) && is_inside(b, c) && is_inside(c, a);
        rests.then_some(Rest { down: self.down, height_mm })
    }
}

/// Returns true if the outline of points encloses the origin by a margin.
fn encloses_origin(mut points: Vec<[f64; 2]>, margin: f64) -> bool {
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let lower = half_outline(points.iter());
    let upper = half_outline(points.iter().rev());
    let mut edges = lower.windows(2).chain(upper.windows(2));
    let is_within = |edge: &[[f64; 2]]| {
        let [[ax, ay], [bx, by]] = [edge[0], edge[1]];
        ax * by - ay * bx >= margin * (bx - ax).hypot(by - ay)
    };
    points.len() > 2 && edges.all(is_within)
}

/// Half of the convex outline of sorted points, counter-clockwise (A. M. Andrew 1979, *Another efficient algorithm for convex
/// hulls in two dimensions*, Information Processing Letters 9(5)).
fn half_outline<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> Vec<[f64; 2]> {
    let mut outline: Vec<[f64; 2]> = Vec::new();
    for [x, y] in points {
        while let [.., [ax, ay], [bx, by]] = outline[..]
            && (bx - ax) * (y - ay) - (by - ay) * (x - ax) <= 0.0
        {
            outline.pop();
        }
        outline.push([*x, *y]);
    }
    outline
}

/// Solid angle of a triangle seen from a point, steradians (A. van Oosterom and J. Strackee 1983, *The Solid Angle of a Plane
/// Triangle*).
fn solid_angle(corners: &[Point3<f64>; 3], from: &Point3<f64>) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - from);
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let divisor = la * lb * lc + a.dot(&b) * lc + a.dot(&c) * lb + b.dot(&c) * la;
    2.0 * a.dot(&b.cross(&c)).abs().atan2(divisor)
}
