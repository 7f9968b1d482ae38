//! The columns of a matrix that is held by rows: which rows measure a sample, a bit a row. Made from the rows' words by
//! transposing squares of 64 × 64 bits (Warren, *Hacker's Delight*, 7-3), and numbered by a table of hashes in which equal
//! columns alone are the same: a hash decides only where to look, and every find is compared bit by bit. Cost: rows × samples /
//! 64 words, each moved six times, and a pass over the columns.

use rayon::prelude::*;

use crate::planning::ids::SampleId;
use crate::planning::visibility::ones;

/// Columns of some samples, by their place among these.
pub(super) struct Columns {
    words: Vec<u64>,
    width: usize,
}

impl Columns {
    /// Columns of `samples`, ascending, over rows that are given by their words.
    pub(super) fn new(rows: &[&[u64]], samples: &[SampleId]) -> Self {
        let width = rows.len().div_ceil(64).max(1);
        let mut words = vec![0; samples.len() * width];
        words.par_chunks_mut(64 * width).zip(samples.par_chunks(64)).with_min_len(16).for_each(|(columns, samples)| {
            for (group, rows) in rows.chunks(64).enumerate() {
                let mut square = [0; 64];
                square.iter_mut().zip(rows).for_each(|(word, row)| *word = gathered(row, samples));
                transpose(&mut square);
                columns.iter_mut().skip(group).step_by(width).zip(square).for_each(|(column, word)| *column = word);
            }
        });
        Self { words, width }
    }

    /// The column of the sample at a place.
    pub(super) fn of(&self, place: usize) -> &[u64] {
        &self.words[place * self.width..][..self.width]
    }

    /// Rows that measure the sample at a place, ascending.
    pub(super) fn rows(&self, place: usize) -> impl Iterator<Item = usize> {
        let words = (0..).step_by(64).zip(self.of(place));
        words.flat_map(|(first, word)| ones(*word).map(move |bit| first + bit as usize))
    }
}

/// Bits of a row at up to 64 samples, ascending, the first in the lowest bit.
fn gathered(row: &[u64], samples: &[SampleId]) -> u64 {
    let word = |block: usize| row.get(block).copied().unwrap_or(0);
    let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return 0 };
    let (block, shift) = (first.index() / 64, first.0 % 64);
    if last.index() - first.index() + 1 == samples.len() {
        let unbroken = if shift == 0 { word(block) } else { word(block) >> shift | word(block + 1) << (64 - shift) };
        return if samples.len() == 64 { unbroken } else { unbroken & ((1 << samples.len()) - 1) };
    }
    let bits = samples.iter().map(|sample| word(sample.index() / 64) >> (sample.0 % 64) & 1);
    bits.enumerate().fold(0, |bits, (place, bit)| bits | bit << place)
}

/// Turns rows into columns: bit c of word r becomes bit r of word c.
fn transpose(square: &mut [u64; 64]) {
    let (mut half, mut mask) = (32, 0x0000_0000_ffff_ffff_u64);
    while half > 0 {
        for upper in (0..64).filter(|row| row & half == 0) {
            let swapped = (square[upper] >> half ^ square[upper + half]) & mask;
            square[upper] ^= swapped << half;
            square[upper + half] ^= swapped;
        }
        half /= 2;
        mask ^= mask << half;
    }
}

/// Numbers of equal columns, ascending as they first come.
pub(super) struct ColumnNumbers<'a> {
    columns: &'a Columns,
    hash: fn(&[u64]) -> u64,
    /// Number + 1 in each place of the table; 0 where it is free.
    places: Vec<u32>,
    /// Place of the sample that first had each number.
    pub(super) first: Vec<usize>,
}

impl<'a> ColumnNumbers<'a> {
    /// A table with room for `count` columns.
    pub(super) fn new(columns: &'a Columns, count: usize) -> Self {
        Self { columns, hash: spread, places: vec![0; (2 * count + 1).next_power_of_two()], first: Vec::new() }
    }

    /// The number of the column at a place; a new one if none before was equal to it. `None` for a column without rows.
    pub(super) fn number(&mut self, at: usize) -> Option<u32> {
        let column = self.columns.of(at);
        if column.iter().all(|word| *word == 0) {
            return None;
        }
        let mask = self.places.len() - 1;
        let mut place = (self.hash)(column) as usize & mask;
        loop {
            match self.places[place] {
                0 => {
                    self.first.push(at);
                    self.places[place] = self.first.len() as u32;
                    return Some(self.first.len() as u32 - 1);
                }
                known if self.columns.of(self.first[known as usize - 1]) == column => return Some(known - 1),
                _ => place = (place + 1) & mask,
            }
        }
    }
}

/// Spreads the bits of a column over a number, by products of twice the width folded.
fn spread(column: &[u64]) -> u64 {
    column.iter().fold(0x9e37_79b9_7f4a_7c15, |hash: u64, word| {
        let product = u128::from(hash ^ word) * 0xd6e8_feb8_6659_fd93;
        (product as u64 ^ (product >> 64) as u64).wrapping_add(0x2545_f491_4f6c_dd1d)
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn words(rows: &[Vec<u64>]) -> Vec<&[u64]> {
        rows.iter().map(Vec::as_slice).collect()
    }

    proptest! {
        #[test]
        fn columns_are_those_of_the_rows(
            rows in proptest::collection::vec(proptest::collection::vec(any::<u64>(), 4), 1..150),
            kept in proptest::collection::vec(any::<bool>(), 256),
            first in 0..100_usize,
            unbroken in any::<bool>(),
        ) {
            let samples: Vec<SampleId> = (first..250).filter(|at| unbroken || kept[*at]).map(SampleId::at).collect();
            let columns = Columns::new(&words(&rows), &samples);
            for (place, sample) in samples.iter().enumerate() {
                let holds = |row: &Vec<u64>| row[sample.index() / 64] >> (sample.0 % 64) & 1 == 1;
                let held: Vec<usize> = (0..rows.len()).filter(|row| holds(&rows[*row])).collect();
                prop_assert_eq!(columns.rows(place).collect::<Vec<_>>(), held);
            }
        }

        #[test]
        fn equal_columns_and_no_others_have_the_same_number_whatever_their_hashes(
            rows in proptest::collection::vec(proptest::collection::vec(any::<u64>(), 3), 1..4),
            collide in any::<bool>(),
        ) {
            let samples: Vec<SampleId> = SampleId::first(192).collect();
            let columns = Columns::new(&words(&rows), &samples);
            let mut numbers = ColumnNumbers::new(&columns, samples.len());
            numbers.hash = if collide { |_| 7 } else { spread };
            let numbered: Vec<Option<u32>> = (0..samples.len()).map(|at| numbers.number(at)).collect();
            let mut next = 0;
            for (at, number) in numbered.iter().enumerate() {
                prop_assert_eq!(number.is_none(), columns.rows(at).next().is_none());
                prop_assert!((0..at).all(|other| (columns.of(at) == columns.of(other)) == (*number == numbered[other])));
                let Some(number) = number else { continue };
                prop_assert!(*number <= next, "numbers ascend as they first come");
                next = next.max(number + 1);
            }
        }
    }
}
