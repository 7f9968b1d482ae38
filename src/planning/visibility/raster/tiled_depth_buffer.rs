//! The image of one device from one viewpoint as a grid of tiles: which tiles are wanted, which triangles meet each, and
//! the map of what is nearest there. Clusters are culled by normal cone and bounding box before any triangle is touched;
//! those that reach behind the device or far beyond the image are cut in full precision, triangle by triangle.
//!
//! Memory, kept between views: 16 KiB a wanted tile (48 MB for all of a 12-megapixel image), 12 bytes a cluster and
//! 4 bytes a pair of cluster and tile.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::clusters::{Cluster, Clusters, TRIANGLES};
use super::pinhole::{LANES, Pinhole};
use super::tile::{Clipped, InverseDepth, NOTHING, TILE, TilePass, TriangleIds};
use crate::cell::Lens;
use crate::geometry::{Kernel, SimdLevel};
use crate::planning::context::{Cancelled, Context};

/// Nearest depth at which surfaces are drawn, mm; what is nearer touches the device.
const NEAR_MM: f64 = 0.1;
/// Guard band: distance beyond the grid up to which triangles are drawn as they are, pixels; beyond it they are clipped, since
/// f32 would tell.
const GUARD_PX: f64 = 16384.0;
/// Widening of a cluster's rectangle, pixels: corners of a box and vertices are rounded differently.
const WIDENING_PX: f32 = 0.05;
/// Clusters that are culled at a time.
const CULL_CHUNK: usize = 1024;

/// A grid of tiles over the undistorted image, large enough for all that the device sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    /// Image coordinates of the first pixel of the first tile.
    pub(super) left_px: f32,
    pub(super) top_px: f32,
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl Grid {
    /// Covers the undistorted image of `lens`, with a margin of a tile for the distorted frame's bulges and for the
    /// neighbours of its outermost pixels.
    pub(super) fn of(lens: &Lens) -> Self {
        let [left, right, top, bottom] = lens.undistorted_bounds_px();
        let first = |px: f64| px.floor() - TILE as f64;
        let count = |from: f64, to: f64| ((to - first(from)) / TILE as f64).ceil() as usize + 1;
        Self { left_px: first(left) as f32, top_px: first(top) as f32, columns: count(left, right), rows: count(top, bottom) }
    }

    pub(super) fn tiles(&self) -> usize {
        self.columns * self.rows
    }

    fn corner_px(&self, tile: usize) -> [f32; 2] {
        let (row, column) = (tile / self.columns, tile % self.columns);
        [self.left_px + (column * TILE) as f32, self.top_px + (row * TILE) as f32]
    }

    /// Column or row of a coordinate relative to the grid's first pixel, held within the grid.
    #[inline(always)]
    pub(super) fn index(offset_px: f32, count: usize) -> u16 {
        let last = (count - 1) as f32;
        let tile = offset_px * (1.0 / TILE as f32);
        let held = if tile < last { tile } else { last };
        if held > 0.0 { held as i32 as u16 } else { 0 }
    }
}

/// Columns and rows of tiles that a cluster may meet, first and last of each; empty where the first lies beyond the last.
type TileRange = [u16; 4];
const NOWHERE: TileRange = [1, 0, 1, 0];
/// Marks a cluster to be cut.
const TO_CLIP: TileRange = [u16::MAX, 0, 0, 0];

/// Reusable buffers for one device.
#[derive(Default)]
pub(super) struct TiledDepthBuffer {
    /// Place of each tile of the grid among the wanted ones; [`NOTHING`] where not wanted.
    slots: Vec<u32>,
    /// Wanted tiles.
    wanted: Vec<u32>,
    ranges: Vec<TileRange>,
    back_ranges: Vec<TileRange>,
    clipped: Vec<Clipped>,
    /// Clusters by tile: those that may show a front face, and those that show back faces alone.
    fronts_of: TileLists,
    backs_of: TileLists,
    clipped_of: TileLists,
    maps: Vec<InverseDepth>,
}

/// Lists of triangles, one for each wanted tile.
#[derive(Default)]
struct TileLists {
    begin: Vec<u32>,
    entries: Vec<u32>,
}

impl TileLists {
    fn of(&self, slot: usize) -> &[u32] {
        &self.entries[self.begin[slot] as usize..self.begin[slot + 1] as usize]
    }

