//! Bound of the choice: a lower bound on the number of views of any choice from the same candidates, by the linear
//! relaxation and exact arithmetic (`multipliers.rs`); `certified` raises it by branch and bound.
//!
//! Goals that count: every goal, the plan's own target first; where the plan does not reach a goal (the
//! target cannot be met, growth ended it, the views were limited), the area of it that the plan measures. Overlap, time and
//! quality are left out, which makes it a bound with them as well.
//!
//! No choice depends on it, and it takes as long as all choices together: a selection comes with what its bound is computed from
//! ([`OpenBound`]), which a plan computes beside the stages that follow. Cost: 15 to 60 steps of at most [`QUICK`], once to price rows
//! and up to four times with those that can count; a tenth of a second to a second.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::multipliers::{BoundTarget, Multipliers, Prices, RelaxationSize};
use super::units::Units;
use super::{CoverProblem, is_for_coverage, max_views};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::SelectionParams;
use crate::planning::visibility::Row;

/// Size of the relaxation that every solver gets.
const QUICK: RelaxationSize =
    RelaxationSize { step: 4e6, rows: 400, prices: Some(Prices { step: 2e6, rows: 56, free_rows: 128 }) };

/// Goals that a bound is computed from at most, unless more count samples that the plan's own does not: a step of the relaxation takes half
/// their square for each class. Our choice.
const MAX_GOALS: usize = 40;

/// Bound on the number of views, or on the area, of any choice from the same candidates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bound {
    /// Lower bound of the views of any choice from the same candidates that reaches the plan's goals, or the area that the plan
    /// measures of those that it does not reach.
    pub views_lower: u32,
    /// Views chosen minus `views_lower`.
    pub gap: u32,
    /// Upper bound of the share of the asked area that `selection.max_views` views can measure; with the best coverage as goal. On the
    /// samples that views are chosen on; of a plan the share that it measures of all samples, and the gap.
    pub of_asked_upper: Option<f64>,
    /// Share by which other views could measure more of the samples that views are chosen on; 0 where the choice is proved best there.
    pub gap_of_asked: Option<f64>,
}

/// The goals of the problem, each lowered to the area that `rows` reach.
pub(super) fn goals_of(problem: &CoverProblem<'_>, rows: &[&Row], for_coverage: bool) -> Vec<Units> {
    let mut goals = Units::of_goals(problem);
    if for_coverage {
        goals.truncate(1);
        goals.iter_mut().for_each(|goal| goal.needed = goal.total);
    }
    goals.iter_mut().for_each(|goal| goal.clamp_to(rows));
    goals
}

/// Picks the goals that a bound is computed from, where there are more than [`MAX_GOALS`]: of goals of the same samples the one that needs
/// most, and of these the plan's own, those that count samples which it does not, and those that need the most area. Views that meet all
/// goals meet these, so that a bound for these holds for all; and they count every sample that any goal counts, so that a search over
/// them drops no row that another goal needs. `None` where all are taken.
pub(super) fn decisive(goals: &[Units]) -> Option<Vec<Units>> {
    if goals.len() <= MAX_GOALS {
        return None;
    }
    // Places of goals whose samples differ, by the samples that they count, and what those like each need at most.
    let mut alike: BTreeMap<&[u64], Vec<usize>> = BTreeMap::new();
    let mut needs: BTreeMap<usize, i64> = BTreeMap::new();
    for (place, goal) in goals.iter().enumerate() {
        let alike = alike.entry(goal.counted_words()).or_default();
        let known = alike.iter().copied().find(|other| goals[*other].of_sample == goal.of_sample);
        if known.is_none() {
            alike.push(place);
        }
        let needed = needs.entry(known.unwrap_or(place)).or_insert(goal.needed);
        *needed = goal.needed.max(*needed);
    }
    let mut largest: Vec<(usize, i64)> = needs.into_iter().collect();
    let is_taken = |place: usize| place == 0 || goals[place].counts_beyond(&goals[0]);
    largest.sort_by(|(a, of_a), (b, of_b)| {
        let area_mm2 = |place: &usize, needed: &i64| goals[*place].area_mm2(*needed);
        is_taken(*b).cmp(&is_taken(*a)).then_with(|| area_mm2(b, of_b).total_cmp(&area_mm2(a, of_a)))
    });
    let taken = largest.iter().filter(|(place, _)| is_taken(*place)).count();
    largest.truncate(MAX_GOALS.max(taken));
    largest.sort_unstable();
    let raised = |(place, needed): (usize, i64)| {
        let mut goal = goals[place].clone();
        goal.needed = needed;
        goal
    };
    Some(largest.into_iter().map(raised).collect())
}

