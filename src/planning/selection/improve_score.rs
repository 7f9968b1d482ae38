//! Raises the score at the same number of views and the same goals: exchanges of one view for
//! another while G_v of the union ([`crate::planning::method::quality`], each sample by the best of its views), less the
//! cost of travel, rises.
//!
//! The values of all pairs of a row and a sample that it measures are computed once, and a step passes over them. Of a table of
//! more than [`MAX_PAIRS`] pairs a share of the samples, drawn by a hash of their numbers, tells which rows are worth a
//! closer look; the deficits of those, and the rises of the best of them, are then computed exactly. What is kept is judged by all
//! samples either way. Cost: a step passes over [`MAX_PAIRS`] values at most, and over the pairs of the chosen views.

use rayon::prelude::*;

use super::blocks::count_in;
use super::local::{Budget, Exchange, SwapPricer, Swaps};
use super::score::Scorer;
use crate::geometry::parallel;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{RowIndex, SampleId, ViewId};
use crate::planning::random::split_mix;
use crate::planning::visibility::{Row, SampleSet, ones};

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
/// Pairs of a table that is evaluated as a whole, and those of a share of a larger one, about.
const MAX_PAIRS: usize = 2_000_000;
const PAIRS_OF_SHARE: usize = 1_000_000;
/// Rows, those of the highest rises on a share, whose deficits are computed, and of these the best, whose rises are.
const PRICED_ROWS: usize = 64;
const EXACT_ROWS: usize = 4;
/// Stands for no view.
const NONE: u16 = u16::MAX;

/// Exchanges views for a higher score while the goals stay met; returns the best that are found.
pub(super) fn run(
    scorer: &Scorer<'_>,
    exchange: &Exchange<'_>,
    rows: Vec<RowIndex>,
    budget: &mut Budget,
    ctx: &Context<'_>,
) -> Result<ScoredRows, Cancelled> {
    let pairs_of = |row: &&Row| count_in(row.words(), row.words(), ctx.simd_level()) as u64;
    let table: u64 = scorer.problem.rows.par_iter().map(pairs_of).sum();
    let steps = (MAX_WORK / table.max(1)).clamp(1, MAX_STEPS);
    let values = ValueTable::new(scorer, (MAX_PAIRS, PAIRS_OF_SHARE), ctx)?;
    let mut search = ScoreSearch { scorer, exchange, values, tabu: vec![0; scorer.problem.rows.len()], best: None, rows };
    let mut since_best = 0;
    for step in 1..=steps {
        if budget.left == 0 || search.rows.is_empty() || since_best == MAX_STEPS_WITHOUT_RISE {
            break;
        }
        let (work, risen) = search.step(step, ctx)?;
        budget.spend(table + work);
        since_best = if risen { 0 } else { since_best + 1 };
    }
    Ok(search.best.unwrap_or((f64::NEG_INFINITY, search.rows)))
}

/// Views with their score, that of none that meet the goals −∞.
pub(super) type ScoredRows = (f64, Vec<RowIndex>);

/// Tabu search for the highest score; an exchange that leaves a goal unmet pays for what is missing.
struct ScoreSearch<'a> {
    scorer: &'a Scorer<'a>,
    exchange: &'a Exchange<'a>,
    values: ValueTable,
    /// First step at which each row may be exchanged again.
    tabu: Vec<u64>,
    /// The highest score of views that meet the goals, with them.
    best: Option<ScoredRows>,
    rows: Vec<RowIndex>,
}

