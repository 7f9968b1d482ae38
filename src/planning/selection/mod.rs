//! Choice of views from the visibility matrix (thesis §3.3, [`crate::planning::method::selection`]): the greedy rule and its stop
//! reasons, solvers that need fewer views, and the bound that tells how many fewer there could be.
//!
//! `greedy` and `lazy` make the same choices; `local` exchanges views; `certified` adds branch and bound. Every one of
//! them comes with a [`Bound`]. All are limited by work, never by a clock, and give the same on any number of threads and with any
//! vector instructions: areas of covering are whole numbers, added in blocks of 64 samples (`blocks.rs`).

mod blocks;
mod bound;
mod branch;
mod certified;
mod cholesky;
mod classes;
mod columns;
mod grade_floor;
mod greedy;
mod improve_score;
mod incidence;
mod lazy;
mod local;
mod multipliers;
mod overlap;
mod relaxation;
mod score;
#[cfg(test)]
mod tests;
mod units;

use std::borrow::Cow;
use std::sync::Arc;

use super::context::{Cancelled, Context};
use super::ids::{RowIndex, ViewId};
use super::params::{ScoreParams, SelectionGoal, SelectionParams, Solver, TargetOf};
use super::visibility::{Row, SampleSet};
use grade_floor::FloorNeeds;
use local::ScoredViews;

pub use bound::Bound;
pub(in crate::planning) use bound::OpenBound;
pub(in crate::planning) use grade_floor::GradeFloor;
pub(in crate::planning) use overlap::Overlap;

/// Seconds that the cell needs from the view of one row to that of another.
pub type TravelSecs<'a> = &'a (dyn Fn(RowIndex, RowIndex) -> f64 + Sync);

/// The problem of covering enough area with few views: candidates, goals and costs.
#[derive(Clone)]
pub struct CoverProblem<'a> {
    /// Rows of the candidates that may be chosen, ascending by candidate number.
    pub rows: Vec<&'a Row>,
    /// Area that each sample stands for, mm²; 0 for samples that are not asked for.
    pub asked_area_mm2: &'a [f64],
    /// Area by which each sample counts in the score, mm²: its asked area times a weight.
    pub weighted_area_mm2: Cow<'a, [f64]>,
    /// Goals, all of which must be met. The first is the plan's own target.
    pub goals: Vec<Goal<'a>>,
    /// Time that a view takes beside the travel to it.
    pub view_secs: f64,
    /// Travel between two rows' views; `None` counts none.
    pub travel_secs: Option<TravelSecs<'a>>,
}

/// An area of which enough must be measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal<'a> {
    /// Area that each sample counts for, mm²; 0 for samples that do not count.
    pub area_mm2: Cow<'a, [f64]>,
    /// Part of that area that must be measured, mm².
    pub needed_mm2: f64,
}

/// A chosen view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Row of the view.
    pub row: RowIndex,
    /// Asked area that it added, mm².
    pub gain_mm2: f64,
    /// Score of the view when it was chosen, mm²: G_v, or plain area, less what its time costs.
    pub score: f64,
}

crate::cell::closed_list! {
    /// The rule that ended the selection.
    pub enum StopReason {
        /// The target share was reached.
        Target = "target",
        /// No further view of positive score would add `selection.min_growth`.
        Growth = "growth",
        /// `selection.max_views` views were chosen.
        MaxViews = "max_views",
        /// No candidate's score is positive.
        NoGain = "no_gain",
        /// The target was met only of the area that views with a path measure; others were tried in place of those without. Of further
        /// views: no view with a path gains anything in place of those without, or some of the last choice have none.
        NoPath = "no_path",
        /// The target was met, or nothing more could be gained, but of a region or feature with a target of its own a smaller share
        /// of the asked area is measured.
        RegionsUnmet = "regions_unmet",
    }
}

/// Chosen views, in the order chosen, with their bound.
#[derive(Clone, Debug, PartialEq)]
pub struct Selection {
    /// The choices.
    pub choices: Vec<Choice>,
    /// The rule that ended it.
    pub stopped_because: StopReason,
    /// Bound of the number of views, or of the area.
    pub bound: Bound,
}

