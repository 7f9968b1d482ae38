//! Depth buffer of triangles. They are rasterised with fixed-point edge functions (Pineda, *A Parallel Algorithm for Polygon
//! Rasterization*, 1988), which leave no cracks between neighbours and give the same result on every run, at every level of vector
//! instructions. Small triangles test each sample of their box; of others, the run of each row is found by division and filled as
//! a whole. Camera frame: +z forward, +x right, +y down.
//!
//! Cost: O(triangles + samples that they cover). Memory: 8 bytes a sample.

use std::ops::Range;

use nalgebra::Point3;

use super::camera::Camera;
use crate::geometry::{simd_max, simd_min};

/// Steps of the fixed-point grid per sample.
pub(super) const STEPS: i64 = 16;
/// Relative increase of the depth of back faces, so that of two coincident sheets the one that faces the camera is seen.
const BACK_BIAS: f64 = 1e-5;
/// Clamp on coordinates, in steps, far outside any picture: their products then fit 64 bits.
const FAR_STEPS: f64 = 1e8;
/// Samples of a row that are tested side by side.
const LANES: usize = 8;
/// Width and height of a box, in steps, up to which each of its samples is tested: edge functions then fit 32 bits.
const SMALL_STEPS: i32 = 12 * STEPS as i32;

/// A vertex in the picture.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Projected {
    /// Place, steps.
    pub(super) x: i32,
    pub(super) y: i32,
    /// 1/z, 1/mm; 0 before the near plane.
    pub(super) inverse_depth: f64,
}

impl Projected {
    /// A point given in the camera's frame.
    #[inline(always)]
    pub(super) fn of(fine: &Camera, p: &Point3<f64>) -> Self {
        match fine.pixel(p) {
            Some([x, y]) => Self { x: steps(x), y: steps(y), inverse_depth: 1.0 / p.z },
            None => Self::default(),
        }
    }
}

/// Place on the fixed-point grid.
#[inline(always)]
fn steps(at: f64) -> i32 {
    (at * STEPS as f64).round_ties_even().clamp(-FAR_STEPS, FAR_STEPS) as i32
}

/// The nearest triangle at each sample, row-major.
pub(super) struct DepthBuffer {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Rows from the top, and [`LANES`] more in which nothing is drawn. A sample is the number whose upper bits are those of 1/z, which is
    /// positive and linear across the picture of a plane, and whose lower bits are the complement of the triangle's number. So the greater
    /// is the nearer, and of equally near ones the first; 0 is none. It is a float because the greater of two floats is one instruction
    /// on every CPU, where that of two integers of this size becomes a masked store, which some write in twenty cycles.
    samples: Vec<f64>,
}

/// Triangle of a sample of the buffer; meaningless for 0.
#[inline(always)]
pub(super) fn face_of(sample: f64) -> usize {
    !(sample.to_bits() as u32) as usize
}

/// 1/z of a sample of the buffer; 0 where there is nothing.
#[inline(always)]
pub(super) fn inverse_depth_of(sample: f64) -> f32 {
    f32::from_bits((sample.to_bits() >> 32) as u32)
}

impl DepthBuffer {
    /// An empty buffer.
    pub(super) fn new(size_px: [usize; 2]) -> Self {
        let [width, height] = size_px;
        // Written rather than asked for as zeros: those are mapped twice, when first read and when first written.
        let mut samples = Vec::with_capacity(width * height + LANES);
        samples.extend(std::iter::repeat_n(0.0, width * height + LANES));
        Self { width, height, samples }
    }

    /// Row of samples from the top; empty below the picture.
    pub(super) fn row(&self, y: usize) -> &[f64] {
        if y < self.height { &self.samples[y * self.width..(y + 1) * self.width] } else { &[] }
    }

    /// The sample at a place in the picture, if a triangle is there.
    pub(super) fn at(&self, x: usize, y: usize) -> Option<f64> {
        self.row(y).get(x).copied().filter(|sample| *sample > 0.0)
    }

