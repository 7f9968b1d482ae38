//! Corners of a hull in boxes, so that those near a supporting plane are found without a look at all of them: a fine ball has a
//! million corners, and a thousand facets that may be stood on.
//!
//! Cost: O(n) to sort n corners into boxes, then a look at some √n boxes, some ten thousand at most, for each plane.

use std::borrow::Cow;
use std::ops::Range;

use nalgebra::Point3;

use crate::geometry::mesh::Aabb;

/// Planes from which on sorting pays.
const MANY_PLANES: usize = 16;
/// Cells of the grid along each edge of the hull's box, at most.
const MAX_CELLS: usize = 64;
/// Corners of a cell on average, about, if they are spread over a ball.
const CORNERS_PER_CELL: f64 = 64.0;

/// Corners of a hull, those of a box one after another.
pub(super) struct CornerBlocks<'h> {
    corners: Cow<'h, [Point3<f64>]>,
    blocks: Vec<Block>,
}

/// A box, as the ball around it.
struct Block {
    middle: Point3<f64>,
    radius_mm: f64,
    corners: Range<usize>,
}

impl Block {
    fn of(corners: &[Point3<f64>], range: Range<usize>) -> Self {
        let around = Aabb::around(&corners[range.clone()]);
        Self { middle: around.centre(), radius_mm: around.extent_mm().norm() / 2.0, corners: range }
    }
}

impl<'h> CornerBlocks<'h> {
    /// Sorts corners into boxes; all into one where that does not pay for so many planes.
    pub(super) fn of(corners: &'h [Point3<f64>], planes: usize) -> Self {
        let cells = ((corners.len() as f64 / CORNERS_PER_CELL).sqrt() as usize).min(MAX_CELLS);
        if planes < MANY_PLANES || cells < 2 {
            let all = Block::of(corners, 0..corners.len());
            return Self { corners: Cow::Borrowed(corners), blocks: vec![all] };
        }
        let around = Aabb::around(corners);
        let cell = |corner: &Point3<f64>| {
            let at = |axis: usize| {
                let share = (corner[axis] - around.min[axis]) / (around.max[axis] - around.min[axis]);
                ((share * cells as f64) as usize).min(cells - 1)
            };
            (at(0) * cells + at(1)) * cells + at(2)
        };
        let cell_of: Vec<u32> = corners.iter().map(|corner| cell(corner) as u32).collect();
        let mut next = vec![0; cells.pow(3) + 1];
        cell_of.iter().for_each(|cell| next[*cell as usize + 1] += 1);
        for cell in 1..next.len() {
            next[cell] += next[cell - 1];
        }
        let ranges: Vec<Range<usize>> = next.windows(2).map(|ends| ends[0]..ends[1]).filter(|range| !range.is_empty()).collect();
        let mut sorted = corners.to_vec();
        for (corner, cell) in corners.iter().zip(cell_of) {
            let place = &mut next[cell as usize];
            sorted[*place] = *corner;
            *place += 1;
        }
        let blocks = ranges.into_iter().map(|range| Block::of(&sorted, range)).collect();
        Self { corners: Cow::Owned(sorted), blocks }
    }

    /// Corners of the boxes that `is_wanted` accepts, given a ball around each: its middle and radius.
    pub(super) fn of_balls(&self, is_wanted: impl Fn(&Point3<f64>, f64) -> bool) -> impl Iterator<Item = &Point3<f64>> {
        let wanted = self.blocks.iter().filter(move |block| is_wanted(&block.middle, block.radius_mm));
        wanted.flat_map(|block| &self.corners[block.corners.clone()])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Corners on a ball of radius 10, evenly spread.
    fn ball(corners: u32) -> Vec<Point3<f64>> {
        let golden_rad = std::f64::consts::PI * (1.0 + 5.0_f64.sqrt());
        let corner = |number: u32| {
            let z = 1.0 - 2.0 * (f64::from(number) + 0.5) / f64::from(corners);
            let (sin, cos) = (golden_rad * f64::from(number)).sin_cos();
            Point3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z) * 10.0
        };
        (0..corners).map(corner).collect()
    }

    fn sorted(mut corners: Vec<Point3<f64>>) -> Vec<Point3<f64>> {
        corners.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
        corners
    }

    #[test]
    fn every_corner_is_in_one_box_and_in_the_ball_around_it() {
        let corners = ball(5000);
        for planes in [1, 1000] {
            let blocks = CornerBlocks::of(&corners, planes);
            assert_eq!(blocks.blocks.len() > 100, planes == 1000, "{}", blocks.blocks.len());
            assert_eq!(sorted(blocks.of_balls(|_, _| true).copied().collect()), sorted(corners.clone()));
            for block in &blocks.blocks {
                let inside = |corner: &Point3<f64>| (corner - block.middle).norm() <= block.radius_mm + 1e-9;
                assert!(blocks.corners[block.corners.clone()].iter().all(inside), "{:?}", block.middle);
            }
        }
    }

    #[test]
    fn boxes_that_are_not_wanted_are_left_out() {
        let corners = ball(5000);
        let blocks = CornerBlocks::of(&corners, 1000);
        let found: Vec<_> = blocks.of_balls(|middle, radius_mm| middle.z + radius_mm >= 9.0).copied().collect();
        let wanted = corners.iter().filter(|corner| corner.z >= 9.0);
        assert!(wanted.clone().all(|corner| found.contains(corner)));
        assert!(found.len() < 3 * wanted.count(), "{}", found.len());
    }
}
