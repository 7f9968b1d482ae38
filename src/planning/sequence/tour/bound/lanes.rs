//! The arithmetic of [`super::ng_routes`]: times to the nodes of a group side by side, in single precision.
//!
//! Cost of an extension from all groups to one: for each group and each memory that matters there, an addition and a
//! comparison of [`LANES`] for each of its nodes from which arcs are left. Labels that differ in what does not matter are merged
//! first.

use super::ng_sets::{CYCLE, NgSets};
use crate::geometry::{Kernel, SimdLevel, simd_min};

/// Nodes side by side.
pub(super) const LANES: usize = 16;
/// Rows of lanes that a group's nodes take: 1, 2 or 4.
pub(super) const MAX_CHUNKS: usize = 4;
/// Labels for which there is room from the start.
const INITIAL_CAPACITY: usize = 128;
/// Cost of visiting a row, in additions to it.
const VISIT_WORK: usize = 3;

/// A row of times, aligned so that a load of all of it crosses no line of the cache.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct LaneCosts(pub(super) [f32; LANES]);

/// Times to nodes that no route reaches.
pub(super) const INFINITE: LaneCosts = LaneCosts([f32::INFINITY; LANES]);

impl LaneCosts {
    #[inline(always)]
    fn min(&self, other: &Self) -> Self {
        let mut now = *other;
        for lane in 0..LANES {
            // Adding nothing keeps the compiler from a store of some lanes alone, which the next load would have to wait for.
            now.0[lane] = simd_min(self.0[lane], now.0[lane] + 0.0);
        }
        now
    }
}

/// The time to a node in rows of lanes.
#[inline(always)]
pub(super) fn at(rows: &[LaneCosts], node: usize) -> f32 {
    rows[node / LANES].0[node % LANES]
}

/// Arcs between the nodes of each two groups.
#[derive(Clone)]
pub(super) struct Arcs {
    pub(super) groups: usize,
    pub(super) chunks: usize,
    /// Index of the first arc from a group to a chunk of another. Arcs to one group stand side by side, in them those from one.
    pub(super) first: Vec<u32>,
    /// Tail of each arc: the number of its node in the group, ascending.
    pub(super) from: Vec<u16>,
    /// Times of each arc to the nodes of its chunk, infinite where the arc was eliminated.
    pub(super) secs: Vec<LaneCosts>,
}

impl Arcs {
    #[inline(always)]
    pub(super) fn to_chunk(&self, from: usize, to: usize, chunk: usize) -> std::ops::Range<usize> {
        let at = (to * self.groups + from) * self.chunks + chunk;
        self.first[at] as usize..self.first[at + 1] as usize
    }

    #[inline(always)]
    pub(super) fn between(&self, from: usize, to: usize) -> std::ops::Range<usize> {
        self.to_chunk(from, to, 0).start..self.to_chunk(from, to, self.chunks - 1).end
    }

    /// Arcs to a group.
    pub(super) fn to(&self, to: usize) -> std::ops::Range<usize> {
        self.between(0, to).start..self.between(self.groups - 1, to).end
    }
}

/// Labels of the partial routes that end in a group: one a memory, with the least times to all nodes.
#[derive(Clone, Default)]
pub(super) struct NgLabels {
    /// Memory of each label, a bit for each group of the ng-set.
    pub(super) sets: Vec<u16>,
    /// Times to all nodes for each memory, infinite where there is no such node or route.
    pub(super) secs: Vec<LaneCosts>,
    /// Cost of finding them.
    pub(super) work: usize,
}

impl NgLabels {
    pub(super) fn rows(&self, chunks: usize) -> impl Iterator<Item = (u16, &[LaneCosts])> {
        self.sets.iter().copied().zip(self.secs.chunks_exact(chunks))
    }

    /// Merges labels whose memories differ outside a mask only; `bits` is the size of the ng-set.
    pub(super) fn merged(&self, mask: u16, bits: usize, chunks: usize, level: SimdLevel) -> Self {
        match chunks {
            1 => level.run(Merge::<1> { labels: self, mask, bits }),
            2 => level.run(Merge::<2> { labels: self, mask, bits }),
            _ => level.run(Merge::<MAX_CHUNKS> { labels: self, mask, bits }),
        }
    }
}

/// Index that stands for no row yet.
const NONE: u16 = u16::MAX;

struct Merge<'a, const CHUNKS: usize> {
    labels: &'a NgLabels,
    mask: u16,
    bits: usize,
}

