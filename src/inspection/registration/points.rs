//! Points of a view that are matched: every so many of those that are there.

use nalgebra::{Isometry3, Point3};

use crate::inspection::ViewScan;

/// Some points of a view, scanner frame.
pub(super) struct ViewPoints {
    pub(super) part_from_scanner: Isometry3<f64>,
    pub(super) points_mm: Vec<Point3<f64>>,
    /// Points that the view has, of which these are some.
    pub(super) there: usize,
}

impl ViewPoints {
    /// Some of the points, spread evenly over the view, no more than so many: of an organised cloud the cells of a coarser grid.
    pub(super) fn of(scan: &ViewScan, max_points: usize) -> Self {
        let cloud = &scan.scanner_cloud;
        let there = cloud.finite().count();
        let part_from_scanner = *scan.part_from_scanner.isometry();
        let every = there.div_ceil(max_points.max(1)).max(1);
        let points_mm = match cloud.grid {
            Some(grid) if every > 1 => {
                let step = (1..).find(|step: &usize| step * step >= every).unwrap_or(1);
                let on_grid =
                    |number: usize| (number % grid.columns).is_multiple_of(step) && (number / grid.columns).is_multiple_of(step);
                cloud.finite().filter(|(number, _)| on_grid(*number)).map(|(_, point)| point).collect()
            }
            _ => cloud.finite().step_by(every).map(|(_, point)| point).collect(),
        };
        Self { part_from_scanner, points_mm, there }
    }
}
