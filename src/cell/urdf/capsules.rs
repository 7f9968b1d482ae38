//! A few capsules around a set of triangles. Each contains whole triangles, so that together they contain the surface and,
//! being convex, what it encloses between them is only lost where the set is split. A split is made where it saves volume.
//!
//! A capsule's axis is the best of the set's principal axes and the frame's own; around it the smallest circle is grown from
//! its farthest points (B. Gärtner, "Fast and robust smallest enclosing balls", ESA 1999, the pivot rule).

use std::cmp::Ordering::Equal;

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector2, Vector3};
use rayon::iter::{IntoParallelIterator, ParallelIterator};

/// Capsules of one set at most: two splits, one after the other.
const SPLITS: u32 = 2;
/// A split must leave at most this share of the volume.
const WORTH: f64 = 0.9;
/// Points that the smallest circle is grown by at most; it takes about ten.
const MAX_PIVOTS: u32 = 100;
/// Share of its radius by which a point may lie outside a circle for rounding.
const ON_CIRCLE: f64 = 1e-9;
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
    let by_place = |a: &Point3<f64>, b: &Point3<f64>| (0..3).map(|i| a[i].total_cmp(&b[i])).find(|o| o.is_ne()).unwrap_or(Equal);
    let mut points_mm: Vec<Point3<f64>> = triangles.iter().flatten().copied().collect();
    points_mm.sort_unstable_by(by_place);
    points_mm.dedup_by(|a, b| by_place(a, b).is_eq());
    let place = |corner: &Point3<f64>| points_mm.partition_point(|p| by_place(p, corner).is_lt()) as u32;
    let faces: Vec<[u32; 3]> = triangles.iter().map(|corners| corners.each_ref().map(place)).collect();
    split(&points_mm, &faces, SPLITS)
}

fn split(points_mm: &[Point3<f64>], faces: &[[u32; 3]], splits: u32) -> Vec<Capsule> {
    if faces.is_empty() {
        return Vec::new();
    }
    let (corners_mm, directions) = (corners(points_mm, faces), directions(points_mm, faces));
    let capsules = directions.iter().map(|axis| along(&corners_mm, axis));
    let Some(whole) = capsules.min_by(|a, b| a.volume().total_cmp(&b.volume())) else { return Vec::new() };
    if splits == 0 || faces.len() < 2 {
        return vec![whole];
    }
    let middle = |face: &[u32; 3]| face.iter().map(|corner| points_mm[*corner as usize].coords).sum::<Vector3<f64>>() / 3.0;
    let cut = |axis: Vector3<f64>| {
        let (low, high) = corners_mm
            .iter()
            .map(|p| p.coords.dot(&axis))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), t| (low.min(t), high.max(t)));
        let (near, far): (Vec<_>, Vec<_>) = faces.iter().partition(|face| middle(face).dot(&axis) < 0.5 * (low + high));
        [split(points_mm, &near, splits - 1), split(points_mm, &far, splits - 1)].concat()
    };
    let volume = |capsules: &[Capsule]| capsules.iter().map(Capsule::volume).sum::<f64>();
    let cuts: Vec<Vec<Capsule>> = directions.into_par_iter().map(cut).filter(|capsules| capsules.len() > 1).collect();
    let best = cuts.into_iter().min_by(|a, b| volume(a).total_cmp(&volume(b)));
    best.filter(|capsules| volume(capsules) < WORTH * whole.volume()).unwrap_or_else(|| vec![whole])
}

/// Corners of the triangles, each once.
fn corners(points_mm: &[Point3<f64>], faces: &[[u32; 3]]) -> Vec<Point3<f64>> {
    let mut is_corner = vec![false; points_mm.len()];
    faces.iter().flatten().for_each(|corner| is_corner[*corner as usize] = true);
    points_mm.iter().zip(is_corner).filter_map(|(p, is_corner)| is_corner.then_some(*p)).collect()
}

/// Principal axes of the triangles' corners, and the frame's.
fn directions(points_mm: &[Point3<f64>], faces: &[[u32; 3]]) -> Vec<Vector3<f64>> {
    let corners = || faces.iter().flatten().map(|corner| points_mm[*corner as usize].coords);
    let centre = corners().sum::<Vector3<f64>>() / (3 * faces.len()) as f64;
    let spread: Matrix3<f64> = corners().map(|p| (p - centre) * (p - centre).transpose()).sum();
    let principal = SymmetricEigen::new(spread).eigenvectors;
    let own = [Vector3::x(), Vector3::y(), Vector3::z()];
    own.into_iter().chain((0..3).map(|axis| principal.column(axis).into_owned())).collect()
}

