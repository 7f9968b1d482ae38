//! Local search for fewer views: greedy by score where grades have floors, as by default, else by area; redundant views removed,
//! then with one view less exchanges of one view for another until the goals are met again, or work ends (tabu search: Glover
//! 1989; for covering with a fixed number of views: Resende 1998, Galinier and Hertz 2007). The best views are exchanged for a
//! higher score at last (`improve_score.rs`).
//!
//! Deterministic: ties go to the lower rows, tenures come from a hash of the step, and the limit counts work. Cost: the first step
//! passes over the open and the singly covered samples of every row, 64 at a time; each further step over those that the exchange before
//! it opened, covered, or left to one view. The limit counts every step as the first.

use std::ops::Range;

use rayon::prelude::*;

use super::blocks::{BLOCK, BlockSegment, change_sums, masked_sum, segment_sums};
use super::greedy::{self, BatchQueue};
use super::improve_score;
use super::overlap::Overlap;
use super::score::Scorer;
use super::units::Units;
use super::{Cover, CoverProblem, StopReason, is_for_coverage, max_views};
use crate::geometry::{SimdLevel, parallel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{RowIndex, ViewId};
use crate::planning::params::{SelectionParams, Solver};
use crate::planning::visibility::Row;

/// Work of an attempt with one view less: pairs of sample and row evaluated.
const ATTEMPT_WORK: u64 = 400_000_000;
/// Attempts with one view less, each begun without another view, where views are this many; of fewer views there is one. Among tilted
/// candidates too, one attempt left 18 and 18 views of two public parts where three left 16 and 17, and six no fewer.
const ATTEMPTS: u64 = 3;
const MANY_VIEWS: usize = 12;
/// Steps of an attempt: a minimum however large the table, a maximum, and its increase for each row.
const MIN_STEPS: u64 = 8;
const MAX_STEPS: u64 = 100;
const STEPS_A_ROW: u64 = 8;
/// Pairs of sample and row that a segment of a row counts for: most rows measure nothing of it, others all of its 64.
const PAIRS_A_SEGMENT: u64 = 8;
/// Share of the asked area by which views with more at grade A are looked for, half of it after an attempt that finds none with a higher
/// score; attempts at most, and those of them that find none. Of 200 plans of public parts grade A rose by 1.5 points on average.
const RAISE: f64 = 0.05;
const MAX_RAISES: u64 = 4;
const MAX_FAILURES: u32 = 2;
/// Blocks whose segments a thread finds at once.
const BLOCKS_A_TASK: usize = 64;
/// Numbers of [`KeptUnits`] at most, 32 MB; of larger tables with many views or regions every step computes them anew.
const MAX_KEPT_UNITS: usize = 4_000_000;
/// Rows of a table that one thread takes at once.
const ROWS_A_TASK: usize = 16;

/// Views without their order.
pub(super) struct LocalOptimum {
    pub(super) rows: ScoredViews,
    pub(super) stopped_because: StopReason,
}

/// Views of a high score.
pub(super) struct ScoredViews {
    pub(super) best: Vec<RowIndex>,
    /// Views of the highest score before more area at grade A was looked for, where these are others.
    pub(super) before_raise: Option<Vec<RowIndex>>,
}

impl ScoredViews {
    /// Makes views beside which no others were looked for.
    pub(super) fn only(best: Vec<RowIndex>) -> Self {
        Self { best, before_raise: None }
    }
}

/// The best views that exchanges find, begun at `start`, or where greedy by area ends: the fewest, and of as many those of the highest
/// score ([`best_scored`]).
pub(super) fn search(
    scorer: &Scorer<'_>,
    params: &SelectionParams,
    (start, grade_a): (Option<&Cover>, Option<usize>),
    budget: &mut Budget,
    ctx: &Context<'_>,
) -> Result<LocalOptimum, Cancelled> {
    let problem = scorer.problem;
    let (found, goals) = fewest(scorer, params, (start, grade_a), budget, ctx)?;
    let overlap = Overlap::new(problem, &params.overlap);
    let exchange = Exchange { problem, goals: &goals, overlap: &overlap };
    // Certified looks for more at grade A after its proof.
    let raised = grade_a.filter(|_| params.solver != Solver::Certified);
    let rows = best_scored(scorer, &exchange, (found.rows.best, raised), budget, ctx)?;
    Ok(LocalOptimum { rows, ..found })
}

/// Finds as many views of the highest score: by exchanges from the views at hand, then from others, as many, with more area at grade A
/// than the best have, and no less at A or B. Those are mostly better covers that single exchanges do not lead to. `grade_a` is the place
/// of the floor under grade A among the goals; without it no others are looked for.
pub(super) fn best_scored(
    scorer: &Scorer<'_>,
    exchange: &Exchange<'_>,
    (rows, grade_a): (Vec<RowIndex>, Option<usize>),
    budget: &mut Budget,
    ctx: &Context<'_>,
) -> Result<ScoredViews, Cancelled> {
    let (mut score, mut best) = improve_score::run(scorer, exchange, rows, budget, ctx)?;
    let Some(grade_a) = grade_a else { return Ok(ScoredViews::only(best)) };
    let mut before_raise = None;
    let (mut raise, mut failures) = (RAISE, 0);
    for attempt in 0..MAX_RAISES {
        let (mut goals, measured) = (exchange.goals.to_vec(), exchange.problem.measured(&best));
        // Nothing of the other floors is given up for it.
        goals[grade_a..].iter_mut().for_each(|floor| floor.needed = floor.covered_by(&measured));
        let goal = &mut goals[grade_a];
        goal.needed = goal.needed.saturating_add((raise * goal.total as f64) as i64);
        if goal.needed > goal.measured || budget.left == 0 {
            break;
        }
        let raised = Exchange { goals: &goals, ..*exchange };
        let found = raised.run(best.clone(), attempt, budget, ctx)?;
        let is_met = raised.deficit(&found) == 0 && raised.overlap.connects(&found);
        let found = is_met.then(|| improve_score::run(scorer, &raised, found, budget, ctx)).transpose()?;
        if let Some((higher, found)) = found.filter(|(found, _)| *found > score) {
            before_raise.get_or_insert(std::mem::replace(&mut best, found));
            score = higher;
            continue;
        }
        (raise, failures) = (raise / 2.0, failures + 1);
        if failures == MAX_FAILURES {
            break;
        }
    }
    Ok(ScoredViews { best, before_raise })
}

/// The fewest views that exchanges find, whatever their score, and the goals that they meet. `grade_a` as in [`best_scored`].
pub(super) fn fewest(
    scorer: &Scorer<'_>,
    params: &SelectionParams,
    (start, grade_a): (Option<&Cover>, Option<usize>),
    budget: &mut Budget,
    ctx: &Context<'_>,
) -> Result<(LocalOptimum, Vec<Units>), Cancelled> {
    let problem = scorer.problem;
    let by_area = || greedy::run(BatchQueue::new(problem.rows.len()), &scorer.by_area(), params, &[], ctx);
    let start = start.map_or_else(by_area, |start| Ok(start.clone()))?;
    let overlap = Overlap::new(problem, &params.overlap);
    let mut rows = start.rows();
    let mut stopped_because = start.stopped_because;
    let mut goals = Units::of_goals(problem);
    let limited = stopped_because == StopReason::MaxViews && rows.len() == max_views(params);
    if is_for_coverage(params) {
        goals.truncate(1);
        goals.iter_mut().for_each(|goal| goal.needed = goal.total);
    }
    if limited && !rows.is_empty() {
        rows = Exchange { problem, goals: &goals, overlap: &overlap }.with_less_missed(rows, grade_a, budget, ctx)?;
    }
    let measured = problem.measured(&rows);
    goals.iter_mut().for_each(|goal| goal.clamp_to(&measured));
    if !is_for_coverage(params) {
        // What is asked for at grade A is no target.
        if limited && problem.goals.len() == goals.len() && are_met(problem, grade_a, &measured) {
            stopped_because = StopReason::Target;
        }
        rows = Exchange { problem, goals: &goals, overlap: &overlap }.fewer(rows, budget, ctx)?;
    }
    Ok((LocalOptimum { rows: ScoredViews::only(rows), stopped_because }, goals))
}

/// Returns true if the goals before the floor under grade A are met.
fn are_met(problem: &CoverProblem<'_>, grade_a: Option<usize>, measured: &[&Row]) -> bool {
    let goals = Units::of_goals(problem);
    goals.iter().take(grade_a.unwrap_or(goals.len())).all(|goal| goal.covered_by(measured) >= goal.needed)
}

/// Work that is left, counted as in [`ATTEMPT_WORK`].
pub(super) struct Budget {
    pub(super) left: u64,
}

impl Budget {
    /// All work that a choice may take.
    pub(super) fn of(params: &SelectionParams) -> Self {
        Self { left: u64::from(params.work_limit) * 1_000_000 }
    }

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
            let Some(found) = self.one_fewer(&best, budget, ctx)? else { break };
            best = self.remove_redundant(found, ctx)?;
        }
        Ok(best)
    }

    /// Meets the goals with one view less, if an attempt finds how.
    fn one_fewer(&self, rows: &[RowIndex], budget: &mut Budget, ctx: &Context<'_>) -> Result<Option<Vec<RowIndex>>, Cancelled> {
        let attempts = if rows.len() < MANY_VIEWS { 1 } else { ATTEMPTS };
        for (attempt, start) in (0..attempts).zip(self.without_one(rows)) {
            let found = self.run(start, attempt, budget, ctx)?;
            if self.deficit(&found) == 0 && self.overlap.connects(&found) {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    /// Exchanges as many views as there may be until they miss the goals by as little as is found. The goals before the floor under grade A
    /// are missed by no more than `rows` miss them, all in all: with a floor that is too high for that, attempts go half as far.
    fn with_less_missed(
        &self,
        rows: Vec<RowIndex>,
        grade_a: Option<usize>,
        budget: &mut Budget,
        ctx: &Context<'_>,
    ) -> Result<Vec<RowIndex>, Cancelled> {
        let measured = self.problem.measured(&rows);
        let lacking = |goal: &Units, measured: &[&Row]| (goal.needed - goal.covered_by(measured)).max(0);
        let is_raised = |place: &usize| self.goals.get(*place).is_some_and(|floor| lacking(floor, &measured) > 0);
        let Some(grade_a) = grade_a.filter(is_raised) else { return self.run(rows, 0, budget, ctx) };
        let missed = |measured: &[&Row]| self.goals[..grade_a].iter().map(|goal| lacking(goal, measured)).sum::<i64>();
        let (missed_before, covered) = (missed(&measured), self.goals[grade_a].covered_by(&measured));
        let mut goals = self.goals.to_vec();
        for attempt in 0..MAX_RAISES {
            let found = Exchange { goals: &goals, ..*self }.run(rows.clone(), attempt, budget, ctx)?;
            if missed(&self.problem.measured(&found)) <= missed_before {
                return Ok(found);
            }
            goals[grade_a].needed = i64::midpoint(goals[grade_a].needed, covered);
        }
        Ok(rows)
    }

    /// Removes redundant views, the last first, as long as the goals stay met.
    fn remove_redundant(&self, mut rows: Vec<RowIndex>, ctx: &Context<'_>) -> Result<Vec<RowIndex>, Cancelled> {
        let mut state = CoverState::new(self, &rows);
        for view in ViewId::first(rows.len()).rev() {
            ctx.check()?;
            if rows.len() == 1 || state.deficit_without(view) > 0 {
                continue;
            }
            let fewer = without(&rows, view);
            if self.overlap.connects(&fewer) {
                rows = fewer;
                state = CoverState::new(self, &rows);
            }
        }
        Ok(rows)
    }

    /// The views without one of them, by the deficit that its loss leaves, the smallest first.
    fn without_one(&self, rows: &[RowIndex]) -> impl Iterator<Item = Vec<RowIndex>> {
        let state = CoverState::new(self, rows);
        let fewer = ViewId::first(rows.len()).map(|view| (state.deficit_without(view), without(rows, view)));
        let mut allowed: Vec<_> = fewer.filter(|(_, fewer)| self.overlap.connects(fewer)).collect();
        allowed.sort_by_key(|(deficit, _)| *deficit);
        allowed.into_iter().map(|(_, fewer)| fewer)
    }

    /// Tabu search from `rows`, with tenures of its own in each attempt; returns the best that it finds.
    fn run(
        &self,
        mut rows: Vec<RowIndex>,
        attempt: u64,
        budget: &mut Budget,
        ctx: &Context<'_>,
    ) -> Result<Vec<RowIndex>, Cancelled> {
        let mut tabu = vec![0_u64; self.problem.rows.len()];
        let mut best = (CoverState::new(self, &rows).deficit(), rows.clone());
        let mut spent = 0;
        let mut kept: Option<KeptUnits<'_>> = None;
        for step in 1..=MAX_STEPS + STEPS_A_ROW * tabu.len() as u64 {
            if best.0 == 0 || (spent > ATTEMPT_WORK || budget.left == 0) && step > MIN_STEPS {
                break;
            }
            let pricer = SwapPricer::new(self, &rows);
            let work = pricer.work(tabu.len());
            spent += work;
            budget.spend(work);
            let swaps = if tabu.len() * pricer.units.len() > MAX_KEPT_UNITS {
                Swaps::of(&pricer, self.problem, &rows, ctx)?
            } else {
                let now = match kept.take() {
                    Some(before) => before.exchanged(pricer, self.problem, ctx)?,
                    None => KeptUnits::new(pricer, self.problem, ctx)?,
                };
                kept.insert(now).swaps(&rows)
            };
            let chosen = swaps.best(|view, row, deficit| {
                let allowed = deficit < best.0 || (tabu[row.index()] < step && tabu[rows[view.index()].index()] < step);
                allowed && self.connects(&rows, view, row)
            });
            let Some((view, row, deficit)) = chosen else { continue };
            let noise = mixed(step + (attempt << 32));
            tabu[rows[view.index()].index()] = step + 4 + noise % 8;
            tabu[row.index()] = step + 1 + noise / 8 % (rows.len() as u64 / 2 + 1);
            rows[view.index()] = row;
            if deficit < best.0 {
                best = (deficit, rows.clone());
            }
        }
        Ok(best.1)
    }

    /// Units by which `rows` miss the goals.
    fn deficit(&self, rows: &[RowIndex]) -> i64 {
        CoverState::new(self, rows).deficit()
    }

    /// A deficit as area.
    pub(super) fn deficit_mm2(&self, deficit: i64) -> f64 {
        self.goals.first().map_or(0.0, |goal| goal.area_mm2(deficit))
    }

    /// Returns true if `rows` with that of one view exchanged may be chosen together.
    pub(super) fn connects(&self, rows: &[RowIndex], view: ViewId, row: RowIndex) -> bool {
        let mut exchanged = rows.to_vec();
        exchanged[view.index()] = row;
        self.overlap.connects(&exchanged)
    }
}

/// The rows but that of one view.
fn without(rows: &[RowIndex], view: ViewId) -> Vec<RowIndex> {
    [&rows[..view.index()], &rows[view.index() + 1..]].concat()
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
    /// Samples that none or one of the views covers and some goal counts, block by block: goal g's of view v alone have the number
    /// g × (views + 1) + v, and those of no view are the last of each goal.
    segments: Vec<BlockSegment>,
    /// Units of each goal (outer) that each view covers alone.
    lost: Vec<Vec<i64>>,
    /// Units covered of each goal.
    covered: Vec<i64>,
}

impl<'a> CoverState<'a> {
    fn new(exchange: &Exchange<'a>, rows: &[RowIndex]) -> Self {
        let (goals, measured) = (exchange.goals, exchange.problem.measured(rows));
        let blocks = exchange.problem.asked_area_mm2.len().div_ceil(BLOCK);
        let tasks: Vec<usize> = (0..blocks).step_by(BLOCKS_A_TASK).collect();
        let of_task = |first: &usize| segments_of(goals, &measured, *first..blocks.min(first + BLOCKS_A_TASK));
        let parts: Vec<PartialCover> = parallel::map(&tasks, of_task);
        let (mut covered, mut alone) = (vec![0; goals.len()], vec![0; goals.len() * (rows.len() + 1)]);
        let add = |sums: &mut [i64], part: &[i64]| sums.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        for part in &parts {
            add(&mut covered, &part.covered);
            add(&mut alone, &part.alone);
        }
        let lost = alone.chunks_exact(rows.len() + 1).map(|goal| goal[..rows.len()].to_vec()).collect();
        let segments = parts.into_iter().flat_map(|part| part.segments).collect();
        Self { goals, segments, lost, covered }
    }

    fn deficit(&self) -> i64 {
        together(self.goals.iter().zip(&self.covered).map(|(goal, covered)| (goal.needed - covered).max(0)))
    }

    /// Deficit of all views but one.
    fn deficit_without(&self, view: ViewId) -> i64 {
        let of_goals = self.goals.iter().zip(&self.covered).zip(&self.lost);
        together(of_goals.map(|((goal, covered), lost)| (goal.needed - (covered - lost[view.index()])).max(0)))
    }
}

/// Deficit of all goals together. Each may miss 2⁵² units, so that the sum of 2048 is no i64 any more: it ends at the largest, which
/// is unmet and no better than any other.
fn together(of_goals: impl Iterator<Item = i64>) -> i64 {
    of_goals.fold(0, i64::saturating_add)
}

/// Cover of some blocks.
struct PartialCover {
    /// Segments of these blocks ([`CoverState::segments`]).
    segments: Vec<BlockSegment>,
    /// Units covered of each goal.
    covered: Vec<i64>,
    /// Units of each sum of the segments; 0 for those of no view, which nothing asks for.
    alone: Vec<i64>,
}

fn segments_of(goals: &[Units], measured: &[&Row], blocks: Range<usize>) -> PartialCover {
    let views = measured.len();
    let mut part =
        PartialCover { segments: Vec::new(), covered: vec![0; goals.len()], alone: vec![0; goals.len() * (views + 1)] };
    let mut words = vec![0; views];
    for block in blocks {
        let (mut once, mut twice) = (0, 0);
        for (word, row) in words.iter_mut().zip(measured) {
            *word = row.words().get(block).copied().unwrap_or(0);
            twice |= once & *word;
            once |= *word;
        }
        for (number, goal) in goals.iter().enumerate() {
            let (first, units, counted) = (number * (views + 1), goal.of_block(block), goal.counted(block));
            part.covered[number] += masked_sum(units, once & counted);
            let masks = words.iter().map(|word| word & !twice & counted).enumerate().filter(|(_, mask)| *mask != 0);
            for (view, mask) in masks {
                part.alone[first + view] += masked_sum(units, mask);
                part.segments.push(BlockSegment { block: block as u32, sum: (first + view) as u32, mask });
            }
            let open = !once & counted;
            if open != 0 {
                part.segments.push(BlockSegment { block: block as u32, sum: (first + views) as u32, mask: open });
            }
        }
    }
    part
}

/// Prices exchanges of chosen views: the deficit that each leaves.
pub(super) struct SwapPricer<'a> {
    state: CoverState<'a>,
    views: usize,
    /// Units in which each sum of the segments is added up.
    units: Vec<&'a [i64]>,
}

impl<'a> SwapPricer<'a> {
    pub(super) fn new(exchange: &Exchange<'a>, rows: &[RowIndex]) -> Self {
        let (views, goals) = (rows.len(), exchange.goals);
        let units = (0..goals.len() * (views + 1)).map(|sum| goals[sum / (views + 1)].of_sample.as_slice()).collect();
        Self { state: CoverState::new(exchange, rows), views, units }
    }

    /// Deficit of the views as they are.
    pub(super) fn deficit(&self) -> i64 {
        self.state.deficit()
    }

    /// Deficit after the exchange of each view for a row.
    pub(super) fn deficits(&self, row: &Row, level: SimdLevel) -> Vec<i64> {
        self.deficits_of(&self.regained(row, level))
    }

    /// Units that a row measures of each sum of the segments.
    fn regained(&self, row: &Row, level: SimdLevel) -> Vec<i64> {
        segment_sums(row.words(), &self.state.segments, &self.units, level)
    }

    /// Deficit after the exchange of each view for a row that measures these units of the segments.
    fn deficits_of(&self, regained: &[i64]) -> Vec<i64> {
        let CoverState { goals, lost, covered, .. } = &self.state;
        let deficit = |view: ViewId| {
            let of_goals = goals.iter().zip(covered).zip(lost).zip(regained.chunks_exact(self.views + 1));
            together(of_goals.map(|(((goal, covered), lost), regained)| {
                let covered = covered - lost[view.index()] + regained[view.index()] + regained[self.views];
                (goal.needed - covered).max(0)
            }))
        };
        ViewId::first(self.views).map(deficit).collect()
    }

    /// Work of [`SwapPricer::deficits`] of so many rows, in pairs of sample and row.
    pub(super) fn work(&self, rows: usize) -> u64 {
        (self.state.segments.len() * rows) as u64 * PAIRS_A_SEGMENT
    }
}

/// Samples of segments that other segments of the same block and sum do not have. Both ascend by block and sum.
fn beyond(segments: &[BlockSegment], others: &[BlockSegment]) -> Vec<BlockSegment> {
    let place = |segment: &BlockSegment| (segment.block, segment.sum);
    let mut others = others.iter().peekable();
    let mut without = |segment: &BlockSegment| {
        while others.next_if(|other| place(other) < place(segment)).is_some() {}
        let known = others.peek().filter(|other| place(other) == place(segment)).map_or(0, |other| other.mask);
        BlockSegment { mask: segment.mask & !known, ..*segment }
    };
    segments.iter().map(&mut without).filter(|segment| segment.mask != 0).collect()
}

/// Units that every row measures of each sum of the segments of chosen views, kept up while views are exchanged.
pub(super) struct KeptUnits<'a> {
    pricer: SwapPricer<'a>,
    /// Units of each sum (inner) that each row (outer) measures.
    regained: Vec<Vec<i64>>,
}