/// Chosen views, in the order chosen, with a bound that may still have to be computed.
pub(in crate::planning) struct OpenSelection {
    pub(in crate::planning) choices: Vec<Choice>,
    pub(in crate::planning) stopped_because: StopReason,
    pub(in crate::planning) bound: Arc<OpenBound>,
    /// Choices of a lower score, as many, to fall back on: before views with more area at grade A were looked for.
    pub(in crate::planning) before_raise: Option<Vec<Choice>>,
}

/// A first choice, in place of which or beside which other views are looked for.
pub(in crate::planning) struct FirstChoice {
    pub(in crate::planning) rows: Vec<RowIndex>,
    floors: Floors,
}

/// Floors under grades that a first choice sets.
enum Floors {
    /// Area that views must measure of each grade that has a floor, or better; `None` without floors.
    Needed(Option<FloorNeeds>),
    /// Share of the asked area by which views may give less of a grade or better than the first choice does.
    MaxLoss(f64),
}

impl FirstChoice {
    /// Makes a first choice of whose grades others may lose a share of the asked area.
    pub(in crate::planning) fn with_max_loss(rows: Vec<RowIndex>, max_loss: f64) -> Self {
        Self { rows, floors: Floors::MaxLoss(max_loss) }
    }
}

/// Chosen views without their bound.
#[derive(Clone)]
pub(in crate::planning) struct Cover {
    choices: Vec<Choice>,
    stopped_because: StopReason,
}

/// Times that greedy goes on from exchanged views at most, where growth or the limit of views ended their choice: our choice.
const MAX_CONTINUATIONS: usize = 4;

/// Chooses views, of the number that a plan takes; a plan then looks for as many with more area at grade A.
///
/// # Errors
/// [`Cancelled`].
pub fn select(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    score: &ScoreParams,
    ctx: &Context<'_>,
) -> Result<Selection, Cancelled> {
    let OpenSelection { choices, stopped_because, bound, before_raise } = choose(problem, params, score, None, ctx)?;
    Ok(Selection { choices: before_raise.unwrap_or(choices), stopped_because, bound: bound.compute(ctx)? })
}

/// Chooses views; their bound may still have to be computed. The floors under grades are those of a `first` choice,
/// whose rows are among those of the problem.
///
/// # Errors
/// [`Cancelled`].
pub(in crate::planning) fn choose(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    score: &ScoreParams,
    first: Option<&FirstChoice>,
    ctx: &Context<'_>,
) -> Result<OpenSelection, Cancelled> {
    let Cover { choices, stopped_because } = match params.solver {
        Solver::Greedy => greedy::select(problem, params, score, ctx)?,
        Solver::Lazy => lazy::select(problem, params, score, ctx)?,
        Solver::Local | Solver::Certified => return fewest(problem, params, score, first, ctx),
    };
    let chosen: Vec<&Row> = choices.iter().map(|choice| problem.row(choice.row)).collect();
    let bound = Arc::new(OpenBound::of(problem, params, &chosen, problem.rows_without_quality()));
    Ok(OpenSelection { choices, stopped_because, bound, before_raise: None })
}

