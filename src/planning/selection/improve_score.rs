//! Raises the score at the same number of views and the same goals: exchanges of one view for
//! another while G_v of the union ([`crate::planning::method::quality`], each sample by the best of its views), less the
//! cost of travel, rises. Cost: a step passes over every pair of a row and a sample that it measures.

use rayon::prelude::*;

use super::local::{Budget, Exchange, Swaps};
use super::score::Scorer;
use crate::planning::context::{Cancelled, Context};

/// Exchanges at most.
const MAX_STEPS: usize = 40;
/// Work at most: pairs of sample and row evaluated.
const MAX_WORK: u64 = 600_000_000;
/// Smallest rise that counts, as a share of the score.
const MIN_RISE: f64 = 1e-9;
/// Stands for no view.
const NONE: u16 = u16::MAX;

pub(super) fn run(
    scorer: &Scorer<'_>,
    exchange: &Exchange<'_>,
    mut rows: Vec<usize>,
    budget: &mut Budget,
    ctx: &Context<'_>,
) -> Result<Vec<usize>, Cancelled> {
    let table: u64 = scorer.problem.rows.iter().map(|row| row.count() as u64).sum();
    let steps = usize::try_from(MAX_WORK / table.max(1)).unwrap_or(MAX_STEPS).clamp(1, MAX_STEPS);
    for _ in 0..steps {
        if budget.left == 0 || rows.is_empty() {
            break;
        }
        let swaps = Swaps::new(exchange, &rows, ctx)?;
        let union = Union::new(scorer, &rows);
        let rises = union.rises(scorer, ctx)?;
        budget.spend(table + swaps.work);
        let travel = scorer.tree_cost_mm2(&rows);
        let mut best = (MIN_RISE * union.total.abs(), None);
        for (at, row, _) in swaps.all().filter(|(.., deficit)| *deficit == 0) {
            if rises[row][at] + travel <= best.0 {
                continue;
            }
            let mut exchanged = rows.clone();
            exchanged[at] = row;
            let rise = rises[row][at] + travel - scorer.tree_cost_mm2(&exchanged);
            if rise > best.0 && exchange.overlap.connects(&exchanged) {
                best = (rise, Some(exchanged));
            }
        }
        let Some(better) = best.1 else { break };
        rows = better;
    }
    Ok(rows)
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
    fn new(scorer: &Scorer<'_>, rows: &[usize]) -> Self {
        let samples = scorer.problem.asked_area_mm2.len();
        let (mut best, mut second, mut owner) = (vec![0.0; samples], vec![f64::NEG_INFINITY; samples], vec![NONE; samples]);
        for (view, row) in (0..).zip(rows) {
            for (sample, value) in scorer.values(*row).map(|(sample, value)| (sample as usize, value)) {
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
        let of_row = |row: usize| {
            ctx.check()?;
            let mut beside = 0.0;
            let mut rises = self.without.clone();
            for (sample, value) in scorer.values(row).map(|(sample, value)| (sample as usize, value)) {
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
        (0..scorer.problem.rows.len()).into_par_iter().map(of_row).collect()
    }
}

/// Value of a sample of which [`Union`] has no second view.
fn or_nothing(second: f64) -> f64 {
    if second == f64::NEG_INFINITY { 0.0 } else { second }
}