/// The smallest capsule around the points with this axis.
fn along(corners_mm: &[Point3<f64>], axis: &Vector3<f64>) -> Capsule {
    let across = if axis.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let u = axis.cross(&across).normalize();
    let v = axis.cross(&u);
    let seen: Vec<(Vector2<f64>, f64)> =
        corners_mm.iter().map(|p| (Vector2::new(p.coords.dot(&u), p.coords.dot(&v)), p.coords.dot(axis))).collect();
    let (centre, farthest) = smallest_circle(&seen);
    let radii = WIDER.map(|wider| wider * farthest.max(MIN_RADIUS_MM));
    let ends = ends(&seen, &centre, &radii);
    let at = |t: f64| Point3::from(u * centre.x + v * centre.y + axis * t);
    let capsules = radii.iter().zip(ends).map(|(radius, (low, high))| Capsule {
        from_mm: at(low),
        to_mm: at(high),
        radius_mm: radius + MARGIN_MM,
    });
    // Blunt ends are better held by a wider and shorter one.
    capsules.min_by(|a, b| a.volume().total_cmp(&b.volume())).unwrap_or_else(|| unreachable!("radii are tried"))
}

/// Centre of the smallest circle around the points, and the distance of the farthest from it.
pub(super) fn smallest_circle(seen: &[(Vector2<f64>, f64)]) -> (Vector2<f64>, f64) {
    let (mut support, mut centre) = (vec![seen[0].0], seen[0].0);
    let farthest = |centre: &Vector2<f64>| {
        let squares = seen.iter().map(|(p, _)| (*p, (p - centre).norm_squared()));
        squares.fold((*centre, 0.0), |best, other| if other.1 > best.1 { other } else { best })
    };
    let mut radius = 0.0;
    for _ in 0..MAX_PIVOTS {
        let (pivot, square) = farthest(&centre);
        if square.sqrt() <= radius * (1.0 + ON_CIRCLE) {
            break;
        }
        support.push(pivot);
        (support, centre, radius) = around_few(&support);
    }
    (centre, farthest(&centre).1.sqrt())
}

/// The smallest circle around a few points: those that hold it, its centre and radius.
fn around_few(points: &[Vector2<f64>]) -> (Vec<Vector2<f64>>, Vector2<f64>, f64) {
    let count = points.len();
    let pairs = (0..count).flat_map(|a| (0..a).map(move |b| (points[a], points[b])));
    let of_pairs = pairs.map(|(a, b)| (vec![a, b], 0.5 * (a + b)));
    let triples = (0..count).flat_map(|a| (0..a).flat_map(move |b| (0..b).map(move |c| [points[a], points[b], points[c]])));
    let of_triples = triples.filter_map(|corners| Some((corners.to_vec(), circumcentre(&corners)?)));
    let with_radius = |(support, centre): (Vec<Vector2<f64>>, Vector2<f64>)| {
        let radius = points.iter().map(|p| (p - centre).norm()).fold(0.0, f64::max);
        (support, centre, radius)
    };
    let circles = of_pairs.chain(of_triples).map(with_radius);
    circles.min_by(|a, b| a.2.total_cmp(&b.2)).unwrap_or_else(|| (points.to_vec(), points[0], 0.0))
}

/// Centre of the circle through three corners; `None` if they lie on a line.
fn circumcentre([a, b, c]: &[Vector2<f64>; 3]) -> Option<Vector2<f64>> {
    let (ab, ac) = (b - a, c - a);
    let twice = 2.0 * ab.perp(&ac);
    let (b2, c2) = (ab.norm_squared(), ac.norm_squared());
    let from_a = Vector2::new(ac.y * b2 - ab.y * c2, ab.x * c2 - ac.x * b2) / twice;
    (from_a.x.is_finite() && from_a.y.is_finite()).then(|| a + from_a)
}

/// Ends along the axis for a capsule of each radius to hold every point.
fn ends(seen: &[(Vector2<f64>, f64)], centre: &Vector2<f64>, radii: &[f64; WIDER.len()]) -> [(f64, f64); WIDER.len()] {
    let mut ends = [(f64::INFINITY, f64::NEG_INFINITY); WIDER.len()];
    for (p, t) in seen {
        let off = (p - centre).norm_squared();
        for ((low, high), radius) in ends.iter_mut().zip(radii) {
            // Each end goes as far as the balls there need to reach every point.
            let reach = (radius * radius - off).max(0.0).sqrt();
            (*low, *high) = (low.min(t + reach), high.max(t - reach));
        }
    }
    // One ball holds them all where the ends pass each other.
    ends.map(|(low, high)| if low <= high { (low, high) } else { (0.5 * (low + high), 0.5 * (low + high)) })
}
