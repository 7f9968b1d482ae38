//! The view planning problem: a part in its setups, candidates that the cell can or cannot take, what each of them measures;
//! and the choice of views that solves it.
//!
//! Candidates are numbered by their place among those kept, the setups' one after another.

mod evaluated;
mod robust_rows;
mod rounds;
mod sampled_part;

use std::borrow::Cow;
use std::collections::BTreeSet;

pub(super) use sampled_part::{EvaluatedSetups, SampledPart};

use super::candidates::{Candidate, CandidateSet};
use super::context::{Context, PlanError};
use super::params::{PlanParams, TargetOf};
use super::scene::{PlanInput, Reach};
use super::selection::{self, CoverProblem, Goal, Selection, ViewId, coverable};
use super::sequence::straight_secs;
use super::stations::{Station, StationFailure};
use super::surface::{Surface, requirements};
use super::visibility::{Row, VisibilityMatrix};
use crate::geometry::{Part, Pose, Table};

/// The view planning problem: part, setups, candidates, visibility matrix and reach.
pub(in crate::planning) struct ViewPlanningProblem<'a> {
    pub(in crate::planning) input: &'a PlanInput<'a>,
    pub(in crate::planning) params: &'a PlanParams,
    pub(in crate::planning) surface: Surface,
    /// Pose of the part in each setup.
    pub(in crate::planning) setups: Vec<Pose<Table, Part>>,
    pub(in crate::planning) candidates: CandidateSet,
    /// Row of each kept candidate.
    pub(in crate::planning) matrix: VisibilityMatrix,
    /// Rows by which views are chosen, where that is not the matrix: the samples measured under every stated error.
    pub(in crate::planning) robust_rows: Option<Vec<Row>>,
    /// Stations of each kept candidate; `None` without a cell.
    pub(in crate::planning) reach: Option<Reach>,
    /// Area of each sample, 0 where it is not asked for.
    pub(in crate::planning) asked_area_mm2: Vec<f64>,
}

/// A selection over the kept candidates.
pub(in crate::planning) struct ChosenViews {
    /// Index of each chosen candidate among the kept ones, in the order chosen.
    pub(in crate::planning) kept: Vec<usize>,
    pub(in crate::planning) selection: Selection,
}

