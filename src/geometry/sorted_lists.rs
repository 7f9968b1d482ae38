//! Lists of numbers, one for each key, each sorted: what a map of lists would hold, in two arrays. Keys are counted first, so
//! that every number can be put where its list is (counting sort: D. E. Knuth, *The Art of Computer Programming* 3, §5.2), by
//! several threads, each for keys of its own; then every list is sorted. Cost: O(numbers + keys), and the sorting of the lists.

use std::ops::Range;

use rayon::prelude::*;

use super::poll::{Interrupted, Poll};
use super::side_by_side::{self, PIECE};
use super::sort::sort_by_key;

/// Most ranges of keys that numbers are sorted into side by side; for each of them all items are looked at.
const MAX_SHARES: usize = 8;
/// Items between two looks.
const ITEMS_PER_LOOK: usize = 131_072;
/// A list longer than this is sorted by the thread that asks whether to go on.
const LONG_LIST: usize = 65_536;

/// Lists by key.
pub(super) struct SortedLists {
    /// End of each key's list.
    ends: Vec<u32>,
    numbers: Vec<u64>,
}

/// Keys of one thread: for each the place of its next number, counted over all; and the numbers of all of them.
struct Share<'a> {
    first_key: usize,
    next: &'a mut [u32],
    first_place: usize,
    numbers: &'a mut [u64],
}

impl Share<'_> {
    fn place(&mut self, key: u32, number: u64) {
        if let Some(next) = self.next.get_mut((key as usize).wrapping_sub(self.first_key)) {
            self.numbers[*next as usize - self.first_place] = number;
            *next += 1;
        }
    }
}

impl SortedLists {
    /// Lists for so many keys, with the `entries` (key and number) of so many items.
    ///
    /// # Errors
    /// [`Interrupted`].
    pub(super) fn new<const N: usize>(
        items: usize,
        keys: usize,
        entries: impl Fn(usize) -> [(u32, u64); N] + Sync,
        poll: &Poll<'_>,
    ) -> Result<Self, Interrupted> {
        assert!(items < u32::MAX as usize / N.max(1), "places are numbers of 32 bits");
        let share_keys = keys.div_ceil(rayon::current_num_threads().min(MAX_SHARES)).max(1);
        let mut ends = vec![0_u32; keys];
        let mut counts: Vec<(usize, &mut [u32])> = ends.chunks_mut(share_keys).enumerate().collect();
        for some in looks(items) {
            poll.check()?;
            counts.par_iter_mut().for_each(|(share, counts)| {
                for (key, _) in some.clone().flat_map(&entries) {
                    if let Some(count) = counts.get_mut((key as usize).wrapping_sub(*share * share_keys)) {
                        *count += 1;
                    }
                }
            });
        }
        let total = begin_of_each(&mut ends, poll)?;
        let mut numbers = vec![0; total as usize];
        let mut shares = shares(&mut ends, &mut numbers, share_keys);
        for some in looks(items) {
            poll.check()?;
            shares.par_iter_mut().for_each(|share| {
                some.clone().flat_map(&entries).for_each(|(key, number)| share.place(key, number));
            });
        }
        // What was the place of each key's next number is now the end of its list.
        let mut lists = Self { ends, numbers };
        lists.sort(poll)?;
        Ok(lists)
    }

    fn sort(&mut self, poll: &Poll<'_>) -> Result<(), Interrupted> {
        let keys = self.pieces();
        let mut rest = &mut self.numbers[..];
        let mut pieces = Vec::with_capacity(keys.len());
        for keys in keys {
            let begin = begin(&self.ends, keys.start);
            let (own, after) = rest.split_at_mut(self.ends[keys.end - 1] as usize - begin);
            pieces.push((begin, &self.ends[keys], own));
            rest = after;
        }
        let sort_short = |(first, ends, numbers): &mut (usize, &[u32], &mut [u64])| {
            let mut begin = 0;
            for end in ends.iter().map(|end| *end as usize - *first) {
                if (2..=LONG_LIST).contains(&(end - begin)) {
                    numbers[begin..end].sort_unstable();
                }
                begin = end;
            }
        };
        side_by_side::for_each(pieces, sort_short, poll)?;
        let mut begin = 0;
        for end in self.ends.iter().map(|end| *end as usize) {
            if end - begin > LONG_LIST {
                sort_by_key(&mut self.numbers[begin..end], |number| u128::from(*number), poll)?;
            }
            begin = end;
        }
        Ok(())
    }

