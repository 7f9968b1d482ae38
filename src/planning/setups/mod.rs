//! Choice of setups: the poses in which the part is planned, at most `setups` and as few as do.
//!
//! The samples that a viewpoint measures do not depend on how the part lies, only whether it can be taken: all optical centres
//! above the plate. So one table of viewpoints all around tells for every set of poses what they can measure together, and the
//! smallest set is taken that loses no more than [`FLIP_WORTH`] against the best set of the size allowed. The cell's reach
//! enters afterwards, with the candidates of each chosen pose. The poses are those given, else how the part lies in the first
//! place and the stable poses of [`crate::geometry::stable_poses()`].
//!
//! Cost: one table of 412 views and 8 000 samples, some of the facets' where there are more facets than that; of 108 views where
//! there are many. So many views look at each block of the part, and fewer where they would be more than a job may have.

pub(super) mod registration;
#[cfg(test)]
mod tests;

use nalgebra::Vector3;

use self::registration::{SharedSurface, Stability, shared};
use super::candidates::{self, Scope};
use super::context::{Cancelled, Context, NoPlan, PlanError, Refusal};
use super::ids::PoseIndex;
use super::params::{CandidateParams, Hemisphere, Objective, PlanParams, Registration};
use super::plan::share;
use super::scene::{PlanInput, PlanningScene, standing_on};
use super::surface::{self, Surface};
use super::visibility::{Occluders, Optics, SampleSet, UnitedViews};
use crate::cell::Scanner;
use crate::geometry::parallel;
use crate::geometry::{Mesh, Part, Pose, ScannerFrame, StablePose, Table};

/// Poses that are compared.
const MAX_POSES: usize = 12;
/// Samples on which they are.
const SAMPLES: f64 = 8_000.0;
/// Triangles beyond which fewer viewpoints are compared: a ray among them takes longer.
const MANY_TRIANGLES: usize = 20_000;
/// Steps of the grids of viewpoints around a block, `step_small_deg` and `step_large_deg`, the finest first: of 412, 108, 44 and 12 views.
const GRIDS_DEG: [[f64; 2]; 4] = [[15.0, 30.0], [30.0, 45.0], [45.0, 90.0], [90.0, 90.0]];
/// Viewpoints that are evaluated side by side.
const BATCH: usize = 8;
/// Share of the asked area for which the part is turned over once more.
const FLIP_WORTH: f64 = 0.002;
/// Poses whose axes differ by less are one, radians (3°).
const SAME_POSE_RAD: f64 = 3.0 * std::f64::consts::PI / 180.0;

/// One way in which the part lies, with everything that hides a sample or hinders the robot then.
pub(super) struct Setup<'a> {
    pub(super) table_from_part: Pose<Table, Part>,
    pub(super) occluders: Occluders,
    /// Present with a cell.
    pub(super) scene: Option<PlanningScene<'a>>,
}

/// The poses to plan in: one where one is asked for, else some of a pool.
///
/// # Errors
/// [`PlanError`].
pub(super) fn poses<'p>(
    input: &PlanInput<'_>,
    params: &PlanParams,
    pool: impl FnOnce() -> Result<&'p [Pose<Table, Part>], Cancelled>,
    ctx: &Context<'_>,
) -> Result<Vec<Pose<Table, Part>>, PlanError> {
    let first = params.part.table_from_part.unwrap_or_default().pose();
    if params.setups <= 1 {
        return Ok(vec![first]);
    }
    if input.fixture.is_some() {
        return Err(PlanError::param("/setups", &Refusal::SetupsOfFixture));
    }
    let pool = pool()?;
    let reachable = measured_from(pool, input, params, &Occluders::interruptible([input.mesh], ctx)?, ctx)?;
    let asked_mm2 = reachable.area_mm2.iter().sum::<f64>();
    let max_setups = (params.setups as usize).min(pool.len());
    let links = (params.registration == Registration::Surface).then(|| reachable.links());
    let worth_mm2 = FLIP_WORTH * asked_mm2;
    let fewest = reachable.fewest(max_setups, worth_mm2, links.as_ref());
    if let Some(links) = &links
        && fewest.len() == 1
    {
        let freely = reachable.fewest(max_setups, worth_mm2, None);
        if freely.len() > 1 {
            let stability = links.best_among(&freely);
            return Err(PlanError::NoPlan(NoPlan::NotRegistered { stability }));
        }
    }
    Ok(fewest.into_iter().map(|pose| pool[pose.index()]).collect())
}

