//! Coverage of the chosen views on samples that they were not chosen on: as planned, and with poses that are off.
//!
//! Views chosen on a set of samples fit that set: its share reads high, by up to half a point on machined parts. So it is
//! evaluated again on a second set, as dense, from another seed. A pose that is off is turned by the whole angle of
//! `robust.pose_error` about a random axis and moved by its whole distance in a random direction: each view by an error
//! of its own about the viewpoint, the part as a whole about the centre of its box, or every view by the same error in the
//! scanner frame. Every draw has a stream of its own, so that neither threads nor the number of draws change it. Cost: a view of
//! the table for each chosen view and draw.

pub mod recheck;
#[cfg(test)]
mod tests;

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Point3, UnitQuaternion};
use rayon::prelude::*;

use super::context::{Cancelled, Context, PlanError};
use super::ids::{SampleId, SetupId};
use super::params::{Objective, PlanParams, PoseErrorParams};
use super::plan::{Certificate, Drawn, Independent, PlannedView, Robust, share};
use super::random::{Stream, split_mix};
use super::realism::{self, RiskInput, RiskView};
use super::scene::PlanInput;
use super::sight::Sight;
use super::sky::{Sky, SkyProbe, stands_on};
use super::surface::{Surface, requirements};
use super::tally::measured_area;
use super::visibility::{self, Occluders, Row, SampleSet};
use crate::geometry::{Part, Pose, RayScene, ScannerFrame, Table};

/// Names of the streams of random numbers.
const SECOND_SAMPLES: u64 = 0x7365_636f_6e64;
const EACH_VIEW: u64 = 0x76_6965_7773;
const WHOLE_PART: u64 = 0x7061_7274;
const HAND_EYE: u64 = 0x68_616e_6465_7965;

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
        let Some(sight) = self.sight.filter(|sight| !sight.has_no_obstacles()) else { return Ok(rows) };
        for ((row, pose), table_rad) in rows.iter_mut().zip(poses).zip(&self.table_rad) {
            let Some(table_rad) = *table_rad else { continue };
            if let Some(hidden) = sight.hidden(surface, pose, row.measured(), table_rad, ctx)? {
                *row = row.without(&hidden);
            }
        }
        Ok(rows)
    }
}

