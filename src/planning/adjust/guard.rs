//! The guard of adjusted views: what one view in place of another changes for all of them together. A change is permitted that
//! loses no area, in all and in any region, and none of any grade or better.

use crate::planning::ids::{CandidateIndex, SampleId, ViewId};
use crate::planning::plan::Grade;
use crate::planning::problem::ViewPlanningProblem;
use crate::planning::visibility::{self, Row};

/// Areas are sums in another order.
const SUM_SLACK_MM2: f64 = 1e-6;
/// Grades whose area, or better, must not shrink; that of the last is all that is measured.
const GRADES: [Grade; 4] = [Grade::A, Grade::B, Grade::C, Grade::D];

/// Quality with which each of the chosen views measures a sample.
type Measurements = Vec<(ViewId, f32)>;

/// Measurements of chosen views, by sample.
pub(super) struct Guard {
    of_sample: Vec<Measurements>,
}

/// Change of the measured area by one view in place of another.
#[derive(Debug)]
pub(super) struct Change {
    /// Gain of each grade or better, then of each region, mm².
    gained_mm2: Vec<f64>,
    /// Gain of the score of all views, each sample by the best of them, mm².
    pub(super) score_mm2: f64,
}

impl Change {
    /// Returns true if nothing is lost.
    pub(super) fn loses_nothing(&self) -> bool {
        self.gained_mm2.iter().all(|gained_mm2| *gained_mm2 >= -SUM_SLACK_MM2)
    }
}

impl Guard {
    /// Starts from views, each the number of one and its candidate.
    pub(super) fn new(problem: &ViewPlanningProblem<'_>, views: impl IntoIterator<Item = (ViewId, CandidateIndex)>) -> Self {
        let mut of_sample = vec![Measurements::new(); problem.surface.sample_mm.len()];
        for (view, candidate) in views {
            graded(problem, candidate).graded().for_each(|(sample, quality)| of_sample[sample.index()].push((view, quality)));
        }
        Self { of_sample }
    }

    /// Asked area that the views together measure at a grade or better, mm².
    pub(super) fn area_mm2(&self, problem: &ViewPlanningProblem<'_>, grade: Grade) -> f64 {
        let best = |measured: &Measurements| measured.iter().map(|(_, quality)| *quality).reduce(f32::max);
        let has_grade = |measured: &Measurements| best(measured).is_some_and(|quality| Grade::of(f64::from(quality)) <= grade);
        let graded = self.of_sample.iter().zip(&problem.asked_area_mm2).filter(|(measured, _)| has_grade(measured));
        graded.map(|(_, area_mm2)| area_mm2).sum()
    }

    /// Best quality of a sample by the other views, where one measures it.
    pub(super) fn best_of_others(&self, view: ViewId, sample: SampleId) -> Option<f32> {
        let others = self.of_sample[sample.index()].iter().filter(|(other, _)| *other != view);
        others.map(|(_, quality)| *quality).reduce(f32::max)
    }

    /// The change by a view that measures `after` in place of what it measures.
    pub(super) fn change(&self, problem: &ViewPlanningProblem<'_>, view: ViewId, before: &Row, after: &Row) -> Change {
        let requirements = &problem.surface.requirements;
        let mut change = Change { gained_mm2: vec![0.0; GRADES.len()], score_mm2: 0.0 };
        let mut add = |sample: SampleId, was: Option<f32>, is: Option<f32>| {
            let area_mm2 = problem.asked_area_mm2[sample.index()];
            if was == is || area_mm2 == 0.0 {
                return;
            }
            let value = |quality: Option<f32>| quality.map_or(0.0, |quality| problem.params.score.value(f64::from(quality)));
            change.score_mm2 += area_mm2 * requirements.of(sample).weight * (value(is) - value(was));
            let reaches =
                |quality: Option<f32>, grade: Grade| quality.is_some_and(|quality| Grade::of(f64::from(quality)) <= grade);
            let gained_mm2 = |was: bool, is: bool| area_mm2 * f64::from(i8::from(is) - i8::from(was));
            for (gained, grade) in change.gained_mm2.iter_mut().zip(GRADES) {
                *gained += gained_mm2(reaches(was, grade), reaches(is, grade));
            }
            for region in requirements.of(sample).regions.iter().map(|region| GRADES.len() + region) {
                change.gained_mm2.resize(change.gained_mm2.len().max(region + 1), 0.0);
                change.gained_mm2[region] += gained_mm2(was.is_some(), is.is_some());
            }
        };
        let best = |a: Option<f32>, b: Option<f32>| a.into_iter().chain(b).reduce(f32::max);
        let mut after_at = after.graded().peekable();
        let mut before_at = before.graded().peekable();
        while let Some(sample) = before_at.peek().into_iter().chain(after_at.peek()).map(|(sample, _)| *sample).min() {
            let others = self.best_of_others(view, sample);
            let was = before_at.next_if(|(at, _)| *at == sample).map(|(_, quality)| quality);
            let is = after_at.next_if(|(at, _)| *at == sample).map(|(_, quality)| quality);
            add(sample, best(others, was), best(others, is));
        }
        change
    }