    /// Sorts `ranges` into the wanted tiles.
    fn fill(&mut self, ranges: &[TileRange], slots: &[u32], columns: usize, wanted: usize) {
        self.begin.clear();
        self.begin.resize(wanted + 2, 0);
        each_tile(ranges, slots, columns, |slot, _| self.begin[slot as usize + 2] += 1);
        for slot in 2..wanted + 2 {
            self.begin[slot] += self.begin[slot - 1];
        }
        self.entries.clear();
        self.entries.resize(self.begin[wanted + 1] as usize, 0);
        let (begin, entries) = (&mut self.begin, &mut self.entries);
        each_tile(ranges, slots, columns, |slot, entry| {
            let next = &mut begin[slot as usize + 1];
            entries[*next as usize] = entry;
            *next += 1;
        });
    }
}

fn each_tile(ranges: &[TileRange], slots: &[u32], columns: usize, mut put: impl FnMut(u32, u32)) {
    for (entry, [left, right, top, bottom]) in ranges.iter().enumerate() {
        for row in *top..=*bottom {
            for column in *left..=*right {
                let slot = slots[usize::from(row) * columns + usize::from(column)];
                if slot != NOTHING {
                    put(slot, entry as u32);
                }
            }
        }
    }
}

/// One pass over a scene with one device.
#[derive(Clone, Copy)]
pub(super) struct RenderPass<'a> {
    pub(super) scene: &'a Clusters,
    pub(super) pinhole: &'a Pinhole,
    pub(super) grid: Grid,
    pub(super) level: SimdLevel,
    /// Smallest number of tiles or chunks that one thread takes.
    pub(super) grain: usize,
}

impl TiledDepthBuffer {
    /// Prepares the wanted tiles: finds what meets each.
    pub(super) fn prepare(
        &mut self,
        pass: &RenderPass<'_>,
        wanted: impl Fn(usize) -> bool,
        ctx: &Context<'_>,
    ) -> Result<(), Cancelled> {
        let grid = pass.grid;
        self.slots.clear();
        self.slots.resize(grid.tiles(), NOTHING);
        self.wanted.clear();
        for tile in (0..grid.tiles()).filter(|tile| wanted(*tile)) {
            self.slots[tile] = self.wanted.len() as u32;
            self.wanted.push(tile as u32);
        }
        self.ranges.resize(pass.scene.clusters.len(), NOWHERE);
        self.back_ranges.resize(pass.scene.clusters.len(), NOWHERE);
        let ranges = self.ranges.par_chunks_mut(CULL_CHUNK).zip(self.back_ranges.par_chunks_mut(CULL_CHUNK));
        let culled = pass.scene.clusters.par_chunks(CULL_CHUNK).zip(ranges);
        culled.with_min_len(pass.grain).try_for_each(|(clusters, (ranges, back_ranges))| {
            ctx.check()?;
            pass.level.run(Cull { clusters, ranges, back_ranges, pass });
            Ok::<_, Cancelled>(())
        })?;
        self.clipped.clear();
        let clipper = Clipper::new(pass);
        for (range, cluster) in self.ranges.iter_mut().zip(&pass.scene.clusters).filter(|(range, _)| **range == TO_CLIP) {
            *range = NOWHERE;
            ctx.check()?;
            clipper.clip(cluster, &mut self.clipped);
        }
        self.fronts_of.fill(&self.ranges, &self.slots, grid.columns, self.wanted.len());
        self.backs_of.fill(&self.back_ranges, &self.slots, grid.columns, self.wanted.len());
        let ranges: Vec<TileRange> = self.clipped.iter().map(|cut| range_of_clipped(cut, &grid)).collect();
        self.clipped_of.fill(&ranges, &self.slots, grid.columns, self.wanted.len());
        Ok(())
    }

    /// Draws the map of the wanted tiles.
    pub(super) fn draw(&mut self, pass: &RenderPass<'_>, ctx: &Context<'_>) -> Result<(), Cancelled> {
        let mut maps = std::mem::take(&mut self.maps);
        if maps.len() < self.wanted.len() {
            maps.resize(self.wanted.len(), [[0.0; LANES]; TILE * TILE / LANES]);
        }
        let drawn = maps[..self.wanted.len()].par_iter_mut().enumerate().with_min_len(pass.grain).try_for_each(|(slot, map)| {
            ctx.check()?;
            self.job(slot, pass).draw(pass.level, map);
            Ok(())
        });
        self.maps = maps;
        drawn
    }

