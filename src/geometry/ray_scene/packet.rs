//! Sixteen rays from one point against a box, and against the triangles of a block, in f32 relative to that point.
//!
//! The triangle test is that of [`super::exact`] (Woop, Benthin and Wald 2013): corners are sheared along the ray's longest
//! axis, and a corner moves by the same roundings in every triangle that has it, so that no ray slips between neighbours;
//! a sheared corner is off by 3 roundings (2⁻²⁴) of the distance to the point at most. Where the ray hits is taken from
//! the triangle's plane, whose normal and distance are computed once a packet.

#![expect(clippy::needless_range_loop, reason = "a lane or a slot runs through several arrays at once")]

use super::gather::Rays;
use super::lanes::{LANES, Lanes, cross, dot, each, minus, simd_from_fn, simd_max, simd_min};
use super::origin::inverse;
use super::tree::{BLOCK, Block};

/// Number of rays up to which they are bounded one by one, not all sixteen at once.
const FEW: u32 = 5;
const SIGN: u32 = 1 << 31;
/// End of a lane without a ray, or without need of one: before every box and triangle.
pub(super) const RETIRED: f32 = -1.0;
/// Index of a ray that has met no triangle yet.
pub(super) const NONE: u32 = u32::MAX;

/// The rays while they are traced.
pub(super) struct Packet {
    /// Directions in the order of `axes`.
    direction: [Lanes; 3],
    /// Shear: travel of the rays along the first two of `axes` for one along the third.
    shear: [Lanes; 2],
    /// The axis along which every ray is longest comes last.
    axes: [usize; 3],
    inverse: [Lanes; 3],
    /// The least and the greatest of `inverse`.
    inverse_range: [[f32; 2]; 3],
    /// End of each ray: its first hit so far; [`RETIRED`] when it needs no more.
    pub(super) end: Lanes,
    /// The greatest of `end`.
    pub(super) furthest: f32,
    /// Axis by axis whether the rays descend, and so meet the upper plane of a box first.
    pub(super) descend: [bool; 3],
    /// Triangle that each ray meets at `end`, or [`NONE`].
    pub(super) triangle: [u32; LANES],
}

impl Packet {
    /// `rays` as far as `end`.
    #[inline(always)]
    pub(super) fn new(rays: &Rays, end: f32) -> Self {
        let longest = rays.longest();
        let axes = [(longest + 1) % 3, (longest + 2) % 3, longest];
        let mut directions = rays.direction;
        let mut packet = Self {
            direction: rays.direction,
            shear: [Lanes([0.0; LANES]); 2],
            axes,
            inverse: rays.direction,
            inverse_range: [[0.0; 2]; 3],
            end: Lanes([end; LANES]),
            furthest: end,
            descend: simd_from_fn(|axis| rays.descend(axis)),
            triangle: [NONE; LANES],
        };
        for lane in rays.count..LANES {
            packet.end.0[lane] = RETIRED;
            for axis in 0..3 {
                directions[axis].0[lane] = rays.direction[axis].0[0];
            }
        }
        for axis in 0..3 {
            for lane in 0..LANES {
                packet.inverse[axis].0[lane] = inverse(directions[axis].0[lane], packet.descend[axis]);
            }
            packet.inverse_range[axis] = [packet.inverse[axis].over_all(simd_min), packet.inverse[axis].over_all(simd_max)];
        }
        for (place, axis) in axes.into_iter().enumerate() {
            packet.direction[place] = directions[axis];
        }
        for place in 0..2 {
            for lane in 0..LANES {
                packet.shear[place].0[lane] = packet.direction[place].0[lane] / packet.direction[2].0[lane];
            }
        }
        packet
    }

    /// The least and the greatest inverse direction among `lanes`.
    #[inline(always)]
    pub(super) fn range_of(&self, lanes: u32) -> [[f32; 2]; 3] {
        if lanes.count_ones() > FEW {
            return self.inverse_range;
        }
        let mut range = [[f32::INFINITY, f32::NEG_INFINITY]; 3];
        for lane in each(lanes) {
            for axis in 0..3 {
                let inverse = self.inverse[axis].0[lane];
                range[axis] = [simd_min(inverse, range[axis][0]), simd_max(inverse, range[axis][1])];
            }
        }
        range
    }

