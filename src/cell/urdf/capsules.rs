//! A few capsules around a set of triangles. Each contains whole triangles, so that together they contain the surface and,
//! being convex, what it encloses between them is only lost where the set is split. A split is made where it saves volume.
//!
//! A capsule's axis is the best of the set's principal axes and the frame's own; around it the smallest circle is found by
//! M. Bădoiu and K. Clarkson's steps towards the farthest point ("Smaller core-sets for balls", SODA 2003).

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector2, Vector3};

/// Capsules of one set at most: two splits, one after the other.
const SPLITS: u32 = 2;
/// A split must leave at most this share of the volume.
const WORTH: f64 = 0.9;
/// Steps towards the smallest circle: within 1 % of its radius.
const STEPS: u32 = 100;
/// Radii that are tried, in parts of the least.
const WIDER: [f64; 5] = [1.0, 1.05, 1.1, 1.2, 1.35];
/// Allowance for rounding, mm.
const MARGIN_MM: f64 = 0.1;
/// Smallest radius of a capsule, mm.
const MIN_RADIUS_MM: f64 = 1.0;

/// All points within a radius of a segment.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Capsule {
    pub(super) from_mm: Point3<f64>,
    pub(super) to_mm: Point3<f64>,
    pub(super) radius_mm: f64,
}

impl Capsule {
    fn volume(&self) -> f64 {
        let length = (self.to_mm - self.from_mm).norm();
        std::f64::consts::PI * self.radius_mm * self.radius_mm * (length + 4.0 / 3.0 * self.radius_mm)
    }
}

/// Capsules around the triangles; none around none.
pub(super) fn around(triangles: &[[Point3<f64>; 3]]) -> Vec<Capsule> {
    split(triangles, SPLITS)
}

fn split(triangles: &[[Point3<f64>; 3]], splits: u32) -> Vec<Capsule> {
    let corners: Vec<_> = triangles.iter().flatten().copied().collect();
    let Some(whole) = smallest(&corners) else { return Vec::new() };
    if splits == 0 || triangles.len() < 2 {
        return vec![whole];
    }
    let middle = |triangle: &[Point3<f64>; 3]| (triangle[0].coords + triangle[1].coords + triangle[2].coords) / 3.0;
    let cut = |axis: Vector3<f64>| {
        let (low, high) = corners
            .iter()
            .map(|p| p.coords.dot(&axis))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), t| (low.min(t), high.max(t)));
        let (near, far): (Vec<_>, Vec<_>) =
            triangles.iter().partition(|triangle| middle(triangle).dot(&axis) < 0.5 * (low + high));
        [split(&near, splits - 1), split(&far, splits - 1)].concat()
    };
    let volume = |capsules: &[Capsule]| capsules.iter().map(Capsule::volume).sum::<f64>();
    let cuts = directions(&corners).into_iter().map(cut).filter(|capsules| capsules.len() > 1);
    let best = cuts.min_by(|a, b| volume(a).total_cmp(&volume(b)));
    best.filter(|capsules| volume(capsules) < WORTH * whole.volume()).unwrap_or_else(|| vec![whole])
}

/// Principal axes of the points, and the frame's.
fn directions(corners: &[Point3<f64>]) -> Vec<Vector3<f64>> {
    let centre = corners.iter().map(|p| p.coords).sum::<Vector3<f64>>() / corners.len() as f64;
    let spread: Matrix3<f64> = corners.iter().map(|p| (p.coords - centre) * (p.coords - centre).transpose()).sum();
    let principal = SymmetricEigen::new(spread).eigenvectors;
    let own = [Vector3::x(), Vector3::y(), Vector3::z()];
    own.into_iter().chain((0..3).map(|axis| principal.column(axis).into_owned())).collect()
}

fn smallest(corners: &[Point3<f64>]) -> Option<Capsule> {
    let capsules = if corners.is_empty() { Vec::new() } else { directions(corners) };
    capsules.into_iter().map(|axis| along(corners, axis)).min_by(|a, b| a.volume().total_cmp(&b.volume()))
}

/// The smallest capsule around the points with this axis.
fn along(corners: &[Point3<f64>], axis: Vector3<f64>) -> Capsule {
    let across = if axis.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let u = axis.cross(&across).normalize();
    let v = axis.cross(&u);
    let seen: Vec<(Vector2<f64>, f64)> =
        corners.iter().map(|p| (Vector2::new(p.coords.dot(&u), p.coords.dot(&v)), p.coords.dot(&axis))).collect();
    let mut centre = seen[0].0;
    for step in 1..=STEPS {
        let farthest =
            seen.iter().map(|(p, _)| p).max_by(|a, b| (*a - centre).norm_squared().total_cmp(&(*b - centre).norm_squared()));
        centre += (farthest.unwrap_or(&centre) - centre) / f64::from(step + 1);
    }
    let farthest = seen.iter().map(|(p, _)| (p - centre).norm()).fold(0.0, f64::max);
    let around = |wider: f64| {
        let radius = wider * farthest.max(MIN_RADIUS_MM);
        let (low, high) = ends(&seen, &centre, radius);
        let at = |t: f64| Point3::from(u * centre.x + v * centre.y + axis * t);
        Capsule { from_mm: at(low), to_mm: at(high), radius_mm: radius + MARGIN_MM }
    };
    // Blunt ends are better held by a wider and shorter one.
    let tried = WIDER.map(around);
    tried.into_iter().min_by(|a, b| a.volume().total_cmp(&b.volume())).unwrap_or_else(|| around(1.0))
}

/// Ends along the axis for a capsule of this radius to hold every point.
fn ends(seen: &[(Vector2<f64>, f64)], centre: &Vector2<f64>, radius: f64) -> (f64, f64) {
    // Each end goes as far as the balls there need to reach every point.
    let reach = |p: &Vector2<f64>| (radius * radius - (p - centre).norm_squared()).max(0.0).sqrt();
    let low = seen.iter().map(|(p, t)| t + reach(p)).fold(f64::INFINITY, f64::min);
    let high = seen.iter().map(|(p, t)| t - reach(p)).fold(f64::NEG_INFINITY, f64::max);
    // One ball holds them all where the ends pass each other.
    if low <= high { (low, high) } else { (0.5 * (low + high), 0.5 * (low + high)) }
}
