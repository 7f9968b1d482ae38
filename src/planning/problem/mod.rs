//! The view planning problem: a part in its setups, candidates that the cell can or cannot take, what each of them measures;
//! and the choice of views that solves it.
//!
//! Candidates have their places in [`ViewPlanningProblem::candidates`], the setups' one after another.

pub(super) mod estimate;
mod evaluated;
mod every_sample;
mod expected;
mod robust_rows;
mod rounds;
mod sampled_part;

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::mem;
use std::sync::Arc;

pub(super) use evaluated::EvaluatedCandidates;
pub(super) use expected::ExpectedViews;
pub(super) use sampled_part::{EvaluatedSetups, SampledPart, SamplesToChooseOn, TriedSetup};

use super::candidates::{Candidate, CandidateSet};
use super::context::{Cancelled, Context, PlanError};
use super::ids::{CandidateIndex, RowIndex, SampleId, SetupIndex, ViewId};
use super::params::{PlanParams, TargetOf};
use super::plan::ChosenOn;
use super::scene::{PlanInput, PlanningScene, Reach};
use super::selection::{self, CoverProblem, FirstChoice, Goal, OpenSelection, coverable};
use super::sequence::straight_secs;
use super::setups::Setup;
use super::stations::{Station, StationFailure};
use super::surface::thinned::Strata;
use super::surface::{Surface, requirements};
use super::visibility::{Row, SampleSet, VisibilityMatrix};
use crate::cell::Configuration;
use crate::geometry::{Part, Pose, Table};

/// The view planning problem: part, setups, candidates, visibility matrix and reach.
#[derive(Clone)]
pub(in crate::planning) struct ViewPlanningProblem<'a> {
    pub(in crate::planning) input: &'a PlanInput<'a>,
    pub(in crate::planning) params: &'a PlanParams,
    /// Samples that views are chosen on; after that every sample.
    pub(in crate::planning) surface: Arc<Surface>,
    /// Pose of the part in each setup that is planned in.
    pub(in crate::planning) setups: Vec<Pose<Table, Part>>,
    pub(in crate::planning) candidates: CandidateSet,
    /// Row of each candidate.
    pub(in crate::planning) matrix: VisibilityMatrix,
    /// Rows by which views are chosen, where that is not the matrix: the samples measured under every stated error.
    pub(in crate::planning) robust_rows: Option<Vec<Row>>,
    /// Stations of each candidate; `None` without a cell.
    pub(in crate::planning) reach: Option<Reach>,
    /// Samples that obstacles of the cell hide at every station of some candidate that would measure them.
    pub(in crate::planning) hidden_by_cell: SampleSet,
    /// Area of each sample, 0 where it is not asked for.
    pub(in crate::planning) asked_area_mm2: Vec<f64>,
    /// Rows that are known on some samples alone, once the samples are all that there are.
    pub(in crate::planning) partly_known: PartlyKnown,
    /// Strata of the samples, while views are chosen on some of them.
    pub(in crate::planning) strata: Option<Strata>,
    /// Asked area that the candidates of each setup measure, where rows of some of them are not whole.
    pub(in crate::planning) coverable_of_setup_mm2: Option<Vec<f64>>,
    /// Samples that views are chosen on.
    pub(in crate::planning) chosen_on: ChosenOn,
}

/// Extent to which rows of candidates are known.
#[derive(Clone, Default)]
pub(in crate::planning) struct PartlyKnown {
    /// Candidates whose rows are whole: chosen views.
    whole: BTreeSet<CandidateIndex>,
    /// Samples that none of these measures: on these the other rows are known.
    open: SampleSet,
}

/// Numbers of candidates before others join them.
#[derive(Clone, Copy)]
pub(in crate::planning) struct KnownCandidates {
    remaining: usize,
    rejected: usize,
    generated: usize,
}

/// A selection among the candidates.
pub(in crate::planning) struct ChosenViews {
    /// Candidate of each view.
    pub(in crate::planning) candidates: Vec<CandidateIndex>,
    pub(in crate::planning) selection: OpenSelection,
}

