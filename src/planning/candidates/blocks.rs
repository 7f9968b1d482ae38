//! Division of a part into blocks that the scanner's field can hold (method §3, thesis §3.1.2–3.1.3): one box when the
//! bounding box fits the block cube, else the fewest equal boxes that do. A box that holds no sample gives none.

use nalgebra::{Point3, Vector3};

use super::Scope;
use crate::geometry::Aabb;

/// A box of the part, table frame, mm.
pub(super) struct Block {
    pub(super) centre: Point3<f64>,
    pub(super) half_extent: Vector3<f64>,
}

/// Blocks of the part, ordered by x, then y, then z.
pub(super) fn split(scope: &Scope<'_>) -> Vec<Block> {
    let samples: Vec<_> = scope.surface.sample_mm.iter().map(|p| scope.table_from_part.point(p)).collect();
    // Patch corners, not samples, span the bounding box.
    let corners = scope.surface.patches.iter().flat_map(|patch| patch.corners_mm);
    let aabb = corners.fold(Aabb::empty(), |aabb, corner| aabb.with(&scope.table_from_part.point(&corner)));
    let extent = aabb.extent_mm();
    // A billionth of slack: a part of exactly one cube must not become two blocks by rounding.
    let counts = extent.map(|edge_mm| (edge_mm / scope.scanner.block_cube_mm - 1e-9).ceil().max(1.0));
    let edge = extent.component_div(&counts);
    let cells = counts.map(|count| count as usize);
    let mut occupied = vec![false; cells.iter().product()];
    for p in &samples {
        let cell = |axis: usize| (((p[axis] - aabb.min[axis]) / edge[axis]) as usize).min(cells[axis] - 1);
        occupied[(cell(0) * cells[1] + cell(1)) * cells[2] + cell(2)] = true;
    }
    occupied
        .iter()
        .enumerate()
        .filter(|(_, occupied)| **occupied)
        .map(|(number, _)| {
            let (x, y, z) = (number / (cells[1] * cells[2]), number / cells[2] % cells[1], number % cells[2]);
            let middle = Vector3::new(x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5);
            Block { centre: aabb.min + edge.component_mul(&middle), half_extent: edge * 0.5 }
        })
        .collect()
}
