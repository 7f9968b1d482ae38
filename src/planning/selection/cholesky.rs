//! Cholesky factors of the relaxation's systems, a few hundred rows each: nalgebra's factorisation takes a column at a time, and
//! an element so passes through the memory once for each column before its own; here eight columns of sixteen rows stay in
//! registers meanwhile. The operations on an element are the same, in the same order: the factors are nalgebra's, bit by bit.

use nalgebra::{Cholesky, DMatrix, Dyn};

use crate::geometry::{Kernel, SimdLevel};

/// Columns that are updated together, and rows of them.
const COLUMNS: usize = 8;
const ROWS: usize = 16;

/// Factors a symmetric matrix, of which the lower triangle is given; `None` where it is not positive definite.
pub(super) fn factored(mut matrix: DMatrix<f64>, level: SimdLevel) -> Option<Cholesky<f64, Dyn>> {
    let n = matrix.nrows();
    let is_definite = level.run(Factor { n, columns: matrix.as_mut_slice() });
    is_definite.then(|| Cholesky::pack_dirty(matrix))
}

struct Factor<'a> {
    n: usize,
    /// The matrix, column by column.
    columns: &'a mut [f64],
}

impl Kernel for Factor<'_> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Self { n, columns } = self;
        for first in (0..n).step_by(COLUMNS) {
            let width = COLUMNS.min(n - first);
            let (before, panel) = columns.split_at_mut(first * n);
            let mut row = first;
            while width == COLUMNS && row + ROWS <= n {
                update_tile(before, panel, n, (first, row));
                row += ROWS;
            }
            for row in row..n {
                for place in 0..width {
                    let own = &mut panel[place * n + row];
                    for column in before.chunks_exact(n) {
                        *own += -column[first + place] * column[row];
                    }
                }
            }
            if !factor_panel(panel, n, first, width) {
                return false;
            }
        }
        true
    }
}

/// Subtracts what the columns `before` take from a tile of the panel.
#[inline(always)]
fn update_tile(before: &[f64], panel: &mut [f64], n: usize, (first, row): (usize, usize)) {
    let mut tile = [[0.0; ROWS]; COLUMNS];
    for place in 0..COLUMNS {
        tile[place].copy_from_slice(&panel[place * n + row..][..ROWS]);
    }
    for column in before.chunks_exact(n) {
        let (factors, rows) = (&column[first..][..COLUMNS], &column[row..][..ROWS]);
        for place in 0..COLUMNS {
            let factor = -factors[place];
            for lane in 0..ROWS {
                tile[place][lane] += factor * rows[lane];
            }
        }
    }
    for place in 0..COLUMNS {
        panel[place * n + row..][..ROWS].copy_from_slice(&tile[place]);
    }
}

/// Factors the columns of a panel among themselves; returns false at a pivot that is not positive.
#[inline(always)]
fn factor_panel(panel: &mut [f64], n: usize, first: usize, width: usize) -> bool {
    for place in 0..width {
        let (done, rest) = panel.split_at_mut(place * n);
        let (row, column) = (first + place, &mut rest[..n]);
        for other in done.chunks_exact(n) {
            let factor = -other[row];
            for (own, other) in column[row..].iter_mut().zip(&other[row..]) {
                *own += factor * other;
            }
        }
        let pivot = column[row];
        if pivot.is_nan() || pivot <= 0.0 {
            return false;
        }
        let root = pivot.sqrt();
        column[row] = root;
        column[row + 1..].iter_mut().for_each(|value| *value /= root);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A positive definite matrix, its numbers from a recurrence.
    fn definite(n: usize) -> DMatrix<f64> {
        let mut state = 0.4;
        let half = DMatrix::from_fn(n, n, |_, _| {
            state = 3.9 * state * (1.0 - state);
            state - 0.5
        });
        &half * half.transpose() + DMatrix::identity(n, n)
    }

    #[test]
    fn factors_are_those_of_the_library_bit_by_bit() {
        for n in [1, 7, 8, 9, 24, 31, 70, 133] {
            let matrix = definite(n);
            let theirs = Cholesky::new(matrix.clone()).expect("definite").l();
            for level in SimdLevel::available() {
                let ours = factored(matrix.clone(), level).expect("definite").l();
                assert!(
                    ours.iter().zip(&theirs).all(|(ours, theirs)| ours.to_bits() == theirs.to_bits()),
                    "{n}, {}",
                    level.as_str()
                );
            }
        }
    }

    #[test]
    fn what_is_not_definite_is_refused() {
        let mut matrix = definite(20);
        matrix[(13, 13)] = -1.0;
        assert!(factored(matrix.clone(), SimdLevel::widest()).is_none());
        matrix[(13, 13)] = f64::NAN;
        assert!(factored(matrix, SimdLevel::widest()).is_none());
    }
}