/// Ways in which a part may lie, and those that it is planned in.
pub(super) type PoolAndStanding<'a> = (&'a [Pose<Table, Part>], &'a [Pose<Table, Part>]);

/// One more pose to plan in.
pub(super) struct FurtherPose {
    /// Place among the poses of [`FurtherPoses`].
    pub(super) place: PoseIndex,
    pub(super) table_from_part: Pose<Table, Part>,
    /// True if a plan in one more setup, registered like this, chooses the poses that it has and this one by itself.
    pub(super) is_default: bool,
    /// Means of registration that it takes: that of the job where the setups share enough surface, else markers.
    pub(super) registration: Registration,
    /// Share of the asked area that can be measured from above the plate in it and in those that are planned in.
    pub(super) reachable_of_asked: f64,
}

/// Poses that a plan in one more setup chooses by itself, without some of those that are planned in.
pub(super) struct PosesAnew {
    /// The poses, in the order of the setups of that plan.
    pub(super) table_from_part: Vec<Pose<Table, Part>>,
    /// Means of registration: that of the job.
    pub(super) registration: Registration,
    /// Share of the asked area that can be measured from above the plate in them.
    pub(super) reachable_of_asked: f64,
}

/// Poses of a pool beside those that are planned in.
pub(super) struct FurtherPoses {
    pool: Vec<Pose<Table, Part>>,
    /// Poses that are planned in.
    own: Vec<PoseIndex>,
    /// True if the pool was offered with them.
    are_own_offered: bool,
    reachable: Reachable,
    /// Surface that poses share, where setups have to be registered by it.
    links: Option<Links>,
    registration: Registration,
    worth_mm2: f64,
}

impl FurtherPoses {
    /// The poses of `pool` beside `standing`, those that are planned in; `None` if there are none. `part` are the occluders of the
    /// part alone.
    ///
    /// # Errors
    /// [`PlanError`].
    pub(super) fn of(
        input: &PlanInput<'_>,
        params: &PlanParams,
        (offered, standing): PoolAndStanding<'_>,
        part: &Occluders,
        ctx: &Context<'_>,
    ) -> Result<Option<Self>, PlanError> {
        let mut pool = offered.to_vec();
        pool.extend(standing.iter().filter(|pose| !offered.contains(pose)).copied());
        let own = PoseIndex::number(&pool).filter(|(_, pose)| standing.contains(pose));
        let own: Vec<PoseIndex> = own.map(|(place, _)| place).collect();
        if own.len() == pool.len() {
            return Ok(None);
        }
        let reachable = measured_from(&pool, input, params, part, ctx)?;
        let registration = params.registration;
        let links = (registration == Registration::Surface).then(|| reachable.links());
        let worth_mm2 = FLIP_WORTH * reachable.area_mm2.iter().sum::<f64>();
        Ok(Some(Self { are_own_offered: pool.len() == offered.len(), pool, own, reachable, links, registration, worth_mm2 }))
    }

    /// The pose that adds most to those that are planned in, all that can be measured from above the plate counted, without those at the
    /// places that were `tried`; of them first that share enough surface with one that is planned in. `None` where no pose adds
    /// what a setup is worth.
    pub(super) fn best(&self, tried: &[PoseIndex]) -> Option<FurtherPose> {
        let Self { own, reachable, links, worth_mm2, .. } = self;
        let is_new = |pose: PoseIndex| !tried.contains(&pose);
        let is_joined =
            |pose: PoseIndex| links.as_ref().is_none_or(|links| own.iter().any(|own| links.between(*own, pose).is_fixed()));
        let joined = reachable.best_beside(own, *worth_mm2, |pose| is_new(pose) && is_joined(pose));
        let registration = if joined.is_some() { self.registration } else { Registration::Markers };
        let place = joined.or_else(|| reachable.best_beside(own, *worth_mm2, is_new))?;
        let links = links.as_ref().filter(|_| registration == Registration::Surface);
        let mut all = [own.as_slice(), &[place]].concat();
        all.sort_unstable();
        let is_default = self.are_own_offered && reachable.fewest(all.len(), *worth_mm2, links) == all;
        let reachable_of_asked = reachable.of_asked(&all);
        Some(FurtherPose { place, table_from_part: self.pool[place.index()], is_default, registration, reachable_of_asked })
    }