    /// Rays that meet the box, as bits.
    #[inline(always)]
    pub(super) fn meets_box(&self, near: [f32; 3], far: [f32; 3]) -> u32 {
        let mut lanes = 0;
        for lane in 0..LANES {
            let [x, y, z] = [self.inverse[0].0[lane], self.inverse[1].0[lane], self.inverse[2].0[lane]];
            let enter = simd_max(simd_max(near[0] * x, near[1] * y), simd_max(near[2] * z, 0.0));
            let leave = simd_min(simd_min(far[0] * x, far[1] * y), simd_min(far[2] * z, self.end.0[lane]));
            lanes |= u32::from(enter <= leave) << lane;
        }
        lanes
    }

    #[inline(always)]
    fn ray(&self, lane: usize) -> Ray {
        Ray {
            direction: [self.direction[0].0[lane], self.direction[1].0[lane], self.direction[2].0[lane]],
            shear: [self.shear[0].0[lane], self.shear[1].0[lane]],
        }
    }

    /// Takes what `lanes`, and perhaps others, hit of a block; with `ANY_HIT` a ray is done with its first hit, wherever
    /// that is. All rays are held against each triangle, or each ray against all triangles, whichever are fewer.
    #[inline(always)]
    pub(super) fn meet<const ANY_HIT: bool>(&mut self, block: &Block, origin: &[[f32; 2]; 3], lanes: u32) {
        let seen = Seen::from(block, origin, self.axes);
        if lanes.count_ones() > block.count {
            for slot in 0..(block.count as usize).min(BLOCK) {
                self.meet_triangle::<ANY_HIT>(&seen, slot, block.first + slot as u32);
            }
        } else {
            for lane in each(lanes) {
                self.meet_block::<ANY_HIT>(&seen, block, lane);
            }
        }
    }

    /// Takes what all rays hit of one triangle.
    #[inline(always)]
    fn meet_triangle<const ANY_HIT: bool>(&mut self, seen: &Seen, slot: usize, number: u32) {
        let seen_triangle = seen.triangle(slot);
        let (mut any, mut end, mut triangle) = (0, self.end, self.triangle);
        for lane in 0..LANES {
            let crossing = self.ray(lane).crossing(&seen_triangle);
            let hit = crossing.hits::<ANY_HIT>(number, end.0[lane], triangle[lane]);
            any |= u32::from(hit);
            end.0[lane] = if hit { crossing.new_end::<ANY_HIT>() } else { end.0[lane] };
            triangle[lane] = if hit { number } else { triangle[lane] };
        }
        if any != 0 {
            (self.end, self.triangle) = (end, triangle);
            self.furthest = end.over_all(simd_max);
        }
    }

    /// Takes what one ray hits of a block.
    #[inline(always)]
    fn meet_block<const ANY_HIT: bool>(&mut self, seen: &Seen, block: &Block, lane: usize) {
        let ray = self.ray(lane);
        let (end, triangle) = (self.end.0[lane], self.triangle[lane]);
        let mut crossings = [Crossing { height: 0.0, descent: 0.0 }; BLOCK];
        let mut any = 0;
        for slot in 0..BLOCK {
            crossings[slot] = ray.crossing(&seen.triangle(slot));
            any |= u32::from(crossings[slot].hits::<ANY_HIT>(block.first + slot as u32, end, triangle));
        }
        if any == 0 {
            return;
        }
        for (number, crossing) in (block.first..).zip(crossings) {
            if crossing.hits::<ANY_HIT>(number, self.end.0[lane], self.triangle[lane]) {
                self.end.0[lane] = crossing.new_end::<ANY_HIT>();
                self.triangle[lane] = number;
            }
        }
        self.furthest = self.end.over_all(simd_max);
    }
}