/// Chooses the fewest views that meet the goals, the floors under grades among them, with the best score of that many.
fn fewest(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    score: &ScoreParams,
    first: Option<&FirstChoice>,
    ctx: &Context<'_>,
) -> Result<OpenSelection, Cancelled> {
    let floor = GradeFloor::of(problem, params, score, first, ctx)?;
    let with_floor = floor.as_ref().map(|floor| floor.problem(problem));
    let (problem, floor) = (with_floor.as_ref().unwrap_or(problem), floor.as_ref());
    if params.solver == Solver::Certified {
        return certified::select(problem, params, score, floor, ctx);
    }
    let scorer = score::Scorer::new(problem, params, score, ctx.simd_level());
    let from = (floor.map(|floor| &floor.start), floor.map(GradeFloor::goal_of_grade_a));
    let mut budget = local::Budget::of(params);
    let mut found = local::search(&scorer, params, from, &mut budget, ctx)?;
    // Others may add enough to exchanged views, though none did to greedy's; views that exchanges save are there for more of the goals.
    for _ in 0..MAX_CONTINUATIONS {
        let may_go_on = match found.stopped_because {
            StopReason::Growth => true,
            StopReason::MaxViews => found.rows.best.len() < max_views(params),
            StopReason::Target | StopReason::NoGain | StopReason::NoPath | StopReason::RegionsUnmet => false,
        };
        if !may_go_on {
            break;
        }
        let grown = greedy::select_after(problem, params, score, &found.rows.best, ctx)?;
        if grown.choices.len() == found.rows.best.len() {
            // The limit is not what ends a choice of fewer views.
            found.stopped_because = grown.stopped_because;
            break;
        }
        found = local::search(&scorer, params, (Some(&grown), from.1), &mut budget, ctx)?;
    }
    if found.stopped_because == StopReason::Growth {
        // Views before a search for grades were not looked at.
        found.rows.before_raise = None;
    }
    let bound = Arc::new(OpenBound::of(problem, params, &problem.measured(&found.rows.best), problem.rows_without_quality()));
    OpenSelection::of(&scorer, &found.rows, (found.stopped_because, bound), ctx)
}

/// The fewest views that exchanges find for the goals, the floors under grades among them, whatever their score.
///
/// # Errors
/// [`Cancelled`].
pub(in crate::planning) fn first_choice(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    score: &ScoreParams,
    ctx: &Context<'_>,
) -> Result<FirstChoice, Cancelled> {
    let floor = GradeFloor::of(problem, params, score, None, ctx)?;
    let needs = floor.as_ref().map(GradeFloor::needs);
    let with_floor = floor.as_ref().map(|floor| floor.problem(problem));
    let (problem, floor) = (with_floor.as_ref().unwrap_or(problem), floor.as_ref());
    let scorer = score::Scorer::new(problem, params, score, ctx.simd_level());
    let from = (floor.map(|floor| &floor.start), floor.map(GradeFloor::goal_of_grade_a));
    let (found, _) = local::fewest(&scorer, params, from, &mut local::Budget::of(params), ctx)?;
    Ok(FirstChoice { rows: found.rows.best, floors: Floors::Needed(needs) })
}

/// Chooses greedily, without a bound.
///
/// # Errors
/// [`Cancelled`].
pub(in crate::planning) fn greedily(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    score: &ScoreParams,
    ctx: &Context<'_>,
) -> Result<Vec<Choice>, Cancelled> {
    Ok(greedy::select(problem, params, score, ctx)?.choices)
}

/// Exchanges of views that keep the goals met, for one problem and views that change.
pub(in crate::planning) struct Exchanges<'a> {
    problem: &'a CoverProblem<'a>,
    goals: Vec<units::Units>,
    overlap: overlap::Overlap<'a>,
}

impl<'a> Exchanges<'a> {
    /// Exchanges of views of a problem.
    pub(in crate::planning) fn new(problem: &'a CoverProblem<'a>, params: &'a SelectionParams) -> Self {
        Self { problem, goals: units::Units::of_goals(problem), overlap: overlap::Overlap::new(problem, &params.overlap) }
    }

    /// Lists every exchange of one of the views, whose rows are `rows`, for another row after which the goals are met as far as
    /// `rows` meet them and overlap is as asked for: the view, and the other row.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn of(&self, rows: &[RowIndex], ctx: &Context<'_>) -> Result<Vec<(ViewId, RowIndex)>, Cancelled> {
        let (measured, mut goals) = (self.problem.measured(rows), self.goals.clone());
        goals.iter_mut().for_each(|goal| goal.clamp_to(&measured));
        let exchange = local::Exchange { problem: self.problem, goals: &goals, overlap: &self.overlap };
        let swaps = local::Swaps::new(&exchange, rows, ctx)?;
        let allowed = swaps.all().filter(|(view, row, deficit)| *deficit == 0 && exchange.connects(rows, *view, *row));
        Ok(allowed.map(|(view, row, _)| (view, row)).collect())
    }
}

