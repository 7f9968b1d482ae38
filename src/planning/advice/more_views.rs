//! More views of the candidates that were considered, and the target that asks for them.

use std::collections::BTreeSet;

use super::turn_over::raised_limit;
use super::{
    Basis, MAX_VIEWS, Wanted, choose as choose_rows, cycle_secs, exceeds_every_limit, quickest_secs, starting_params, views_of,
};
use crate::cell::{Cell, Configuration};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, RowIndex, SetupIndex};
use crate::planning::params::{Registration, SelectionGoal, SelectionParams};
use crate::planning::plan::{AdviceKind, Outcome, ParamChange, PlanAdvice};
use crate::planning::problem::ViewPlanningProblem;
use crate::planning::selection;
use crate::planning::sequence::{Ordered, straight_secs};
use crate::planning::setups::registration::union_of;

/// Share of the asked area that a further view adds at least: our choice.
const MIN_GAIN: f64 = 0.002;
/// Views that are added at most.
const MAX_ADDED: usize = 12;
/// Steps of a target in one: three decimals.
const TARGET_STEPS: f64 = 1e3;
/// Share of the asked area by which two sums of its parts differ by rounding, and a target counts as met.
const SUM_SLACK: f64 = 1e-8;

/// Views that were chosen beside those of the plan.
pub(super) struct MoreViews {
    /// Number of them, or by which a plan that chooses all its views anew has more, where those do not do.
    added: usize,
    /// Asked area that a plan with the target measures at least.
    measured_mm2: f64,
    /// Target that asks for them; `None` where only the limit of views keeps them out.
    target: Option<f64>,
    /// True if a plan measures as much that may take no more views and chooses all of them anew, by its own score.
    is_met_anew: bool,
    /// Means by which the setups that are planned in are registered to each other; none for a single one.
    registration: Registration,
    /// Time of the moves to them, each put between two views where it takes least, moves straight; of more that a plan takes that chooses
    /// anew, each is counted as long.
    moving_secs: f64,
}

/// Chooses more of the candidates that are not `given_up`, beside the plan's `views`; `None` where too little is open for them, or a plan
/// with more of them may not register its setups.
pub(super) fn choose(
    basis: &Basis,
    problem: &ViewPlanningProblem<'_>,
    (views, ordered): (usize, &[Ordered]),
    given_up: &BTreeSet<CandidateIndex>,
    ctx: &Context<'_>,
) -> Result<Option<MoreViews>, Cancelled> {
    if !basis.is_worth(basis.area_mm2(&basis.coverable)) {
        return Ok(None);
    }
    let params = &problem.params.selection;
    let registration = if problem.setups.len() > 1 { problem.params.registration } else { Registration::None };
    // All views that there may be are taken for their area, and none is left to register setups.
    if params.goal == SelectionGoal::BestCoverage && registration == Registration::Surface {
        return Ok(None);
    }
    let (choosable, open_mm2) = (problem.choosable(given_up), basis.open_area_mm2());
    let min_gain_mm2 = MIN_GAIN.max(params.min_growth) * basis.asked_mm2();
    let wanted = Wanted { open_mm2: &open_mm2, needed_mm2: open_mm2.iter().sum(), min_gain_mm2, max_views: MAX_ADDED };
    let picks = choose_rows(&problem.rows(&choosable), &wanted, &problem.params.score, ctx)?;
    let picks: Vec<CandidateIndex> = picks.into_iter().map(|row| choosable[row.index()]).collect();
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
    if !basis.is_worth(measured_mm2) {
        return Ok(None);
    }
    let moving_secs = insertion_secs(problem, ordered, &picks);
    let mut more = MoreViews { added: picks.len(), measured_mm2, target, is_met_anew: true, registration, moving_secs };
    if let Some(limit) = params.max_views {
        more.choose_anew(basis, problem, &choosable, (views, limit), ctx)?;
    }
    Ok(basis.is_worth(more.measured_mm2).then_some(more))
}

/// Asked area that a plan with other parameters measures at least, which chooses all its views among the same candidates, and the number
/// of these: where greedy ends, see [`starting_params`].
fn measured_anew(
    basis: &Basis,
    problem: &ViewPlanningProblem<'_>,
    choosable: &[CandidateIndex],
    params: &SelectionParams,
    ctx: &Context<'_>,
) -> Result<(f64, usize), Cancelled> {
    let score = &problem.params.score;
    let params = starting_params(params, score);
    let travel_secs = |from: RowIndex, to: RowIndex| {
        let ends = [problem.stations(choosable[from.index()]), problem.stations(choosable[to.index()])];
        problem.input.cell.map_or(0.0, |cell| quickest_secs(cell, &problem.params.motion, ends))
    };
    let mut cover = problem.cover_problem(choosable);
    cover.travel_secs = problem.input.cell.is_some().then_some(&travel_secs);
    cover.goals[0].needed_mm2 = params.target * basis.whole_mm2(&basis.coverable, params.target_of);
    let choices = selection::greedily(&cover, &params, score, &ctx.silent())?;
    let rows = choices.iter().map(|choice| problem.row(choosable[choice.row.index()]));
    Ok((basis.area_mm2(&union_of(rows, basis.asked_area_mm2.len())), choices.len()))
}

