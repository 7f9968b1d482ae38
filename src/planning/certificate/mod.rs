//! Coverage of the chosen views on samples that they were not chosen on: as planned, and with poses that are off.
//!
//! Views chosen on a set of samples fit that set: its share reads high, by up to half a point on machined parts. So it is
//! evaluated again on a second set from another seed, as dense up to 400 000 triangles, and denser where a region of interest or a feature
//! is small, so that each region's share is told by samples of its own. A pose that is off is turned by the whole angle of
//! `robust.pose_error` about a random axis and moved by its whole distance in a random direction: each view by an error
//! of its own about the viewpoint, the part with fixture and plate, but not the cell's obstacles, about the centre of its box, or every
//! view by the same error in the scanner frame. Directions are spread over blocks of six draws, each block with a stream of its own, so
//! that neither threads nor the number of draws change them (`draws.rs`). Cost: a view of the table for each chosen view, and rays for some
//! ten thousand samples for each draw.

mod draws;
pub mod recheck;
#[cfg(test)]
mod tests;

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use super::context::{Cancelled, Context, PlanError};
use super::ids::{SampleId, SetupId};
use super::params::{Objective, PlanParams};
use super::plan::tally::measured_area;
use super::plan::{Certificate, Independent, IndependentRegion, PlannedView};
use super::random::split_mix;
use super::realism::{self, RiskInput, RiskView};
use super::scene::PlanInput;
use super::scene::demand::mask_alike;
use super::sight::Sight;
use super::sight::sky::{Sky, SkyProbe, stands_on};
use super::surface::{Surface, requirements};
use super::visibility::{self, Occluders, Row, SampleSet};
use crate::geometry::{Part, Pose, RayScene, ScannerFrame, Table, parallel};

/// Triangles up to which every one has a second sample of its own; a finer mesh gets as many samples, by area. The standard error of a share
/// of 97 % is then below 0.03 points: √(p (1 − p) / n), less for samples that are spread over the part (Cochran 1977, chapter 8).
const MAX_SAMPLES: usize = 400_000;
/// Samples that each region of interest and feature has at least: the standard error of a share of 95 % of it is then one point, 0.05 · 0.95 /
/// 0.01².
const SAMPLES_OF_A_REGION: usize = 475;
/// Name of the second samples among what is hashed with the seed.
const SECOND_SAMPLES: u64 = 0x7365_636f_6e64;

/// A view as it is taken.
#[derive(Clone, Copy)]
struct TakenView<'a> {
    /// Pose in the frame of the part as it lies.
    part_from_scanner: &'a Pose<Part, ScannerFrame>,
    /// Pose of the part as it lies in the frame of the planned one, where that is another.
    displaced: Option<&'a Pose<Part, Part>>,
    /// Table angle; `None` without a cell.
    table_rad: Option<f64>,
}

/// Views that are taken while the part lies in one way.
pub(super) struct SetupViews<'a> {
    pub(super) occluders: &'a Occluders,
    /// Lines of sight past what stands in the cell; `None` without a cell.
    pub(super) sight: Option<&'a Sight>,
    pub(super) views: Vec<Pose<Part, ScannerFrame>>,
    /// Table angle at which the cell takes each view; `None` without a cell.
    pub(super) table_rad: Vec<Option<f64>>,
}

impl<'a> SetupViews<'a> {
    /// The views of a setup that measure something.
    pub(super) fn of(occluders: &'a Occluders, sight: Option<&'a Sight>, views: &[PlannedView], setup: SetupId) -> Self {
        let measuring = || views.iter().filter(|view| view.rejected.is_none() && view.setup == setup);
        let table_rad = measuring().map(|view| view.station.map(|station| station.table_angle_rad)).collect();
        Self { occluders, sight, views: measuring().map(|view| view.part_from_scanner).collect(), table_rad }
    }

    /// Takes out of the rows of views that stand at `poses` what obstacles of the cell hide.
    fn in_sight(
        &self,
        surface: &Surface,
        poses: &[Pose<Part, ScannerFrame>],
        mut rows: Vec<Row>,
        ctx: &Context<'_>,
    ) -> Result<Vec<Row>, Cancelled> {
        for ((row, pose), table_rad) in rows.iter_mut().zip(poses).zip(&self.table_rad) {
            let view = TakenView { part_from_scanner: pose, displaced: None, table_rad: *table_rad };
            self.keep_in_sight(surface, &view, row, ctx)?;
        }
        Ok(rows)
    }

