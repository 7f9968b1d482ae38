//! Incidence of rows and classes in the relaxation: products with vectors, and the matrix of a step's system. The sums have a fixed
//! order on any number of threads.

use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::geometry::{Kernel, SimdLevel};

/// Classes and rows whose sums a thread takes at once.
const CLASSES_A_TASK: usize = 512;
const ROWS_A_TASK: usize = 8;
/// Columns of Aᵀ D A that a thread sums at once.
const COLUMNS_A_TASK: usize = 8;
/// Rows of a group, which are added at once.
const LANES: usize = 8;

/// Incidence matrix A, both ways.
pub(super) struct Incidence<'a> {
    /// Classes that each row covers, ascending.
    of_row: &'a [Vec<u32>],
    /// Rows of class c are `rows[starts[c]..starts[c + 1]]`, ascending.
    starts: Vec<u32>,
    rows: Vec<u32>,
    /// The rows of class c in groups are `groups[group_starts[c]..group_starts[c + 1]]`, ascending.
    group_starts: Vec<u32>,
    groups: Vec<RowGroup>,
    /// Classes of each row.
    entries: Vec<Vec<Entry>>,
}

impl<'a> Incidence<'a> {
    /// The matrix of rows that cover these of so many classes.
    pub(super) fn new(of_row: &'a [Vec<u32>], classes: usize) -> Self {
        let mut starts = vec![0_u32; classes + 1];
        of_row.iter().flatten().for_each(|class| starts[*class as usize + 1] += 1);
        (0..classes).for_each(|class| starts[class + 1] += starts[class]);
        let (mut next, mut rows) = (starts.clone(), vec![0_u32; starts[classes] as usize]);
        for (row, classes) in (0..).zip(of_row) {
            for class in classes {
                rows[next[*class as usize] as usize] = row;
                next[*class as usize] += 1;
            }
        }
        let (mut group_starts, mut groups) = (vec![0], Vec::<RowGroup>::new());
        let mut entries: Vec<Vec<Entry>> = of_row.iter().map(|classes| Vec::with_capacity(classes.len())).collect();
        for (class, ends) in (0..).zip(starts.windows(2)) {
            let first = groups.len();
            for row in &rows[ends[0] as usize..ends[1] as usize] {
                let (group, bit) = ((*row as usize / LANES) as u16, 1 << (*row as usize % LANES));
                match groups[first..].last_mut().filter(|last| last.group == group) {
                    Some(last) => last.mask |= bit,
                    None => groups.push(RowGroup { group, mask: bit }),
                }
                entries[*row as usize].push(Entry { class, first_group: groups.len() as u32 - 1 });
            }
            group_starts.push(groups.len() as u32);
        }
        Self { of_row, starts, rows, group_starts, groups, entries }
    }

    /// Number of rows.
    pub(super) fn rows(&self) -> usize {
        self.of_row.len()
    }

    /// Number of classes.
    pub(super) fn classes(&self) -> usize {
        self.starts.len() - 1
    }

    /// A v.
    pub(super) fn times(&self, v: &[f64]) -> Vec<f64> {
        let of_class = |ends: &[u32]| self.rows[ends[0] as usize..ends[1] as usize].iter().map(|row| v[*row as usize]).sum();
        self.starts.par_windows(2).with_min_len(CLASSES_A_TASK).map(of_class).collect()
    }

    /// Aᵀ v.
    pub(super) fn transposed_times(&self, v: &[f64]) -> Vec<f64> {
        let of_row = |classes: &Vec<u32>| classes.iter().map(|class| v[*class as usize]).sum();
        self.of_row.par_iter().with_min_len(ROWS_A_TASK).map(of_row).collect()
    }

