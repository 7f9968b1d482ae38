//! Local search for fewer views: greedy by area, redundant views removed, then with one view less exchanges of one view for
//! another until the goals are met again, or work ends (tabu search: Glover 1989; for covering with a fixed number of views:
//! Resende 1998, Galinier and Hertz 2007). The best views are exchanged for a higher score at last (`improve_score.rs`).
//!
//! Deterministic: ties go to the lower rows, tenures come from a hash of the step, and the limit counts work. Cost: a step
//! passes over the open and the singly covered samples of every row.

use rayon::prelude::*;

use super::greedy::{self, BatchQueue};
use super::improve_score;
use super::overlap::Overlap;
use super::score::Scorer;
use super::units::Units;
use super::{Cover, CoverProblem, StopReason, is_for_coverage, max_views};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::RowIndex;
use crate::planning::params::{ScoreParams, SelectionParams};
use crate::planning::visibility::{Row, ones};

/// Work of an attempt with one view less: pairs of sample and row evaluated.
const ATTEMPT_WORK: u64 = 400_000_000;
/// Steps of an attempt: a minimum however large the table, a maximum, and its increase for each row.
const MIN_STEPS: u64 = 8;
const MAX_STEPS: u64 = 100;
const STEPS_A_ROW: u64 = 8;
/// Rows of a table that one thread takes at once.
const ROWS_A_TASK: usize = 16;

pub(super) fn select(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    weights: &ScoreParams,
    start: Option<&Cover>,
    ctx: &Context<'_>,
) -> Result<Cover, Cancelled> {
    let scorer = Scorer::new(problem, params, weights);
    let found = search(&scorer, params, start, ctx)?;
    Ok(Cover { choices: greedy::order(&scorer, &found.rows, ctx)?, stopped_because: found.stopped_because })
}

/// Views without their order.
pub(super) struct LocalOptimum {
    pub(super) rows: Vec<RowIndex>,
    pub(super) stopped_because: StopReason,
}

/// The best views that exchanges find, begun at `start`, or where greedy by area ends.
pub(super) fn search(
    scorer: &Scorer<'_>,
    params: &SelectionParams,
    start: Option<&Cover>,
    ctx: &Context<'_>,
) -> Result<LocalOptimum, Cancelled> {
    let problem = scorer.problem;
    let by_area = || greedy::run(BatchQueue::new(problem.rows.len()), &scorer.by_area(), params, ctx);
    let start = start.map_or_else(by_area, |start| Ok(start.clone()))?;
    let overlap = Overlap::new(problem, &params.overlap);
    let mut rows: Vec<RowIndex> = start.choices.iter().map(|choice| choice.row).collect();
    let mut stopped_because = start.stopped_because;
    let mut goals = Units::of_goals(problem);
    let mut budget = Budget { left: u64::from(params.work_limit) * 1_000_000 };
    let limited = stopped_because == StopReason::MaxViews && rows.len() == max_views(params);
    if is_for_coverage(params) {
        goals.truncate(1);
        goals.iter_mut().for_each(|goal| goal.needed = goal.total);
    }
    if limited && !rows.is_empty() {
        rows = Exchange { problem, goals: &goals, overlap: &overlap }.run(rows, &mut budget, ctx)?;
    }
    let measured = problem.measured(&rows);
    goals.iter_mut().for_each(|goal| goal.clamp_to(&measured));
    if !is_for_coverage(params) {
        if limited && problem.goals.len() == goals.len() && are_met(problem, &measured) {
            stopped_because = StopReason::Target;
        }
        rows = Exchange { problem, goals: &goals, overlap: &overlap }.fewer(rows, &mut budget, ctx)?;
    }
    let rows = improve_score::run(scorer, &Exchange { problem, goals: &goals, overlap: &overlap }, rows, &mut budget, ctx)?;
    Ok(LocalOptimum { rows, stopped_because })
}

fn are_met(problem: &CoverProblem<'_>, measured: &[&Row]) -> bool {
    Units::of_goals(problem).iter().all(|goal| goal.covered_by(measured) >= goal.needed)
}

/// Work that is left, counted as in [`ATTEMPT_WORK`].
pub(super) struct Budget {
    pub(super) left: u64,
}

impl Budget {
    pub(super) fn spend(&mut self, work: u64) {
        self.left = self.left.saturating_sub(work);
    }
}

/// Exchanges of one view for another.
pub(super) struct Exchange<'a> {
    pub(super) problem: &'a CoverProblem<'a>,
    pub(super) goals: &'a [Units],
    pub(super) overlap: &'a Overlap<'a>,
}

