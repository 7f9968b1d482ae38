//! Puts a cloud without a grid, or with another one, into the left camera's: each cell keeps the nearest of the points that it images.

use nalgebra::Point3;

use super::camera::LeftCamera;
use super::clean::{Removed, RemovedBecause};
use crate::geometry::PointCloud;

/// Cell sizes that are tried, pixels.
const CELL_PIXELS: [usize; 10] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32];
/// Share of the neighbours of occupied cells that are occupied, from which on a cloud is dense in its grid: with less the spacing of the
/// points exceeds the cell.
const DENSE_SHARE: f64 = 0.85;

/// Organises points in the scanner's frame. The cells are the smallest that the points fill: a cell of n pixels spans n·z/f on a
/// surface at depth z, as much as the points' spacing.
pub(super) fn project(points_mm: &[[f32; 3]], camera: &LeftCamera<'_>, removed: &mut Removed) -> PointCloud {
    let pixels: Vec<Option<([f32; 2], f32)>> = points_mm.iter().map(|point| pixel_of(point, camera)).collect();
    let missing = points_mm.iter().zip(&pixels).filter(|(point, pixel)| !point[0].is_nan() && pixel.is_none()).count();
    removed.count(RemovedBecause::OutsideImage, missing);
    let dense = CELL_PIXELS.into_iter().find(|size| fill(&pixels, camera, *size) >= DENSE_SHARE);
    let size = dense.unwrap_or(CELL_PIXELS[CELL_PIXELS.len() - 1]);
    let grid = camera.grid(size);
    let mut depth = vec![f32::INFINITY; grid.columns * grid.rows];
    let mut cells = vec![[f32::NAN; 3]; grid.columns * grid.rows];
    for (point, pixel) in points_mm.iter().zip(&pixels) {
        let Some((pixel, own_depth)) = pixel else { continue };
        if let Some([column, row]) = LeftCamera::cell(pixel.map(f64::from), size as f64, grid) {
            let cell = row * grid.columns + column;
            if *own_depth < depth[cell] {
                (depth[cell], cells[cell]) = (*own_depth, *point);
            }
        }
    }
    PointCloud { points_mm: cells, grid: Some(grid) }
}

fn pixel_of(point: &[f32; 3], camera: &LeftCamera<'_>) -> Option<([f32; 2], f32)> {
    let (pixel, depth) = camera.pixel(&Point3::from(point.map(f64::from)))?;
    Some((pixel.map(|value| value as f32), depth as f32))
}

/// Share of the right and lower neighbours of occupied cells that are occupied.
fn fill(pixels: &[Option<([f32; 2], f32)>], camera: &LeftCamera<'_>, size: usize) -> f64 {
    let grid = camera.grid(size);
    let mut is_occupied = vec![false; grid.columns * grid.rows];
    for (pixel, _) in pixels.iter().flatten() {
        if let Some([column, row]) = LeftCamera::cell(pixel.map(f64::from), size as f64, grid) {
            is_occupied[row * grid.columns + column] = true;
        }
    }
    let (mut neighbours, mut occupied) = (0_usize, 0_usize);
    for row in 0..grid.rows.saturating_sub(1) {
        for column in 0..grid.columns.saturating_sub(1) {
            let cell = row * grid.columns + column;
            if is_occupied[cell] {
                neighbours += 2;
                occupied += usize::from(is_occupied[cell + 1]) + usize::from(is_occupied[cell + grid.columns]);
            }
        }
    }
    occupied as f64 / neighbours.max(1) as f64
}