    /// Takes out of the row of one of the views what obstacles of the cell hide.
    fn keep_in_sight(&self, surface: &Surface, view: &TakenView<'_>, row: &mut Row, ctx: &Context<'_>) -> Result<(), Cancelled> {
        let sight = self.sight.filter(|sight| !sight.has_no_obstacles());
        let TakenView { part_from_scanner: pose, displaced, table_rad } = *view;
        let Some((sight, table_rad)) = sight.zip(table_rad) else { return Ok(()) };
        let hidden = match displaced {
            Some(displaced) => sight.hidden_of_displaced(surface, (pose, displaced), row.measured(), table_rad, ctx)?,
            None => sight.hidden(surface, pose, row.measured(), table_rad, ctx)?,
        };
        if let Some(hidden) = hidden {
            *row = row.without(&hidden);
        }
        Ok(())
    }
}

/// Evaluates the views of all setups together. `part` is the scene of the part alone; `asked_as` are the samples that tell what is
/// asked, where that is not what the regions say; `standing` are the poses in which it is planned, if there is a plate.
///
/// # Errors
/// [`PlanError::Cancelled`].
pub(super) fn certify(
    (input, params): (&PlanInput<'_>, &PlanParams),
    setups: &[SetupViews<'_>],
    (part, asked_as): (&RayScene, Option<&Arc<Surface>>),
    standing: &[Pose<Table, Part>],
    ctx: &Context<'_>,
) -> Result<Certificate, PlanError> {
    let second = SecondSampling::new(input, params, setups, asked_as, ctx)?;
    let (independent, regions) = second.independent(part, standing, ctx)?;
    let nominal = independent.of_asked();
    let robust = params.robust.pose_error.map(|error| draws::robust(&second, error, nominal, ctx)).transpose()?;
    Ok(Certificate { independent, regions, robust })
}

/// The second set of samples, with what is evaluated on it.
struct SecondSampling<'a> {
    input: &'a PlanInput<'a>,
    /// Parameters of the plan, without the quality that only choosing needs.
    params: PlanParams,
    setups: &'a [SetupViews<'a>],
    surface: Surface,
    asked_area_mm2: Vec<f64>,
    asked_mm2: f64,
}

