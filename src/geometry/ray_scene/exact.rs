//! The f64 segment test: slabs widened against rounding, and triangles after Woop, Benthin and Wald (2013), *Watertight
//! Ray/Triangle Intersection*, JCGT 2(1), section 3.

use nalgebra::{Point3, Vector3};

use super::tree::{Node, WIDTH};

/// Widens a slab interval so that rounding never makes a box smaller: 1 + 2γ(3) for f64 (Ize 2013, *Robust BVH Ray
/// Traversal*, JCGT 2(2), section 3), rounded up.
const SLAB_WIDENING: f64 = 1.0 + 1e-15;

/// A segment with what the tests need of it.
pub(super) struct Segment {
    origin: Point3<f64>,
    inverse_direction: Vector3<f64>,
    end: f64,
    axes: [usize; 3],
    shear: Vector3<f64>,
}

impl Segment {
    /// `origin + t·direction`, 0 < t < `end`.
    pub(super) fn new(origin: Point3<f64>, direction: Vector3<f64>, end: f64) -> Self {
        let kz = direction.iamax();
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        let shear = Vector3::new(direction[kx] / direction[kz], direction[ky] / direction[kz], 1.0 / direction[kz]);
        // Less than infinity, where the boxes of absent children are.
        let end = end.min(f64::MAX);
        Self { origin, inverse_direction: direction.map(f64::recip), end, axes: [kx, ky, kz], shear }
    }

    /// Which children's boxes it meets, as bits.
    pub(super) fn meets_boxes(&self, node: &Node) -> u32 {
        let (mut near, mut far) = ([0.0_f64; WIDTH], [self.end; WIDTH]);
        for axis in 0..3 {
            let (origin, inverse) = (self.origin[axis], self.inverse_direction[axis]);
            for child in 0..WIDTH {
                let a = (f64::from(node.planes[axis][child]) - origin) * inverse;
                let b = (f64::from(node.planes[axis + 3][child]) - origin) * inverse;
                // 0 · ∞ is NaN when the origin lies on a slab's plane: min and max then keep the other operand.
                near[child] = near[child].max(a.min(b));
                far[child] = far[child].min(a.max(b) * SLAB_WIDENING);
            }
        }
        (0..WIDTH).filter(|&child| near[child] <= far[child]).fold(0, |bits, child| bits | 1 << child)
    }

    /// Woop's test: translate to the origin, shear the direction onto z, sign of the three edge functions.
    pub(super) fn meets_triangle(&self, corners: &[Point3<f64>; 3]) -> bool {
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
