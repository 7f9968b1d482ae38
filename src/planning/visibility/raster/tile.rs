//! Draws triangles into one tile of a device's undistorted image: which surface is nearest at each pixel centre.
//!
//! A tile is 64 × 64 pixels, kept in blocks of 4 × 4 so that a block is one vector. Edge functions are a·x + b·y + c
//! relative to the tile's corner with a = y₁ − y₂, b = x₂ − x₁, c = x₁y₂ − x₂y₁ (Pineda 1988, *A Parallel Algorithm for
//! Polygon Rasterization*): swapping the two vertices negates each of the three exactly, also in rounded arithmetic, so
//! two triangles that share an edge see exactly opposite values and, both including zero, leave no crack. Inverse depth is
//! the triangle's plane of 1/depth, held within the values at its corners. Triangles are prepared 16 at a time.

use super::clusters::{Cluster, TRIANGLES, VERTICES};
use super::pinhole::{LANES, Pinhole, PixelLanes};
use crate::geometry::{Kernel, SimdLevel, floor_to_i32, simd_from_fn, simd_max, simd_min};

/// Pixels along a tile's edge.
pub(super) const TILE: usize = 64;
/// Pixels along a block's edge.
const BLOCK: usize = 4;
/// Blocks along a tile's edge.
const BLOCKS: usize = TILE / BLOCK;
/// Horizontal and vertical place of a block's pixels.
const PIXEL_X: PixelLanes = [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
const PIXEL_Y: PixelLanes = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];
/// Left edges of a row of blocks.
const BLOCK_X: PixelLanes = [0.0, 4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 28.0, 32.0, 36.0, 40.0, 44.0, 48.0, 52.0, 56.0, 60.0];
/// Blocks in a row from which it pays to ask first which of them the triangle meets.
const WIDE: usize = 3;
/// Distance beyond a block's pixels at which an edge function is evaluated before the block is passed over: far more than
/// rounding.
const BLOCK_REACH: f32 = 3.01;

/// Inverse depth at a tile's pixels, 1/mm, 0 where there is nothing; by blocks, row by row.
pub(super) type InverseDepth = [PixelLanes; BLOCKS * BLOCKS];
/// Offset from a pixel to its right neighbour, within the tile.
#[inline(always)]
pub(super) fn step_right(x: u32) -> u32 {
    if x % BLOCK as u32 == BLOCK as u32 - 1 { LANES as u32 - (BLOCK as u32 - 1) } else { 1 }
}

/// Offset from a pixel to the one below it, within the tile.
#[inline(always)]
pub(super) fn step_down(y: u32) -> u32 {
    let blocks = (BLOCKS * LANES) as u32;
    if y % BLOCK as u32 == BLOCK as u32 - 1 { blocks - (BLOCK * (BLOCK - 1)) as u32 } else { BLOCK as u32 }
}

/// Numbers of the triangles at a tile's pixels: [`NOTHING`] or a number that the pass gave.
pub(super) type TriangleIds = [[u32; LANES]; BLOCKS * BLOCKS];
/// Index that stands for no triangle.
pub(super) const NOTHING: u32 = u32::MAX;

/// Place of a pixel of a tile in [`InverseDepth`].
#[inline(always)]
pub(super) fn offset_of(x: u32, y: u32) -> u32 {
    ((y >> 2) * BLOCKS as u32 + (x >> 2)) * LANES as u32 + (y & 3) * BLOCK as u32 + (x & 3)
}

/// A triangle in the image that was cut to what lies in front of the device: image coordinates and inverse depth.
#[derive(Clone, Copy)]
pub(super) struct Clipped {
    /// Corners, by coordinate, then corner.
    pub(super) corners: [[f32; 3]; 3],
    /// Number of the triangle it was cut from.
    pub(super) number: u32,
}

/// Clusters and clipped triangles of one tile, and its position.
pub(super) struct TilePass<'a> {
    pub(super) pinhole: &'a Pinhole,
    /// Image coordinates of the tile's first pixel.
    pub(super) corner_px: [f32; 2],
    pub(super) clusters: &'a [Cluster],
    /// Clusters that meet the tile and may show a front face.
    pub(super) front_clusters: &'a [u32],
    /// Clusters that meet the tile and show only back faces, which mostly lie behind front faces.
    pub(super) back_clusters: &'a [u32],
    pub(super) clipped: &'a [Clipped],
    /// Triangles of `cut` that meet the tile.
    pub(super) clipped_ids: &'a [u32],
    /// Is true if back faces of outward clusters are left out.
    pub(super) cull: bool,
}