impl<'a> KeptUnits<'a> {
    pub(super) fn new(pricer: SwapPricer<'a>, problem: &CoverProblem<'_>, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let of_row = |row: &&Row| ctx.check().map(|()| pricer.regained(row, ctx.simd_level()));
        let of_rows = problem.rows.par_iter().with_min_len(ROWS_A_TASK).map(of_row);
        let regained = of_rows.collect::<Result<_, Cancelled>>()?;
        Ok(Self { pricer, regained })
    }

    /// The units after views were exchanged; `pricer` prices those of now, as many as before.
    pub(super) fn exchanged(
        mut self,
        pricer: SwapPricer<'a>,
        problem: &CoverProblem<'_>,
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let (before, now) = (&self.pricer.state.segments, &pricer.state.segments);
        let (joined, left) = rayon::join(|| beyond(now, before), || beyond(before, now));
        let update = |(row, regained): (&&Row, &mut Vec<i64>)| {
            ctx.check()?;
            change_sums(regained, row.words(), (&joined, &left), &pricer.units, ctx.simd_level());
            Ok::<(), Cancelled>(())
        };
        let of_rows = problem.rows.par_iter().zip(&mut self.regained).with_min_len(ROWS_A_TASK);
        of_rows.try_for_each(update)?;
        Ok(Self { pricer, ..self })
    }

