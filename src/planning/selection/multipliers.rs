//! Lagrangian multipliers of samples, and the exact bounds that follow from them. With 0 ≤ u_s ≤ w_s for each sample, w_s its
//! units and slack the units that may stay open, views S that meet the goals satisfy Σ_{s covered} u_s ≥ Σ u_s − slack, and
//! cover at most the sum of u_s over their rows: if the k rows of the largest sums are together below that, k views do not
//! suffice. This is the Lagrangian bound of maximum k-cover (Cornuéjols, Fisher, Nemhauser 1977; Held and Karp 1971 for
//! multipliers as such). It holds for any multipliers; those of the linear relaxation make it as good as that relaxation. Whole
//! numbers throughout.
//!
//! Several goals enter as one: their units are added with whole weights, the relaxation's multipliers of the goals. Of many goals only
//! some enter (`bound.rs`).
//!
//! A quick bound prices the rows first: on a small share of the samples the relaxation tells which rows the optimum can take, and
//! only those of the smallest reduced costs enter the relaxation that counts; rows that would violate it are added, and it is solved
//! again (sifting: Bixby, Gregory, Lustig, Marsten, Shanno 1992, Operations Research 40).
//! Where the bound of the prices already is the number of views at hand, nothing better is left to find, nor is there where it is
//! the value of that relaxation, rounded up.

use rayon::prelude::*;

use super::CoverProblem;
use super::blocks::count_in;
use super::classes::{Classes, work_of_goals};
use super::relaxation::{Form, Precision, Solution, solve};
use super::units::{Units, row_sums};
use crate::geometry::SimdLevel;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{RowIndex, SampleId};
use crate::planning::visibility::ones;

/// Sum of the weights of the goals, about.
const GOAL_WEIGHTS: f64 = 256.0;
/// Rounds in which the relaxation is solved at most, each with rows added that violate it.
const MAX_ROUNDS: usize = 4;
/// Relative gap to which the relaxation is solved, and that on a share of the samples, which is to hold for the others.
const GAP: f64 = 1e-7;
const GAP_OF_SHARE: f64 = 4e-3;
/// Share of the relaxation's value that its exact bound is at least: with one goal whose samples all enter, and else, where
/// weights of goals are rounded and a share stands for the rest.
const RELIED_ON: f64 = 1.0 - 1e-6;
const RELIED_ON_OF_MANY: f64 = 0.98;
/// Rows that are kept for each of many views.
const ROWS_A_VIEW: f64 = 1.5;
/// Reduced cost, in views, up to which rows are as good as those taken.
const FREE_COST: f64 = 0.01;
/// Share of a row up to which it covers nothing worth counting.
const MIN_TAKEN: f64 = 1e-4;
/// Samples that a thread weighs at once.
const SAMPLES_A_TASK: usize = 4096;

/// Samples up to which a matrix is reduced as a whole, to see if it is small enough.
const MAX_MERGED: usize = 60_000;

/// Largest size of a relaxation.
pub(super) struct RelaxationSize {
    /// Classes × ((rows a class)² + goals²) / 2 at most, about: work of a step. The square of few goals counts for nothing.
    pub(super) step: f64,
    /// Rows at most.
    pub(super) rows: usize,
    /// Prices with which rows are chosen first, where there are more than these; `None` takes them all.
    pub(super) prices: Option<Prices>,
}

/// The relaxation that prices rows.
pub(super) struct Prices {
    /// Work of a step, as of [`RelaxationSize::step`].
    pub(super) step: f64,
    /// Rows that are kept, those of the smallest reduced costs; more for many views ([`ROWS_A_VIEW`]).
    pub(super) rows: usize,
    /// Rows that are kept at most where more of them cost next to nothing ([`FREE_COST`]).
    pub(super) free_rows: usize,
}

/// Multipliers of the samples, in whole units.
pub(super) struct Multipliers {
    /// w_s: units of each sample.
    pub(super) units: Vec<i64>,
    /// u_s: multiplier of each sample.
    pub(super) values: Vec<i64>,
    /// Units that may stay open.
    pub(super) slack: i64,
    /// U_r: sum of the multipliers of each row.
    sums: Vec<i64>,
    /// Value of the relaxation that they come from: for the fewest views, a number of views.
    relaxed: f64,
}

/// The quantity to bound.
#[derive(Clone, Copy)]
pub(super) enum BoundTarget {
    /// Number of views for the goals.
    FewestViews,
    /// Units of the first goal with so many views.
    MostArea(usize),
}