impl TilePass<'_> {
    /// Returns true if nothing meets the tile.
    pub(super) fn is_empty(&self) -> bool {
        self.front_clusters.is_empty() && self.back_clusters.is_empty() && self.clipped_ids.is_empty()
    }

    /// Draws inverse depth alone.
    pub(super) fn draw(&self, level: SimdLevel, inverse_depth: &mut InverseDepth) {
        *inverse_depth = [[0.0; LANES]; BLOCKS * BLOCKS];
        level.run(Draw { job: self, inverse_depth, numbers: &mut () });
    }

    /// Draws inverse depth and the numbers of the nearest triangles.
    pub(super) fn draw_with_ids(&self, level: SimdLevel, inverse_depth: &mut InverseDepth, numbers: &mut TriangleIds) {
        *inverse_depth = [[0.0; LANES]; BLOCKS * BLOCKS];
        *numbers = [[NOTHING; LANES]; BLOCKS * BLOCKS];
        level.run(Draw { job: self, inverse_depth, numbers });
    }
}

/// Sink for the number of the nearest triangle, if it is wanted.
trait Target {
    fn block(&self, place: usize) -> [u32; LANES];
    fn put(&mut self, place: usize, block: [u32; LANES]);
}

impl Target for () {
    #[inline(always)]
    fn block(&self, _: usize) -> [u32; LANES] {
        [NOTHING; LANES]
    }

    #[inline(always)]
    fn put(&mut self, _: usize, _: [u32; LANES]) {}
}

impl Target for TriangleIds {
    #[inline(always)]
    fn block(&self, place: usize) -> [u32; LANES] {
        self[place]
    }

    #[inline(always)]
    fn put(&mut self, place: usize, block: [u32; LANES]) {
        self[place] = block;
    }
}

struct Draw<'a, T> {
    job: &'a TilePass<'a>,
    inverse_depth: &'a mut InverseDepth,
    numbers: &'a mut T,
}

impl<T: Target> Kernel for Draw<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { job, inverse_depth, numbers } = self;
        let (mut image, mut setup) = ([[0.0; VERTICES]; 3], TriangleSetup::default());
        for &cluster in job.front_clusters {
            let cluster = &job.clusters[cluster as usize];
            project(job, cluster, &mut image);
            draw_cluster(job, cluster, &image, &mut setup, inverse_depth, numbers);
        }
        if !job.back_clusters.is_empty() {
            let hierarchical_z = HierarchicalZ::of(inverse_depth);
            for &cluster in job.back_clusters {
                let cluster = &job.clusters[cluster as usize];
                project(job, cluster, &mut image);
                if !hierarchical_z.hides(cluster, &image) {
                    draw_cluster(job, cluster, &image, &mut setup, inverse_depth, numbers);
                }
            }
        }
        for listed in job.clipped_ids.chunks(LANES) {
            setup.prepare(&gather_clipped(job, listed), false);
            setup.draw(inverse_depth, numbers, |lane| job.clipped[listed[lane] as usize].number);
        }
    }
}

#[inline(always)]
fn draw_cluster<T: Target>(
    job: &TilePass<'_>,
    cluster: &Cluster,
    image: &[[f32; VERTICES]; 3],
    setup: &mut TriangleSetup,
    inverse_depth: &mut InverseDepth,
    numbers: &mut T,
) {
    let cull = job.cull && cluster.outward;
    for first in (0..TRIANGLES).step_by(LANES) {
        if cluster.numbers[first] == NOTHING {
            break;
        }
        setup.prepare(&gather(cluster, first, image), cull);
        setup.draw(inverse_depth, numbers, |lane| cluster.numbers[first + lane]);
    }
}

/// The furthest pixel of each block, which hides whatever is further still (Greene, Kass and Miller 1993, *Hierarchical
/// Z-Buffer Visibility*).
struct HierarchicalZ([PixelLanes; BLOCKS]);

impl HierarchicalZ {
    #[inline(always)]
    fn of(inverse_depth: &InverseDepth) -> Self {
        let mut furthest = [[0.0; BLOCKS]; BLOCKS];
        for (row, blocks) in inverse_depth.as_chunks::<BLOCKS>().0.iter().enumerate() {
            for (column, block) in blocks.iter().enumerate() {
                let mut eight = [0.0; LANES / 2];
                for lane in 0..LANES / 2 {
                    eight[lane] = simd_min(block[lane], block[lane + LANES / 2]);
                }
                let mut four = [0.0; LANES / 4];
                for lane in 0..LANES / 4 {
                    four[lane] = simd_min(eight[lane], eight[lane + LANES / 4]);
                }
                furthest[row][column] = simd_min(simd_min(four[0], four[1]), simd_min(four[2], four[3]));
            }
        }
        Self(furthest)
    }

