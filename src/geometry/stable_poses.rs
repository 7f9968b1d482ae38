//! The ways in which a body can stand on a plane: the facets of its convex hull above which the centre of mass lies.
//!
//! The likelihood that a body comes to rest on a facet grows with the solid angle under which its centre of mass sees that facet
//! (K. Goldberg, B. Mirtich, Y. Zhuang, J. Craig, B. Carlisle, J. Canny 1999, *Part pose statistics: estimators and
//! experiments*, IEEE Transactions on Robotics and Automation 15(5)); facets from which it tips over are left out here,
//! not counted for the facet it ends on. Part frame, millimetres. Cost: O(n log n) for n vertices, the hull's.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};
use parry3d::math::Vector as ParryVector;
use parry3d::transformation::try_convex_hull;

use super::mesh::Mesh;

#[cfg(test)]
mod tests;

/// Facets of the hull with normals within this angle are one face, radians (0.5°).
const ALIKE_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// A body that tips over within this angle does not stand, radians (3°).
const TIPPING_RAD: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// Height within which corners touch the plane, as a share of the body's size: that by which a face of facets [`ALIKE_RAD`] apart bulges.
const CONTACT: f64 = 0.009;
/// Digits to which corners are told apart, as a share of the body's size.
const SAME_CORNER: f64 = 1e-6;

/// A way to stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StablePose {
    /// Unit normal of the face it stands on: the direction that points down.
    pub down: Vector3<f64>,
    /// Share of the full solid angle under which the centre of mass sees that face.
    pub share: f64,
}

/// The ways in which a body can stand, the likeliest first. None for what has no volume.
#[must_use]
pub fn stable_poses(mesh: &Mesh) -> Vec<StablePose> {
    let Some(hull) = Hull::of(mesh) else { return Vec::new() };
    let centre = centre_of_mass(mesh).unwrap_or_else(|| hull.centre());
    let mut poses: Vec<_> = hull.faces().iter().filter_map(|face| hull.standing_on(face, &centre)).collect();
    // Stable: equal shares stay in the order of the hull's faces.
    poses.sort_by(|a, b| b.share.total_cmp(&a.share));
    poses
}

/// Centre of mass of the enclosed volume, by tetrahedra from the origin; `None` for a surface that encloses none.
fn centre_of_mass(mesh: &Mesh) -> Option<Point3<f64>> {
    let middle = mesh.aabb().centre();
    let (mut volume, mut moment) = (0.0, Vector3::zeros());
    for face in 0..mesh.faces.len() {
        let [a, b, c] = mesh.corners(face).map(|corner| corner - middle);
        let sixth = a.dot(&b.cross(&c));
        volume += sixth;
        moment += (a + b + c) * (sixth / 4.0);
    }
    let box_volume: f64 = mesh.aabb().extent_mm().iter().product();
    // An open surface gives a volume that means nothing; one within the box's is taken.
    let sensible = volume > 6e-3 * box_volume && volume <= 6.0 * box_volume;
    let centre = sensible.then(|| middle + moment / volume)?;
    mesh.aabb().holds(&centre).then_some(centre)
}

/// A convex hull, its triangles outward.
struct Hull {
    points: Vec<Point3<f64>>,
    triangles: Vec<[usize; 3]>,
    size_mm: f64,
}

impl Hull {
    fn of(mesh: &Mesh) -> Option<Self> {
        let middle = mesh.aabb().centre();
        let size_mm = mesh.aabb().extent_mm().norm();
        // Corners that several facets bring along, each once, the first of them: the hull's builder is confused by near copies.
        let offset = |corner: u32| (mesh.vertices_mm[corner as usize] - middle) / size_mm;
        let key = |corner: u32| <[f64; 3]>::from(offset(corner)).map(|c| (c / SAME_CORNER).round() as i32);
        let mut corners: Vec<([i32; 3], u32)> = (0..mesh.vertices_mm.len() as u32).map(|corner| (key(corner), corner)).collect();
        corners.sort_unstable();
        corners.dedup_by_key(|(key, _)| *key);
        let points = corners.iter().map(|(_, corner)| offset(*corner));
        let points: Vec<_> = points.map(|p| ParryVector::new(p.x as f32, p.y as f32, p.z as f32)).collect();
        let (points, triangles) = try_convex_hull(&points).ok()?;
        let back = |p: &ParryVector| middle + Vector3::new(p.x, p.y, p.z).map(f64::from) * size_mm;
        Some(Self {
            points: points.iter().map(back).collect(),
            triangles: triangles.iter().map(|corners| corners.map(|corner| corner as usize)).collect(),
            size_mm,
        })
    }

    fn corners(&self, triangle: usize) -> [Point3<f64>; 3] {
        self.triangles[triangle].map(|corner| self.points[corner])
    }

    fn normal(&self, triangle: usize) -> Option<Vector3<f64>> {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(&(c - a)).try_normalize(0.0)
    }