/// The fewest views that `goals`, which `views` views meet, ask for by the relaxation alone.
pub(super) fn views_lower(
    problem: &CoverProblem<'_>,
    goals: &[Units],
    views: usize,
    ctx: &Context<'_>,
) -> Result<usize, Cancelled> {
    Ok(Multipliers::relaxed(problem, goals, BoundTarget::FewestViews, (&QUICK, views), ctx)?.views_lower())
}

/// A bound that may still have to be computed.
pub(in crate::planning) enum OpenBound {
    Known(Bound),
    Open(Box<BoundProblem>),
}

/// The sets and goals that a bound is computed from.
pub(in crate::planning) struct BoundProblem {
    /// Samples that each row's view measures.
    rows: Vec<Row>,
    asked_area_mm2: Vec<f64>,
    goals: Vec<Units>,
    /// Views that meet them.
    views: usize,
    /// Number of views that may be chosen, for the best coverage.
    max_views: Option<usize>,
}

impl OpenBound {
    /// The bound of chosen rows of a problem.
    pub(super) fn of(problem: &CoverProblem<'_>, params: &SelectionParams, chosen: &[&Row], rows: Vec<Row>) -> Self {
        let for_coverage = is_for_coverage(params);
        let goals = goals_of(problem, chosen, for_coverage);
        Self::Open(Box::new(BoundProblem {
            rows,
            asked_area_mm2: problem.asked_area_mm2.to_vec(),
            goals: decisive(&goals).unwrap_or(goals),
            views: chosen.len(),
            max_views: for_coverage.then(|| max_views(params)),
        }))
    }

    /// Computes the bound.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn compute(&self, ctx: &Context<'_>) -> Result<Bound, Cancelled> {
        match self {
            Self::Known(bound) => Ok(*bound),
            Self::Open(problem) => problem.bound(ctx),
        }
    }
}

impl BoundProblem {
    fn bound(&self, ctx: &Context<'_>) -> Result<Bound, Cancelled> {
        let problem = CoverProblem {
            rows: self.rows.iter().collect(),
            asked_area_mm2: &self.asked_area_mm2,
            weighted_area_mm2: Cow::Borrowed(&self.asked_area_mm2),
            goals: Vec::new(),
            view_secs: 0.0,
            travel_secs: None,
        };
        let goals = &self.goals;
        let bound = Bound::of_views(views_lower(&problem, goals, self.views, ctx)?, self.views);
        let Some(views) = self.max_views else { return Ok(bound) };
        let largest = Multipliers::relaxed(&problem, goals, BoundTarget::MostArea(views), (&QUICK, usize::MAX), ctx)?;
        Ok(bound.with_max_units(&problem, &goals[0], largest.max_units(views)))
    }
}

impl Bound {
    pub(super) fn of_views(views_lower: usize, views: usize) -> Self {
        let views_lower = views_lower.min(views);
        Self { views_lower: views_lower as u32, gap: (views - views_lower) as u32, ..Self::default() }
    }

    /// The bound beside so many views, at least as many as it was computed for.
    pub(in crate::planning) fn beside(self, views: usize) -> Self {
        Self { gap: (views as u32).saturating_sub(self.views_lower), ..self }
    }

    /// The bound of a plan that measures this share of the asked area, by all samples; `None` where the bound is of something else: where
    /// the plan does not count all that the chosen views measure, or these were chosen by what they measure under errors too.
    pub(in crate::planning) fn of_plan(self, of_asked: Option<f64>) -> Self {
        let gap_of_asked = self.gap_of_asked.filter(|_| of_asked.is_some());
        let of_asked_upper = of_asked.zip(gap_of_asked).map(|(of_asked, gap)| (of_asked + gap).min(1.0));
        Self { of_asked_upper, gap_of_asked, ..self }
    }

