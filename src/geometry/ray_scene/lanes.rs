//! Sixteen numbers side by side, one a ray, and the arithmetic of the kernels: plain loops and branch-free choices, which
//! the compiler turns into vector instructions.

#![expect(clippy::needless_range_loop, reason = "a lane or a slot runs through several arrays at once")]

pub(super) use crate::geometry::simd::{simd_from_fn, simd_max, simd_min};

/// Rays of a packet.
pub(super) const LANES: usize = 16;

/// One number a ray.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Lanes(pub(super) [f32; LANES]);

impl Lanes {
    /// The result of `of_two` over all lanes, which may not depend on their order.
    #[inline(always)]
    pub(super) fn over_all(&self, of_two: impl Fn(f32, f32) -> f32) -> f32 {
        let (mut eight, mut four) = ([0.0; 8], [0.0; 4]);
        for lane in 0..8 {
            eight[lane] = of_two(self.0[lane], self.0[lane + 8]);
        }
        for lane in 0..4 {
            four[lane] = of_two(eight[lane], eight[lane + 4]);
        }
        of_two(of_two(four[0], four[2]), of_two(four[1], four[3]))
    }
}

/// Lists the lanes set in `lanes`.
#[inline(always)]
pub(super) fn each(mut lanes: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = lanes.trailing_zeros() as usize % LANES;
        let some = lanes != 0;
        lanes &= lanes.wrapping_sub(1);
        some.then_some(lane)
    })
}

#[inline(always)]
pub(super) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(super) fn minus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
