//! The shortest cycle that still meets the goals (`selection.goal` = `min_time`): views are exchanged for others that lie
//! better on the way. An exchange keeps the number of views, so settling and scanning take what they took; what it saves is
//! estimated with straight moves, as the view is taken out of the tour and the other put in where it costs least. Stations,
//! order and paths are then found anew, and the result is kept if its moves really take less.

use std::collections::BTreeSet;

use super::joins;
use crate::cell::{Axes, Cell, Configuration};
use crate::planning::context::{Context, PlanError};
use crate::planning::ids::{CandidateIndex, RowIndex, SetupIndex, ViewId};
use crate::planning::problem::{ChosenViews, ViewPlanningProblem};
use crate::planning::scene::PlanningScene;
use crate::planning::selection::{Exchanges, GradeFloor};
use crate::planning::sequence::{Ordered, Sequence, straight_secs};

/// Times that all is ordered anew, at most.
const MAX_ROUNDS: usize = 6;
/// Exchanges between two times, at most.
const MAX_EXCHANGES: usize = 40;
/// Smallest saving of an exchange, seconds.
const MIN_SAVING_SECS: f64 = 0.02;

/// A plan's views in the order visited, by setup: the view and where the cell takes it.
type Tours = Vec<Vec<(ViewId, Configuration)>>;

/// The selection, or a quicker one that is permitted, with its order.
///
/// # Errors
/// The errors of [`ViewPlanningProblem::chosen_of`], and those of `is_permitted`.
pub(in crate::planning) fn exchange_views(
    problem: &ViewPlanningProblem<'_>,
    scenes: &[&PlanningScene<'_>],
    (mut chosen, mut ordered): (ChosenViews, Vec<Ordered>),
    excluded: &BTreeSet<CandidateIndex>,
    is_permitted: &mut dyn FnMut(&ChosenViews) -> Result<bool, PlanError>,
    ctx: &Context<'_>,
) -> Result<(ChosenViews, Vec<Ordered>), PlanError> {
    let moving = |ordered: &[Ordered]| ordered.iter().map(|ordered| ordered.sequence.motion_secs()).sum::<f64>();
    for _ in 0..MAX_ROUNDS {
        let Some(other) = exchanged(problem, &chosen, &ordered, excluded, ctx)? else { break };
        if joins::must_join(problem) && !joins::are_joined(problem, &other.candidates) {
            break;
        }
        let order = |(setup, scene): (SetupIndex, &&PlanningScene<'_>)| {
            let in_sight = |view, station: &Configuration| problem.is_in_sight(scene, other.candidate(view), station, ctx);
            scene.order(&problem.stations_of(&other, setup), true, &in_sight, ctx)
        };
        let again: Vec<Ordered> = SetupIndex::number(scenes).map(order).collect::<Result<_, _>>()?;
        if again.iter().any(|ordered| !ordered.no_path.is_empty()) || moving(&again) >= moving(&ordered) - MIN_SAVING_SECS {
            break;
        }
        if !is_permitted(&other)? {
            break;
        }
        (chosen, ordered) = (other, again);
    }
    Ok((chosen, ordered))
}

/// Finds as many views that meet the goals and take less time by straight moves; `None` where there are none.
fn exchanged(
    problem: &ViewPlanningProblem<'_>,
    chosen: &ChosenViews,
    ordered: &[Ordered],
    excluded: &BTreeSet<CandidateIndex>,
    ctx: &Context<'_>,
) -> Result<Option<ChosenViews>, PlanError> {
    let Some(cell) = problem.input.cell else { return Ok(None) };
    let exchange = TourExchange { problem, cell, axes: cell.axes() };
    let choosable = problem.choosable(excluded);
    let cover = problem.cover_problem(&choosable);
    let params = &problem.params.selection;
    let floor = GradeFloor::of(&cover, params, &problem.params.score, None, ctx)?;
    let with_floor = floor.as_ref().map(|floor| floor.problem(&cover));
    let exchanges = Exchanges::new(with_floor.as_ref().unwrap_or(&cover), params);
    // Every chosen candidate is choosable, so that the places among these are the views.
    let row_of = |candidate: &CandidateIndex| choosable.binary_search(candidate).ok().map(RowIndex::at);
    let mut rows: Vec<RowIndex> = chosen.candidates.iter().filter_map(row_of).collect();
    let mut tours = tours(ordered.iter().map(|ordered| &ordered.sequence));
    let mut found = false;
    for _ in 0..MAX_EXCHANGES {
        let allowed = exchanges.of(&rows, ctx)?;
        let savings = allowed.into_iter().filter_map(|(view, row)| {
            let (saved_secs, tours) = exchange.evaluate(&tours, view, choosable[row.index()])?;
            Some((saved_secs, view, row, tours))
        });
        let best = savings.fold(None, |best: Option<(f64, ViewId, RowIndex, Tours)>, next| match best {
            Some(best) if best.0 >= next.0 => Some(best),
            _ => Some(next),
        });
        let Some((_, view, row, quicker)) = best.filter(|best| best.0 > MIN_SAVING_SECS) else { break };
        (rows[view.index()], tours, found) = (row, quicker, true);
    }
    found.then(|| problem.chosen_of(&cover, &choosable, &rows, chosen, ctx)).transpose()
}

fn tours<'a>(sequences: impl Iterator<Item = &'a Sequence>) -> Tours {
    let tour =
        |sequence: &Sequence| sequence.visits.iter().map(|(view, leg)| (*view, leg.target.configuration())).collect::<Vec<_>>();
    sequences.map(tour).collect()
}

struct TourExchange<'a> {
    problem: &'a ViewPlanningProblem<'a>,
    cell: &'a Cell,
    axes: Axes,
}

impl TourExchange<'_> {
    /// Saving by a candidate in place of a view, and the tours then; `None` where the candidate has no station,
    /// or belongs to another setup.
    fn evaluate(&self, tours: &Tours, view: ViewId, candidate: CandidateIndex) -> Option<(f64, Tours)> {
        let setup = self.problem.candidates[candidate].setup.index();
        let at = tours.get(setup)?.iter().position(|(other, _)| *other == view)?;
        let mut without = tours[setup].clone();
        let (_, here) = without.remove(at);
        let saved_secs = self.detour_secs(&without, at, &here);
        let stations = self.problem.reach.as_ref()?[candidate.index()].as_deref().ok()?;
        let insertions = (0..=without.len()).flat_map(|at| stations.iter().map(move |station| (at, station.configuration())));
        let costs = insertions.map(|(at, there)| (self.detour_secs(&without, at, &there), at, there));
        let (cost_secs, at, there) = costs.min_by(|a, b| a.0.total_cmp(&b.0))?;
        without.insert(at, (view, there));
        let mut tours = tours.clone();
        tours[setup] = without;
        Some((saved_secs - cost_secs, tours))
    }

    /// Extra time of the move through `here` between the stops before and at `at`.
    fn detour_secs(&self, tour: &[(ViewId, Configuration)], at: usize, here: &Configuration) -> f64 {
        let home = &self.cell.home_rad;
        let stop = |at: Option<usize>| at.and_then(|at| tour.get(at)).map_or(home, |(_, configuration)| configuration);
        let (before, after) = (stop(at.checked_sub(1)), stop(Some(at)));
        let secs = |from, to| straight_secs(&self.axes, from, to, &self.problem.params.motion);
        secs(before, here) + secs(here, after) - secs(before, after)
    }
}