    /// Draws each wanted tile that anything meets with numbers, and hands them to `see` with the image coordinates of
    /// the tile's first pixel.
    pub(super) fn draw_with_ids(
        &self,
        pass: &RenderPass<'_>,
        ctx: &Context<'_>,
        see: impl Fn([f32; 2], &TriangleIds) + Sync,
    ) -> Result<(), Cancelled> {
        let buffers = || (Box::new([[0.0; LANES]; TILE * TILE / LANES]), Box::new([[NOTHING; LANES]; TILE * TILE / LANES]));
        let slots = (0..self.wanted.len()).into_par_iter().with_min_len(pass.grain);
        slots.try_for_each_init(buffers, |(map, numbers), slot| {
            ctx.check()?;
            let job = self.job(slot, pass);
            if !job.is_empty() {
                job.draw_with_ids(pass.level, map, numbers);
                see(job.corner_px, numbers);
            }
            Ok(())
        })
    }

    fn job<'a>(&'a self, slot: usize, pass: &RenderPass<'a>) -> TilePass<'a> {
        let (scene, centre_mm) = (pass.scene, pass.pinhole.centre_mm);
        TilePass {
            pinhole: pass.pinhole,
            corner_px: pass.grid.corner_px(self.wanted[slot] as usize),
            clusters: &scene.clusters,
            front_clusters: self.fronts_of.of(slot),
            back_clusters: self.backs_of.of(slot),
            clipped: &self.clipped,
            clipped_ids: self.clipped_of.of(slot),
            // Back faces hide nothing only from outside.
            cull: !scene.may_enclose(&centre_mm),
        }
    }

    /// Maps of the wanted tiles, and for each tile of the grid its place among them.
    pub(super) fn maps(&self) -> (&[InverseDepth], &[u32]) {
        (&self.maps, &self.slots)
    }
}

/// Culls clusters and finds the tiles that the others may meet.
struct Cull<'a> {
    clusters: &'a [Cluster],
    ranges: &'a mut [TileRange],
    back_ranges: &'a mut [TileRange],
    pass: &'a RenderPass<'a>,
}

impl Kernel for Cull<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let centre_mm = self.pass.pinhole.centre_mm;
        let cull = !self.pass.scene.may_enclose(&centre_mm);
        for ((cluster, range), back_range) in self.clusters.iter().zip(self.ranges).zip(self.back_ranges) {
            (*range, *back_range) = (NOWHERE, NOWHERE);
            let away = cluster.faces_away(&centre_mm);
            if away && cull && cluster.outward {
                continue;
            }
            let meets = range_of_box(cluster, self.pass);
            // What is to be cut is drawn last in any case.
            *(if away && meets != TO_CLIP { back_range } else { range }) = meets;
        }
    }
}

/// Bounds from the projected corners of the bounding box.
#[inline(always)]
fn range_of_box(cluster: &Cluster, pass: &RenderPass<'_>) -> TileRange {
    let (low, high) = (&cluster.low_mm, &cluster.high_mm);
    let mut corners = [[0.0; LANES]; 3];
    for lane in 0..LANES {
        corners[0][lane] = if lane & 1 == 0 { low[0] } else { high[0] };
        corners[1][lane] = if lane & 2 == 0 { low[1] } else { high[1] };
        corners[2][lane] = if lane & 4 == 0 { low[2] } else { high[2] };
    }
    let [x, y, inverse_depth] = pass.pinhole.project([&corners[0], &corners[1], &corners[2]]);
    let (mut left, mut right, mut top, mut bottom) = (f32::INFINITY, f32::NEG_INFINITY, f32::INFINITY, f32::NEG_INFINITY);
    let mut behind = false;
    for corner in 0..8 {
        behind |= !(inverse_depth[corner] > 0.0 && inverse_depth[corner] < 1.0 / NEAR_MM as f32);
        left = left.min(x[corner]);
        right = right.max(x[corner]);
        top = top.min(y[corner]);
        bottom = bottom.max(y[corner]);
    }
    let grid = &pass.grid;
    let guard = GUARD_PX as f32;
    if behind || !(left > -guard && right < guard && top > -guard && bottom < guard) {
        return TO_CLIP;
    }
    range([left, right, top, bottom], grid)
}

/// Tiles that a rectangle of the image meets.
fn range([left, right, top, bottom]: [f32; 4], grid: &Grid) -> TileRange {
    let (left, right) = (left - grid.left_px - WIDENING_PX, right - grid.left_px + WIDENING_PX);
    let (top, bottom) = (top - grid.top_px - WIDENING_PX, bottom - grid.top_px + WIDENING_PX);
    let (width, height) = ((grid.columns * TILE) as f32, (grid.rows * TILE) as f32);
    if right < 0.0 || bottom < 0.0 || left >= width || top >= height {
        return NOWHERE;
    }
    let column = |px: f32| Grid::index(px, grid.columns);
    let row = |px: f32| Grid::index(px, grid.rows);
    [column(left), column(right), row(top), row(bottom)]
}

