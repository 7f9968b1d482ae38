//! Convex polytopes as intersections of half-spaces, and the largest box inside one.
//!
//! Vertices are found by meeting the planes in threes and keeping what all half-spaces hold (Preparata and Shamos,
//! *Computational Geometry*, 1985, section 7.2, brute force): n³/6 · n steps for n half-spaces, exact for the few dozen
//! a scanner has. Lengths in millimetres.

#[cfg(test)]
mod tests;

use nalgebra::{Matrix3, Point3, Vector3};

/// A vertex may leave a half-space by this much, and vertices closer than this are one.
const TOLERANCE_MM: f64 = 1e-6;

/// All points p with normal · p ≤ offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfSpace {
    /// Unit normal, outward.
    pub normal: Vector3<f64>,
    /// Distance of its plane from the origin along the normal.
    pub offset_mm: f64,
}

impl HalfSpace {
    /// The half-space whose plane goes through `point` and which `outward` (any length above 0) points out of.
    #[must_use]
    pub fn through(point: &Point3<f64>, outward: &Vector3<f64>) -> Self {
        let normal = outward.normalize();
        Self { normal, offset_mm: normal.dot(&point.coords) }
    }

    /// Depth of `point` inside; negative outside.
    #[must_use]
    pub fn depth_mm(&self, point: &Point3<f64>) -> f64 {
        self.offset_mm - self.normal.dot(&point.coords)
    }

    fn equals(&self, other: &Self) -> bool {
        (self.normal - other.normal).norm() < 1e-12 && (self.offset_mm - other.offset_mm).abs() < TOLERANCE_MM
    }
}

/// A bounded convex polytope with an inside.
#[derive(Clone, Debug)]
pub struct ConvexPolytope {
    /// Half-spaces whose intersection it is, without repetitions; some may not touch it.
    pub half_spaces: Vec<HalfSpace>,
    /// Corners of the polytope, mm, in no particular order.
    pub vertices_mm: Vec<Point3<f64>>,
    /// Volume of the polytope, mm³.
    pub volume_mm3: f64,
}

impl ConvexPolytope {
    /// Intersection of `half_spaces`; `None` when it has no inside. That it is bounded is the caller's duty.
    #[must_use]
    pub fn intersection(half_spaces: impl IntoIterator<Item = HalfSpace>) -> Option<Self> {
        let mut distinct: Vec<HalfSpace> = Vec::new();
        for half_space in half_spaces {
            if !distinct.iter().any(|known| known.equals(&half_space)) {
                distinct.push(half_space);
            }
        }
        let vertices_mm = vertices(&distinct);
        let volume_mm3 = volume(&distinct, &vertices_mm);
        (volume_mm3 > TOLERANCE_MM).then_some(Self { half_spaces: distinct, vertices_mm, volume_mm3 })
    }

    /// This polytope cut down to what `half_spaces` hold; `None` when nothing is left.
    #[must_use]
    pub fn cut(&self, half_spaces: impl IntoIterator<Item = HalfSpace>) -> Option<Self> {
        Self::intersection(self.half_spaces.iter().copied().chain(half_spaces))
    }

    /// Returns true if `point` lies inside or on it.
    #[must_use]
    pub fn holds(&self, point: &Point3<f64>) -> bool {
        self.half_spaces.iter().all(|h| h.depth_mm(point) >= -TOLERANCE_MM)
    }
}

/// The six half-spaces of an axis-aligned box.
#[must_use]
pub fn box_half_spaces(centre: &Point3<f64>, size_mm: &Vector3<f64>) -> [HalfSpace; 6] {
    std::array::from_fn(|i| {
        let sign = if i < 3 { 1.0 } else { -1.0 };
        let mut normal = Vector3::zeros();
        normal[i % 3] = sign;
        HalfSpace { normal, offset_mm: sign * centre[i % 3] + 0.5 * size_mm[i % 3] }
    })
}

fn vertices(half_spaces: &[HalfSpace]) -> Vec<Point3<f64>> {
    let mut found: Vec<Point3<f64>> = Vec::new();
    for (i, a) in half_spaces.iter().enumerate() {
        for (j, b) in half_spaces.iter().enumerate().skip(i + 1) {
            for c in &half_spaces[j + 1..] {
                let Some(point) = meeting_point(a, b, c) else { continue };
                let inside = half_spaces.iter().all(|h| h.depth_mm(&point) >= -TOLERANCE_MM);
                if inside && !found.iter().any(|known| (known - point).norm() < TOLERANCE_MM) {
                    found.push(point);
                }
            }
        }
    }
    found
}

