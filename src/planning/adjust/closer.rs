//! A closer look beside a draft: the views of a first choice are tilted to all sides, and views are chosen again among all. The second
//! choice stands unless it takes more views, since the tilted views measure surface that nothing else does and that the target counts
//! then; in that case the tilted views are forgotten.
//!
//! `candidates.look_closer` = `false` chooses once. Plans that ask for overlap, or for views that tolerate stated errors, are chosen at once, as are those of the plain greedy rule,
//! those for the best coverage, and those of given poses; so are choices without candidates that have no path.
//!
//! Cost: a choice without its search for the best score, and eight views evaluated for each that it takes.

use std::collections::BTreeSet;

use crate::planning::context::{Context, PlanError};
use crate::planning::ids::CandidateIndex;
use crate::planning::params::{SelectionGoal, Solver, Standoff};
use crate::planning::problem::{ChosenViews, SampledPart, ViewPlanningProblem};
use crate::planning::setups::Setup;

/// Views chosen among the candidates and, where that takes no more of them, those beside a draft, which then are candidates too.
///
/// # Errors
/// [`PlanError::Cancelled`].
pub(in crate::planning) fn select_beside_draft(
    problem: &mut ViewPlanningProblem<'_>,
    (sampled, setups): (&SampledPart, &[Setup<'_>]),
    excluded: &BTreeSet<CandidateIndex>,
    ctx: &Context<'_>,
) -> Result<ChosenViews, PlanError> {
    if !looks_closer(problem, excluded) {
        return problem.select(excluded, ctx);
    }
    let known = problem.known();
    let of_draft = problem.look_beside_draft(sampled, setups, excluded, ctx)?;
    let chosen = problem.select(excluded, ctx)?;
    if chosen.candidates.len() <= of_draft {
        return Ok(chosen);
    }
    problem.forget_from(known);
    problem.select(excluded, ctx)
}

fn looks_closer(problem: &ViewPlanningProblem<'_>, excluded: &BTreeSet<CandidateIndex>) -> bool {
    let params = problem.params;
    let exchanges = matches!(params.selection.solver, Solver::Local | Solver::Certified);
    let is_for_few_views = params.selection.goal != SelectionGoal::BestCoverage;
    let is_asked_for = params.candidates.look_closer && params.candidates.standoff == Standoff::Surface;
    exchanges && is_for_few_views && is_asked_for && excluded.is_empty() && !super::keeps_views(problem)
}
