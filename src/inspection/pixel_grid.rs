//! The grid of an organised cloud over the left camera's image: cell (c, r) of W/n × H/n cells has the ray of the pixel position
//! ((c + ½)·n, (r + ½)·n), in the convention of [`crate::cell::Lens`].

use nalgebra::{Isometry3, Point3, Vector2, Vector3};

use crate::cell::{Lens, Scanner};
use crate::geometry::CloudGrid;

/// Cells of n × n pixels over an image, and the rays through their middles.
#[derive(Clone, Copy, Debug)]
pub struct PixelGrid {
    /// n.
    pub step_px: f64,
    /// Cells a row, and rows.
    pub size: CloudGrid,
    lens: Lens,
    device_from_scanner: Isometry3<f64>,
    scanner_from_device: Isometry3<f64>,
}

impl PixelGrid {
    /// Grid of every `step_px`-th pixel of the left camera.
    #[must_use]
    pub fn new(scanner: &Scanner, step_px: u32) -> Self {
        let left = &scanner.devices.left;
        let step_px = f64::from(step_px.max(1));
        let cells = |size_px: f64| ((size_px / step_px).floor() as usize).max(1);
        let size = CloudGrid { columns: cells(left.lens.width_px), rows: cells(left.lens.height_px) };
        let scanner_from_device = *left.scanner_from_device.isometry();
        Self { step_px, size, lens: left.lens, device_from_scanner: scanner_from_device.inverse(), scanner_from_device }
    }

    /// Grid that has these columns and rows; `None` where no step gives them.
    #[must_use]
    pub fn of_size(scanner: &Scanner, size: CloudGrid) -> Option<Self> {
        let width_px = scanner.devices.left.lens.width_px;
        // Columns are ⌊width / n⌋, so that n lies in (width / (columns + 1), width / columns].
        let largest = (width_px / size.columns.max(1) as f64).floor() as u32;
        let smallest = (width_px / (size.columns as f64 + 1.0)).floor() as u32;
        (smallest.max(1)..=largest.max(1)).rev().map(|step_px| Self::new(scanner, step_px)).find(|grid| grid.size == size)
    }

    /// Number of cells.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.size.columns * self.size.rows
    }

    /// Optical centre, scanner frame.
    #[must_use]
    pub fn centre_mm(&self) -> Point3<f64> {
        Point3::from(self.scanner_from_device.translation.vector)
    }

    /// Direction of a cell's ray in the left camera's frame, at depth 1.
    #[must_use]
    pub fn device_ray(&self, cell: usize) -> Vector3<f64> {
        let (column, row) = (cell % self.size.columns, cell / self.size.columns);
        let middle = |number: usize| (number as f64 + 0.5) * self.step_px;
        self.lens.unproject(&Vector2::new(middle(column), middle(row)))
    }

    /// Direction of a cell's ray in the scanner's frame; as long as it is for one mm of depth in the camera.
    #[must_use]
    pub fn ray(&self, cell: usize) -> Vector3<f64> {
        self.scanner_from_device.rotation * self.device_ray(cell)
    }

    /// Column and row in which a point of the scanner's frame is imaged; `None` outside of the grid.
    #[must_use]
    pub fn cell_of(&self, scanner_mm: &Point3<f64>) -> Option<[usize; 2]> {
        self.cell_at(self.image_of(scanner_mm)?.0)
    }

    /// Column and row at a place, in cells; `None` outside of the grid.
    #[inline]
    #[must_use]
    pub fn cell_at(&self, [column, row]: [f64; 2]) -> Option<[usize; 2]> {
        let is_inside = column >= 0.0 && row >= 0.0 && (column as usize) < self.size.columns && (row as usize) < self.size.rows;
        is_inside.then_some([column as usize, row as usize])
    }

    /// Length that a cell spans on a surface at a depth, mm.
    #[must_use]
    pub fn cell_mm(&self, depth_mm: f64) -> f64 {
        self.step_px * depth_mm / self.lens.focal_px()
    }

    /// Place of the image of a point in the scanner's frame, in cells, and its depth along the camera's axis, mm; `None` outside
    /// of the image.
    #[inline]
    #[must_use]
    pub fn image_of(&self, scanner_mm: &Point3<f64>) -> Option<([f64; 2], f64)> {
        let at = self.device_from_scanner * scanner_mm;
        let (u, v, is_inside) = self.lens.image(at.x, at.y, at.z);
        is_inside.then_some(([u, v].map(|position| position / self.step_px), at.z))
    }

    /// Number of a cell in a cloud of this grid.
    #[must_use]
    pub fn number(&self, [column, row]: [usize; 2]) -> usize {
        row * self.size.columns + column
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::nominal_scanner;

    #[test]
    fn cells_have_the_rays_of_their_middles_on_both_sides_of_the_principal_point_alike() {
        let scanner = nominal_scanner();
        let lens = scanner.devices.left.lens;
        assert_eq!([lens.cx, lens.cy], [0.5 * lens.width_px, 0.5 * lens.height_px], "the principal point is the image's middle");
        for step_px in [1, 2, 3, 4] {
            let grid = PixelGrid::new(&scanner, step_px);
            let [columns, rows] = [grid.size.columns, grid.size.rows];
            let pixel = lens.project(&Point3::from(grid.device_ray(grid.number([2, 1])))).expect("inside the image");
            let middle_px = [2.5, 1.5].map(|cells| cells * f64::from(step_px));
            assert!((pixel - Vector2::from(middle_px)).norm() < 1e-9, "{pixel}");
            let ray = grid.ray(grid.number([2, 1]));
            assert_eq!(grid.cell_of(&(grid.centre_mm() + ray * 400.0)), Some([2, 1]));
            if columns as f64 * grid.step_px == lens.width_px && rows as f64 * grid.step_px == lens.height_px {
                let [first, last] = [[0, 0], [columns - 1, rows - 1]].map(|cell| grid.device_ray(grid.number(cell)));
                assert!((first.xy() + last.xy()).norm() < 1e-12, "{first} {last}");
            }
        }
    }
}
