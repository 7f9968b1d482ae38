//! Lagrangian multipliers of samples, and the exact bounds that follow from them. With 0 ≤ u_s ≤ w_s for each sample, w_s its
//! units and slack the units that may stay open, views S that meet the goals satisfy Σ_{s covered} u_s ≥ Σ u_s − slack, and
//! cover at most the sum of u_s over their rows: if the k rows of the largest sums are together below that, k views do not
//! suffice. This is the Lagrangian bound of maximum k-cover (Cornuéjols, Fisher, Nemhauser 1977; Held and Karp 1971 for
//! multipliers as such). It holds for any multipliers; those of the linear relaxation make it as good as that relaxation. Whole
//! numbers throughout.
//!
//! Several goals enter as one: their units are added with whole weights, the relaxation's multipliers of the goals.

use super::CoverProblem;
use super::classes::Classes;
use super::relaxation::{Form, Solution, solve};
use super::units::{Units, row_sums};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{RowIndex, SampleId};

/// Sum of the weights of the goals, about.
const GOAL_WEIGHTS: f64 = 256.0;
/// Rounds in which the relaxation is solved at most, each with rows added that violate it.
const MAX_ROUNDS: usize = 4;
/// Relative gap to which the relaxation is solved, and that on a share of the samples, which is to hold for the others.
const GAP: f64 = 1e-7;
const GAP_OF_SHARE: f64 = 4e-3;

/// Samples up to which a matrix is reduced as a whole, to see if it is small enough.
const MAX_MERGED: usize = 60_000;

/// Largest size of a relaxation.
pub(super) struct RelaxationSize {
    /// Classes × (rows a class)² / 2 at most, about: work of a step.
    pub(super) step: f64,
    /// Rows at most.
    pub(super) rows: usize,
}

/// Multipliers of the samples, in whole units.
pub(super) struct Multipliers {
    /// w_s: units of each sample.
    pub(super) units: Vec<i64>,
    /// u_s: multiplier of each sample.
    pub(super) values: Vec<i64>,
    /// Units that may stay open.
    pub(super) slack: i64,
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
    /// Derives multipliers from the linear relaxation, as large as `size` allows.
    pub(super) fn relaxed(
        problem: &CoverProblem<'_>,
        goals: &[Units],
        aim: BoundTarget,
        size: &RelaxationSize,
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let mut rows = largest_rows(problem, &goals[0], size.rows);
        let (samples, is_share) = sampled(problem, goals, &rows, size);
        let mut round = 1;
        loop {
            let classes = Classes::new(problem, goals, &samples, &rows);
            let form = form(&classes, goals, aim);
            let solution = solve(&classes.of_row, classes.len(), &form, if is_share { GAP_OF_SHARE } else { GAP }, ctx)?;
            let multipliers = Self::new(problem, goals, &classes, &form, &solution, is_share);
            let sums = row_sums(&problem.rows, &multipliers.values);
            let largest = classes.rows.iter().map(|row| sums[row.index()]).max().unwrap_or(0);
            let mut larger: Vec<RowIndex> =
                problem.all_rows().filter(|row| sums[row.index()] > largest && !rows.contains(row)).collect();
            if larger.is_empty() || round == MAX_ROUNDS || is_share {
                return Ok(multipliers);
            }
            larger.sort_by_key(|row| std::cmp::Reverse(sums[row.index()]));
            larger.truncate(size.rows / 4);
            rows.extend(larger);
            rows.sort_unstable();
            round += 1;
        }
    }

