//! Reduction of the matrix: samples that the same rows measure become one class with the sum of their units, and rows are
//! dropped whose samples another row measures too. Neither changes what any number of views can cover. Samples are told apart
//! by their columns (`columns.rs`), found by hash and compared bit by bit: nothing is sorted, and nothing that differs is merged.
//!
//! Real views leave little to merge: of a bunny's 64 000 samples under 274 of them 48 000 differ. Cost: a bit a pair of
//! sample and row; a comparison of two rows ends at the first difference.

use super::CoverProblem;
use super::columns::{ColumnNumbers, Columns};
use super::units::Units;
use crate::planning::ids::{RowIndex, SampleId};

/// Goals, at most, whose products count for nothing beside those of the rows. Our choice.
const FEW_GOALS: usize = 16;

/// The reduced matrix.
pub(super) struct Classes {
    /// The problem's rows that no other makes superfluous, ascending.
    pub(super) rows: Vec<RowIndex>,
    /// Classes of each of these rows, ascending.
    pub(super) of_row: Vec<Vec<u32>>,
    /// Units of each class, for each goal.
    pub(super) units: Vec<Vec<i64>>,
    /// Class of each sample; [`Classes::NONE`] for samples that were left out or that no row measures.
    pub(super) of_sample: Vec<u32>,
}

impl Classes {
    /// Stands for no class.
    pub(super) const NONE: u32 = u32::MAX;

    /// Merges the `samples` that some goal counts, over the `rows` given.
    pub(super) fn new(problem: &CoverProblem<'_>, goals: &[Units], samples: &[SampleId], rows: &[RowIndex]) -> Self {
        let counts = |sample: &SampleId| goals.iter().any(|goal| goal.of_sample[sample.index()] > 0);
        let counted: Vec<SampleId> = samples.iter().copied().filter(counts).collect();
        let words: Vec<&[u64]> = rows.iter().map(|row| problem.row(*row).words()).collect();
        let columns = Columns::new(&words, &counted);
        let mut numbers = ColumnNumbers::new(&columns, counted.len());
        let mut units = vec![Vec::new(); goals.len()];
        let mut of_sample = vec![Self::NONE; problem.asked_area_mm2.len()];
        for (at, sample) in counted.iter().map(|sample| sample.index()).enumerate() {
            let Some(class) = numbers.number(at) else { continue };
            of_sample[sample] = class;
            for (units, goal) in units.iter_mut().zip(goals) {
                units.resize(numbers.first.len(), 0);
                units[class as usize] += goal.of_sample[sample];
            }
        }
        let mut of_row = vec![Vec::new(); rows.len()];
        for (class, at) in (0..).zip(&numbers.first) {
            columns.rows(*at).for_each(|place| of_row[place].push(class));
        }
        let representatives = numbers.first;
        let places = undominated(&of_row, representatives.len());
        let of_row = places.iter().map(|place| std::mem::take(&mut of_row[*place])).collect();
        Self { rows: places.iter().map(|place| rows[*place]).collect(), of_row, units, of_sample }
    }

    /// Work of a step of the relaxation: half the square of the rows of each class, and that of many goals.
    pub(super) fn step_work(&self) -> f64 {
        let (mut rows, of_goals) = (vec![0.0; self.len()], work_of_goals(self.units.len()));
        self.of_row.iter().flatten().for_each(|class| rows[*class as usize] += 1.0);
        rows.iter().map(|rows| rows * rows / 2.0 + of_goals).sum()
    }

    /// Number of classes.
    pub(super) fn len(&self) -> usize {
        self.units.first().map_or(0, Vec::len)
    }
}

/// Work of a step of the relaxation for each class by so many goals: half their square, or nothing where they are few.
pub(super) fn work_of_goals(goals: usize) -> f64 {
    if goals <= FEW_GOALS { 0.0 } else { (goals * goals) as f64 / 2.0 }
}

/// Finds the places of rows, given by their classes, ascending, that no other contains; of equal ones the first. Only rows that hold the
/// rarest class of a row are compared with it: of the many candidates of a large part few share any.
pub(super) fn undominated(of_row: &[Vec<u32>], classes: usize) -> Vec<usize> {
    let mut largest_first: Vec<usize> = (0..of_row.len()).filter(|row| !of_row[*row].is_empty()).collect();
    largest_first.sort_by_key(|row| std::cmp::Reverse(of_row[*row].len()));
    let mut found: Vec<usize> = Vec::new();
    let mut found_with: Vec<Vec<u32>> = vec![Vec::new(); classes];
    for row in largest_first {
        let own = &of_row[row];
        let rarest = own.iter().map(|class| &found_with[*class as usize]).min_by_key(|found| found.len());
        let is_contained = rarest.is_some_and(|found| found.iter().any(|other| is_within(own, &of_row[*other as usize])));
        if !is_contained {
            found.push(row);
            own.iter().for_each(|class| found_with[*class as usize].push(row as u32));
        }
    }
    found.sort_unstable();
    found
}

/// Returns true if a row has all classes of another, given by its own; both ascend.
fn is_within(own: &[u32], other: &[u32]) -> bool {
    let mut held = other.iter();
    own.len() <= other.len() && own.iter().all(|class| held.by_ref().find(|held| *held >= class) == Some(class))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::random::split_mix;

    #[test]
    fn rows_are_left_that_no_other_contains_and_of_equal_ones_the_first() {
        let rows: [&[u32]; 7] = [&[1, 2], &[0, 1, 2, 5], &[], &[3], &[3], &[2, 4], &[0, 5]];
        assert_eq!(undominated(&rows.map(<[u32]>::to_vec), 6), [1, 3, 5]);
        let contains = |a: &Vec<u32>, b: &Vec<u32>| b.iter().all(|class| a.contains(class));
        for seed in 0..200 {
            let holds = |row: u64, class: u64| split_mix(seed << 16 | row << 8 | class) % 4 < 1 + row % 3;
            let row = |row: u64| (0..12).filter(|class| holds(row, *class)).map(|class| class as u32).collect::<Vec<_>>();
            let rows: Vec<Vec<u32>> = (0..16).map(row).collect();
            let is_left = |at: &usize| {
                let is_before = |other: &usize| rows[*other].len() > rows[*at].len() || *other < *at;
                let dominates = |other: &usize| other != at && contains(&rows[*other], &rows[*at]) && is_before(other);
                !rows[*at].is_empty() && !(0..rows.len()).any(|other| dominates(&other))
            };
            assert_eq!(undominated(&rows, 12), (0..rows.len()).filter(is_left).collect::<Vec<_>>(), "{rows:?}");
        }
    }
}
