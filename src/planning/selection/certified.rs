//! The proof: what exchanges find (`local.rs`), a bound by the linear relaxation (`multipliers.rs`), then branch and bound
//! (`branch.rs`) on "can k views do it" for k upwards from the bound, until k views can or those at hand are proved
//! fewest. For the best coverage the question is whether k views cover one unit more. Work is limited; what was proved
//! until then stands.
//!
//! With `selection.overlap` the proof is of the problem without it, and views that it finds are taken only if they are
//! connected.

use super::bound::{Bound, goals_of};
use super::branch::{Answer, Node, search};
use super::classes::Classes;
use super::local::{Budget, Exchange};
use super::multipliers::{Aim, Multipliers, Size};
use super::overlap::Overlap;
use super::score::Scorer;
use super::units::Units;
use super::{CoverProblem, Selection, StopReason, greedy, is_for_coverage, local, max_views, polish};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::{ScoreParams, SelectionParams};
use crate::planning::visibility::Row;

/// The relaxation at the root.
const THOROUGH: Size = Size { step: 2e8, rows: 600 };
/// Pairs of row and class with which branch and bound is begun at most: its memory.
const MAX_PAIRS: usize = 30_000_000;

pub(super) fn select(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    weights: &ScoreParams,
    ctx: &Context<'_>,
) -> Result<Selection, Cancelled> {
    let scorer = Scorer::new(problem, params, weights);
    let mut found = local::search(&scorer, params, ctx)?;
    let overlap = Overlap::new(problem, &params.overlap);
    let mut proof = Proof { problem, overlap: &overlap, left: u64::from(params.work_limit) * 1_000_000, ctx };
    let bound = if is_for_coverage(params) {
        proof.most_area(&mut found.rows, max_views(params))?
    } else {
        proof.fewest_views(&mut found.rows)?
    };
    let rows = measured(problem, &found.rows);
    let goals = goals_of(problem, &rows, is_for_coverage(params));
    let exchange = Exchange { problem, goals: &goals, overlap: &overlap };
    let rows = polish::run(&scorer, &exchange, found.rows, &mut Budget { left: u64::MAX }, ctx)?;
    let stopped_because = match found.stopped_because {
        StopReason::MaxViews if rows.len() < max_views(params) && !is_for_coverage(params) => StopReason::Target,
        reason => reason,
    };
    Ok(Selection { choices: greedy::order(&scorer, &rows, ctx)?, stopped_because, bound })
}

fn measured<'a>(problem: &CoverProblem<'a>, rows: &[usize]) -> Vec<&'a Row> {
    rows.iter().map(|row| problem.rows[*row]).collect()
}

struct Proof<'a> {
    problem: &'a CoverProblem<'a>,
    overlap: &'a Overlap<'a>,
    /// Work that may still be done: pairs of row and class looked at.
    left: u64,
    ctx: &'a Context<'a>,
}

impl Proof<'_> {
    /// Raises the bound to the number of views, or finds fewer.
    fn fewest_views(&mut self, rows: &mut Vec<usize>) -> Result<Bound, Cancelled> {
        let goals = goals_of(self.problem, &measured(self.problem, rows), false);
        let multipliers = Multipliers::relaxed(self.problem, &goals, Aim::FewestViews, &THOROUGH, self.ctx)?;
        let mut lower = multipliers.views_lower(self.problem);
        let Some(question) = self.question(&goals, &multipliers, lower < rows.len()) else {
            return Ok(Bound::of_views(lower, rows.len()));
        };
        while lower < rows.len() {
            let accepts = |taken: &[u32]| {
                let rows = question.rows_of(taken);
                goals.iter().all(|goal| goal.covered_by(&measured(self.problem, &rows)) >= goal.needed)
            };
            match search(question.node(multipliers.slack, lower), &accepts, &mut self.left, self.ctx)? {
                Answer::Refuted => lower += 1,
                Answer::Found(taken) => {
                    let fewer = question.rows_of(&taken);
                    if self.overlap.connects(&fewer) {
                        *rows = fewer;
                    }
                    break;
                }
                Answer::Open(_) => break,
            }
        }
        Ok(Bound::of_views(lower, rows.len()))
    }

    /// Lowers what `views` views can cover to what is covered, or finds better ones.
    fn most_area(&mut self, rows: &mut Vec<usize>, views: usize) -> Result<Bound, Cancelled> {
        let problem = self.problem;
        let mut goal = goals_of(problem, &measured(problem, rows), true);
        let multipliers = Multipliers::relaxed(problem, &goal, Aim::MostArea(views), &THOROUGH, self.ctx)?;
        let mut most = multipliers.most_units(problem, views).min(goal[0].measured);
        let question = self.question(&goal, &multipliers, most > goal[0].needed);
        while let Some(question) = question.as_ref().filter(|_| most > goal[0].needed) {
            let asked = goal[0].needed + 1;
            match search(question.node(goal[0].total - asked, views), &|_| true, &mut self.left, self.ctx)? {
                Answer::Refuted => most = goal[0].needed,
                Answer::Found(taken) => {
                    let better = question.rows_of(&taken);
                    let covered = goal[0].covered_by(&measured(problem, &better));
                    if !self.overlap.connects(&better) {
                        break;
                    }
                    (goal[0].needed, *rows) = (covered, better);
                }
                Answer::Open(excess) => {
                    most = most.min(asked.saturating_add(excess));
                    break;
                }
            }
        }
        let fewest = Multipliers::relaxed(problem, &goal, Aim::FewestViews, &THOROUGH, self.ctx)?;
        Ok(Bound::of_views(fewest.views_lower(problem), rows.len()).with_most(problem, &goal[0], most))
    }

    /// The table for branch and bound; none where it is not wanted or would be too large.
    fn question(&self, goals: &[Units], multipliers: &Multipliers, wanted: bool) -> Option<Question> {
        let pairs: usize = self.problem.rows.iter().map(|row| row.count()).sum();
        if !wanted || pairs > MAX_PAIRS {
            return None;
        }
        let all: Vec<u32> = (0..multipliers.units.len() as u32).collect();
        let rows: Vec<usize> = (0..self.problem.rows.len()).collect();
        let classes = Classes::new(self.problem, goals, &all, &rows);
        let (mut units, mut prices) = (vec![0; classes.len()], vec![0; classes.len()]);
        let mut beyond = 0;
        for (sample, class) in classes.of_sample.iter().enumerate() {
            match *class {
                Classes::NONE => beyond += multipliers.units[sample],
                class => {
                    units[class as usize] += multipliers.units[sample];
                    prices[class as usize] += multipliers.prices[sample];
                }
            }
        }
        Some(Question { classes, units, prices, beyond })
    }
}

/// A table with its prices.
struct Question {
    classes: Classes,
    units: Vec<i64>,
    prices: Vec<i64>,
    /// Units of samples that no row measures.
    beyond: i64,
}

impl Question {
    /// Whether `views` views leave at most `slack` units open.
    fn node(&self, slack: i64, views: usize) -> Node {
        Node {
            ids: (0..self.classes.rows.len() as u32).collect(),
            of_row: self.classes.of_row.clone(),
            units: self.units.clone(),
            prices: self.prices.clone(),
            slack: slack - self.beyond,
            views,
            taken: Vec::new(),
            excess: i64::MAX / 4,
        }
    }

    fn rows_of(&self, taken: &[u32]) -> Vec<usize> {
        let mut rows: Vec<usize> = taken.iter().map(|id| self.classes.rows[*id as usize]).collect();
        rows.sort_unstable();
        rows
    }
}