/// Makes the selection of `rows` in greedy's order, with the bound of `like`, whose views may be fewer.
///
/// # Errors
/// [`Cancelled`].
pub(in crate::planning) fn of_rows(
    problem: &CoverProblem<'_>,
    params: &SelectionParams,
    score: &ScoreParams,
    rows: &[RowIndex],
    like: &OpenSelection,
    ctx: &Context<'_>,
) -> Result<OpenSelection, Cancelled> {
    let choices = greedy::order(&score::Scorer::new(problem, params, score, ctx.simd_level()), rows, ctx)?;
    Ok(like.with_choices(choices))
}

impl OpenSelection {
    /// Makes a selection of other choices, as many, that meet the same goals.
    pub(in crate::planning) fn with_choices(&self, choices: Vec<Choice>) -> Self {
        Self { choices, stopped_because: self.stopped_because, bound: Arc::clone(&self.bound), before_raise: None }
    }

    /// Orders views as greedy takes them.
    fn of(
        scorer: &score::Scorer<'_>,
        views: &ScoredViews,
        (stopped_because, bound): (StopReason, Arc<OpenBound>),
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let before_raise = views.before_raise.as_ref().map(|rows| greedy::order(scorer, rows, ctx)).transpose()?;
        Ok(Self { choices: greedy::order(scorer, &views.best, ctx)?, stopped_because, bound, before_raise })
    }
}

impl Cover {
    fn rows(&self) -> Vec<RowIndex> {
        self.choices.iter().map(|choice| choice.row).collect()
    }
}

impl<'a> CoverProblem<'a> {
    /// Makes the problem of the plan's own target alone: samples count by their asked area, and time costs nothing. `total_mm2`
    /// is the area of the whole surface.
    #[must_use]
    pub fn new(rows: Vec<&'a Row>, asked_area_mm2: &'a [f64], total_mm2: f64, params: &SelectionParams) -> Self {
        let whole_mm2 = match params.target_of {
            TargetOf::Coverable => coverable_mm2(&rows, asked_area_mm2),
            TargetOf::Asked => asked_area_mm2.iter().sum(),
            TargetOf::Total => total_mm2,
        };
        let target = Goal { area_mm2: Cow::Borrowed(asked_area_mm2), needed_mm2: params.target * whole_mm2 };
        let weighted_area_mm2 = Cow::Borrowed(asked_area_mm2);
        Self { rows, asked_area_mm2, weighted_area_mm2, goals: vec![target], view_secs: 0.0, travel_secs: None }
    }

    /// Samples that a row's view measures.
    #[must_use]
    pub fn row(&self, row: RowIndex) -> &'a Row {
        self.rows[row.index()]
    }

    /// Every row, ascending.
    fn all_rows(&self) -> impl DoubleEndedIterator<Item = RowIndex> + ExactSizeIterator + Clone + use<> {
        RowIndex::first(self.rows.len())
    }

    /// Copies of the rows without quality.
    fn rows_without_quality(&self) -> Vec<Row> {
        self.rows.iter().map(|row| Row::new(row.words().to_vec())).collect()
    }

    /// Samples that each of some rows' views measures.
    fn measured(&self, rows: &[RowIndex]) -> Vec<&'a Row> {
        rows.iter().map(|row| self.row(*row)).collect()
    }

    /// Sum of the asked area.
    #[must_use]
    pub fn asked_mm2(&self) -> f64 {
        self.asked_area_mm2.iter().sum()
    }
}

/// Samples, of so many, that at least one of `rows` measures.
#[must_use]
pub fn coverable(rows: &[&Row], samples: usize) -> SampleSet {
    let mut coverable = SampleSet::none_of(samples);
    rows.iter().for_each(|row| coverable.insert_all(row.measured()));
    coverable
}

/// Asked area that at least one of `rows` measures.
#[must_use]
pub fn coverable_mm2(rows: &[&Row], asked_area_mm2: &[f64]) -> f64 {
    coverable(rows, asked_area_mm2.len()).iter().map(|sample| asked_area_mm2[sample.index()]).sum()
}

/// Largest number of views that may be chosen.
fn max_views(params: &SelectionParams) -> usize {
    params.max_views.map_or(usize::MAX, |views| views as usize)
}

fn is_for_coverage(params: &SelectionParams) -> bool {
    params.goal == SelectionGoal::BestCoverage
}
