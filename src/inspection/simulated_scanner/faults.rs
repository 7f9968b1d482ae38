//! Faults of files, for tests and rehearsals: cropped clouds, wrong units, views that were exchanged.

use super::{CellFate, SimulatedView};
use crate::inspection::ViewScan;

/// Cuts columns off the right side of a view; `kept` is the share of the columns that stays.
pub fn crop(view: &mut SimulatedView, kept: f64) {
    let columns = view.grid.size.columns;
    let end = (kept.clamp(0.0, 1.0) * columns as f64) as usize;
    let cells = view.scan.scanner_cloud.points_mm.iter_mut().zip(&mut view.fates).enumerate();
    for (_, (point, fate)) in cells.filter(|(cell, _)| cell % columns >= end) {
        if *fate == CellFate::Returned {
            *fate = CellFate::OutsideFile;
        }
        *point = [f32::NAN; 3];
    }
}

/// Writes coordinates in a unit of `unit_mm`, as a file does that does not say so.
pub fn in_unit(scan: &mut ViewScan, unit_mm: f64) {
    let scaled = |coordinate: f32| (f64::from(coordinate) / unit_mm) as f32;
    scan.scanner_cloud.points_mm.iter_mut().for_each(|point| *point = point.map(scaled));
}

/// Exchanges the clouds of two views, as files with each other's names do.
pub fn swap(scans: &mut [ViewScan], first: usize, second: usize) {
    let cloud = scans[first].scanner_cloud.clone();
    scans[first].scanner_cloud = std::mem::replace(&mut scans[second].scanner_cloud, cloud);
}
