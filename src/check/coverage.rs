//! Coverage derived anew beside the coverage that a plan states: from the scans of a program, or from the viewpoints of the plan
//! itself. It is derived by the engine that the plan was made with, so that a sound plan agrees exactly, and by the reference, a
//! ray for every sample. One of them has to agree; where the other one does not, both figures are told.

use super::place::CheckPlace;
use super::{Reference, setup_count, table_from_part, views_in, whole};
use crate::cell::{Cell, Configuration, FieldError, Findings};
use crate::geometry::{Part, Pose, Table};
use crate::planning::PlanInput;
use crate::planning::certificate::recheck::{TakenView, recheck_by};
use crate::planning::context::{Context, PlanError};
use crate::planning::params::{Engine, PlanParams};
use crate::planning::selection::coverable_mm2;
use crate::planning::visibility::Row;
use crate::program::{self, Expected, Program};
use crate::wire::UnverifiedStatement;
use crate::wire::plan::{PlanDocument, ViewpointDocument};

/// Tolerance of the asked area, as a share of it: it went through a file.
const AREA_TOLERANCE: f64 = 1e-6;
/// Reason for which a plan on other samples than are taken now is not compared.
const OTHER_SAMPLES: &str =
    "the plan was made on other samples than its parameters give, by another release or with others: plan again";

/// Reason for which a plan of further views is not compared.
const OF_OPEN: &str = "the plan asks for what earlier scans left open alone";

/// Coverage of a plan, derived anew.
pub(super) enum PlanCoverage {
    /// Agreement with what the plan states.
    AsStated {
        /// Share of the asked area that its views measure.
        of_asked: f64,
        /// True if that is on the samples that the plan has.
        is_on_same_samples: bool,
        /// Statement on the engine that gives another share, if one does.
        other_engine: Option<UnverifiedStatement>,
    },
    /// Coverage that was not compared, with the reason or with what to give.
    Unchecked(String),
}

/// Coverage of a program, derived anew.
pub(super) enum ProgramCoverage {
    /// Comparison with what the plan states for the setup.
    Compared {
        /// Share of the asked area that its scans measure.
        measured: f64,
        /// Share that the plan states.
        planned: f64,
        /// Statement on the engine that gives another share, if one does.
        other_engine: Option<UnverifiedStatement>,
    },
    /// Coverage that was not compared, with the reason or with what to give.
    Unchecked(&'static str),
}

/// Views that are taken while the part lies in one way.
struct PlacedViews {
    table_from_part: Pose<Table, Part>,
    views: Vec<TakenView>,
}

/// Share of the asked area that views measure, derived anew.
struct Measured {
    /// Engine that the plan was made with.
    engine: Engine,
    /// Share by that engine.
    of_asked: f64,
    /// Share by a ray for every sample.
    of_asked_by_rays: f64,
    asked_mm2: f64,
    /// Number of samples that it was derived on.
    samples: usize,
}

impl Measured {
    /// Returns true if it differs from the share that a plan states for its own samples, by either engine.
    fn is_off(&self, planned: f64) -> bool {
        [self.of_asked, self.of_asked_by_rays].iter().all(|share| program::off_coverage(*share, planned).is_some())
    }

    /// The share by the engine that agrees with the share that a plan states, and the statement on the other engine if that one
    /// does not; by the plan's own engine where neither agrees.
    fn beside(&self, planned: f64) -> (f64, Option<UnverifiedStatement>) {
        let (own, rays, name) = (self.of_asked, self.of_asked_by_rays, engine_name(self.engine));
        let agrees = |share: f64| program::off_coverage(share, planned).is_none();
        match (agrees(own), agrees(rays)) {
            (true, true) | (false, false) => (own, None),
            (true, false) => {
                let reason = format!(
                    "is {rays:.5}; by the engine of the plan, {name}, it is {own:.5}, as planned: that engine passes over \
                     what lies less than 0.003 mm before a facet; to count it, plan with visibility.engine \"rays\""
                );
                (own, Some(UnverifiedStatement { statement: "coverage by a ray for every sample".to_owned(), reason }))
            }
            (false, true) => {
                let reason = format!(
                    "is {own:.5}, by {name}; by a ray for every sample it is {rays:.5}, as planned: another release made the \
                     plan, or its params.visibility.engine was changed"
                );
                (rays, Some(UnverifiedStatement { statement: "coverage by the engine of the plan".to_owned(), reason }))
            }
        }
    }

