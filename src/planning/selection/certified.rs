//! The proof: views from exchanges (`local.rs`), a bound by the linear relaxation (`multipliers.rs`), then branch and bound
//! (`branch.rs`) on whether k views suffice, for k upwards from the bound, until k views do or those at hand are proved
//! fewest. For the best coverage it decides whether k views cover one unit more. Work is limited; whatever was proved
//! until then stands.
//!
//! With `selection.overlap` the proof is of the problem without it, and views that it finds are taken only if they are
//! connected.

use std::sync::Arc;

use super::bound::{self, Bound, OpenBound, goals_of};
use super::branch::{CoverResult, SearchNode, search};
use super::classes::Classes;
use super::grade_floor::GradeFloor;
use super::local::{Budget, Exchange, ScoredViews};
use super::multipliers::{BoundTarget, Multipliers, RelaxationSize};
use super::overlap::Overlap;
use super::score::Scorer;
use super::units::Units;
use super::{CoverProblem, OpenSelection, StopReason, greedy, is_for_coverage, local, max_views};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{RowIndex, SampleId};
use crate::planning::params::{ScoreParams, SelectionParams};

/// Size of the relaxation at the root.
const THOROUGH: RelaxationSize = RelaxationSize { step: 2e8, rows: 600, prices: None };
/// Pairs of row and class with which branch and bound begins at most: its memory.
const MAX_PAIRS: usize = 30_000_000;

pub(super) fn select(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    weights: &ScoreParams,
    floor: Option<&GradeFloor>,
    ctx: &Context<'_>,
) -> Result<OpenSelection, Cancelled> {
    let scorer = Scorer::new(problem, params, weights, ctx.simd_level());
    let (start, grade_a) = (floor.map(|floor| &floor.start), floor.map(GradeFloor::goal_of_grade_a));
    let mut found = local::search(&scorer, params, (start, grade_a), &mut Budget::of(params), ctx)?;
    let overlap = Overlap::new(problem, &params.overlap);
    let mut proof = Proof { problem, overlap: &overlap, left: u64::from(params.work_limit) * 1_000_000, ctx };
    let bound = if is_for_coverage(params) {
        proof.max_area(&mut found.rows.best, max_views(params))?
    } else {
        proof.fewest_views(&mut found.rows.best)?
    };
    let rows = problem.measured(&found.rows.best);
    let goals = goals_of(problem, &rows, is_for_coverage(params));
    let exchange = Exchange { problem, goals: &goals, overlap: &overlap };
    let views = local::best_scored(&scorer, &exchange, (found.rows.best, grade_a), &mut Budget { left: u64::MAX }, ctx)?;
    // Fewer views that measure what all that may be chosen did: those that they save are there for more of the goals. Others may
    // add enough to them, though none did to greedy's.
    let may_go_on = match found.stopped_because {
        StopReason::MaxViews => views.best.len() < max_views(params),
        StopReason::Growth => true,
        StopReason::Target | StopReason::NoGain | StopReason::NoPath | StopReason::RegionsUnmet => false,
    };
    let (views, stopped_because) = if may_go_on && !is_for_coverage(params) {
        let more = greedy::select_after(problem, params, weights, &views.best, ctx)?;
        (ScoredViews::only(more.rows()), more.stopped_because)
    } else {
        (views, found.stopped_because)
    };
    let bound = Arc::new(OpenBound::Known(bound.beside(views.best.len())));
    OpenSelection::of(&scorer, &views, (stopped_because, bound), ctx)
}

struct Proof<'a> {
    problem: &'a CoverProblem<'a>,
    overlap: &'a Overlap<'a>,
    /// Work that is left: pairs of row and class evaluated.
    left: u64,
    ctx: &'a Context<'a>,
}

