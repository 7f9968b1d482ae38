//! Nearest point of a surface: a tree of boxes by parry finds the triangle in single precision, relative to the mesh's middle; the
//! point on it is then computed in double precision, so that distances hold to the last digits that coordinates have.
//!
//! Closest point of a triangle by its Voronoi regions: C. Ericson, *Real-Time Collision Detection*, 2005, section 5.1.5.
//! Cost: O(log n) a query, some 5 to 10 µs; good for tens of thousands of points, not for millions.

use nalgebra::{Point3, Vector3};
use parry3d::bounding_volume::Aabb as Box3;
use parry3d::math::Vector as Vec3;
use parry3d::partitioning::{Bvh, BvhBuildStrategy};

use super::mesh::{Aabb, Mesh};

/// Triangles of a surface, to be asked for the nearest point.
pub struct NearestFace<'m> {
    mesh: &'m Mesh,
    centre_mm: Point3<f64>,
    tree: Bvh,
}

/// Nearest point of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestPoint {
    /// Triangle of the mesh.
    pub face: u32,
    /// The nearest point, frame of the mesh, mm.
    pub point_mm: Point3<f64>,
    /// True where the point lies inside the triangle and on none of its edges.
    pub is_inside: bool,
}

impl<'m> NearestFace<'m> {
    /// Grows the tree of a mesh.
    #[must_use]
    pub fn new(mesh: &'m Mesh) -> Self {
        let centre_mm = if mesh.faces.is_empty() { Point3::origin() } else { Aabb::around(&mesh.vertices_mm).centre() };
        let around = |face: usize| {
            let corners = mesh.corners(face).map(|corner| single(&(corner - centre_mm)));
            Box3::from_points(corners)
        };
        let boxes: Vec<Box3> = (0..mesh.faces.len()).map(around).collect();
        Self { mesh, centre_mm, tree: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes) }
    }

    /// The mesh that is asked.
    #[must_use]
    pub fn mesh(&self) -> &'m Mesh {
        self.mesh
    }

    /// Nearest point within `max_mm` of a point. Of two triangles that are equally far, either may be named.
    #[must_use]
    pub fn nearest(&self, point_mm: &Point3<f64>, max_mm: f64) -> Option<NearestPoint> {
        let at = single(&(point_mm - self.centre_mm));
        if !(at.x.is_finite() && at.y.is_finite() && at.z.is_finite()) {
            return None;
        }
        // The boxes are rounded to single precision: a little more is allowed than is asked for.
        let limit = (max_mm * (1.0 + 1e-6) + 1e-3).min(f64::from(f32::MAX)) as f32;
        let (face, _) = self.tree.find_best(
            limit,
            |node, _| box_distance(&node.aabb(), at),
            |face, _| Some(self.on_face(face, point_mm).1 as f32),
        )?;
        let (found, distance_mm) = self.on_face(face, point_mm);
        (distance_mm <= max_mm).then_some(found)
    }

    /// Nearest point of one triangle, and its distance.
    fn on_face(&self, face: u32, point_mm: &Point3<f64>) -> (NearestPoint, f64) {
        let (nearest_mm, is_inside) = nearest_of_triangle(&self.mesh.corners(face as usize), point_mm);
        (NearestPoint { face, point_mm: nearest_mm, is_inside }, (point_mm - nearest_mm).norm())
    }
}

/// Distance of a point to a box, 0 inside.
fn box_distance(around: &Box3, point: Vec3) -> f32 {
    let axis = |low: f32, high: f32, value: f32| (low - value).max(value - high).max(0.0);
    let x = axis(around.mins.x, around.maxs.x, point.x);
    let y = axis(around.mins.y, around.maxs.y, point.y);
    let z = axis(around.mins.z, around.maxs.z, point.z);
    (x * x + y * y + z * z).sqrt()
}

fn single(offset: &Vector3<f64>) -> Vec3 {
    Vec3::new(offset.x as f32, offset.y as f32, offset.z as f32)
}

/// Nearest point of a triangle; true where it lies inside.
#[must_use]
pub fn nearest_of_triangle([a, b, c]: &[Point3<f64>; 3], p: &Point3<f64>) -> (Point3<f64>, bool) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (*a, false);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return (*b, false);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (a + ab * (d1 / (d1 - d3)), false);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return (*c, false);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (a + ac * (d2 / (d2 - d6)), false);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return (b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))), false);
    }
    let share = 1.0 / (va + vb + vc);
    (a + ab * (vb * share) + ac * (vc * share), true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::demo_parts::figurine;

    #[test]
    fn the_tree_finds_what_the_loop_over_all_triangles_finds() {
        let mesh = figurine(8_000).expect("a figurine");
        let nearest = NearestFace::new(&mesh);
        let mut state = 7_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1 << 24) - 0.5
        };
        for _ in 0..300 {
            let point = Point3::new(120.0 * next(), 120.0 * next(), 75.0 + 180.0 * next());
            let slow = (0..mesh.faces.len() as u32).map(|face| nearest.on_face(face, &point).1).fold(f64::INFINITY, f64::min);
            let found = nearest.nearest(&point, 1e3).expect("a face");
            assert!(((found.point_mm - point).norm() - slow).abs() < 1e-4, "{point}");
            assert_eq!(nearest.nearest(&point, slow * 0.99 - 1e-3).map(|_| ()), None);
        }
        assert_eq!(nearest.nearest(&Point3::new(f64::NAN, 0.0, 0.0), 1.0), None);
    }
}