    /// Returns true if nothing of a projected cluster can change the tile.
    #[inline(always)]
    fn hides(&self, cluster: &Cluster, image: &[[f32; VERTICES]; 3]) -> bool {
        let mut bounds = [[f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES], [f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]];
        let mut nearest = [0.0; LANES];
        for first in (0..cluster.vertices.len() * LANES).step_by(LANES) {
            for lane in 0..LANES {
                let (x, y) = (image[0][first + lane], image[1][first + lane]);
                bounds[0][lane] = simd_min(x, bounds[0][lane]);
                bounds[1][lane] = simd_max(x, bounds[1][lane]);
                bounds[2][lane] = simd_min(y, bounds[2][lane]);
                bounds[3][lane] = simd_max(y, bounds[3][lane]);
                nearest[lane] = simd_max(image[2][first + lane], nearest[lane]);
            }
        }
        let lowest = |values: &PixelLanes| values.iter().fold(f32::INFINITY, |a, b| simd_min(a, *b));
        let highest = |values: &PixelLanes| values.iter().fold(f32::NEG_INFINITY, |a, b| simd_max(a, *b));
        let (left, right) = columns(lowest(&bounds[0]), highest(&bounds[1]));
        let (top, bottom) = columns(lowest(&bounds[2]), highest(&bounds[3]));
        let (nearest, blocks) = (highest(&nearest), (left >> 2)..=(right >> 2));
        let block_columns: [i32; BLOCKS] = simd_from_fn(|column| column as i32);
        left > right
            || ((top >> 2)..=(bottom >> 2)).all(|row| {
                let row = &self.0[row as usize & (BLOCKS - 1)];
                let mut open = 0;
                for column in 0..BLOCKS {
                    open |= i32::from(blocks.contains(&block_columns[column]) & (row[column] < nearest));
                }
                open == 0
            })
    }
}

/// Image coordinates, relative to the tile, and inverse depth of a cluster's vertices.
#[inline(always)]
fn project(job: &TilePass<'_>, cluster: &Cluster, image: &mut [[f32; VERTICES]; 3]) {
    let [left, top] = job.corner_px;
    for (batch, [x, y, z]) in cluster.vertices.iter().enumerate() {
        let [u, v, inverse_depth] = job.pinhole.project([x, y, z]);
        let first = batch * LANES;
        for lane in 0..LANES {
            image[0][first + lane] = u[lane] - left;
            image[1][first + lane] = v[lane] - top;
            image[2][first + lane] = inverse_depth[lane];
        }
    }
}

/// Corners of 16 triangles, by corner, then coordinate.
type Corners = [[PixelLanes; 3]; 3];

#[inline(always)]
fn gather(cluster: &Cluster, first: usize, image: &[[f32; VERTICES]; 3]) -> Corners {
    let mut corners = [[[0.0; LANES]; 3]; 3];
    for (corner, coordinates) in corners.iter_mut().enumerate() {
        let indices = &cluster.corners[corner][first..first + LANES];
        for (axis, values) in coordinates.iter_mut().enumerate() {
            for lane in 0..LANES {
                values[lane] = image[axis][usize::from(indices[lane]).min(VERTICES - 1)];
            }
        }
    }
    corners
}

/// Gathers clipped triangles as [`gather`] does; lanes beyond the list hold triangles without area.
#[inline(always)]
fn gather_clipped(job: &TilePass<'_>, listed: &[u32]) -> Corners {
    let mut corners = [[[0.0; LANES]; 3]; 3];
    for (lane, &cut) in listed.iter().enumerate() {
        let cut = &job.clipped[cut as usize];
        for corner in 0..3 {
            corners[corner][0][lane] = cut.corners[0][corner] - job.corner_px[0];
            corners[corner][1][lane] = cut.corners[1][corner] - job.corner_px[1];
            corners[corner][2][lane] = cut.corners[2][corner];
        }
    }
    corners
}

/// Sixteen triangles ready to be drawn.
#[derive(Default)]
struct TriangleSetup {
    /// Edge functions: a, b, c of each edge.
    edges: [[PixelLanes; 3]; 3],
    /// Inverse depth: change along x, along y, value at the tile's corner.
    plane: [PixelLanes; 3],
    nearest: PixelLanes,
    furthest: PixelLanes,
    /// First and last column, first and last row, of the pixels that the bounding box holds.
    bounds: [[i32; LANES]; 4],
    /// 1 where there is anything to draw, else 0.
    live: [u8; LANES],
}

