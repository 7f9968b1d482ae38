//! A further view for more area at grade A, and the share that asks for it: a plan takes the fewest views that meet its
//! target, and one more may measure much of the surface better.

use std::collections::BTreeSet;

use super::more_views::insertion_secs;
use super::{Basis, cycle_secs, views_of};
use crate::cell::Cell;
use crate::geometry::parallel;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, SampleId};
use crate::planning::params::SelectionGoal;
use crate::planning::plan::{AdviceKind, Outcome, ParamChange, PlanAdvice};
use crate::planning::problem::{ChosenViews, ViewPlanningProblem};
use crate::planning::sequence::Ordered;
use crate::planning::verdict::Grade;
use crate::planning::visibility::{Row, SampleSet};

/// Share of the asked area that the view adds at grade A at least: our choice.
const MIN_GAIN: f64 = 0.03;
/// Steps of the share that is asked for in one: three decimals.
const SHARE_STEPS: f64 = 1e3;

/// A further view, chosen on the samples that all are chosen on for the area that it adds at grade A.
pub(in crate::planning) struct BetterGrades {
    /// Share of the asked area at grade A that asks for it.
    min_grade_a: f64,
    /// Area that the view adds at grade A.
    gain_mm2: f64,
    /// Time of the moves to it, put between two views where it takes least.
    moving_secs: f64,
}

/// Chooses the candidate, of those that are not `given_up`, that adds most at grade A to the chosen views; `None` where that is too
/// little, no advice is asked for, or the plan does not look for the fewest views, has several setups, has no view left, or is asked
/// for a share at grade A already. `problem` is the one that views were chosen from: in that of every sample the rows of candidates
/// lack what the chosen views measure.
pub(in crate::planning) fn choose(
    problem: &ViewPlanningProblem<'_>,
    (chosen, ordered): (&ChosenViews, &[Ordered]),
    given_up: &BTreeSet<CandidateIndex>,
    ctx: &Context<'_>,
) -> Result<Option<BetterGrades>, Cancelled> {
    let params = &problem.params.selection;
    // Views that have no path are not mended by asking for more of them.
    let has_paths = ordered.iter().all(|ordered| ordered.no_path.is_empty());
    let looks_for_fewest = params.goal == SelectionGoal::FewestViews && params.keeps_grades(&problem.params.score);
    let has_view_left = params.max_views.is_none_or(|limit| chosen.candidates.len() < limit as usize);
    let is_wanted = problem.params.missed.advice && !problem.tolerates_errors() && problem.params.realism.count_at_risk;
    if !is_wanted || !has_paths || !looks_for_fewest || params.min_grade_a.is_some() || !has_view_left || problem.setups.len() > 1
    {
        return Ok(None);
    }
    let mut at_grade_a = SampleSet::none_of(problem.asked_area_mm2.len());
    for candidate in &chosen.candidates {
        samples_at_grade_a(problem.row(*candidate)).for_each(|sample| at_grade_a.insert(sample));
    }
    let choosable = problem.choosable(given_up);
    let gain_mm2 = |candidate: &CandidateIndex| {
        ctx.check()?;
        let gained = samples_at_grade_a(problem.row(*candidate)).filter(|sample| !at_grade_a.holds(*sample));
        Ok(gained.map(|sample| problem.asked_area_mm2[sample.index()]).sum::<f64>())
    };
    let gains_mm2 = parallel::try_map::<_, _, Cancelled>(&choosable, gain_mm2)?;
    // Of equal ones the first.
    let best = choosable.iter().zip(gains_mm2).reduce(|best, next| if next.1 > best.1 { next } else { best });
    let asked_mm2: f64 = problem.asked_area_mm2.iter().sum();
    let Some((pick, gain_mm2)) = best.filter(|(_, gain_mm2)| *gain_mm2 >= MIN_GAIN.max(params.min_growth) * asked_mm2) else {
        return Ok(None);
    };
    let now_mm2: f64 = at_grade_a.iter().map(|sample| problem.asked_area_mm2[sample.index()]).sum();
    let min_grade_a = ((now_mm2 + gain_mm2) / asked_mm2 * SHARE_STEPS).floor() / SHARE_STEPS;
    let moving_secs = insertion_secs(problem, ordered, &[*pick]);
    Ok(Some(BetterGrades { min_grade_a, gain_mm2, moving_secs }))
}

