//! Puts a cloud without a grid, or with another one, into the left camera's: each cell keeps the nearest of the points that it images.

use nalgebra::Point3;

use super::clean::{Removed, RemovedBecause};
use crate::cell::Scanner;
use crate::geometry::{CloudGrid, PointCloud};
use crate::inspection::PixelGrid;

/// Cell sizes that are tried, pixels.
pub(super) const CELL_PIXELS: [u32; 10] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32];
/// Share of the neighbours of occupied cells that are occupied, from which on a cloud is dense in its grid: with less the spacing of the
/// points exceeds the cell.
pub(super) const DENSE_SHARE: f64 = 0.85;
/// Distance of a point's image from the middle of its own cell that poses and lenses which are a little off explain, cells. Samples take
/// the points of few cells around their image.
const NEAR_CELLS: f64 = 1.0;
/// Points of which the images are held against their cells.
const TRIED_POINTS: usize = 2000;

/// Organises points in the scanner's frame. The cells are the smallest that the points fill: a cell of n pixels spans n·z/f on a
/// surface at depth z, as much as the points' spacing.
pub(super) fn project(points_mm: &[[f32; 3]], scanner: &Scanner, removed: &mut Removed) -> PointCloud {
    let image = PixelGrid::new(scanner, 1);
    let pixels: Vec<Option<([f32; 2], f32)>> = points_mm.iter().map(|point| pixel_of(point, &image)).collect();
    let missing = points_mm.iter().zip(&pixels).filter(|(point, pixel)| !point[0].is_nan() && pixel.is_none()).count();
    removed.count(RemovedBecause::OutsideImage, missing);
    removed.is_projected = true;
    let grid = filled_grid(&pixels, scanner);
    let mut depth = vec![f32::INFINITY; grid.cells()];
    let mut cells = vec![[f32::NAN; 3]; grid.cells()];
    for (point, pixel) in points_mm.iter().zip(&pixels) {
        let Some((pixel, own_depth)) = pixel else { continue };
        if let Some(cell) = cell_in(&grid, *pixel).filter(|cell| *own_depth < depth[*cell]) {
            (depth[cell], cells[cell]) = (*own_depth, *point);
        }
    }
    PointCloud { points_mm: cells, grid: Some(grid.size) }
}

/// Grid of the smallest cells that images of points, with their depths, fill; of the largest where they fill none.
pub(super) fn filled_grid(images: &[Option<([f32; 2], f32)>], scanner: &Scanner) -> PixelGrid {
    let mut grids = CELL_PIXELS.map(|step_px| PixelGrid::new(scanner, step_px)).into_iter();
    let largest = PixelGrid::new(scanner, CELL_PIXELS[CELL_PIXELS.len() - 1]);
    let places = || images.iter().flatten().map(|(pixel, _)| *pixel);
    grids.find(|grid| fill(&occupied(places(), grid), grid) >= DENSE_SHARE).unwrap_or(largest)
}

/// Returns true if most points of a cloud are imaged near their cells of a grid of its size. Else it is organised by another image, such as
/// that of another camera, or goes from the bottom up.
pub(super) fn is_in_cells(cloud: &PointCloud, grid: &PixelGrid) -> bool {
    let every = cloud.finite().count().div_ceil(TRIED_POINTS).max(1);
    let is_near = |(number, point): (usize, Point3<f64>)| {
        let own = [number % grid.size.columns, number / grid.size.columns].map(|cell| cell as f64 + 0.5);
        let Some((place, _)) = grid.image_of(&point) else { return false };
        (place[0] - own[0]).abs().max((place[1] - own[1]).abs()) <= NEAR_CELLS
    };
    let near: Vec<bool> = cloud.finite().step_by(every).map(is_near).collect();
    2 * near.iter().filter(|is_near| **is_near).count() >= near.len()
}

/// Place of a point's image in the left camera, pixels, and its depth, mm; `None` outside of the image.
pub(super) fn pixel_of(point: &[f32; 3], image: &PixelGrid) -> Option<([f32; 2], f32)> {
    let (pixel, depth) = image.image_of(&Point3::from(point.map(f64::from)))?;
    Some((pixel.map(|value| value as f32), depth as f32))
}

/// Cell of a pixel position.
pub(super) fn cell_in(grid: &PixelGrid, pixel: [f32; 2]) -> Option<usize> {
    let cell = grid.cell_at(pixel.map(|position| f64::from(position) / grid.step_px))?;
    Some(grid.number(cell))
}

/// Cells of a grid that points are imaged in.
pub(super) fn occupied(pixels: impl Iterator<Item = [f32; 2]>, grid: &PixelGrid) -> Vec<bool> {
    let mut is_occupied = vec![false; grid.cells()];
    pixels.filter_map(|pixel| cell_in(grid, pixel)).for_each(|cell| is_occupied[cell] = true);
    is_occupied
}

/// Share of the right and lower neighbours of occupied cells that are occupied.
pub(super) fn fill(is_occupied: &[bool], grid: &PixelGrid) -> f64 {
    let CloudGrid { columns, rows } = grid.size;
    let (mut neighbours, mut occupied) = (0_usize, 0_usize);
    for row in 0..rows.saturating_sub(1) {
        for column in 0..columns.saturating_sub(1) {
            let cell = grid.number([column, row]);
            if is_occupied[cell] {
                neighbours += 2;
                occupied += usize::from(is_occupied[cell + 1]) + usize::from(is_occupied[cell + columns]);
            }
        }
    }
    occupied as f64 / neighbours.max(1) as f64
}
