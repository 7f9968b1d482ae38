//! Lazy greedy: a priority queue of upper bounds, of which the first is evaluated again and is the best once it
//! stays in front (Minoux 1978; as CELF in Leskovec et al. 2007, *Cost-effective Outbreak Detection in Networks*). The
//! choices are always those of greedy, since the upper bound of a candidate is never less than its score.
//!
//! One thread; it scores fewer candidates than greedy, which takes them sixteen at a time.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

use super::greedy::{CandidateQueue, Round, precedes, run};
use super::overlap::Overlap;
use super::score::Scorer;
use super::{Cover, CoverProblem};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::RowIndex;
use crate::planning::params::{ScoreParams, SelectionParams};

pub(super) fn select(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    weights: &ScoreParams,
    ctx: &Context<'_>,
) -> Result<Cover, Cancelled> {
    run(LazyQueue::new(problem.rows.len()), &Scorer::new(problem, params, weights, ctx.simd_level()), params, &[], ctx)
}

/// Candidates by the upper bounds of their scores.
struct LazyQueue {
    heap: BinaryHeap<Entry>,
}

/// A row and the upper bound of its score; the lower row is the greater among equals.
#[derive(PartialEq)]
struct Entry(f64, Reverse<RowIndex>);

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0).then(self.1.cmp(&other.1))
    }
}

impl LazyQueue {
    fn new(rows: usize) -> Self {
        Self { heap: RowIndex::first(rows).map(|row| Entry(f64::INFINITY, Reverse(row))).collect() }
    }
}

impl CandidateQueue for LazyQueue {
    fn best(
        &mut self,
        round: &Round<'_>,
        overlap: &Overlap<'_>,
        ctx: &Context<'_>,
    ) -> Result<Option<(RowIndex, f64)>, Cancelled> {
        let mut best: Option<(RowIndex, f64)> = None;
        let mut scored = Vec::new();
        while let Some(Entry(upper_bound, Reverse(row))) = self.heap.pop() {
            if best.is_some_and(|best| precedes(best, (row, upper_bound))) {
                scored.push(Entry(upper_bound, Reverse(row)));
                break;
            }
            ctx.check()?;
            let upper_bound = round.scorer.score(row, &round.open);
            let score = round.net_score(row, upper_bound);
            let leads = score > 0.0 && best.is_none_or(|best| precedes((row, score), best));
            if leads && !round.chosen.contains(&row) && overlap.joins(row, &round.chosen) {
                best = Some((row, score));
            }
            let next = if round.scorer.scores_only_fall(row) { upper_bound } else { f64::INFINITY };
            scored.push(Entry(next, Reverse(row)));
        }
        self.heap.extend(scored);
        Ok(best)
    }
}
