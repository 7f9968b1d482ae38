//! Which groups each group remembers, and what becomes of what is remembered on the way from one to another.

use rayon::prelude::*;

/// What is remembered of a walk at a group is a set of bits, one for each of the group's list.
#[derive(Clone)]
pub(super) struct Memories {
    pub(super) lists: Vec<Vec<usize>>,
    /// Groups that all others remember, first in each list.
    pub(super) landmarks: Vec<usize>,
    /// For each two groups, the second's row by row.
    pairs: Vec<Pair>,
    /// For each group the sets of bits that matter to some other, each once.
    pub(super) masks: Vec<Vec<u16>>,
}

/// What becomes of what one group remembers at another.
#[derive(Clone)]
pub(super) struct Pair {
    /// Which of the group's masks has the bits that matter.
    pub(super) mask: usize,
    /// For the lower and the upper bits of a set: what is remembered then.
    halves: [[u16; 1 << HALF_BITS]; 2],
}

const HALF_BITS: usize = 7;
/// The second group is remembered by the first: no walk goes there.
pub(super) const FORBIDDEN: u16 = 1 << 15;

impl Memories {
    pub(super) fn new(landmarks: Vec<usize>, lists: Vec<Vec<usize>>) -> Self {
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
        let pair = |(pair, mask): (usize, usize)| Pair::new(&lists, pair % count, pair / count, mask);
        let pairs = mask_of.into_par_iter().enumerate().map(pair).collect();
        Self { lists, landmarks, pairs, masks }
    }

    /// All remember some more groups.
    pub(super) fn with_landmarks(&self, more: &[usize]) -> Self {
        let landmarks: Vec<_> = self.landmarks.iter().chain(more).copied().collect();
        let with = |(group, list): (usize, &Vec<usize>)| {
            let others = list.iter().filter(|other| !landmarks.contains(other));
            landmarks.iter().filter(|landmark| **landmark != group).chain(others).copied().collect()
        };
        let lists = self.lists.iter().enumerate().map(with).collect();
        Self::new(landmarks, lists)
    }

    #[inline(always)]
    pub(super) fn pair(&self, from: usize, to: usize) -> &Pair {
        &self.pairs[to * self.lists.len() + from]
    }

    pub(super) fn bits(&self, group: usize) -> usize {
        self.lists[group].len()
    }

    /// All that a group remembers.
    pub(super) fn all(&self, group: usize) -> u16 {
        (1 << self.bits(group)) - 1
    }

    /// How many of its bits, the first, are landmarks.
    pub(super) fn landmark_bits(&self, group: usize) -> usize {
        self.landmarks.iter().filter(|landmark| **landmark != group).count()
    }
}

impl Pair {
    fn new(lists: &[Vec<usize>], from: usize, to: usize, mask: usize) -> Self {
        let place = |group: &usize| lists[to].iter().position(|other| other == group);
        let itself = place(&from).map_or(0, |bit| 1 << bit);
        let bit = |group: &usize| if *group == to { FORBIDDEN } else { place(group).map_or(0, |bit| 1 << bit) };
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

    /// What is remembered then, at least [`FORBIDDEN`] where no walk goes.
    #[inline(always)]
    pub(super) fn passed_on(&self, set: u16) -> u16 {
        let [lower, upper] = &self.halves;
        lower[usize::from(set) % (1 << HALF_BITS)] | upper[usize::from(set) >> HALF_BITS & ((1 << HALF_BITS) - 1)]
    }
}