impl Multipliers {
    /// Derives multipliers from the linear relaxation, as large as `size` allows. Once they prove that fewer than `views` views
    /// do not suffice, they are good enough.
    pub(super) fn relaxed(
        problem: &CoverProblem<'_>,
        goals: &[Units],
        aim: BoundTarget,
        (size, views): (&RelaxationSize, usize),
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let mut rows = largest_rows(problem, &goals[0], size.rows, ctx.simd_level());
        let mut enough_views = views;
        let is_enough = |found: &Self, views: usize| matches!(aim, BoundTarget::FewestViews) && found.views_lower() >= views;
        let mut best: Option<Self> = None;
        if let Some(prices) = size.prices.as_ref().filter(|prices| prices.rows < rows.len()) {
            let reduced = Reduced::share(problem, goals, rows, (prices.step, ctx.simd_level()));
            let (priced, reduced_cost) = reduced.solved(problem, goals, aim, size, ctx)?;
            enough_views = views.min(priced.relaxed_views());
            if is_enough(&priced, enough_views) {
                return Ok(priced);
            }
            let views = if let BoundTarget::MostArea(views) = aim { views } else { views };
            let free = reduced_cost.iter().filter(|cost| **cost < FREE_COST).count().min(prices.free_rows);
            rows = reduced.cheapest(&reduced_cost, prices.rows.max(free).max((ROWS_A_VIEW * views as f64) as usize));
            best = Some(priced);
        }
        let mut reduced = Reduced::new(problem, goals, rows, (size, ctx.simd_level()));
        let mut round = 1;
        loop {
            let (found, _) = reduced.solved(problem, goals, aim, size, ctx)?;
            let larger = found.larger(&reduced.classes, &reduced.rows, size.rows / 4);
            let takes_all = size.prices.is_none() && reduced.is_share;
            let is_last = larger.is_empty() || round == MAX_ROUNDS || takes_all || is_enough(&found, enough_views);
            let better = match best {
                Some(best) if best.is_better(&found, aim) => best,
                _ => found,
            };
            if is_last {
                return Ok(better);
            }
            best = Some(better);
            reduced = reduced.with_rows(problem, goals, larger);
            round += 1;
        }
    }

    /// Number of views that a relaxation on all rows and a share of the samples asks for, as far as it is relied on: more is not to be
    /// proved by relaxations on some of the rows, which end near it.
    fn relaxed_views(&self) -> usize {
        (self.relaxed * RELIED_ON_OF_MANY).ceil() as usize
    }

    /// Returns true if the bound of these multipliers is the better one.
    fn is_better(&self, other: &Self, aim: BoundTarget) -> bool {
        match aim {
            BoundTarget::FewestViews => self.views_lower() > other.views_lower(),
            BoundTarget::MostArea(views) => self.max_units(views) < other.max_units(views),
        }
    }

    /// The `count` of some rows that have the largest sums, ascending by number.
    fn largest(&self, rows: impl Iterator<Item = RowIndex>, count: usize) -> Vec<RowIndex> {
        let mut rows: Vec<RowIndex> = rows.collect();
        rows.sort_by_key(|row| std::cmp::Reverse(self.sums[row.index()]));
        rows.truncate(count);
        rows.sort_unstable();
        rows
    }

    /// Rows, `count` at most, that are not among `rows` and whose sums are larger than those of the relaxation.
    fn larger(&self, classes: &Classes, rows: &[RowIndex], count: usize) -> Vec<RowIndex> {
        let largest = classes.rows.iter().map(|row| self.sums[row.index()]).max().unwrap_or(0);
        let larger = RowIndex::number(&self.sums).filter(|(row, sum)| **sum > largest && rows.binary_search(row).is_err());
        self.largest(larger.map(|(row, _)| row), count)
    }

    fn new(
        problem: &CoverProblem<'_>,
        goals: &[Units],
        classes: &Classes,
        form: &Form,
        solution: &Solution,
        (is_share, level): (bool, SimdLevel),
    ) -> Self {
        let weights = goal_weights(goals, &solution.limit);
        let weighted = || goals.iter().zip(&weights);
        let units_of = |sample: usize| weighted().map(|(goal, weight)| weight * goal.of_sample[sample]).sum::<i64>();
        let samples = (0..problem.asked_area_mm2.len()).into_par_iter().with_min_len(SAMPLES_A_TASK);
        let units: Vec<i64> = samples.map(units_of).collect();
        let slack = weighted().map(|(goal, weight)| weight * (goal.total - goal.needed)).sum();
        let caps = caps(form, solution, classes.len());
        let ratio: Vec<f64> = caps.iter().zip(&solution.class).map(|(cap, u)| (u / cap).clamp(0.0, 1.0)).collect();
        let taken = if is_share { taken_of_samples(problem, classes, solution) } else { Vec::new() };
        let mean_cap = caps.iter().sum::<f64>() / caps.len().max(1) as f64;
        let ratio_of = |sample: usize| match classes.of_sample[sample] {
            Classes::NONE if is_share && taken[sample] > 0.0 => central_ratio((taken[sample] - 1.0) * mean_cap / solution.tau),
            Classes::NONE => 1.0,
            class => ratio[class as usize],
        };
        let value = |(sample, units): (usize, &i64)| match *units {
            0 => 0,
            units => ((ratio_of(sample) * units as f64) as i64).clamp(0, units),
        };
        let values: Vec<i64> = units.par_iter().enumerate().with_min_len(SAMPLES_A_TASK).map(value).collect();
        let sums = row_sums(&problem.rows, &values, level);
        Self { units, values, slack, sums, relaxed: solution.value }
    }

