//! Scans whose points lie scattered in their grid: a cloud without the camera's grid that is thinner than the largest cells, or an organised
//! one of which most points are gone everywhere. An empty cell between points is then no loss of its own.

use crate::inspection::coverage::GriddedCloud;

/// Share of the neighbours of occupied cells that are occupied too, below which the points of an organised scan are scattered. Not from a
/// source: areas without points, however many, leave more.
const MIN_FILL: f64 = 0.6;
/// Cells of so many pixels are the largest into which a cloud without the camera's grid is put, whether points fill them or not; those that
/// they fill have this share of neighbours.
const LARGEST_CELL_PX: f64 = 32.0;
const MIN_LARGE_FILL: f64 = 0.85;

/// Returns true if the points of a scan lie scattered in its grid.
pub(super) fn is_scattered(cloud: &GriddedCloud<'_>) -> bool {
    let grid = cloud.grid();
    let (mut neighbours, mut occupied) = (0_usize, 0_usize);
    for row in 0..grid.size.rows.saturating_sub(1) {
        for column in 0..grid.size.columns.saturating_sub(1) {
            if cloud.point([column, row]).is_some() {
                let beside = [[column + 1, row], [column, row + 1]];
                neighbours += beside.len();
                occupied += beside.into_iter().filter(|cell| cloud.point(*cell).is_some()).count();
            }
        }
    }
    let min_fill = if grid.step_px >= LARGEST_CELL_PX { MIN_LARGE_FILL } else { MIN_FILL };
    (occupied as f64) < min_fill * neighbours as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::PointCloud;
    use crate::inspection::PixelGrid;
    use crate::testing::nominal_scanner;

    #[test]
    fn points_are_scattered_where_empty_cells_lie_between_them_and_not_where_an_area_has_none() {
        let scanner = nominal_scanner();
        let is_scattered_at = |step_px: u32, has_point: &dyn Fn(usize, usize) -> bool| {
            let grid = PixelGrid::new(&scanner, step_px);
            let point = |number: usize| {
                let at = grid.centre_mm() + grid.ray(number) * 400.0;
                let is_there = has_point(number % grid.size.columns, number / grid.size.columns);
                if is_there { [at.x as f32, at.y as f32, at.z as f32] } else { [f32::NAN; 3] }
            };
            let cloud = PointCloud { points_mm: (0..grid.cells()).map(point).collect(), grid: Some(grid.size) };
            is_scattered(&GriddedCloud::new(&scanner, &cloud))
        };
        assert!(!is_scattered_at(16, &|_, _| true) && !is_scattered_at(32, &|_, _| true), "full");
        assert!(!is_scattered_at(16, &|column, _| column < 50), "an area is empty");
        assert!(is_scattered_at(16, &|column, row| (column + row).is_multiple_of(2)), "every second cell is empty");
        let has_gaps = |column: usize, row: usize| !(column + 2 * row).is_multiple_of(5);
        assert!(!is_scattered_at(16, &has_gaps) && is_scattered_at(32, &has_gaps), "a fifth of the cells is empty");
    }
}