/// Samples that a view measures at grade A.
fn samples_at_grade_a(row: &Row) -> impl Iterator<Item = SampleId> {
    row.graded().filter(|(_, quality)| Grade::of(f64::from(*quality)) == Grade::A).map(|(sample, _)| sample)
}

impl BetterGrades {
    /// The advice to ask for it.
    pub(super) fn advice(&self, basis: &Basis, outcome: &Outcome, cell: Option<&Cell>) -> PlanAdvice {
        PlanAdvice {
            kind: AdviceKind::BetterGrades,
            changes: vec![ParamChange::MinGradeA(self.min_grade_a)],
            table_from_part: None,
            turn: None,
            setups: Vec::new(),
            added_views: 1,
            views: views_of(outcome) + 1,
            measured_area_mm2: basis.measured_mm2(),
            grade_a_area_mm2: Some(outcome.plan.coverage.measured.grade_area_mm2[Grade::A as usize] + self.gain_mm2),
            visible_area_mm2: outcome.plan.coverage.visible_area_mm2,
            cycle_secs: cycle_secs(outcome, cell, |_| true, (1, self.moving_secs)),
            regions_met: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::geometry::demo_parts;
    use crate::planning::context::Silent;
    use crate::planning::params::PlanParams;
    use crate::planning::plan::Plan;
    use crate::planning::{PlanInput, plan};
    use crate::testing::nominal_scanner;

    /// The plan of a demo part without a cell, on few samples.
    fn planned(change: impl Fn(&mut PlanParams)) -> Plan {
        let mesh = demo_parts::figurine(8_000).unwrap_or_else(|error| panic!("{error}"));
        let (scanner, cancel, mut params) = (nominal_scanner(), AtomicBool::new(false), PlanParams::default());
        (params.part.samples_per_mm2, params.missed.remedies, params.robust.pose_error) = (Some(0.3), 0, None);
        change(&mut params);
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        plan(&input, &params, &Context::new(&cancel, &Silent)).expect("a plan").plan
    }

    fn for_better_grades(plan: &Plan) -> Option<&PlanAdvice> {
        plan.advice.iter().find(|advice| advice.kind == AdviceKind::BetterGrades)
    }

    fn at_grade_a(plan: &Plan) -> f64 {
        plan.coverage.measured.grade_area_mm2[Grade::A as usize] / plan.coverage.asked_area_mm2
    }

    #[test]
    #[ignore = "long: tests/all runs it"]
    fn a_plan_with_the_advised_share_has_it_at_grade_a_with_about_one_view_more() {
        let before = planned(|_| ());
        let advice = for_better_grades(&before).unwrap_or_else(|| panic!("{:?}", before.advice));
        let [ParamChange::MinGradeA(share)] = advice.changes[..] else { panic!("{advice:?}") };
        assert_eq!((advice.added_views, advice.views), (1, before.views.len() + 1));
        let told = advice.grade_a_area_mm2.expect("an area") / before.coverage.asked_area_mm2;
        assert!(
            (told - share).abs() < 0.01
                && told >= at_grade_a(&before) + MIN_GAIN
                && share >= at_grade_a(&before) + MIN_GAIN - 0.01,
            "{advice:?}"
        );
        let after = planned(|params| params.selection.min_grade_a = Some(share));
        // Views are slid once they are chosen.
        assert!(at_grade_a(&after) >= share - 0.005, "{} of {share}", at_grade_a(&after));
        assert!(after.views.len() <= advice.views + 1, "{} views, {} told", after.views.len(), advice.views);
        assert_eq!(for_better_grades(&after), None, "a share is asked for");
    }

    #[test]
    fn better_grades_are_not_advised_without_a_view_left_nor_where_the_choice_keeps_no_grades() {
        let kinds = |change: fn(&mut PlanParams)| for_better_grades(&planned(change)).is_some();
        assert!(kinds(|_| ()));
        assert!(!kinds(|params| params.selection.min_growth = 0.2));
        assert!(!kinds(|params| params.selection.max_views = Some(2)));
        assert!(!kinds(|params| params.selection.solver = crate::planning::params::Solver::Greedy));
        assert!(!kinds(|params| params.missed.advice = false));
    }
}