impl Exchange<'_> {
    /// Meets the same goals with as few views as are found.
    pub(super) fn fewer(&self, rows: Vec<RowIndex>, budget: &mut Budget, ctx: &Context<'_>) -> Result<Vec<RowIndex>, Cancelled> {
        let mut best = self.remove_redundant(rows, ctx)?;
        while best.len() > 1 && budget.left > 0 {
            let Some(start) = self.remove_one(&best) else { break };
            let found = self.run(start, budget, ctx)?;
            if self.deficit(&found) > 0 || !self.overlap.connects(&found) {
                break;
            }
            best = self.remove_redundant(found, ctx)?;
        }
        Ok(best)
    }

    /// Removes redundant views, the last first, as long as the goals stay met.
    fn remove_redundant(&self, mut rows: Vec<RowIndex>, ctx: &Context<'_>) -> Result<Vec<RowIndex>, Cancelled> {
        let mut state = CoverState::new(self, &rows);
        for at in (0..rows.len()).rev() {
            ctx.check()?;
            if rows.len() == 1 || state.deficit_without(at) > 0 {
                continue;
            }
            let fewer = without(&rows, at);
            if self.overlap.connects(&fewer) {
                rows = fewer;
                state = CoverState::new(self, &rows);
            }
        }
        Ok(rows)
    }

    /// Removes the view whose loss leaves the smallest deficit.
    fn remove_one(&self, rows: &[RowIndex]) -> Option<Vec<RowIndex>> {
        let state = CoverState::new(self, rows);
        let fewer = (0..rows.len()).map(|at| (state.deficit_without(at), without(rows, at)));
        let allowed = fewer.filter(|(_, fewer)| self.overlap.connects(fewer));
        allowed.min_by_key(|(deficit, _)| *deficit).map(|(_, fewer)| fewer)
    }

    /// Tabu search from `rows`; returns the best that it finds.
    fn run(&self, mut rows: Vec<RowIndex>, budget: &mut Budget, ctx: &Context<'_>) -> Result<Vec<RowIndex>, Cancelled> {
        let mut tabu = vec![0_u64; self.problem.rows.len()];
        let mut best = (CoverState::new(self, &rows).deficit(), rows.clone());
        let mut spent = 0;
        for step in 1..=MAX_STEPS + STEPS_A_ROW * tabu.len() as u64 {
            if best.0 == 0 || (spent > ATTEMPT_WORK || budget.left == 0) && step > MIN_STEPS {
                break;
            }
            let swaps = Swaps::new(self, &rows, ctx)?;
            spent += swaps.work;
            budget.spend(swaps.work);
            let chosen = swaps.best(|at, row, deficit| {
                let allowed = deficit < best.0 || (tabu[row.index()] < step && tabu[rows[at].index()] < step);
                allowed && self.connects(&rows, at, row)
            });
            let Some((at, row, deficit)) = chosen else { continue };
            let noise = mixed(step);
            tabu[rows[at].index()] = step + 4 + noise % 8;
            tabu[row.index()] = step + 1 + noise / 8 % (rows.len() as u64 / 2 + 1);
            rows[at] = row;
            if deficit < best.0 {
                best = (deficit, rows.clone());
            }
        }
        Ok(best.1)
    }

    /// Units by which `rows` miss the goals.
    pub(super) fn deficit(&self, rows: &[RowIndex]) -> i64 {
        CoverState::new(self, rows).deficit()
    }

    /// A deficit as area.
    pub(super) fn deficit_mm2(&self, deficit: i64) -> f64 {
        self.goals.first().map_or(0.0, |goal| goal.area_mm2(deficit))
    }

    /// Returns true if `rows` with the one at `at` exchanged may be chosen together.
    pub(super) fn connects(&self, rows: &[RowIndex], at: usize, row: RowIndex) -> bool {
        let mut exchanged = rows.to_vec();
        exchanged[at] = row;
        self.overlap.connects(&exchanged)
    }
}

/// The rows but the one at `at`.
fn without(rows: &[RowIndex], at: usize) -> Vec<RowIndex> {
    [&rows[..at], &rows[at + 1..]].concat()
}

/// Finaliser of SplitMix64 (Steele, Lea, Flood 2014).
fn mixed(step: u64) -> u64 {
    let mut z = step.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

/// Samples that some views cover, and those that one of them covers alone.
struct CoverState<'a> {
    goals: &'a [Units],
    /// Samples that no view covers, or one alone, as words of bits.
    moving: Vec<u64>,
    /// The view that covers such a sample alone; the number of views where none does. Means nothing for other samples.
    sole: Vec<u16>,
    /// Units of each goal (outer) that each view covers alone.
    lost: Vec<Vec<i64>>,
    /// Units covered of each goal.
    covered: Vec<i64>,
}

