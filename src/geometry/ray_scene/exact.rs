//! One segment: boxes in f32, grown beyond every rounding, so that they hide no triangle; triangles in f64 after Woop,
//! Benthin and Wald (2013), *Watertight Ray/Triangle Intersection*, JCGT 2(1), section 3.

use nalgebra::{Point3, Vector3};

use super::lanes::{simd_from_fn, simd_max, simd_min};
use super::origin::{Origin, inverse};
use super::tree::{BLOCK, Block, Node};

/// A segment with what the tests need of it.
pub(super) struct Segment {
    origin: Point3<f64>,
    end: f64,
    axes: [usize; 3],
    shear: Vector3<f64>,
    boxes: Boxes,
}

/// Values that the tests of boxes need.
struct Boxes {
    origin: Origin,
    /// Axis by axis whether the direction is negative, and its inverse.
    descend: [bool; 3],
    inverse: [f32; 3],
    end: f32,
}

impl Segment {
    /// `origin + t·direction`, 0 < t < `end`, through a tree without coordinates beyond `reach`.
    pub(super) fn new(origin: Point3<f64>, direction: Vector3<f64>, end: f64, reach: f32) -> Self {
        let kz = direction.iamax();
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        let shear = Vector3::new(direction[kx] / direction[kz], direction[ky] / direction[kz], 1.0 / direction[kz]);
        let descend = simd_from_fn(|axis| direction[axis] < 0.0);
        let boxes = Boxes {
            origin: Origin::new(&origin, reach),
            descend,
            inverse: simd_from_fn(|axis| inverse(direction[axis] as f32, descend[axis])),
            end: (end as f32).min(f32::MAX).next_up(),
        };
        Self { origin, end, axes: [kx, ky, kz], shear, boxes }
    }

    /// Children whose boxes it meets, as bits.
    pub(super) fn meets_children(&self, node: &Node) -> u32 {
        self.boxes.met(|axis| (&node.planes[axis], &node.planes[axis + 3]))
    }

    /// Triangles whose boxes around the corners it meets, as bits.
    pub(super) fn meets_slots(&self, block: &Block) -> u32 {
        let (mut lower, mut upper) = (block.corners[0], block.corners[0]);
        for corner in [1, 2] {
            for axis in 0..3 {
                for slot in 0..BLOCK {
                    let x = block.corners[corner][axis][slot];
                    lower[axis][slot] = simd_min(x, lower[axis][slot]);
                    upper[axis][slot] = simd_max(x, upper[axis][slot]);
                }
            }
        }
        self.boxes.met(|axis| (&lower[axis], &upper[axis])) & ((1 << block.count) - 1)
    }

    /// Woop's test: translate to the origin, shear the direction onto z, sign of the three edge functions.
    pub(super) fn meets_triangle(&self, corners: &[Point3<f64>; 3]) -> bool {
        let [kx, ky, kz] = self.axes;
        let sheared = |corner: usize| {
            let p = corners[corner] - self.origin;
            Vector3::new(p[kx] - self.shear.x * p[kz], p[ky] - self.shear.y * p[kz], p[kz])
        };
        let [a, b, c] = [sheared(0), sheared(1), sheared(2)];
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

impl Boxes {
    /// Boxes of `N` that are met, as bits, given the lower and the upper planes along an axis.
    #[inline(always)]
    fn met<'a, const N: usize>(&self, planes: impl Fn(usize) -> (&'a [f32; N], &'a [f32; N])) -> u32 {
        let (mut enter, mut leave) = ([0.0_f32; N], [self.end; N]);
        for axis in 0..3 {
            let ((lower, upper), [below, above]) = (planes(axis), self.origin.padded[axis]);
            let (near, far) =
                if self.descend[axis] { ((upper, above), (lower, below)) } else { ((lower, below), (upper, above)) };
            let (first, inverse) = (self.origin.parts[axis][0], self.inverse[axis]);
            for i in 0..N {
                // What overflows f32 becomes NaN, which is neither greater nor less: it hides nothing.
                enter[i] = simd_max((near.0[i] - first - near.1) * inverse, enter[i]);
                leave[i] = simd_min((far.0[i] - first - far.1) * inverse, leave[i]);
            }
        }
        let mut met = 0;
        for i in 0..N {
            met |= u32::from(enter[i] <= leave[i]) << i;
        }
        met
    }
}