/// Evaluates the views of all setups together. `part` is the scene of the part alone; `standing` are the poses in which it is
/// planned, if there is a plate.
///
/// # Errors
/// [`PlanError::Cancelled`].
pub(super) fn certify(
    input: &PlanInput<'_>,
    params: &PlanParams,
    setups: &[SetupViews<'_>],
    part: &RayScene,
    standing: &[Pose<Table, Part>],
    ctx: &Context<'_>,
) -> Result<Certificate, PlanError> {
    let second = SecondSampling::new(input, params, setups, ctx)?;
    let independent = second.independent(part, standing, ctx)?;
    let robust = params.robust.pose_error.map(|error| second.robust(error, independent.of_asked(), ctx)).transpose()?;
    Ok(Certificate { independent, robust })
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
        ctx: &Context<'_>,
    ) -> Result<Self, PlanError> {
        let mut params = params.clone();
        params.selection.objective = Objective::Coverage;
        let seed = split_mix(params.seed ^ SECOND_SAMPLES);
        let surface = requirements::sampled(input.mesh, &params, seed, ctx)?;
        let asked_area_mm2 = surface.asked_area_mm2();
        let asked_mm2 = asked_area_mm2.iter().sum();
        Ok(Self { input, params, setups, surface, asked_area_mm2, asked_mm2 })
    }

    /// Coverage with the poses as planned.
    fn independent(&self, part: &RayScene, standing: &[Pose<Table, Part>], ctx: &Context<'_>) -> Result<Independent, Cancelled> {
        let poses: Vec<_> = self.views().map(|(_, view)| *view).collect();
        let mut rows = self.rows(&poses, &ctx.silent())?;
        for (row, view) in rows.iter_mut().zip(&poses) {
            *row = visibility::grade(&self.surface, view, self.input.scanner, &self.params, row);
        }
        let mut is_measured = SampleSet::none_of(self.asked_area_mm2.len());
        rows.iter().for_each(|row| is_measured.insert_all(row.measured()));
        let rows = self.counted(rows, &poses, &ctx.silent())?;
        let views = poses.iter().map(Pose::origin_mm).zip(&rows);
        let measured = measured_area(&self.surface, &self.asked_area_mm2, views);
        Ok(Independent {
            samples: self.asked_area_mm2.len(),
            asked_area_mm2: self.asked_mm2,
            total_area_mm2: self.surface.area_where(|_| true),
            visible_area_mm2: self.visible_mm2(&is_measured, part, standing, ctx)?,
            measured,
        })
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
        let rests = |sample| !standing.is_empty() && standing.iter().all(|pose| stands_on(&self.surface, sample, pose));
        let is_enclosed = |sample: SampleId| {
            let (point_mm, patch) = (&self.surface.sample_mm[sample.index()], self.surface.patch_of(sample));
            sky.sky(point_mm, &patch.normal) == Sky::Closed
        };
        let visible_mm2 = |place: usize| {
            let (sample, area_mm2) = (SampleId::at(place), self.asked_area_mm2[place]);
            if area_mm2 == 0.0 || is_measured.holds(sample) {
                return Ok(area_mm2);
            }
            ctx.check()?;
            Ok(if rests(sample) || is_enclosed(sample) { 0.0 } else { area_mm2 })
        };
        let of_samples = (0..self.asked_area_mm2.len()).into_par_iter().map(visible_mm2);
        Ok(of_samples.collect::<Result<Vec<f64>, Cancelled>>()?.iter().sum())
    }

    /// Views of all setups, each with the place of its setup.
    fn views(&self) -> impl Iterator<Item = (usize, &Pose<Part, ScannerFrame>)> {
        self.setups.iter().enumerate().flat_map(|(number, setup)| setup.views.iter().map(move |view| (number, view)))
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

    /// The rows of views at `poses` less what does not count, since it is at risk.
    fn counted(&self, rows: Vec<Row>, poses: &[Pose<Part, ScannerFrame>], ctx: &Context<'_>) -> Result<Vec<Row>, Cancelled> {
        if self.params.realism.count_at_risk {
            return Ok(rows);
        }
        let Self { input, surface, params, .. } = self;
        let input = RiskInput { mesh: input.mesh, surface, scanner: input.scanner, params };
        let view = |((setup, _), (row, pose)): ((usize, _), (_, &Pose<Part, ScannerFrame>))| RiskView {
            part_from_scanner: *pose,
            row,
            surfaces: self.setups[setup].occluders.rays(),
        };
        let views: Vec<RiskView<'_>> = self.views().zip(rows.iter().zip(poses)).map(view).collect();
        let left_out = realism::risks(&input, &views, ctx)?.samples();
        Ok(realism::without(rows, &left_out))
    }

    /// Asked area that the views measure from where `moved` puts those of a setup.
    fn measured_mm2(
        &self,
        mut moved: impl FnMut(usize, &Pose<Part, ScannerFrame>) -> Pose<Part, ScannerFrame>,
        ctx: &Context<'_>,
    ) -> Result<f64, Cancelled> {
        let poses: Vec<_> = self.views().map(|(setup, view)| moved(setup, view)).collect();
        let mut measured = SampleSet::none_of(self.asked_area_mm2.len());
        let rows = self.counted(self.rows(&poses, ctx)?, &poses, ctx)?;
        rows.iter().for_each(|row| measured.insert_all(row.measured()));
        Ok(measured.iter().map(|sample| self.asked_area_mm2[sample.index()]).sum())
    }

    fn robust(&self, error: PoseErrorParams, nominal: f64, ctx: &Context<'_>) -> Result<Robust, Cancelled> {
        let robust = &self.params.robust;
        let draws = robust.draws as usize;
        let (part_draws, hand_eye_draws) = (robust.part_draws as usize, robust.hand_eye_draws as usize);
        let all = draws + part_draws + hand_eye_draws;
        let stream = |kind: u64, draw: usize| Stream::new(self.params.seed, &[kind, draw as u64]);
        let mut views = Vec::with_capacity(draws);
        for draw in 0..draws {
            let mut stream = stream(EACH_VIEW, draw);
            views.push(self.of_asked(|_, view| *view * random_error(&error, &Point3::origin(), &mut stream), ctx)?);
            ctx.progress(draw + 1, all);
        }
        let mut part = Vec::with_capacity(part_draws);
        for draw in 0..part_draws {
            let mut stream = stream(WHOLE_PART, draw);
            let centre_mm = &self.surface.centre_mm;
            let errors: Vec<Pose<Part, Part>> =
                self.setups.iter().map(|_| random_error(&error, centre_mm, &mut stream)).collect();
            part.push(self.of_asked(|setup, view| errors[setup] * *view, ctx)?);
            ctx.progress(draws + draw + 1, all);
        }
        let mut hand_eye = Vec::with_capacity(hand_eye_draws);
        for draw in 0..hand_eye_draws {
            let error = random_error(&error, &Point3::origin(), &mut stream(HAND_EYE, draw));
            hand_eye.push(self.of_asked(|_, view| *view * error, ctx)?);
            ctx.progress(draws + part_draws + draw + 1, all);
        }
        let [views, part, hand_eye] = [views, part, hand_eye].map(|of_asked| Drawn::new(nominal, of_asked));
        Ok(Robust { pose_error: error, views, part, hand_eye })
    }

    fn of_asked(
        &self,
        moved: impl FnMut(usize, &Pose<Part, ScannerFrame>) -> Pose<Part, ScannerFrame>,
        ctx: &Context<'_>,
    ) -> Result<f64, Cancelled> {
        Ok(share(self.measured_mm2(moved, &ctx.silent())?, self.asked_mm2))
    }
}

/// Draws the pose of a frame that should be at the identity: turned about `centre_mm`, then moved.
fn random_error<Frame>(error: &PoseErrorParams, centre_mm: &Point3<f64>, stream: &mut Stream) -> Pose<Frame, Frame> {
    let turn = UnitQuaternion::from_axis_angle(&stream.direction(), error.angle_deg.to_radians());
    let shift_mm = stream.direction().into_inner() * error.translation_mm;
    Pose::from_parts(centre_mm.coords + shift_mm - turn * centre_mm.coords, turn)
}
