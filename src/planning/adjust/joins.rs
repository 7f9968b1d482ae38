//! Setups joined: where the views of different setups share too little surface to be registered to each other
//! ([`crate::planning::setups::registration`]), views are added that share more. Those are taken first that make the weakest freedom of
//! two setups stiffest; where none makes it stiffer yet, those that measure most of what both setups could share.
//!
//! Cost: an evaluation of the shared surface for each usable candidate of a setup and each view added, a second for two thousand
//! candidates of fifty thousand samples.

use std::collections::BTreeSet;

use crate::geometry::parallel;
use crate::planning::context::{Context, NoPlan, PlanError};
use crate::planning::ids::{CandidateIndex, RowIndex, SetupIndex};
use crate::planning::params::Registration;
use crate::planning::problem::{ChosenViews, ViewPlanningProblem};
use crate::planning::setups::registration::{SharedSurface, Stability, shared, union_of};
use crate::planning::verdict::MIN_RESISTANCE;
use crate::planning::visibility::SampleSet;

/// Views that are added at most.
const MAX_ADDED: usize = 12;
/// Factor by which a view has to make the weakest freedom stiffer to be taken before one that measures more of what both could share.
const STIFFER: f64 = 1.5;

/// Returns true if the views of different setups have to share surface.
pub(super) fn must_join(problem: &ViewPlanningProblem<'_>) -> bool {
    problem.setups.len() > 1 && problem.params.registration == Registration::Surface
}

/// Returns true if chosen views join all of their setups.
pub(super) fn are_joined(problem: &ViewPlanningProblem<'_>, candidates: &[CandidateIndex]) -> bool {
    weakest_gap(problem, &measured_by_setup(problem, candidates)).is_none()
}

/// The chosen views with as many more as join their setups.
///
/// # Errors
/// [`NoPlan::NotRegistered`] where no views would; [`PlanError::Cancelled`].
pub(in crate::planning) fn join_setups(
    problem: &ViewPlanningProblem<'_>,
    chosen: ChosenViews,
    excluded: &BTreeSet<CandidateIndex>,
    ctx: &Context<'_>,
) -> Result<ChosenViews, PlanError> {
    if !must_join(problem) {
        return Ok(chosen);
    }
    let usable = problem.choosable(excluded);
    let views = match joined(problem, &chosen.candidates, &usable, STIFFER, ctx) {
        // Little by little, where views that measure most of what both could share come to nothing.
        Err(PlanError::NoPlan(_)) => joined(problem, &chosen.candidates, &usable, 1.0, ctx)?,
        joined => joined?,
    };
    if views.len() == chosen.candidates.len() {
        return Ok(chosen);
    }
    let place = |candidate| usable.binary_search(candidate).ok().map(RowIndex::at);
    let rows: Vec<RowIndex> = views.iter().filter_map(place).collect();
    problem.chosen_of(&problem.cover_problem(&usable), &usable, &rows, &chosen, ctx)
}

/// Views with as many more as join their setups; one that makes a gap stiffer by less than the factor `stiffer` is not taken for that.
fn joined(
    problem: &ViewPlanningProblem<'_>,
    chosen: &[CandidateIndex],
    usable: &[CandidateIndex],
    stiffer: f64,
    ctx: &Context<'_>,
) -> Result<Vec<CandidateIndex>, PlanError> {
    let mut views = chosen.to_vec();
    let max_views = problem.params.selection.max_views.map_or(usize::MAX, |views| views as usize);
    for _ in 0..MAX_ADDED.min(max_views.saturating_sub(views.len())) {
        let measured = measured_by_setup(problem, &views);
        let Some(gap) = weakest_gap(problem, &measured) else { break };
        let added = gap.closing_view(problem, (&measured, stiffer), usable, &views, ctx)?;
        views.push(added.ok_or(PlanError::NoPlan(NoPlan::NotRegistered { stability: gap.stability }))?);
    }
    match weakest_gap(problem, &measured_by_setup(problem, &views)) {
        Some(gap) => Err(PlanError::NoPlan(NoPlan::NotRegistered { stability: gap.stability })),
        None => Ok(views),
    }
}