    /// Draws a triangle of which no corner lies before the near plane.
    #[inline(always)]
    pub(super) fn draw(&mut self, corners: [Projected; 3], face: u32) {
        let [a, b, c] = corners;
        let (low_x, high_x) = (a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x));
        let (low_y, high_y) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        let (columns, rows) = (span(low_x, high_x, self.width), span(low_y, high_y, self.height));
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        let Some(triangle) = Triangle::new(a, b, c, face) else { return };
        let is_small = high_x - low_x <= SMALL_STEPS && high_y - low_y <= SMALL_STEPS;
        if is_small { self.fill_small(&triangle, columns, rows) } else { self.fill(&triangle, &columns, rows) }
    }

    #[inline(always)]
    fn fill_small(&mut self, triangle: &Triangle, columns: Range<usize>, rows: Range<usize>) {
        let values = triangle.values(columns.start, rows.start);
        let mut depth = triangle.inverse_depth_at(&values);
        let [right, down] = triangle.slope;
        let mut values = narrow(values);
        let (to_right, to_next) = (narrow(triangle.right), narrow(triangle.down));
        for y in rows {
            let start = y * self.width;
            for first in columns.clone().step_by(LANES) {
                let across = (first - columns.start) as i32;
                let left = (columns.end - first) as i32;
                let near = (depth + right * f64::from(across)) as f32;
                let (mut inside, mut inverse_depth) = ([0; LANES], [0.0; LANES]);
                for lane in 0..LANES {
                    let place = across + lane as i32;
                    // None of these is negative inside.
                    inside[lane] = (values[0] + to_right[0] * place)
                        | (values[1] + to_right[1] * place)
                        | (values[2] + to_right[2] * place)
                        | (left - 1 - lane as i32);
                    inverse_depth[lane] = near + right as f32 * lane as i32 as f32;
                }
                self.keep_nearest(start + first, triangle, &inside, &inverse_depth);
            }
            for edge in 0..3 {
                values[edge] += to_next[edge];
            }
            depth += down;
        }
    }

    /// Keeps the nearer of what is at [`LANES`] samples and of a triangle, which is at those where `inside` is not negative.
    #[inline(always)]
    fn keep_nearest(&mut self, first: usize, triangle: &Triangle, inside: &[i32; LANES], inverse_depth: &[f32; LANES]) {
        let Some(samples) = self.samples[first..].first_chunk_mut::<LANES>() else { return };
        let mut nearest = *samples;
        for lane in 0..LANES {
            let inverse_depth = simd_min(simd_max(inverse_depth[lane], triangle.range[0]), triangle.range[1]);
            let new = u64::from(inverse_depth.to_bits()) << 32 | triangle.low_bits;
            let new = f64::from_bits(if inside[lane] >= 0 { new } else { 0 });
            nearest[lane] = nearest[lane].max(new);
        }
        *samples = nearest;
    }

    #[inline(always)]
    fn fill(&mut self, triangle: &Triangle, columns: &Range<usize>, rows: Range<usize>) {
        let mut values = triangle.values(columns.start, rows.start);
        let mut depth = triangle.inverse_depth_at(&values);
        let [right, down] = triangle.slope;
        for y in rows {
            let run = triangle.run(&values, columns.len());
            if !run.is_empty() {
                let start = y * self.width + columns.start;
                let near = (depth + right * run.start as f64) as f32;
                for first in (0..run.len()).step_by(LANES) {
                    let (mut inside, mut inverse_depth) = ([0; LANES], [0.0; LANES]);
                    for lane in 0..LANES {
                        let place = first as i32 + lane as i32;
                        inside[lane] = run.len() as i32 - 1 - place;
                        inverse_depth[lane] = near + right as f32 * place as f32;
                    }
                    self.keep_nearest(start + run.start + first, triangle, &inside, &inverse_depth);
                }
            }
            for edge in 0..3 {
                values[edge] += triangle.down[edge];
            }
            depth += down;
        }
    }
}