impl<'a> SecondSampling<'a> {
    fn new(
        input: &'a PlanInput<'a>,
        params: &PlanParams,
        setups: &'a [SetupViews<'a>],
        asked_as: Option<&Arc<Surface>>,
        ctx: &Context<'_>,
    ) -> Result<Self, PlanError> {
        let mut params = params.clone();
        params.selection.objective = Objective::Coverage;
        let seed = split_mix(params.seed ^ SECOND_SAMPLES);
        let asks_for_more =
            params.part.samples_per_mm2.is_some_and(|density| density * input.mesh.area_mm2() > MAX_SAMPLES as f64);
        // What is asked is told by samples in the same patches.
        let is_dense = asked_as.is_some() || asks_for_more || input.mesh.faces.len() <= MAX_SAMPLES;
        let mut surface = if is_dense {
            requirements::sampled_densely(input.mesh, &params, (SAMPLES_OF_A_REGION, seed), ctx)?
        } else {
            requirements::sampled_sparsely(input.mesh, &params, (MAX_SAMPLES, SAMPLES_OF_A_REGION, seed), ctx)?
        };
        asked_as.into_iter().for_each(|first| mask_alike(first, &mut surface));
        let asked_area_mm2 = surface.asked_area_mm2();
        let asked_mm2 = asked_area_mm2.iter().sum();
        Ok(Self { input, params, setups, surface, asked_area_mm2, asked_mm2 })
    }

    /// Coverage with the poses as planned, of the part and of each region.
    fn independent(
        &self,
        part: &RayScene,
        standing: &[Pose<Table, Part>],
        ctx: &Context<'_>,
    ) -> Result<(Independent, Vec<IndependentRegion>), Cancelled> {
        let poses: Vec<_> = self.views().map(|(_, view)| *view).collect();
        let rows = self.rows(&poses, &ctx.silent())?;
        let views: Vec<(&Row, &Pose<Part, ScannerFrame>)> = rows.iter().zip(&poses).collect();
        let grade = |(row, view): &(&Row, &Pose<Part, ScannerFrame>)| {
            visibility::grade(&self.surface, view, self.input.scanner, &self.params, row)
        };
        let rows = parallel::map(&views, grade);
        let mut is_measured = SampleSet::none_of(self.asked_area_mm2.len());
        rows.iter().for_each(|row| is_measured.insert_all(row.measured()));
        let rows = self.counted(&self.surface, rows, &poses, &ctx.silent())?;
        let views = poses.iter().map(Pose::origin_mm).zip(&rows);
        let measured = measured_area(&self.surface, &self.asked_area_mm2, views);
        let independent = Independent {
            samples: self.asked_area_mm2.len(),
            asked_area_mm2: self.asked_mm2,
            total_area_mm2: self.surface.area_where(|_| true),
            visible_area_mm2: self.visible_mm2(&is_measured, part, standing, ctx)?,
            measured,
        };
        Ok((independent, self.of_regions(&rows)))
    }

    /// Coverage of each region of interest and feature by views of these rows together.
    fn of_regions(&self, rows: &[Row]) -> Vec<IndependentRegion> {
        let mut regions = vec![IndependentRegion::default(); requirements::regions(&self.params).len()];
        if regions.is_empty() {
            return regions;
        }
        let mut measured = SampleSet::none_of(self.asked_area_mm2.len());
        rows.iter().for_each(|row| measured.insert_all(row.measured()));
        for (sample, area_mm2) in SampleId::number(&self.asked_area_mm2).filter(|(_, area_mm2)| **area_mm2 > 0.0) {
            for region in &self.surface.requirements.of(sample).regions {
                regions[*region].add(*area_mm2, measured.holds(sample));
            }
        }
        regions
    }

    /// Asked area that is measured, or neither rests on the plate in every pose of `standing` nor is enclosed.
    fn visible_mm2(
        &self,
        is_measured: &SampleSet,
        part: &RayScene,
        standing: &[Pose<Table, Part>],
        ctx: &Context<'_>,
    ) -> Result<f64, Cancelled> {
        let (mesh, best_mm, level) = (self.input.mesh, self.input.scanner.best_mm, ctx.simd_level());
        // Whether the sky is open does not depend on where the plate is, nor on limits.
        let sky = SkyProbe::new(mesh, part, (&[], 0.0), best_mm, FRAC_PI_2, level);
        let plate_radius_mm = self.input.cell.map_or(0.0, |cell| cell.turntable.plate_radius_mm);
        let stands = |sample, pose| stands_on(&self.surface, sample, pose, plate_radius_mm);
        let rests = |sample| !standing.is_empty() && standing.iter().all(|pose| stands(sample, pose));
        let is_open = |sample: &SampleId| {
            let area_mm2 = self.asked_area_mm2[sample.index()];
            area_mm2 > 0.0 && !is_measured.holds(*sample) && !rests(*sample)
        };
        let open: Vec<SampleId> = self.surface.samples().filter(is_open).collect();
        let skies = sky.skies(&self.surface, &open, ctx)?;
        let mut is_visible = is_measured.clone();
        let seen = open.iter().zip(skies).filter(|(_, sky)| *sky != Sky::Closed);
        seen.for_each(|(sample, _)| is_visible.insert(*sample));
        Ok(is_visible.iter().map(|sample| self.asked_area_mm2[sample.index()]).sum())
    }

    /// Views of all setups, each with its setup.
    fn views(&self) -> impl Iterator<Item = (&SetupViews<'a>, &Pose<Part, ScannerFrame>)> {
        self.setups.iter().flat_map(|setup| setup.views.iter().map(move |view| (setup, view)))
    }

    /// Samples that each view measures from one of `poses`, which are in the order of [`Self::views`].
    fn rows(&self, poses: &[Pose<Part, ScannerFrame>], ctx: &Context<'_>) -> Result<Vec<Row>, Cancelled> {
        let (scanner, mut rows) = (self.input.scanner, Vec::with_capacity(poses.len()));
        for setup in self.setups {
            let poses = &poses[rows.len()..rows.len() + setup.views.len()];
            let usable = vec![true; poses.len()];
            let cast = visibility::cast(&self.surface, poses, &usable, scanner, setup.occluders, &self.params, ctx)?;
            rows.extend(setup.in_sight(&self.surface, poses, cast.rows, ctx)?);
        }
        Ok(rows)
    }

    /// The rows of views at `poses`, over samples of `surface`, less what does not count, since it is at risk.
    fn counted(
        &self,
        surface: &Surface,
        rows: Vec<Row>,
        poses: &[Pose<Part, ScannerFrame>],
        ctx: &Context<'_>,
    ) -> Result<Vec<Row>, Cancelled> {
        if self.params.realism.count_at_risk {
            return Ok(rows);
        }
        let Self { input, params, .. } = self;
        let input = RiskInput { mesh: input.mesh, surface, scanner: input.scanner, params };
        let views = self.views().zip(rows.iter().zip(poses));
        let views: Vec<RiskView<'_>> = views
            .map(|((setup, _), (row, pose))| RiskView { part_from_scanner: *pose, row, surfaces: setup.occluders.rays() })
            .collect();
        let left_out = realism::risks(&input, &views, ctx)?.samples();
        Ok(realism::without(rows, &left_out))
    }
}
