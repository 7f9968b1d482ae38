//! Sixteen rays from one point against a box, and against the triangles of a block, in f32 relative to that point.
//!
//! What depends on the point alone (normals of the planes through it and an edge) is computed once a packet; a ray then
//! costs four products a triangle. An edge test is the volume of ray and edge, taken as edge × sum of its ends, so that
//! two triangles see their common edge with exactly opposite signs and no ray slips between them, and so that it errs by
//! 9 roundings (2⁻²⁴) of the distance to the point at most, whatever the size of the triangle.

#![expect(clippy::needless_range_loop, reason = "a lane or a slot runs through several arrays at once")]

use super::gather::Rays;
use super::lanes::{LANES, Lanes, cross, dot, each, greatest, least, minus, plus};
use super::tree::{BLOCK, Block};

/// Directions count as this long at least along every axis, so that they have a finite inverse; over 10⁵ mm that moves a
/// ray by 10⁻¹³ mm.
const LEAST_COMPONENT: f32 = 1e-18;
/// Up to so many rays are bounded and tested one by one, not all sixteen at once.
const FEW: u32 = 5;
const SIGN: u32 = 1 << 31;
/// End of a lane without a ray, or without need of one: before every box and triangle.
pub(super) const RETIRED: f32 = -1.0;
/// No triangle yet.
pub(super) const NONE: u32 = u32::MAX;

/// The rays while they are traced.
pub(super) struct Packet {
    direction: [Lanes; 3],
    inverse: [Lanes; 3],
    /// The least and the greatest of `inverse`.
    inverse_range: [[f32; 2]; 3],
    /// Where the ray ends: its first hit so far; [`RETIRED`] when it needs no more.
    pub(super) end: Lanes,
    /// The greatest of `end`.
    pub(super) furthest: f32,
    /// Axis by axis whether the rays descend, and so meet the upper plane of a box first.
    pub(super) descend: [bool; 3],
    /// What each ray meets at `end`, or [`NONE`].
    pub(super) triangle: [u32; LANES],
}

impl Packet {
    /// `rays` as far as `end`.
    #[inline(always)]
    pub(super) fn new(rays: &Rays, end: f32) -> Self {
        let mut packet = Self {
            direction: rays.direction,
            inverse: rays.direction,
            inverse_range: [[0.0; 2]; 3],
            end: Lanes([end; LANES]),
            furthest: end,
            descend: std::array::from_fn(|axis| rays.descend(axis)),
            triangle: [NONE; LANES],
        };
        for lane in rays.count..LANES {
            packet.end.0[lane] = RETIRED;
            for axis in 0..3 {
                packet.direction[axis].0[lane] = rays.direction[axis].0[0];
            }
        }
        for axis in 0..3 {
            let sign = if packet.descend[axis] { -1.0_f32 } else { 1.0 };
            for lane in 0..LANES {
                let length = packet.direction[axis].0[lane].abs();
                packet.inverse[axis].0[lane] = sign / if length > LEAST_COMPONENT { length } else { LEAST_COMPONENT };
            }
            packet.inverse_range[axis] = [packet.inverse[axis].over_all(least), packet.inverse[axis].over_all(greatest)];
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
                range[axis] = [least(inverse, range[axis][0]), greatest(inverse, range[axis][1])];
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
            let enter = greatest(greatest(near[0] * x, near[1] * y), greatest(near[2] * z, 0.0));
            let leave = least(least(far[0] * x, far[1] * y), least(far[2] * z, self.end.0[lane]));
            lanes |= u32::from(enter <= leave) << lane;
        }
        lanes
    }

    #[inline(always)]
    fn direction_of(&self, lane: usize) -> [f32; 3] {
        [self.direction[0].0[lane], self.direction[1].0[lane], self.direction[2].0[lane]]
    }

