//! The default engine: what hides a sample is read from a depth map of each device, and from a ray where the map leaves
//! doubt, or where rays for all samples cost less than the map.
//!
//! For each view: the steps of [`crate::planning::method::visibility`] before any shadow, for all samples at once; then, device
//! by device, few samples are joined with the optical centre by packets of rays. Of many, the tiles of the undistorted image
//! that they fall on are drawn with all triangles that meet them, and each sample is compared with the four pixels around it
//! (Williams 1978, *Casting Curved Shadows on Curved Surfaces*). It is seen where none of the four is nearer than the plane of
//! its own facet there by more than 0.003 mm. With z its depth and i its incidence, it is
//! hidden where all four are nearer than z − 0.06 mm − 1.5 pixels · tan i. Otherwise a ray to the optical centre decides. The
//! lens's distortion enters with the frame alone, which is tested before: rays are straight lines in the undistorted image.
//!
//! Cost a view: O(samples + triangles that face a device + pixels of the part). Memory: 18 bytes a triangle for the
//! clusters (45 at most), 31 bytes a sample, and for each thread 16 KiB a tile of one device (48 MB at 12 megapixels) and
//! 6 bytes a sample.

mod clusters;
mod kernels;
mod one_view;
mod pinhole;
mod pixel_set;
mod samples;
#[cfg(test)]
mod tests;
mod tile;
mod tiled_depth_buffer;

use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use super::rays::RAY_END_SHARE;
use super::view::{Optics, PASSES, SHADOWS, View};
use super::{Occluders, QualityScale, Row, SampleSet, VisibilityMatrix, ones};
use crate::cell::{DeviceName, PerDevice};
use crate::geometry::parallel;
use crate::geometry::{Part, Pose, ScannerFrame, SimdLevel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::surface::Surface;
use crate::planning::verdict::Cause;
pub(crate) use clusters::Clusters;
use kernels::{Compare, DepthLookup, EvaluateOptics, ScreenBounds, mark};
pub(super) use one_view::OneByOne;
use pinhole::Pinhole;
pub(super) use pixel_set::pixel_set;
use samples::{NO_SAMPLE, SAMPLES, SampleCluster, Samples};
use tiled_depth_buffer::{Grid, RenderPass, TiledDepthBuffer};

/// Clusters of samples that one task takes: about a millisecond.
const TASK: usize = 32;
/// Doubtful samples that one task takes.
const RAYS: usize = 512;

/// Views to be evaluated.
pub(super) struct Views<'a> {
    pub(super) poses: &'a [Pose<Part, ScannerFrame>],
    /// Marks those that may be chosen.
    pub(super) usable: &'a [bool],
}

/// Cost of a map in rays: drawing a tile takes about 160 of them, a triangle that is no larger than a pixel a quarter of one.
/// Measured with one thread, AVX-512, on parts of 8 000 to 1 000 000 triangles: 26 to 90 ns a ray, 8 µs a tile and 12 ns a
/// triangle.
const RAYS_OF_A_TILE: usize = 160;
const TRIANGLES_OF_A_RAY: usize = 4;

/// The samples of each cluster that are looked at, one bit each.
type Open = [u64];

pub(super) fn cast(
    surface: &Surface,
    views: &Views<'_>,
    optics: &Optics,
    quality_scale: Option<QualityScale>,
    occluders: &Occluders,
    ctx: &Context<'_>,
) -> Result<VisibilityMatrix, Cancelled> {
    let engine = RasterEngine::new(surface, optics, quality_scale, occluders, ctx);
    let pool = ScratchPool { engine: &engine, free: Mutex::default(), done: AtomicUsize::new(0), views: views.poses.len() };
    let (usable, others): (Vec<_>, Vec<_>) = (0..views.poses.len()).partition(|view| views.usable[*view]);
    let mut rows = vec![Row::default(); views.poses.len()];
    let everything = vec![u64::MAX; engine.samples.clusters.len()];
    pool.rows(views.poses, &usable, &everything, &mut rows)?;
    // The rest is asked only about what no usable view measures: there alone it can make a difference.
    if !others.is_empty() {
        let mut measured = SampleSet::none_of(surface.sample_mm.len());
        usable.iter().for_each(|view| measured.insert_all(rows[*view].measured()));
        pool.rows(views.poses, &others, &engine.samples.outside(&measured), &mut rows)?;
    }
    Ok(VisibilityMatrix { rows, furthest_cause: engine.furthest(&pool.into_scratches()) })
}

