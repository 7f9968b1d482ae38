//! Coverage of the chosen views on samples that they were not chosen on: as planned, and with poses that are off.
//!
//! Views chosen on a set of samples fit that set: its share reads high, by up to half a point on machined parts. So it is
//! evaluated again on a second set, as dense, from another seed. A pose that is off is turned by the whole angle of
//! `robust.pose_error` about a random axis and moved by its whole distance in a random direction: each view by an error
//! of its own about the viewpoint, or the part as a whole about the centre of its box. Every draw has a stream of its own,
//! so that neither threads nor the number of draws change it. Cost: a view of the table for each chosen view and draw.

pub mod recheck;
#[cfg(test)]
mod tests;

use nalgebra::{Point3, UnitQuaternion};

use super::context::{Cancelled, Context, PlanError};
use super::ids::SetupId;
use super::params::{Objective, PlanParams, PoseErrorParams};
use super::plan::{Certificate, Drawn, Independent, PlannedView, Robust, share};
use super::random::{Stream, split_mix};
use super::scene::PlanInput;
use super::surface::{Surface, requirements};
use super::visibility::{self, Occluders, SampleSet};
use crate::geometry::{Part, Pose, ScannerFrame};

/// Names of the streams of random numbers.
const SECOND_SAMPLES: u64 = 0x7365_636f_6e64;
const EACH_VIEW: u64 = 0x76_6965_7773;
const WHOLE_PART: u64 = 0x7061_7274;

/// Views that are taken while the part lies in one way.
pub(super) struct SetupViews<'a> {
    pub(super) occluders: &'a Occluders,
    pub(super) views: Vec<Pose<Part, ScannerFrame>>,
}

impl<'a> SetupViews<'a> {
    /// The views of a setup that measure something.
    pub(super) fn of(occluders: &'a Occluders, views: &[PlannedView], setup: SetupId) -> Self {
        let measuring = views.iter().filter(|view| view.rejected.is_none() && view.setup == setup);
        Self { occluders, views: measuring.map(|view| view.part_from_scanner).collect() }
    }
}

/// Evaluates the views of all setups together.
///
/// # Errors
/// [`PlanError::Cancelled`].
pub(super) fn certify(
    input: &PlanInput<'_>,
    params: &PlanParams,
    setups: &[SetupViews<'_>],
    ctx: &Context<'_>,
) -> Result<Certificate, PlanError> {
    let second = SecondSampling::new(input, params, setups, ctx)?;
    let measured_area_mm2 = second.measured_mm2(|_, view| *view, &ctx.silent())?;
    let (samples, total_area_mm2) = (second.asked_area_mm2.len(), second.surface.area_where(|_| true));
    let independent = Independent { samples, asked_area_mm2: second.asked_mm2, total_area_mm2, measured_area_mm2 };
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

    /// Asked area that the views measure from where `moved` puts those of a setup.
    fn measured_mm2(
        &self,
        mut moved: impl FnMut(usize, &Pose<Part, ScannerFrame>) -> Pose<Part, ScannerFrame>,
        ctx: &Context<'_>,
    ) -> Result<f64, Cancelled> {
        let mut measured = SampleSet::none_of(self.asked_area_mm2.len());
        for (number, setup) in self.setups.iter().enumerate() {
            let views: Vec<_> = setup.views.iter().map(|view| moved(number, view)).collect();
            let (scanner, usable) = (self.input.scanner, vec![true; views.len()]);
            let table = visibility::cast(&self.surface, &views, &usable, scanner, setup.occluders, &self.params, ctx)?;
            table.rows.iter().for_each(|row| measured.insert_all(row.measured()));
        }
        Ok(measured.iter().map(|sample| self.asked_area_mm2[sample.index()]).sum())
    }

    fn robust(&self, error: PoseErrorParams, nominal: f64, ctx: &Context<'_>) -> Result<Robust, Cancelled> {
        let (draws, part_draws) = (self.params.robust.draws as usize, self.params.robust.part_draws as usize);
        let stream = |kind: u64, draw: usize| Stream::new(self.params.seed, &[kind, draw as u64]);
        let mut views = Vec::with_capacity(draws);
        for draw in 0..draws {
            let mut stream = stream(EACH_VIEW, draw);
            views.push(self.of_asked(|_, view| *view * random_error(&error, &Point3::origin(), &mut stream), ctx)?);
            ctx.progress(draw + 1, draws + part_draws);
        }
        let mut part = Vec::with_capacity(part_draws);
        for draw in 0..part_draws {
            let mut stream = stream(WHOLE_PART, draw);
            let centre_mm = &self.surface.centre_mm;
            let errors: Vec<Pose<Part, Part>> =
                self.setups.iter().map(|_| random_error(&error, centre_mm, &mut stream)).collect();
            part.push(self.of_asked(|setup, view| errors[setup] * *view, ctx)?);
            ctx.progress(draws + draw + 1, draws + part_draws);
        }
        Ok(Robust { pose_error: error, views: Drawn::new(nominal, views), part: Drawn::new(nominal, part) })
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
