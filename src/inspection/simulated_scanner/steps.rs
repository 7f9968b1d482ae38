//! Steps of depth in the left camera's image: where neighbouring rays meet surfaces that no plane through either joins.

use rayon::prelude::*;

use super::cast::FirstHits;

/// Cells with a hit within `reach` cells of a step, which runs midway between two cells.
pub(super) fn near_steps(hits: &FirstHits<'_>, step_mm: f64, reach: f64) -> Vec<bool> {
    let size = hits.size();
    // From the middle of the cell beside the step.
    let radius = reach - 0.5;
    if radius < 0.0 {
        return vec![false; size.columns * size.rows];
    }
    let row_of = |row: usize| {
        let beside = |column: usize| {
            let mut neighbours = [(-1, 0), (1, 0), (0, -1), (0, 1)].into_iter().filter_map(|(right, down)| {
                let column = column.checked_add_signed(right).filter(|column| *column < size.columns)?;
                let row = row.checked_add_signed(down).filter(|row| *row < size.rows)?;
                Some(row * size.columns + column)
            });
            let cell = row * size.columns + column;
            hits.is_hit(cell) && neighbours.any(|other| hits.is_step(cell, other, step_mm))
        };
        (0..size.columns).map(beside).collect::<Vec<_>>()
    };
    let marked: Vec<bool> = (0..size.rows).into_par_iter().flat_map_iter(row_of).collect();
    let along: Vec<usize> = marked.par_chunks(size.columns).flat_map_iter(distances).collect();
    let lines = radius as usize;
    (0..marked.len())
        .into_par_iter()
        .map(|cell| {
            let row = cell / size.columns;
            let rows = row.saturating_sub(lines)..size.rows.min(row + lines + 1);
            rows.into_iter().any(|other| {
                let across = along[other * size.columns + cell % size.columns] as f64;
                across.hypot(row.abs_diff(other) as f64) <= radius
            })
        })
        .collect()
}

/// Distance of each place of a line from the nearest mark.
fn distances(line: &[bool]) -> Vec<usize> {
    // Longer than any line, and far from overflow.
    let mut distances = vec![usize::MAX / 2; line.len()];
    let mut sweep = |places: &mut dyn Iterator<Item = usize>| {
        let mut distance = usize::MAX / 2;
        for place in places {
            distance = if line[place] { 0 } else { distance + 1 };
            distances[place] = distances[place].min(distance);
        }
    };
    sweep(&mut (0..line.len()));
    sweep(&mut (0..line.len()).rev());
    distances
}