/// Buffers that threads borrow while they work on a view.
struct ScratchPool<'a> {
    engine: &'a RasterEngine<'a>,
    free: Mutex<Vec<Scratch>>,
    done: AtomicUsize,
    views: usize,
}

impl ScratchPool<'_> {
    /// Puts the rows of some of the views into their places.
    fn rows(&self, poses: &[Pose<Part, ScannerFrame>], some: &[usize], open: &Open, rows: &mut [Row]) -> Result<(), Cancelled> {
        // One view a thread while there are enough of them; the threads share the views that are left over.
        let (alone, shared) = some.split_at(some.len() - some.len() % rayon::current_num_threads());
        let row = |view: &usize| self.row(&poses[*view], open, usize::MAX);
        let made = parallel::try_map(alone, row)?;
        alone.iter().zip(made).for_each(|(view, row)| rows[*view] = row);
        for view in shared {
            rows[*view] = self.row(&poses[*view], open, 1)?;
        }
        Ok(())
    }

    fn row(&self, pose: &Pose<Part, ScannerFrame>, open: &Open, grain: usize) -> Result<Row, Cancelled> {
        let mut scratch = self.lock().pop().unwrap_or_else(|| self.engine.scratch());
        let row = self.engine.row(pose, open, &mut scratch, grain)?;
        self.lock().push(scratch);
        self.engine.ctx.progress(self.done.fetch_add(1, Ordering::Relaxed) + 1, self.views);
        Ok(row)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<Scratch>> {
        self.free.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn into_scratches(self) -> Vec<Scratch> {
        self.free.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

struct RasterEngine<'a> {
    surface: &'a Surface,
    optics: &'a Optics,
    quality_scale: Option<QualityScale>,
    occluders: &'a Occluders,
    samples: Samples,
    grids: PerDevice<Grid>,
    level: SimdLevel,
    ctx: &'a Context<'a>,
}

/// Buffers of one thread.
struct Scratch {
    /// Number of the first step at which each sample fails, [`PASSES`] if none; by clusters.
    states: Vec<[u8; SAMPLES]>,
    /// Step of quality of each sample that passes the steps before any shadow; by clusters.
    steps: Vec<[i16; SAMPLES]>,
    /// Step of quality of each measured sample, in its place in the surface.
    steps_by_sample: Vec<i16>,
    /// Highest number of a cause so far, of each sample.
    furthest: Vec<[u8; SAMPLES]>,
    /// Tiles that samples fall on, by device.
    touched: PerDevice<Vec<AtomicBool>>,
    depth_buffer: TiledDepthBuffer,
}

impl<'a> RasterEngine<'a> {
    fn new(
        surface: &'a Surface,
        optics: &'a Optics,
        quality_scale: Option<QualityScale>,
        occluders: &'a Occluders,
        ctx: &'a Context<'a>,
    ) -> Self {
        Self {
            surface,
            optics,
            quality_scale,
            occluders,
            samples: Samples::new(surface, occluders.clusters.order()),
            grids: optics.lenses().map(Grid::of),
            level: ctx.simd_level(),
            ctx,
        }
    }

    fn scratch(&self) -> Scratch {
        let clusters = self.samples.clusters.len();
        Scratch {
            states: vec![[0; SAMPLES]; clusters],
            steps: vec![[0; SAMPLES]; clusters],
            steps_by_sample: vec![0; self.surface.sample_mm.len()],
            furthest: vec![[Cause::Facing as u8; SAMPLES]; clusters],
            touched: self.grids.map(|grid| std::iter::repeat_with(AtomicBool::default).take(grid.tiles()).collect()),
            depth_buffer: TiledDepthBuffer::default(),
        }
    }

    fn row(&self, pose: &Pose<Part, ScannerFrame>, open: &Open, scratch: &mut Scratch, grain: usize) -> Result<Row, Cancelled> {
        let view = self.optics.at(pose);
        let pinhole = |(lens, device_from_part)| Pinhole::new(lens, device_from_part, &self.occluders.clusters.centre_mm);
        let pinholes = self.optics.lenses().zip(view.device_from_part.as_ref()).map(pinhole);
        self.evaluate_optics(&view, open, scratch, grain)?;
        self.mark_tiles(&pinholes, scratch, grain)?;
        for device in DeviceName::ALL {
            self.test_occlusion(device, &view, &pinholes[device], scratch, grain)?;
        }
        Ok(self.finish(scratch))
    }

    /// The steps before any shadow.
    fn evaluate_optics(&self, view: &View<'_>, open: &Open, scratch: &mut Scratch, grain: usize) -> Result<(), Cancelled> {
        let clusters = self.samples.clusters.par_chunks(TASK).zip(open.par_chunks(TASK));
        let tasks = clusters.zip(scratch.states.par_chunks_mut(TASK)).zip(scratch.steps.par_chunks_mut(TASK));
        let scale = self.quality_scale;
        tasks.with_min_len(grain).try_for_each(|(((clusters, open), states), steps)| {
            self.ctx.check()?;
            for (((cluster, open), states), steps) in clusters.iter().zip(open).zip(states).zip(steps) {
                if *open == 0 || view.centres_mm.iter().any(|centre| cluster.faces_away(&(centre - self.surface.centre_mm))) {
                    *states = [Cause::Facing as u8; SAMPLES];
                    continue;
                }
                let (centre_mm, incidence_min) = (&self.surface.centre_mm, self.optics.incidence_min());
                self.level.run(EvaluateOptics { view, cluster, centre_mm, incidence_min, scale, states, steps });
                if *open != u64::MAX {
                    let closed = (0..SAMPLES).filter(|place| open >> place & 1 == 0);
                    closed.for_each(|place| states[place] = Cause::Facing as u8);
                }
            }
            Ok(())
        })
    }

    /// Marks the tiles that the remaining samples fall on, where these are not so few that rays cost less in any case.
    fn mark_tiles(&self, pinholes: &PerDevice<Pinhole>, scratch: &mut Scratch, grain: usize) -> Result<(), Cancelled> {
        if self.rays_cost_less(passing(&scratch.states), 1) {
            return Ok(());
        }
        scratch.touched.iter().flatten().for_each(|tile| tile.store(false, Ordering::Relaxed));
        let (touched, offset_mm) = (&scratch.touched, self.scene_from_part_centre());
        let tasks = self.samples.clusters.par_chunks(TASK).zip(scratch.states.par_chunks(TASK));
        tasks.with_min_len(grain).try_for_each(|(clusters, states)| {
            self.ctx.check()?;
            for (cluster, states) in clusters.iter().zip(states).filter(|(_, states)| states.contains(&PASSES)) {
                for device in DeviceName::ALL {
                    let bounds = self.level.run(ScreenBounds { cluster, states, pinhole: &pinholes[device], offset_mm });
                    mark(&touched[device], &self.grids[device], bounds);
                }
            }
            Ok(())
        })
    }

    /// Returns true if rays for so many samples cost less than a map of so many tiles.
    fn rays_cost_less(&self, samples: usize, tiles: usize) -> bool {
        samples < RAYS_OF_A_TILE * tiles + self.occluders.clusters.triangles / TRIANGLES_OF_A_RAY
    }

    /// Offset from the part's centre to the scene's.
    fn scene_from_part_centre(&self) -> [f32; 3] {
        (self.surface.centre_mm - self.occluders.clusters.centre_mm).map(|mm| mm as f32).into()
    }

    /// Tests which of the remaining samples a device sees.
    fn test_occlusion(
        &self,
        device: DeviceName,
        view: &View<'_>,
        pinhole: &Pinhole,
        scratch: &mut Scratch,
        grain: usize,
    ) -> Result<(), Cancelled> {
        let touched = &scratch.touched[device];
        let passing = passing(&scratch.states);
        let tiles = || touched.iter().filter(|tile| tile.load(Ordering::Relaxed)).count();
        if self.rays_cost_less(passing, 1) || self.rays_cost_less(passing, tiles()) {
            return self.cast_rays(device, view, scratch, grain);
        }
        let pass = RenderPass { scene: &self.occluders.clusters, pinhole, grid: self.grids[device], level: self.level, grain };
        scratch.depth_buffer.prepare(&pass, |tile| touched[tile].load(Ordering::Relaxed), self.ctx)?;
        scratch.depth_buffer.draw(&pass, self.ctx)?;
        let (maps, slots) = scratch.depth_buffer.maps();
        let lookup = DepthLookup {
            maps,
            slots,
            grid: &self.grids[device],
            pinhole,
            offset_mm: self.scene_from_part_centre(),
            hidden: SHADOWS[device] as u8,
        };
        self.decide(device, view, &mut scratch.states, grain, |cluster, states| {
            self.level.run(Compare { lookup: &lookup, cluster, states })
        })
    }

    /// Tests occlusion by rays alone, where the map would cost more than a ray for every sample.
    fn cast_rays(&self, device: DeviceName, view: &View<'_>, scratch: &mut Scratch, grain: usize) -> Result<(), Cancelled> {
        self.decide(device, view, &mut scratch.states, grain, |_, states| {
            (0..SAMPLES).fold(0, |doubts, place| doubts | u64::from(states[place] == PASSES) << place)
        })
    }

    /// Settles by rays to a device what `compare` leaves in doubt of each cluster.
    fn decide(
        &self,
        device: DeviceName,
        view: &View<'_>,
        states: &mut [[u8; SAMPLES]],
        grain: usize,
        compare: impl Fn(&SampleCluster, &mut [u8; SAMPLES]) -> u64 + Sync,
    ) -> Result<(), Cancelled> {
        let tasks = self.samples.clusters.par_chunks(TASK).zip(states.par_chunks_mut(TASK));
        let centre = view.centres_mm[device];
        tasks.with_min_len(grain).try_for_each(|(clusters, states)| {
            self.ctx.check()?;
            let (mut doubtful, mut targets, mut hidden) = (Vec::new(), Vec::new(), Vec::new());
            for (index, (cluster, states)) in clusters.iter().zip(states.iter_mut()).enumerate() {
                if states.contains(&PASSES) {
                    doubtful.extend(ones(compare(cluster, states)).map(|place| (index, place as usize)));
                }
            }
            for doubtful in doubtful.chunks(RAYS) {
                self.ctx.check()?;
                targets.clear();
                let target = |(index, place): &(usize, usize)| self.surface.sample_mm[clusters[*index].number[*place] as usize];
                targets.extend(doubtful.iter().map(target));
                self.occluders.rays.blocked_from(self.level, &centre, &targets, RAY_END_SHARE, &mut hidden);
                for (&(index, place), &hidden) in doubtful.iter().zip(&hidden) {
                    states[index][place] = if hidden { SHADOWS[device] as u8 } else { PASSES };
                }
            }
            Ok(())
        })
    }

    /// The row in the surface's order; the furthest causes are remembered.
    fn finish(&self, scratch: &mut Scratch) -> Row {
        let mut measured = SampleSet::none_of(self.surface.sample_mm.len());
        let Scratch { states, steps, steps_by_sample, furthest, .. } = scratch;
        for (((cluster, states), steps), furthest) in self.samples.clusters.iter().zip(states).zip(steps).zip(furthest) {
            if *states == [Cause::Facing as u8; SAMPLES] {
                continue;
            }
            for place in 0..SAMPLES {
                let cause = if states[place] == PASSES { 0 } else { states[place] };
                furthest[place] = furthest[place].max(cause);
            }
            for place in (0..SAMPLES).filter(|place| states[*place] == PASSES) {
                measured.insert(SampleId(cluster.number[place]));
                steps_by_sample[cluster.number[place] as usize] = steps[place];
            }
        }
        let row = Row::new(measured.into_words());
        match self.quality_scale {
            Some(scale) => {
                // Iterated from within: a nested iterator is slow from outside.
                let mut steps = Vec::with_capacity(row.count());
                row.samples().for_each(|sample| steps.push(steps_by_sample[sample.index()]));
                row.with_quality(steps, scale)
            }
            None => row,
        }
    }

    /// The furthest cause of each sample over all views.
    fn furthest(&self, scratches: &[Scratch]) -> Vec<Cause> {
        let mut furthest = vec![Cause::Facing; self.surface.sample_mm.len()];
        for (index, cluster) in self.samples.clusters.iter().enumerate() {
            for place in (0..SAMPLES).filter(|place| cluster.number[*place] != NO_SAMPLE) {
                let highest = scratches.iter().map(|scratch| scratch.furthest[index][place]).max();
                let highest = highest.map_or(Cause::Facing, |cause| Cause::ALL[usize::from(cause)]);
                furthest[cluster.number[place] as usize] = highest;
            }
        }
        furthest
    }
}

/// Number of samples that pass every step so far.
fn passing(states: &[[u8; SAMPLES]]) -> usize {
    states.as_flattened().iter().filter(|state| **state == PASSES).count()
}