    /// Returns true if the plan was made on other samples, as earlier releases took them for small regions: two sound shares may
    /// then differ.
    fn is_on_other_samples(&self, plan: &PlanDocument) -> bool {
        plan.chosen_on.is_none_or(|chosen_on| chosen_on.of_samples != self.samples)
    }
}

/// Share of the asked area that the views of some setups measure together.
///
/// Setups are evaluated one by one, which loses nothing where area at risk is not counted: a sample in the margins of images is
/// left out of a setup unless one of its views measures it outside of them, and so out of all setups unless a view of any does;
/// one beside a concave edge is left out of each.
fn measured_together(
    input: &PlanInput<'_>,
    params: &PlanParams,
    setups: &[PlacedViews],
    ctx: &Context<'_>,
) -> Result<Measured, PlanError> {
    let engine = params.visibility.engine;
    let (measured_mm2, asked_area_mm2) = measured_by(engine, input, params, setups, ctx)?;
    let by_rays_mm2 = match engine {
        Engine::Rays => measured_mm2,
        Engine::Raster => measured_by(Engine::Rays, input, params, setups, ctx)?.0,
    };
    let asked_mm2 = asked_area_mm2.iter().sum::<f64>();
    let (of_asked, of_asked_by_rays) = (measured_mm2 / asked_mm2, by_rays_mm2 / asked_mm2);
    Ok(Measured { engine, of_asked, of_asked_by_rays, asked_mm2, samples: asked_area_mm2.len() })
}

/// Area that the views of some setups measure together by an engine, mm², and the asked area of each sample.
fn measured_by(
    engine: Engine,
    input: &PlanInput<'_>,
    params: &PlanParams,
    setups: &[PlacedViews],
    ctx: &Context<'_>,
) -> Result<(f64, Vec<f64>), PlanError> {
    let (mut rows, mut asked_area_mm2) = (Vec::new(), Vec::new());
    for PlacedViews { table_from_part, views } in setups {
        let of_setup = recheck_by(engine, input, params, table_from_part, views, ctx)?;
        rows.extend(of_setup.rows);
        // The samples are the same in every setup.
        asked_area_mm2 = of_setup.asked_area_mm2;
    }
    let rows: Vec<&Row> = rows.iter().collect();
    Ok((coverable_mm2(&rows, &asked_area_mm2), asked_area_mm2))
}

/// Statement on the engine that gives another share, in words that follow the share; nothing where both agree.
pub(super) fn beside_share(other_engine: Option<&UnverifiedStatement>) -> String {
    other_engine.map_or_else(String::new, |other| format!(" ({} {})", other.statement, other.reason))
}

/// Name of an engine, as `params.visibility.engine` has it.
fn engine_name(engine: Engine) -> &'static str {
    match engine {
        Engine::Raster => "raster",
        Engine::Rays => "rays",
    }
}

/// A viewpoint of a plan as the plan says it is taken.
fn taken(view: &ViewpointDocument) -> TakenView {
    let table_rad = view.station.as_ref().map(|station| station.table_angle_deg.to_radians());
    TakenView { part_from_scanner: view.part_from_scanner.pose(), table_rad }
}