    /// Prices every exchange of a view, whose rows are `rows`.
    pub(super) fn swaps(&self, rows: &[RowIndex]) -> Swaps {
        let of_rows = self.regained.par_iter().with_min_len(ROWS_A_TASK);
        Swaps::without(of_rows.map(|regained| self.pricer.deficits_of(regained)).collect(), rows)
    }
}

/// Deficits that every exchange would leave.
pub(super) struct Swaps {
    /// Deficit after the exchange of each view (inner) for each row (outer); of rows that are views none.
    pub(super) deficits: Vec<Vec<i64>>,
}

impl Swaps {
    pub(super) fn new(exchange: &Exchange<'_>, rows: &[RowIndex], ctx: &Context<'_>) -> Result<Self, Cancelled> {
        Self::of(&SwapPricer::new(exchange, rows), exchange.problem, rows, ctx)
    }

    /// The deficits of every row of the problem.
    pub(super) fn of(
        pricer: &SwapPricer<'_>,
        problem: &CoverProblem<'_>,
        rows: &[RowIndex],
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let of_row = |row: &&Row| ctx.check().map(|()| pricer.deficits(row, ctx.simd_level()));
        let of_rows = problem.rows.par_iter().with_min_len(ROWS_A_TASK).map(of_row);
        Ok(Self::without(of_rows.collect::<Result<_, Cancelled>>()?, rows))
    }