    /// Mean of the hull's volume.
    fn centre(&self) -> Point3<f64> {
        let inside = self.points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / self.points.len() as f64;
        let (mut volume, mut moment) = (0.0, Vector3::zeros());
        for triangle in 0..self.triangles.len() {
            let [a, b, c] = self.corners(triangle).map(|corner| corner.coords - inside);
            let sixth = a.dot(&b.cross(&c));
            volume += sixth;
            moment += (a + b + c) * (sixth / 4.0);
        }
        Point3::from(if volume > 0.0 { inside + moment / volume } else { inside })
    }

    /// Triangles of each flat face: those that share an edge and a normal.
    fn faces(&self) -> Vec<Vec<usize>> {
        let mut neighbours: HashMap<(usize, usize), usize> = HashMap::new();
        for (triangle, [a, b, c]) in self.triangles.iter().enumerate() {
            neighbours.extend([(*a, *b), (*b, *c), (*c, *a)].map(|edge| (edge, triangle)));
        }
        let mut taken = vec![false; self.triangles.len()];
        let mut faces = Vec::new();
        for seed in 0..self.triangles.len() {
            let Some(normal) = self.normal(seed).filter(|_| !taken[seed]) else { continue };
            taken[seed] = true;
            let (mut face, mut next) = (Vec::new(), vec![seed]);
            while let Some(triangle) = next.pop() {
                face.push(triangle);
                let [a, b, c] = self.triangles[triangle];
                for other in [(b, a), (c, b), (a, c)].iter().filter_map(|edge| neighbours.get(edge)) {
                    let alike = self.normal(*other).is_none_or(|other| other.angle(&normal) <= ALIKE_RAD);
                    if alike && !taken[*other] {
                        taken[*other] = true;
                        next.push(*other);
                    }
                }
            }
            faces.push(face);
        }
        faces
    }

    /// The pose of a body on a face, if it stands there: its centre of mass lies above it, far enough from every edge.
    fn standing_on(&self, face: &[usize], centre: &Point3<f64>) -> Option<StablePose> {
        let normal_of = |triangle: &usize| {
            let [a, b, c] = self.corners(*triangle);
            (b - a).cross(&(c - a))
        };
        let down = face.iter().map(normal_of).sum::<Vector3<f64>>().try_normalize(0.0)?;
        let height_mm = (self.corners(face[0])[0] - centre).dot(&down);
        let foot = centre + down * height_mm;
        let rim = self.rim(face);
        let margin_mm = |(a, b): &(Point3<f64>, Point3<f64>)| {
            let along = (b - a).try_normalize(0.0)?;
            Some((foot - a).dot(&down.cross(&along)))
        };
        let min_mm = rim.iter().filter_map(margin_mm).fold(f64::INFINITY, f64::min);
        let margin_mm = height_mm * TIPPING_RAD.tan();
        let stands = height_mm > SAME_CORNER * self.size_mm && min_mm >= margin_mm && self.encloses(&down, &foot, margin_mm);
        let share =
            face.iter().map(|triangle| solid_angle(&self.corners(*triangle), centre)).sum::<f64>() / (4.0 * std::f64::consts::PI);
        stands.then_some(StablePose { down, share })
    }

    /// Returns true if the corners that touch the plane below the body enclose a point of it by a distance. A facet does not tell that
    /// alone: of many corners on a circle some facets are slivers, the normals of which mean nothing.
    fn encloses(&self, down: &Vector3<f64>, foot: &Point3<f64>, by_mm: f64) -> bool {
        let height_mm = |p: &Point3<f64>| (p - foot).dot(down);
        let lowest_mm = self.points.iter().map(height_mm).fold(f64::NEG_INFINITY, f64::max);
        let across = down.cross(&Vector3::ith(down.iamin(), 1.0)).normalize();
        let along = down.cross(&across);
        let contacts = self.points.iter().filter(|p| height_mm(p) >= lowest_mm - CONTACT * self.size_mm);
        let mut contacts: Vec<[f64; 2]> = contacts.map(|p| [(p - foot).dot(&across), (p - foot).dot(&along)]).collect();
        contacts.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        let lower = half_outline(contacts.iter());
        let upper = half_outline(contacts.iter().rev());
        let mut edges = lower.windows(2).chain(upper.windows(2));
        let is_within = |edge: &[[f64; 2]]| {
            let [[ax, ay], [bx, by]] = [edge[0], edge[1]];
            ax * by - ay * bx >= by_mm * (bx - ax).hypot(by - ay)
        };
        contacts.len() > 2 && edges.all(is_within)
    }

    /// Edges that a face shares with other faces, counter-clockwise seen from outside.
    fn rim(&self, face: &[usize]) -> Vec<(Point3<f64>, Point3<f64>)> {
        let edges = |triangle: &usize| {
            let [a, b, c] = self.triangles[*triangle];
            [(a, b), (b, c), (c, a)]
        };
        let all: std::collections::HashSet<_> = face.iter().flat_map(edges).collect();
        let outer = face.iter().flat_map(edges).filter(|(a, b)| !all.contains(&(*b, *a)));
        outer.map(|(a, b)| (self.points[a], self.points[b])).collect()
    }
}

/// Half of the convex outline of sorted points, counter-clockwise (A. M. Andrew 1979, *Another efficient algorithm for convex hulls in two
/// dimensions*, Information Processing Letters 9(5)).
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