impl Reference {
    /// Input of a plan, to evaluate views anew; `None` without the part or the scanner.
    fn input<'a>(&'a self, plan: &'a PlanDocument, place: CheckPlace<'a>) -> Option<PlanInput<'a>> {
        Some(PlanInput {
            mesh: self.part.as_ref()?,
            fixture: self.fixture.as_ref(),
            part_sha256: &plan.part.sha256,
            scanner: place.scanner()?,
            // A plan without a cell knows neither its plate nor its obstacles.
            cell: place.cell().filter(|_| plan.cell.is_some()),
            roadmaps: None,
        })
    }

    /// Derives the share of the asked area anew that a program's scans measure, and that the plan states for its setup.
    ///
    /// # Errors
    /// The reason for which the scans cannot be evaluated.
    pub(super) fn program_coverage(
        &self,
        program: &Program,
        cell: &Cell,
        expected: Option<&Expected>,
        ctx: &Context<'_>,
    ) -> Result<ProgramCoverage, Vec<FieldError>> {
        let unchecked = |reason: &'static str| Ok(ProgramCoverage::Unchecked(reason));
        let (Some((plan, _)), Some(expected)) = (&self.plan, expected) else { return unchecked("give the plan and the part") };
        let Some(input) = self.input(plan, CheckPlace::Cell(cell)) else { return unchecked("give the part") };
        // Views of other setups than the program's clear samples of risks; what they measure is not to be had here.
        if !plan.params.realism.count_at_risk && plan.setups.len() > 1 {
            return unchecked("the area at risk that the plan leaves out depends on all setups together");
        }
        // Parameters do not say what earlier scans left open.
        if plan.coverage.of_open {
            return unchecked(OF_OPEN);
        }
        let poses = program::scan_poses(program, cell, &expected.table_from_part).into_iter();
        let scans = poses.zip(program::scan_configurations(program));
        let view =
            |(part_from_scanner, here): (_, Configuration)| TakenView { part_from_scanner, table_rad: Some(here.table_rad) };
        let setup = PlacedViews { table_from_part: expected.table_from_part, views: scans.map(view).collect() };
        let measured = measured_together(&input, &plan.params, &[setup], ctx).map_err(|error| whole(error.to_string()))?;
        let here = plan.setups.get(program.setup).map_or(plan.coverage.measured_area_mm2, |setup| setup.measured_area_mm2);
        let planned = here / plan.coverage.asked_area_mm2;
        if measured.is_off(planned) && measured.is_on_other_samples(plan) {
            return unchecked(OTHER_SAMPLES);
        }
        let (measured, other_engine) = measured.beside(planned);
        Ok(ProgramCoverage::Compared { measured, planned, other_engine })
    }

    /// Derives the coverage of a plan anew, that of all its setups together, on the samples that the plan states it for.
    ///
    /// # Errors
    /// The findings that its viewpoints measure something else than it states, or that something else is asked, or why they
    /// cannot be evaluated.
    pub(super) fn coverage(
        &self,
        plan: &PlanDocument,
        place: CheckPlace<'_>,
        ctx: &Context<'_>,
    ) -> Result<PlanCoverage, Vec<FieldError>> {
        let unchecked = |reason: &str| Ok(PlanCoverage::Unchecked(reason.to_owned()));
        if self.part.is_none() {
            return unchecked("give the part");
        }
        let Some(input) = self.input(plan, place) else { return unchecked("give the scanner that it was planned with") };
        if self.lacks_fixture(plan) {
            return unchecked("give the fixture that it was planned with");
        }
        // Parameters do not say what earlier scans left open.
        if plan.coverage.of_open {
            return unchecked(OF_OPEN);
        }
        let views = |setup: usize| views_in(plan, setup).map(|(_, view)| view).filter(|view| view.rejected.is_none()).map(taken);
        let placed = |setup: usize| PlacedViews {
            table_from_part: table_from_part(plan, setup).unwrap_or_else(Pose::identity),
            views: views(setup).collect(),
        };
        let setups: Vec<PlacedViews> = (0..setup_count(plan)).map(placed).collect();
        let measured = measured_together(&input, &plan.params, &setups, ctx).map_err(|error| whole(error.to_string()))?;
        let is_on_same_samples = !measured.is_on_other_samples(plan);
        if !is_on_same_samples && measured.is_off(plan.coverage.of_asked) {
            return unchecked(OTHER_SAMPLES);
        }
        let mut findings = Findings::default();
        let (asked_mm2, planned) = (plan.coverage.asked_area_mm2, plan.coverage.of_asked);
        let is_as_asked = (measured.asked_mm2 - asked_mm2).abs() <= AREA_TOLERANCE * asked_mm2;
        findings.require(is_as_asked || !is_on_same_samples, "/coverage/asked_area_mm2", || {
            format!("is {asked_mm2} mm²; by params.part and params.regions it is {} mm²: plan again", measured.asked_mm2)
        });
        findings.require(!measured.is_off(planned), "/coverage/of_asked", || {
            let (own, rays) = (measured.of_asked, measured.of_asked_by_rays);
            let both = program::off_coverage(own, rays).map(|_| format!(", by a ray for every sample {rays:.5}"));
            format!("is {planned:.5}; by its viewpoints it is {own:.5}{}: plan again", both.unwrap_or_default())
        });
        findings.into_result()?;
        let (of_asked, other_engine) = measured.beside(planned);
        Ok(PlanCoverage::AsStated { of_asked, is_on_same_samples, other_engine })
    }

    /// Returns true if the plan was made with a fixture, and none is given.
    pub(super) fn lacks_fixture(&self, plan: &PlanDocument) -> bool {
        self.fixture.is_none() && plan.has_fixture()
    }
}
