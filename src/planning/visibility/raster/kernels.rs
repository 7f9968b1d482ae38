//! Kernels over the samples of a cluster, sixteen or more at a time: the definition's steps before any shadow, where
//! the remaining ones fall in a device's image, and the comparison with its map.

use nalgebra::{Point3, Vector3};
use std::sync::atomic::{AtomicBool, Ordering};

use super::pinhole::{LANES, Pinhole};
use super::samples::{BATCHES, SAMPLES, SampleCluster};
use super::tile::{InverseDepth, TILE, offset_of, step_down, step_right};
use super::tiled_depth_buffer::Grid;
use crate::geometry::{Kernel, floor_to_i32, simd_from_fn, simd_max, simd_min};
use crate::planning::visibility::QualityScale;
use crate::planning::visibility::view::{IncidenceMin, PASSES, View};

/// Distance by which a pixel may be nearer than the plane of a sample's facet and still not hide it, mm: what the definition leaves
/// out before a sample. f32 leaves less; where bends between facets leave more, a ray decides.
const BAND_MM: f32 = 0.003;
/// Pixels of distance for which the surface's slope is allowed.
const BAND_PX: f32 = 1.5;
/// Distance by which all four pixels must be nearer, beyond the slope's share, for the map to hide a sample, mm.
const HIDDEN_MM: f32 = 0.06;

/// The definition's steps before any shadow, for a cluster of samples.
pub(super) struct EvaluateOptics<'a> {
    pub(super) view: &'a View<'a>,
    pub(super) cluster: &'a SampleCluster,
    pub(super) centre_mm: &'a Point3<f64>,
    /// Limits of each kind of requirement.
    pub(super) incidence_min: &'a [IncidenceMin],
    /// Scale of the quality, where it is asked for.
    pub(super) scale: Option<QualityScale>,
    pub(super) states: &'a mut [u8; SAMPLES],
    pub(super) steps: &'a mut [i16; SAMPLES],
}

impl Kernel for EvaluateOptics<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let ([x, y, z], [nx, ny, nz]) = (&self.cluster.offset_mm, &self.cluster.normal);
        let centre = [self.centre_mm.x, self.centre_mm.y, self.centre_mm.z];
        // Results go to arrays of this function first: only then is it plain that they overlap nothing that is read.
        let mut causes = [0_u64; SAMPLES];
        let IncidenceMin { left, right, projector } = self.incidence_min[0];
        let (mut left, mut right, mut projector) = ([left; SAMPLES], [right; SAMPLES], [projector; SAMPLES]);
        if self.incidence_min.len() > 1 {
            for i in 0..SAMPLES {
                let of_kind = &self.incidence_min[usize::from(self.cluster.kind[i])];
                (left[i], right[i], projector[i]) = (of_kind.left, of_kind.right, of_kind.projector);
            }
        }
        for i in 0..SAMPLES {
            let p = [centre[0] + f64::from(x[i]), centre[1] + f64::from(y[i]), centre[2] + f64::from(z[i])];
            let normal = [f64::from(nx[i]), f64::from(ny[i]), f64::from(nz[i])];
            let min_cos = IncidenceMin { left: left[i], right: right[i], projector: projector[i] };
            causes[i] = self.view.first_failing_step(p, normal, min_cos);
        }
        *self.states = simd_from_fn(|i| causes[i] as u8);
        let Some(scale) = self.scale.filter(|_| self.states.contains(&PASSES)) else { return };
        let mut qualities = [0.0; SAMPLES];
        for i in 0..SAMPLES {
            let p = [centre[0] + f64::from(x[i]), centre[1] + f64::from(y[i]), centre[2] + f64::from(z[i])];
            qualities[i] = self.view.quality_of(p, [f64::from(nx[i]), f64::from(ny[i]), f64::from(nz[i])]);
        }
        *self.steps = simd_from_fn(|i| scale.quantise(qualities[i] as f32));
    }
}

/// Bounds of the remaining samples of a cluster in a device's image: left, right, top, bottom.
pub(super) struct ScreenBounds<'a> {
    pub(super) cluster: &'a SampleCluster,
    pub(super) states: &'a [u8; SAMPLES],
    pub(super) pinhole: &'a Pinhole,
    pub(super) offset_mm: [f32; 3],
}