    fn new(
        problem: &CoverProblem<'_>,
        goals: &[Units],
        classes: &Classes,
        form: &Form,
        solution: &Solution,
        is_share: bool,
    ) -> Self {
        let weights = goal_weights(goals, &solution.limit);
        let weighted =
            |of: &dyn Fn(&Units) -> i64| -> i64 { goals.iter().zip(&weights).map(|(goal, weight)| weight * of(goal)).sum() };
        let units: Vec<i64> = (0..problem.asked_area_mm2.len()).map(|sample| weighted(&|goal| goal.of_sample[sample])).collect();
        let slack = weighted(&|goal| goal.total - goal.needed);
        let caps = caps(form, solution, classes.len());
        let ratio: Vec<f64> = caps.iter().zip(&solution.class).map(|(cap, u)| (u / cap).clamp(0.0, 1.0)).collect();
        let taken = if is_share { taken_of_samples(problem, classes, solution) } else { Vec::new() };
        let mean_cap = caps.iter().sum::<f64>() / caps.len().max(1) as f64;
        let ratio_of = |sample: usize| match classes.of_sample[sample] {
            Classes::NONE if is_share && taken[sample] > 0.0 => central_ratio((taken[sample] - 1.0) * mean_cap / solution.tau),
            Classes::NONE => 1.0,
            class => ratio[class as usize],
        };
        let values = units
            .iter()
            .enumerate()
            .map(|(sample, units)| ((ratio_of(sample) * *units as f64) as i64).clamp(0, *units))
            .collect();
        Self { units, values, slack }
    }

    /// Lower bound of the number of views by these multipliers.
    pub(super) fn views_lower(&self, problem: &CoverProblem<'_>) -> usize {
        let mut sums = row_sums(&problem.rows, &self.values);
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
    pub(super) fn max_units(&self, problem: &CoverProblem<'_>, views: usize) -> i64 {
        let mut sums = row_sums(&problem.rows, &self.values);
        sums.sort_unstable_by(|a, b| b.cmp(a));
        let open: i64 = self.units.iter().zip(&self.values).map(|(units, value)| units - value).sum();
        open + sums.iter().take(views).sum::<i64>()
    }
}

/// Samples for the relaxation, and if they are a share of all, spread evenly over those that count.
fn sampled(problem: &CoverProblem<'_>, goals: &[Units], rows: &[RowIndex], size: &RelaxationSize) -> (Vec<SampleId>, bool) {
    let counts = |sample: &SampleId| goals.iter().any(|goal| goal.of_sample[sample.index()] > 0);
    let all: Vec<SampleId> = SampleId::first(problem.asked_area_mm2.len()).filter(counts).collect();
    if all.len() <= MAX_MERGED && Classes::new(problem, goals, &all, rows).step_work() <= size.step {
        return (all, false);
    }
    let pairs: f64 = rows.iter().map(|row| problem.row(*row).count() as f64).sum();
    let rows_a_sample = (pairs / all.len().max(1) as f64).max(1.0);
    let max = (2.0 * size.step / (rows_a_sample * rows_a_sample)).max(1_000.0) as usize;
    if all.len() <= max {
        return (all, false);
    }
    ((0..max).map(|place| all[place * all.len() / max]).collect(), true)
}

/// The rows that cover most, ascending by number.
fn largest_rows(problem: &CoverProblem<'_>, goal: &Units, max: usize) -> Vec<RowIndex> {
    let mut rows: Vec<RowIndex> = problem.all_rows().collect();
    if rows.len() > max {
        let sums = row_sums(&problem.rows, &goal.of_sample);
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
    let mut taken = vec![0.0; problem.asked_area_mm2.len()];
    for (row, share) in classes.rows.iter().zip(&solution.taken).filter(|(_, share)| **share > 1e-6) {
        problem.row(*row).samples().for_each(|sample| taken[sample.index()] += share);
    }
    taken
}

/// Multiplier, as a share of its cap, of a class on the central path: ρ with 1/ρ − 1/(1 − ρ) = `excess`, which is the
/// class's excess cover times its cap over τ.
fn central_ratio(excess: f64) -> f64 {
    // ρ² e − ρ (e + 2) + 1 = 0, the root between 0 and 1.
    2.0 / (excess + 2.0 + (excess * excess + 4.0).sqrt())
}