impl TriangleSetup {
    #[inline(always)]
    fn prepare(&mut self, [p, q, r]: &Corners, cull: bool) {
        let both = !cull;
        for lane in 0..LANES {
            let (x0, y0, w0) = (p[0][lane], p[1][lane], p[2][lane]);
            let (x1, y1, w1) = (q[0][lane], q[1][lane], q[2][lane]);
            let (x2, y2, w2) = (r[0][lane], r[1][lane], r[2][lane]);
            let area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0);
            // v runs downwards, so a front face has a negative area here; its edge functions change sign.
            let sign = if area < 0.0 { -1.0 } else { 1.0 };
            let edges = [
                [y1 - y2, x2 - x1, x1 * y2 - x2 * y1],
                [y2 - y0, x0 - x2, x2 * y0 - x0 * y2],
                [y0 - y1, x1 - x0, x0 * y1 - x1 * y0],
            ];
            for edge in 0..3 {
                for part in 0..3 {
                    self.edges[edge][part][lane] = edges[edge][part] * sign;
                }
            }
            let along_x = ((w1 - w0) * (y2 - y0) - (w2 - w0) * (y1 - y0)) / area;
            let along_y = ((w2 - w0) * (x1 - x0) - (w1 - w0) * (x2 - x0)) / area;
            self.plane[0][lane] = along_x;
            self.plane[1][lane] = along_y;
            self.plane[2][lane] = w0 - along_x * x0 - along_y * y0;
            self.nearest[lane] = simd_max(simd_max(w0, w1), w2);
            self.furthest[lane] = simd_min(simd_min(w0, w1), w2);
            let (left, right) = columns(simd_min(simd_min(x0, x1), x2), simd_max(simd_max(x0, x1), x2));
            let (top, bottom) = columns(simd_min(simd_min(y0, y1), y2), simd_max(simd_max(y0, y1), y2));
            self.bounds[0][lane] = left;
            self.bounds[1][lane] = right;
            self.bounds[2][lane] = top;
            self.bounds[3][lane] = bottom;
            let faces = (area < 0.0) | (both & (area > 0.0));
            self.live[lane] = u8::from(faces & (left <= right) & (top <= bottom));
        }
    }

    #[inline(always)]
    fn draw<T: Target>(&self, inverse_depth: &mut InverseDepth, numbers: &mut T, number: impl Fn(usize) -> u32) {
        let mut live = bits(&self.live);
        while live != 0 {
            let lane = live.trailing_zeros() as usize & (LANES - 1);
            live &= live - 1;
            self.draw_one(lane, inverse_depth, numbers, number(lane));
        }
    }

    #[inline(always)]
    fn draw_one<T: Target>(&self, triangle: usize, inverse_depth: &mut InverseDepth, numbers: &mut T, number: u32) {
        let [left, right, top, bottom] = simd_from_fn(|side| self.bounds[side][triangle] as usize >> 2);
        let (right, bottom) = (right.min(BLOCKS - 1), bottom.min(BLOCKS - 1));
        let stepper = TriangleStepper::new(self, triangle, number);
        // Apart, because the compiler makes ready what a loop may need even where it does not.
        if right - left < WIDE {
            for row in top..bottom + 1 {
                let line = stepper.line(row);
                for column in left..right + 1 {
                    stepper.draw(&line, column, inverse_depth, numbers);
                }
            }
        } else {
            for row in top..bottom + 1 {
                let line = stepper.line(row);
                let mut met = blocks_met(&stepper.edges, line.y) & (u32::MAX << left) & ((2 << right) - 1);
                while met != 0 {
                    stepper.draw(&line, met.trailing_zeros() as usize, inverse_depth, numbers);
                    met &= met - 1;
                }
            }
        }
    }
}

/// One triangle.
struct TriangleStepper {
    edges: [[f32; 3]; 3],
    plane: [f32; 3],
    nearest: f32,
    furthest: f32,
    /// Differences of edge functions and inverse depth at a block's pixels from its first.
    within: [PixelLanes; 3],
    slope: PixelLanes,
    number: u32,
}

/// A row of blocks.
struct BlockRow {
    row: usize,
    y: f32,
    /// Edge functions and inverse depth at the row's first pixel.
    edges: [f32; 3],
    inverse_depth: f32,
}

