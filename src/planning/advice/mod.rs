//! Advice on a plan as a whole: parameters with which it would measure more, each tried on the model
//! ([`crate::planning::method::causes`]); and one with which it would measure more at grade A (`better_grades.rs`).
//!
//! Views are chosen greedily for what the plan leaves open: among its candidates, its own views kept (`more_views.rs`), and in
//! one more pose of the part among some of the candidates that a plan in that setup chooses from, with its own views or the
//! fewest of them that do (`turn_over.rs`). Where a plan in one more setup would lie in other poses by itself, and measure more
//! there, views are chosen for those, and those of the poses that it leaves are given up. A plan with the advised parameters has
//! these candidates and more, and ends at its target, so what it measures is not below the target's share of what those measure.
//! That holds as long as no limit of views ends it before: it chooses all its views anew, and by its own score. So a limit of as
//! many views as were tried is advised only where views that are chosen like that measure as much; else the largest that there
//! is.
//!
//! With the best coverage as goal a plan has no target, and takes as many views as its limit lets it. The limit stays then, and
//! as many are chosen anew, among the plan's own views and the candidates of the poses that are new. Where the limit ended the
//! plan, no view is left to register setups by the surface that they share, so that markers are advised; so they are where
//! surface leads to nothing. With another goal a plan that its limit ended before its target gets more views in its own poses
//! too.
//!
//! Another setup is tried on some of the samples, and what is told of the views that were chosen for it is what they measure of all
//! of them. The plan's own views may be given up there too, where the fewest of all measure as much: a plan that chooses for all setups at
//! once often needs few of the views that it takes in one. Of 20 parts of 120 mm, plans made in one more setup as advised measured 0.1 to
//! 4.8 percentage points of the asked area more than was told, since they have more candidates; with 3 views fewer to 3 more on 18 of
//! them, and 5 and 39 more on two, whose thin walls leave much open; and in 20 % less to 72 % more time (median: as much; 16 % less to
//! 6 % more where the number of views was as told).
//!
//! Cost: a fraction of the plan's candidates on some samples, with their stations, the order of the views of one setup, and rays
//! for what is open; the same for each pose where the part is laid anew, and again for a second and a third choice of poses where the
//! one before leads to nothing or falls clearly short. Nothing where less is open than advice is given for.

pub(super) mod better_grades;
mod more_views;
mod trial;
mod turn_over;

use std::collections::BTreeSet;
use std::sync::Arc;

use super::context::{Cancelled, Context, PlanError};
use super::ids::{CandidateIndex, RowIndex, SampleId};
use super::params::{MotionParams, Objective, ScoreParams, SelectionGoal, SelectionParams, Solver, TargetOf};
use super::plan::{Cause, Outcome, PlanAdvice, PlannedView, Verdict, ViewId};
use super::problem::{ChosenViews, SampledPart, ViewPlanningProblem};
use super::scene::PlanInput;
use super::selection::{self, CoverProblem, GradeFloor};
use super::sequence::{Ordered, Sequence, straight_secs};
use super::setups::Setup;
use super::setups::registration::union_of;
use super::stations::Station;
use super::visibility::{Row, SampleSet};
use crate::cell::{Cell, Configuration};
use crate::geometry::{Part, Pose, RayScene, Table, sort_descending};
use better_grades::BetterGrades;
use more_views::MoreViews;

/// Share of the asked area that advice recovers at least, unless it makes a region meet its target: our choice.
const MIN_RECOVERED: f64 = 0.01;
/// Largest number of views of a plan: the range of `selection.max_views`.
const MAX_VIEWS: u32 = 1000;

/// A chosen plan as far as advice needs it: before the outcome takes its candidates over, or as the outcome tells it.
pub(super) struct Basis {
    /// Samples that the chosen views measure.
    measured: SampleSet,
    /// Samples that some candidate measures which the cell can take.
    coverable: SampleSet,
    /// Area of each sample, 0 where it is not asked for.
    asked_area_mm2: Vec<f64>,
    /// Area of the whole surface.
    total_mm2: f64,
    more_views: Option<MoreViews>,
}