    /// The poses that a plan in one more setup chooses by itself, registered as the job asks, where they measure more, by what a setup is
    /// worth, than those that are planned in and one more. `None` where they are no more than those, or hold them all.
    pub(super) fn anew(&self) -> Option<PosesAnew> {
        let Self { pool, own, reachable, links, registration, worth_mm2, .. } = self;
        let chosen = reachable.fewest(own.len() + 1, *worth_mm2, links.as_ref());
        let holds_own = own.iter().all(|own| chosen.contains(own));
        if !self.are_own_offered || holds_own || chosen.len() <= own.len() {
            return None;
        }
        let reachable_of_asked = reachable.of_asked(&chosen);
        let beside = self.best(&[]).filter(|further| further.registration == *registration);
        let beside_of_asked = beside.map_or(0.0, |further| further.reachable_of_asked);
        let table_from_part = chosen.iter().map(|place| pool[place.index()]).collect();
        let anew = PosesAnew { table_from_part, registration: *registration, reachable_of_asked };
        (reachable_of_asked - beside_of_asked >= FLIP_WORTH).then_some(anew)
    }
}

/// Poses to choose from: those given, else the first and the stable ones.
///
/// # Errors
/// [`Cancelled`], by `stable`, which is asked where no poses are given.
pub(super) fn pool<'s>(
    mesh: &Mesh,
    params: &PlanParams,
    stable: impl FnOnce() -> Result<&'s [StablePose], Cancelled>,
) -> Result<Vec<Pose<Table, Part>>, Cancelled> {
    let first = params.part.table_from_part.unwrap_or_default().pose();
    if !params.part.resting_poses.is_empty() {
        return Ok(params.part.resting_poses.iter().map(crate::cell::PoseSpec::pose).collect());
    }
    let mut pool = vec![first];
    for stable in stable()? {
        let pose = standing_on(mesh, &stable.down);
        let is_new = |other: &Pose<Table, Part>| other.inverse().direction(&-Vector3::z()).angle(&stable.down) > SAME_POSE_RAD;
        if pool.iter().all(is_new) && pool.len() < MAX_POSES {
            pool.push(pose);
        }
    }
    Ok(pool)
}

/// Samples that can be measured from above the plate in each pose.
struct Reachable {
    surface: Surface,
    by_pose: Vec<SampleSet>,
    /// Asked area of each sample.
    area_mm2: Vec<f64>,
}

fn measured_from(
    pool: &[Pose<Table, Part>],
    input: &PlanInput<'_>,
    params: &PlanParams,
    occluders: &Occluders,
    ctx: &Context<'_>,
) -> Result<Reachable, PlanError> {
    let mut coarse = params.clone();
    coarse.part.samples_per_mm2 = Some(SAMPLES / input.mesh.area_mm2());
    coarse.part.patch_edge_mm = Some(f64::INFINITY);
    // Nothing is chosen by quality here.
    coarse.selection.objective = Objective::Coverage;
    let surface = if input.mesh.faces.len() as f64 > SAMPLES {
        surface::sample_some(input.mesh, &coarse.regions, (SAMPLES as usize, coarse.seed), ctx)?
    } else {
        surface::sample_for(input.mesh, &coarse.part, &coarse.regions, coarse.seed, ctx)?
    };
    let blocks = candidates::occupied_blocks(&surface, &pool[0], input.scanner);
    let grid = grid(blocks, surface.sample_mm.len(), input.mesh.faces.len() > MANY_TRIANGLES);
    let scope = Scope {
        part: input.mesh,
        surface: &surface,
        scanner: input.scanner,
        cell: None,
        table_from_part: pool[0],
        occluders,
        optics: &Optics::new(input.scanner, &coarse, &surface.requirements),
        score: &coarse.score,
        seed: 0,
    };
    let generated = candidates::generate(&scope, &grid, &ctx.silent())?;
    let views: Vec<_> = generated.remaining.iter().map(|candidate| candidate.part_from_scanner).collect();
    let above = |view: &Pose<Part, ScannerFrame>| -> Vec<PoseIndex> {
        let is_above = |pose: &PoseIndex| is_above(view, &pool[pose.index()], input.scanner, coarse.candidates.min_elevation_deg);
        PoseIndex::first(pool.len()).filter(is_above).collect()
    };
    let served: Vec<Vec<PoseIndex>> = views.iter().map(above).collect();
    let optics = Optics::new(input.scanner, &coarse, &surface.requirements);
    let silent = ctx.silent();
    let together = UnitedViews::new(&surface, &optics, occluders, &coarse, &silent);
    let by_pose = measured_in_poses(&together, &views, &served, pool.len())?;
    Ok(Reachable { by_pose, area_mm2: surface.asked_area_mm2(), surface })
}

