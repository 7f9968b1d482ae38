//! The floor under grade A for views as they are slid. Exchanges ask for nearly as much of the better grades as greedy's views
//! give, and both give more of grade A once they are slid: greedy's sometimes the more. Where the views chosen then lose more of it
//! than is permitted, views are chosen again, with greedy's slid views as the first choice. Grades A and B together are not looked
//! at again: on public parts of 300 mm that took up to two views more, and one in three of those gave less of grade A.
//!
//! Cost: greedy's choice, and a view evaluated anew for each that it takes.

use std::collections::BTreeSet;

use super::guard::Guard;
use super::slides::slid;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, RowIndex, ViewId};
use crate::planning::plan::Grade;
use crate::planning::problem::ViewPlanningProblem;
use crate::planning::selection::{self, FirstChoice, GradeFloor};
use crate::planning::setups::Setup;

/// Part of the permitted loss that views may lose when they are chosen again: they are judged on some of the samples, the plan on all.
const MARGIN: f64 = 0.75;

/// Greedy's views, slid, which are candidates too then; `None` where the chosen views give as much of grade A, but for what they may
/// lose.
///
/// # Errors
/// [`Cancelled`].
pub(in crate::planning) fn better_graded_choice(
    problem: &mut ViewPlanningProblem<'_>,
    setups: &[Setup<'_>],
    chosen: &[CandidateIndex],
    excluded: &BTreeSet<CandidateIndex>,
    ctx: &Context<'_>,
) -> Result<Option<FirstChoice>, Cancelled> {
    let (params, score) = (&problem.params.selection, &problem.params.score);
    let Some(max_loss) = GradeFloor::max_loss(params, score).filter(|_| !chosen.is_empty()) else { return Ok(None) };
    let mut choosable = problem.choosable(excluded);
    choosable.retain(|candidate| problem.candidates[*candidate].slid_from.is_none());
    let choices = selection::greedily(&problem.cover_problem(&choosable), params, score, ctx)?;
    let greedy: Vec<CandidateIndex> = choices.iter().map(|choice| choosable[choice.row.index()]).collect();
    let known = problem.known();
    let greedy = slid(problem, setups, &greedy, ctx)?;
    let [of_chosen, of_greedy] = [chosen, &greedy].map(|views| Guard::new(problem, ViewId::number(views.iter().copied())));
    let may_lose_mm2 = max_loss * problem.asked_area_mm2.iter().sum::<f64>();
    if of_chosen.area_mm2(problem, Grade::A) >= of_greedy.area_mm2(problem, Grade::A) - may_lose_mm2 {
        problem.forget_from(known);
        return Ok(None);
    }
    let choosable = problem.choosable(excluded);
    let place = |candidate| choosable.binary_search(candidate).ok().map(RowIndex::at);
    Ok(Some(FirstChoice::with_max_loss(greedy.iter().filter_map(place).collect(), MARGIN * max_loss)))
}