/// A part in its setups, of which one more is tried.
pub(super) struct AdviceScope<'a> {
    pub(super) input: &'a PlanInput<'a>,
    pub(super) sampled: &'a SampledPart,
    pub(super) setups: &'a [Setup<'a>],
    /// The part alone.
    pub(super) part: &'a Arc<RayScene>,
}

impl Basis {
    /// Takes from a solved problem what advice needs; `excluded` are candidates that were given up for want of a path. `None` where
    /// no advice is asked for; nor is any tried where views are chosen by what they measure under errors too, where they have to
    /// overlap, or where area at risk does not count.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(super) fn of(
        problem: &ViewPlanningProblem<'_>,
        chosen: &ChosenViews,
        ordered: &[Ordered],
        excluded: &BTreeSet<CandidateIndex>,
        ctx: &Context<'_>,
    ) -> Result<Option<Self>, Cancelled> {
        if !problem.params.tries_advice() {
            return Ok(None);
        }
        let samples = problem.asked_area_mm2.len();
        let no_path: BTreeSet<_> = ordered.iter().flat_map(|ordered| chosen.candidates_of(&ordered.no_path)).collect();
        let taken = chosen.candidates.iter().filter(|candidate| !no_path.contains(candidate));
        let mut basis = Self {
            measured: union_of(taken.map(|candidate| problem.row(*candidate)), samples),
            coverable: union_of(problem.rows(&problem.usable()), samples),
            asked_area_mm2: problem.asked_area_mm2.clone(),
            total_mm2: problem.surface.area_where(|_| true),
            more_views: None,
        };
        // Views that have no path are not mended by asking for more of them.
        if no_path.is_empty() {
            basis.more_views = more_views::choose(&basis, problem, (chosen.candidates.len(), ordered), excluded, ctx)?;
        }
        Ok(Some(basis))
    }

    /// The plan on the samples of its outcome, without more views.
    fn of_outcome(outcome: &Outcome) -> Self {
        let samples_where = |keep: fn(&Verdict) -> bool| {
            let mut samples = SampleSet::none_of(outcome.verdicts.len());
            let kept = SampleId::number(&outcome.verdicts).filter(|(_, verdict)| keep(verdict));
            kept.for_each(|(sample, _)| samples.insert(sample));
            samples
        };
        let is_coverable = |verdict: &Verdict| {
            matches!(verdict, Verdict::Measured(_) | Verdict::Missed(Cause::NotChosen | Cause::NoPath | Cause::AtRisk))
        };
        Self {
            measured: samples_where(|verdict| matches!(verdict, Verdict::Measured(_))),
            coverable: samples_where(is_coverable),
            asked_area_mm2: outcome.surface.asked_area_mm2(),
            total_mm2: outcome.surface.area_where(|_| true),
            more_views: None,
        }
    }

    /// The plan with some of its views alone. No more than what they measure is taken to be coverable.
    fn of_views(outcome: &Outcome, views: &[ViewId]) -> Self {
        let rows = views.iter().map(|view| &outcome.measured_by_view[view.index()]);
        let measured = union_of(rows, outcome.verdicts.len());
        Self {
            coverable: measured.clone(),
            measured,
            asked_area_mm2: outcome.surface.asked_area_mm2(),
            total_mm2: outcome.surface.area_where(|_| true),
            more_views: None,
        }
    }

    /// The plan on some of the samples, each with the area that it stands for.
    fn on(&self, some: &[(SampleId, f64)]) -> Self {
        Self {
            measured: within(&self.measured, some),
            coverable: within(&self.coverable, some),
            asked_area_mm2: some.iter().map(|(_, area_mm2)| *area_mm2).collect(),
            total_mm2: self.total_mm2,
            more_views: None,
        }
    }

    fn area_mm2(&self, samples: &SampleSet) -> f64 {
        samples.iter().map(|sample| self.asked_area_mm2[sample.index()]).sum()
    }

    fn asked_mm2(&self) -> f64 {
        self.asked_area_mm2.iter().sum()
    }

    fn measured_mm2(&self) -> f64 {
        self.area_mm2(&self.measured)
    }

    /// Area of each sample that is asked for and not measured.
    fn open_area_mm2(&self) -> Vec<f64> {
        let mut open_mm2 = self.asked_area_mm2.clone();
        self.measured.iter().for_each(|sample| open_mm2[sample.index()] = 0.0);
        open_mm2
    }

    /// Area of which the target is a share, with so much of the surface coverable.
    fn whole_mm2(&self, coverable: &SampleSet, target_of: TargetOf) -> f64 {
        match target_of {
            TargetOf::Coverable => self.area_mm2(coverable),
            TargetOf::Asked => self.asked_mm2(),
            TargetOf::Total => self.total_mm2,
        }
    }

    fn is_worth(&self, measured_mm2: f64) -> bool {
        measured_mm2 - self.measured_mm2() >= MIN_RECOVERED * self.asked_mm2()
    }
}