impl ScoreSearch<'_> {
    /// Records the views if they are the best, and makes the best exchange that is allowed. Returns the work, and true if they
    /// were the best.
    fn step(&mut self, step: u64, ctx: &Context<'_>) -> Result<(u64, bool), Cancelled> {
        let Self { scorer, exchange, values, tabu, best, rows } = self;
        let union = Union::new(scorer, &values.counted, rows);
        let travel = scorer.tree_cost_mm2(rows);
        let total = union.total - travel;
        let pricer = SwapPricer::new(exchange, rows);
        let risen = pricer.deficit() == 0 && best.as_ref().is_none_or(|(best, _)| total > best + MIN_RISE * best.abs());
        if risen {
            *best = Some((total, rows.clone()));
        }
        let best_total = best.as_ref().map_or(f64::NEG_INFINITY, |(best, _)| best + MIN_RISE * best.abs());
        let is_free = |view: ViewId, row: RowIndex| tabu[row.index()] <= step && tabu[rows[view.index()].index()] <= step;
        let may_go = |view: ViewId, row: RowIndex, rise: f64| is_free(view, row) || total + rise > best_total;
        let moves = StepExchanges { scorer, exchange, values, union: &union, pricer: &pricer };
        let (moves, work) = moves.list(rows, &may_go, ctx)?;
        let mut chosen = (f64::NEG_INFINITY, None);
        for (view, row, rise, deficit) in moves.iter().flat_map(RowMoves::all) {
            let gain = rise - PRICE_OF_DEFICIT * exchange.deficit_mm2(deficit);
            if gain + travel <= chosen.0 {
                continue;
            }
            let mut exchanged = rows.clone();
            exchanged[view.index()] = row;
            let gain = gain + travel - scorer.tree_cost_mm2(&exchanged);
            let allowed = is_free(view, row) || deficit == 0 && total + gain > best_total;
            if gain > chosen.0 && allowed && exchange.overlap.connects(&exchanged) {
                chosen = (gain, Some((view, exchanged)));
            }
        }
        if let Some((view, exchanged)) = chosen.1 {
            tabu[rows[view.index()].index()] = step + TENURE;
            tabu[exchanged[view.index()].index()] = step + TENURE / 2;
            *rows = exchanged;
        }
        Ok((work, risen))
    }
}

/// Exchanges of the views for one row.
struct RowMoves {
    row: RowIndex,
    /// Rise of the score by the exchange of each view.
    rises: Vec<f64>,
    /// Deficit that it leaves; empty for a row that is a view.
    deficits: Vec<i64>,
}

impl RowMoves {
    /// View, row, rise and deficit of each.
    fn all(&self) -> impl Iterator<Item = (ViewId, RowIndex, f64, i64)> {
        let of_views = ViewId::number(self.deficits.iter().zip(&self.rises));
        of_views.map(|(view, (deficit, rise))| (view, self.row, *rise, *deficit))
    }

    /// The best gain of those that may go, as far as it is known.
    fn gain(&self, exchange: &Exchange<'_>, may_go: MayGo<'_>) -> f64 {
        let may_go = self.all().filter(|(view, row, rise, _)| may_go(*view, *row, *rise));
        let gains = may_go.map(|(_, _, rise, deficit)| rise - PRICE_OF_DEFICIT * exchange.deficit_mm2(deficit));
        gains.fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Returns true if a view may be exchanged for a row, by which the score rises so far at most.
type MayGo<'a> = &'a dyn Fn(ViewId, RowIndex, f64) -> bool;

/// Exchanges of a step, with what they are priced by.
struct StepExchanges<'a> {
    scorer: &'a Scorer<'a>,
    exchange: &'a Exchange<'a>,
    values: &'a ValueTable,
    union: &'a Union,
    pricer: &'a SwapPricer<'a>,
}

impl StepExchanges<'_> {
    /// The exchanges among which a step chooses, ascending by row, and the work of finding them.
    fn list(&self, rows: &[RowIndex], may_go: MayGo<'_>, ctx: &Context<'_>) -> Result<(Vec<RowMoves>, u64), Cancelled> {
        let union = self.union;
        let of_row = |(row, values): (usize, &RowValues)| ctx.check().map(|()| (RowIndex::at(row), union.rises(values.iter())));
        let rises = self.values.of_row.par_iter().enumerate().map(of_row).collect::<Result<Vec<_>, Cancelled>>()?;
        if self.values.is_share {
            let others = rises.into_iter().filter(|(row, _)| !rows.contains(row)).collect();
            return Ok(self.best_by_share(others, may_go, ctx));
        }
        let swaps = Swaps::of(self.pricer, self.exchange.problem, rows, ctx)?;
        let moves = rises.into_iter().zip(swaps.deficits).map(|((row, rises), deficits)| RowMoves { row, rises, deficits });
        Ok((moves.collect(), self.pricer.work(self.values.of_row.len())))
    }

