//! Sorts rays from one point into packets whose rays point into one octant, so that the near and the far planes of a box
//! are the same for all of them. Neighbours that agree go together at once; the others wait for their like.

#![expect(clippy::needless_range_loop, reason = "a lane or a slot runs through several arrays at once")]

use nalgebra::Vector3;

use super::lanes::{LANES, Lanes};

const OCTANTS: usize = 8;

/// The packets of `rays`.
pub(super) struct Packets<'a, R, D> {
    rays: &'a [R],
    direction: D,
    /// Rays read so far.
    read: usize,
    /// The last ones read, and how many of them are sorted.
    last: Rays,
    sorted: usize,
    waiting: [Rays; OCTANTS],
}

impl<'a, R: Copy, D: Fn(&R) -> Vector3<f64>> Packets<'a, R, D> {
    #[inline(always)]
    pub(super) fn new(rays: &'a [R], direction: D) -> Self {
        Self { rays, direction, read: 0, last: Rays::EMPTY, sorted: 0, waiting: [const { Rays::EMPTY }; OCTANTS] }
    }

    /// The next packet, full but for the last of each octant.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<Rays> {
        loop {
            while self.sorted < self.last.count {
                let lane = self.sorted;
                self.sorted += 1;
                // A direction that is not finite has no octant, and no hit.
                let Some(octant) = self.waiting.get_mut(self.last.octant[lane] as usize) else { continue };
                octant.push(&self.last, lane);
                if octant.count == LANES {
                    return Some(octant.take());
                }
            }
            if !self.read_on() {
                return self.waiting.iter_mut().find(|octant| octant.count > 0).map(Rays::take);
            }
            if self.last.share_octant() {
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
                let padded = std::array::from_fn(|lane| rest.get(lane).copied().unwrap_or(first));
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
    /// One bit an axis, set where the direction is negative; [`OCTANTS`] where it is not finite.
    octant: [u32; LANES],
}

impl Rays {
    const EMPTY: Self = Self { count: 0, number: [0; LANES], direction: [Lanes([0.0; LANES]); 3], octant: [0; LANES] };

    /// Whether the rays descend along `axis`.
    #[inline(always)]
    pub(super) fn descend(&self, axis: usize) -> bool {
        self.octant[0] >> axis & 1 == 1
    }

    /// The first `count` of `rays`, numbered from `first`.
    #[inline(always)]
    fn gather<R>(first: usize, rays: &[R; LANES], count: usize, direction: &impl Fn(&R) -> Vector3<f64>) -> Self {
        let mut gathered = Self { count, ..Self::EMPTY };
        for lane in 0..LANES {
            let d = direction(&rays[lane]).map(|d| d as f32);
            gathered.number[lane] = (first + lane) as u32;
            for axis in 0..3 {
                gathered.direction[axis].0[lane] = d[axis];
            }
            let octant = u32::from(d.x < 0.0) | u32::from(d.y < 0.0) << 1 | u32::from(d.z < 0.0) << 2;
            let finite = d.x.abs() + d.y.abs() + d.z.abs() <= f32::MAX;
            gathered.octant[lane] = if finite { octant } else { OCTANTS as u32 };
        }
        gathered
    }

    /// Whether the packet is full and of one octant.
    #[inline(always)]
    fn share_octant(&self) -> bool {
        let first = self.octant[0];
        let differences = self.octant.iter().fold(first >> 3, |differences, &octant| differences | (octant ^ first));
        self.count == LANES && differences == 0
    }

    /// What waits here, which then is empty.
    #[inline(always)]
    fn take(&mut self) -> Self {
        let rays = *self;
        self.count = 0;
        rays
    }

    #[inline(always)]
    fn push(&mut self, from: &Self, lane: usize) {
        self.number[self.count] = from.number[lane];
        self.octant[self.count] = from.octant[lane];
        for axis in 0..3 {
            self.direction[axis].0[self.count] = from.direction[axis].0[lane];
        }
        self.count += 1;
    }
}
