//! Sorting that can be given up: in place by eight bits at a time from the top (P. M. McIlroy, K. Bostic and M. D. McIlroy,
//! "Engineering radix sort", Computing Systems 6(1), 1993, the American flag sort). Cost: O(n) for each eight bits in which
//! keys differ; equal keys cost one pass.

use super::poll::{Interrupted, Poll};

/// Items that are sorted at once: a fraction of a millisecond.
const AT_ONCE: usize = 4096;
/// Bits of a digit, and how many digits there are.
const DIGIT_BITS: u32 = 8;
const DIGITS: usize = 1 << DIGIT_BITS;

/// Sorts by `key`. Items of equal keys come in any order, the same on every run.
///
/// # Errors
/// [`Interrupted`]; the items are then in no order.
pub(super) fn sort_by_key<T>(items: &mut [T], key: impl Fn(&T) -> u128, poll: &Poll<'_>) -> Result<(), Interrupted> {
    let mut waiting: Vec<_> = std::iter::once(0..items.len()).collect();
    while let Some(range) = waiting.pop() {
        let part = &mut items[range.clone()];
        if part.len() <= AT_ONCE {
            part.sort_unstable_by_key(&key);
            poll.spend(40 * part.len())?;
            continue;
        }
        let Some(shift) = shift(part, &key, poll)? else { continue };
        let digit = |item: &T| (key(item) >> shift) as usize % DIGITS;
        let ends = distribute(part, digit, poll)?;
        let begins = std::iter::once(0).chain(ends);
        waiting.extend(begins.zip(ends).filter(|(begin, end)| end - begin > 1).map(|(b, e)| range.start + b..range.start + e));
    }
    Ok(())
}

/// Number of bits below the digit that tells the keys apart; `None` where all are equal.
fn shift<T>(part: &[T], key: impl Fn(&T) -> u128, poll: &Poll<'_>) -> Result<Option<u32>, Interrupted> {
    let (mut low, mut high) = (u128::MAX, 0);
    for item in part {
        poll.spend(2)?;
        (low, high) = (low.min(key(item)), high.max(key(item)));
    }
    let differing = u128::BITS - (low ^ high).leading_zeros();
    Ok((differing > 0).then(|| differing.saturating_sub(DIGIT_BITS)))
}

/// Brings the items into the order of their digits; where each digit ends.
fn distribute<T>(part: &mut [T], digit: impl Fn(&T) -> usize, poll: &Poll<'_>) -> Result<[usize; DIGITS], Interrupted> {
    let mut ends = [0; DIGITS];
    for item in part.iter() {
        poll.spend(2)?;
        ends[digit(item)] += 1;
    }
    for d in 1..DIGITS {
        ends[d] += ends[d - 1];
    }
    let mut next = [0; DIGITS];
    next[1..].copy_from_slice(&ends[..DIGITS - 1]);
    for d in 0..DIGITS {
        while next[d] < ends[d] {
            poll.spend(8)?;
            let other = digit(&part[next[d]]);
            part.swap(next[d], next[other]);
            next[other] += 1;
        }
    }
    Ok(ends)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers that look random; the same on every run (Steele, Lea and Flood 2014, SplitMix).
    fn scattered(count: usize, mask: u128) -> Vec<u128> {
        let mix = |seed: u64| {
            let z = (seed ^ (seed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z ^ (z >> 31)
        };
        let number = |i: u64| (u128::from(mix(2 * i + 1)) << 64 | u128::from(mix(0x9e37_79b9 + 2 * i))) & mask;
        (0..count as u64).map(number).collect()
    }

    #[test]
    fn it_sorts_what_differs_in_any_bits() {
        for mask in [u128::MAX, 0xff, 1, 0, 0xf000_0000_0000_0000, u128::MAX << 96, 0x0101_0000_0000_0001_0000_0000] {
            for count in [0, 1, 2, 5000, 100_000] {
                let mut items = scattered(count, mask);
                let mut wanted = items.clone();
                wanted.sort_unstable();
                sort_by_key(&mut items, |item| *item, &Poll::never()).expect("not interrupted");
                assert!(items == wanted, "{count} items, mask {mask:x}");
            }
        }
    }

    #[test]
    fn it_can_be_given_up() {
        let mut items = scattered(1_000_000, u128::MAX);
        assert_eq!(sort_by_key(&mut items, |item| *item, &Poll::new(&|| true)), Err(Interrupted));
    }
}
