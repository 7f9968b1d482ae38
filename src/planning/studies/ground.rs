//! Candidates of one set of parameters with what each measures, from which views are chosen in many ways.

use super::steps::steps;
use super::{Series, StudyCase};
use crate::planning::context::{Context, PlanError};
use crate::planning::ids::RowIndex;
use crate::planning::params::{PlanParams, ScoreParams, SelectionParams, Solver, TargetOf};
use crate::planning::pipeline::{Tabulated, tabulate};
use crate::planning::plan::share;
use crate::planning::scene::PlanInput;
use crate::planning::selection::{self, CoverProblem, coverable_mm2};
use crate::planning::visibility::{self, Row};

/// Candidates of one set of parameters, with their visibility matrix.
pub(super) struct StudyBase {
    table: Tabulated,
}

impl StudyBase {
    /// Everything that comes before views are chosen. Quality is kept, whatever weight it has.
    ///
    /// # Errors
    /// The errors of [`crate::planning::plan()`].
    pub(super) fn new(input: &PlanInput<'_>, params: &PlanParams, ctx: &Context<'_>) -> Result<Self, PlanError> {
        let params = PlanParams { score: ScoreParams { a: 0.5, b: 0.5, ..params.score }, ..params.clone() };
        Ok(Self { table: tabulate(input, &params, ctx)? })
    }

    /// Greedy for everything that can be had, at most `max_views` views, by the score or by area as the case says.
    ///
    /// # Errors
    /// [`PlanError::Cancelled`].
    pub(super) fn series(
        &self,
        case: &StudyCase,
        input: &PlanInput<'_>,
        max_views: u32,
        ctx: &Context<'_>,
    ) -> Result<Series, PlanError> {
        let (table, total_mm2) = (&self.table, self.table.surface.area_where(|_| true));
        let params = SelectionParams {
            solver: Solver::Greedy,
            target: 1.0,
            target_of: TargetOf::Coverable,
            max_views: Some(max_views),
            ..case.params.selection.clone()
        };
        let cover = CoverProblem::new(table.rows.iter().collect(), &table.asked_area_mm2, total_mm2, &params);
        let chosen = selection::select(&cover, &params, &case.params.score, ctx)?;
        // Every candidate of the table may be chosen, so that a row is the place of its candidate too.
        let graded = |row: RowIndex| {
            let pose = &table.candidates.remaining[row.index()].part_from_scanner;
            visibility::grade(&table.surface, pose, input.scanner, &case.params, cover.row(row))
        };
        let graded: Vec<Row> = chosen.choices.iter().map(|choice| graded(choice.row)).collect();
        let coverable_mm2 = coverable_mm2(&cover.rows, cover.asked_area_mm2);
        Ok(Series {
            label: case.label.clone(),
            settings: case.settings.clone(),
            candidates: table.rows.len(),
            coverable_of_asked: share(coverable_mm2, cover.asked_mm2()),
            steps: steps(&graded, cover.asked_area_mm2, coverable_mm2, total_mm2),
            stopped_because: chosen.stopped_because,
        })
    }
}
