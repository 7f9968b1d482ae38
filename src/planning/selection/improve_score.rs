//! Raises the score at the same number of views and the same goals: exchanges of one view for
//! another while G_v of the union ([`crate::planning::method::quality`], each sample by the best of its views), less the
//! cost of travel, rises. Cost: a step passes over every pair of a row and a sample that it measures.

use rayon::prelude::*;

use super::local::{Budget, Exchange, Swaps};
use super::score::Scorer;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::RowIndex;

/// Exchanges at most.
const MAX_STEPS: u64 = 100;
/// Exchanges at most after the best views.
const MAX_STEPS_WITHOUT_RISE: u64 = 10;
/// Work at most: pairs of sample and row evaluated.
const MAX_WORK: u64 = 600_000_000;
/// Score that a unit of area costs by which a goal is missed.
const PRICE_OF_DEFICIT: f64 = 4.0;
/// Steps for which a view that was exchanged stays out.
const TENURE: u64 = 10;
/// Smallest rise that counts, as a share of the score.
const MIN_RISE: f64 = 1e-9;
/// Stands for no view.
const NONE: u16 = u16::MAX;

pub(super) fn run(
    scorer: &Scorer<'_>,
    exchange: &Exchange<'_>,
    rows: Vec<RowIndex>,
    budget: &mut Budget,
    ctx: &Context<'_>,
) -> Result<Vec<RowIndex>, Cancelled> {
    let table: u64 = scorer.problem.rows.iter().map(|row| row.count() as u64).sum();
    let steps = (MAX_WORK / table.max(1)).clamp(1, MAX_STEPS);
    let mut search = ScoreSearch { scorer, exchange, tabu: vec![0; scorer.problem.rows.len()], best: None, rows };
    let mut since_best = 0;
    for step in 1..=steps {
        if budget.left == 0 || search.rows.is_empty() || since_best == MAX_STEPS_WITHOUT_RISE {
            break;
        }
        let (work, risen) = search.step(step, ctx)?;
        budget.spend(table + work);
        since_best = if risen { 0 } else { since_best + 1 };
    }
    Ok(search.best.map_or(search.rows, |(_, rows)| rows))
}

/// Tabu search for the highest score; an exchange that leaves a goal unmet pays for what is missing.
struct ScoreSearch<'a> {
    scorer: &'a Scorer<'a>,
    exchange: &'a Exchange<'a>,
    /// First step at which each row may be exchanged again.
    tabu: Vec<u64>,
    /// The highest score of views that meet the goals, with them.
    best: Option<(f64, Vec<RowIndex>)>,
    rows: Vec<RowIndex>,
}

impl ScoreSearch<'_> {
    /// Records the views if they are the best, and makes the best exchange that is allowed. Returns the work, and true if they
    /// were the best.
    fn step(&mut self, step: u64, ctx: &Context<'_>) -> Result<(u64, bool), Cancelled> {
        let Self { scorer, exchange, tabu, best, rows } = self;
        let union = Union::new(scorer, rows);
        let travel = scorer.tree_cost_mm2(rows);
        let total = union.total - travel;
        let swaps = Swaps::new(exchange, rows, ctx)?;
        let risen = exchange.deficit(rows) == 0 && best.as_ref().is_none_or(|(best, _)| total > best + MIN_RISE * best.abs());
        if risen {
            *best = Some((total, rows.clone()));
        }
        let best_total = best.as_ref().map_or(f64::NEG_INFINITY, |(best, _)| best + MIN_RISE * best.abs());
        let rises = union.rises(scorer, ctx)?;
        let mut chosen = (f64::NEG_INFINITY, None);
        for (at, row, deficit) in swaps.all() {
            let gain = rises[row.index()][at] - PRICE_OF_DEFICIT * exchange.deficit_mm2(deficit);
            if gain + travel <= chosen.0 {
                continue;
            }
            let mut exchanged = rows.clone();
            exchanged[at] = row;
            let gain = gain + travel - scorer.tree_cost_mm2(&exchanged);
            let allowed =
                tabu[row.index()] <= step && tabu[rows[at].index()] <= step || deficit == 0 && total + gain > best_total;
            if gain > chosen.0 && allowed && exchange.overlap.connects(&exchanged) {
                chosen = (gain, Some((at, exchanged)));
            }
        }
        if let Some((at, exchanged)) = chosen.1 {
            tabu[rows[at].index()] = step + TENURE;
            tabu[exchanged[at].index()] = step + TENURE / 2;
            *rows = exchanged;
        }
        Ok((swaps.work, risen))
    }
}

/// Value of each sample by the best and by the second best of some views.
struct Union {
    best: Vec<f64>,
    second: Vec<f64>,
    /// The view that is best; [`NONE`] where no view measures the sample.
    owner: Vec<u16>,
    /// Change of the value when a view is removed, for each view.
    without: Vec<f64>,
    total: f64,
}

impl Union {
    fn new(scorer: &Scorer<'_>, rows: &[RowIndex]) -> Self {
        let samples = scorer.problem.asked_area_mm2.len();
        let (mut best, mut second, mut owner) = (vec![0.0; samples], vec![f64::NEG_INFINITY; samples], vec![NONE; samples]);
        for (view, row) in (0..).zip(rows) {
            for (sample, value) in scorer.values(*row).map(|(sample, value)| (sample.index(), value)) {
                if owner[sample] == NONE || value > best[sample] {
                    if owner[sample] != NONE {
                        second[sample] = best[sample];
                    }
                    (best[sample], owner[sample]) = (value, view);
                } else {
                    second[sample] = second[sample].max(value);
                }
            }
        }
        let mut without = vec![0.0; rows.len()];
        for sample in (0..samples).filter(|sample| owner[*sample] != NONE) {
            without[usize::from(owner[sample])] += or_nothing(second[sample]) - best[sample];
        }
        Self { total: best.iter().sum(), best, second, owner, without }
    }

    /// Rise of the score, for each row, by its exchange for each view.
    fn rises(&self, scorer: &Scorer<'_>, ctx: &Context<'_>) -> Result<Vec<Vec<f64>>, Cancelled> {
        let of_row = |row: RowIndex| {
            ctx.check()?;
            let mut beside = 0.0;
            let mut rises = self.without.clone();
            for (sample, value) in scorer.values(row).map(|(sample, value)| (sample.index(), value)) {
                if self.owner[sample] == NONE {
                    beside += value;
                    continue;
                }
                let over_best = (value - self.best[sample]).max(0.0);
                let second = self.second[sample];
                let over_second = if second == f64::NEG_INFINITY { value } else { (value - second).max(0.0) };
                beside += over_best;
                rises[usize::from(self.owner[sample])] += over_second - over_best;
            }
            rises.iter_mut().for_each(|rise| *rise += beside);
            Ok(rises)
        };
        (0..scorer.problem.rows.len()).into_par_iter().map(RowIndex::at).map(of_row).collect()
    }
}

/// Value of a sample of which [`Union`] has no second view.
fn or_nothing(second: f64) -> f64 {
    if second == f64::NEG_INFINITY { 0.0 } else { second }
}
