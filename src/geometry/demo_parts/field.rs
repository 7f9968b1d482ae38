//! Signed distance fields in millimetres: negative inside, and nowhere steeper than 1, so that |d| bounds the distance
//! to the surface from below. Blends after I. Quilez, "Smooth minimum" (polynomial) and "Distance functions".

use nalgebra::{Point3, Vector2, Vector3};

/// A body as the distance to its surface.
pub(super) trait DistanceField {
    /// Signed distance at `p`, mm.
    fn at(&self, p: &Point3<f64>) -> f64;

    /// Direction of steepest ascent, by central differences.
    fn gradient(&self, p: &Point3<f64>) -> Vector3<f64> {
        const STEP_MM: f64 = 1e-5;
        let slope = |axis: usize| {
            let mut step = Vector3::zeros();
            step[axis] = STEP_MM;
            (self.at(&(p + step)) - self.at(&(p - step))) / (2.0 * STEP_MM)
        };
        Vector3::new(slope(0), slope(1), slope(2))
    }
}

impl<F: Fn(&Point3<f64>) -> f64> DistanceField for F {
    fn at(&self, p: &Point3<f64>) -> f64 {
        self(p)
    }
}

/// Box given by two corners.
pub(super) fn cuboid(p: &Point3<f64>, min: [f64; 3], max: [f64; 3]) -> f64 {
    let (min, max) = (Point3::from(min), Point3::from(max));
    let outside = (p - nalgebra::center(&min, &max)).abs() - (max - min) / 2.0;
    outside.sup(&Vector3::zeros()).norm() + outside.max().min(0.0)
}

/// Rectangle about the origin of the plane, with round corners.
pub(super) fn round_rectangle(p: Vector2<f64>, half: [f64; 2], radius: f64) -> f64 {
    let outside = p.abs() - Vector2::from(half).add_scalar(-radius);
    outside.sup(&Vector2::zeros()).norm() + outside.max().min(0.0) - radius
}

/// Cylinder about the line through `axis` along z, between two heights.
pub(super) fn upright_cylinder(p: &Point3<f64>, axis: [f64; 2], radius: f64, z: [f64; 2]) -> f64 {
    let radial = (p.xy() - Vector2::from(axis)).coords.norm() - radius;
    sharp_common(radial, slab(p.z, z))
}

/// Distance to what lies between two values on an axis.
pub(super) fn slab(value: f64, [low, high]: [f64; 2]) -> f64 {
    (low - value).max(value - high)
}

/// Ball.
pub(super) fn ball(p: &Point3<f64>, centre: [f64; 3], radius: f64) -> f64 {
    (p - Point3::from(centre)).norm() - radius
}

/// Ellipsoid with its axes along the frame's. A lower bound of the distance.
pub(super) fn ellipsoid(p: &Point3<f64>, centre: [f64; 3], half_axes: [f64; 3]) -> f64 {
    let half_axes = Vector3::from(half_axes);
    ((p - Point3::from(centre)).component_div(&half_axes).norm() - 1.0) * half_axes.min()
}

/// Capsule from `a` to `b` whose radius goes from `radius[0]` to `radius[1]`. A lower bound of the distance.
pub(super) fn limb(p: &Point3<f64>, a: [f64; 3], b: [f64; 3], radius: [f64; 2]) -> f64 {
    let (a, b) = (Point3::from(a), Point3::from(b));
    let along = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
    let slope = (radius[1] - radius[0]) / (b - a).norm();
    let distance = (p - (a + along * (b - a))).norm() - (radius[0] + along * (radius[1] - radius[0]));
    distance / (1.0 + slope * slope).sqrt()
}

/// Intersection of two fields, with a sharp edge; exact outside for fields that meet at right angles.
pub(super) fn sharp_common(a: f64, b: f64) -> f64 {
    a.max(b).min(0.0) + a.max(0.0).hypot(b.max(0.0))
}

/// Intersection of two fields, with the edge rounded to `radius`.
pub(super) fn round_common(a: f64, b: f64, radius: f64) -> f64 {
    sharp_common(a + radius, b + radius) - radius
}

/// Union of two fields, with the joint filled to a soft valley over `reach`.
pub(super) fn blend(a: f64, b: f64, reach: f64) -> f64 {
    let share = (reach - (a - b).abs()).max(0.0) / reach;
    a.min(b) - share * share * reach / 4.0
}

/// `a` without `b`, with the rim of the cut rounded over `reach`.
pub(super) fn soft_cut(a: f64, b: f64, reach: f64) -> f64 {
    -blend(-a, b, reach)
}

/// `a` without `b`, with a sharp rim.
pub(super) fn cut(a: f64, b: f64) -> f64 {
    a.max(-b)
}
