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
//! not counted for the facet it ends on. Part frame, millimetres. Cost: O(n log n) for n vertices, the hull's, and a look at each
//! corner of the hull for each facet that may be stood on: up to a thousand of a ball, a few of most bodies.

use std::cmp::Reverse;
use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

use super::mesh::Mesh;

#[cfg(test)]
mod tests;

/// A body that tips over within this angle does not stand, radians (3°).
const TIPPING_RAD: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// Rounding of a file's 32-bit numbers, as a share of the body's size; no source.
const ROUNDING: f64 = 1e-6;
/// Steps of the hull's grid along the body's size: a product of two lengths fits into 64 bits, one of four into 128.
const GRID: f64 = (1 << 30) as f64;

/// A way to stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StablePose {
    /// Unit normal of the face it stands on: the direction that points down.
    pub down: Vector3<f64>,
    /// Share of the full solid angle under which the centre of mass sees that face: the facets of the hull within 3° of it.
    pub share: f64,
}

/// The ways in which a body can stand, the likeliest first. None for what has no volume.
#[must_use]
pub fn stable_poses(mesh: &Mesh) -> Vec<StablePose> {
    let Some(hull) = Hull::of(mesh) else { return Vec::new() };
    let centre = centre_of_mass(mesh).unwrap_or_else(|| hull.centre());
    let stable = hull.rests(&centre).into_iter().filter(|rest| hull.is_stable(rest, &centre));
    let mut poses: Vec<_> = stable.map(|rest| StablePose { down: rest.down, share: hull.share(&rest.down, &centre) }).collect();
    // Shares that are equal but for rounding are in the order of their directions, so that rounding decides nothing.
    let digits = |value: f64| (value * 1e6).round() as i64;
    poses.sort_by_key(|pose| (Reverse(digits(pose.share)), digits(pose.down.z), digits(pose.down.y), digits(pose.down.x)));
    poses
}

/// Centre of mass of the enclosed volume; `None` for a surface that encloses none.
fn centre_of_mass(mesh: &Mesh) -> Option<Point3<f64>> {
    let (volume, centre) = centroid((0..mesh.faces.len()).map(|face| mesh.corners(face)), &mesh.aabb().centre());
    let box_volume: f64 = mesh.aabb().extent_mm().iter().product();
    // An open surface gives a volume that means nothing; one within the box's is taken.
    let is_sensible = volume > 6e-3 * box_volume && volume <= 6.0 * box_volume && mesh.aabb().holds(&centre);
    is_sensible.then_some(centre)
}

/// Six times the volume that triangles enclose, and its centre, by tetrahedra from a point near them.
fn centroid(triangles: impl Iterator<Item = [Point3<f64>; 3]>, near: &Point3<f64>) -> (f64, Point3<f64>) {
    let (mut volume, mut moment) = (0.0, Vector3::zeros());
    for corners in triangles {
        let [a, b, c] = corners.map(|corner| corner - near);
        let sixth = a.dot(&b.cross(&c));
        volume += sixth;
        moment += (a + b + c) * (sixth / 4.0);
    }
    (volume, near + moment / volume)
}

/// A convex hull.
struct Hull {
    corners: Vec<Point3<f64>>,
    facets: Vec<Facet>,
    size_mm: f64,
}

/// A triangle of the hull.
struct Facet {
    /// Counter-clockwise seen from outside.
    corners: [Point3<f64>; 3],
    /// Unit normal, outward: exact also where the triangle is a sliver.
    down: Vector3<f64>,
}

/// A pose with the centre of mass lower than in any other nearby.
struct Rest {
    down: Vector3<f64>,
    /// Height of the centre of mass above the plane.
    height_mm: f64,
}