/// A triangle on the fixed-point grid.
struct Triangle {
    /// Edge functions at the grid's origin, not negative on the inner side; one step of tolerance is added: where a long edge meets two
    /// short ones, as in some files, rounding would otherwise leave pinholes.
    at_origin: [i64; 3],
    /// Change of them from a sample to the next one of its row, and of its column.
    right: [i64; 3],
    down: [i64; 3],
    /// Inverse depth as weighted sum of them, with its constant.
    weights: [f64; 3],
    constant: f64,
    /// Change of the inverse depth from a sample to the next one of its row, and of its column.
    slope: [f64; 2],
    /// Lowest and highest inverse depth of its corners: within the tolerance, the plane of a sliver would extrapolate far beyond.
    range: [f32; 2],
    low_bits: u64,
}

impl Triangle {
    /// Sets up a triangle; `None` if it is seen edge-on.
    #[inline(always)]
    fn new(a: Projected, b: Projected, c: Projected, face: u32) -> Option<Self> {
        let [x, y] = [[a.x, b.x, c.x].map(i64::from), [a.y, b.y, c.y].map(i64::from)];
        let turned = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0]);
        // With y down, a triangle that is counter-clockwise seen from outside has a negative area when it faces the camera.
        let (sign, bias) = match turned {
            0 => return None,
            facing if facing < 0 => (-1, 1.0),
            _ => (1, 1.0 - BACK_BIAS),
        };
        let depths = [a, b, c].map(|corner| corner.inverse_depth * bias);
        let (mut at_origin, mut right, mut down, mut weights) = ([0; 3], [0; 3], [0; 3], [0.0; 3]);
        let (mut constant, mut slope) = (0.0, [0.0; 2]);
        let per_area = 1.0 / (turned * sign) as f64;
        for edge in 0..3 {
            let (from, to) = ((edge + 1) % 3, (edge + 2) % 3);
            let (dx, dy) = (sign * (x[to] - x[from]), sign * (y[to] - y[from]));
            let tolerance = dx.abs().max(dy.abs());
            at_origin[edge] = dy * x[from] - dx * y[from] + tolerance;
            right[edge] = -dy * STEPS;
            down[edge] = dx * STEPS;
            weights[edge] = depths[edge] * per_area;
            constant -= tolerance as f64 * weights[edge];
            slope[0] += right[edge] as f64 * weights[edge];
            slope[1] += down[edge] as f64 * weights[edge];
        }
        let range = [depths[0].min(depths[1]).min(depths[2]) as f32, depths[0].max(depths[1]).max(depths[2]) as f32];
        Some(Self { at_origin, right, down, weights, constant, slope, range, low_bits: u64::from(!face) })
    }

    /// Edge functions at the centre of a sample, tolerance included.
    #[inline(always)]
    fn values(&self, x: usize, y: usize) -> [i64; 3] {
        let [x, y] = [x, y].map(|n| n as i64 * STEPS + STEPS / 2);
        let mut values = self.at_origin;
        for edge in 0..3 {
            // Both are multiples of the steps a sample.
            values[edge] += self.down[edge] / STEPS * y + self.right[edge] / STEPS * x;
        }
        values
    }

    /// Inverse depth where the edge functions have these values.
    #[inline(always)]
    fn inverse_depth_at(&self, values: &[i64; 3]) -> f64 {
        self.constant
            + values[0] as f64 * self.weights[0]
            + values[1] as f64 * self.weights[1]
            + values[2] as f64 * self.weights[2]
    }

    /// Samples of a row of so many that lie inside, from the values at its first.
    #[inline(always)]
    fn run(&self, values: &[i64; 3], count: usize) -> Range<usize> {
        let (mut first, mut end) = (0, count as i64);
        for edge in 0..3 {
            let (value, step) = (values[edge], self.right[edge]);
            if step > 0 {
                if value < 0 {
                    first = first.max((-value + step - 1) / step);
                }
            } else if value < 0 {
                return 0..0;
            } else if step < 0 {
                end = end.min(value / -step + 1);
            }
        }
        if first < end { first as usize..end as usize } else { 0..0 }
    }
}

/// Edge functions, or changes of them, of a small triangle.
#[inline(always)]
fn narrow([a, b, c]: [i64; 3]) -> [i32; 3] {
    [a as i32, b as i32, c as i32]
}