impl Kernel for ScreenBounds<'_> {
    type Output = [f32; 4];

    #[inline(always)]
    fn run(self) -> [f32; 4] {
        let mut bounds = [[f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES], [f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]];
        for batch in 0..BATCHES {
            let [u, v, _] = project(self.cluster, batch, self.pinhole, self.offset_mm);
            let states = &self.states.as_chunks::<LANES>().0[batch];
            for lane in 0..LANES {
                let passes = states[lane] == PASSES;
                let kept = |value: f32, other: f32| if passes { value } else { other };
                bounds[0][lane] = simd_min(kept(u[lane], f32::INFINITY), bounds[0][lane]);
                bounds[1][lane] = simd_max(kept(u[lane], f32::NEG_INFINITY), bounds[1][lane]);
                bounds[2][lane] = simd_min(kept(v[lane], f32::INFINITY), bounds[2][lane]);
                bounds[3][lane] = simd_max(kept(v[lane], f32::NEG_INFINITY), bounds[3][lane]);
            }
        }
        let lowest = |values: &[f32; LANES]| values.iter().fold(f32::INFINITY, |a, b| simd_min(a, *b));
        let highest = |values: &[f32; LANES]| values.iter().fold(f32::NEG_INFINITY, |a, b| simd_max(a, *b));
        [lowest(&bounds[0]), highest(&bounds[1]), lowest(&bounds[2]), highest(&bounds[3])]
    }
}

#[inline(always)]
fn project(cluster: &SampleCluster, batch: usize, pinhole: &Pinhole, offset_mm: [f32; 3]) -> [[f32; LANES]; 3] {
    let offsets = cluster.batch(batch);
    let mut points = [[0.0; LANES]; 3];
    for axis in 0..3 {
        for lane in 0..LANES {
            points[axis][lane] = offsets[axis][lane] + offset_mm[axis];
        }
    }
    pinhole.project([&points[0], &points[1], &points[2]])
}

/// Marks the tiles that hold a rectangle and the pixels around it.
pub(super) fn mark(touched: &[AtomicBool], grid: &Grid, [left, right, top, bottom]: [f32; 4]) {
    let (first, last) =
        (Grid::index(left - grid.left_px - 1.0, grid.columns), Grid::index(right - grid.left_px + 2.0, grid.columns));
    for row in Grid::index(top - grid.top_px - 1.0, grid.rows)..=Grid::index(bottom - grid.top_px + 2.0, grid.rows) {
        for column in first..=last {
            touched[usize::from(row) * grid.columns + usize::from(column)].store(true, Ordering::Relaxed);
        }
    }
}

/// A device's map, and how to look a sample up in it.
pub(super) struct DepthLookup<'a> {
    pub(super) maps: &'a [InverseDepth],
    pub(super) slots: &'a [u32],
    pub(super) grid: &'a Grid,
    pub(super) pinhole: &'a Pinhole,
    pub(super) offset_mm: [f32; 3],
    /// Mark of a sample that is hidden.
    pub(super) hidden: u8,
}

impl DepthLookup<'_> {
    #[inline(always)]
    fn inverse_depth(&self, x: u32, y: u32) -> f32 {
        let tile = (y / TILE as u32) as usize * self.grid.columns + (x / TILE as u32) as usize;
        let map = self.slots.get(tile).and_then(|slot| self.maps.get(*slot as usize));
        let place = offset_of(x % TILE as u32, y % TILE as u32) as usize;
        map.map_or(0.0, |map| map.as_flattened()[place])
    }

    /// Inverse depth at the four pixels around a place.
    #[inline(always)]
    fn around(&self, x: u32, y: u32, spot: Spot) -> [f32; 4] {
        let last = TILE as u32 - 1;
        if x % TILE as u32 == last || y % TILE as u32 == last {
            return [
                self.inverse_depth(x, y),
                self.inverse_depth(x + 1, y),
                self.inverse_depth(x, y + 1),
                self.inverse_depth(x + 1, y + 1),
            ];
        }
        let Some(map) = self.slots.get(spot.tile as usize).and_then(|slot| self.maps.get(*slot as usize)) else {
            return [0.0; 4];
        };
        let pixels: &[f32; TILE * TILE] = map.as_flattened().try_into().unwrap_or(&[0.0; TILE * TILE]);
        let at = |place: u32| pixels[place as usize % (TILE * TILE)];
        let below = spot.place + spot.down;
        [at(spot.place), at(spot.place + spot.right), at(below), at(below + spot.right)]
    }
}