/// Samples that the views of each setup measure; of setups that have any.
fn measured_by_setup(problem: &ViewPlanningProblem<'_>, views: &[CandidateIndex]) -> Vec<(SetupIndex, SampleSet)> {
    let setup_of = |candidate: &CandidateIndex| problem.candidates[*candidate].setup;
    let setups: BTreeSet<SetupIndex> = views.iter().map(setup_of).collect();
    let measured = |setup: SetupIndex| {
        let here = views.iter().filter(|candidate| setup_of(candidate) == setup).map(|candidate| problem.row(*candidate));
        (setup, union_of(here, problem.surface.sample_mm.len()))
    };
    setups.into_iter().map(measured).collect()
}

/// Two setups that are not joined yet, of those the two that are nearest to it.
struct Gap {
    setups: [SetupIndex; 2],
    stability: Stability,
}

/// The gap that is closed next; `None` where all setups are joined, directly or through others.
fn weakest_gap(problem: &ViewPlanningProblem<'_>, measured: &[(SetupIndex, SampleSet)]) -> Option<Gap> {
    let part = SharedSurface::new(&problem.surface);
    let link = |a: usize, b: usize| part.stability(&shared(&measured[a].1, &measured[b].1));
    let (mut reached, mut rest) = (vec![0], (1..measured.len()).collect::<Vec<_>>());
    while !rest.is_empty() {
        let links = rest.iter().enumerate().flat_map(|(at, b)| reached.iter().map(move |a| (at, *a, *b)));
        let links = links.map(|(at, a, b)| (at, a, b, link(a, b)));
        let (at, a, b, stability) = links.reduce(|a, b| if b.3.resistance > a.3.resistance { b } else { a })?;
        if !stability.is_fixed() {
            return Some(Gap { setups: [measured[a].0, measured[b].0], stability });
        }
        reached.push(rest.swap_remove(at));
    }
    None
}

impl Gap {
    /// The usable candidate of either setup that closes the gap furthest; `None` where none adds anything that both could share.
    fn closing_view(
        &self,
        problem: &ViewPlanningProblem<'_>,
        (measured, stiffer): (&[(SetupIndex, SampleSet)], f64),
        usable: &[CandidateIndex],
        views: &[CandidateIndex],
        ctx: &Context<'_>,
    ) -> Result<Option<CandidateIndex>, PlanError> {
        let samples = problem.surface.sample_mm.len();
        let of_setup = |setup: SetupIndex| usable.iter().filter(move |c| problem.candidates[**c].setup == setup);
        let could = self.setups.map(|setup| union_of(of_setup(setup).map(|candidate| problem.row(*candidate)), samples));
        let could_share = shared(&could[0], &could[1]);
        let now = self.setups.map(|setup| measured.iter().find(|(of, _)| *of == setup).map(|(_, set)| set));
        let [Some(first), Some(second)] = now else { return Ok(None) };
        let sides = [(self.setups[0], first, second), (self.setups[1], second, first)];
        let candidates = sides.iter().flat_map(|side| of_setup(side.0).map(move |candidate| (*candidate, side)));
        let open: Vec<_> = candidates.filter(|(candidate, _)| !views.contains(candidate)).collect();
        let part = SharedSurface::new(&problem.surface);
        let worth = |(candidate, (_, own, other)): &(CandidateIndex, &(SetupIndex, &SampleSet, &SampleSet))| {
            ctx.check()?;
            let mut with = (*own).clone();
            with.insert_all(problem.row(*candidate).measured());
            let resistance = part.stability(&shared(&with, other)).resistance;
            let mut new = shared(problem.row(*candidate).measured(), &could_share);
            new.remove_all(own);
            let new_mm2: f64 = new.iter().map(|sample| problem.surface.sample_area_mm2(sample)).sum();
            Ok((*candidate, resistance, new_mm2))
        };
        let worths = parallel::try_map::<_, _, PlanError>(&open, worth)?;
        let stiffest = worths.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a });
        let widest = worths.iter().copied().reduce(|a, b| if b.2 > a.2 { b } else { a });
        let is_stiffer = |(_, resistance, _): &(CandidateIndex, f64, f64)| {
            *resistance >= MIN_RESISTANCE || *resistance > stiffer * self.stability.resistance + 1e-6
        };
        let adds = |(_, _, new_mm2): &(CandidateIndex, f64, f64)| *new_mm2 > 0.0;
        Ok(stiffest.filter(is_stiffer).or(widest.filter(adds)).map(|(candidate, ..)| candidate))
    }
}
