//! More views of the candidates that were considered, and the target that asks for them.

use std::collections::BTreeSet;

use super::{Basis, Wanted, choose as choose_rows, cycle_secs, exceeds_every_limit, views_of};
use crate::cell::Configuration;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, SetupIndex};
use crate::planning::params::SelectionGoal;
use crate::planning::plan::{AdviceKind, Outcome, ParamChange, PlanAdvice};
use crate::planning::problem::ViewPlanningProblem;
use crate::planning::registration::union_of;
use crate::planning::sequence::{Ordered, straight_secs};

/// Share of the asked area that a further view adds at least: our choice.
const MIN_GAIN: f64 = 0.002;
/// Views that are added at most.
const MAX_ADDED: usize = 12;
/// Steps of a target in one: three decimals.
const TARGET_STEPS: f64 = 1e3;

/// Views that were chosen beside those of the plan.
pub(super) struct MoreViews {
    /// Number of them.
    added: usize,
    /// Asked area that a plan with the target measures at least.
    measured_mm2: f64,
    /// Target that asks for them; `None` where only the limit of views keeps them out.
    target: Option<f64>,
    /// Time of the moves to them, each put between two views where it takes least, moves straight.
    moving_secs: f64,
}

/// Chooses more of the candidates that are not `given_up`; `None` where too little is open for them.
pub(super) fn choose(
    basis: &Basis,
    problem: &ViewPlanningProblem<'_>,
    ordered: &[Ordered],
    given_up: &BTreeSet<CandidateIndex>,
    ctx: &Context<'_>,
) -> Result<Option<MoreViews>, Cancelled> {
    if !basis.is_worth(basis.area_mm2(&basis.coverable)) {
        return Ok(None);
    }
    let params = &problem.params.selection;
    let (choosable, open_mm2) = (problem.choosable(given_up), basis.open_area_mm2());
    let min_gain_mm2 = MIN_GAIN.max(params.min_growth) * basis.asked_mm2();
    let wanted = Wanted { open_mm2: &open_mm2, needed_mm2: open_mm2.iter().sum(), min_gain_mm2, max_views: MAX_ADDED };
    let picks = choose_rows(&problem.rows(&choosable), &wanted, &problem.params.score, ctx)?;
    let picks: Vec<CandidateIndex> = picks.into_iter().map(|place| choosable[place]).collect();
    let mut measured = basis.measured.clone();
    measured.insert_all(&union_of(problem.rows(&picks), basis.asked_area_mm2.len()));
    let (measured_mm2, whole_mm2) = (basis.area_mm2(&measured), basis.whole_mm2(&basis.coverable, params.target_of));
    let target = ((measured_mm2 / whole_mm2 * TARGET_STEPS).floor() / TARGET_STEPS).min(1.0);
    let (target, measured_mm2) = match params.goal {
        SelectionGoal::BestCoverage => (None, measured_mm2),
        SelectionGoal::FewestViews | SelectionGoal::MinTime if target > params.target => (Some(target), target * whole_mm2),
        // The plan's own target asks for as much, and only the limit of views keeps it from that.
        SelectionGoal::FewestViews | SelectionGoal::MinTime => (None, measured_mm2.min(params.target * whole_mm2)),
    };
    let moving_secs = insertion_secs(problem, ordered, &picks);
    let more = MoreViews { added: picks.len(), measured_mm2, target, moving_secs };
    Ok(basis.is_worth(measured_mm2).then_some(more))
}

/// Time that the moves take longer with some more views, each put between two where that takes least; moves are straight, so that
/// detours are not counted. 0 without a cell.
fn insertion_secs(problem: &ViewPlanningProblem<'_>, ordered: &[Ordered], picks: &[CandidateIndex]) -> f64 {
    let Some(cell) = problem.input.cell else { return 0.0 };
    let (axes, motion) = (cell.axes(), &problem.params.motion);
    let secs = |a: &Configuration, b: &Configuration| straight_secs(&axes, a, b, motion);
    let tour = |ordered: &Ordered| {
        let stops = ordered.sequence.visits.iter().map(|(_, leg)| leg.target.configuration());
        std::iter::once(cell.home_rad).chain(stops).chain([cell.home_rad]).collect::<Vec<_>>()
    };
    let mut tours: Vec<Vec<Configuration>> = ordered.iter().map(tour).collect();
    let mut longer_secs = 0.0;
    for pick in picks {
        let SetupIndex(setup) = problem.candidates[*pick].setup;
        let Some(tour) = tours.get_mut(setup as usize) else { continue };
        let places =
            problem.stations(*pick).iter().flat_map(|station| (1..tour.len()).map(move |at| (at, station.configuration())));
        let priced = places.map(|(at, stop)| {
            let [before, after] = [&tour[at - 1], &tour[at]];
            (secs(before, &stop) + secs(&stop, after) - secs(before, after), at, stop)
        });
        if let Some((added_secs, at, stop)) = priced.min_by(|a, b| a.0.total_cmp(&b.0)) {
            longer_secs += added_secs;
            tour.insert(at, stop);
        }
    }
    longer_secs
}

impl MoreViews {
    /// The advice to choose them; `None` where no parameter asks for them.
    pub(super) fn advice(&self, basis: &Basis, outcome: &Outcome) -> Option<PlanAdvice> {
        let (plan, params) = (&outcome.plan, &outcome.plan.params);
        let views = views_of(outcome) + self.added;
        if exceeds_every_limit(params.selection.max_views, views) {
            return None;
        }
        let limit =
            params.selection.max_views.filter(|limit| (*limit as usize) < views).map(|_| ParamChange::MaxViews(views as u32));
        let changes: Vec<ParamChange> = self.target.map(ParamChange::Target).into_iter().chain(limit).collect();
        (!changes.is_empty()).then(|| PlanAdvice {
            kind: AdviceKind::MoreViews,
            changes,
            table_from_part: None,
            turn: None,
            setups: Vec::new(),
            added_views: self.added,
            views,
            measured_area_mm2: self.measured_mm2.max(basis.measured_mm2()),
            visible_area_mm2: plan.coverage.visible_area_mm2,
            cycle_secs: cycle_secs(outcome, |_| true, (self.added, self.moving_secs)),
            regions_met: Vec::new(),
        })
    }
}
