//! The floor under grades: fewer views must not be bought with worse ones. Greedy by score chooses first; the views taken in its
//! place must give grade A, and grades A and B together, to all but a small share of the asked area to which greedy's do. A job may ask
//! for more of grade A than that; greedy's views are then joined by those that add most of it, until they give as much.
//!
//! The floors are goals like any other. Each sample has a twin for each floor: a row holds the twin of what it measures at that
//! grade or better, and a goal asks for enough area of twins. Twins count in no score. Of more than [`MAX_TWINNED`] samples only
//! every nth has twins, which stand close together behind the samples. Cost: a copy of the table, and 2 bits and 4 bytes a twin for
//! each row.

use std::borrow::Cow;

use super::overlap::Overlap;
use super::score::Uncovered;
use super::{Choice, Cover, CoverProblem, FirstChoice, Floors, Goal, StopReason, coverable_mm2, greedy, max_views};
use crate::geometry::parallel;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{RowIndex, SampleId};
use crate::planning::params::{ScoreParams, SelectionParams};
use crate::planning::verdict::Grade;
use crate::planning::visibility::{QualityScale, Row, SampleSet, ones};

/// Grades under which there is a floor, each with what is better.
const FLOORS: [Grade; 2] = [Grade::A, Grade::B];
/// Samples that have twins at most: their area is that of all to a tenth of a percent.
const MAX_TWINNED: usize = 50_000;

/// Share of the asked area that a view must add at grade A which is taken for that alone: our choice. For slivers of a demo part 90 views
/// would be taken in place of 14 to have 89 % of grade A in place of 76 %.
const MIN_ADDED: f64 = 0.005;

/// A problem with twins, and the views that greedy takes.
pub(in crate::planning) struct GradeFloor {
    rows: Vec<Row>,
    asked_area_mm2: Vec<f64>,
    weighted_area_mm2: Vec<f64>,
    goals: Vec<Goal<'static>>,
    /// Every so many samples one has twins.
    stride: usize,
    pub(super) start: Cover,
}

/// Area that views must measure of each grade that has a floor, or better, with the twins by which it was told.
pub(super) struct FloorNeeds {
    needed_mm2: Vec<f64>,
    /// Every so many samples one had twins.
    stride: usize,
    /// Area of the twins of a floor.
    twins_mm2: f64,
}

impl FloorNeeds {
    /// Area needed of twins of this area, one at every so many samples: where these are others than it was told by, the same share.
    fn on(&self, floor: usize, stride: usize, twins_mm2: f64) -> Option<f64> {
        let needed_mm2 = *self.needed_mm2.get(floor)?;
        let is_told_alike = stride == self.stride || self.twins_mm2 <= 0.0;
        Some(if is_told_alike { needed_mm2 } else { needed_mm2 / self.twins_mm2 * twins_mm2 })
    }
}