impl ChosenViews {
    /// A selection whose rows are those of `choosable`.
    fn of(selection: OpenSelection, choosable: &[CandidateIndex]) -> Self {
        Self { candidates: selection.choices.iter().map(|choice| choosable[choice.row.index()]).collect(), selection }
    }

    /// The candidate that a view is.
    pub(in crate::planning) fn candidate(&self, view: ViewId) -> CandidateIndex {
        self.candidates[view.index()]
    }

    /// The candidates that views are.
    pub(in crate::planning) fn candidates_of(&self, views: &[ViewId]) -> impl Iterator<Item = CandidateIndex> {
        views.iter().map(|view| self.candidate(*view))
    }

    /// Views with their candidates, in the order chosen.
    pub(in crate::planning) fn views(&self) -> impl Iterator<Item = (ViewId, CandidateIndex)> {
        ViewId::number(self.candidates.iter().copied())
    }
}

impl ViewPlanningProblem<'_> {
    /// Samples that a candidate measures.
    pub(in crate::planning) fn row(&self, candidate: CandidateIndex) -> &Row {
        &self.matrix.rows[candidate.index()]
    }

    /// Returns true if obstacles of the cell hide nothing that a candidate measures from a station.
    pub(in crate::planning) fn is_in_sight(
        &self,
        scene: &PlanningScene<'_>,
        candidate: CandidateIndex,
        station: &Configuration,
        ctx: &Context<'_>,
    ) -> bool {
        let pose = &self.candidates[candidate].part_from_scanner;
        scene.is_in_sight(&self.surface, pose, self.row(candidate), station.table_rad, ctx)
    }

    /// Counts the candidates.
    pub(in crate::planning) fn known(&self) -> KnownCandidates {
        let CandidateSet { remaining, generated, rejected } = &self.candidates;
        KnownCandidates { remaining: remaining.len(), rejected: rejected.len(), generated: *generated }
    }

    /// The one of the `known` candidates that a candidate is, or that was slid to it.
    pub(in crate::planning) fn original_of(&self, candidate: CandidateIndex, known: KnownCandidates) -> Option<CandidateIndex> {
        first_known(candidate, |candidate| self.candidates[*candidate].slid_from, known.remaining)
    }

    /// Takes out the candidates that joined the `known` ones.
    pub(in crate::planning) fn forget_from(&mut self, known: KnownCandidates) {
        self.candidates.generated = known.generated;
        self.candidates.rejected.truncate(known.rejected);
        self.candidates.remaining.truncate(known.remaining);
        self.matrix.rows.truncate(known.remaining);
        if let Some(reach) = &mut self.reach {
            reach.truncate(known.remaining);
        }
    }

    /// Adds candidates of a setup.
    fn join(&mut self, setup: SetupIndex, more: EvaluatedCandidates) {
        let mut all = EvaluatedCandidates {
            candidates: mem::take(&mut self.candidates),
            matrix: mem::take(&mut self.matrix),
            reach: self.reach.take(),
            hidden_by_cell: mem::take(&mut self.hidden_by_cell),
        };
        all.append(more.in_setup(setup));
        EvaluatedCandidates {
            candidates: self.candidates,
            matrix: self.matrix,
            reach: self.reach,
            hidden_by_cell: self.hidden_by_cell,
        } = all;
    }

    /// Failure for which the cell cannot use a candidate, if so.
    pub(in crate::planning) fn blocked(&self, candidate: CandidateIndex) -> Option<StationFailure> {
        self.reach.as_ref().and_then(|reach| reach[candidate.index()].as_ref().err().copied())
    }

    /// The problem of choosing among `choosable`: a [`RowIndex`] of it is a place there.
    pub(in crate::planning) fn cover_problem(&self, choosable: &[CandidateIndex]) -> CoverProblem<'_> {
        let scan = &self.params.scan;
        let total_mm2 = self.surface.area_where(|_| true);
        let mut cover =
            CoverProblem::new(self.rows_to_choose_by(choosable), &self.asked_area_mm2, total_mm2, &self.params.selection);
        cover.view_secs = scan.settle_secs + scan.capture_secs;
        let requirements = &self.surface.requirements;
        if requirements.kinds.len() > 1 {
            let weighted = |(sample, area_mm2): (SampleId, &f64)| area_mm2 * requirements.of(sample).weight;
            cover.weighted_area_mm2 = Cow::Owned(SampleId::number(&self.asked_area_mm2).map(weighted).collect());
            cover.goals.extend(self.goals_of_regions(choosable));
        }
        cover
    }

    /// Targets of the regions that have their own, each as far as `choosable` can meet it ([`needed_mm2`]). Regions of which
    /// nothing counts have no goal here: the outcome tells whether they were met.
    fn goals_of_regions(&self, choosable: &[CandidateIndex]) -> Vec<Goal<'static>> {
        let requirements = &self.surface.requirements;
        let coverable = coverable(&self.rows_to_choose_by(choosable), self.asked_area_mm2.len());
        let of_coverable = self.params.selection.target_of == TargetOf::Coverable;
        let counts = |sample: SampleId| !of_coverable || coverable.holds(sample);
        let goal = |(number, region): (usize, requirements::NamedRegion)| {
            let is_held: Vec<bool> = requirements.kinds.iter().map(|kind| kind.regions.contains(&number)).collect();
            let holds = |sample: SampleId| is_held[usize::from(requirements.kind(sample))];
            let area = |sample: SampleId| if holds(sample) { self.asked_area_mm2[sample.index()] } else { 0.0 };
            let area_mm2: Vec<f64> = self.surface.samples().map(area).collect();
            let counted = self.surface.samples().filter(|sample| counts(*sample));
            let counted_mm2: f64 = counted.map(|sample| area_mm2[sample.index()]).sum();
            let needed_mm2 = needed_mm2(region.target?, area_mm2.iter().sum(), counted_mm2);
            Some(Goal { needed_mm2, area_mm2: Cow::Owned(area_mm2) })
        };
        requirements::regions(self.params).into_iter().enumerate().filter_map(goal).filter(|goal| goal.needed_mm2 > 0.0).collect()
    }

    /// Returns true if views are chosen by what they measure under errors of pose too.
    pub(in crate::planning) fn tolerates_errors(&self) -> bool {
        self.params.robust.select && self.params.robust.pose_error.is_some()
    }

    /// Rows by which views are chosen: as planned, or also with poses that are off.
    fn rows_to_choose_by(&self, candidates: &[CandidateIndex]) -> Vec<&Row> {
        let rows = self.robust_rows.as_ref().unwrap_or(&self.matrix.rows);
        candidates.iter().map(|candidate| &rows[candidate.index()]).collect()
    }

    /// Rows of `candidates` as planned.
    pub(in crate::planning) fn rows(&self, candidates: &[CandidateIndex]) -> Vec<&Row> {
        candidates.iter().map(|candidate| self.row(*candidate)).collect()
    }

    /// Candidates that the cell can use, ascending.
    pub(in crate::planning) fn usable(&self) -> Vec<CandidateIndex> {
        self.candidates.indices().filter(|candidate| self.blocked(*candidate).is_none()).collect()
    }

    /// Candidates that the cell can use and that are not `excluded`, ascending.
    pub(in crate::planning) fn choosable(&self, excluded: &BTreeSet<CandidateIndex>) -> Vec<CandidateIndex> {
        self.usable().into_iter().filter(|candidate| !excluded.contains(candidate)).collect()
    }

    /// The selection of `rows` of a cover problem over `choosable`, with the bound of `chosen`.
    pub(in crate::planning) fn chosen_of(
        &self,
        cover: &CoverProblem<'_>,
        choosable: &[CandidateIndex],
        rows: &[RowIndex],
        chosen: &ChosenViews,
        ctx: &Context<'_>,
    ) -> Result<ChosenViews, PlanError> {
        let selection = selection::of_rows(cover, &self.params.selection, &self.params.score, rows, &chosen.selection, ctx)?;
        Ok(ChosenViews::of(selection, choosable))
    }

    /// Adds candidates beside the views of a first choice: the fewest that meet the goals, whatever their score. Candidates
    /// are spread evenly over directions, and the best views lie between them: a closer look at a few places costs less than one
    /// everywhere. Poses that the job gives are not looked beside. Returns the first choice.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn look_beside_first_choice(
        &mut self,
        sampled: &SampledPart,
        setups: &[Setup<'_>],
        excluded: &BTreeSet<CandidateIndex>,
        ctx: &Context<'_>,
    ) -> Result<FirstChoice, Cancelled> {
        let choosable = self.choosable(excluded);
        let first = selection::first_choice(&self.cover_problem(&choosable), &self.params.selection, &self.params.score, ctx)?;
        let chosen: Vec<&Candidate> = first.rows.iter().map(|row| &self.candidates[choosable[row.index()]]).collect();
        let (mut already, mut beside) = (self.candidates.generated, Vec::new());
        for (index, setup) in SetupIndex::number(setups) {
            let is_here = |view: &&Candidate| view.setup == index && !view.is_given;
            let views: Vec<&Candidate> = chosen.iter().copied().filter(is_here).collect();
            let tried = TriedSetup {
                table_from_part: setup.table_from_part,
                surface: &self.surface,
                occluders: &setup.occluders,
                scene: setup.scene.as_ref(),
            };
            let more = sampled.evaluate_beside(self.input, &tried, &self.asked_area_mm2, (&views, already), &ctx.silent())?;
            already += more.candidates.generated;
            beside.push((index, more));
        }
        beside.into_iter().for_each(|(setup, more)| self.join(setup, more));
        Ok(first)
    }

    /// Chooses among the usable candidates that are not `excluded`. A target of the coverable area is here a share of what
    /// those measure; the outcome says then whether it was met. After a first choice, grades keep the floors of that. The last views
    /// are the best, and those before them are to fall back on.
    pub(in crate::planning) fn select(
        &self,
        excluded: &BTreeSet<CandidateIndex>,
        first: Option<&FirstChoice>,
        ctx: &Context<'_>,
    ) -> Result<Vec<ChosenViews>, PlanError> {
        let choosable = self.choosable(excluded);
        let travel_secs = |from: RowIndex, to: RowIndex| self.travel_secs(choosable[from.index()], choosable[to.index()]);
        let mut cover = self.cover_problem(&choosable);
        cover.travel_secs = self.reach.is_some().then_some(&travel_secs);
        let mut selection = selection::choose(&cover, &self.params.selection, &self.params.score, first, ctx)?;
        let before_raise = selection.before_raise.take().map(|choices| selection.with_choices(choices));
        Ok(before_raise.into_iter().chain([selection]).map(|selection| ChosenViews::of(selection, &choosable)).collect())
    }

    /// Time of the quickest straight move between stations of two candidates: what travel costs at least.
    fn travel_secs(&self, from: CandidateIndex, to: CandidateIndex) -> f64 {
        let Some(cell) = self.input.cell.filter(|_| self.reach.is_some()) else { return 0.0 };
        let axes = cell.axes();
        let ends = [from, to].map(|candidate| self.stations(candidate));
        let pairs = ends[0].iter().flat_map(|a| ends[1].iter().map(move |b| (a.configuration(), b.configuration())));
        pairs.map(|(a, b)| straight_secs(&axes, &a, &b, &self.params.motion)).fold(f64::INFINITY, f64::min)
    }

    /// Stations of a candidate; none where the cell cannot use it, or without a cell.
    pub(in crate::planning) fn stations(&self, candidate: CandidateIndex) -> &[Station] {
        self.reach.as_ref().and_then(|reach| reach[candidate.index()].as_deref().ok()).unwrap_or_default()
    }

    /// Chosen views of a setup with their stations, for ordering.
    pub(in crate::planning) fn stations_of(&self, chosen: &ChosenViews, setup: SetupIndex) -> Vec<(ViewId, &[Station])> {
        let is_here = |(_, candidate): &(ViewId, CandidateIndex)| self.candidates[*candidate].setup == setup;
        chosen.views().filter(is_here).map(|(view, candidate)| (view, self.stations(candidate))).collect()
    }

    /// Candidates that are reached but for collisions, and those that were dropped since the scanner's body meets something,
    /// with no stations; and those of `all_excluded`, with theirs.
    pub(in crate::planning) fn obstructed(&self, all_excluded: &BTreeSet<CandidateIndex>) -> Vec<(&Candidate, &[Station])> {
        let stations = |candidate: CandidateIndex| match &self.reach.as_ref()?[candidate.index()] {
            Ok(stations) => all_excluded.contains(&candidate).then_some(stations.as_slice()),
            Err(blocked) => (*blocked == StationFailure::Collision).then_some(&[][..]),
        };
        let remaining =
            self.candidates.indices().filter_map(|candidate| Some((&self.candidates[candidate], stations(candidate)?)));
        remaining.chain(self.dropped_for_body().map(|candidate| (candidate, &[][..]))).collect()
    }

    /// Candidates that were dropped since the scanner's body meets something there.
    pub(in crate::planning) fn dropped_for_body(&self) -> impl Iterator<Item = &Candidate> {
        let rejected = self.candidates.rejected.iter();
        rejected.filter(|(_, reason)| reason.is_collision_of_body()).map(|(candidate, _)| candidate)
    }
}