impl<const CHUNKS: usize> Kernel for Merge<'_, CHUNKS> {
    type Output = NgLabels;

    #[inline(always)]
    fn run(self) -> NgLabels {
        let capacity = self.labels.sets.len().min(1 << self.mask.count_ones());
        let mut merged = NgLabels { sets: Vec::with_capacity(capacity), secs: Vec::with_capacity(capacity * CHUNKS), work: 0 };
        let mut places = vec![NONE; 1 << self.bits];
        let (rows, _) = self.labels.secs.as_chunks::<CHUNKS>();
        for (set, row) in self.labels.sets.iter().zip(rows) {
            let set = set & self.mask;
            let place = &mut places[usize::from(set)];
            if *place == NONE {
                *place = merged.sets.len() as u16;
                merged.sets.push(set);
                merged.secs.extend_from_slice(row);
            } else {
                for (into, row) in merged.secs[usize::from(*place) * CHUNKS..][..CHUNKS].iter_mut().zip(row) {
                    *into = row.min(into);
                }
            }
        }
        merged.work = VISIT_WORK * CHUNKS * self.labels.sets.len();
        merged
    }
}

/// Extension of labels from all groups to one.
pub(super) struct Extension<'a> {
    pub(super) arcs: &'a Arcs,
    pub(super) ng_sets: &'a NgSets,
    /// Labels of each group, merged by each of its masks.
    pub(super) merged: &'a [Vec<NgLabels>],
    pub(super) to: usize,
    pub(super) multiplier: f32,
    /// Completion bounds from there ([`SubsetMinimum`]), and the bits of their sets.
    pub(super) completion: Option<(&'a [LaneCosts], u16)>,
    /// Labels that cannot be completed within this are pruned.
    pub(super) limit: f32,
}

/// Action on each label that is extended to another group.
trait Visit<const CHUNKS: usize> {
    /// Visits one label; `place` numbers the memories there in the order in which they come up.
    fn visit(&mut self, extension: &Extension<'_>, from: usize, place: usize, set: u16, so_far: &[LaneCosts; CHUNKS]);
}

impl Extension<'_> {
    /// Labels of the routes one stop longer.
    pub(super) fn labels(&self, level: SimdLevel) -> NgLabels {
        match self.arcs.chunks {
            1 => level.run(Extend::<1>(self)),
            2 => level.run(Extend::<2>(self)),
            _ => level.run(Extend::<MAX_CHUNKS>(self)),
        }
    }

    /// Minimum times of routes through each arc to the group, or those known where they are less.
    pub(super) fn through_arcs(&self, known: Vec<LaneCosts>, level: SimdLevel) -> Vec<LaneCosts> {
        match self.arcs.chunks {
            1 => level.run(ThroughArcs::<1>(self, known)),
            2 => level.run(ThroughArcs::<2>(self, known)),
            _ => level.run(ThroughArcs::<MAX_CHUNKS>(self, known)),
        }
    }

