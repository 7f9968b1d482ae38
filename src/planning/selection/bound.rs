//! Bound of the choice: a lower bound on the number of views of any choice from the same candidates, by the linear
//! relaxation and exact arithmetic (`multipliers.rs`); `certified` raises it by branch and bound.
//!
//! Goals that count: every goal, the plan's own target first; where the plan does not reach a goal (the
//! target cannot be met, growth ended it, the views were limited), the area of it that the plan measures. Overlap, time and
//! quality are left out, which makes it a bound with them as well.
//!
//! No choice depends on it, and it takes as long as all choices together: a selection comes with what its bound is computed from
//! ([`OpenBound`]), which a plan computes beside the stages that follow. Cost: 15 to 60 steps of at most [`QUICK`], once to price rows
//! and up to four times with those that can count; a tenth of a second to a second.

use std::borrow::Cow;

use super::multipliers::{BoundTarget, Multipliers, Prices, RelaxationSize};
use super::units::Units;
use super::{CoverProblem, is_for_coverage, max_views};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::SelectionParams;
use crate::planning::visibility::Row;

/// Size of the relaxation that every solver gets.
const QUICK: RelaxationSize =
    RelaxationSize { step: 4e6, rows: 400, prices: Some(Prices { step: 2e6, rows: 56, free_rows: 128 }) };

/// Bound on the number of views, or on the area, of any choice from the same candidates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bound {
    /// Lower bound of the views of any choice from the same candidates that reaches the plan's goals, or the area that the plan
    /// measures of those that it does not reach.
    pub views_lower: u32,
    /// Views chosen minus `views_lower`.
    pub gap: u32,
    /// Upper bound of the share of the asked area that `selection.max_views` views can measure; with the best coverage as goal. On the
    /// samples that views are chosen on; of a plan the share that it measures of all samples, and the gap.
    pub of_asked_upper: Option<f64>,
    /// Share by which other views could measure more of the samples that views are chosen on; 0 where the choice is proved best there.
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

/// The fewest views that `goals`, which `views` views meet, ask for by the relaxation alone.
pub(super) fn views_lower(
    problem: &CoverProblem<'_>,
    goals: &[Units],
    views: usize,
    ctx: &Context<'_>,
) -> Result<usize, Cancelled> {
    Ok(Multipliers::relaxed(problem, goals, BoundTarget::FewestViews, (&QUICK, views), ctx)?.views_lower())
}

/// A bound that may still have to be computed.
pub(in crate::planning) enum OpenBound {
    Known(Bound),
    Open(Box<BoundProblem>),
}

/// The sets and goals that a bound is computed from.
pub(in crate::planning) struct BoundProblem {
    /// Samples that each row's view measures.
    rows: Vec<Row>,
    asked_area_mm2: Vec<f64>,
    goals: Vec<Units>,
    /// Views that meet them.
    views: usize,
    /// Number of views that may be chosen, for the best coverage.
    max_views: Option<usize>,
}

impl OpenBound {
    /// The bound of chosen rows of a problem.
    pub(super) fn of(problem: &CoverProblem<'_>, params: &SelectionParams, chosen: &[&Row], rows: Vec<Row>) -> Self {
        let for_coverage = is_for_coverage(params);
        Self::Open(Box::new(BoundProblem {
            rows,
            asked_area_mm2: problem.asked_area_mm2.to_vec(),
            goals: goals_of(problem, chosen, for_coverage),
            views: chosen.len(),
            max_views: for_coverage.then(|| max_views(params)),
        }))
    }

    /// Computes the bound.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn compute(&self, ctx: &Context<'_>) -> Result<Bound, Cancelled> {
        match self {
            Self::Known(bound) => Ok(*bound),
            Self::Open(problem) => problem.bound(ctx),
        }
    }
}

impl BoundProblem {
    fn bound(&self, ctx: &Context<'_>) -> Result<Bound, Cancelled> {
        let problem = CoverProblem {
            rows: self.rows.iter().collect(),
            asked_area_mm2: &self.asked_area_mm2,
            weighted_area_mm2: Cow::Borrowed(&self.asked_area_mm2),
            goals: Vec::new(),
            view_secs: 0.0,
            travel_secs: None,
        };
        let goals = &self.goals;
        let bound = Bound::of_views(views_lower(&problem, goals, self.views, ctx)?, self.views);
        let Some(views) = self.max_views else { return Ok(bound) };
        let largest = Multipliers::relaxed(&problem, goals, BoundTarget::MostArea(views), (&QUICK, usize::MAX), ctx)?;
        Ok(bound.with_max_units(&problem, &goals[0], largest.max_units(views)))
    }
}

impl Bound {
    pub(super) fn of_views(views_lower: usize, views: usize) -> Self {
        let views_lower = views_lower.min(views);
        Self { views_lower: views_lower as u32, gap: (views - views_lower) as u32, ..Self::default() }
    }

    /// The bound beside so many views, at least as many as it was computed for.
    pub(in crate::planning) fn beside(self, views: usize) -> Self {
        Self { gap: (views as u32).saturating_sub(self.views_lower), ..self }
    }

    /// The bound of a plan that measures this share of the asked area, by all samples; `None` where that is not all that the chosen
    /// views measure, and so not what the bound is of.
    pub(in crate::planning) fn of_plan(self, of_asked: Option<f64>) -> Self {
        let gap_of_asked = self.gap_of_asked.filter(|_| of_asked.is_some());
        let of_asked_upper = of_asked.zip(gap_of_asked).map(|(of_asked, gap)| (of_asked + gap).min(1.0));
        Self { of_asked_upper, gap_of_asked, ..self }
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
