//! Verdict of every sample: its best grade, or the first failing cause of the candidate that gets furthest
//! ([`crate::planning::method::causes`]).

use std::collections::{BTreeMap, BTreeSet};

use crate::geometry::{RayScene, parallel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, SampleId};
use crate::planning::params::Hemisphere;
use crate::planning::plan::{Cause, Grade, Verdict};
use crate::planning::problem::ViewPlanningProblem;
use crate::planning::sight::sky::{Sky, SkyProbe, stands_on};
use crate::planning::stations::StationFailure;
use crate::planning::visibility::{Occluders, Optics, Row, SampleSet, UnitedViews};

/// Measured samples that count.
pub(super) struct Counted<'a> {
    /// Samples that each chosen view measures and that count, with its quality.
    pub(super) measuring: &'a [Row],
    /// Samples that some view measures and that do not count, since they are at risk.
    pub(super) left_out: &'a SampleSet,
}

/// Verdicts, given what each chosen view measures and the candidates that were given up for want of a path. `part` is
/// the part alone.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn of(
    problem: &ViewPlanningProblem<'_>,
    counted: &Counted<'_>,
    all_excluded: &BTreeSet<CandidateIndex>,
    (occluders, part): (&Occluders, &RayScene),
    ctx: &Context<'_>,
) -> Result<Vec<Verdict>, Cancelled> {
    let samples = problem.surface.sample_mm.len();
    let mut best_quality = vec![f32::NEG_INFINITY; samples];
    for row in counted.measuring {
        for (sample, quality) in row.graded() {
            let best = &mut best_quality[sample.index()];
            *best = best.max(quality);
        }
    }
    let is_missed = |sample: &SampleId| problem.surface.asked[sample.index()] && best_quality[sample.index()].is_infinite();
    let missed: Vec<SampleId> = problem.surface.samples().filter(is_missed).collect();
    let causes = causes(problem, counted.left_out, &missed, (all_excluded, occluders, part), ctx)?;
    let mut verdicts = vec![Verdict::NotAsked; samples];
    for (verdict, (quality, asked)) in verdicts.iter_mut().zip(best_quality.iter().zip(&problem.surface.asked)) {
        if *asked && quality.is_finite() {
            *verdict = Verdict::Measured(Grade::of(f64::from(*quality)));
        }
    }
    missed.iter().zip(causes).for_each(|(sample, cause)| verdicts[sample.index()] = Verdict::Missed(cause));
    Ok(verdicts)
}

/// Cause of each missed sample: what is cheap to tell first, since views and lines of sight are cast for the others alone.
fn causes(
    problem: &ViewPlanningProblem<'_>,
    left_out: &SampleSet,
    missed: &[SampleId],
    (all_excluded, occluders, part): (&BTreeSet<CandidateIndex>, &Occluders, &RayScene),
    ctx: &Context<'_>,
) -> Result<Vec<Cause>, Cancelled> {
    let motion_cause = motion_causes(problem, all_excluded);
    let plate_radius_mm = problem.input.cell.map(|cell| cell.turntable.plate_radius_mm);
    let rests_on = |sample: SampleId| {
        let stands = |radius_mm| problem.setups.iter().all(|pose| stands_on(&problem.surface, sample, pose, radius_mm));
        plate_radius_mm.is_some_and(stands)
    };
    let known = |sample: &SampleId| match motion_cause[sample.index()] {
        _ if left_out.holds(*sample) => Some(Cause::AtRisk),
        _ if rests_on(*sample) => Some(Cause::ExcludedResting),
        cause => cause,
    };
    let mut causes: Vec<Option<Cause>> = parallel::map(missed, known);
    let open = |causes: &[Option<Cause>]| -> Vec<usize> { (0..missed.len()).filter(|place| causes[*place].is_none()).collect() };
    let unexplained = open(&causes);
    let samples_of = |places: &[usize]| -> Vec<SampleId> { places.iter().map(|place| missed[*place]).collect() };
    let by_dropped = measured_by_dropped(problem, occluders, &samples_of(&unexplained), ctx)?;
    let hindered = SampleId::number(unexplained).filter(|(number, _)| by_dropped.holds(*number));
    hindered.for_each(|(_, place)| causes[place] = Some(Cause::Collision));
    let unexplained = open(&causes);
    let skies = sky_probe(problem, part, ctx).skies(&problem.surface, &samples_of(&unexplained), ctx)?;
    for (place, sky) in unexplained.into_iter().zip(skies) {
        causes[place] = Some(match sky {
            Sky::Closed => Cause::Enclosed,
            Sky::BelowPlate => Cause::FacesTable,
            Sky::Open => problem.matrix.furthest_cause[missed[place].index()],
        });
    }
    Ok(causes.into_iter().map(|cause| cause.unwrap_or(Cause::Facing)).collect())
}

