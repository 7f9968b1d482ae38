//! A view's cloud by cells of the left camera's image. An organised cloud is read where it lies; another one is put into cells
//! by projection, the nearest point of a cell first.

use std::borrow::Cow;

use nalgebra::{Point3, Vector3};

use crate::cell::Scanner;
use crate::geometry::PointCloud;
use crate::inspection::PixelGrid;

/// Largest step that is looked for in a cloud without a grid, pixels.
const MAX_STEP_PX: u32 = 32;
/// Share of the occupied cells that have a neighbour to the right and below, from which on cells are large enough: inside of a
/// surface all have both.
const FILLED: f64 = 0.6;
/// Index of a cell without a point.
const NONE: u32 = u32::MAX;

/// Points of one view by cells.
pub struct GriddedCloud<'a> {
    grid: PixelGrid,
    points_mm: &'a [[f32; 3]],
    /// Point of each cell, where the cloud is not organised.
    of_cell: Option<Cow<'a, [u32]>>,
}

impl<'a> GriddedCloud<'a> {
    /// Takes `cloud`, in the scanner's frame, by its own grid, or finds one.
    #[must_use]
    pub fn new(scanner: &Scanner, cloud: &'a PointCloud) -> Self {
        let own = cloud.grid.and_then(|size| PixelGrid::of_size(scanner, size));
        if let Some(grid) = own.filter(|grid| grid.cells() == cloud.points_mm.len()) {
            return Self { grid, points_mm: &cloud.points_mm, of_cell: None };
        }
        let first = lattice_step(&PixelGrid::new(scanner, 1), cloud);
        let gridded = |step_px: u32| by_projection(PixelGrid::new(scanner, step_px), cloud);
        // Points that lie on no lattice have gaps beside each other: cells grow until they hold one each.
        let filled = (first..=MAX_STEP_PX).map(gridded).find(GriddedCloud::is_filled);
        filled.unwrap_or_else(|| gridded(first))
    }

    /// Grid of the cloud.
    #[must_use]
    pub fn grid(&self) -> &PixelGrid {
        &self.grid
    }

    /// The point of a cell, scanner frame.
    #[must_use]
    pub fn point(&self, cell: [usize; 2]) -> Option<Point3<f64>> {
        let number = self.grid.number(cell);
        let point = match &self.of_cell {
            None => self.points_mm[number],
            Some(of_cell) => *self.points_mm.get(of_cell[number] as usize)?,
        };
        let point = Point3::from(point.map(f64::from));
        (point.x.is_finite() && point.y.is_finite() && point.z.is_finite()).then_some(point)
    }

    /// The point of a cell so many columns and rows off.
    pub(in crate::inspection) fn neighbour(&self, [column, row]: [usize; 2], right: isize, down: isize) -> Option<Point3<f64>> {
        let column = column.checked_add_signed(right).filter(|column| *column < self.grid.size.columns)?;
        let row = row.checked_add_signed(down).filter(|row| *row < self.grid.size.rows)?;
        self.point([column, row])
    }

    /// Most points in one of the four squares of 2 × 2 cells that hold a cell, which has a point itself.
    pub(in crate::inspection) fn best_square(&self, cell: [usize; 2]) -> u32 {
        let has = |right, down| u32::from(self.neighbour(cell, right, down).is_some());
        let count = |[right, down]: [isize; 2]| 1 + has(right, 0) + has(0, down) + has(right, down);
        QUADRANTS.into_iter().map(count).max().unwrap_or(1)
    }

    /// Largest cosine between `normal`, in the scanner's frame, and those of the triangles that a point forms with its neighbours
    /// along row and column, up to `reach` cells off: on the near side of an edge one of them lies on the point's own surface.
    /// `None` where it has no such neighbours.
    pub(in crate::inspection) fn best_normal_cos(
        &self,
        cell: [usize; 2],
        point: &Point3<f64>,
        normal: &Vector3<f64>,
        reach: isize,
        enough: f64,
    ) -> Option<f64> {
        let mut best: Option<f64> = None;
        for offset in (1..=reach).rev() {
            for [right, down] in QUADRANTS {
                let beside = self.neighbour(cell, right * offset, 0).zip(self.neighbour(cell, 0, down * offset));
                let Some((along_row, along_column)) = beside else { continue };
                let across = (along_row - point).cross(&(along_column - point)) * (right * down) as f64;
                // Rows go down and columns to the right as the camera looks along +z: the cross product points away from it.
                let cos = -across.dot(normal) / across.norm();
                if cos.is_finite() {
                    best = Some(best.map_or(cos, |best| best.max(cos)));
                }
                if best.is_some_and(|best| best >= enough) {
                    return best;
                }
            }
        }
        best
    }

    /// Returns true if most occupied cells have occupied ones to the right and below.
    fn is_filled(&self) -> bool {
        let (mut occupied, mut joined) = (0_usize, 0_usize);
        for cell in 0..self.grid.cells() {
            let cell = [cell % self.grid.size.columns, cell / self.grid.size.columns];
            if self.point(cell).is_some() {
                occupied += 1;
                joined += usize::from(self.neighbour(cell, 1, 0).is_some() && self.neighbour(cell, 0, 1).is_some());
            }
        }
        joined as f64 >= FILLED * occupied as f64
    }
}

/// Signs of the offsets along row and column of the four quadrants around a cell.
const QUADRANTS: [[isize; 2]; 4] = [[1, 1], [-1, 1], [1, -1], [-1, -1]];

/// Distance between points along the rows of the image that is met most often, in cells of a grid of single pixels.
fn lattice_step(pixels: &PixelGrid, cloud: &PointCloud) -> u32 {
    // Rays through middles of cells meet the borders of pixels: a quarter beside them no rounding counts.
    let place = |(_, point): (usize, Point3<f64>)| pixels.cell_at(pixels.image_of(&point)?.0.map(|place| place + 0.25));
    let mut cells: Vec<u32> = cloud.finite().filter_map(place).map(|cell| pixels.number(cell) as u32).collect();
    cells.sort_unstable();
    let columns = pixels.size.columns as u32;
    let mut counts = [0_usize; MAX_STEP_PX as usize + 1];
    for pair in cells.windows(2).filter(|pair| pair[0] / columns == pair[1] / columns) {
        if let Some(count) = counts.get_mut((pair[1] - pair[0]) as usize) {
            *count += 1;
        }
    }
    (1..=MAX_STEP_PX).rev().max_by_key(|step| counts[*step as usize]).unwrap_or(1)
}

fn by_projection<'a>(grid: PixelGrid, cloud: &'a PointCloud) -> GriddedCloud<'a> {
    let mut of_cell = vec![NONE; grid.cells()];
    for (number, point) in cloud.finite() {
        let Some(cell) = grid.cell_of(&point) else { continue };
        let nearest = &mut of_cell[grid.number(cell)];
        let is_nearer = |other: u32| f64::from(cloud.points_mm[other as usize][2]) > point.z;
        if *nearest == NONE || is_nearer(*nearest) {
            *nearest = number as u32;
        }
    }
    GriddedCloud { grid, points_mm: &cloud.points_mm, of_cell: Some(Cow::Owned(of_cell)) }
}