/// The triangles of a block as seen from the origin, axes in the order of the packet.
struct Seen {
    /// `corners[corner][axis][slot]`.
    corners: [[[f32; BLOCK]; 3]; 3],
    /// `normals[axis][slot]`.
    normals: [[f32; BLOCK]; 3],
    /// Height of the origin over the triangle's plane, times the length of its normal.
    height: [f32; BLOCK],
}

/// A triangle that was seen.
struct SeenTriangle {
    corners: [[f32; 3]; 3],
    normal: [f32; 3],
    height: f32,
}

impl Seen {
    #[inline(always)]
    fn from(block: &Block, origin: &[[f32; 2]; 3], axes: [usize; 3]) -> Self {
        let along = |corner: usize, place: usize| {
            // The bound is known, but not to the compiler.
            let axis = axes[place].min(2);
            let (corners, [first, second]) = (&block.corners[corner][axis], origin[axis]);
            simd_from_fn(|slot| corners[slot] - first - second)
        };
        let corners = simd_from_fn(|corner| simd_from_fn(|place| along(corner, place)));
        let (mut normals, mut height) = ([[0.0; BLOCK]; 3], [0.0; BLOCK]);
        for slot in 0..BLOCK {
            let [a, b, c] = simd_from_fn(|corner| corner_of(&corners[corner], slot));
            let normal = cross(minus(b, a), minus(c, a));
            height[slot] = dot(a, normal);
            for axis in 0..3 {
                normals[axis][slot] = normal[axis];
            }
        }
        Self { corners, normals, height }
    }

    #[inline(always)]
    fn triangle(&self, slot: usize) -> SeenTriangle {
        SeenTriangle {
            corners: simd_from_fn(|corner| corner_of(&self.corners[corner], slot)),
            normal: [self.normals[0][slot], self.normals[1][slot], self.normals[2][slot]],
            height: self.height[slot],
        }
    }
}

#[inline(always)]
fn corner_of(by_axis: &[[f32; BLOCK]; 3], slot: usize) -> [f32; 3] {
    [by_axis[0][slot], by_axis[1][slot], by_axis[2][slot]]
}

/// One ray, axes in the order of the packet.
struct Ray {
    direction: [f32; 3],
    shear: [f32; 2],
}

impl Ray {
    #[inline(always)]
    fn crossing(&self, triangle: &SeenTriangle) -> Crossing {
        let sheared = |[x, y, z]: [f32; 3]| [x - self.shear[0] * z, y - self.shear[1] * z];
        let [a, b, c] = triangle.corners;
        let (a, b, c) = (sheared(a), sheared(b), sheared(c));
        let (u, v, w) = (c[0] * b[1] - c[1] * b[0], a[0] * c[1] - a[1] * c[0], b[0] * a[1] - b[1] * a[0]);
        let inside = (simd_min(simd_min(u, v), w) >= 0.0) | (simd_max(simd_max(u, v), w) <= 0.0);
        let descent = dot(self.direction, triangle.normal);
        let height = f32::from_bits(triangle.height.to_bits() ^ (descent.to_bits() & SIGN));
        Crossing { height: if inside { height } else { -1.0 }, descent: descent.abs() }
    }
}

/// Height of the origin over a triangle, and descent of the direction to it: the ray hits at their ratio.
/// The height is negative when it misses.
#[derive(Clone, Copy)]
struct Crossing {
    height: f32,
    descent: f32,
}

impl Crossing {
    /// Returns true if this is a hit of triangle `number` before the one at `end`. Of two at the same place the lower number
    /// counts, so that the answer does not depend on who was asked first.
    #[inline(always)]
    #[expect(clippy::float_cmp, reason = "the same place is the same number")]
    fn hits<const ANY_HIT: bool>(self, number: u32, end: f32, triangle: u32) -> bool {
        if ANY_HIT {
            return (self.height > 0.0) & (self.height < end * self.descent);
        }
        let share = self.height / self.descent;
        (self.height > 0.0) & ((share < end) | ((share == end) & (number < triangle)))
    }

    #[inline(always)]
    fn new_end<const ANY_HIT: bool>(self) -> f32 {
        if ANY_HIT { RETIRED } else { self.height / self.descent }
    }
}