/// The first of a candidate and those that it was slid from, one from another, that is among the first `known` ones.
fn first_known(
    candidate: CandidateIndex,
    slid_from: impl FnMut(&CandidateIndex) -> Option<CandidateIndex>,
    known: usize,
) -> Option<CandidateIndex> {
    std::iter::successors(Some(candidate), slid_from).find(|candidate| candidate.index() < known)
}

/// Area of a region that views have to measure: the target's share of the asked area, by which the outcome judges it, where so
/// much counts for `selection.target_of`; else that share of what counts, so that the goal can be met.
fn needed_mm2(target: f64, asked_mm2: f64, counted_mm2: f64) -> f64 {
    let of_asked_mm2 = target * asked_mm2;
    if of_asked_mm2 <= counted_mm2 { of_asked_mm2 } else { target * counted_mm2 }
}

#[cfg(test)]
mod tests {
    use super::{CandidateIndex, first_known, needed_mm2};

    #[test]
    fn a_candidate_that_was_slid_twice_is_led_back_to_the_one_that_was_known() {
        // Two are known; the third was slid from the second, the fourth from the third, and the last joined by itself.
        let slid_from = |candidate: &CandidateIndex| [None, None, Some(1), Some(2), None][candidate.index()].map(CandidateIndex);
        let led_back = |candidate: u32| first_known(CandidateIndex(candidate), slid_from, 2).map(|known| known.0);
        assert_eq!([0, 1, 2, 3, 4].map(led_back), [Some(0), Some(1), Some(1), Some(1), None]);
        assert_eq!(first_known(CandidateIndex(3), slid_from, 3), Some(CandidateIndex(2)), "the nearest that is known");
    }

    #[test]
    fn a_region_asks_for_its_asked_area_where_views_can_measure_that_and_for_what_they_can_elsewhere() {
        assert_eq!(needed_mm2(0.5, 100.0, 100.0), 50.0);
        assert_eq!(needed_mm2(0.5, 100.0, 60.0), 50.0, "half of what is asked, though 60 mm² alone can be measured");
        assert_eq!(needed_mm2(0.5, 100.0, 40.0), 20.0, "half of what can be measured, since half of all cannot");
        assert_eq!(needed_mm2(0.5, 100.0, 0.0), 0.0);
    }
}