    /// Adds the bound for the best coverage: `upper` units are possible, and those needed are measured.
    pub(super) fn with_max_units(self, problem: &CoverProblem<'_>, goal: &Units, upper: i64) -> Self {
        let asked_mm2 = problem.asked_mm2();
        let share = |units: i64| if asked_mm2 > 0.0 { (goal.area_mm2(units) / asked_mm2).min(1.0) } else { 0.0 };
        let upper = upper.clamp(goal.needed, goal.measured.max(goal.needed));
        let gap = if upper == goal.needed { 0.0 } else { share(upper) - share(goal.needed) };
        Self { of_asked_upper: Some(share(upper)), gap_of_asked: Some(gap), ..self }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::planning::context::Silent;
    use crate::planning::ids::{RowIndex, SampleId};
    use crate::planning::random::split_mix;
    use crate::planning::selection::Goal;
    use crate::planning::selection::classes::Classes;

    const SAMPLES: usize = 60;

    /// Twelve rows that each measure two fifths of the samples, and together all.
    fn table() -> Vec<Row> {
        let measures =
            |row: u64, sample: u32| u64::from(sample) % 12 == row || split_mix(1_000 * row + u64::from(sample)).is_multiple_of(3);
        let row = |row: u64| {
            let measured = (0..SAMPLES as u32).filter(|sample| measures(row, *sample));
            Row::from_samples(SAMPLES, measured.map(|sample| (SampleId(sample), 0.0)))
        };
        (0..12).map(row).collect()
    }

    fn goal_of(holds: impl Fn(usize) -> bool, share: f64) -> Goal<'static> {
        let area_mm2: Vec<f64> = (0..SAMPLES).map(|sample| f64::from(u8::from(holds(sample)))).collect();
        Goal { needed_mm2: share * area_mm2.iter().sum::<f64>(), area_mm2: Cow::Owned(area_mm2) }
    }

    fn problem<'a>(rows: &'a [Row], area_mm2: &'a [f64], goals: Vec<Goal<'a>>) -> CoverProblem<'a> {
        let mut problem = CoverProblem::new(rows.iter().collect(), area_mm2, SAMPLES as f64, &SelectionParams::default());
        problem.goals[0].needed_mm2 = 0.5 * SAMPLES as f64;
        problem.goals.extend(goals);
        problem
    }

    fn lower(problem: &CoverProblem<'_>, goals: &[Units]) -> usize {
        let flag = AtomicBool::new(false);
        views_lower(problem, goals, usize::MAX, &Context::new(&flag, &Silent)).unwrap_or_else(|_| unreachable!())
    }

    /// A step took 2000² products for each class: 20 s for a bound on a box.
    #[test]
    fn of_2000_equal_goals_the_one_that_needs_most_enters_a_bound_within_its_work() {
        let (rows, area_mm2) = (table(), [1.0; SAMPLES]);
        let of_half = |share: f64| goal_of(|sample| sample.is_multiple_of(2), share);
        let many = (0..2_000).map(|at| of_half(if at == 1_234 { 0.9 } else { 0.6 })).collect();
        let (problem, needed) = (problem(&rows, &area_mm2, many), 0.9 * SAMPLES as f64 / 2.0);
        let all = Units::of_goals(&problem);
        let some = decisive(&all).expect("fewer goals");
        assert_eq!(some.len(), 2);
        assert!((some[1].area_mm2(some[1].needed) - needed).abs() < 1e-6, "{} mm²", some[1].area_mm2(some[1].needed));
        let samples: Vec<SampleId> = SampleId::first(SAMPLES).collect();
        let numbers: Vec<RowIndex> = problem.all_rows().collect();
        let work = |goals: &[Units]| Classes::new(&problem, goals, &samples, &numbers).step_work();
        assert!(work(&all) > QUICK.step && work(&some) < QUICK.step, "{} and {}", work(&all), work(&some));
        assert_eq!(lower(&problem, &some), lower(&problem, &[all[0].clone(), all[1_235].clone()]));
        assert!(decisive(&all[..MAX_GOALS]).is_none(), "few goals enter as they are");
    }

    #[test]
    fn a_bound_of_some_of_many_goals_is_none_above_the_fewest_views_for_all() {
        let (rows, area_mm2) = (table(), [1.0; SAMPLES]);
        let goal = |at: usize| goal_of(move |sample| split_mix((at * SAMPLES + sample) as u64) % 200 < at as u64, 0.85);
        let problem = problem(&rows, &area_mm2, (1..=150).map(goal).collect());
        let all = Units::of_goals(&problem);
        let some = decisive(&all).expect("fewer goals");
        assert_eq!((some.len(), some[0].needed), (MAX_GOALS, all[0].needed));
        let measured =
            |set: u32| -> Vec<&Row> { (0..rows.len()).filter(|row| set >> row & 1 == 1).map(|row| &rows[row]).collect() };
        let meets = |set: &u32, goals: &[Units]| goals.iter().all(|goal| goal.covered_by(&measured(*set)) >= goal.needed);
        let fewest = |goals: &[Units]| (0..1_u32 << rows.len()).filter(|set| meets(set, goals)).map(u32::count_ones).min();
        let (of_own, of_some, of_all) = (fewest(&all[..1]), fewest(&some), fewest(&all));
        assert!(of_own < of_some && of_some <= of_all, "{of_own:?}, {of_some:?}, {of_all:?}");
        let bound = lower(&problem, &some) as u32;
        assert!(bound > 1 && Some(bound) <= of_some, "{bound} of {of_some:?}");
    }
}
