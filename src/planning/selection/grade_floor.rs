//! The floor under grades: fewer views must not be bought with worse ones. Greedy by score chooses first; the views taken in its
//! place must give grade A, and grades A and B together, to all but a small share of the asked area to which greedy's do.
//!
//! The floors are goals like any other. Each sample has a twin for each floor: a row holds the twin of what it measures at that
//! grade or better, and a goal asks for enough area of twins. Twins count in no score. Of more than [`MAX_TWINNED`] samples only
//! every nth has twins. Cost: a copy of the table, and 2 bits a sample and 2 bytes a twin for each row.

use std::borrow::Cow;

use rayon::prelude::*;

use super::{CoverProblem, Goal, greedy};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::{Objective, ScoreParams, SelectionParams};
use crate::planning::verdict::Grade;
use crate::planning::visibility::{Row, SampleSet};

/// Grades under which there is a floor, each with what is better.
const FLOORS: [Grade; 2] = [Grade::A, Grade::B];
/// Samples that have twins at most: their area is that of all to a tenth of a percent.
const MAX_TWINNED: usize = 50_000;

/// A problem with twins, and the views that greedy takes.
pub(super) struct GradeFloor {
    rows: Vec<Row>,
    asked_area_mm2: Vec<f64>,
    weighted_area_mm2: Vec<f64>,
    goals: Vec<Goal<'static>>,
    pub(super) start: super::Cover,
}

impl GradeFloor {
    /// The floor of `problem`; `None` where none is asked for, or quality does not count.
    pub(super) fn of(
        problem: &CoverProblem<'_>,
        params: &SelectionParams,
        weights: &ScoreParams,
        ctx: &Context<'_>,
    ) -> Result<Option<Self>, Cancelled> {
        let Some(max_loss) = params.max_grade_loss else { return Ok(None) };
        let counts = params.objective == Objective::Score && weights.b > 0.0 && !super::is_for_coverage(params);
        if !counts || problem.rows.iter().any(|row| row.quality().is_none()) {
            return Ok(None);
        }
        let start = greedy::select(problem, params, weights, ctx)?;
        let length = problem.asked_area_mm2.len().next_multiple_of(64);
        // The samples, then their twins for each floor.
        let placed = |area_mm2: &[f64], place: usize| {
            let mut placed = vec![0.0; length * (1 + FLOORS.len())];
            placed[length * place..][..area_mm2.len()].copy_from_slice(area_mm2);
            placed
        };
        let goal =
            |area_mm2: &[f64], place: usize, needed_mm2: f64| Goal { area_mm2: Cow::Owned(placed(area_mm2, place)), needed_mm2 };
        let mut goals: Vec<Goal<'static>> = problem.goals.iter().map(|own| goal(&own.area_mm2, 0, own.needed_mm2)).collect();
        let stride = problem.asked_area_mm2.len().div_ceil(MAX_TWINNED).max(1);
        let twinned = |(sample, area_mm2): (usize, &f64)| if sample.is_multiple_of(stride) { *area_mm2 } else { 0.0 };
        let twinned_mm2: Vec<f64> = problem.asked_area_mm2.iter().enumerate().map(twinned).collect();
        for (place, grade) in (1..).zip(FLOORS) {
            let mut by_greedy = SampleSet::none_of(problem.asked_area_mm2.len());
            start.choices.iter().for_each(|choice| by_greedy.insert_all(&at_least(problem.row(choice.row), grade, stride)));
            let greedy_mm2: f64 = by_greedy.iter().map(|sample| twinned_mm2[sample.index()]).sum();
            let needed_mm2 = greedy_mm2 - max_loss * twinned_mm2.iter().sum::<f64>();
            goals.push(goal(&twinned_mm2, place, needed_mm2.max(0.0)));
        }
        Ok(Some(Self {
            rows: problem.rows.par_iter().map(|row| with_twins(row, stride)).collect(),
            asked_area_mm2: placed(problem.asked_area_mm2, 0),
            weighted_area_mm2: placed(&problem.weighted_area_mm2, 0),
            goals,
            start,
        }))
    }

    /// The problem with twins; its rows are those of `problem`.
    pub(super) fn problem<'a>(&'a self, problem: &CoverProblem<'a>) -> CoverProblem<'a> {
        CoverProblem {
            rows: self.rows.iter().collect(),
            asked_area_mm2: &self.asked_area_mm2,
            weighted_area_mm2: Cow::Borrowed(&self.weighted_area_mm2),
            goals: self.goals.iter().map(borrowed).collect(),
            view_secs: problem.view_secs,
            travel_secs: problem.travel_secs,
        }
    }
}

/// Borrows a goal without copying its areas.
fn borrowed<'a>(goal: &'a Goal<'_>) -> Goal<'a> {
    Goal { area_mm2: Cow::Borrowed(&goal.area_mm2), needed_mm2: goal.needed_mm2 }
}

/// Every `stride`th sample, where a row measures it at this grade or better.
fn at_least(row: &Row, grade: Grade, stride: usize) -> SampleSet {
    let mut samples = SampleSet::from_words(vec![0; row.words().len()]);
    let twinned = row.graded().filter(|(sample, _)| sample.index().is_multiple_of(stride));
    let graded = twinned.filter(|(_, quality)| f64::from(*quality) > grade.above());
    graded.for_each(|(sample, _)| samples.insert(sample));
    samples
}

/// A row with the twins of its samples; the quality of a twin does not count.
fn with_twins(row: &Row, stride: usize) -> Row {
    let twins = FLOORS.map(|grade| at_least(row, grade, stride));
    let words = std::iter::once(row.words()).chain(twins.iter().map(SampleSet::words));
    let with_twins = Row::new(words.collect::<Vec<_>>().concat());
    match row.quality() {
        Some((scale, steps)) => {
            let count = with_twins.count();
            let mut steps = steps.to_vec();
            steps.resize(count, 0);
            with_twins.with_quality(steps, scale)
        }
        None => with_twins,
    }
}