    /// The deficits but those of the views themselves.
    fn without(mut deficits: Vec<Vec<i64>>, rows: &[RowIndex]) -> Self {
        rows.iter().for_each(|row| deficits[row.index()].clear());
        Self { deficits }
    }

    /// Lists every exchange of a view for a row that is not chosen: the view, the row, and the deficit after it.
    pub(super) fn all(&self) -> impl Iterator<Item = (ViewId, RowIndex, i64)> + '_ {
        RowIndex::number(&self.deficits)
            .flat_map(|(row, deficits)| ViewId::number(deficits).map(move |(view, deficit)| (view, row, *deficit)))
    }

    /// The allowed exchange with the least deficit; the first among equals.
    fn best(&self, allowed: impl Fn(ViewId, RowIndex, i64) -> bool) -> Option<(ViewId, RowIndex, i64)> {
        let mut best: Option<(ViewId, RowIndex, i64)> = None;
        for (view, row, deficit) in self.all() {
            if best.is_none_or(|best| deficit < best.2) && allowed(view, row, deficit) {
                best = Some((view, row, deficit));
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::planning::context::Silent;
    use crate::planning::ids::SampleId;
    use crate::planning::selection::Goal;

    #[test]
    fn attempts_begin_without_the_views_that_are_missed_least() {
        let measured: [&[u32]; 4] = [&[0, 1, 2], &[3], &[4, 5], &[0, 3]];
        let rows = measured.map(|samples| Row::from_samples(6, samples.iter().map(|sample| (SampleId(*sample), 0.0))));
        let (area_mm2, params) = ([1.0; 6], SelectionParams::default());
        let problem = CoverProblem::new(rows.iter().collect(), &area_mm2, 6.0, &params);
        let (goals, overlap) = (Units::of_goals(&problem), Overlap::new(&problem, &params.overlap));
        let exchange = Exchange { problem: &problem, goals: &goals, overlap: &overlap };
        let chosen = [0, 1, 2].map(RowIndex::at);
        let left_out = |fewer: Vec<RowIndex>| chosen.into_iter().find(|row| !fewer.contains(row));
        let order: Vec<_> = exchange.without_one(&chosen).filter_map(left_out).map(RowIndex::index).collect();
        assert_eq!(order, [1, 2, 0]);
        let flag = AtomicBool::new(false);
        let found = exchange.one_fewer(&chosen, &mut Budget { left: u64::MAX }, &Context::new(&flag, &Silent));
        assert_eq!(found.expect("not cancelled"), None, "two of the four views measure five samples at most");
    }

    /// The deficit of 2600 goals, 2⁵² units each, wrapped around: a view that all of them need was removed as redundant.
    #[test]
    fn a_view_that_2600_goals_need_is_no_redundant_one() {
        let rows = [0, 1, 1].map(|sample| Row::from_samples(2, [(SampleId(sample), 0.0)]));
        let (area_mm2, params) = ([1.0, 3.0], SelectionParams::default());
        let mut problem = CoverProblem::new(rows.iter().collect(), &area_mm2, 4.0, &params);
        // Both samples are needed: the last view by its area alone, the first by all goals but the plan's own.
        let first = || Goal { area_mm2: Cow::Borrowed(&[1.0, 0.0]), needed_mm2: 1.0 };
        problem.goals.extend(std::iter::repeat_with(first).take(2_600));
        let (goals, overlap) = (Units::of_goals(&problem), Overlap::new(&problem, &params.overlap));
        let exchange = Exchange { problem: &problem, goals: &goals, overlap: &overlap };
        let (both, flag) = ([1, 0].map(RowIndex::at), AtomicBool::new(false));
        let state = CoverState::new(&exchange, &both);
        assert_eq!((state.deficit(), state.deficit_without(ViewId::at(1))), (0, i64::MAX));
        assert_eq!(exchange.deficit(&both[..1]), i64::MAX);
        let ctx = Context::new(&flag, &Silent);
        assert_eq!(exchange.remove_redundant(both.to_vec(), &ctx).expect("not cancelled"), both);
        // Of the exchanges for the first row, which all goals need, and for the last, that is the better one.
        let swaps = Swaps::new(&exchange, &both[..1], &ctx).expect("not cancelled");
        let best = swaps.best(|_, _, _| true);
        let left = goals[0].needed - goals[0].of_sample[0];
        assert_eq!(best, Some((ViewId::at(0), RowIndex::at(0), left)));
    }
}
