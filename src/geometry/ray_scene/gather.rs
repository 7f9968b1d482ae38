//! Sorts rays from one point into packets of one kind: all point into one octant, so that the near and the far planes of
//! a box are the same for all, and are longest along one axis, which the test of a triangle singles out. Neighbours of
//! one kind go together at once; the others wait for their like.

#![expect(clippy::needless_range_loop, reason = "a lane or a slot runs through several arrays at once")]

use nalgebra::Vector3;

use super::lanes::{LANES, Lanes};

/// An octant and an axis.
const KINDS: usize = 24;

/// The packets of `rays`.
pub(super) struct Packets<'a, R, D> {
    rays: &'a [R],
    direction: D,
    /// Rays read so far.
    read: usize,
    /// The last ones read, and how many of them are sorted.
    last: Rays,
    sorted: usize,
    waiting: [Rays; KINDS],
}

impl<'a, R: Copy, D: Fn(&R) -> Vector3<f64>> Packets<'a, R, D> {
    #[inline(always)]
    pub(super) fn new(rays: &'a [R], direction: D) -> Self {
        Self { rays, direction, read: 0, last: Rays::EMPTY, sorted: 0, waiting: [const { Rays::EMPTY }; KINDS] }
    }

    /// The next packet, full but for the last of each kind.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<Rays> {
        loop {
            while self.sorted < self.last.count {
                let lane = self.sorted;
                self.sorted += 1;
                // A direction that is not finite is of no kind, and has no hit.
                let Some(like) = self.waiting.get_mut(self.last.kind[lane] as usize) else { continue };
                like.push(&self.last, lane);
                if like.count == LANES {
                    return Some(like.take());
                }
            }
            if !self.read_on() {
                return self.waiting.iter_mut().find(|like| like.count > 0).map(Rays::take);
            }
            if self.last.agree() {
                self.sorted = LANES;
                return Some(self.last);
            }
        }
    }

    /// Reads the next rays; false at their end.
    #[inline(always)]
    fn read_on(&mut self) -> bool {
        let rest = &self.rays[self.read..];
        let Some(&first) = rest.first() else { return false };
        self.last = match rest.first_chunk::<LANES>() {
            Some(full) => Rays::gather(self.read, full, LANES, &self.direction),
            None => {
                let mut padded = [first; LANES];
                padded[..rest.len()].copy_from_slice(rest);
                Rays::gather(self.read, &padded, rest.len(), &self.direction)
            }
        };
        self.read += self.last.count;
        self.sorted = 0;
        true
    }
}

/// Rays for one packet.
#[derive(Clone, Copy)]
pub(super) struct Rays {
    pub(super) count: usize,
    pub(super) number: [u32; LANES],
    pub(super) direction: [Lanes; 3],
    /// One bit an axis, set where the direction is negative, and eight times the longest axis; [`KINDS`] where the
    /// direction is not finite.
    kind: [u32; LANES],
}

impl Rays {
    const EMPTY: Self = Self { count: 0, number: [0; LANES], direction: [Lanes([0.0; LANES]); 3], kind: [0; LANES] };

    /// Returns true if the rays descend along `axis`.
    #[inline(always)]
    pub(super) fn descend(&self, axis: usize) -> bool {
        self.kind[0] >> axis & 1 == 1
    }

    /// The axis along which every ray is longest.
    #[inline(always)]
    pub(super) fn longest(&self) -> usize {
        self.kind[0] as usize / 8
    }

    /// The first `count` of `rays`, numbered from `first`.
    #[inline(always)]
    fn gather<R>(first: usize, rays: &[R; LANES], count: usize, direction: &impl Fn(&R) -> Vector3<f64>) -> Self {
        let mut gathered = Self { count, ..Self::EMPTY };
        for lane in 0..LANES {
            let d = direction(&rays[lane]);
            let d = Vector3::new(d.x as f32, d.y as f32, d.z as f32);
            gathered.number[lane] = (first + lane) as u32;
            for axis in 0..3 {
                gathered.direction[axis].0[lane] = d[axis];
            }
            let octant = u32::from(d.x < 0.0) | u32::from(d.y < 0.0) << 1 | u32::from(d.z < 0.0) << 2;
            let [x, y, z] = [d.x.abs(), d.y.abs(), d.z.abs()];
            let past_x = u32::from((x < y) | (x < z));
            let longest = past_x + (past_x & u32::from(y < z));
            let finite = x + y + z <= f32::MAX;
            gathered.kind[lane] = if finite { octant + 8 * longest } else { KINDS as u32 };
        }
        gathered
    }

    /// Returns true if the packet is full and of one kind.
    #[inline(always)]
    fn agree(&self) -> bool {
        let first = self.kind[0];
        let differences = self.kind.iter().fold(0, |differences, &kind| differences | (kind ^ first));
        self.count == LANES && differences == 0 && first != KINDS as u32
    }

    /// Takes the rays that wait here, which then are none.
    #[inline(always)]
    fn take(&mut self) -> Self {
        let rays = *self;
        self.count = 0;
        rays
    }

    #[inline(always)]
    fn push(&mut self, from: &Self, lane: usize) {
        self.number[self.count] = from.number[lane];
        self.kind[self.count] = from.kind[lane];
        for axis in 0..3 {
            self.direction[axis].0[self.count] = from.direction[axis].0[lane];
        }
        self.count += 1;
    }
}