    #[inline(always)]
    fn each<const CHUNKS: usize>(&self, visitor: &mut impl Visit<CHUNKS>) {
        let mut places = vec![NONE; 1 << self.ng_sets.bits(self.to)];
        let mut count = 0;
        for (from, merged) in self.merged.iter().enumerate() {
            if self.arcs.between(from, self.to).is_empty() {
                continue;
            }
            let pair = self.ng_sets.pair(from, self.to);
            let labels = &merged[pair.mask];
            let (rows, _) = labels.secs.as_chunks();
            for (set, so_far) in labels.sets.iter().zip(rows) {
                let set = pair.extended(*set);
                if set < CYCLE {
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

struct Extend<'a, const CHUNKS: usize>(&'a Extension<'a>);

struct Extended<const CHUNKS: usize> {
    sets: Vec<u16>,
    best: Vec<[LaneCosts; CHUNKS]>,
    work: usize,
}

impl<const CHUNKS: usize> Kernel for Extend<'_, CHUNKS> {
    type Output = NgLabels;

    #[inline(always)]
    fn run(self) -> NgLabels {
        let Self(extension) = self;
        let mut extended =
            Extended { sets: Vec::with_capacity(INITIAL_CAPACITY), best: Vec::with_capacity(INITIAL_CAPACITY), work: 0 };
        extension.each::<CHUNKS>(&mut extended);
        let count = extended.sets.len();
        let mut kept =
            NgLabels { sets: Vec::with_capacity(count), secs: Vec::with_capacity(count * CHUNKS), work: extended.work };
        for (set, row) in extended.sets.into_iter().zip(&mut extended.best) {
            let mut min = INFINITE;
            for (chunk, secs) in row.iter_mut().enumerate() {
                let mut whole = *secs;
                for lane in 0..LANES {
                    whole.0[lane] += extension.multiplier;
                }
                *secs = whole;
                if let Some((completion, all)) = extension.completion {
                    let on = &completion[usize::from(all & !set) * CHUNKS + chunk];
                    for lane in 0..LANES {
                        whole.0[lane] += on.0[lane];
                    }
                }
                min = whole.min(&min);
            }
            if extension.completion.is_none() || min.0.into_iter().fold(f32::INFINITY, simd_min) <= extension.limit {
                kept.sets.push(set);
                kept.secs.extend_from_slice(row);
            }
        }
        kept
    }
}

impl<const CHUNKS: usize> Visit<CHUNKS> for Extended<CHUNKS> {
    #[inline(always)]
    fn visit(&mut self, extension: &Extension<'_>, from: usize, place: usize, set: u16, so_far: &[LaneCosts; CHUNKS]) {
        if place == self.sets.len() {
            self.sets.push(set);
            self.best.push([INFINITE; CHUNKS]);
        }
        self.work += VISIT_WORK + extension.arcs.between(from, extension.to).len();
        for (chunk, best) in self.best[place].iter_mut().enumerate() {
            let range = extension.arcs.to_chunk(from, extension.to, chunk);
            let mut now = *best;
            for (node, secs) in extension.arcs.from[range.clone()].iter().zip(&extension.arcs.secs[range]) {
                // The remainder tells the compiler that there is such a node.
                let so_far = at(so_far, usize::from(*node) % (LANES * CHUNKS));
                for lane in 0..LANES {
                    now.0[lane] = simd_min(so_far + secs.0[lane], now.0[lane]);
                }
            }
            *best = now;
        }
    }
}

struct ThroughArcs<'a, const CHUNKS: usize>(&'a Extension<'a>, Vec<LaneCosts>);

impl<const CHUNKS: usize> Kernel for ThroughArcs<'_, CHUNKS> {
    type Output = Vec<LaneCosts>;

    #[inline(always)]
    fn run(self) -> Vec<LaneCosts> {
        let Self(extension, known) = self;
        let mut through = ThroughTimes { first: extension.arcs.to(extension.to).start, known };
        extension.each::<CHUNKS>(&mut through);
        through.known
    }
}

struct ThroughTimes {
    first: usize,
    known: Vec<LaneCosts>,
}

impl<const CHUNKS: usize> Visit<CHUNKS> for ThroughTimes {
    #[inline(always)]
    fn visit(&mut self, extension: &Extension<'_>, from: usize, _: usize, set: u16, so_far: &[LaneCosts; CHUNKS]) {
        let Some((completion, all)) = extension.completion else { return };
        let on = &completion[usize::from(all & !set) * CHUNKS..][..CHUNKS];
        for (chunk, on) in on.iter().enumerate() {
            let range = extension.arcs.to_chunk(from, extension.to, chunk);
            let known = &mut self.known[range.start - self.first..range.end - self.first];
            let arcs = extension.arcs.from[range.clone()].iter().zip(&extension.arcs.secs[range]);
            for ((node, secs), known) in arcs.zip(known) {
                let so_far = at(so_far, usize::from(*node) % (LANES * CHUNKS)) + extension.multiplier;
                let mut now = *known;
                for lane in 0..LANES {
                    now.0[lane] = simd_min(so_far + secs.0[lane] + on.0[lane], now.0[lane]);
                }
                *known = now;
            }
        }
    }
}

/// Minimum over subsets: for each set of groups the least time, less the multiplier, of the labels whose memory lies within it
/// and holds all its critical groups.
pub(super) struct SubsetMinimum<'a> {
    pub(super) labels: &'a NgLabels,
    pub(super) bits: usize,
    pub(super) critical_bits: usize,
    pub(super) chunks: usize,
    pub(super) multiplier: f32,
}

impl Kernel for SubsetMinimum<'_> {
    type Output = Vec<LaneCosts>;

    #[inline(always)]
    fn run(self) -> Vec<LaneCosts> {
        let mut minimum = vec![INFINITE; self.chunks << self.bits];
        for (set, row) in self.labels.rows(self.chunks) {
            for (minimum, row) in minimum[usize::from(set) * self.chunks..].iter_mut().zip(row) {
                let mut secs = *row;
                for lane in 0..LANES {
                    secs.0[lane] -= self.multiplier;
                }
                *minimum = secs;
            }
        }
        for bit in self.critical_bits..self.bits {
            let half = self.chunks << bit;
            for both in minimum.chunks_exact_mut(2 * half) {
                let (without, with) = both.split_at_mut(half);
                for (without, with) in without.iter().zip(with) {
                    *with = without.min(with);
                }
            }
        }
        minimum
    }
}