impl GradeFloor {
    /// The floor of `problem`, or that of a first choice, from which greedy then goes on; `None` where none is asked for, or
    /// quality does not count.
    pub(in crate::planning) fn of(
        problem: &CoverProblem<'_>,
        params: &SelectionParams,
        weights: &ScoreParams,
        first: Option<&FirstChoice>,
        ctx: &Context<'_>,
    ) -> Result<Option<Self>, Cancelled> {
        if !Self::is_asked(params, weights) || problem.rows.iter().any(|row| row.quality().is_none()) {
            return Ok(None);
        }
        // Without a limit of the loss, all may be lost.
        let max_loss = Self::max_loss(params, weights).unwrap_or(1.0);
        let (max_loss, needs) = match first.map(|first| &first.floors) {
            Some(Floors::MaxLoss(max_loss)) => (*max_loss, None),
            Some(Floors::Needed(needs)) => (max_loss, needs.as_ref()),
            None => (max_loss, None),
        };
        let mut start = greedy::select_after(problem, params, weights, first.map_or(&[], |first| &first.rows), ctx)?;
        let places = TwinPlaces::new(problem.asked_area_mm2.len());
        let rows: Vec<Row> = parallel::map(&problem.rows, |row| places.with_twins(row));
        let own = |goal: &Goal<'_>| Goal { area_mm2: Cow::Owned(places.of_samples(&goal.area_mm2)), needed_mm2: goal.needed_mm2 };
        let mut goals: Vec<Goal<'static>> = problem.goals.iter().map(own).collect();
        let chosen: Vec<&Row> = start.choices.iter().map(|choice| &rows[choice.row.index()]).collect();
        let floor_under = |floor: usize| {
            let area_mm2 = places.of_twins(problem.asked_area_mm2, floor);
            let twins_mm2 = area_mm2.iter().sum::<f64>();
            let of_greedy_mm2 = (coverable_mm2(&chosen, &area_mm2) - max_loss * twins_mm2).max(0.0);
            let needed_mm2 = needs.and_then(|needs| needs.on(floor, places.stride, twins_mm2)).unwrap_or(of_greedy_mm2);
            Goal { area_mm2: Cow::Owned(area_mm2), needed_mm2 }
        };
        let [mut grade_a, grade_b] = [0, 1].map(floor_under);
        if params.min_grade_a.is_some() {
            raise(&mut grade_a, &mut start, (&rows, &goals), &Overlap::new(problem, &params.overlap), params, ctx)?;
        }
        goals.extend([grade_a, grade_b]);
        Ok(Some(Self {
            rows,
            asked_area_mm2: places.of_samples(problem.asked_area_mm2),
            weighted_area_mm2: places.of_samples(&problem.weighted_area_mm2),
            goals,
            stride: places.stride,
            start,
        }))
    }

    /// Share of the asked area by which views may give less of a grade or better than greedy's; `None` where no such floor is asked
    /// for, or quality does not count.
    pub(in crate::planning) fn max_loss(params: &SelectionParams, weights: &ScoreParams) -> Option<f64> {
        params.max_grade_loss.filter(|_| Self::is_asked(params, weights))
    }

    /// Returns true if some floor is asked for, and quality counts.
    pub(in crate::planning) fn is_asked(params: &SelectionParams, weights: &ScoreParams) -> bool {
        params.keeps_grades(weights) && (params.max_grade_loss.is_some() || params.min_grade_a.is_some())
    }

    /// Place of the floor under grade A among the goals of the problem with twins.
    pub(super) fn goal_of_grade_a(&self) -> usize {
        self.goals.len() - FLOORS.len()
    }

    /// Area needed of each grade or better.
    pub(super) fn needs(&self) -> FloorNeeds {
        let floors = &self.goals[self.goals.len() - FLOORS.len()..];
        FloorNeeds {
            needed_mm2: floors.iter().map(|goal| goal.needed_mm2).collect(),
            stride: self.stride,
            twins_mm2: floors[0].area_mm2.iter().sum(),
        }
    }

