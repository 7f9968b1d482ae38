//! The ng-sets: the groups that each group remembers, and the memory of a route as it goes from one group to another.

use rayon::prelude::*;

/// The ng-sets of all groups. The memory of a route at a group is a set of bits, one for each group of its ng-set.
#[derive(Clone)]
pub(super) struct NgSets {
    /// ng-set of each group, critical groups first.
    pub(super) lists: Vec<Vec<usize>>,
    /// Groups that all others remember.
    pub(super) critical: Vec<usize>,
    /// Extension of memories between each two groups, row by row of the second.
    pairs: Vec<NgPair>,
    /// Masks of each group: the sets of bits that matter to some other group, each once.
    pub(super) masks: Vec<Vec<u16>>,
}

/// Extension of memories from one group to another.
#[derive(Clone)]
pub(super) struct NgPair {
    /// Index of the mask that holds the bits that matter.
    pub(super) mask: usize,
    /// Extended memory for the lower and the upper bits of a memory.
    halves: [[u16; 1 << HALF_BITS]; 2],
}

/// Bits of a memory that are looked up at once.
const HALF_BITS: usize = 7;
/// Marks a cycle: the second group is in the memory at the first.
pub(super) const CYCLE: u16 = 1 << 15;

impl NgSets {
    pub(super) fn new(critical: Vec<usize>, lists: Vec<Vec<usize>>) -> Self {
        let count = lists.len();
        let mut masks = vec![Vec::new(); count];
        let mut mask_of = |from: usize, to: usize| {
            let matters = |group: &usize| *group == to || lists[to].contains(group);
            let mask =
                lists[from].iter().enumerate().filter(|(_, group)| matters(group)).fold(0, |mask, (bit, _)| mask | 1 << bit);
            masks[from].iter().position(|other| *other == mask).unwrap_or_else(|| {
                masks[from].push(mask);
                masks[from].len() - 1
            })
        };
        let mask_of: Vec<_> = (0..count * count).map(|pair| mask_of(pair % count, pair / count)).collect();
        let pair = |(pair, mask): (usize, usize)| NgPair::new(&lists, pair % count, pair / count, mask);
        let pairs = mask_of.into_par_iter().enumerate().map(pair).collect();
        Self { lists, critical, pairs, masks }
    }

    /// Makes more groups critical.
    pub(super) fn with_critical(&self, more: &[usize]) -> Self {
        let critical: Vec<_> = self.critical.iter().chain(more).copied().collect();
        let with = |(group, list): (usize, &Vec<usize>)| {
            let others = list.iter().filter(|other| !critical.contains(other));
            critical.iter().filter(|other| **other != group).chain(others).copied().collect()
        };
        let lists = self.lists.iter().enumerate().map(with).collect();
        Self::new(critical, lists)
    }

    #[inline(always)]
    pub(super) fn pair(&self, from: usize, to: usize) -> &NgPair {
        &self.pairs[to * self.lists.len() + from]
    }

    pub(super) fn bits(&self, group: usize) -> usize {
        self.lists[group].len()
    }

    /// The full memory at a group.
    pub(super) fn all(&self, group: usize) -> u16 {
        (1 << self.bits(group)) - 1
    }

    /// Number of the first bits that stand for critical groups.
    pub(super) fn critical_bits(&self, group: usize) -> usize {
        self.critical.iter().filter(|other| **other != group).count()
    }
}

impl NgPair {
    fn new(lists: &[Vec<usize>], from: usize, to: usize, mask: usize) -> Self {
        let place = |group: &usize| lists[to].iter().position(|other| other == group);
        let itself = place(&from).map_or(0, |bit| 1 << bit);
        let bit = |group: &usize| if *group == to { CYCLE } else { place(group).map_or(0, |bit| 1 << bit) };
        let bits: Vec<u16> = lists[from].iter().map(bit).collect();
        let half = |upper: usize| {
            let bits = bits.iter().skip(upper * HALF_BITS).take(HALF_BITS);
            let passed = |set: usize| {
                let kept = bits.clone().enumerate().filter(|(bit, _)| set >> bit & 1 == 1);
                kept.fold(itself, |all, (_, bit)| all | bit)
            };
            std::array::from_fn(passed)
        };
        Self { mask, halves: std::array::from_fn(half) }
    }

    /// The memory after the extension; at least [`CYCLE`] where that would close a cycle.
    #[inline(always)]
    pub(super) fn extended(&self, set: u16) -> u16 {
        let [lower, upper] = &self.halves;
        lower[usize::from(set) % (1 << HALF_BITS)] | upper[usize::from(set) >> HALF_BITS & ((1 << HALF_BITS) - 1)]
    }
}