fn meeting_point(a: &HalfSpace, b: &HalfSpace, c: &HalfSpace) -> Option<Point3<f64>> {
    let normals = Matrix3::from_rows(&[a.normal.transpose(), b.normal.transpose(), c.normal.transpose()]);
    if normals.determinant().abs() < 1e-9 {
        return None;
    }
    let offsets = Vector3::new(a.offset_mm, b.offset_mm, c.offset_mm);
    Some(Point3::from(normals.try_inverse()? * offsets))
}

/// Sum of the pyramids from the middle of the vertices to each face.
fn volume(half_spaces: &[HalfSpace], vertices: &[Point3<f64>]) -> f64 {
    if vertices.len() < 4 {
        return 0.0;
    }
    let middle = Point3::from(vertices.iter().map(|v| v.coords).sum::<Vector3<f64>>() / vertices.len() as f64);
    half_spaces.iter().map(|h| face_area(h, vertices) * h.depth_mm(&middle) / 3.0).sum()
}

/// Area of the face on the plane of `half_space`: its vertices in turn about their middle, then triangles.
fn face_area(half_space: &HalfSpace, vertices: &[Point3<f64>]) -> f64 {
    let mut face: Vec<&Point3<f64>> = vertices.iter().filter(|v| half_space.depth_mm(v).abs() <= 2.0 * TOLERANCE_MM).collect();
    if face.len() < 3 {
        return 0.0;
    }
    let middle = face.iter().map(|v| v.coords).sum::<Vector3<f64>>() / face.len() as f64;
    let u = (face[0].coords - middle).normalize();
    let v = half_space.normal.cross(&u);
    let angle = |p: &Point3<f64>| {
        let d = p.coords - middle;
        d.dot(&v).atan2(d.dot(&u))
    };
    face.sort_by(|p, q| angle(p).total_cmp(&angle(q)));
    let fan = face[1..].windows(2).map(|pair| (pair[0] - face[0]).cross(&(pair[1] - face[0])));
    0.5 * fan.sum::<Vector3<f64>>().norm()
}

/// Edge lengths of the largest axis-aligned box by volume that is centred on `centre` and lies in all `half_spaces`;
/// `None` when the centre is not inside all of them or no largest one exists.
///
/// With half edges h, a half-space with normal n and depth r at the centre holds the box iff |n| · h ≤ r. Maximising
/// log h₀h₁h₂ under these is a concave problem, so its one optimum is that of a set of one, two or three of the
/// constraints held as equations; each set is solved in closed form and the best admissible solution taken: exact.
#[must_use]
pub fn largest_centred_box(half_spaces: &[HalfSpace], centre: &Point3<f64>) -> Option<Vector3<f64>> {
    let limits: Vec<(Vector3<f64>, f64)> = half_spaces.iter().map(|h| (h.normal.abs(), h.depth_mm(centre))).collect();
    let admissible = |h: &Vector3<f64>| h.min() > 0.0 && limits.iter().all(|(g, r)| g.dot(h) <= r + TOLERANCE_MM);
    let mut candidates = Vec::new();
    for (i, a) in limits.iter().enumerate() {
        candidates.push(a.0.map(|g| a.1 / (3.0 * g)));
        for (j, b) in limits.iter().enumerate().skip(i + 1) {
            candidates.extend(best_on_line(a, b));
            for c in &limits[j + 1..] {
                let rows = Matrix3::from_rows(&[a.0.transpose(), b.0.transpose(), c.0.transpose()]);
                candidates.extend(rows.try_inverse().map(|inverse| inverse * Vector3::new(a.1, b.1, c.1)));
            }
        }
    }
    candidates
        .into_iter()
        .filter(|h| h.iter().all(|edge| edge.is_finite()) && admissible(h))
        .max_by(|p, q| p.product().total_cmp(&q.product()))
        .map(|half| half * 2.0)
}

/// Stationary points of h₀h₁h₂ on the line on which two constraints hold as equations: with h = p + t d, the derivative
/// of the product is a quadratic in t.
fn best_on_line(a: &(Vector3<f64>, f64), b: &(Vector3<f64>, f64)) -> Vec<Vector3<f64>> {
    let d = a.0.cross(&b.0);
    let Some(inverse) = Matrix3::from_rows(&[a.0.transpose(), b.0.transpose(), d.transpose()]).try_inverse() else {
        return Vec::new();
    };
    let p = inverse * Vector3::new(a.1, b.1, 0.0);
    let quadratic = 3.0 * d.x * d.y * d.z;
    let half_linear = p.x * d.y * d.z + d.x * p.y * d.z + d.x * d.y * p.z;
    let constant = d.x * p.y * p.z + p.x * d.y * p.z + p.x * p.y * d.z;
    let root = (half_linear * half_linear - quadratic * constant).max(0.0).sqrt();
    // Both forms of the roots, so that a vanishing leading coefficient leaves one usable.
    let (low, high) = (-half_linear - root, -half_linear + root);
    [low / quadratic, high / quadratic, constant / low, constant / high].map(|t| p + d * t).to_vec()
}