impl<'a> CoverState<'a> {
    fn new(exchange: &Exchange<'a>, rows: &[RowIndex]) -> Self {
        let words = exchange.problem.asked_area_mm2.len().div_ceil(64);
        let (mut once, mut twice) = (vec![0_u64; words], vec![0_u64; words]);
        let measured = exchange.problem.measured(rows);
        for row in &measured {
            for ((once, twice), word) in once.iter_mut().zip(&mut twice).zip(row.words()) {
                *twice |= *once & word;
                *once |= word;
            }
        }
        let goals = exchange.goals;
        let mut sole = vec![rows.len() as u16; 64 * words];
        let mut lost = vec![vec![0; rows.len()]; goals.len()];
        for (view, row) in measured.iter().enumerate() {
            for (first, alone) in (0..).step_by(64).zip(row.words().iter().zip(&twice).map(|(word, twice)| word & !twice)) {
                for sample in ones(alone).map(|bit| first + bit as usize) {
                    sole[sample] = view as u16;
                    lost.iter_mut().zip(goals).for_each(|(lost, goal)| lost[view] += goal.of_sample[sample]);
                }
            }
        }
        let covered = goals.iter().map(|goal| units_in(&once, goal)).collect();
        twice.iter_mut().for_each(|word| *word = !*word);
        Self { goals, moving: twice, sole, lost, covered }
    }

    fn deficit(&self) -> i64 {
        self.goals.iter().zip(&self.covered).map(|(goal, covered)| (goal.needed - covered).max(0)).sum()
    }

    /// Deficit of all views but one.
    fn deficit_without(&self, view: usize) -> i64 {
        let of_goals = self.goals.iter().zip(&self.covered).zip(&self.lost);
        of_goals.map(|((goal, covered), lost)| (goal.needed - (covered - lost[view])).max(0)).sum()
    }
}

/// Sums, for each view, the units of the samples that it alone covers and `row` covers too; at last of those that none covers.
fn regained(row: &Row, moving: &[u64], sole: &[u16], goal: &Units, views: usize) -> Vec<i64> {
    let mut sums = vec![0; views + 1];
    let blocks = row.words().iter().zip(moving).zip(sole.chunks_exact(64)).zip(goal.of_sample.chunks(64));
    for (((word, moving), sole), units) in blocks.filter(|(((word, moving), _), _)| *word & *moving != 0) {
        for bit in ones(word & moving) {
            sums[usize::from(sole[bit as usize])] += units[bit as usize];
        }
    }
    sums
}

/// Sums the units of a set of samples, given as words of bits.
fn units_in(samples: &[u64], goal: &Units) -> i64 {
    let words = samples.iter().zip(goal.of_sample.chunks(64));
    words.map(|(word, units)| ones(*word).map(|bit| units[bit as usize]).sum::<i64>()).sum()
}

/// Deficits that every exchange would leave.
pub(super) struct Swaps {
    /// Deficit after the exchange of each view (inner) for each row (outer).
    deficits: Vec<Vec<i64>>,
    pub(super) work: u64,
}

impl Swaps {
    pub(super) fn new(exchange: &Exchange<'_>, rows: &[RowIndex], ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let (views, goals) = (rows.len(), exchange.goals);
        let CoverState { moving, sole, lost, covered, .. } = CoverState::new(exchange, rows);
        let of_row = |row: &&Row| {
            ctx.check()?;
            let regained: Vec<Vec<i64>> = goals.iter().map(|goal| regained(row, &moving, &sole, goal, views)).collect();
            let seen: usize = row.words().iter().zip(&moving).map(|(word, moving)| (word & moving).count_ones() as usize).sum();
            let work = (moving.len() / 4 + seen * goals.len()) as u64;
            let deficit = |view: usize| {
                let of_goals = goals.iter().zip(&covered).zip(&lost).zip(&regained);
                of_goals
                    .map(|(((goal, covered), lost), regained)| {
                        (goal.needed - (covered - lost[view] + regained[view] + regained[views])).max(0)
                    })
                    .sum()
            };
            Ok(((0..views).map(deficit).collect::<Vec<i64>>(), work))
        };
        let of_rows =
            exchange.problem.rows.par_iter().with_min_len(ROWS_A_TASK).map(of_row).collect::<Result<Vec<_>, Cancelled>>()?;
        let work = of_rows.iter().map(|(_, work)| work).sum();
        let mut deficits: Vec<Vec<i64>> = of_rows.into_iter().map(|(deficits, _)| deficits).collect();
        rows.iter().for_each(|row| deficits[row.index()].clear());
        Ok(Self { deficits, work })
    }

    /// Lists every exchange of a view for a row that is not chosen: position of the view, row, and the deficit after it.
    pub(super) fn all(&self) -> impl Iterator<Item = (usize, RowIndex, i64)> + '_ {
        RowIndex::number(&self.deficits)
            .flat_map(|(row, deficits)| deficits.iter().enumerate().map(move |(at, deficit)| (at, row, *deficit)))
    }

    /// The allowed exchange with the least deficit; the first among equals.
    fn best(&self, allowed: impl Fn(usize, RowIndex, i64) -> bool) -> Option<(usize, RowIndex, i64)> {
        let mut best: Option<(usize, RowIndex, i64)> = None;
        for (at, row, deficit) in self.all() {
            if best.is_none_or(|best| deficit < best.2) && allowed(at, row, deficit) {
                best = Some((at, row, deficit));
            }
        }
        best
    }
}