/// The samples of a set among some of the surface's, by their places there.
fn within(samples: &SampleSet, some: &[(SampleId, f64)]) -> SampleSet {
    let mut within = SampleSet::none_of(some.len());
    let held = SampleId::number(some).filter(|(_, (sample, _))| samples.holds(*sample));
    held.for_each(|(place, _)| within.insert(place));
    within
}

/// Advice on a plan, what measures most first, better grades last.
///
/// # Errors
/// [`PlanError`].
pub(super) fn of(
    (basis, better_grades): (&Basis, Option<&BetterGrades>),
    outcome: &Outcome,
    scope: &AdviceScope<'_>,
    ctx: &Context<'_>,
) -> Result<Vec<PlanAdvice>, PlanError> {
    let more_views = basis.more_views.as_ref().and_then(|more| more.advice(basis, outcome, scope.input.cell));
    let turn_over = turn_over::advice(&Basis::of_outcome(outcome), outcome, scope, ctx)?;
    let mut advice: Vec<PlanAdvice> = turn_over.into_iter().chain(more_views).collect();
    // Stable: of equal ones the order above stays.
    sort_descending(&mut advice, |advice| advice.measured_area_mm2);
    advice.extend(better_grades.map(|better| better.advice(basis, outcome, scope.input.cell)));
    Ok(advice)
}

/// Samples to be measured.
struct Wanted<'a> {
    /// Area of each sample, 0 where it does not count.
    open_mm2: &'a [f64],
    /// Part of that area that is enough.
    needed_mm2: f64,
    /// A view adds at least so much.
    min_gain_mm2: f64,
    max_views: usize,
}

/// Rows that greedy takes for what is wanted, as places in `rows`.
fn choose(rows: &[&Row], wanted: &Wanted<'_>, score: &ScoreParams, ctx: &Context<'_>) -> Result<Vec<RowIndex>, Cancelled> {
    let all_mm2: f64 = wanted.open_mm2.iter().sum();
    if rows.is_empty() || wanted.needed_mm2 <= 0.0 || all_mm2 <= 0.0 || wanted.max_views == 0 {
        return Ok(Vec::new());
    }
    let params = SelectionParams {
        solver: Solver::Greedy,
        objective: Objective::Coverage,
        goal: SelectionGoal::FewestViews,
        target: 1.0,
        target_of: TargetOf::Asked,
        min_growth: wanted.min_gain_mm2 / all_mm2,
        max_views: Some(wanted.max_views as u32),
        ..SelectionParams::default()
    };
    let mut cover = CoverProblem::new(rows.to_vec(), wanted.open_mm2, all_mm2, &params);
    cover.goals[0].needed_mm2 = wanted.needed_mm2;
    let choices = selection::greedily(&cover, &params, score, &ctx.silent())?;
    Ok(choices.iter().map(|choice| choice.row).collect())
}

/// Parameters of the choice that a plan's solver begins with. Exchanges begin there, by score where grades have a floor and else
/// by area, and leave no less measured.
fn starting_params(params: &SelectionParams, score: &ScoreParams) -> SelectionParams {
    let mut params = params.clone();
    let exchanges = matches!(params.solver, Solver::Local | Solver::Certified);
    if exchanges && !GradeFloor::is_asked(&params, score) {
        (params.objective, params.view_cost_mm2_per_s) = (Objective::Coverage, 0.0);
    }
    params
}