/// Samples, as numbers in `open`, that views would measure that were dropped since the scanner's body meets something: collision
/// alone is what keeps them from that.
fn measured_by_dropped(
    problem: &ViewPlanningProblem<'_>,
    occluders: &Occluders,
    open: &[SampleId],
    ctx: &Context<'_>,
) -> Result<SampleSet, Cancelled> {
    let ViewPlanningProblem { surface, params, input, .. } = problem;
    let area_mm2 = |sample: &SampleId| (*sample, surface.sample_area_mm2(*sample));
    let surface = surface.of_samples(&open.iter().map(area_mm2).collect::<Vec<_>>());
    let optics = Optics::new(input.scanner, params, &surface.requirements);
    let poses = problem.dropped_for_body().filter(|_| !open.is_empty()).map(|candidate| &candidate.part_from_scanner);
    UnitedViews::new(&surface, &optics, occluders, params, &ctx.silent()).measured(poses)
}

/// The sky over the part: with viewpoints above the plate alone, in the setups that are planned in.
fn sky_probe<'a>(problem: &'a ViewPlanningProblem<'_>, part: &'a RayScene, ctx: &Context<'_>) -> SkyProbe<'a> {
    let (input, params) = (problem.input, problem.params);
    let above_only = params.candidates.hemisphere == Some(Hemisphere::AboveTable);
    let setups = if above_only { &problem.setups[..] } else { &[] };
    let limit_rad = |device| params.limits.incidence_max_rad(device);
    let incidence_max_rad = input.scanner.devices.iter().map(limit_rad).fold(f64::INFINITY, f64::min);
    let plates = (setups, params.candidates.min_elevation_deg);
    SkyProbe::new(input.mesh, part, plates, input.scanner.best_mm, incidence_max_rad, ctx.simd_level())
}

/// Cause by motion of each sample that some candidate measures: how far the best such candidate got with the cell.
fn motion_causes(problem: &ViewPlanningProblem<'_>, all_excluded: &BTreeSet<CandidateIndex>) -> Vec<Option<Cause>> {
    let samples = problem.surface.sample_mm.len();
    let mut samples_of = BTreeMap::from([(Cause::HiddenByCell, problem.hidden_by_cell.clone())]);
    for candidate in problem.candidates.indices() {
        let cause = match problem.blocked(candidate) {
            Some(StationFailure::Unreachable) => Cause::Unreachable,
            Some(StationFailure::Collision) => Cause::Collision,
            None if all_excluded.contains(&candidate) => Cause::NoPath,
            None => Cause::NotChosen,
        };
        samples_of.entry(cause).or_insert_with(|| SampleSet::none_of(samples)).insert_all(problem.row(candidate).measured());
    }
    let mut causes = vec![None; samples];
    for (cause, samples) in samples_of {
        samples.iter().for_each(|sample| causes[sample.index()] = Some(cause));
    }
    causes
}