    /// Puts what a view measures now in place of what it measured.
    pub(super) fn exchange(&mut self, view: ViewId, before: &Row, after: &Row) {
        before.samples().for_each(|sample| self.of_sample[sample.index()].retain(|(other, _)| *other != view));
        after.graded().for_each(|(sample, quality)| self.of_sample[sample.index()].push((view, quality)));
    }
}

/// Samples that a candidate measures, with its quality.
pub(super) fn graded(problem: &ViewPlanningProblem<'_>, candidate: CandidateIndex) -> Row {
    let pose = &problem.candidates[candidate].part_from_scanner;
    visibility::grade(&problem.surface, pose, problem.input.scanner, problem.params, problem.row(candidate))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::planning::candidates::CandidateSet;
    use crate::planning::params::PlanParams;
    use crate::planning::plan::ChosenOn;
    use crate::planning::problem::PartlyKnown;
    use crate::planning::scene::PlanInput;
    use crate::planning::surface::Surface;
    use crate::planning::visibility::{SampleSet, VisibilityMatrix};
    use crate::testing::{box_mesh, nominal_scanner};

    /// Areas of the samples.
    const AREA_MM2: [f64; 2] = [1.0, 4.0];
    /// Qualities of each grade.
    const A: Option<f32> = Some(0.75);
    const B: Option<f32> = Some(0.25);
    const C: Option<f32> = Some(-0.25);
    const D: Option<f32> = Some(-0.75);

    /// The change by a view that measures the two samples with the quality `after` in place of `before`, beside another view.
    fn change(before: [Option<f32>; 2], after: [Option<f32>; 2], other: [Option<f32>; 2]) -> Change {
        let (mesh, scanner, params) = (box_mesh([0.0; 3], [1.0; 3]), nominal_scanner(), PlanParams::default());
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        let problem = ViewPlanningProblem {
            input: &input,
            params: &params,
            surface: Arc::new(Surface::default()),
            setups: Vec::new(),
            candidates: CandidateSet::default(),
            matrix: VisibilityMatrix::default(),
            robust_rows: None,
            reach: None,
            hidden_by_cell: SampleSet::default(),
            asked_area_mm2: AREA_MM2.to_vec(),
            partly_known: PartlyKnown::default(),
            strata: None,
            coverable_of_setup_mm2: None,
            chosen_on: ChosenOn::default(),
        };
        let row = |measured: [Option<f32>; 2]| {
            let graded = SampleId::number(measured).filter_map(|(sample, quality)| Some((sample, quality?)));
            Row::from_samples(measured.len(), graded)
        };
        let mut guard = Guard { of_sample: vec![Measurements::new(); AREA_MM2.len()] };
        guard.exchange(ViewId(0), &Row::default(), &row(before));
        guard.exchange(ViewId(1), &Row::default(), &row(other));
        guard.change(&problem, ViewId(0), &row(before), &row(after))
    }

    /// Rolls were guarded by area alone once, and lowered grades.
    #[test]
    fn a_loss_of_area_alone_or_of_one_grade_or_better_is_refused_whatever_else_is_gained() {
        // Each is lost at one of the grades or better, and at that alone.
        let losses = [(A, B), (B, C), (C, D), (D, None)];
        for (lost, (was, is)) in losses.into_iter().enumerate() {
            let alone = change([was, None], [is, None], [None; 2]);
            let mut told_mm2 = [0.0; GRADES.len()];
            told_mm2[lost] = -1.0;
            assert_eq!(alone.gained_mm2, told_mm2);
            assert!(!alone.loses_nothing(), "{alone:?}");
            for (gained, (is_elsewhere, was_elsewhere)) in losses.into_iter().enumerate() {
                let change = change([was, was_elsewhere], [is, is_elsewhere], [None; 2]);
                assert_eq!(change.loses_nothing(), gained == lost, "4 mm² are gained, 1 mm² is lost: {change:?}");
            }
        }
    }

    #[test]
    fn what_another_view_measures_as_well_is_not_lost() {
        let taken_away = |other: Option<f32>| change([A, None], [None; 2], [other, None]).loses_nothing();
        assert_eq!([A, B, C, D, None].map(taken_away), [true, false, false, false, false]);
    }
}