/// Time of the quickest straight move between stations of two candidates, as a plan counts it for the cost of its views.
fn quickest_secs(cell: &Cell, motion: &MotionParams, [from, to]: [&[Station]; 2]) -> f64 {
    let axes = cell.axes();
    let pairs = from.iter().flat_map(|a| to.iter().map(move |b| (a.configuration(), b.configuration())));
    pairs.map(|(a, b)| straight_secs(&axes, &a, &b, motion)).fold(f64::INFINITY, f64::min)
}

/// Cycle time of a plan with so many more views, the moves of which take `added_secs`, and without its views that do not stay;
/// `None` without a cell.
///
/// The estimate assumes that the views which stay keep their stations and their order ([`moving_secs`]); `added_secs` has the
/// moves of each further setup, from home and back too. Each view settles once; a further one is captured as often as those of
/// the plan on average. A plan with the advised parameters chooses its views and their order anew.
fn cycle_secs(
    outcome: &Outcome,
    cell: Option<&Cell>,
    stays: impl Fn(ViewId) -> bool,
    (added_views, added_secs): (usize, f64),
) -> Option<f64> {
    let (plan, scan, motion) = (&outcome.plan, &outcome.plan.params.scan, &outcome.plan.params.motion);
    let axes = cell?.axes();
    let secs_between = |from: &Configuration, to: &Configuration| straight_secs(&axes, from, to, motion);
    let staying: Vec<ViewId> = plan.visits().map(|(view, _)| *view).filter(|view| stays(*view)).collect();
    // A view may be captured at two levels of brightness.
    let captures_of = |view: &ViewId| plan.views.get(view.index()).map_or(1, |view| view.levels(scan).len());
    let captures = staying.iter().map(captures_of).sum::<usize>() as f64
        + captures_of_further(added_views, plan.captures(), plan.visits().count());
    let moving_secs: f64 = plan.sequences().map(|sequence| moving_secs(sequence, &stays, secs_between)).sum();
    let settling_secs = (staying.len() + added_views) as f64 * scan.settle_secs;
    Some(moving_secs + added_secs + settling_secs + captures * scan.capture_secs)
}

/// Captures of further views: each has as many as the views of a plan have on average, one where the plan has none.
fn captures_of_further(further: usize, captures: usize, views: usize) -> f64 {
    let of_each = if views == 0 { 1.0 } else { captures as f64 / views as f64 };
    further as f64 * of_each
}

/// Time of the moves through the views of a sequence that stay, at their stations and in their order. A move between two that
/// follow each other takes as long as planned; one past views that drop out is taken to be straight, without a detour. Fewer
/// views lie further apart: a share of the time of all moves, or as many of average length, would be far too short.
fn moving_secs(
    sequence: &Sequence,
    stays: impl Fn(ViewId) -> bool,
    secs_between: impl Fn(&Configuration, &Configuration) -> f64,
) -> f64 {
    let visits = sequence.visits.iter().map(|(view, leg)| (stays(*view), leg));
    let (mut from, mut is_past_others, mut secs) = (sequence.return_home.target.configuration(), false, 0.0);
    for (is_kept, leg) in visits.chain([(true, &sequence.return_home)]) {
        if is_kept {
            let to = leg.target.configuration();
            secs += if is_past_others { secs_between(&from, &to) } else { leg.duration_secs };
            from = to;
        }
        is_past_others = !is_kept;
    }
    secs
}

/// Time by which a further sequence in the same setup lengthens a plan's own. The two are taken to be run as one, with a straight
/// move from an end of one to an end of the other in place of a way home and one from there: both can be run backwards.
fn lengthening_secs(own: &Sequence, further: &Sequence, secs_between: impl Fn(&Configuration, &Configuration) -> f64) -> f64 {
    let (own, further_ends) = (ends(own), ends(further));
    let pairs = own.iter().flatten().flat_map(|own| further_ends.iter().flatten().map(move |further| (own, further)));
    let saved_secs = pairs.map(|((a, home_a_secs), (b, home_b_secs))| home_a_secs + home_b_secs - secs_between(a, b));
    further.motion_secs() - saved_secs.fold(0.0, f64::max)
}

