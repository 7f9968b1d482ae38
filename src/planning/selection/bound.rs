//! Bound of the choice: the fewest views that any choice from the same candidates needs, by the linear
//! relaxation and exact arithmetic (`multipliers.rs`); `certified` raises it by branch and bound.
//!
//! Goals that count: every goal, the plan's own target first; where the plan does not reach a goal (the
//! target cannot be met, growth ended it, the views were limited), the area of it that the plan measures. Overlap, time and
//! quality are left out, which makes it a bound with them as well. Exchanges ask for it before they look for fewer views
//! (`local.rs`), and it is not computed twice. Cost: 15 to 40 steps of at most [`QUICK`], once to price rows and up to four times
//! with those that can count; a twentieth of a second as a rule.

use super::multipliers::{BoundTarget, Multipliers, Prices, RelaxationSize};
use super::units::Units;
use super::{CoverProblem, is_for_coverage, max_views};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::RowIndex;
use crate::planning::params::SelectionParams;
use crate::planning::visibility::Row;

/// Size of the relaxation that every solver gets.
const QUICK: RelaxationSize = RelaxationSize { step: 4e6, rows: 400, prices: Some(Prices { step: 2e6, rows: 128 }) };

/// Bound on the number of views, or on the area, of any choice from the same candidates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bound {
    /// Lower bound of the views of any choice from the same candidates that reaches the plan's goals, or the area that the plan
    /// measures of those that it does not reach.
    pub views_lower: u32,
    /// Views chosen minus `views_lower`.
    pub gap: u32,
    /// Upper bound of the share of the asked area that `selection.max_views` views can measure; with the best coverage as goal.
    pub of_asked_upper: Option<f64>,
    /// `of_asked_upper` minus the share that the plan measures; 0 where the plan is proved best.
    pub gap_of_asked: Option<f64>,
}

/// The goals of the problem, each lowered to the area that `rows` reach.
pub(super) fn goals_of(problem: &CoverProblem<'_>, rows: &[&Row], for_coverage: bool) -> Vec<Units> {
    let mut goals = Units::of_goals(problem);
    if for_coverage {
        goals.truncate(1);
        goals.iter_mut().for_each(|goal| goal.needed = goal.total);
    }
    goals.iter_mut().for_each(|goal| goal.clamp_to(rows));
    goals
}

/// A proof that goals ask for so many views.
pub(super) struct FewestProof {
    /// Units needed of each goal.
    needed: Vec<i64>,
    views_lower: usize,
}

impl FewestProof {
    /// The bound from the relaxation alone, for goals that `views` views meet.
    pub(super) fn new(problem: &CoverProblem<'_>, goals: &[Units], views: usize, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let multipliers = Multipliers::relaxed(problem, goals, BoundTarget::FewestViews, (&QUICK, views), ctx)?;
        Ok(Self { needed: needed(goals), views_lower: multipliers.views_lower() })
    }

    /// The fewest views that `goals` ask for, where it was proved of them.
    pub(super) fn views_of(&self, goals: &[Units]) -> Option<usize> {
        (self.needed == needed(goals)).then_some(self.views_lower)
    }
}

fn needed(goals: &[Units]) -> Vec<i64> {
    goals.iter().map(|goal| goal.needed).collect()
}

/// The bound of chosen rows from the relaxation alone, or from what is `proved` of the same goals.
pub(super) fn quick(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    rows: &[RowIndex],
    proved: Option<&FewestProof>,
    ctx: &Context<'_>,
) -> Result<Bound, Cancelled> {
    let goals = goals_of(problem, &problem.measured(rows), is_for_coverage(params));
    let known = proved.and_then(|proved| proved.views_of(&goals));
    let proved = || FewestProof::new(problem, &goals, rows.len(), ctx).map(|proof| proof.views_lower);
    let bound = Bound::of_views(known.map_or_else(proved, Ok)?, rows.len());
    if !is_for_coverage(params) {
        return Ok(bound);
    }
    let views = max_views(params);
    let most = Multipliers::relaxed(problem, &goals, BoundTarget::MostArea(views), (&QUICK, usize::MAX), ctx)?;
    Ok(bound.with_max_units(problem, &goals[0], most.max_units(views)))
}

impl Bound {
    pub(super) fn of_views(views_lower: usize, views: usize) -> Self {
        let views_lower = views_lower.min(views);
        Self { views_lower: views_lower as u32, gap: (views - views_lower) as u32, ..Self::default() }
    }

    /// Adds the bound for the best coverage: `upper` units are possible, and those needed are measured.
    pub(super) fn with_max_units(self, problem: &CoverProblem<'_>, goal: &Units, upper: i64) -> Self {
        let asked_mm2 = problem.asked_mm2();
        let share = |units: i64| if asked_mm2 > 0.0 { (goal.area_mm2(units) / asked_mm2).min(1.0) } else { 0.0 };
        let upper = upper.clamp(goal.needed, goal.measured.max(goal.needed));
        let gap = if upper == goal.needed { 0.0 } else { share(upper) - share(goal.needed) };
        Self { of_asked_upper: Some(share(upper)), gap_of_asked: Some(gap), ..self }
    }
}