    /// The best by the rises on a share of the samples, with what they truly are.
    fn best_by_share(&self, mut rises: Vec<(RowIndex, Vec<f64>)>, may_go: MayGo<'_>, ctx: &Context<'_>) -> (Vec<RowMoves>, u64) {
        let highest = |(row, rises): &(RowIndex, Vec<f64>)| {
            let may_go = ViewId::number(rises).filter(|(view, rise)| may_go(*view, *row, **rise));
            may_go.map(|(_, rise)| *rise).fold(f64::NEG_INFINITY, f64::max)
        };
        rises.sort_by_cached_key(|of_row| (descending(highest(of_row)), of_row.0));
        rises.truncate(PRICED_ROWS);
        let work = self.pricer.work(rises.len());
        let Self { scorer, exchange, values, union, pricer } = self;
        let priced = |(row, rises): (RowIndex, Vec<f64>)| {
            let deficits = pricer.deficits(scorer.problem.row(row), ctx.simd_level());
            RowMoves { row, rises, deficits }
        };
        let mut moves: Vec<RowMoves> = rises.into_par_iter().map(priced).collect();
        moves.sort_by_cached_key(|moves| (descending(moves.gain(exchange, may_go)), moves.row));
        moves.truncate(EXACT_ROWS);
        let exact = |moves: RowMoves| {
            let values = scorer.values(moves.row, &values.counted).map(|(sample, value)| (sample.index(), value));
            RowMoves { rises: union.rises(values), ..moves }
        };
        let mut moves: Vec<RowMoves> = moves.into_par_iter().map(exact).collect();
        moves.sort_by_key(|moves| moves.row);
        (moves, work)
    }
}

/// A key by which numbers are sorted, the highest first: their bits, ordered as `f64::total_cmp` has them.
fn descending(number: f64) -> i64 {
    let bits = number.to_bits() as i64;
    !(bits ^ ((bits >> 63) as u64 >> 1) as i64)
}

/// Samples that a row measures, with their values.
struct RowValues {
    samples: Vec<u32>,
    values: Vec<f64>,
}

impl RowValues {
    fn iter(&self) -> impl Iterator<Item = (usize, f64)> {
        self.samples.iter().zip(&self.values).map(|(sample, value)| (*sample as usize, *value))
    }
}

/// Values of the pairs of row and sample that count in the score.
struct ValueTable {
    /// Samples that count, as words of bits.
    counted: Vec<u64>,
    of_row: Vec<RowValues>,
    /// Set where the table has a share of these samples, whose values stand for the others too.
    is_share: bool,
}

impl ValueTable {
    /// Makes the table, or if it had more than `max` pairs, that of a share of about so many.
    fn new(scorer: &Scorer<'_>, (max, of_share): (usize, usize), ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let problem = scorer.problem;
        let mut counted = SampleSet::none_of(problem.weighted_area_mm2.len());
        let counts = SampleId::number(problem.weighted_area_mm2.iter()).filter(|(_, area_mm2)| **area_mm2 > 0.0);
        counts.for_each(|(sample, _)| counted.insert(sample));
        let counted = counted.into_words();
        let pairs_of = |row: &&Row| count_in(row.words(), &counted, ctx.simd_level());
        let pairs: usize = problem.rows.par_iter().map(pairs_of).sum();
        let is_share = pairs > max;
        let samples_a_drawn = if is_share { pairs.div_ceil(of_share) as u64 } else { 1 };
        let drawn = |(first, word): (u64, &u64)| {
            let of_share = ones(*word).filter(|bit| split_mix(first + u64::from(*bit)).is_multiple_of(samples_a_drawn));
            of_share.fold(0, |drawn, bit| drawn | 1 << bit)
        };
        let drawn: Vec<u64> = (0..).step_by(64).zip(&counted).map(drawn).collect();
        let scale = samples_a_drawn as f64;
        let of_row = |row: usize| {
            ctx.check()?;
            let values = scorer.values(RowIndex::at(row), &drawn).map(|(sample, value)| (sample.0, value * scale));
            let (samples, values) = values.unzip();
            Ok(RowValues { samples, values })
        };
        let of_row = parallel::try_map_range::<_, Cancelled>(problem.rows.len(), of_row)?;
        Ok(Self { counted, of_row, is_share })
    }
}

/// Value of each sample by the best and by the second best of some views.
struct Union {
    of_sample: Vec<BestValues>,
    /// Change of the value when a view is removed, for each view.
    without: Vec<f64>,
    total: f64,
}

/// Values of a sample.
#[derive(Clone, Copy)]
struct BestValues {
    best: f64,
    second: f64,
    /// The view that is best; [`NONE`] where no view measures the sample.
    owner: u16,
}

