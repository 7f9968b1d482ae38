//! Division of a part into blocks that the scanner's field can hold ([`crate::planning::method::candidates`], thesis
//! §3.1.2–3.1.3): one box when the
//! bounding box fits the block cube, else the fewest equal boxes that do. A box that holds no sample gives none.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};

use super::Scope;
use crate::cell::Scanner;
use crate::geometry::{Aabb, Part, Pose, Table};
use crate::planning::ids::SampleId;
use crate::planning::surface::Surface;

/// A box of the part, table frame, mm.
pub(super) struct PartBlock {
    /// Number of the block among the blocks of the part.
    pub(super) number: u32,
    pub(super) centre: Point3<f64>,
    pub(super) half_extent: Vector3<f64>,
}

/// Number of boxes that a bounding box is divided into, along each axis.
pub(in crate::planning) fn counts(extent_mm: &Vector3<f64>, scanner: &Scanner) -> Vector3<f64> {
    // A billionth of slack: a part of exactly one cube must not become two blocks by rounding.
    extent_mm.map(|edge_mm| (edge_mm / scanner.block_cube_mm - 1e-9).ceil().max(1.0))
}

/// Blocks of the part, ordered by x, then y, then z.
pub(super) fn split(surface: &Surface, table_from_part: &Pose<Table, Part>, scanner: &Scanner) -> Vec<PartBlock> {
    BlockGrid::new(surface, table_from_part, scanner).blocks().0
}

/// Lists the samples, of `samples`, that lie in each block, in the order of [`split`].
pub(super) fn samples_of_blocks(scope: &Scope<'_>, samples: &[SampleId]) -> Vec<Vec<SampleId>> {
    let grid = BlockGrid::new(scope.surface, &scope.table_from_part, scope.scanner);
    let (blocks, number_of_cell) = grid.blocks();
    let mut of_block = vec![Vec::new(); blocks.len()];
    for sample in samples {
        let number = number_of_cell[&grid.cell_of(&scope.surface.sample_mm[sample.index()])];
        of_block[number as usize].push(*sample);
    }
    of_block
}

/// The grid of equal boxes that a part is divided into.
struct BlockGrid<'a> {
    surface: &'a Surface,
    table_from_part: &'a Pose<Table, Part>,
    aabb: Aabb,
    counts: Vector3<f64>,
    edge: Vector3<f64>,
}

impl<'a> BlockGrid<'a> {
    fn new(surface: &'a Surface, table_from_part: &'a Pose<Table, Part>, scanner: &Scanner) -> Self {
        // Patch corners, not samples, span the bounding box.
        let corners = surface.patches.iter().flat_map(|patch| patch.corners_mm);
        let aabb = corners.fold(Aabb::empty(), |aabb, corner| aabb.with(&table_from_part.point(&corner)));
        let extent = aabb.extent_mm();
        let counts = counts(&extent, scanner);
        Self { surface, table_from_part, aabb, counts, edge: extent.component_div(&counts) }
    }

    /// Cell of a point of the part frame.
    fn cell_of(&self, p: &Point3<f64>) -> [u64; 3] {
        let p = self.table_from_part.point(p);
        [0, 1, 2].map(|axis| {
            let cell = ((p[axis] - self.aabb.min[axis]) / self.edge[axis]).floor();
            // A flat part has no extent along an axis: 0 / 0 is no number, and stands for the one cell there is.
            if cell.is_nan() { 0 } else { cell.clamp(0.0, self.counts[axis] - 1.0) as u64 }
        })
    }

    /// The boxes that hold samples, and the number of each by its cell.
    fn blocks(&self) -> (Vec<PartBlock>, BTreeMap<[u64; 3], u32>) {
        let occupied: BTreeSet<[u64; 3]> = self.surface.sample_mm.iter().map(|p| self.cell_of(p)).collect();
        let block = |(cell, number): ([u64; 3], u32)| {
            let middle = Vector3::from(cell.map(|index| index as f64 + 0.5));
            PartBlock { number, centre: self.aabb.min + self.edge.component_mul(&middle), half_extent: self.edge * 0.5 }
        };
        let numbered = || occupied.iter().copied().zip(0..);
        (numbered().map(block).collect(), numbered().collect())
    }
}
