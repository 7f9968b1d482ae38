//! Division of a part into blocks that the scanner's field can hold ([`crate::planning::method::candidates`], thesis
//! §3.1.2–3.1.3): one box when the
//! bounding box fits the block cube, else the fewest equal boxes that do. A box that holds no sample gives none.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};

use super::Scope;
use crate::cell::Scanner;
use crate::geometry::Aabb;

/// A box of the part, table frame, mm.
pub(super) struct PartBlock {
    pub(super) centre: Point3<f64>,
    pub(super) half_extent: Vector3<f64>,
}

/// Number of boxes that a bounding box is divided into, along each axis.
pub(in crate::planning) fn counts(extent_mm: &Vector3<f64>, scanner: &Scanner) -> Vector3<f64> {
    // A billionth of slack: a part of exactly one cube must not become two blocks by rounding.
    extent_mm.map(|edge_mm| (edge_mm / scanner.block_cube_mm - 1e-9).ceil().max(1.0))
}

/// Blocks of the part, ordered by x, then y, then z.
pub(super) fn split(scope: &Scope<'_>) -> Vec<PartBlock> {
    // Patch corners, not samples, span the bounding box.
    let corners = scope.surface.patches.iter().flat_map(|patch| patch.corners_mm);
    let aabb = corners.fold(Aabb::empty(), |aabb, corner| aabb.with(&scope.table_from_part.point(&corner)));
    let extent = aabb.extent_mm();
    let counts = counts(&extent, scope.scanner);
    let edge = extent.component_div(&counts);
    let cell_of = |p: &Point3<f64>| {
        let p = scope.table_from_part.point(p);
        [0, 1, 2].map(|axis| {
            let cell = ((p[axis] - aabb.min[axis]) / edge[axis]).floor();
            // A flat part has no extent along an axis: 0 / 0 is no number, and stands for the one cell there is.
            if cell.is_nan() { 0 } else { cell.clamp(0.0, counts[axis] - 1.0) as u64 }
        })
    };
    let occupied: BTreeSet<[u64; 3]> = scope.surface.sample_mm.iter().map(cell_of).collect();
    let block = |cell: [u64; 3]| {
        let middle = Vector3::from(cell.map(|index| index as f64 + 0.5));
        PartBlock { centre: aabb.min + edge.component_mul(&middle), half_extent: edge * 0.5 }
    };
    occupied.into_iter().map(block).collect()
}