impl Hull {
    fn of(mesh: &Mesh) -> Option<Self> {
        let (middle, size_mm) = (mesh.aabb().centre(), mesh.aabb().extent_mm().norm());
        let on_grid = |p: &Point3<f64>| <[i64; 3]>::from(((p - middle) * (GRID / size_mm)).map(|c| c.round() as i64));
        let mut steps: Vec<[i64; 3]> = mesh.vertices_mm.iter().map(on_grid).collect();
        steps.sort_unstable();
        steps.dedup();
        let points: Vec<Vector3<i64>> = steps.into_iter().map(Vector3::from).collect();
        let exact = quickhull(&points)?;
        let point_mm = |point: usize| middle + points[point].map(|c| c as f64) * (size_mm / GRID);
        let facet =
            |facet: &ExactFacet| Facet { corners: facet.corners.map(point_mm), down: facet.normal.map(|c| c as f64).normalize() };
        let mut corners: Vec<usize> = exact.iter().flat_map(|facet| facet.corners).collect();
        corners.sort_unstable();
        corners.dedup();
        Some(Self { corners: corners.into_iter().map(point_mm).collect(), facets: exact.iter().map(facet).collect(), size_mm })
    }

    /// Centre of the hull's volume.
    fn centre(&self) -> Point3<f64> {
        centroid(self.facets.iter().map(|facet| facet.corners), &self.corners[0]).1
    }

    /// Facets that hold the foot of the centre of mass, the lowest first. Of those within twice [`TIPPING_RAD`] of one another
    /// the lowest alone: the height above the supporting plane is sublinear in its normal, so that a body tips over from the
    /// others.
    fn rests(&self, centre: &Point3<f64>) -> Vec<Rest> {
        let mut rests: Vec<Rest> = self.facets.iter().filter_map(|facet| facet.rest(centre, ROUNDING * self.size_mm)).collect();
        rests.sort_by(|a, b| a.height_mm.total_cmp(&b.height_mm));
        let mut lowest: Vec<Rest> = Vec::new();
        let apart = (2.0 * TIPPING_RAD).cos();
        for rest in rests {
            if lowest.iter().all(|lower| lower.down.dot(&rest.down) < apart) {
                lowest.push(rest);
            }
        }
        lowest
    }

    /// Returns true if it takes a tilt by more than [`TIPPING_RAD`] to topple the body: the condition at the head of the module.
    fn is_stable(&self, rest: &Rest, centre: &Point3<f64>) -> bool {
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
        let supports: Vec<[f64; 2]> = self.corners.iter().map(shortened).filter(is_far).collect();
        encloses_origin(supports, margin_mm + ROUNDING * self.size_mm)
    }

