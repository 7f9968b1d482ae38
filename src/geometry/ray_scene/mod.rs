//! Decides whether a segment meets a surface: the any-hit query behind every visibility test.
//!
//! Triangles are two-sided. The tree is parry's, with boxes rounded outwards to f32; boxes and triangles are tested in
//! f64, the triangles watertight after Woop, Benthin and Wald (2013), *Watertight Ray/Triangle Intersection*, JCGT 2(1),
//! section 3, so that no ray slips between neighbours. A tree answers exactly as the plain loop over all triangles does,
//! since a box never hides a triangle that the loop would hit. Cost: O(log n) a query; 64 to 100 bytes a triangle.

use nalgebra::{Point3, Vector3};
use parry3d::bounding_volume::Aabb as ParryAabb;
use parry3d::math::Vector as ParryVector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy};

use super::mesh::{Aabb, Mesh};

#[cfg(test)]
mod tests;

/// Widens a slab interval so that rounding never makes a box smaller: 1 + 2γ(3) for f64 (Ize 2013, *Robust BVH Ray
/// Traversal*, JCGT 2(2), section 3), rounded up.
const SLAB_WIDENING: f64 = 1.0 + 1e-15;

/// Meshes as one set of triangles that segments may meet.
pub struct RayScene {
    bvh: Bvh,
    corners_mm: Vec<[Point3<f64>; 3]>,
}

/// A segment with what the tests need of it.
struct Segment {
    origin: Point3<f64>,
    inverse_direction: Vector3<f64>,
    end: f64,
    axes: [usize; 3],
    shear: Vector3<f64>,
}

impl Segment {
    /// `origin + t·direction`, 0 < t < `end`.
    fn new(origin: Point3<f64>, direction: Vector3<f64>, end: f64) -> Self {
        let kz = direction.iamax();
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        let shear = Vector3::new(direction[kx] / direction[kz], direction[ky] / direction[kz], 1.0 / direction[kz]);
        Self { origin, inverse_direction: direction.map(f64::recip), end, axes: [kx, ky, kz], shear }
    }

    fn meets_box(&self, min: Vector3<f64>, max: Vector3<f64>) -> bool {
        let (mut near, mut far) = (0.0_f64, self.end);
        for axis in 0..3 {
            let a = (min[axis] - self.origin[axis]) * self.inverse_direction[axis];
            let b = (max[axis] - self.origin[axis]) * self.inverse_direction[axis];
            // 0 · ∞ is NaN when the origin lies on a slab's plane: min and max then keep the other operand.
            near = near.max(a.min(b));
            far = far.min(a.max(b) * SLAB_WIDENING);
        }
        near <= far
    }

    /// Woop's test: translate to the origin, shear the direction onto z, sign of the three edge functions.
    fn meets_triangle(&self, corners: &[Point3<f64>; 3]) -> bool {
        let [kx, ky, kz] = self.axes;
        let [a, b, c] = corners.map(|corner| {
            let p = corner - self.origin;
            Vector3::new(p[kx] - self.shear.x * p[kz], p[ky] - self.shear.y * p[kz], p[kz])
        });
        let u = c.x * b.y - c.y * b.x;
        let v = a.x * c.y - a.y * c.x;
        let w = b.x * a.y - b.y * a.x;
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return false;
        }
        let determinant = u + v + w;
        if determinant == 0.0 {
            return false;
        }
        let t = self.shear.z * (u * a.z + v * b.z + w * c.z) / determinant;
        0.0 < t && t < self.end
    }
}

impl RayScene {
    /// A scene of all triangles of `meshes`, which share one frame.
    #[must_use]
    pub fn new<'a>(meshes: impl IntoIterator<Item = &'a Mesh>) -> Self {
        let corners_mm: Vec<_> =
            meshes.into_iter().flat_map(|mesh| (0..mesh.faces.len()).map(|face| mesh.corners(face))).collect();
        let boxes: Vec<_> = corners_mm.iter().map(outward_box).collect();
        Self { bvh: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes), corners_mm }
    }

    /// Whether a surface lies strictly between `from` and the point at `share` of the way to `to`.
    #[must_use]
    pub fn blocked(&self, from: &Point3<f64>, to: &Point3<f64>, share: f64) -> bool {
        let segment = Segment::new(*from, to - from, share);
        self.bvh
            .leaves(|node| segment.meets_box(widened(node.mins()), widened(node.maxs())))
            .any(|triangle| segment.meets_triangle(&self.corners_mm[triangle as usize]))
    }

    /// [`RayScene::blocked`] without the tree: the oracle of tests.
    #[must_use]
    pub fn blocked_brute_force(&self, from: &Point3<f64>, to: &Point3<f64>, share: f64) -> bool {
        let segment = Segment::new(*from, to - from, share);
        self.corners_mm.iter().any(|corners| segment.meets_triangle(corners))
    }

    /// All triangles, those near each other in space near each other in the list.
    #[must_use]
    pub fn leaf_order(&self) -> Vec<u32> {
        self.bvh.leaves(|_| true).collect()
    }

    /// Whether `point` lies inside the surface: most of three rays in unrelated directions cross it an odd number of
    /// times. Exact for closed surfaces; where a surface is open the majority decides.
    #[must_use]
    pub fn encloses(&self, point: &Point3<f64>) -> bool {
        const DIRECTIONS: [[f64; 3]; 3] = [[0.36, 0.48, 0.8], [-0.61, 0.27, 0.74], [0.19, -0.83, -0.52]];
        let odd = |direction: &[f64; 3]| {
            let segment = Segment::new(*point, Vector3::from(*direction), f64::INFINITY);
            let near = self.bvh.leaves(|node| segment.meets_box(widened(node.mins()), widened(node.maxs())));
            near.filter(|triangle| segment.meets_triangle(&self.corners_mm[*triangle as usize])).count() % 2 == 1
        };
        DIRECTIONS.iter().filter(|direction| odd(direction)).count() >= 2
    }
}

fn widened(v: ParryVector) -> Vector3<f64> {
    Vector3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z))
}

/// The f32 box around a triangle, each face moved to the next f32 outwards.
fn outward_box(corners: &[Point3<f64>; 3]) -> ParryAabb {
    let Aabb { min, max } = Aabb::around(corners);
    let down = |x: f64| (x as f32).next_down();
    let up = |x: f64| (x as f32).next_up();
    ParryAabb::new(ParryVector::new(down(min.x), down(min.y), down(min.z)), ParryVector::new(up(max.x), up(max.y), up(max.z)))
}