impl ViewPlanningProblem<'_> {
    /// Failure for which the cell cannot use a kept candidate, if so.
    pub(in crate::planning) fn blocked(&self, kept: usize) -> Option<StationFailure> {
        self.reach.as_ref().and_then(|reach| reach[kept].as_ref().err().copied())
    }

    pub(in crate::planning) fn cover_problem(&self, kept: &[usize]) -> CoverProblem<'_> {
        let scan = &self.params.scan;
        let total_mm2 = self.surface.area_where(|_| true);
        let mut cover = CoverProblem::new(self.rows_to_choose_by(kept), &self.asked_area_mm2, total_mm2, &self.params.selection);
        cover.view_secs = scan.settle_secs + scan.capture_secs;
        let requirements = &self.surface.requirements;
        if requirements.kinds.len() > 1 {
            let weighted = |(sample, area_mm2): (usize, &f64)| area_mm2 * requirements.of(sample).weight;
            cover.weighted_area_mm2 = Cow::Owned(self.asked_area_mm2.iter().enumerate().map(weighted).collect());
            cover.goals.extend(self.goals_of_regions(kept));
        }
        cover
    }

    /// Targets of the regions that have their own: a share of their area, counted as the plan's own target counts.
    fn goals_of_regions(&self, kept: &[usize]) -> Vec<Goal<'static>> {
        let requirements = &self.surface.requirements;
        let coverable = coverable(&self.rows_to_choose_by(kept), self.asked_area_mm2.len());
        let of_coverable = self.params.selection.target_of == TargetOf::Coverable;
        let counts = |sample: usize| !of_coverable || coverable.holds(sample as u32);
        let goal = |(number, region): (usize, requirements::NamedRegion)| {
            let holds = |sample: usize| requirements.of(sample).regions.contains(&number);
            let area = |sample: usize| if holds(sample) { self.asked_area_mm2[sample] } else { 0.0 };
            let area_mm2: Vec<f64> = (0..self.asked_area_mm2.len()).map(area).collect();
            let whole_mm2: f64 = (0..area_mm2.len()).filter(|sample| counts(*sample)).map(|sample| area_mm2[sample]).sum();
            Some(Goal { needed_mm2: region.target? * whole_mm2, area_mm2: Cow::Owned(area_mm2) })
        };
        requirements::regions(self.params).into_iter().enumerate().filter_map(goal).filter(|goal| goal.needed_mm2 > 0.0).collect()
    }

    /// Rows by which views are chosen: as planned, or also with poses that are off.
    fn rows_to_choose_by(&self, kept: &[usize]) -> Vec<&Row> {
        let rows = self.robust_rows.as_ref().unwrap_or(&self.matrix.rows);
        kept.iter().map(|kept| &rows[*kept]).collect()
    }

    pub(in crate::planning) fn rows(&self, kept: &[usize]) -> Vec<&Row> {
        kept.iter().map(|kept| &self.matrix.rows[*kept]).collect()
    }

    /// Kept candidates that the cell can use.
    pub(in crate::planning) fn usable(&self) -> Vec<usize> {
        (0..self.candidates.kept.len()).filter(|kept| self.blocked(*kept).is_none()).collect()
    }

    /// Kept candidates that the cell can use and that are not `excluded`, ascending.
    pub(in crate::planning) fn choosable(&self, excluded: &BTreeSet<usize>) -> Vec<usize> {
        self.usable().into_iter().filter(|kept| !excluded.contains(kept)).collect()
    }

    /// The selection of `rows` of a cover problem over `usable`, as many as `chosen` has.
    pub(in crate::planning) fn chosen_of(
        &self,
        cover: &CoverProblem<'_>,
        usable: &[usize],
        rows: &[usize],
        chosen: &ChosenViews,
        ctx: &Context<'_>,
    ) -> Result<ChosenViews, PlanError> {
        let selection = selection::of_rows(cover, &self.params.selection, &self.params.score, rows, &chosen.selection, ctx)?;
        Ok(ChosenViews { kept: selection.choices.iter().map(|choice| usable[choice.row]).collect(), selection })
    }

    /// Chooses among the usable candidates that are not `excluded`. A target of the coverable area is here a share of what
    /// those measure; the outcome says then whether it was met.
    pub(in crate::planning) fn select(&self, excluded: &BTreeSet<usize>, ctx: &Context<'_>) -> Result<ChosenViews, PlanError> {
        let usable = self.choosable(excluded);
        let travel_secs = |from: usize, to: usize| self.travel_secs(usable[from], usable[to]);
        let mut cover = self.cover_problem(&usable);
        cover.travel_secs = self.reach.is_some().then_some(&travel_secs);
        let selection = selection::select(&cover, &self.params.selection, &self.params.score, ctx)?;
        Ok(ChosenViews { kept: selection.choices.iter().map(|choice| usable[choice.row]).collect(), selection })
    }

    /// Time of the quickest straight move between stations of two kept candidates: what travel costs at least.
    fn travel_secs(&self, from: usize, to: usize) -> f64 {
        let (Some(cell), Some(reach)) = (self.input.cell, &self.reach) else { return 0.0 };
        let stations = |kept: usize| reach[kept].as_deref().unwrap_or_default();
        let axes = cell.axes();
        let pairs = stations(from).iter().flat_map(|a| stations(to).iter().map(move |b| (a.configuration(), b.configuration())));
        pairs.map(|(a, b)| straight_secs(&axes, &a, &b, &self.params.motion)).fold(f64::INFINITY, f64::min)
    }

    /// Chosen views of a setup with their stations, for ordering.
    pub(in crate::planning) fn stations_of(&self, chosen: &ChosenViews, setup: usize) -> Vec<(ViewId, &[Station])> {
        let stations = |kept: usize| match &self.reach {
            Some(reach) => reach[kept].as_deref().unwrap_or_default(),
            None => &[],
        };
        let of_setup = |(_, kept): &(usize, &usize)| self.candidates.kept[**kept].setup == setup;
        chosen.kept.iter().enumerate().filter(of_setup).map(|(view, kept)| (ViewId(view as u32), stations(*kept))).collect()
    }

    /// The kept candidates behind `views`.
    pub(in crate::planning) fn candidates_behind(&self, chosen: &ChosenViews, views: &[ViewId]) -> Vec<usize> {
        views.iter().map(|view| chosen.kept[view.0 as usize]).collect()
    }

    /// Kept candidates that are reached but for collisions, with no stations, and those of `all_excluded`, with theirs.
    pub(in crate::planning) fn obstructed(&self, all_excluded: &BTreeSet<usize>) -> Vec<(&Candidate, &[Station])> {
        let stations = |kept: usize| match &self.reach.as_ref()?[kept] {
            Ok(stations) => all_excluded.contains(&kept).then_some(stations.as_slice()),
            Err(blocked) => (*blocked == StationFailure::Collision).then_some(&[][..]),
        };
        (0..self.candidates.kept.len()).filter_map(|kept| Some((&self.candidates.kept[kept], stations(kept)?))).collect()
    }
}
