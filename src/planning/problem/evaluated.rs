//! Candidates with what is known of them: stations, and the samples that each measures.

use rayon::prelude::*;

use crate::planning::candidates::{CandidateSet, Rejection};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, SampleId, SetupIndex};
use crate::planning::scene::{PlanningScene, Reach};
use crate::planning::surface::Surface;
use crate::planning::verdict::Cause;
use crate::planning::visibility::{Row, SampleSet, VisibilityMatrix};

/// Candidates with everything that is known of them.
pub(in crate::planning) struct EvaluatedCandidates {
    pub(in crate::planning) candidates: CandidateSet,
    /// Row of each candidate.
    pub(in crate::planning) matrix: VisibilityMatrix,
    /// Stations of each candidate; `None` without a cell.
    pub(in crate::planning) reach: Option<Reach>,
    /// Samples that obstacles of the cell hide at every station of some candidate that would measure them.
    pub(in crate::planning) hidden_by_cell: SampleSet,
}

/// Returns true if the cell can take a candidate.
pub(super) fn is_usable(reach: Option<&Reach>, candidate: CandidateIndex) -> bool {
    reach.is_none_or(|reach| reach[candidate.index()].is_ok())
}

impl EvaluatedCandidates {
    /// An empty set of candidates.
    pub(super) fn none_of(surface: &Surface, with_cell: bool) -> Self {
        let furthest_cause = vec![Cause::Facing; surface.sample_mm.len()];
        let matrix = VisibilityMatrix { rows: Vec::new(), furthest_cause };
        let hidden_by_cell = SampleSet::none_of(surface.sample_mm.len());
        Self { candidates: CandidateSet::default(), matrix, reach: with_cell.then(Vec::new), hidden_by_cell }
    }

    /// Takes out of rows and stations what obstacles of the cell hide, see [`PlanningScene::keep_in_sight`].
    pub(super) fn keep_in_sight(
        &mut self,
        scene: &PlanningScene<'_>,
        surface: &Surface,
        ctx: &Context<'_>,
    ) -> Result<(), Cancelled> {
        let Some(reach) = self.reach.as_mut().filter(|_| !scene.sight().has_no_obstacles()) else { return Ok(()) };
        let views = self.candidates.remaining.par_iter().map(|candidate| &candidate.part_from_scanner);
        let hidden = self.matrix.rows.par_iter_mut().zip(reach).zip(views).map(|((row, stations), view)| match stations {
            Ok(stations) => scene.keep_in_sight(surface, view, stations, row, ctx),
            Err(_) => Ok(None),
        });
        let hidden = hidden.collect::<Result<Vec<Option<SampleSet>>, Cancelled>>()?;
        hidden.iter().flatten().for_each(|hidden| self.hidden_by_cell.insert_all(hidden));
        Ok(())
    }

    /// Samples that a candidate measures.
    pub(super) fn row(&self, candidate: CandidateIndex) -> &Row {
        &self.matrix.rows[candidate.index()]
    }

    /// Returns true if the cell can take a candidate.
    pub(super) fn is_usable(&self, candidate: CandidateIndex) -> bool {
        is_usable(self.reach.as_ref(), candidate)
    }

    /// Assigns the candidates to a setup.
    pub(super) fn in_setup(mut self, setup: SetupIndex) -> Self {
        let rejected = self.candidates.rejected.iter_mut().map(|(candidate, _)| candidate);
        self.candidates.remaining.iter_mut().chain(rejected).for_each(|candidate| candidate.setup = setup);
        self
    }

    pub(super) fn append(&mut self, more: Self) {
        self.candidates.append(more.candidates);
        self.matrix.rows.extend(more.matrix.rows);
        let furthest = self.matrix.furthest_cause.iter_mut().zip(more.matrix.furthest_cause);
        furthest.for_each(|(furthest, more)| *furthest = (*furthest).max(more));
        self.hidden_by_cell.insert_all(&more.hidden_by_cell);
        if let (Some(reach), Some(more)) = (&mut self.reach, more.reach) {
            reach.extend(more);
        }
    }

    /// A candidate that measures nothing asked adds nothing to any choice. Those that the cell cannot use keep that as
    /// their reason.
    pub(super) fn drop_what_measures_nothing(&mut self, asked_area_mm2: &[f64]) {
        let mut asked = SampleSet::none_of(asked_area_mm2.len());
        SampleId::number(asked_area_mm2).filter(|(_, mm2)| **mm2 > 0.0).for_each(|(sample, _)| asked.insert(sample));
        let measures = |words: &[u64]| words.iter().zip(asked.words()).any(|(row, asked)| row & asked != 0);
        self.drop_where(|all, candidate| {
            (all.is_usable(candidate) && !measures(all.row(candidate).words())).then_some(Rejection::MeasuresNothing)
        });
    }

    /// Drops candidates that must not be chosen.
    pub(in crate::planning) fn drop_unusable(&mut self) {
        self.drop_where(|all, candidate| (!all.is_usable(candidate)).then_some(Rejection::Unreachable));
    }

    /// Drops the candidates that `reason` gives a reason for, knowing them all.
    pub(super) fn drop_where(&mut self, reason: impl Fn(&Self, CandidateIndex) -> Option<Rejection>) {
        let reasons: Vec<Option<Rejection>> = self.candidates.indices().map(|candidate| reason(self, candidate)).collect();
        let dropped = self
            .candidates
            .remaining
            .iter()
            .zip(&reasons)
            .filter_map(|(candidate, reason)| Some((candidate.clone(), (*reason)?)));
        self.candidates.rejected.extend(dropped);
        retain(&mut self.candidates.remaining, &reasons);
        retain(&mut self.matrix.rows, &reasons);
        if let Some(reach) = &mut self.reach {
            retain(reach, &reasons);
        }
    }
}

fn retain<T>(items: &mut Vec<T>, reasons: &[Option<Rejection>]) {
    let mut reasons = reasons.iter();
    items.retain(|_| reasons.next().is_none_or(Option::is_none));
}
