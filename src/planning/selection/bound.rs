//! Bound of the choice: the fewest views that any choice from the same candidates needs, by the linear
//! relaxation and exact arithmetic (`multipliers.rs`); `certified` raises it by branch and bound.
//!
//! Goals that count: every goal, the plan's own target first; where the plan does not reach a goal (the
//! target cannot be met, growth ended it, the views were limited), the area of it that the plan measures. Overlap, time and
//! quality are left out, which makes it a bound with them as well. Cost: about half a second at most.

use super::multipliers::{BoundTarget, Multipliers, RelaxationSize};
use super::units::Units;
use super::{Cover, CoverProblem, is_for_coverage, max_views};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::SelectionParams;
use crate::planning::visibility::Row;

/// Size of the relaxation that every solver gets.
const QUICK: RelaxationSize = RelaxationSize { step: 3e7, rows: 400 };

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

/// The bound from the relaxation alone.
pub(super) fn quick(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    chosen: &Cover,
    ctx: &Context<'_>,
) -> Result<Bound, Cancelled> {
    let rows: Vec<&Row> = chosen.choices.iter().map(|choice| problem.row(choice.row)).collect();
    let goals = goals_of(problem, &rows, is_for_coverage(params));
    let multipliers = Multipliers::relaxed(problem, &goals, BoundTarget::FewestViews, &QUICK, ctx)?;
    let bound = Bound::of_views(multipliers.views_lower(problem), rows.len());
    if !is_for_coverage(params) {
        return Ok(bound);
    }
    let views = max_views(params);
    let upper = Multipliers::relaxed(problem, &goals, BoundTarget::MostArea(views), &QUICK, ctx)?.max_units(problem, views);
    Ok(bound.with_max_units(problem, &goals[0], upper))
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