impl Proof<'_> {
    /// Raises the bound to the number of views, or finds fewer.
    fn fewest_views(&mut self, rows: &mut Vec<RowIndex>) -> Result<Bound, Cancelled> {
        let goals = goals_of(self.problem, &self.problem.measured(rows), false);
        let some = bound::decisive(&goals);
        let some = some.as_ref().unwrap_or(&goals);
        if bound::views_lower(self.problem, some, rows.len(), self.ctx)? >= rows.len() {
            return Ok(Bound::of_views(rows.len(), rows.len()));
        }
        let multipliers = Multipliers::relaxed(self.problem, some, BoundTarget::FewestViews, (&THOROUGH, rows.len()), self.ctx)?;
        let mut lower = multipliers.views_lower();
        let Some(instance) = self.instance(some, &multipliers, lower < rows.len()) else {
            return Ok(Bound::of_views(lower, rows.len()));
        };
        while lower < rows.len() {
            let accepts = |taken: &[u32]| {
                let rows = instance.rows_of(taken);
                goals.iter().all(|goal| goal.covered_by(&self.problem.measured(&rows)) >= goal.needed)
            };
            match search(instance.node(multipliers.slack, lower), &accepts, &mut self.left, self.ctx)? {
                CoverResult::Infeasible => lower += 1,
                CoverResult::Found(taken) => {
                    let fewer = instance.rows_of(&taken);
                    if self.overlap.connects(&fewer) {
                        *rows = fewer;
                    }
                    break;
                }
                CoverResult::Open(_) => break,
            }
        }
        Ok(Bound::of_views(lower, rows.len()))
    }

    /// Lowers the bound on the area of `views` views to the covered area, or finds better views.
    fn max_area(&mut self, rows: &mut Vec<RowIndex>, views: usize) -> Result<Bound, Cancelled> {
        let problem = self.problem;
        let mut goal = goals_of(problem, &problem.measured(rows), true);
        let multipliers = Multipliers::relaxed(problem, &goal, BoundTarget::MostArea(views), (&THOROUGH, usize::MAX), self.ctx)?;
        let mut upper = multipliers.max_units(views).min(goal[0].measured);
        let instance = self.instance(&goal, &multipliers, upper > goal[0].needed);
        while let Some(instance) = instance.as_ref().filter(|_| upper > goal[0].needed) {
            let asked = goal[0].needed + 1;
            match search(instance.node(goal[0].total - asked, views), &|_| true, &mut self.left, self.ctx)? {
                CoverResult::Infeasible => upper = goal[0].needed,
                CoverResult::Found(taken) => {
                    let better = instance.rows_of(&taken);
                    let covered = goal[0].covered_by(&problem.measured(&better));
                    if !self.overlap.connects(&better) {
                        break;
                    }
                    (goal[0].needed, *rows) = (covered, better);
                }
                CoverResult::Open(surplus) => {
                    upper = upper.min(asked.saturating_add(surplus));
                    break;
                }
            }
        }
        let fewest = Multipliers::relaxed(problem, &goal, BoundTarget::FewestViews, (&THOROUGH, rows.len()), self.ctx)?;
        Ok(Bound::of_views(fewest.views_lower(), rows.len()).with_max_units(problem, &goal[0], upper))
    }

    /// Makes the instance for branch and bound; `None` where it is not wanted or would be too large.
    fn instance(&self, goals: &[Units], multipliers: &Multipliers, wanted: bool) -> Option<CoverInstance> {
        let pairs: usize = self.problem.rows.iter().map(|row| row.count()).sum();
        if !wanted || pairs > MAX_PAIRS {
            return None;
        }
        let all: Vec<SampleId> = SampleId::first(multipliers.units.len()).collect();
        let rows: Vec<RowIndex> = self.problem.all_rows().collect();
        let classes = Classes::new(self.problem, goals, &all, &rows);
        let (mut units, mut multipliers_of_class) = (vec![0; classes.len()], vec![0; classes.len()]);
        let mut beyond = 0;
        for (sample, class) in classes.of_sample.iter().enumerate() {
            match *class {
                Classes::NONE => beyond += multipliers.units[sample],
                class => {
                    units[class as usize] += multipliers.units[sample];
                    multipliers_of_class[class as usize] += multipliers.values[sample];
                }
            }
        }
        Some(CoverInstance { classes, units, multipliers: multipliers_of_class, beyond })
    }
}

/// An instance of maximum k-cover over classes, with a multiplier of each class.
struct CoverInstance {
    classes: Classes,
    units: Vec<i64>,
    multipliers: Vec<i64>,
    /// Units of samples that no row measures.
    beyond: i64,
}

impl CoverInstance {
    /// The root node of the question if `views` views leave at most `slack` units open.
    fn node(&self, slack: i64, views: usize) -> SearchNode {
        SearchNode {
            ids: (0..self.classes.rows.len() as u32).collect(),
            of_row: self.classes.of_row.clone(),
            units: self.units.clone(),
            multipliers: self.multipliers.clone(),
            slack: slack - self.beyond,
            views,
            taken: Vec::new(),
            surplus: i64::MAX / 4,
        }
    }

    /// Rows of the problem by their places in [`Classes::rows`].
    fn rows_of(&self, taken: &[u32]) -> Vec<RowIndex> {
        let mut rows: Vec<RowIndex> = taken.iter().map(|id| self.classes.rows[*id as usize]).collect();
        rows.sort_unstable();
        rows
    }
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::planning::context::Silent;
    use crate::planning::params::OverlapParams;
    use crate::planning::selection::Goal;
    use crate::planning::visibility::Row;

    /// The last sample is a twin: only a small goal counts it. Of 47 goals 40 entered, and the row that alone measures it beside others
    /// was dropped as one that measures no more: three views were proved fewest where two suffice.
    #[test]
    fn a_row_that_only_a_small_goal_of_many_needs_is_not_dropped_from_the_proof() {
        const SAMPLES: usize = 11;
        let rows = [&[0, 1, 2, 3, 4, 10][..], &[0, 1, 2, 3, 4, 5], &[5, 6, 7, 8, 9], &[10]];
        let rows = rows.map(|samples| Row::from_samples(SAMPLES, samples.iter().map(|sample| (SampleId(*sample), 0.0))));
        let area_mm2: [f64; SAMPLES] = std::array::from_fn(|sample| f64::from(u8::from(sample < 10)));
        let params = SelectionParams::default();
        let mut problem = CoverProblem::new(rows.iter().collect(), &area_mm2, 10.0, &params);
        problem.goals[0].needed_mm2 = 10.0;
        let whole = |area_mm2: Vec<f64>| Goal { needed_mm2: area_mm2.iter().sum(), area_mm2: Cow::Owned(area_mm2) };
        let pair = |a: usize, b: usize| whole((0..SAMPLES).map(|s| f64::from(u8::from(s == a || s == b))).collect());
        problem.goals.extend((0..10).flat_map(|b| (0..b).map(move |a| pair(a, b))));
        problem.goals.push(whole((0..SAMPLES).map(|sample| if sample == 10 { 0.1 } else { 0.0 }).collect()));
        let (overlap_params, flag) = (OverlapParams::default(), AtomicBool::new(false));
        let (overlap, ctx) = (Overlap::new(&problem, &overlap_params), Context::new(&flag, &Silent));
        let mut found = [1, 2, 3].map(RowIndex::at).to_vec();
        let bound = Proof { problem: &problem, overlap: &overlap, left: u64::MAX, ctx: &ctx }.fewest_views(&mut found);
        let bound = bound.unwrap_or_else(|_| unreachable!());
        assert_eq!((bound.views_lower, found), (2, [0, 2].map(RowIndex::at).to_vec()));
    }
}
