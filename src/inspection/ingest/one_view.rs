//! A file with the number of a view that holds the points of several: a merged cloud under a name such as `part_4.ply`.
//!
//! Along each ray of its camera a view images one point: one that lies outside of the image, or behind another, is of another view. Where
//! the part lies does not matter for that, only where the view was taken from in the frame of the file. In simulated scans of six parts,
//! whole or thinned to a point each 1, 1.5 and 2 mm, such points are up to 1.1 % of a view's own scan, and of a cloud of all views at least
//! 4.3 % (whole) and 2.5 % (thinned). A fine grille (own scans thinned to 1.5 mm: 9 %) and a thin plate (merged: 1 %) are told wrongly.

use nalgebra::Point3;

use super::frames::{FrameAttempt, PlannedCapture, best_of, is_near, try_all, try_merged};
use super::swapped::FRAMES_OF_PART;
use super::{IngestWorld, MIN_SHARE, ScanFile, organise};
use crate::geometry::CloudGrid;
use crate::inspection::PixelGrid;
use crate::planning::context::{Cancelled, Context};

/// Share of the points near the part that a view cannot have imaged, above which a file is of several views. Not from a source: between
/// the shares in simulated scans.
pub const MAX_UNSEEN_SHARE: f64 = 0.03;
/// Minimum distance behind the nearest point of a cell from which on a point is taken to lie behind it, mm: a pose that is a
/// little off moves edges by less.
const BEHIND_MM: f64 = 5.0;
/// Minimum such distance in widths of a cell: a surface that is seen more flatly than 76° alone is that deep within one.
const BEHIND_CELLS: f64 = 4.0;
/// Points that are judged.
const JUDGED_POINTS: usize = 10_000;

/// Returns true if a file that has the number of a view holds points of several: in no frame in which they lie on the part can the view
/// have imaged them, and in one that views may share they do lie on it. A cloud in the scanner's own frame is of one view.
pub(super) fn is_of_several(
    file: &ScanFile,
    capture: &PlannedCapture,
    world: &IngestWorld<'_>,
    ctx: &Context<'_>,
) -> Result<bool, Cancelled> {
    let declared = |attempt: &&FrameAttempt| {
        file.unit.is_none_or(|unit| unit == attempt.unit) && file.frame.is_none_or(|frame| frame == attempt.frame)
    };
    let tried = try_all(&file.cloud, file.unit, capture, world);
    let Some(best) = best_of(tried.iter().filter(declared)).filter(|best| best.on_part > 0.0) else { return Ok(false) };
    // Of a round part, more than one frame may fit.
    let fits = |attempt: &&FrameAttempt| attempt.on_part >= best.on_part.min(MIN_SHARE);
    for attempt in tried.iter().filter(declared).filter(fits) {
        ctx.check()?;
        if !FRAMES_OF_PART.contains(&attempt.frame) || unseen_share(file, attempt, capture, world) <= MAX_UNSEEN_SHARE {
            return Ok(false);
        }
    }
    let merged = world.captures.first().map(|first| try_merged(&file.cloud, file.unit, first, world)).unwrap_or_default();
    Ok(merged.iter().filter(declared).any(|attempt| attempt.on_part >= MIN_SHARE))
}

/// Share of the points near the part that a view cannot have imaged, in a unit and a frame.
fn unseen_share(file: &ScanFile, attempt: &FrameAttempt, capture: &PlannedCapture, world: &IngestWorld<'_>) -> f64 {
    let Some(scanner_from_frame) = capture.scanner_from(attempt.frame) else { return 0.0 };
    let to_scanner = |point: &[f32; 3]| -> [f32; 3] {
        let in_frame = Point3::from(point.map(f64::from)) * attempt.unit.mm();
        (scanner_from_frame * in_frame).coords.map(|mm| mm as f32).into()
    };
    let scanner_mm: Vec<[f32; 3]> = file.cloud.points.iter().map(to_scanner).collect();
    let image = PixelGrid::new(world.scanner, 1);
    let images: Vec<Option<([f32; 2], f32)>> = scanner_mm.iter().map(|point| organise::pixel_of(point, &image)).collect();
    let grid = organise::filled_grid(&images, world.scanner);
    let mut nearest_mm = vec![f32::INFINITY; grid.cells()];
    for (pixel, depth_mm) in images.iter().flatten() {
        if let Some(cell) = organise::cell_in(&grid, *pixel) {
            nearest_mm[cell] = nearest_mm[cell].min(*depth_mm);
        }
    }
    let is_unseen = |image: &Option<([f32; 2], f32)>| {
        let Some((pixel, depth_mm)) = image else { return true };
        let behind_mm = BEHIND_MM.max(BEHIND_CELLS * grid.cell_mm(f64::from(*depth_mm)));
        let front_mm = organise::cell_in(&grid, *pixel).map(|cell| front_mm(&grid, &nearest_mm, cell));
        front_mm.is_some_and(|front_mm| f64::from(depth_mm - front_mm) > behind_mm)
    };
    let there = || scanner_mm.iter().zip(&images).filter(|(point, _)| !point[0].is_nan());
    let every = there().count().div_ceil(JUDGED_POINTS).max(1);
    // A plate around a small part has most points of every view.
    let is_of_part = |(point, _): &(&[f32; 3], &Option<([f32; 2], f32)>)| {
        is_near(world.nearest, &capture.part_from_scanner.point(&Point3::from(point.map(f64::from))))
    };
    let unseen: Vec<bool> = there().step_by(every).filter(is_of_part).map(|(_, image)| is_unseen(image)).collect();
    unseen.iter().filter(|is_unseen| **is_unseen).count() as f64 / unseen.len().max(1) as f64
}

/// Depth of the surface in front of all points of a cell: the largest of the nearest depths in it and the cells around it, mm. Points of a
/// thinned scan share the cell of nearer ones beside an edge, but not those around it.
fn front_mm(grid: &PixelGrid, nearest_mm: &[f32], cell: usize) -> f32 {
    let CloudGrid { columns, rows } = grid.size;
    let around = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
    let (column, row) = (cell % columns, cell / columns);
    let cells = around(row, rows).flat_map(|row| around(column, columns).map(move |column| row * columns + column));
    cells.map(|cell| nearest_mm[cell]).filter(|mm| mm.is_finite()).fold(0.0, f32::max)
}