    /// Lower bound of the number of views by these multipliers.
    pub(super) fn views_lower(&self) -> usize {
        let mut sums = self.sums.clone();
        sums.sort_unstable_by(|a, b| b.cmp(a));
        let needed = self.values.iter().sum::<i64>() - self.slack;
        let mut held = 0;
        let falls_short = |sum: &&i64| {
            let falls_short = held < needed;
            held += **sum;
            falls_short
        };
        sums.iter().take_while(falls_short).count()
    }

    /// Upper bound of the units that `views` views cover.
    pub(super) fn max_units(&self, views: usize) -> i64 {
        let mut sums = self.sums.clone();
        sums.sort_unstable_by(|a, b| b.cmp(a));
        let open: i64 = self.units.iter().zip(&self.values).map(|(units, value)| units - value).sum();
        open + sums.iter().take(views).sum::<i64>()
    }
}

/// A problem reduced for the relaxation.
struct Reduced {
    /// Rows that may enter, ascending.
    rows: Vec<RowIndex>,
    samples: Vec<SampleId>,
    /// Set where the samples are a share of all, spread evenly over those that count.
    is_share: bool,
    classes: Classes,
}

impl Reduced {
    /// Every sample that counts, where `size` allows it; else a share.
    fn new(
        problem: &CoverProblem<'_>,
        goals: &[Units],
        rows: Vec<RowIndex>,
        (size, level): (&RelaxationSize, SimdLevel),
    ) -> Self {
        let samples = counted(problem, goals);
        if samples.len() <= MAX_MERGED {
            let classes = Classes::new(problem, goals, &samples, &rows);
            if classes.step_work() <= size.step {
                return Self { rows, samples, is_share: false, classes };
            }
        }
        Self::share(problem, goals, rows, (size.step, level))
    }

    /// A share of the samples of which a step has so much work; all of them, where that is no more.
    fn share(problem: &CoverProblem<'_>, goals: &[Units], rows: Vec<RowIndex>, (step, level): (f64, SimdLevel)) -> Self {
        let all = counted(problem, goals);
        let pairs_of = |row: &RowIndex| count_in(problem.row(*row).words(), problem.row(*row).words(), level);
        let pairs = rows.par_iter().map(pairs_of).sum::<usize>() as f64;
        let rows_a_sample = (pairs / all.len().max(1) as f64).max(1.0);
        let products = rows_a_sample * rows_a_sample + 2.0 * work_of_goals(goals.len());
        let max = (2.0 * step / products).max(1_000.0) as usize;
        let is_share = all.len() > max;
        let samples = if is_share { (0..max).map(|place| all[place * all.len() / max]).collect() } else { all };
        let classes = Classes::new(problem, goals, &samples, &rows);
        Self { rows, samples, is_share, classes }
    }

    /// Adds rows.
    fn with_rows(mut self, problem: &CoverProblem<'_>, goals: &[Units], more: Vec<RowIndex>) -> Self {
        self.rows.extend(more);
        self.rows.sort_unstable();
        self.classes = Classes::new(problem, goals, &self.samples, &self.rows);
        self
    }

    /// Lists the `count` rows of the relaxation that have the smallest reduced costs, ascending by number.
    fn cheapest(&self, reduced_cost: &[f64], count: usize) -> Vec<RowIndex> {
        let mut rows: Vec<(f64, RowIndex)> = reduced_cost.iter().copied().zip(self.classes.rows.iter().copied()).collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        rows.truncate(count);
        let mut rows: Vec<RowIndex> = rows.into_iter().map(|(_, row)| row).collect();
        rows.sort_unstable();
        rows
    }

    /// Multipliers of the relaxation's solution, and the reduced costs of its rows.
    fn solved(
        &self,
        problem: &CoverProblem<'_>,
        goals: &[Units],
        aim: BoundTarget,
        size: &RelaxationSize,
        ctx: &Context<'_>,
    ) -> Result<(Multipliers, Vec<f64>), Cancelled> {
        let relied_on = if self.is_share || goals.len() > 1 { RELIED_ON_OF_MANY } else { RELIED_ON };
        let gap = if self.is_share { GAP_OF_SHARE } else { GAP };
        let precision = Precision { gap, whole: size.prices.is_some().then_some(relied_on) };
        let form = form(&self.classes, goals, aim);
        let solution = solve(&self.classes.of_row, self.classes.len(), &form, precision, ctx)?;
        let multipliers = Multipliers::new(problem, goals, &self.classes, &form, &solution, (self.is_share, ctx.simd_level()));
        Ok((multipliers, solution.reduced_cost))
    }
}

