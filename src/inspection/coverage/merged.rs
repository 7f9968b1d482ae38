//! Coverage of a cloud that several views were merged into: a sample is measured if a point lies within a ball around it, no farther
//! off its plane than the tolerance. The radius is 0.75 of the diagonal of the points' lattice, which balances what is
//! counted too much beside borders and too little inside; it stays known to about one point of coverage, and so the result is
//! marked. Part frame, mm.
//!
//! Memory: 8 bytes a point beside the cloud. Cost: O(n log n).

use nalgebra::Point3;
use rayon::prelude::*;

use super::{ComparedViews, MeasuredCoverage};
use crate::geometry::{PointCloud, parallel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::random::split_mix;
use crate::planning::visibility::SampleSet;

/// Radius of the ball as a share of the lattice's diagonal.
const BALL_OF_DIAGONAL: f64 = 0.75;
/// Points whose nearest neighbours tell the distance between points.
const SPACING_POINTS: usize = 2000;
/// Samples that a thread looks up at a time.
const BLOCK: usize = 4096;

/// Measures the coverage of a merged cloud in the part's frame; `spacing_mm` is the distance between the points of one view,
/// otherwise that of nearest neighbours, which is smaller where views overlap. [`ComparedViews::scanned`] is not used.
///
/// # Errors
/// [`Cancelled`].
pub fn measure(
    input: &ComparedViews<'_>,
    part_cloud: &PointCloud,
    spacing_mm: Option<f64>,
    ctx: &Context<'_>,
) -> Result<MeasuredCoverage, Cancelled> {
    let asked_mm2: f64 = input.asked_area_mm2.iter().sum();
    // As if the points lay evenly over the surface: cells of the grid hold a few.
    let cell_mm = 2.0 * (asked_mm2 / part_cloud.points_mm.len().max(1) as f64).sqrt().max(1e-3);
    let points = PointGrid::new(part_cloud, cell_mm);
    let spacing_mm = spacing_mm.unwrap_or_else(|| points.spacing_mm());
    let radius_mm = BALL_OF_DIAGONAL * std::f64::consts::SQRT_2 * spacing_mm;
    let asked: Vec<SampleId> = input.surface.samples().filter(|sample| input.asked_area_mm2[sample.index()] > 0.0).collect();
    let is_measured = |sample: &SampleId| {
        let (point_mm, normal) = (input.surface.sample_mm[sample.index()], input.surface.patch_of(*sample).normal);
        let is_near = |point: &Point3<f64>| (point - point_mm).dot(&normal).abs() <= input.compare.tolerance_mm;
        points.within(&point_mm, radius_mm).any(|point| is_near(&point))
    };
    let blocks = parallel::try_map_chunks(&asked, BLOCK, |block| {
        ctx.check()?;
        Ok::<_, Cancelled>(block.iter().copied().filter(is_measured).collect::<Vec<_>>())
    })?;
    let mut measured = SampleSet::none_of(input.surface.sample_mm.len());
    blocks.iter().flatten().for_each(|sample| measured.insert(*sample));
    let mut coverage = MeasuredCoverage::of_sets(input, Vec::new(), measured);
    coverage.is_approximate = true;
    Ok(coverage)
}

/// Points by cells of a grid: a hash of the cell and the number of the point, in one word, sorted.
struct PointGrid<'a> {
    cloud: &'a PointCloud,
    cell_mm: f64,
    words: Vec<u64>,
}

impl<'a> PointGrid<'a> {
    fn new(cloud: &'a PointCloud, cell_mm: f64) -> Self {
        let mut words: Vec<u64> =
            cloud.finite().map(|(number, point)| hash(cell_of(&point, cell_mm)) << 32 | number as u64).collect();
        words.par_sort_unstable();
        Self { cloud, cell_mm, words }
    }

    /// Points within a distance.
    fn within(&self, centre: &Point3<f64>, radius_mm: f64) -> impl Iterator<Item = Point3<f64>> + '_ {
        let reach = nalgebra::Vector3::repeat(radius_mm);
        let (low, high) = (cell_of(&(centre - reach), self.cell_mm), cell_of(&(centre + reach), self.cell_mm));
        let cells = (low[0]..=high[0])
            .flat_map(move |x| (low[1]..=high[1]).flat_map(move |y| (low[2]..=high[2]).map(move |z| [x, y, z])));
        let centre = *centre;
        cells.flat_map(move |cell| {
            let hash = hash(cell);
            let first = self.words.partition_point(|word| word >> 32 < hash);
            let of_cell = self.words[first..].iter().take_while(move |word| **word >> 32 == hash);
            let point = |word: &u64| Point3::from(self.cloud.points_mm[(word & 0xffff_ffff) as usize].map(f64::from));
            let points = of_cell.map(point);
            // Cells of one hash may lie far apart.
            points.filter(move |point| {
                cell_of(point, self.cell_mm) == cell && (point - centre).norm_squared() <= radius_mm * radius_mm
            })
        })
    }

    /// Median distance of some points from their nearest neighbours, mm.
    fn spacing_mm(&self) -> f64 {
        let step = (self.words.len() / SPACING_POINTS).max(1);
        let nearest = |word: &u64| {
            let point = Point3::from(self.cloud.points_mm[(word & 0xffff_ffff) as usize].map(f64::from));
            let others = self.within(&point, 2.0 * self.cell_mm).map(|other| (other - point).norm());
            others.filter(|distance_mm| *distance_mm > 0.0).min_by(f64::total_cmp)
        };
        let mut distances_mm: Vec<f64> = self.words.iter().step_by(step).filter_map(nearest).collect();
        distances_mm.sort_by(f64::total_cmp);
        distances_mm.get(distances_mm.len() / 2).copied().unwrap_or(self.cell_mm)
    }
}

fn cell_of(point: &Point3<f64>, cell_mm: f64) -> [i64; 3] {
    [point.x, point.y, point.z].map(|mm| (mm / cell_mm).floor() as i64)
}

fn hash([x, y, z]: [i64; 3]) -> u64 {
    split_mix(split_mix(split_mix(x as u64) ^ y as u64) ^ z as u64) >> 32
}