/// First and last stop of a sequence, each with the time of the move between it and home; `None` without views.
fn ends(sequence: &Sequence) -> Option<[(Configuration, f64); 2]> {
    let ((_, first), (_, last)) = (sequence.visits.first()?, sequence.visits.last()?);
    let return_secs = sequence.return_home.duration_secs;
    Some([(first.target.configuration(), first.duration_secs), (last.target.configuration(), return_secs)])
}

/// Returns true if a plan that limits its views cannot take so many, whatever its limit: the range of the limit ends before.
fn exceeds_every_limit(limit: Option<u32>, views: usize) -> bool {
    limit.is_some() && views > MAX_VIEWS as usize
}

/// Views of a plan that measure something.
fn views_of(outcome: &Outcome) -> usize {
    outcome.plan.executed_views()
}

/// Returns true if a view is taken with the part in one of some poses.
fn is_in_poses(view: &PlannedView, outcome: &Outcome, poses: &[Pose<Table, Part>]) -> bool {
    outcome.plan.setups.get(view.setup.index()).is_some_and(|setup| poses.contains(&setup.table_from_part))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::sequence::Leg;

    /// A sequence from home, at 0, through stations at these angles of the first joint, each with the time of the move to it.
    fn sequence(stops: &[(f64, f64)], return_secs: f64) -> Sequence {
        let leg = |joint_rad: f64, duration_secs: f64| {
            let target = Station { table_angle_rad: 0.0, joints_rad: [joint_rad, 0.0, 0.0, 0.0, 0.0, 0.0] };
            Leg { via_rad: Vec::new(), target, duration_secs, passed_within_rad: None, turning_secs: 0.0 }
        };
        let visits = stops.iter().enumerate().map(|(view, (joint_rad, secs))| (ViewId::at(view), leg(*joint_rad, *secs)));
        Sequence {
            visits: visits.collect(),
            return_home: leg(0.0, return_secs),
            ordered_secs: 0.0,
            lower_bound_secs: 0.0,
            moving_lower_secs: 0.0,
        }
    }

    /// The first joint turns by 1 rad/s, without ramps.
    fn secs_between(from: &Configuration, to: &Configuration) -> f64 {
        (from.joints_rad[0] - to.joints_rad[0]).abs()
    }

    /// Far from home and near to each other: with an even share of all moves one view took 12.25 s, two took 18.375 s.
    #[test]
    fn a_sequence_that_loses_views_keeps_the_way_from_home_and_back() {
        // The way to the first has a detour.
        let sequence = sequence(&[(10.0, 10.5), (11.0, 1.0), (12.0, 1.0)], 12.0);
        let with = |kept: &[u32]| moving_secs(&sequence, |view| kept.contains(&view.0), secs_between);
        assert_eq!([with(&[]), with(&[0]), with(&[1]), with(&[2])], [0.0, 20.5, 22.0, 24.0]);
        assert_eq!([with(&[0, 1]), with(&[0, 2]), with(&[1, 2]), with(&[0, 1, 2])], [22.5, 24.5, 24.0, 24.5]);
    }

    /// The way from home and back counted twice: 24 s.
    #[test]
    fn further_views_in_a_setup_of_the_plan_are_taken_on_one_way_from_home() {
        let further = sequence(&[(11.0, 11.0), (12.0, 1.0)], 12.0);
        let beside =
            |stops: &[(f64, f64)], return_secs: f64| lengthening_secs(&sequence(stops, return_secs), &further, secs_between);
        // 0, 10, 11, 12, 0 takes 24 s, of which 20 s were there; 0, 13, 12, 11, 0 takes 26 s as before.
        assert_eq!([beside(&[(10.0, 10.0)], 10.0), beside(&[(13.0, 13.0)], 13.0)], [4.0, 0.0]);
        // On the other side of home it is as far; so it is beside no view at all.
        assert_eq!([beside(&[(-5.0, 5.0)], 5.0), beside(&[], 0.0)], [24.0, 24.0]);
    }

    /// Further views were captured once, where each view of the plan is captured twice.
    #[test]
    fn further_views_are_captured_as_often_as_those_of_the_plan() {
        assert_eq!([captures_of_further(3, 8, 4), captures_of_further(3, 6, 4), captures_of_further(3, 0, 0)], [6.0, 4.5, 3.0]);
    }
}
