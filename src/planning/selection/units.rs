//! Areas as whole numbers, so that "less than the target" is exact: the whole of a goal's area is about 2⁵² units, each
//! sample's area is rounded up and what is needed is rounded down by more than any sum of areas in floating point can be
//! off. A bound that is proved in units is so proved in mm².

use rayon::prelude::*;

use super::CoverProblem;
use crate::planning::visibility::{Row, ones};

/// Units of a goal's whole area.
const WHOLE: f64 = (1_u64 << 52) as f64;
/// Share by which needed areas are rounded down: greedy's own rounding of a target and that of sums over 10⁷ samples.
const SLACK: f64 = 2e-9;

/// A goal in units.
pub(super) struct Units {
    /// Units of each sample.
    pub(super) of_sample: Vec<i64>,
    /// Units of all samples.
    pub(super) total: i64,
    /// Units of the samples that some row measures.
    pub(super) measured: i64,
    /// Units that must be covered.
    pub(super) needed: i64,
    scale: f64,
}

impl Units {
    fn new(area_mm2: &[f64], needed_mm2: f64, rows: &[&Row]) -> Self {
        let total_mm2: f64 = area_mm2.iter().sum();
        let scale = if total_mm2 > 0.0 { WHOLE / total_mm2 } else { 0.0 };
        let of_sample: Vec<i64> = area_mm2.iter().map(|area_mm2| (area_mm2 * scale).ceil() as i64).collect();
        let total = of_sample.iter().sum();
        let needed = (needed_mm2 * scale * (1.0 - SLACK)).floor() as i64;
        let units = Self { total, measured: 0, needed, scale, of_sample };
        Self { measured: units.covered_by(rows), ..units }
    }

    /// The goals of a problem in units.
    pub(super) fn of_goals(problem: &CoverProblem<'_>) -> Vec<Self> {
        problem.goals.iter().map(|goal| Self::new(&goal.area_mm2, goal.needed_mm2, &problem.rows)).collect()
    }

    /// Lowers the need to the units that `rows` cover, where they do not reach the goal.
    pub(super) fn clamp_to(&mut self, rows: &[&Row]) {
        self.needed = self.needed.min(self.covered_by(rows));
    }

    /// Units that `rows` cover together.
    pub(super) fn covered_by(&self, rows: &[&Row]) -> i64 {
        let words = 0..self.of_sample.len().div_ceil(64);
        words
            .map(|at| {
                let covered = rows.iter().fold(0, |covered, row| covered | row.words().get(at).copied().unwrap_or(0));
                ones(covered).map(|bit| self.of_sample[64 * at + bit as usize]).sum::<i64>()
            })
            .sum()
    }

    /// Units as mm², rounded up.
    pub(super) fn area_mm2(&self, units: i64) -> f64 {
        if self.scale > 0.0 { units as f64 / self.scale * (1.0 + SLACK) } else { 0.0 }
    }
}

/// Sum of `of_sample` over the samples of each row.
pub(super) fn row_sums(rows: &[&Row], of_sample: &[i64]) -> Vec<i64> {
    rows.par_iter().map(|row| row_sum(row, of_sample)).collect()
}

/// Sums whole numbers: any order gives the same sum.
fn row_sum(row: &Row, of_sample: &[i64]) -> i64 {
    let words = row.words().iter().zip(of_sample.chunks(64));
    words
        .map(|(word, units)| match *word {
            0 => 0,
            u64::MAX if units.len() == 64 => units.iter().sum(),
            word => ones(word).map(|bit| units[bit as usize]).sum::<i64>(),
        })
        .sum()
}