    /// The problem with twins; its rows are those of `problem`.
    pub(in crate::planning) fn problem<'a>(&'a self, problem: &CoverProblem<'a>) -> CoverProblem<'a> {
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

/// Raises the floor under grade A to the share that is asked for. Views join `start`, each the one that adds most at grade A of those that
/// overlap the others as is asked for, until they give as much, none adds [`MIN_ADDED`] of the asked area, or there may be no more; the
/// floor is what they give at most. Where they are as many as there may be and give less, the floor is what is asked for: exchanges then
/// miss it by as little as they can. `rows` are those with twins, `goals` the others.
fn raise(
    grade_a: &mut Goal<'_>,
    start: &mut Cover,
    (rows, goals): (&[Row], &[Goal<'_>]),
    overlap: &Overlap<'_>,
    params: &SelectionParams,
    ctx: &Context<'_>,
) -> Result<(), Cancelled> {
    let twins_mm2 = grade_a.area_mm2.iter().sum::<f64>();
    let min_added_mm2 = MIN_ADDED.max(params.min_growth) * twins_mm2;
    let needed_mm2 = params.min_grade_a.unwrap_or_default() * twins_mm2 * (1.0 - greedy::SUM_SLACK);
    let mut chosen = start.rows();
    let mut open = Uncovered::all(&grade_a.area_mm2, ctx.simd_level());
    let mut covered_mm2 = 0.0;
    for row in &chosen {
        covered_mm2 += open.area_mm2(&rows[row.index()]);
        open.close(&rows[row.index()]);
    }
    while covered_mm2 < needed_mm2 && chosen.len() < max_views(params) {
        ctx.check()?;
        let gains = parallel::map(rows, |row| open.area_mm2(row));
        let joined = RowIndex::number(gains).filter(|(row, gain_mm2)| *gain_mm2 >= min_added_mm2 && overlap.joins(*row, &chosen));
        let best =
            joined.fold(None, |best, next| if best.is_some_and(|(_, gain_mm2)| gain_mm2 >= next.1) { best } else { Some(next) });
        let Some((row, gain_mm2)) = best else { break };
        covered_mm2 += gain_mm2;
        open.close(&rows[row.index()]);
        chosen.push(row);
        start.choices.push(Choice { row, gain_mm2: 0.0, score: 0.0 });
    }
    let is_limited = covered_mm2 < needed_mm2 && chosen.len() >= max_views(params);
    grade_a.needed_mm2 = grade_a.needed_mm2.max(if is_limited { needed_mm2 } else { needed_mm2.min(covered_mm2) });
    let taken: Vec<&Row> = chosen.iter().map(|row| &rows[row.index()]).collect();
    let is_met = |goal: &Goal<'_>| coverable_mm2(&taken, &goal.area_mm2) >= goal.needed_mm2 * (1.0 - greedy::SUM_SLACK);
    if is_limited {
        start.stopped_because = StopReason::MaxViews;
    } else if goals.iter().all(is_met) {
        start.stopped_because = StopReason::Target;
    }
    Ok(())
}

/// Borrows a goal without copying its areas.
fn borrowed<'a>(goal: &'a Goal<'_>) -> Goal<'a> {
    Goal { area_mm2: Cow::Borrowed(&goal.area_mm2), needed_mm2: goal.needed_mm2 }
}

/// Places of samples and twins: the samples, then the twins of each floor, each part in whole words.
struct TwinPlaces {
    /// Every so many samples one has twins.
    stride: usize,
    /// Samples that have twins, as words of bits.
    twinned: Vec<u64>,
    /// Places of the samples, and of the twins of a floor.
    samples: usize,
    twins: usize,
}

impl TwinPlaces {
    fn new(samples: usize) -> Self {
        let stride = samples.div_ceil(MAX_TWINNED).max(1);
        let mut twinned = SampleSet::none_of(samples);
        (0..samples).step_by(stride).for_each(|sample| twinned.insert(SampleId::at(sample)));
        let twins = samples.div_ceil(stride).next_multiple_of(64);
        Self { stride, twinned: twinned.into_words(), samples: samples.next_multiple_of(64), twins }
    }

    fn len(&self) -> usize {
        self.samples + FLOORS.len() * self.twins
    }

    /// Areas of the samples; those of twins are 0.
    fn of_samples(&self, area_mm2: &[f64]) -> Vec<f64> {
        let mut placed = area_mm2.to_vec();
        placed.resize(self.len(), 0.0);
        placed
    }

    /// Areas of the twins of a floor, each that of its sample; all others are 0.
    fn of_twins(&self, area_mm2: &[f64], floor: usize) -> Vec<f64> {
        let mut placed = vec![0.0; self.len()];
        let twins = &mut placed[self.samples + floor * self.twins..];
        twins.iter_mut().zip(area_mm2.iter().step_by(self.stride)).for_each(|(twin, area_mm2)| *twin = *area_mm2);
        placed
    }

    /// A row with the twins of its samples; the quality of a twin does not count.
    fn with_twins(&self, row: &Row) -> Row {
        let mut words = row.words().to_vec();
        words.resize(self.len() / 64, 0);
        let Some((scale, steps)) = row.quality() else { return Row::new(words) };
        let floors = FLOORS.map(|grade| first_step(scale, grade));
        let mut before = 0;
        for (block, (word, twinned)) in row.words().iter().zip(&self.twinned).enumerate() {
            for bit in ones(word & twinned) {
                let step = i32::from(steps[before + (word & ((1 << bit) - 1)).count_ones() as usize]);
                let twin = (64 * block + bit as usize) / self.stride;
                for (floor, _) in floors.iter().enumerate().filter(|(_, first)| step >= **first) {
                    let place = self.samples + floor * self.twins + twin;
                    words[place / 64] |= 1 << (place % 64);
                }
            }
            before += word.count_ones() as usize;
        }
        let with_twins = Row::new(words);
        let mut steps = steps.to_vec();
        steps.resize(with_twins.count(), 0);
        with_twins.with_quality(steps, scale)
    }
}

/// The first step of quality that has a grade or a better one.
fn first_step(scale: QualityScale, grade: Grade) -> i32 {
    let has_grade = |step: i32| f64::from(scale.quality(step as i16)) > grade.above();
    let (mut below, mut first) = (-i32::from(i16::MAX) - 1, i32::from(i16::MAX) + 1);
    while first - below > 1 {
        let middle = i32::midpoint(below, first);
        if has_grade(middle) { first = middle } else { below = middle }
    }
    first
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::planning::context::Silent;
    use crate::planning::selection::first_choice;

    /// Twins of every second sample have half the area, of which the whole was asked for.
    #[test]
    fn floors_of_a_first_choice_are_the_same_share_where_fewer_samples_have_twins() {
        let (params, weights, flag) = (SelectionParams::default(), ScoreParams::default(), AtomicBool::new(false));
        let ctx = Context::new(&flag, &Silent);
        let best = |samples: usize| Row::from_samples(samples, (0..samples).map(|sample| (SampleId::at(sample), 1.0)));
        let (before, after) = (best(MAX_TWINNED - 1), best(MAX_TWINNED + 1));
        let area_mm2 = vec![1.0; MAX_TWINNED + 1];
        let problem = |row, samples: usize| CoverProblem::new(vec![row], &area_mm2[..samples], samples as f64, &params);
        let (before, after) = (problem(&before, MAX_TWINNED - 1), problem(&after, MAX_TWINNED + 1));
        let first = first_choice(&before, &params, &weights, &ctx).expect("not cancelled");
        let floors = |problem: &CoverProblem<'_>, first: Option<&FirstChoice>| {
            let floor = GradeFloor::of(problem, &params, &weights, first, &ctx).expect("not cancelled").expect("floors");
            floor.goals[1..].iter().map(|goal| (goal.needed_mm2, goal.area_mm2.iter().sum::<f64>())).collect::<Vec<_>>()
        };
        assert_eq!(floors(&before, Some(&first)), floors(&before, None), "the same areas on the same samples");
        let share = 1.0 - params.max_grade_loss.unwrap_or_default();
        for (needed_mm2, twins_mm2) in floors(&after, Some(&first)) {
            assert!((needed_mm2 / twins_mm2 - share).abs() < 1e-9, "{needed_mm2} of {twins_mm2} mm²");
        }
    }

    #[test]
    fn a_row_holds_the_twin_of_what_it_measures_at_the_grade_or_better() {
        for samples in [200, 2 * MAX_TWINNED + 77] {
            let quality = |sample: usize| ((sample * 37) % 401) as f32 / 200.0 - 1.0;
            let measured = (0..samples).filter(|sample| sample % 5 != 2 && sample / 64 % 3 != 1);
            let row = Row::from_samples(samples, measured.map(|sample| (SampleId::at(sample), quality(sample))));
            let places = TwinPlaces::new(samples);
            let with_twins = places.with_twins(&row);
            let area_mm2: Vec<f64> = (0..samples).map(|sample| sample as f64).collect();
            assert_eq!(with_twins.words()[..row.words().len()], *row.words(), "the samples themselves");
            for (floor, grade) in FLOORS.into_iter().enumerate() {
                let twins = places.of_twins(&area_mm2, floor);
                let held: Vec<f64> = with_twins.samples().map(|twin| twins[twin.index()]).filter(|mm2| *mm2 > 0.0).collect();
                let has_grade = |(sample, quality): &(SampleId, f32)| {
                    sample.0 > 0 && sample.index().is_multiple_of(places.stride) && Grade::of(f64::from(*quality)) <= grade
                };
                let wanted: Vec<f64> = row.graded().filter(has_grade).map(|(sample, _)| f64::from(sample.0)).collect();
                assert_eq!(held, wanted, "{grade:?} of {samples} samples");
            }
            let own: Vec<_> = with_twins.graded().take(row.count()).collect();
            assert!(own.into_iter().eq(row.graded()), "the quality of the samples");
        }
    }
}
