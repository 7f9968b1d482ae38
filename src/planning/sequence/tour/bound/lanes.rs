//! The arithmetic of [`super::walks`]: times to the nodes of a group side by side, in single precision.
//!
//! Cost of a step from all groups to one: for each group and each set that matters of those that it remembers, its nodes from
//! which steps are left, an addition and a comparison of [`LANES`] each. Rows that differ in what does not matter are joined
//! first.

use super::memories::{FORBIDDEN, Memories};
use crate::geometry::{Kernel, SimdLevel, least};

/// Nodes side by side.
pub(super) const LANES: usize = 16;
/// Rows of lanes that a group's nodes take: 1, 2 or 4.
pub(super) const MOST_CHUNKS: usize = 4;
/// Sets for which there is room at once.
const FEW: usize = 128;
/// What it costs to look at a row, in additions to it.
const LOOK: usize = 3;

/// A row of times, where a load of all crosses no line of the cache.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Lanes(pub(super) [f32; LANES]);

pub(super) const NEVER: Lanes = Lanes([f32::INFINITY; LANES]);

impl Lanes {
    #[inline(always)]
    fn least(&self, other: &Self) -> Self {
        let mut now = *other;
        for lane in 0..LANES {
            // Adding nothing keeps the compiler from a store of some lanes alone, which the next load would have to wait for.
            now.0[lane] = least(self.0[lane], now.0[lane] + 0.0);
        }
        now
    }
}

/// The time to a node in rows of lanes.
#[inline(always)]
pub(super) fn at(rows: &[Lanes], node: usize) -> f32 {
    rows[node / LANES].0[node % LANES]
}

/// Steps between the nodes of each two groups.
#[derive(Clone)]
pub(super) struct Steps {
    pub(super) groups: usize,
    pub(super) chunks: usize,
    /// Where those from a group to a chunk of another begin; those to a group side by side, and those from a group to it.
    pub(super) first: Vec<u32>,
    /// The nodes that they are from, by their number in the group, ascending, …
    pub(super) from: Vec<u16>,
    /// … and the times to those of the chunk, infinite where there is none.
    pub(super) secs: Vec<Lanes>,
}

impl Steps {
    #[inline(always)]
    pub(super) fn to_chunk(&self, from: usize, to: usize, chunk: usize) -> std::ops::Range<usize> {
        let at = (to * self.groups + from) * self.chunks + chunk;
        self.first[at] as usize..self.first[at + 1] as usize
    }

    #[inline(always)]
    pub(super) fn between(&self, from: usize, to: usize) -> std::ops::Range<usize> {
        self.to_chunk(from, to, 0).start..self.to_chunk(from, to, self.chunks - 1).end
    }

    /// All to a group.
    pub(super) fn to(&self, to: usize) -> std::ops::Range<usize> {
        self.between(0, to).start..self.between(self.groups - 1, to).end
    }
}

/// Walks that end in a group: what it remembers of each, and the least times of those of whom it remembers the same.
#[derive(Clone, Default)]
pub(super) struct Ends {
    pub(super) sets: Vec<u16>,
    /// For each set the times to all nodes, infinite where there is no such node or walk.
    pub(super) secs: Vec<Lanes>,
    /// What they cost to find.
    pub(super) work: usize,
}

impl Ends {
    pub(super) fn rows(&self, chunks: usize) -> impl Iterator<Item = (u16, &[Lanes])> {
        self.sets.iter().copied().zip(self.secs.chunks_exact(chunks))
    }

    /// Joins those that differ in bits outside a mask; `bits` are those of a set.
    pub(super) fn joined(&self, mask: u16, bits: usize, chunks: usize, level: SimdLevel) -> Self {
        match chunks {
            1 => level.run(Join::<1> { ends: self, mask, bits }),
            2 => level.run(Join::<2> { ends: self, mask, bits }),
            _ => level.run(Join::<MOST_CHUNKS> { ends: self, mask, bits }),
        }
    }
}

/// No row yet.
const NONE: u16 = u16::MAX;

struct Join<'a, const CHUNKS: usize> {
    ends: &'a Ends,
    mask: u16,
    bits: usize,
}