impl TriangleStepper {
    #[inline(always)]
    fn new(setup: &TriangleSetup, triangle: usize, number: u32) -> Self {
        let edges: [[f32; 3]; 3] = simd_from_fn(|e| simd_from_fn(|part| setup.edges[e][part][triangle]));
        let plane: [f32; 3] = simd_from_fn(|part| setup.plane[part][triangle]);
        let mut within = [[0.0; LANES]; 3];
        let mut slope = [0.0; LANES];
        for lane in 0..LANES {
            for edge in 0..3 {
                within[edge][lane] = edges[edge][0] * PIXEL_X[lane] + edges[edge][1] * PIXEL_Y[lane];
            }
            slope[lane] = plane[0] * PIXEL_X[lane] + plane[1] * PIXEL_Y[lane];
        }
        let (nearest, furthest) = (setup.nearest[triangle], setup.furthest[triangle]);
        Self { edges, plane, nearest, furthest, within, slope, number }
    }

    #[inline(always)]
    fn line(&self, row: usize) -> BlockRow {
        let y = (row * BLOCK) as f32;
        let edges = simd_from_fn(|e| self.edges[e][1] * y + self.edges[e][2]);
        BlockRow { row, y, edges, inverse_depth: self.plane[1] * y + self.plane[2] }
    }

    #[inline(always)]
    fn draw<T: Target>(&self, line: &BlockRow, column: usize, inverse_depth: &mut InverseDepth, numbers: &mut T) {
        let x = (column * BLOCK) as f32;
        let at: [f32; 3] = simd_from_fn(|e| self.edges[e][0] * x + line.edges[e]);
        let base = self.plane[0] * x + line.inverse_depth;
        let place = (line.row * BLOCKS + column) & (BLOCKS * BLOCKS - 1);
        // Both blocks are read before either is written: else the compiler writes only the pixels that change,
        // and masked stores are slow to be read again.
        let (mut values, mut shown) = (inverse_depth[place], numbers.block(place));
        // A choice between two values becomes an instruction, one between two places a jump.
        let (number, nearest, furthest) = (self.number, self.nearest, self.furthest);
        for lane in 0..LANES {
            let (before, number_before) = (values[lane], shown[lane]);
            let edges: [f32; 3] = [self.within[0][lane] + at[0], self.within[1][lane] + at[1], self.within[2][lane] + at[2]];
            let inside = simd_min(simd_min(edges[0], edges[1]), edges[2]) >= 0.0;
            let value = simd_min(simd_max(self.slope[lane] + base, furthest), nearest);
            let value = if inside { value } else { 0.0 };
            shown[lane] = if value > before { number } else { number_before };
            values[lane] = simd_max(value, before);
        }
        inverse_depth[place] = values;
        numbers.put(place, shown);
    }
}

/// Bit i is byte i, of bytes that are 0 or 1.
#[inline(always)]
fn bits(bytes: &[u8; LANES]) -> u32 {
    // Byte i comes to lie at bit 56 + i, and no two sums meet.
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let [low, high] = bytes.as_chunks::<8>().0 else { return 0 };
    let eight = |bytes: &[u8; 8]| (u64::from_le_bytes(*bytes).wrapping_mul(GATHER) >> 56) as u32;
    eight(low) | eight(high) << 8
}

/// First and last whole pixel between two coordinates, within the tile.
#[inline(always)]
fn columns(from: f32, to: f32) -> (i32, i32) {
    // Both are made positive, where rounding towards zero rounds down.
    let (from, to) = (simd_max(simd_min(from, TILE as f32), -1.0), simd_max(simd_min(to, TILE as f32), -1.0));
    let first = TILE as i32 - floor_to_i32(TILE as f32 - from);
    let last = floor_to_i32(to + 1.0) - 1;
    let (first, last) = (if first < 0 { 0 } else { first }, if last > TILE as i32 - 1 { TILE as i32 - 1 } else { last });
    (first, last)
}

/// Bits of the blocks of the row at `y` in which all edge functions reach zero.
#[inline(always)]
fn blocks_met(edges: &[[f32; 3]; 3], y: f32) -> u32 {
    let mut met = [0_u32; LANES];
    let mut reach = [0.0; 3];
    for edge in 0..3 {
        let [a, b, c] = edges[edge];
        reach[edge] = b * y + c + simd_max(a, 0.0) * BLOCK_REACH + simd_max(b, 0.0) * BLOCK_REACH;
        // A little more, for edges whose functions are small beside their rounding.
        reach[edge] += (a.abs() + b.abs()) * 0.01;
    }
    for lane in 0..LANES {
        let touches = |edge: usize| edges[edge][0] * BLOCK_X[lane] + reach[edge] >= 0.0;
        met[lane] = u32::from(touches(0) & touches(1) & touches(2)) << lane;
    }
    met.iter().fold(0, |all, bit| all | bit)
}