/// Position of a pixel in the maps.
#[derive(Clone, Copy, Default)]
struct Spot {
    tile: u32,
    place: u32,
    /// Steps to its neighbours, unless they lie in another tile.
    right: u32,
    down: u32,
}

/// Compares the remaining samples of a cluster with a device's map.
pub(super) struct Compare<'a> {
    pub(super) lookup: &'a DepthLookup<'a>,
    pub(super) cluster: &'a SampleCluster,
    pub(super) states: &'a mut [u8; SAMPLES],
}

impl Kernel for Compare<'_> {
    /// The samples about which a ray must decide, one bit each.
    type Output = u64;

    #[inline(always)]
    fn run(self) -> u64 {
        let Self { lookup, cluster, states } = self;
        let mut doubts = 0;
        let centre: [f32; 3] =
            (lookup.pinhole.centre_mm - Vector3::from(lookup.offset_mm).cast::<f64>()).map(|mm| mm as f32).into();
        for (batch, states) in states.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            if !states.contains(&PASSES) {
                continue;
            }
            let [u, v, inverse_depth] = project(cluster, batch, lookup.pinhole, lookup.offset_mm);
            let (offsets, normals) = (cluster.batch(batch), cluster.batch_of_normals(batch));
            let (mut columns, mut rows) = ([0; LANES], [0; LANES]);
            let (mut tiles, mut places, mut rights, mut downs) = ([0; LANES], [0; LANES], [0; LANES], [0; LANES]);
            let (mut along_x, mut along_y, mut ahead) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            let mut hidden_mm = [0.0; LANES];
            for lane in 0..LANES {
                let (mut along, mut length) = (0.0, 0.0);
                for axis in 0..3 {
                    let towards = centre[axis] - offsets[axis][lane];
                    along += towards * normals[axis][lane];
                    length += towards * towards;
                }
                let depth_mm = 1.0 / inverse_depth[lane];
                let tan = simd_max(length - along * along, 0.0).sqrt() / along;
                let normal = [normals[0][lane], normals[1][lane], normals[2][lane]];
                [along_x[lane], along_y[lane]] = lookup.pinhole.slope(normal, along);
                hidden_mm[lane] = depth_mm - (BAND_PX / lookup.pinhole.focal_px * depth_mm * tan + HIDDEN_MM);
                let (x, y) = (simd_max(u[lane] - lookup.grid.left_px, 0.0), simd_max(v[lane] - lookup.grid.top_px, 0.0));
                columns[lane] = floor_to_i32(x) as u32;
                rows[lane] = floor_to_i32(y) as u32;
                // What the inverse depth of the facet's plane at the first of the four pixels may be at most.
                let back = along_x[lane] * (columns[lane] as i32 as f32 - x) + along_y[lane] * (rows[lane] as i32 as f32 - y);
                ahead[lane] = inverse_depth[lane] * (1.0 + BAND_MM * inverse_depth[lane]) + back;
            }
            for lane in 0..LANES {
                let (x, y) = (columns[lane], rows[lane]);
                tiles[lane] = y / TILE as u32 * lookup.grid.columns as u32 + x / TILE as u32;
                places[lane] = offset_of(x % TILE as u32, y % TILE as u32);
                rights[lane] = step_right(x);
                downs[lane] = step_down(y);
            }
            for lane in 0..LANES {
                if states[lane] != PASSES {
                    continue;
                }
                let spot = Spot { tile: tiles[lane], place: places[lane], right: rights[lane], down: downs[lane] };
                let [a, b, c, d] = lookup.around(columns[lane], rows[lane], spot);
                let (right, down) = (along_x[lane], along_y[lane]);
                let beyond = simd_max(simd_max(a, b - right), simd_max(c - down, d - right - down));
                let seen = beyond <= ahead[lane];
                let hidden = simd_min(simd_min(a, b), simd_min(c, d)) * hidden_mm[lane] > 1.0;
                doubts |= u64::from(!seen & !hidden) << (batch * LANES + lane);
                states[lane] = if hidden & !seen { lookup.hidden } else { PASSES };
            }
        }
        doubts
    }
}