    /// Ranges of keys whose lists together are worth a thread's while.
    pub(super) fn pieces(&self) -> Vec<Range<usize>> {
        let mut pieces = Vec::new();
        let (mut first, mut begin) = (0, 0);
        for (key, end) in self.ends.iter().map(|end| *end as usize).enumerate() {
            if end - begin >= PIECE || key + 1 == self.ends.len() {
                pieces.push(first..key + 1);
                (first, begin) = (key + 1, end);
            }
        }
        pieces
    }

    /// Keys of a range, each with its list.
    pub(super) fn of(&self, keys: Range<usize>) -> impl Iterator<Item = (u32, &[u64])> {
        let mut begin = begin(&self.ends, keys.start);
        keys.map(move |key| {
            let end = self.ends[key] as usize;
            let list = &self.numbers[begin..end];
            begin = end;
            (key as u32, list)
        })
    }

    /// All keys, each with its list.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u32, &[u64])> {
        self.of(0..self.ends.len())
    }
}

/// Begin of a key's list.
fn begin(ends: &[u32], key: usize) -> usize {
    key.checked_sub(1).map_or(0, |before| ends[before] as usize)
}

fn looks(items: usize) -> impl Iterator<Item = Range<usize>> {
    (0..items).step_by(ITEMS_PER_LOOK).map(move |begin| begin..items.min(begin + ITEMS_PER_LOOK))
}

/// Puts the sum of the counts before it in the place of each count; the sum of all.
fn begin_of_each(counts: &mut [u32], poll: &Poll<'_>) -> Result<u32, Interrupted> {
    let mut sum = 0;
    for count in counts {
        poll.spend(1)?;
        sum += std::mem::replace(count, sum);
    }
    Ok(sum)
}

fn shares<'a>(begins: &'a mut [u32], numbers: &'a mut [u64], share_keys: usize) -> Vec<Share<'a>> {
    let bounds: Vec<usize> = begins.iter().step_by(share_keys).map(|begin| *begin as usize).chain([numbers.len()]).collect();
    let mut rest = numbers;
    let mut shares = Vec::with_capacity(bounds.len());
    for (share, next) in begins.chunks_mut(share_keys).enumerate() {
        let (own, after) = rest.split_at_mut(bounds[share + 1] - bounds[share]);
        shares.push(Share { first_key: share * share_keys, next, first_place: bounds[share], numbers: own });
        rest = after;
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_has_its_numbers_sorted_on_any_number_of_threads() {
        // Key 3 has a list that is sorted apart, key 5 has none.
        let entries = |item: usize| {
            let key = if item.is_multiple_of(2) { 3 } else { (item * item % 1009) as u32 % 800 };
            let key = if key == 5 { 6 } else { key };
            [(key, (item * 7919 % 100_003) as u64), (799, item as u64)]
        };
        let items = 200_000;
        let mut wanted = vec![Vec::new(); 800];
        (0..items).flat_map(entries).for_each(|(key, number)| wanted[key as usize].push(number));
        wanted.iter_mut().for_each(|list| list.sort_unstable());
        for threads in [1, 3, 8] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let lists = pool.install(|| SortedLists::new(items, 800, entries, &Poll::never())).expect("not interrupted");
            let found: Vec<Vec<u64>> = lists.iter().map(|(_, list)| list.to_vec()).collect();
            assert!(found == wanted, "{threads} threads");
            let in_pieces: usize = lists.pieces().into_iter().flat_map(|keys| lists.of(keys)).map(|(_, list)| list.len()).sum();
            assert_eq!(in_pieces, 2 * items);
        }
    }

    #[test]
    fn nothing_makes_no_lists_and_work_can_be_given_up() {
        let none = SortedLists::new(0, 0, |_| [(0, 0)], &Poll::never()).expect("not interrupted");
        assert!(none.iter().next().is_none() && none.pieces().is_empty());
        let empty = SortedLists::new(0, 3, |_| [(0, 0)], &Poll::never()).expect("not interrupted");
        assert_eq!(empty.iter().map(|(_, list)| list.len()).collect::<Vec<_>>(), [0, 0, 0]);
        assert!(SortedLists::new(10, 3, |_| [(0, 0)], &Poll::new(&|| true)).is_err());
    }
}
