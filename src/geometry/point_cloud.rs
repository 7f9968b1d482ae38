//! Points that a scanner measured.

use nalgebra::Point3;

/// Columns and rows of an organised cloud: a point, or none, for each cell of a grid over a camera's image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CloudGrid {
    /// Cells a row.
    pub columns: usize,
    /// Rows, from the top of the image.
    pub rows: usize,
}

/// Points in one frame, which the name of the variable or field says. 12 bytes a point: single precision resolves 0.06 µm at 1 m.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Coordinates, mm. A cell of an organised cloud without a point holds NaN.
    pub points_mm: Vec<[f32; 3]>,
    /// `Some` where the cloud is organised; `points_mm` then goes row by row.
    pub grid: Option<CloudGrid>,
}

impl PointCloud {
    /// The points that are there, with their numbers.
    pub fn finite(&self) -> impl Iterator<Item = (usize, Point3<f64>)> + '_ {
        let present = |(number, point): (usize, &[f32; 3])| {
            let point = point.map(f64::from);
            point.iter().all(|coordinate| coordinate.is_finite()).then(|| (number, Point3::from(point)))
        };
        self.points_mm.iter().enumerate().filter_map(present)
    }
}
