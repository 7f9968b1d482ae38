//! A closer look beside a first choice: its views are tilted to all sides, and views are chosen again among all. The second choice
//! gives the better grades as much area as the floors of the first ask for.
//!
//! Only where `candidates.look_closer` asks for it: fewer views look more obliquely. By a scanner that returns all up to 65° and nothing
//! beyond 80°, 14 views of the gearbox housing with tilted ones among them measure 87.6 %, 17 without 92.6 % (`tests/it/closed_loop.rs`).
//! Not for overlap, views that tolerate stated errors, the plain greedy rule, the best coverage, or other stand-offs.
//!
//! Cost: a choice without its search for the best score, and eight views evaluated for each that it takes.

use crate::planning::params::{SelectionGoal, Solver, Standoff};
use crate::planning::problem::ViewPlanningProblem;

/// Returns true if views are chosen again among those beside a first choice.
pub(in crate::planning) fn looks_closer(problem: &ViewPlanningProblem<'_>) -> bool {
    let params = problem.params;
    let exchanges = matches!(params.selection.solver, Solver::Local | Solver::Certified);
    let is_for_few_views = params.selection.goal != SelectionGoal::BestCoverage;
    let is_asked_for = params.candidates.look_closer && params.candidates.standoff == Standoff::Surface;
    exchanges && is_for_few_views && is_asked_for && !super::keeps_views(problem)
}