/// Samples that some goal counts, ascending.
fn counted(problem: &CoverProblem<'_>, goals: &[Units]) -> Vec<SampleId> {
    let counts = |sample: &SampleId| goals.iter().any(|goal| goal.of_sample[sample.index()] > 0);
    SampleId::first(problem.asked_area_mm2.len()).filter(counts).collect()
}

/// The rows that cover most, ascending by number.
fn largest_rows(problem: &CoverProblem<'_>, goal: &Units, max: usize, level: SimdLevel) -> Vec<RowIndex> {
    let mut rows: Vec<RowIndex> = problem.all_rows().collect();
    if rows.len() > max {
        let sums = row_sums(&problem.rows, &goal.of_sample, level);
        rows.sort_by_key(|row| std::cmp::Reverse(sums[row.index()]));
        rows.truncate(max);
        rows.sort_unstable();
    }
    rows
}

/// Makes the relaxation over the classes: shares of the units that they hold; units that no row covers need not be covered.
fn form(classes: &Classes, goals: &[Units], aim: BoundTarget) -> Form {
    let shares = |units: &[i64]| -> Vec<f64> {
        let whole: f64 = units.iter().map(|units| *units as f64).sum();
        units.iter().map(|units| *units as f64 / whole.max(1.0)).collect()
    };
    let held: Vec<f64> = classes.units.iter().map(|units| units.iter().map(|units| *units as f64).sum()).collect();
    match aim {
        BoundTarget::MostArea(views) => Form::MostArea(shares(&classes.units[0]), views as f64),
        BoundTarget::FewestViews => Form::FewestViews(
            goals
                .iter()
                .zip(&classes.units)
                .zip(held)
                .map(|((goal, units), held)| {
                    // A share of the samples stands for all of them: the same share may stay open of what is measured.
                    let measured = goal.measured.max(1) as f64;
                    (shares(units), if held > 0.0 { (1.0 - goal.needed as f64 / measured).max(0.0) } else { 1.0 })
                })
                .collect(),
        ),
    }
}

/// Largest multiplier of each class.
fn caps(form: &Form, solution: &Solution, classes: usize) -> Vec<f64> {
    match form {
        Form::MostArea(weights, _) => weights.clone(),
        Form::FewestViews(goals) => {
            let cap = |class: usize| goals.iter().zip(&solution.limit).map(|((weights, _), limit)| weights[class] * limit).sum();
            (0..classes).map(cap).collect()
        }
    }
}

/// Whole weights in proportion to the multipliers of the goals; 1 for a single one.
fn goal_weights(goals: &[Units], multipliers: &[f64]) -> Vec<i64> {
    let sum: f64 = multipliers.iter().sum();
    if goals.len() == 1 || sum <= 0.0 || !sum.is_finite() {
        return (0..goals.len()).map(|goal| i64::from(goal == 0)).collect();
    }
    multipliers.iter().map(|multiplier| (multiplier / sum * GOAL_WEIGHTS).round() as i64).collect()
}

/// A x at every sample.
fn taken_of_samples(problem: &CoverProblem<'_>, classes: &Classes, solution: &Solution) -> Vec<f64> {
    let shares: Vec<(&[u64], f64)> = classes
        .rows
        .iter()
        .zip(&solution.taken)
        .filter(|(_, share)| **share > MIN_TAKEN)
        .map(|(row, share)| (problem.row(*row).words(), *share))
        .collect();
    let mut taken = vec![0.0; problem.asked_area_mm2.len()];
    taken.par_chunks_mut(SAMPLES_A_TASK).enumerate().for_each(|(task, taken)| {
        for (words, share) in &shares {
            let own = words.iter().skip(task * SAMPLES_A_TASK / 64);
            for (taken, word) in taken.chunks_mut(64).zip(own) {
                ones(*word).for_each(|bit| taken[bit as usize] += share);
            }
        }
    });
    taken
}

/// Multiplier, as a share of its cap, of a class on the central path: ρ with 1/ρ − 1/(1 − ρ) = `excess`, which is the
/// class's excess cover times its cap over τ.
fn central_ratio(excess: f64) -> f64 {
    // ρ² e − ρ (e + 2) + 1 = 0, the root between 0 and 1.
    2.0 / (excess + 2.0 + (excess * excess + 4.0).sqrt())
}
