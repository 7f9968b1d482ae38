//! Candidates of one set of parameters with what each measures, from which views are chosen in many ways.

use super::steps::steps;
use super::{Case, Series};
use crate::planning::context::{Context, Stage};
use crate::planning::error::PlanError;
use crate::planning::candidates::Scope;
use crate::planning::input::PlanInput;
use crate::planning::motion::Motion;
use crate::planning::params::{PlanParams, ScoreParams, SelectionParams, Solver, TargetOf};
use crate::planning::pipeline::resolve;
use crate::planning::placement;
use crate::planning::plan::share;
use crate::planning::rounds::{Considered, Rounds, is_usable};
use crate::planning::selection::{self, Problem};
use crate::planning::study::asked_area_mm2;
use crate::planning::surface::{self, Surface};
use crate::planning::visibility::{self, Row};

/// See the module.
pub(super) struct Ground {
    surface: Surface,
    asked_area_mm2: Vec<f64>,
    considered: Considered,
    /// Kept candidates that may be chosen.
    usable: Vec<usize>,
}

impl Ground {
    /// Everything that comes before views are chosen. Quality is kept, whatever weight it has.
    ///
    /// # Errors
    /// Those of [`crate::planning::plan()`].
    pub(super) fn new(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Self, PlanError> {
        let mut params = resolve(params, input);
        params.score = ScoreParams { a: 0.5, b: 0.5, ..params.score };
        ctx.begin(Stage::Surface)?;
        let surface =
            surface::sample(input.mesh, &params.part, &params.regions, params.seed).map_err(PlanError::BadParams)?;
        let asked_area_mm2 = asked_area_mm2(&surface)?;
        let table_from_part = params.part.table_from_part.unwrap_or_default().pose();
        let plate = input.cell.map(|cell| placement::plate(cell, &table_from_part));
        let occluders = visibility::Occluders::new([input.mesh].into_iter().chain(input.fixture).chain(&plate));
        input.cell.map_or(Ok(()), |cell| placement::check(cell, input, &table_from_part))?;
        let motion = input.cell.map(|cell| Motion::new(cell, input, &params, table_from_part)).transpose()?;
        let (part, scanner, cell, seed) = (input.mesh, input.scanner, input.cell, params.seed);
        let scope = Scope { part, surface: &surface, scanner, cell, table_from_part, seed };
        let motion = motion.as_ref();
        let rounds = Rounds { scope, params: &params, occluders: &occluders, motion, asked_area_mm2: &asked_area_mm2 };
        let considered = rounds.run(ctx)?;
        let all = 0..considered.generated.kept.len();
        let usable = all.filter(|kept| is_usable(considered.reach.as_ref(), *kept)).collect();
        Ok(Self { surface, asked_area_mm2, considered, usable })
    }

    /// Greedy for everything that can be had, at most `most_views` views, by the score or by area as the case says.
    ///
    /// # Errors
    /// [`PlanError::Cancelled`].
    pub(super) fn series(
        &self,
        case: &Case,
        input: &PlanInput<'_>,
        most_views: u32,
        ctx: &Context<'_>,
    ) -> Result<Series, PlanError> {
        ctx.begin(Stage::Selection)?;
        let rows = self.usable.iter().map(|kept| &self.considered.table.rows[*kept]).collect();
        let total_mm2 = self.surface.area_where(|_| true);
        let problem = Problem { rows, asked_area_mm2: &self.asked_area_mm2, total_mm2 };
        let params = SelectionParams {
            solver: Solver::Greedy,
            target: 1.0,
            target_of: TargetOf::Coverable,
            max_views: Some(most_views),
            ..case.params.selection.clone()
        };
        let chosen = selection::select(&problem, &params, &case.params.score, ctx)?;
        let case_params = resolve(&case.params, input);
        let graded: Vec<Row> = chosen
            .choices
            .iter()
            .map(|choice| {
                let pose = &self.considered.generated.kept[self.usable[choice.row]].part_from_scanner;
                visibility::grade(&self.surface, pose, input.scanner, &case_params, problem.rows[choice.row])
            })
            .collect();
        let coverable_mm2 = problem.coverable_mm2();
        Ok(Series {
            label: case.label.clone(),
            settings: case.settings.clone(),
            candidates: self.usable.len(),
            coverable_of_asked: share(coverable_mm2, problem.asked_mm2()),
            steps: steps(&graded, &self.asked_area_mm2, coverable_mm2, total_mm2),
            stopped_because: chosen.stopped_because,
        })
    }
}
