//! The thesis's greedy (§3.3): take the candidate with the best score over the samples not yet covered, mark them,
//! repeat. Ties break by candidate number. Each sum runs over one row in sample order, so that the result does not
//! depend on threads. Cost: O(views × table).

use rayon::prelude::*;

use super::{Choice, Problem, Selection, StopReason};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::{Objective, ScoreParams, SelectionParams};

/// Rounding of the running sum of areas: a target of 100 % is met by the sum of all parts in another order.
const SUM_SLACK: f64 = 1e-9;

pub(super) fn select(
    problem: &Problem<'_>,
    params: &SelectionParams,
    weights: &ScoreParams,
    ctx: &Context<'_>,
) -> Result<Selection, Cancelled> {
    let target_mm2 = problem.target_mm2(params) * (1.0 - SUM_SLACK);
    let least_gain_mm2 = params.min_growth * problem.asked_mm2();
    let most_views = params.max_views.map_or(usize::MAX, |views| views as usize);
    let mut open_mm2 = problem.asked_area_mm2.to_vec();
    let mut choices: Vec<Choice> = Vec::new();
    let mut covered_mm2 = 0.0;
    let stopped_because = loop {
        ctx.check()?;
        if covered_mm2 >= target_mm2 && (target_mm2 > 0.0 || !choices.is_empty()) {
            break StopReason::Target;
        }
        if choices.len() >= most_views {
            break StopReason::MaxViews;
        }
        let Some(best) = best_choice(problem, params.objective, weights, &open_mm2) else { break StopReason::NoGain };
        if best.gain_mm2 < least_gain_mm2 {
            break StopReason::Growth;
        }
        problem.rows[best.row].samples.iter().for_each(|sample| open_mm2[*sample as usize] = 0.0);
        covered_mm2 += best.gain_mm2;
        choices.push(best);
        ctx.progress((covered_mm2 * 1e3) as usize, (target_mm2 * 1e3) as usize);
    };
    Ok(Selection { choices, stopped_because })
}

/// The candidate with the highest positive score; the lowest number among equals.
fn best_choice(problem: &Problem<'_>, objective: Objective, weights: &ScoreParams, open_mm2: &[f64]) -> Option<Choice> {
    let scored: Vec<Choice> = problem
        .rows
        .par_iter()
        .enumerate()
        .map(|(row, measured)| {
            let (mut area_mm2, mut quality_mm2) = (0.0, 0.0);
            for (sample, quality) in measured.samples.iter().zip(&measured.quality) {
                area_mm2 += open_mm2[*sample as usize];
                quality_mm2 += open_mm2[*sample as usize] * f64::from(*quality);
            }
            let score = match objective {
                Objective::Score => weights.a * area_mm2 + weights.b * quality_mm2,
                Objective::Coverage => area_mm2,
            };
            Choice { row, gain_mm2: area_mm2, score }
        })
        .collect();
    let best = scored.into_iter().reduce(|best, choice| if choice.score > best.score { choice } else { best })?;
    (best.score > 0.0).then_some(best)
}