/// Tells samples as without a path in a plan that ended for want of one, where a view that was chosen and given up measures them:
/// `given_up` are the rows of those. Candidates that were not tried in their place may measure them too.
pub(super) fn blame_paths<'r>(verdicts: &mut [Verdict], given_up: impl IntoIterator<Item = &'r Row>) {
    let mut lacking = SampleSet::none_of(verdicts.len());
    given_up.into_iter().for_each(|row| lacking.insert_all(row.measured()));
    for sample in lacking.iter() {
        let verdict = &mut verdicts[sample.index()];
        if *verdict == Verdict::Missed(Cause::NotChosen) {
            *verdict = Verdict::Missed(Cause::NoPath);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::cell::{Presets, SpecLibrary};
    use crate::planning::context::Silent;
    use crate::planning::params::{PlanParams, Solver, Strategy};
    use crate::planning::plan::{Advice, StopReason};
    use crate::planning::{PlanInput, plan};
    use crate::testing::box_mesh;

    /// All but the few views that were tried were told as measurable, with more views as their fix, and the part was to be laid another
    /// way.
    #[test]
    fn area_is_missed_for_want_of_a_path_where_the_home_lies_within_the_part() {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
        let mesh = box_mesh([-100.0, -100.0, 0.0], [100.0, 100.0, 750.0]);
        let input =
            PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(&cell), roadmaps: None };
        let mut params = PlanParams::default();
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.0005), Some(60.0));
        (params.candidates.strategies, params.candidates.even_directions) = (vec![Strategy::Even], Some(20));
        (params.selection.max_views, params.robust.pose_error) = (Some(1), None);
        (params.missed.remedies, params.missed.advice) = (0, false);
        let outcome = plan(&input, &params, &Context::new(&AtomicBool::new(false), &Silent)).expect("a plan");
        let missed_mm2 = |cause: Cause| -> f64 {
            outcome.plan.missed.iter().filter(|missed| missed.cause == cause).map(|missed| missed.area_mm2).sum()
        };
        assert_eq!(outcome.plan.executed_views(), 0);
        assert!(missed_mm2(Cause::NotChosen) <= 0.0, "{} mm² without a view", missed_mm2(Cause::NotChosen));
        let no_path_mm2 = missed_mm2(Cause::NoPath);
        assert!(no_path_mm2 > 0.5 * outcome.plan.coverage.asked_area_mm2, "{no_path_mm2} mm² without a path");
        let obstructions = outcome.plan.obstructions.iter().filter(|found| found.without_path > 0);
        let advice: Vec<_> = obstructions.map(|found| &found.advice).collect();
        assert!(!advice.is_empty() && advice.iter().all(|advice| **advice == Advice::MoveHome), "{advice:?}");
    }

    #[test]
    fn what_views_without_a_path_would_measure_lacks_a_path_though_others_were_not_tried() {
        let missed = Verdict::Missed;
        let mut verdicts = [
            missed(Cause::NotChosen),
            missed(Cause::NotChosen),
            missed(Cause::NotChosen),
            missed(Cause::AtRisk),
            Verdict::Measured(Grade::A),
            missed(Cause::ShadowLeft),
        ];
        let row = |samples: &[u32]| Row::from_samples(6, samples.iter().map(|sample| (SampleId(*sample), 1.0)));
        blame_paths(&mut verdicts, &[row(&[0, 3, 4]), row(&[1, 4])]);
        let told = [
            missed(Cause::NoPath),
            missed(Cause::NoPath),
            missed(Cause::NotChosen),
            missed(Cause::AtRisk),
            Verdict::Measured(Grade::A),
            missed(Cause::ShadowLeft),
        ];
        assert_eq!(verdicts, told);
    }

    /// A plan that ended since no path leads to 3 of its 17 views told all that these would measure, 82 312 mm², as measurable and not
    /// chosen: a candidate beside them that was never tried measures it.
    #[test]
    #[ignore = "long: tests/all runs it"]
    fn what_is_left_to_views_without_a_path_is_missed_for_want_of_one() {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
        let mesh = box_mesh([-200.0, -200.0, 0.0], [200.0, 200.0, 220.0]);
        let input =
            PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(&cell), roadmaps: None };
        let mut params = PlanParams::default();
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.0005), Some(60.0));
        (params.candidates.strategies, params.candidates.even_directions) = (vec![Strategy::Even], Some(20));
        (params.selection.solver, params.robust.pose_error) = (Solver::Greedy, None);
        (params.missed.remedies, params.missed.advice) = (0, false);
        let plan = plan(&input, &params, &Context::new(&AtomicBool::new(false), &Silent)).expect("a plan").plan;
        assert_eq!(plan.stopped_because, StopReason::NoPath);
        let missed_mm2 = |cause: Cause| -> f64 {
            plan.missed.iter().filter(|missed| missed.cause == cause).map(|missed| missed.area_mm2).sum()
        };
        let short_mm2 = plan.coverage.coverable_area_mm2 - plan.coverage.measured.area_mm2;
        let no_path_mm2 = missed_mm2(Cause::NoPath);
        // With those that have no path the views meet the target.
        let left_by_target_mm2 = (1.0 - params.selection.target) * plan.coverage.coverable_area_mm2;
        assert!(short_mm2 > 2.0 * left_by_target_mm2, "{short_mm2} mm² of what is coverable are missed");
        assert!(no_path_mm2 >= short_mm2 - left_by_target_mm2 - 1e-6, "{no_path_mm2} of {short_mm2} mm² for want of a path");
        assert!(missed_mm2(Cause::NotChosen) <= left_by_target_mm2 + 1e-6, "{} mm²", missed_mm2(Cause::NotChosen));
    }

    /// All of the underside was told as resting, and the visible area was too small by what overhangs.
    #[test]
    fn what_overhangs_the_plate_faces_the_table_and_is_visible() {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
        let mesh = box_mesh([-288.0, -30.0, 0.0], [288.0, 30.0, 20.0]);
        let input =
            PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(&cell), roadmaps: None };
        let mut params = PlanParams::default();
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.005), Some(40.0));
        (params.candidates.strategies, params.candidates.even_directions) = (vec![Strategy::Even], Some(20));
        (params.selection.max_views, params.robust.pose_error) = (Some(1), None);
        (params.missed.remedies, params.missed.advice) = (0, false);
        let outcome = plan(&input, &params, &Context::new(&AtomicBool::new(false), &Silent)).expect("a plan");
        let missed_mm2 = |cause: Cause| -> f64 {
            outcome.plan.missed.iter().filter(|missed| missed.cause == cause).map(|missed| missed.area_mm2).sum()
        };
        // The part of the underside over a plate of 500 mm: a strip of 60 mm across the disc.
        let (underside_mm2, on_plate_mm2) = (576.0 * 60.0, 60.0 * 500.0 * (1.0 - 30.0 * 30.0 / (6.0 * 250.0 * 250.0)));
        let (resting_mm2, facing_mm2) = (missed_mm2(Cause::ExcludedResting), missed_mm2(Cause::FacesTable));
        assert!((resting_mm2 - on_plate_mm2).abs() < 1500.0, "{resting_mm2} mm² rest, not {on_plate_mm2}");
        assert!((resting_mm2 + facing_mm2 - underside_mm2).abs() < 1.0, "{resting_mm2} and {facing_mm2} of {underside_mm2} mm²");
        let coverage = &outcome.plan.coverage;
        for visible_mm2 in [coverage.visible_area_mm2, coverage.independent.visible_area_mm2] {
            let wanted_mm2 = coverage.total_area_mm2 - on_plate_mm2;
            assert!((visible_mm2 - wanted_mm2).abs() < 1500.0, "{visible_mm2} mm² are visible, not {wanted_mm2}");
        }
    }
}