/// The grid of viewpoints around a part of so many blocks: the finest that a job may have, or the second where the part has many triangles.
fn grid(blocks: usize, samples: usize, has_many_triangles: bool) -> CandidateParams {
    let grid = |[step_small_deg, step_large_deg]: [f64; 2]| CandidateParams {
        step_small_deg,
        step_large_deg,
        rolls_deg: vec![0.0, 90.0],
        hemisphere: Some(Hemisphere::Full),
        ..CandidateParams::ellipsoid()
    };
    let is_allowed =
        |grid: &CandidateParams| candidates::check_count(candidates::expected(grid, blocks, samples), samples).is_ok();
    let [.., coarsest] = GRIDS_DEG;
    let mut grids = GRIDS_DEG.into_iter().skip(usize::from(has_many_triangles)).map(grid);
    grids.find(is_allowed).unwrap_or_else(|| grid(coarsest))
}

/// Samples that views measure in each pose of the part in which they can be taken, `served`. A view is not asked about a sample that
/// earlier ones measure in each of its poses; the views of a batch stand all around, so that they see different samples.
fn measured_in_poses(
    together: &UnitedViews<'_>,
    views: &[Pose<Part, ScannerFrame>],
    served: &[Vec<PoseIndex>],
    poses: usize,
) -> Result<Vec<SampleSet>, Cancelled> {
    let mut by_pose = vec![together.nothing(); poses];
    let batches = views.len().div_ceil(BATCH);
    for batch in 0..batches {
        let row = |view: usize| {
            let mut measured = served[view].iter().map(|pose| &by_pose[pose.index()]);
            let Some(first) = measured.next() else { return Ok(None) };
            let mut known = first.clone();
            measured.for_each(|measured| known.retain_all(measured));
            together.row(&views[view], &known).map(Some)
        };
        let of_batch: Vec<usize> = (batch..views.len()).step_by(batches).collect();
        let rows = parallel::try_map(&of_batch, |view| row(*view))?;
        for (view, row) in of_batch.into_iter().zip(rows) {
            row.iter().for_each(|row| served[view].iter().for_each(|pose| by_pose[pose.index()].insert_all(row.measured())));
        }
    }
    Ok(by_pose)
}

/// Returns true if all devices stand above the plate's plane, and the viewpoint at this elevation or more.
pub(super) fn is_above(
    view: &Pose<Part, ScannerFrame>,
    table_from_part: &Pose<Table, Part>,
    scanner: &Scanner,
    min_elevation_deg: f64,
) -> bool {
    let table_from_scanner = *table_from_part * *view;
    let mut centres = scanner.devices.iter().map(|device| device.scanner_from_device.origin_mm());
    centres.all(|centre| table_from_scanner.point(&centre).z > 0.0)
        && candidates::stands_above(&table_from_scanner.origin_mm(), min_elevation_deg)
}

/// Stability of the registration of every two poses, by all that can be measured in both.
struct Links {
    by_pair: Vec<Vec<Stability>>,
}

impl Links {
    fn between(&self, a: PoseIndex, b: PoseIndex) -> &Stability {
        &self.by_pair[a.max(b).index()][a.min(b).index()]
    }

    /// Returns true if poses are registered to each other, each directly or through others.
    fn join(&self, poses: &[PoseIndex]) -> bool {
        let Some((first, rest)) = poses.split_first() else { return true };
        let (mut reached, mut rest) = (vec![*first], rest.to_vec());
        while let Some(next) = rest.iter().position(|pose| reached.iter().any(|other| self.between(*pose, *other).is_fixed())) {
            reached.push(rest.swap_remove(next));
        }
        rest.is_empty()
    }

