//! Chosen views adjusted: chosen again among tilted ones; joined by others where setups share too little surface; slid to where
//! they score higher; chosen again where that leaves them too few good grades; exchanged for others that lie better on the way, and rolled about their axes, for shorter cycles of the same
//! plan.

mod closer;
mod exchange;
mod floors;
mod guard;
mod joins;
mod rolls;
mod slides;

use super::problem::ViewPlanningProblem;

pub(super) use closer::looks_closer;
pub(super) use exchange::exchange_views;
pub(super) use floors::better_graded_choice;
pub(super) use joins::join_setups;
pub(super) use rolls::roll_views;
pub(super) use slides::slide_views;

/// Returns true if the poses of chosen views must stay: what views share, and what they measure under stated errors, would have
/// to be judged anew too.
fn keeps_views(problem: &ViewPlanningProblem<'_>) -> bool {
    let overlap = &problem.params.selection.overlap;
    overlap.min_area_mm2.is_some() || overlap.min_share.is_some() || problem.tolerates_errors()
}