impl<const CHUNKS: usize> Kernel for Join<'_, CHUNKS> {
    type Output = Ends;

    #[inline(always)]
    fn run(self) -> Ends {
        let most = self.ends.sets.len().min(1 << self.mask.count_ones());
        let mut joined = Ends { sets: Vec::with_capacity(most), secs: Vec::with_capacity(most * CHUNKS), work: 0 };
        let mut places = vec![NONE; 1 << self.bits];
        let (rows, _) = self.ends.secs.as_chunks::<CHUNKS>();
        for (set, row) in self.ends.sets.iter().zip(rows) {
            let set = set & self.mask;
            let place = &mut places[usize::from(set)];
            if *place == NONE {
                *place = joined.sets.len() as u16;
                joined.sets.push(set);
                joined.secs.extend_from_slice(row);
            } else {
                for (into, row) in joined.secs[usize::from(*place) * CHUNKS..][..CHUNKS].iter_mut().zip(row) {
                    *into = row.least(into);
                }
            }
        }
        joined.work = LOOK * CHUNKS * self.ends.sets.len();
        joined
    }
}

/// From all groups to one.
pub(super) struct Step<'a> {
    pub(super) steps: &'a Steps,
    pub(super) memories: &'a Memories,
    /// For each group its ends, joined by each of its masks.
    pub(super) joined: &'a [Vec<Ends>],
    pub(super) to: usize,
    pub(super) toll: f32,
    /// What it takes on home from there, see [`Open`], and the bits of its sets.
    pub(super) onward: Option<(&'a [Lanes], u16)>,
    /// Ends from where no walk home is within it are left out.
    pub(super) limit: f32,
}

/// What is done with walks to a group's nodes that go on to another group.
trait Visit<const CHUNKS: usize> {
    /// `place` numbers the sets that are remembered there, in the order that they come up.
    fn visit(&mut self, step: &Step<'_>, from: usize, place: usize, set: u16, so_far: &[Lanes; CHUNKS]);
}

impl Step<'_> {
    /// The walks one stop longer.
    pub(super) fn ends(&self, level: SimdLevel) -> Ends {
        match self.steps.chunks {
            1 => level.run(Advance::<1>(self)),
            2 => level.run(Advance::<2>(self)),
            _ => level.run(Advance::<MOST_CHUNKS>(self)),
        }
    }

    /// The least times of walks home by way of each step to the group, or those known if they are less.
    pub(super) fn by_way_of(&self, known: Vec<Lanes>, level: SimdLevel) -> Vec<Lanes> {
        match self.steps.chunks {
            1 => level.run(Mark::<1>(self, known)),
            2 => level.run(Mark::<2>(self, known)),
            _ => level.run(Mark::<MOST_CHUNKS>(self, known)),
        }
    }

    #[inline(always)]
    fn each<const CHUNKS: usize>(&self, visitor: &mut impl Visit<CHUNKS>) {
        let mut places = vec![NONE; 1 << self.memories.bits(self.to)];
        let mut count = 0;
        for (from, joined) in self.joined.iter().enumerate() {
            if self.steps.between(from, self.to).is_empty() {
                continue;
            }
            let pair = self.memories.pair(from, self.to);
            let ends = &joined[pair.mask];
            let (rows, _) = ends.secs.as_chunks();
            for (set, so_far) in ends.sets.iter().zip(rows) {
                let set = pair.passed_on(*set);
                if set < FORBIDDEN {
                    let place = &mut places[usize::from(set)];
                    if *place == NONE {
                        *place = count;
                        count += 1;
                    }
                    visitor.visit(self, from, usize::from(*place), set, so_far);
                }
            }
        }
    }
}

struct Advance<'a, const CHUNKS: usize>(&'a Step<'a>);

struct Advanced<const CHUNKS: usize> {
    sets: Vec<u16>,
    best: Vec<[Lanes; CHUNKS]>,
    work: usize,
}

impl<const CHUNKS: usize> Kernel for Advance<'_, CHUNKS> {
    type Output = Ends;

    #[inline(always)]
    fn run(self) -> Ends {
        let Self(step) = self;
        let mut advanced = Advanced { sets: Vec::with_capacity(FEW), best: Vec::with_capacity(FEW), work: 0 };
        step.each::<CHUNKS>(&mut advanced);
        let count = advanced.sets.len();
        let mut kept = Ends { sets: Vec::with_capacity(count), secs: Vec::with_capacity(count * CHUNKS), work: advanced.work };
        for (set, row) in advanced.sets.into_iter().zip(&mut advanced.best) {
            let mut nearest = NEVER;
            for (chunk, secs) in row.iter_mut().enumerate() {
                let mut whole = *secs;
                for lane in 0..LANES {
                    whole.0[lane] += step.toll;
                }
                *secs = whole;
                if let Some((onward, all)) = step.onward {
                    let on = &onward[usize::from(all & !set) * CHUNKS + chunk];
                    for lane in 0..LANES {
                        whole.0[lane] += on.0[lane];
                    }
                }
                nearest = whole.least(&nearest);
            }
            if step.onward.is_none() || nearest.0.into_iter().fold(f32::INFINITY, least) <= step.limit {
                kept.sets.push(set);
                kept.secs.extend_from_slice(row);
            }
        }
        kept
    }
}

