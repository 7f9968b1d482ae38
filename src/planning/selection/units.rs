//! Areas as whole numbers, so that "less than the target" is exact: the whole of a goal's area is about 2⁵² units, each
//! sample's area is rounded up and what is needed is rounded down by more than any sum of areas in floating point can be
//! off. A bound that is proved in units is so proved in mm².

use rayon::prelude::*;

use super::CoverProblem;
use super::blocks::{BLOCK, masked_sum, set_sum};
use crate::geometry::SimdLevel;
use crate::planning::visibility::Row;

/// Units of a goal's whole area.
const WHOLE: f64 = (1_u64 << 52) as f64;
/// Share by which needed areas are rounded down: greedy's own rounding of a target and that of sums over 10⁷ samples.
const SLACK: f64 = 2e-9;

/// Words of a set that a thread makes at once.
const WORDS_A_TASK: usize = 1024;

/// A goal in units.
#[derive(Clone)]
pub(super) struct Units {
    /// Units of each sample.
    pub(super) of_sample: Vec<i64>,
    /// Samples of which it has any, as words of bits.
    counted: Vec<u64>,
    /// Units of all samples.
    pub(super) total: i64,
    /// Units of the samples that some row measures.
    pub(super) measured: i64,
    /// Units that must be covered.
    pub(super) needed: i64,
    scale: f64,
}

impl Units {
    fn new(area_mm2: &[f64], needed_mm2: f64, measured: &[u64]) -> Self {
        let total_mm2: f64 = area_mm2.iter().sum();
        let scale = if total_mm2 > 0.0 { WHOLE / total_mm2 } else { 0.0 };
        let of_sample: Vec<i64> = area_mm2.iter().map(|area_mm2| (area_mm2 * scale).ceil() as i64).collect();
        let total = of_sample.iter().sum();
        let needed = (needed_mm2 * scale * (1.0 - SLACK)).floor() as i64;
        let bits = |units: &[i64]| units.iter().rev().fold(0, |bits, units| bits << 1 | u64::from(*units > 0));
        let counted = of_sample.chunks(BLOCK).map(bits).collect();
        let units = Self { total, measured: 0, needed, scale, of_sample, counted };
        Self { measured: units.of_set(measured), ..units }
    }

    /// The goals of a problem in units.
    pub(super) fn of_goals(problem: &CoverProblem<'_>) -> Vec<Self> {
        let measured = union_of(&problem.rows, problem.asked_area_mm2.len());
        problem.goals.iter().map(|goal| Self::new(&goal.area_mm2, goal.needed_mm2, &measured)).collect()
    }

    /// Lowers the need to the units that `rows` cover, where they do not reach the goal.
    pub(super) fn clamp_to(&mut self, rows: &[&Row]) {
        self.needed = self.needed.min(self.covered_by(rows));
    }

    /// Units that `rows` cover together.
    pub(super) fn covered_by(&self, rows: &[&Row]) -> i64 {
        self.of_set(&union_of(rows, self.of_sample.len()))
    }

    /// Units of a set of samples, given as words of bits.
    pub(super) fn of_set(&self, words: &[u64]) -> i64 {
        words.iter().zip(self.of_sample.chunks(BLOCK)).map(|(word, units)| masked_sum(units, *word)).sum()
    }

    /// Samples of a block that it counts, a bit each.
    pub(super) fn counted(&self, block: usize) -> u64 {
        self.counted[block]
    }

    /// Samples that it counts, as words of bits.
    pub(super) fn counted_words(&self) -> &[u64] {
        &self.counted
    }

    /// Returns true if it counts a sample that another goal does not.
    pub(super) fn counts_beyond(&self, other: &Self) -> bool {
        self.counted.iter().zip(&other.counted).any(|(own, other)| own & !other != 0)
    }

    /// Units of the samples of a block.
    pub(super) fn of_block(&self, block: usize) -> &[i64] {
        let end = self.of_sample.len().min((block + 1) * BLOCK);
        &self.of_sample[block * BLOCK..end]
    }

    /// Units as mm², rounded up.
    pub(super) fn area_mm2(&self, units: i64) -> f64 {
        if self.scale > 0.0 { units as f64 / self.scale * (1.0 + SLACK) } else { 0.0 }
    }
}

/// Samples, of so many, that at least one of `rows` measures, as words of bits.
fn union_of(rows: &[&Row], samples: usize) -> Vec<u64> {
    let mut union = vec![0; samples.div_ceil(BLOCK)];
    union.par_chunks_mut(WORDS_A_TASK).enumerate().for_each(|(task, union)| {
        for row in rows {
            let words = row.words().iter().skip(task * WORDS_A_TASK);
            union.iter_mut().zip(words).for_each(|(union, word)| *union |= word);
        }
    });
    union
}

/// Sum of `of_sample` over the samples of each row.
pub(super) fn row_sums(rows: &[&Row], of_sample: &[i64], level: SimdLevel) -> Vec<i64> {
    rows.par_iter().map(|row| set_sum(row.words(), of_sample, level)).collect()
}
