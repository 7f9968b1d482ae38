//! A set of samples, one bit each: bit s mod 64 of word s / 64. Cost: 1 bit a sample of the surface, in the set or not.

use crate::planning::ids::SampleId;

/// A set of samples of one surface.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SampleSet {
    words: Vec<u64>,
}

impl SampleSet {
    /// The empty set of samples of a surface that has `samples`.
    #[must_use]
    pub fn none_of(samples: usize) -> Self {
        Self { words: vec![0; samples.div_ceil(64)] }
    }

    /// The samples whose bits are set.
    #[must_use]
    pub fn from_words(words: Vec<u64>) -> Self {
        Self { words }
    }

    /// Samples 64·i to 64·i + 63 in word i, the lowest in its lowest bit.
    #[must_use]
    pub fn words(&self) -> &[u64] {
        &self.words
    }

    /// Words of the set, see [`SampleSet::words`].
    #[must_use]
    pub fn into_words(self) -> Vec<u64> {
        self.words
    }

    /// Returns true if it holds `sample`.
    #[must_use]
    pub fn holds(&self, sample: SampleId) -> bool {
        self.words.get(sample.index() / 64).is_some_and(|word| word >> (sample.0 % 64) & 1 == 1)
    }

    /// Adds a sample of the surface that the set was made for.
    pub fn insert(&mut self, sample: SampleId) {
        self.words[sample.index() / 64] |= 1 << (sample.0 % 64);
    }

    /// Number of samples that it holds.
    #[must_use]
    pub fn count(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Samples that it holds, ascending.
    pub fn iter(&self) -> impl Iterator<Item = SampleId> {
        (0..).step_by(64).zip(&self.words).flat_map(|(first, word)| ones(*word).map(move |bit| SampleId(first + bit)))
    }

    /// Adds what `other`, a set of the same surface, holds.
    pub fn insert_all(&mut self, other: &Self) {
        self.words.iter_mut().zip(&other.words).for_each(|(word, other)| *word |= other);
    }

    /// Takes out what `other`, a set of the same surface or the empty one of no surface, does not hold.
    pub fn retain_all(&mut self, other: &Self) {
        let others = other.words.iter().copied().chain(std::iter::repeat(0));
        self.words.iter_mut().zip(others).for_each(|(word, other)| *word &= other);
    }

    /// Takes out what `other`, a set of the same surface, holds.
    pub fn remove_all(&mut self, other: &Self) {
        self.words.iter_mut().zip(&other.words).for_each(|(word, other)| *word &= !other);
    }
}

/// The set bits of a word, ascending.
pub(crate) fn ones(mut word: u64) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        let bit = word.trailing_zeros();
        word &= word.wrapping_sub(1);
        (bit < u64::BITS).then_some(bit)
    })
}