/// Time that the moves take longer with some more views, each put between two where that takes least; moves are straight, so that
/// detours are not counted. 0 without a cell.
pub(super) fn insertion_secs(problem: &ViewPlanningProblem<'_>, ordered: &[Ordered], picks: &[CandidateIndex]) -> f64 {
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
    /// Holds what the views measure against a plan that chooses all of its views anew: with the limit of views that there is, or one of as
    /// many as the `views` of the plan and these, and where that leaves less measured, with the largest limit.
    fn choose_anew(
        &mut self,
        basis: &Basis,
        problem: &ViewPlanningProblem<'_>,
        choosable: &[CandidateIndex],
        (views, limit): (usize, u32),
        ctx: &Context<'_>,
    ) -> Result<(), Cancelled> {
        let own = &problem.params.selection;
        let target = self.target.unwrap_or(own.target);
        let anew = |limit: u32| {
            let params = SelectionParams { target, max_views: Some(limit.min(MAX_VIEWS)), ..own.clone() };
            measured_anew(basis, problem, choosable, &params, ctx)
        };
        let (anew_mm2, _) = anew(limit.max((views + self.added) as u32))?;
        if anew_mm2 >= self.measured_mm2 - SUM_SLACK * basis.asked_mm2() {
            return Ok(());
        }
        // So many views are taken for the best coverage, whatever they measure.
        if own.goal == SelectionGoal::BestCoverage {
            self.measured_mm2 = anew_mm2;
            return Ok(());
        }
        let (anew_mm2, anew_views) = anew(MAX_VIEWS)?;
        let added = anew_views.saturating_sub(views).max(self.added);
        self.moving_secs *= added as f64 / self.added.max(1) as f64;
        (self.added, self.is_met_anew) = (added, false);
        self.measured_mm2 = self.measured_mm2.min(anew_mm2);
        Ok(())
    }

    /// The advice to choose them; `None` where no parameter asks for them.
    pub(super) fn advice(&self, basis: &Basis, outcome: &Outcome, cell: Option<&Cell>) -> Option<PlanAdvice> {
        let (plan, params) = (&outcome.plan, &outcome.plan.params);
        let views = views_of(outcome) + self.added;
        if exceeds_every_limit(params.selection.max_views, views) {
            return None;
        }
        let limit = self.raised_limit(params.selection.max_views, views).map(ParamChange::MaxViews);
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
            grade_a_area_mm2: None,
            visible_area_mm2: plan.coverage.visible_area_mm2,
            cycle_secs: cycle_secs(outcome, cell, |_| true, (self.added, self.moving_secs)),
            regions_met: Vec::new(),
        })
    }

    /// Limit of views for a plan that takes so many, and others to register its setups; the largest that there is where a plan that
    /// chooses all its views anew may need more, since it ends at its target. `None` where there is none, or nothing that is advised
    /// needs more than the one that there is.
    fn raised_limit(&self, limit: Option<u32>, views: usize) -> Option<u32> {
        let is_too_low = limit.is_some_and(|limit| (limit as usize) < views);
        let raised = if self.is_met_anew {
            raised_limit(limit, views, self.registration)
        } else {
            limit.filter(|limit| *limit < MAX_VIEWS).map(|_| MAX_VIEWS)
        };
        raised.filter(|_| is_too_low || self.target.is_some())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::geometry::Mesh;
    use crate::planning::context::Silent;
    use crate::planning::params::{PlanParams, Solver, Strategy, TargetOf};
    use crate::planning::plan::Plan;
    use crate::planning::{PlanInput, plan};
    use crate::testing::{box_mesh, nominal_scanner};

    /// A box in two setups, of which a single view may be taken.
    fn one_view_in_two_setups() -> PlanParams {
        let mut params = PlanParams { setups: 2, ..PlanParams::default() };
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.2), Some(1000.0));
        (params.candidates.strategies, params.candidates.even_directions) = (vec![Strategy::Even], Some(30));
        (params.selection.max_views, params.selection.target_of) = (Some(1), TargetOf::Asked);
        (params.missed.remedies, params.robust.pose_error) = (0, None);
        params
    }

    fn planned(params: &PlanParams) -> Plan {
        planned_of(&box_mesh([0.0; 3], [50.0, 40.0, 30.0]), params)
    }

    fn planned_of(mesh: &Mesh, params: &PlanParams) -> Plan {
        let (scanner, cancel) = (nominal_scanner(), AtomicBool::new(false));
        let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        plan(&input, params, &Context::new(&cancel, &Silent)).expect("a plan").plan
    }

    /// Takes the advice, and asks for none.
    fn follow(advice: &PlanAdvice, params: &mut PlanParams) {
        for change in &advice.changes {
            match change {
                ParamChange::MaxViews(views) => params.selection.max_views = Some(*views),
                ParamChange::Target(target) => params.selection.target = *target,
                ParamChange::MinGradeA(share) => params.selection.min_grade_a = Some(*share),
                ParamChange::Setups(_) | ParamChange::RestingPoses(_) | ParamChange::Registration(_) => panic!("{change:?}"),
            }
        }
        params.missed.advice = false;
    }

    /// A limit of as many views as were told left the box without a plan: its setups could not be registered.
    #[test]
    fn a_part_in_two_setups_is_planned_with_the_limit_of_views_that_is_advised() {
        let mut params = one_view_in_two_setups();
        let before = planned(&params);
        let [advice] = &before.advice[..] else { panic!("{:?}", before.advice) };
        assert_eq!(advice.kind, AdviceKind::MoreViews);
        follow(advice, &mut params);
        let after = planned(&params);
        let measured_mm2 = after.coverage.measured.area_mm2;
        assert!(measured_mm2 >= advice.measured_area_mm2 - 1e-6, "{measured_mm2} of {} mm²", advice.measured_area_mm2);
    }

    /// A slab that takes several views, chosen for grades before area and at most two of them.
    fn two_views_of_a_slab(goal: SelectionGoal) -> (Mesh, PlanParams) {
        let mut params = PlanParams::default();
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.01), Some(1000.0));
        (params.candidates.strategies, params.candidates.even_directions) = (vec![Strategy::Even], Some(30));
        (params.selection.solver, params.selection.goal) = (Solver::Greedy, goal);
        (params.selection.max_views, params.score.b) = (Some(2), 4.0);
        (params.missed.remedies, params.robust.pose_error) = (0, None);
        (box_mesh([0.0; 3], [300.0, 200.0, 100.0]), params)
    }

    /// A plan with the limit of 8 views that was advised for 99.8 % of the slab measured 97.6 %: the trial chose for area alone.
    #[test]
    fn advice_gives_what_it_says_where_a_plan_chooses_by_another_score_than_the_trial() {
        for goal in [SelectionGoal::FewestViews, SelectionGoal::BestCoverage] {
            let (mesh, mut params) = two_views_of_a_slab(goal);
            let before = planned_of(&mesh, &params);
            let [advice] = &before.advice[..] else { panic!("{:?}", before.advice) };
            let is_unlimited = advice.changes.contains(&ParamChange::MaxViews(MAX_VIEWS));
            assert_eq!(is_unlimited, goal == SelectionGoal::FewestViews, "{advice:?}");
            follow(advice, &mut params);
            let after = planned_of(&mesh, &params);
            let measured_mm2 = after.coverage.measured.area_mm2;
            // Views are slid once they are chosen, and those of the first plan are among the candidates of the trial.
            let slack_mm2 = 0.002 * after.coverage.asked_area_mm2;
            assert!(measured_mm2 >= advice.measured_area_mm2 - slack_mm2, "{measured_mm2} of {} mm²", advice.measured_area_mm2);
            assert!(after.views.len() <= advice.views + 2, "{} views, {} told", after.views.len(), advice.views);
        }
    }

    /// Choosing as many views for the best coverage leaves none to register the setups, so that there is no plan.
    #[test]
    fn more_views_for_the_best_coverage_are_not_advised_where_setups_are_registered_by_surface() {
        let mut params = one_view_in_two_setups();
        params.selection.goal = SelectionGoal::BestCoverage;
        assert_eq!(planned(&params).advice, []);
        params.registration = Registration::Markers;
        let advice = planned(&params).advice;
        assert!(advice.iter().any(|advice| advice.kind == AdviceKind::MoreViews), "{advice:?}");
    }

    #[test]
    fn a_limit_of_views_is_raised_for_what_is_advised_alone() {
        let more = |registration: Registration, target: Option<f64>| MoreViews {
            added: 2,
            measured_mm2: 0.0,
            target,
            is_met_anew: true,
            registration,
            moving_secs: 0.0,
        };
        let raised = |registration: Registration, target: Option<f64>, limit: Option<u32>| {
            more(registration, target).raised_limit(limit, 3)
        };
        let limits = [None, Some(1), Some(3), Some(15)];
        let with = |registration, target| limits.map(|limit| raised(registration, target, limit));
        assert_eq!(with(Registration::None, Some(0.999)), [None, Some(3), None, None]);
        assert_eq!(with(Registration::None, None), [None, Some(3), None, None]);
        assert_eq!(with(Registration::Surface, Some(0.999)), [None, Some(15), Some(15), None]);
        assert_eq!(with(Registration::Surface, None), [None, Some(15), None, None], "the limit does not keep them out");
        let unsure = MoreViews { is_met_anew: false, ..more(Registration::None, Some(0.999)) };
        let any = [None, Some(1), Some(15), Some(MAX_VIEWS)].map(|limit| unsure.raised_limit(limit, 3));
        assert_eq!(any, [None, Some(MAX_VIEWS), Some(MAX_VIEWS), None], "a plan that chooses anew may need more views");
    }
}
