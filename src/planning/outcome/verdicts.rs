//! Verdict of every sample: its best grade, or the first failing cause of the candidate that gets furthest
//! ([`crate::planning::method::causes`]).

use std::collections::{BTreeMap, BTreeSet};

use crate::planning::missed;
use crate::planning::plan::{Cause, Grade, Verdict};
use crate::planning::problem::ViewPlanningProblem;
use crate::planning::stations::StationFailure;
use crate::planning::visibility::{Row, SampleSet};

/// Verdicts, given what each chosen view measures and the candidates that were given up for want of a path.
pub(super) fn of(problem: &ViewPlanningProblem<'_>, measuring: &[Row], all_excluded: &BTreeSet<usize>) -> Vec<Verdict> {
    let samples = problem.surface.sample_mm.len();
    let mut best_quality = vec![f32::NEG_INFINITY; samples];
    for row in measuring {
        for (sample, quality) in row.graded() {
            let best = &mut best_quality[sample as usize];
            *best = best.max(quality);
        }
    }
    let motion_cause = motion_causes(problem, all_excluded);
    let rests_on = |sample: usize| {
        problem.reach.is_some() && problem.setups.iter().all(|pose| missed::stands_on(&problem.surface, sample, pose))
    };
    let cause = |sample: usize| match motion_cause[sample] {
        _ if rests_on(sample) => Cause::ExcludedResting,
        Some(cause) => cause,
        None => problem.matrix.furthest_cause[sample],
    };
    let verdict = |sample: usize| match best_quality[sample] {
        _ if !problem.surface.asked[sample] => Verdict::NotAsked,
        quality if quality > f32::NEG_INFINITY => Verdict::Measured(Grade::of(f64::from(quality))),
        _ => Verdict::Missed(cause(sample)),
    };
    (0..samples).map(verdict).collect()
}

/// Cause by motion of each sample that some kept candidate measures: how far the best such candidate got with the cell.
fn motion_causes(problem: &ViewPlanningProblem<'_>, all_excluded: &BTreeSet<usize>) -> Vec<Option<Cause>> {
    let samples = problem.surface.sample_mm.len();
    let mut samples_of: BTreeMap<Cause, SampleSet> = BTreeMap::new();
    for (kept, row) in problem.matrix.rows.iter().enumerate() {
        let cause = match problem.blocked(kept) {
            Some(StationFailure::Unreachable) => Cause::Unreachable,
            Some(StationFailure::Collision) => Cause::Collision,
            None if all_excluded.contains(&kept) => Cause::NoPath,
            None => Cause::NotChosen,
        };
        samples_of.entry(cause).or_insert_with(|| SampleSet::none_of(samples)).insert_all(row.measured());
    }
    let mut causes = vec![None; samples];
    for (cause, samples) in samples_of {
        samples.iter().for_each(|sample| causes[sample as usize] = Some(cause));
    }
    causes
}