    /// Takes what `lanes`, and perhaps others, hit of a block; with `ANY_HIT` a ray is done with its first hit, wherever
    /// that is.
    #[inline(always)]
    pub(super) fn meet<const ANY_HIT: bool>(&mut self, block: &Block, origin: &[[f32; 2]; 3], lanes: u32) {
        let seen = Seen::from(block, origin);
        if lanes.count_ones() > FEW {
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
        let (normals, offset) = (seen.normals_of(slot), seen.offset[slot]);
        let (mut any, mut end, mut triangle) = (0, self.end, self.triangle);
        for lane in 0..LANES {
            let crossing = crossing(self.direction_of(lane), &normals, offset);
            let hit = crossing.hits::<ANY_HIT>(number, end.0[lane], triangle[lane]);
            any |= u32::from(hit);
            end.0[lane] = if hit { crossing.new_end::<ANY_HIT>() } else { end.0[lane] };
            triangle[lane] = if hit { number } else { triangle[lane] };
        }
        if any != 0 {
            (self.end, self.triangle) = (end, triangle);
            self.furthest = end.over_all(greatest);
        }
    }

    /// Takes what one ray hits of a block.
    #[inline(always)]
    fn meet_block<const ANY_HIT: bool>(&mut self, seen: &Seen, block: &Block, lane: usize) {
        let direction = self.direction_of(lane);
        let (end, triangle) = (self.end.0[lane], self.triangle[lane]);
        let mut crossings = [Crossing { height: 0.0, descent: 0.0 }; BLOCK];
        let mut any = 0;
        for slot in 0..BLOCK {
            crossings[slot] = crossing(direction, &seen.normals_of(slot), seen.offset[slot]);
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
        self.furthest = self.end.over_all(greatest);
    }
}

/// The triangles of a block as seen from the origin.
struct Seen {
    /// Normals of the planes through the origin and an edge, three a triangle, then the triangle's own normal.
    normals: [[[f32; BLOCK]; 3]; 4],
    /// Of the triangle's plane from the origin, times the length of its normal.
    offset: [f32; BLOCK],
}

impl Seen {
    #[inline(always)]
    fn from(block: &Block, origin: &[[f32; 2]; 3]) -> Self {
        let mut seen = Self { normals: [[[0.0; BLOCK]; 3]; 4], offset: [0.0; BLOCK] };
        for slot in 0..BLOCK {
            let corner = |corner: usize| -> [f32; 3] {
                std::array::from_fn(|axis| block.corners[corner][axis][slot] - origin[axis][0] - origin[axis][1])
            };
            let [a, b, c] = [corner(0), corner(1), corner(2)];
            let [ab, bc, ca] = [minus(b, a), minus(c, b), minus(a, c)];
            let normals = [cross(bc, plus(c, b)), cross(ca, plus(a, c)), cross(ab, plus(b, a)), cross(ab, ca)];
            for (edge, normal) in normals.into_iter().enumerate() {
                for axis in 0..3 {
                    seen.normals[edge][axis][slot] = normal[axis];
                }
            }
            seen.offset[slot] = dot(a, normals[3]);
        }
        seen
    }

    #[inline(always)]
    fn normals_of(&self, slot: usize) -> [[f32; 3]; 4] {
        std::array::from_fn(|edge| std::array::from_fn(|axis| self.normals[edge][axis][slot]))
    }
}

/// How high the origin stands over a triangle, and how far the direction descends to it: the ray hits at their ratio.
/// The height is negative when it misses.
#[derive(Clone, Copy)]
struct Crossing {
    height: f32,
    descent: f32,
}

#[inline(always)]
fn crossing(direction: [f32; 3], [u, v, w, normal]: &[[f32; 3]; 4], offset: f32) -> Crossing {
    let (u, v, w) = (dot(direction, *u), dot(direction, *v), dot(direction, *w));
    let inside = (least(least(u, v), w) >= 0.0) | (greatest(greatest(u, v), w) <= 0.0);
    let descent = dot(direction, *normal);
    let height = f32::from_bits(offset.to_bits() ^ (descent.to_bits() & SIGN));
    Crossing { height: if inside { height } else { -1.0 }, descent: descent.abs() }
}

impl Crossing {
    /// Whether this is a hit of triangle `number` before the one at `end`. Of two at the same place the lower number
    /// counts, so that the answer does not depend on who was asked first.
    #[inline(always)]
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