impl Union {
    fn new(scorer: &Scorer<'_>, counted: &[u64], rows: &[RowIndex]) -> Self {
        let nothing = BestValues { best: 0.0, second: f64::NEG_INFINITY, owner: NONE };
        let mut of_sample = vec![nothing; scorer.problem.weighted_area_mm2.len()];
        for (view, row) in (0..).zip(rows) {
            for (sample, value) in scorer.values(*row, counted) {
                let own = &mut of_sample[sample.index()];
                if own.owner == NONE || value > own.best {
                    if own.owner != NONE {
                        own.second = own.best;
                    }
                    (own.best, own.owner) = (value, view);
                } else {
                    own.second = own.second.max(value);
                }
            }
        }
        let mut without = vec![0.0; rows.len()];
        for own in of_sample.iter().filter(|own| own.owner != NONE) {
            without[usize::from(own.owner)] += or_nothing(own.second) - own.best;
        }
        Self { total: of_sample.iter().map(|own| own.best).sum(), of_sample, without }
    }

    /// Rise of the score by the exchange of each view for a row of these values.
    fn rises(&self, values: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
        let mut beside = 0.0;
        let mut rises = self.without.clone();
        for (sample, value) in values {
            let BestValues { best, second, owner } = self.of_sample[sample];
            if owner == NONE {
                beside += value;
                continue;
            }
            let over_best = (value - best).max(0.0);
            let over_second = if second == f64::NEG_INFINITY { value } else { (value - second).max(0.0) };
            beside += over_best;
            rises[usize::from(owner)] += over_second - over_best;
        }
        rises.iter_mut().for_each(|rise| *rise += beside);
        rises
    }
}

/// Value of a sample of which [`Union`] has no second view.
fn or_nothing(second: f64) -> f64 {
    if second == f64::NEG_INFINITY { 0.0 } else { second }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::planning::context::Silent;
    use crate::planning::params::{ScoreParams, SelectionParams};
    use crate::planning::selection::CoverProblem;
    use crate::planning::selection::overlap::Overlap;
    use crate::planning::selection::units::Units;

    #[test]
    fn exchanges_chosen_by_a_share_have_the_rises_and_deficits_of_all_samples() {
        let row = |row: u32| {
            let measured = (0..600_u32).filter(move |sample| split_mix(u64::from(sample / 7 + 1_000 * row)).is_multiple_of(3));
            Row::from_samples(600, measured.map(move |sample| (SampleId(sample), ((sample + row) % 9) as f32 / 5.0 - 0.8)))
        };
        let (rows, area_mm2): (Vec<Row>, Vec<f64>) = ((0..90).map(row).collect(), (0..600).map(|at| f64::from(at % 5)).collect());
        let (params, weights) = (SelectionParams::default(), ScoreParams::default());
        let problem = CoverProblem::new(rows.iter().collect(), &area_mm2, 1e9, &params);
        let flag = AtomicBool::new(false);
        let ctx = Context::new(&flag, &Silent);
        let (scorer, goals) = (Scorer::new(&problem, &params, &weights, ctx.simd_level()), Units::of_goals(&problem));
        let overlap = Overlap::new(&problem, &params.overlap);
        let exchange = Exchange { problem: &problem, goals: &goals, overlap: &overlap };
        let chosen = [3, 20, 41].map(RowIndex::at);
        let list = |max_pairs: usize| {
            let values = ValueTable::new(&scorer, (max_pairs, max_pairs / 4), &ctx).expect("not cancelled");
            let (union, pricer) = (Union::new(&scorer, &values.counted, &chosen), SwapPricer::new(&exchange, &chosen));
            let moves = StepExchanges { scorer: &scorer, exchange: &exchange, values: &values, union: &union, pricer: &pricer };
            (values.is_share, moves.list(&chosen, &|_, _, _| true, &ctx).expect("not cancelled").0)
        };
        let ((is_share, all), (_, by_share)) = (list(MAX_PAIRS), list(8_000));
        assert!(!is_share && by_share.len() == EXACT_ROWS && by_share.windows(2).all(|pair| pair[0].row < pair[1].row));
        for moves in &by_share {
            let whole = &all[moves.row.index()];
            assert_eq!((&moves.rises, &moves.deficits), (&whole.rises, &whole.deficits), "{:?}", moves.row);
        }
        let best = |moves: &[RowMoves]| {
            moves.iter().map(|moves| moves.gain(&exchange, &|_, _, _| true)).fold(f64::NEG_INFINITY, f64::max)
        };
        let (of_all, of_share) = (best(&all), best(&by_share));
        assert!(of_share <= of_all && of_share > of_all - 0.2 * of_all.abs(), "{of_share} of {of_all} mm²");
    }
}