    /// Aᵀ diag(d) A, its lower triangle. A column stays in the first cache while the classes of its row pass by; classes are added in
    /// their order.
    pub(super) fn weighted_square(&self, d: &[f64], level: SimdLevel) -> DMatrix<f64> {
        let n = self.of_row.len();
        let mut square = DMatrix::zeros(n, n);
        let blocks = square.as_mut_slice().par_chunks_mut(COLUMNS_A_TASK * n.max(1));
        blocks.enumerate().for_each(|(block, columns)| {
            let mut sums = vec![[0.0; LANES]; n.div_ceil(LANES)];
            for (row, column) in (block * COLUMNS_A_TASK..).zip(columns.chunks_exact_mut(n)) {
                sums.fill([0.0; LANES]);
                level.run(AddClasses { incidence: self, d, entries: &self.entries[row], sums: &mut sums });
                column[row..].copy_from_slice(&sums.as_flattened()[row..n]);
            }
        });
        square
    }
}

/// Rows of a class that stand side by side.
#[derive(Clone, Copy)]
struct RowGroup {
    /// Number of the group: its first row is `LANES` times that.
    group: u16,
    /// The rows, a bit each.
    mask: u8,
}

/// A class of a row, and where its rows from the row's own group on begin among the groups.
#[derive(Clone, Copy)]
struct Entry {
    class: u32,
    first_group: u32,
}

/// Adds to each row that shares a class with one row the weights of these classes.
struct AddClasses<'a> {
    incidence: &'a Incidence<'a>,
    d: &'a [f64],
    /// Classes of the row, ascending.
    entries: &'a [Entry],
    sums: &'a mut [[f64; LANES]],
}

impl Kernel for AddClasses<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Incidence { groups, group_starts, .. } = self.incidence;
        for Entry { class, first_group } in self.entries {
            let weight = self.d[*class as usize].to_bits();
            let last = group_starts[*class as usize + 1];
            for RowGroup { group, mask } in &groups[*first_group as usize..last as usize] {
                let chosen = &LANES_OF[usize::from(*mask)];
                let sums = &mut self.sums[usize::from(*group)];
                // A sum of weights that are not negative is never −0, so that adding 0 leaves it as it is.
                *sums = std::array::from_fn(|lane| sums[lane] + f64::from_bits(weight & chosen[lane]));
            }
        }
    }
}

/// All bits of each row of a group that is among those of a mask, none of the others.
const LANES_OF: &[[u64; LANES]; 256] = &{
    let mut lanes = [[0; LANES]; 256];
    let mut mask = 0;
    while mask < 256 {
        let mut lane = 0;
        while lane < LANES {
            lanes[mask][lane] = if mask >> lane & 1 == 1 { u64::MAX } else { 0 };
            lane += 1;
        }
        mask += 1;
    }
    lanes
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_square_is_that_of_single_sums_bit_by_bit() {
        for (rows, classes) in [(1, 1), (7, 40), (8, 300), (37, 500), (130, 900)] {
            let mut state = 0.37;
            let mut share = move || {
                state = 3.9 * state * (1.0 - state);
                state
            };
            let of_row: Vec<Vec<u32>> =
                (0..rows).map(|row| (0..classes).filter(|class| (class + row) % 9 == 0 || share() > 0.8).collect()).collect();
            let d: Vec<f64> = (0..classes).map(|class| if class % 11 == 0 { 0.0 } else { share() }).collect();
            let incidence = Incidence::new(&of_row, classes as usize);
            for level in SimdLevel::available() {
                let square = incidence.weighted_square(&d, level);
                for (j, of_j) in of_row.iter().enumerate() {
                    for (i, of_i) in of_row.iter().enumerate().skip(j) {
                        let shared = of_j.iter().filter(|class| of_i.contains(class));
                        let expected: f64 = shared.fold(0.0, |sum, class| sum + d[*class as usize]);
                        assert_eq!(square[(i, j)].to_bits(), expected.to_bits(), "{i}, {j} of {rows} at {}", level.as_str());
                    }
                }
            }
        }
    }
}
