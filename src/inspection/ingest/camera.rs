//! The left camera, whose image clouds are organised in: cell (c, r) of a grid of W/n × H/n cells has the ray of the pixel position
//! ((c + ½)·n, (r + ½)·n).

use nalgebra::{Isometry3, Point3};

use crate::cell::{Lens, Scanner};
use crate::geometry::CloudGrid;

/// Left camera of a scanner.
pub(in crate::inspection) struct LeftCamera<'a> {
    lens: &'a Lens,
    pub(in crate::inspection) device_from_scanner: Isometry3<f64>,
    /// Optical centre, scanner frame.
    pub(in crate::inspection) centre_mm: Point3<f64>,
}

impl<'a> LeftCamera<'a> {
    pub(in crate::inspection) fn of(scanner: &'a Scanner) -> Self {
        let left = &scanner.devices.left;
        let device_from_scanner = *left.scanner_from_device.inverse().isometry();
        Self { lens: &left.lens, device_from_scanner, centre_mm: left.scanner_from_device.origin_mm() }
    }

    /// Pixel position of a point, and its depth along the camera's axis.
    #[inline]
    pub(in crate::inspection) fn pixel(&self, point: &Point3<f64>) -> Option<([f64; 2], f64)> {
        let at = self.device_from_scanner * point;
        let (u, v, is_inside) = self.lens.image(at.x, at.y, at.z);
        is_inside.then_some(([u, v], at.z))
    }

    /// The grid with cells of n × n pixels.
    pub(in crate::inspection) fn grid(&self, pixels: usize) -> CloudGrid {
        let cells = |size: f64| ((size / pixels as f64) as usize).max(1);
        CloudGrid { columns: cells(self.lens.width_px), rows: cells(self.lens.height_px) }
    }

    /// Whole pixels along the edge of a cell of this grid: columns are ⌊width / n⌋.
    pub(in crate::inspection) fn pixels_of(&self, grid: CloudGrid) -> f64 {
        (self.lens.width_px / grid.columns.max(1) as f64).floor().max(1.0)
    }

    /// Returns true if a grid divides the image into square cells of whole pixels.
    pub(in crate::inspection) fn fits(&self, grid: Option<CloudGrid>) -> bool {
        grid.is_some_and(|grid| self.grid(self.pixels_of(grid) as usize) == grid)
    }

    /// Cell of a pixel position: the one whose own position is nearest.
    #[inline]
    pub(in crate::inspection) fn cell([u, v]: [f64; 2], pixels: f64, grid: CloudGrid) -> Option<[usize; 2]> {
        let (column, row) = (u / pixels, v / pixels);
        let is_inside = column >= 0.0 && row >= 0.0 && (column as usize) < grid.columns && (row as usize) < grid.rows;
        is_inside.then_some([column as usize, row as usize])
    }
}