    /// The most stable link of two of several poses.
    fn best_among(&self, poses: &[PoseIndex]) -> Stability {
        let pairs = poses.iter().enumerate().flat_map(|(at, b)| poses[..at].iter().map(|a| *self.between(*a, *b)));
        pairs.reduce(|a, b| if b.resistance > a.resistance { b } else { a }).unwrap_or_else(|| unreachable!("two poses"))
    }
}

impl Reachable {
    fn links(&self) -> Links {
        let part = SharedSurface::new(&self.surface);
        let link = |b: usize, a: usize| part.stability(&shared(&self.by_pose[a], &self.by_pose[b]));
        Links { by_pair: (0..self.by_pose.len()).map(|b| (0..b).map(|a| link(b, a)).collect()).collect() }
    }

    /// Share of the asked area that can be measured in some poses together.
    fn of_asked(&self, poses: &[PoseIndex]) -> f64 {
        let mut measured = SampleSet::none_of(self.area_mm2.len());
        poses.iter().for_each(|pose| measured.insert_all(&self.by_pose[pose.index()]));
        share(measured.iter().map(|sample| self.area_mm2[sample.index()]).sum(), self.area_mm2.iter().sum())
    }

    /// The fewest poses that lose no more than `worth_mm2` against the best of at most `max`, of those that `links` join.
    fn fewest(&self, max: usize, worth_mm2: f64, links: Option<&Links>) -> Vec<PoseIndex> {
        let best: Vec<(Vec<PoseIndex>, f64)> = (1..=max).map(|count| self.best_of(count, links)).collect();
        let enough_mm2 = best.iter().map(|(_, mm2)| *mm2).fold(0.0, f64::max) - worth_mm2;
        best.into_iter().find(|(_, mm2)| *mm2 >= enough_mm2).map_or_else(|| vec![PoseIndex(0)], |(poses, _)| poses)
    }

    /// The pose that adds most to `own`, of those that `allows` lets through, if it adds as much as it is worth; the first of
    /// equals.
    fn best_beside(&self, own: &[PoseIndex], worth_mm2: f64, allows: impl Fn(PoseIndex) -> bool) -> Option<PoseIndex> {
        let added_mm2 = |pose: PoseIndex| {
            let mut added = self.by_pose[pose.index()].clone();
            own.iter().for_each(|own| added.remove_all(&self.by_pose[own.index()]));
            added.iter().map(|sample| self.area_mm2[sample.index()]).sum::<f64>()
        };
        let others = PoseIndex::first(self.by_pose.len()).filter(|pose| !own.contains(pose) && allows(*pose));
        let added = others.map(|pose| (pose, added_mm2(pose))).filter(|(_, mm2)| *mm2 > 0.0 && *mm2 >= worth_mm2);
        added.reduce(|best, other| if other.1 > best.1 { other } else { best }).map(|(pose, _)| pose)
    }

    /// The poses that measure most together, so many; the first of equals. With the area, mm².
    fn best_of(&self, count: usize, links: Option<&Links>) -> (Vec<PoseIndex>, f64) {
        let mut best = (Vec::new(), f64::NEG_INFINITY);
        let nothing = SampleSet::none_of(self.area_mm2.len());
        self.extend(&mut Vec::new(), &nothing, (count, links), &mut best);
        best
    }

    fn extend(
        &self,
        poses: &mut Vec<PoseIndex>,
        measured: &SampleSet,
        (count, links): (usize, Option<&Links>),
        best: &mut (Vec<PoseIndex>, f64),
    ) {
        if poses.len() == count {
            let area_mm2 = measured.iter().map(|sample| self.area_mm2[sample.index()]).sum();
            if area_mm2 > best.1 && links.is_none_or(|links| links.join(poses)) {
                *best = (poses.clone(), area_mm2);
            }
            return;
        }
        let first = poses.last().map_or(0, |last| last.index() + 1);
        for pose in PoseIndex::first(self.by_pose.len()).skip(first) {
            let mut measured = measured.clone();
            measured.insert_all(&self.by_pose[pose.index()]);
            poses.push(pose);
            self.extend(poses, &measured, (count, links), best);
            poses.pop();
        }
    }
}