    /// Share of the full solid angle under which the centre of mass sees the facets within [`TIPPING_RAD`] of a direction.
    fn share(&self, down: &Vector3<f64>, centre: &Point3<f64>) -> f64 {
        let alike = TIPPING_RAD.cos();
        let face = self.facets.iter().filter(|facet| facet.down.dot(down) >= alike);
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

/// Facet of a hull on the grid, exact.
struct ExactFacet {
    /// Counter-clockwise seen from outside.
    corners: [usize; 3],
    /// Facet beyond the edge from each corner to the next.
    beyond: [usize; 3],
    /// Outward, twice as long as the area.
    normal: Vector3<i64>,
    /// Points above it that the hull does not hold yet, each above one facet.
    outside: Vec<usize>,
    is_gone: bool,
}

impl ExactFacet {
    fn new(corners: [usize; 3], beyond: [usize; 3], points: &[Vector3<i64>]) -> Self {
        let [a, b, c] = corners.map(|corner| points[corner]);
        Self { corners, beyond, normal: (b - a).cross(&(c - a)), outside: Vec::new(), is_gone: false }
    }

    /// Height of a point above it, in lengths of its normal.
    fn height(&self, point: usize, points: &[Vector3<i64>]) -> i128 {
        dot(&self.normal, &(points[point] - points[self.corners[0]]))
    }
}

fn dot(a: &Vector3<i64>, b: &Vector3<i64>) -> i128 {
    a.iter().zip(b.iter()).map(|(a, b)| i128::from(*a) * i128::from(*b)).sum()
}

/// Facets of the convex hull of points, `None` for what is flat (C. B. Barber, D. P. Dobkin, H. Huhdanpaa 1996, *The quickhull
/// algorithm for convex hulls*, ACM Transactions on Mathematical Software 22(4)). Integers keep it convex and closed where many
/// corners lie in one plane but for rounding; that of floating-point numbers has holes there and facets that face inwards.
fn quickhull(points: &[Vector3<i64>]) -> Option<Vec<ExactFacet>> {
    let mut facets = tetrahedron(points)?;
    hand_out(0..points.len(), &mut facets, points);
    let mut next = 0;
    while next < facets.len() {
        let facet = &facets[next];
        let farthest = facet.outside.iter().copied().max_by_key(|point| facet.height(*point, points));
        if let Some(apex) = farthest {
            raise(&mut facets, next, apex, points);
        }
        next += 1;
    }
    facets.retain(|facet| !facet.is_gone);
    Some(facets)
}

/// Four points far apart, as a hull.
fn tetrahedron(points: &[Vector3<i64>]) -> Option<Vec<ExactFacet>> {
    let farthest = |distance: &dyn Fn(Vector3<i64>) -> i128| {
        let distances = points.iter().map(|point| distance(point - points[0]));
        distances.enumerate().max_by_key(|(_, distance)| *distance).filter(|(_, distance)| *distance > 0).map(|(point, _)| point)
    };
    let b = farthest(&|p| dot(&p, &p))?;
    let edge = points[b] - points[0];
    let c = farthest(&|p| dot(&edge.cross(&p), &edge.cross(&p)))?;
    let normal = edge.cross(&(points[c] - points[0]));
    let d = farthest(&|p| dot(&normal, &p).abs())?;
    // Seen from outside the first three corners are counter-clockwise if the fourth lies below them.
    let [b, c] = if dot(&normal, &(points[d] - points[0])) > 0 { [c, b] } else { [b, c] };
    let sides = [([0, b, c], [1, 2, 3]), ([0, d, b], [3, 2, 0]), ([b, d, c], [1, 3, 0]), ([c, d, 0], [2, 1, 0])];
    Some(sides.map(|(corners, beyond)| ExactFacet::new(corners, beyond, points)).into())
}

/// Gives each point to a facet that it lies above; the hull of the facets holds the others.
fn hand_out(outside: impl IntoIterator<Item = usize>, facets: &mut [ExactFacet], points: &[Vector3<i64>]) {
    for point in outside {
        if let Some(facet) = facets.iter_mut().find(|facet| facet.height(point, points) > 0) {
            facet.outside.push(point);
        }
    }
}

/// Replaces the facets below a point, `first` among them, by those from the rim of the hole to the point.
fn raise(facets: &mut Vec<ExactFacet>, first: usize, apex: usize, points: &[Vector3<i64>]) {
    let (mut open, mut outside, mut rim) = (vec![first], Vec::new(), HashMap::new());
    let mut from = apex;
    facets[first].is_gone = true;
    while let Some(facet) = open.pop() {
        // What it held is freed here, since facets that are gone stay in the list.
        outside.append(&mut std::mem::take(&mut facets[facet].outside));
        for side in 0..3 {
            let other = facets[facet].beyond[side];
            if facets[other].is_gone {
                continue;
            }
            if facets[other].height(apex, points) > 0 {
                facets[other].is_gone = true;
                open.push(other);
            } else {
                from = facets[facet].corners[side];
                rim.insert(from, (facets[facet].corners[(side + 1) % 3], other));
            }
        }
    }
    let (first_new, count) = (facets.len(), rim.len());
    for place in 0..count {
        let (to, other) = rim[&from];
        let [next, last] = [1, count - 1].map(|step| first_new + (place + step) % count);
        facets.push(ExactFacet::new([from, to, apex], [other, next, last], points));
        if let Some(side) = facets[other].corners.iter().position(|corner| *corner == to) {
            facets[other].beyond[side] = first_new + place;
        }
        from = to;
    }
    hand_out(outside, &mut facets[first_new..], points);
}