/// Range of samples whose centres can lie between two places, one step of tolerance included.
#[inline(always)]
fn span(low: i32, high: i32, size: usize) -> Range<usize> {
    let low = (i64::from(low) - 2 + STEPS / 2).div_euclid(STEPS).max(0);
    let high = (i64::from(high) + 1 - STEPS / 2).div_euclid(STEPS).min(size as i64 - 1);
    if low <= high { low as usize..high as usize + 1 } else { 0..0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(x: i32, y: i32, inverse_depth: f64) -> Projected {
        Projected { x, y, inverse_depth }
    }

    /// Samples that a triangle covers by the edge functions alone.
    fn expected(corners: [Projected; 3], size_px: [usize; 2]) -> Vec<bool> {
        let [mut a, b, mut c] = corners.map(|corner| [i64::from(corner.x), i64::from(corner.y)]);
        if (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) < 0 {
            (a, c) = (c, a);
        }
        let is_near = |at: i64, axis: usize| {
            let ends = [a[axis], b[axis], c[axis]];
            let (low, high) = (ends.into_iter().min().expect("three"), ends.into_iter().max().expect("three"));
            (low - 1..=high + 1).contains(&at)
        };
        let inside = |x: i64, y: i64| {
            is_near(x, 0)
                && is_near(y, 1)
                && [(a, b), (b, c), (c, a)].iter().all(|(from, to)| {
                    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
                    dx * (y - from[1]) - dy * (x - from[0]) + dx.abs().max(dy.abs()) >= 0
                })
        };
        let at = |n: usize| n as i64 * STEPS + STEPS / 2;
        (0..size_px[1]).flat_map(|y| (0..size_px[0]).map(move |x| (x, y))).map(|(x, y)| inside(at(x), at(y))).collect()
    }

    #[test]
    fn small_and_large_triangles_cover_what_their_edges_hold() {
        let size_px = [64, 48];
        let mut state = 7u64;
        let mut random = |range: i64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) as i64).rem_euclid(range)
        };
        for round in 0..600 {
            let reach = [40, 300, 3000][round % 3];
            let (x, y) = (random(64 * STEPS), random(48 * STEPS));
            let corners: [Projected; 3] = std::array::from_fn(|_| {
                let (dx, dy) = (random(reach) - reach / 2, random(reach) - reach / 2);
                corner((x + dx) as i32, (y + dy) as i32, 0.002 + 1e-6 * random(900) as f64)
            });
            let [a, b, c] = corners.map(|corner| [i64::from(corner.x), i64::from(corner.y)]);
            if (b[0] - a[0]) * (c[1] - a[1]) == (b[1] - a[1]) * (c[0] - a[0]) {
                continue;
            }
            let mut buffer = DepthBuffer::new(size_px);
            buffer.draw(corners, 5);
            let covered: Vec<bool> = (0..size_px[1]).flat_map(|y| buffer.row(y)).map(|sample| *sample > 0.0).collect();
            assert_eq!(covered, expected(corners, size_px), "{corners:?}");
            let depths = corners.map(|corner| corner.inverse_depth as f32);
            let [low, high] = [f32::min, f32::max].map(|choose| depths.into_iter().reduce(choose).expect("three"));
            for sample in buffer.samples.iter().filter(|sample| **sample > 0.0) {
                assert_eq!(face_of(*sample), 5);
                assert!((low * 0.9999..=high * 1.0001).contains(&inverse_depth_of(*sample)), "{corners:?}");
            }
        }
    }

    #[test]
    fn the_nearer_triangle_stays_and_of_equal_ones_the_first() {
        let near = [corner(0, 0, 0.01), corner(0, 900, 0.01), corner(900, 0, 0.01)];
        let far = near.map(|corner| Projected { inverse_depth: 0.005, ..corner });
        for order in [[(near, 3), (far, 1)], [(far, 1), (near, 3)]] {
            let mut buffer = DepthBuffer::new([40, 40]);
            order.iter().for_each(|(corners, face)| buffer.draw(*corners, *face));
            assert_eq!(buffer.at(5, 5).map(face_of), Some(3));
            buffer.draw(near, 9);
            buffer.draw(near, 2);
            assert_eq!(buffer.at(5, 5).map(face_of), Some(2), "whatever the order in which they come");
        }
    }
}