impl<const CHUNKS: usize> Visit<CHUNKS> for Advanced<CHUNKS> {
    #[inline(always)]
    fn visit(&mut self, step: &Step<'_>, from: usize, place: usize, set: u16, so_far: &[Lanes; CHUNKS]) {
        if place == self.sets.len() {
            self.sets.push(set);
            self.best.push([NEVER; CHUNKS]);
        }
        self.work += LOOK + step.steps.between(from, step.to).len();
        for (chunk, best) in self.best[place].iter_mut().enumerate() {
            let range = step.steps.to_chunk(from, step.to, chunk);
            let mut now = *best;
            for (node, secs) in step.steps.from[range.clone()].iter().zip(&step.steps.secs[range]) {
                // The remainder tells the compiler that there is such a node.
                let so_far = at(so_far, usize::from(*node) % (LANES * CHUNKS));
                for lane in 0..LANES {
                    now.0[lane] = least(so_far + secs.0[lane], now.0[lane]);
                }
            }
            *best = now;
        }
    }
}

struct Mark<'a, const CHUNKS: usize>(&'a Step<'a>, Vec<Lanes>);

impl<const CHUNKS: usize> Kernel for Mark<'_, CHUNKS> {
    type Output = Vec<Lanes>;

    #[inline(always)]
    fn run(self) -> Vec<Lanes> {
        let Self(step, known) = self;
        let mut marked = Marked { first: step.steps.to(step.to).start, least: known };
        step.each::<CHUNKS>(&mut marked);
        marked.least
    }
}

struct Marked {
    first: usize,
    least: Vec<Lanes>,
}

impl<const CHUNKS: usize> Visit<CHUNKS> for Marked {
    #[inline(always)]
    fn visit(&mut self, step: &Step<'_>, from: usize, _: usize, set: u16, so_far: &[Lanes; CHUNKS]) {
        let Some((onward, all)) = step.onward else { return };
        let on = &onward[usize::from(all & !set) * CHUNKS..][..CHUNKS];
        for (chunk, on) in on.iter().enumerate() {
            let range = step.steps.to_chunk(from, step.to, chunk);
            let known = &mut self.least[range.start - self.first..range.end - self.first];
            let steps = step.steps.from[range.clone()].iter().zip(&step.steps.secs[range]);
            for ((node, secs), known) in steps.zip(known) {
                let so_far = at(so_far, usize::from(*node) % (LANES * CHUNKS)) + step.toll;
                let mut now = *known;
                for lane in 0..LANES {
                    now.0[lane] = least(so_far + secs.0[lane] + on.0[lane], now.0[lane]);
                }
                *known = now;
            }
        }
    }
}

/// Of ends in a group, for each set: the least times less the toll of those of which nothing outside it is remembered, and all
/// its landmarks.
pub(super) struct Open<'a> {
    pub(super) ends: &'a Ends,
    pub(super) bits: usize,
    pub(super) landmark_bits: usize,
    pub(super) chunks: usize,
    pub(super) toll: f32,
}

impl Kernel for Open<'_> {
    type Output = Vec<Lanes>;

    #[inline(always)]
    fn run(self) -> Vec<Lanes> {
        let mut open = vec![NEVER; self.chunks << self.bits];
        for (set, row) in self.ends.rows(self.chunks) {
            for (open, row) in open[usize::from(set) * self.chunks..].iter_mut().zip(row) {
                let mut secs = *row;
                for lane in 0..LANES {
                    secs.0[lane] -= self.toll;
                }
                *open = secs;
            }
        }
        for bit in self.landmark_bits..self.bits {
            let half = self.chunks << bit;
            for both in open.chunks_exact_mut(2 * half) {
                let (without, with) = both.split_at_mut(half);
                for (without, with) in without.iter().zip(with) {
                    *with = without.least(with);
                }
            }
        }
        open
    }
}
