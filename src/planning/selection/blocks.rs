//! Sums of whole numbers over the samples of a row, a block of 64 samples and a word of bits at a time: a block of which many
//! samples count is added as vectors, the others masked; one of which few count, bit by bit. Whole numbers, so that the order of
//! the sums changes nothing.

use crate::geometry::{Kernel, SimdLevel};
use crate::planning::visibility::ones;

/// Samples of a block.
pub(super) const BLOCK: usize = 64;
/// Samples of a block from which it is added as vectors.
const MIN_VECTOR: u32 = 12;
const LANES: usize = 8;

/// The sum over the samples whose bits are set, with the units of the block.
#[inline(always)]
pub(super) fn masked_sum(units: &[i64], mask: u64) -> i64 {
    match <&[i64; BLOCK]>::try_from(units) {
        Ok(block) if mask.count_ones() >= MIN_VECTOR => vector_sum(block, mask),
        _ => ones(mask).map(|bit| units[bit as usize]).sum(),
    }
}

#[inline(always)]
fn vector_sum(block: &[i64; BLOCK], mask: u64) -> i64 {
    let mut sums = [0_i64; LANES];
    for first in (0..BLOCK).step_by(LANES) {
        let bits = mask >> first;
        for lane in 0..LANES {
            sums[lane] += block[first + lane] & -((bits >> lane & 1) as i64);
        }
    }
    sums.iter().sum()
}

/// Sum of the units of the samples whose bits are set.
pub(super) fn set_sum(words: &[u64], units: &[i64], level: SimdLevel) -> i64 {
    struct Sum<'a>(&'a [u64], &'a [i64]);
    impl Kernel for Sum<'_> {
        type Output = i64;

        #[inline(always)]
        fn run(self) -> i64 {
            let mut sum = 0;
            for (word, units) in self.0.iter().zip(self.1.chunks(BLOCK)) {
                if *word != 0 {
                    sum += masked_sum(units, *word);
                }
            }
            sum
        }
    }
    level.run(Sum(words, units))
}

/// Number of samples that are in both sets.
pub(super) fn count_in(words: &[u64], others: &[u64], level: SimdLevel) -> usize {
    struct Count<'a>(&'a [u64], &'a [u64]);
    impl Kernel for Count<'_> {
        type Output = u64;

        #[inline(always)]
        fn run(self) -> u64 {
            self.0.iter().zip(self.1).map(|(word, other)| u64::from((word & other).count_ones())).sum()
        }
    }
    level.run(Count(words, others)) as usize
}

/// Samples of a block that are added to one sum.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockSegment {
    /// Number of the block.
    pub(super) block: u32,
    /// Number of the sum.
    pub(super) sum: u32,
    /// The samples, a bit each.
    pub(super) mask: u64,
}

/// Sum over what a row measures of the segments of each sum, in the units of that sum.
pub(super) fn segment_sums(words: &[u64], segments: &[BlockSegment], units_of: &[&[i64]], level: SimdLevel) -> Vec<i64> {
    let mut sums = vec![0; units_of.len()];
    change_sums(&mut sums, words, (segments, &[]), units_of, level);
    sums
}

/// Adds to each sum what a row measures of its segments of the first list, and takes away what it measures of those of the second.
pub(super) fn change_sums(
    sums: &mut [i64],
    words: &[u64],
    (joined, left): (&[BlockSegment], &[BlockSegment]),
    units_of: &[&[i64]],
    level: SimdLevel,
) {
    struct Change<'a, 'b>(&'a mut [i64], &'a [u64], [&'a [BlockSegment]; 2], &'a [&'b [i64]]);
    impl Kernel for Change<'_, '_> {
        type Output = ();

        #[inline(always)]
        fn run(self) {
            let Self(sums, words, lists, units_of) = self;
            for (segments, sign) in lists.into_iter().zip([1, -1]) {
                for segment in segments {
                    let mask = words.get(segment.block as usize).copied().unwrap_or(0) & segment.mask;
                    if mask != 0 {
                        let units = units_of[segment.sum as usize];
                        let first = segment.block as usize * BLOCK;
                        sums[segment.sum as usize] += sign * masked_sum(&units[first..units.len().min(first + BLOCK)], mask);
                    }
                }
            }
        }
    }
    level.run(Change(sums, words, [joined, left], units_of));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_sums_what_bits_say() {
        let units: Vec<i64> = (0..200).map(|at| (at * at * 7919) % 1_000_003 + (1 << 40)).collect();
        let words = [u64::MAX, 0x8000_0000_0000_0001, 0x5555_aaaa_0f0f_1234, 0x0000_0000_0000_00a5];
        let set = |at: &usize| words[at / 64] >> (at % 64) & 1 == 1;
        let plain: i64 = (0..200).filter(set).map(|at| units[at]).sum();
        let segments = [(0, 1, u64::MAX), (1, 0, 1), (2, 1, 0xffff_0000_ffff_0000), (2, 0, 0xffff), (3, 1, 0xff)];
        let segments = segments.map(|(block, sum, mask)| BlockSegment { block, sum, mask });
        let of_sum = |sum: u32| -> i64 {
            let own = segments.iter().filter(|segment| segment.sum == sum);
            own.map(|s| {
                (0..200)
                    .filter(|at| at / 64 == s.block as usize && set(at) && s.mask >> (at % 64) & 1 == 1)
                    .map(|at| units[at])
                    .sum::<i64>()
            })
            .sum()
        };
        for level in SimdLevel::available() {
            assert_eq!(set_sum(&words, &units, level), plain, "{}", level.as_str());
            assert_eq!(count_in(&words, &[u64::MAX, 0, 0xff, u64::MAX], level), 64 + 3 + 4, "{}", level.as_str());
            let sums = segment_sums(&words, &segments, &[&units, &units], level);
            assert_eq!(sums, [of_sum(0), of_sum(1)], "{}", level.as_str());
            let mut changed = [7, 7];
            change_sums(&mut changed, &words, (&segments[..2], &segments), &[&units, &units], level);
            let first_two = segment_sums(&words, &segments[..2], &[&units, &units], level);
            assert_eq!(changed, [0, 1].map(|sum| 7 + first_two[sum] - sums[sum]), "{}", level.as_str());
        }
    }
}