fn range_of_clipped(cut: &Clipped, grid: &Grid) -> TileRange {
    let [x, y, _] = &cut.corners;
    let min = |values: &[f32; 3]| values.iter().copied().fold(f32::INFINITY, f32::min);
    let max = |values: &[f32; 3]| values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    range([min(x), max(x), min(y), max(y)], grid)
}

impl Cluster {
    fn faces_away(&self, centre_mm: &Vector3<f64>) -> bool {
        let corner = |mm: &[f32; 3]| Vector3::from(mm.map(f64::from));
        let (low, high) = (corner(&self.low_mm), corner(&self.high_mm));
        self.cone.faces_away(&(centre_mm - (low + high) * 0.5), (high - low).norm() * 0.5)
    }
}

/// Cuts triangles to what lies in front of the device and not absurdly far beyond the grid (Sutherland and Hodgman 1974).
struct Clipper<'a> {
    pinhole: &'a Pinhole,
    /// Half-spaces over (x · depth, y · depth, depth): what counts is where normal · point ≥ offset.
    planes: [(Vector3<f64>, f64); 5],
}

impl<'a> Clipper<'a> {
    fn new(pass: &RenderPass<'a>) -> Self {
        let grid = &pass.grid;
        let (left, top) = (f64::from(grid.left_px) - GUARD_PX / 4.0, f64::from(grid.top_px) - GUARD_PX / 4.0);
        let right = f64::from(grid.left_px) + (grid.columns * TILE) as f64 + GUARD_PX / 4.0;
        let bottom = f64::from(grid.top_px) + (grid.rows * TILE) as f64 + GUARD_PX / 4.0;
        let planes = [
            (Vector3::new(0.0, 0.0, 1.0), NEAR_MM),
            (Vector3::new(1.0, 0.0, -left), 0.0),
            (Vector3::new(-1.0, 0.0, right), 0.0),
            (Vector3::new(0.0, 1.0, -top), 0.0),
            (Vector3::new(0.0, -1.0, bottom), 0.0),
        ];
        Self { pinhole: pass.pinhole, planes }
    }

    fn clip(&self, cluster: &Cluster, cuts: &mut Vec<Clipped>) {
        let vertex = |index: u8| {
            let (batch, lane) = (usize::from(index) / LANES, usize::from(index) % LANES);
            let [x, y, z] = std::array::from_fn(|axis| f64::from(cluster.vertices[batch][axis][lane]));
            self.pinhole.homogeneous_exact(&Vector3::new(x, y, z))
        };
        for triangle in (0..TRIANGLES).filter(|triangle| cluster.numbers[*triangle] != NOTHING) {
            let mut polygon: Vec<Vector3<f64>> = (0..3).map(|corner| vertex(cluster.corners[corner][triangle])).collect();
            for (normal, offset) in &self.planes {
                polygon = clip_by(&polygon, normal, *offset);
            }
            let image: Vec<[f32; 3]> = polygon.iter().map(|p| [p.x / p.z, p.y / p.z, 1.0 / p.z].map(|v| v as f32)).collect();
            for pair in image.windows(2).skip(1) {
                let corners = std::array::from_fn(|axis| [image[0][axis], pair[0][axis], pair[1][axis]]);
                cuts.push(Clipped { corners, number: cluster.numbers[triangle] });
            }
        }
    }
}

/// The part of a convex polygon where normal · point ≥ offset. A cut edge's end is computed from the end that stays, so
/// that both triangles at an edge get the same one.
fn clip_by(polygon: &[Vector3<f64>], normal: &Vector3<f64>, offset: f64) -> Vec<Vector3<f64>> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, p) in polygon.iter().enumerate() {
        let q = &polygon[(i + 1) % polygon.len()];
        let (at_p, at_q) = (normal.dot(p) - offset, normal.dot(q) - offset);
        if at_p >= 0.0 {
            kept.push(*p);
        }
        if (at_p >= 0.0) != (at_q >= 0.0) {
            let (inner, outer, at_inner, at_outer) = if at_p >= 0.0 { (p, q, at_p, at_q) } else { (q, p, at_q, at_p) };
            kept.push(inner + (outer - inner) * (at_inner / (at_inner - at_outer)));
        }
    }
    kept
}

impl Clusters {
    /// Returns true if a point, relative to the scene's centre, lies in the bounding box of all outward clusters.
    fn may_enclose(&self, p: &Vector3<f64>) -> bool {
        self.outward.holds(&Point3::from(*p))
    }
}
