//! Points farther from the surface than deviations are looked for: material that is missing or extra, in heaps.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::DeviationOptions;
use crate::cell::closed_list;

closed_list! {
    /// Sign of a deviation.
    pub enum MaterialKind {
        /// The surface lies below the nominal one.
        Missing = "missing",
        /// The surface lies above the nominal one.
        Extra = "extra",
    }
}

/// A heap of points off the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OffSurface {
    /// Missing or extra.
    pub kind: MaterialKind,
    /// Middle of its points, part frame, mm.
    pub centre_mm: Point3<f64>,
    /// Mean distance from the face that the rays meet, mm.
    pub mean_mm: f64,
    /// Points in it; every fourth of those measured is looked at.
    pub points: usize,
}

/// Size of the cells that neighbouring points share, mm.
const CELL_MM: f64 = 2.0;
/// Fewer points are noise.
const MIN_POINTS: usize = 25;
/// Maximum number of heaps that are listed.
pub const MAX_HEAPS: usize = 20;

/// Sums of a cell.
#[derive(Clone, Copy, Default)]
struct CellSum {
    points: usize,
    place: Vector3<f64>,
    distance: f64,
}

/// Heaps of points, the one with most points first.
pub(super) fn heaps(points: &[(Point3<f64>, f64)], options: &DeviationOptions) -> Vec<OffSurface> {
    let size = CELL_MM.max(options.search_mm);
    let mut found = Vec::new();
    for kind in MaterialKind::ALL {
        let of_kind = points.iter().filter(|(_, distance)| (*distance < 0.0) == (kind == MaterialKind::Missing));
        let mut cells: BTreeMap<[i64; 3], CellSum> = BTreeMap::new();
        for (point, distance) in of_kind {
            let cell: [i64; 3] = point.coords.map(|value| (value / size).floor() as i64).into();
            let sum = cells.entry(cell).or_default();
            *sum = CellSum { points: sum.points + 1, place: sum.place + point.coords, distance: sum.distance + distance };
        }
        while let Some((first, _)) = cells.iter().next() {
            let heap = taken(*first, &mut cells);
            if heap.points >= MIN_POINTS {
                let count = heap.points as f64;
                let centre_mm = Point3::from(heap.place / count);
                found.push(OffSurface { kind, centre_mm, mean_mm: heap.distance / count, points: heap.points });
            }
        }
    }
    found.sort_by_key(|heap| std::cmp::Reverse(heap.points));
    found.truncate(MAX_HEAPS);
    found
}

/// Takes out all cells that hang together with the first.
fn taken(first: [i64; 3], cells: &mut BTreeMap<[i64; 3], CellSum>) -> CellSum {
    let mut sum = CellSum::default();
    let mut waiting = vec![first];
    while let Some([x, y, z]) = waiting.pop() {
        let Some(cell) = cells.remove(&[x, y, z]) else { continue };
        sum = CellSum { points: sum.points + cell.points, place: sum.place + cell.place, distance: sum.distance + cell.distance };
        waiting.extend((0..27).map(|place| [x + place % 3 - 1, y + place / 3 % 3 - 1, z + place / 9 - 1]));
    }
    sum
}
