use std::sync::atomic::AtomicBool;

use nalgebra::Point3;

use super::certificate::{Drawn, random_error};
use super::*;
use crate::planning::context::Silent;
use crate::planning::params::{CandidateParams, Engine};
use crate::planning::plan::Outcome;
use crate::planning::random::Stream;
use crate::planning::{PlanInput, plan, tabulate};
use crate::testing::{nominal_scanner, trough};

const ERROR: PoseErrorParams = PoseErrorParams { angle_deg: 1.0, translation_mm: 2.0 };

#[test]
fn the_stated_errors_move_the_field_by_turn_and_shift_together() {
    let ahead = Point3::new(0.0, 0.0, 480.0);
    let both_mm = 480.0 * 1.0_f64.to_radians().sin() + 2.0;
    let moved = stated_errors(&ERROR).map(|error| error.point(&ahead));
    let wanted = [[0.0, -both_mm], [0.0, both_mm], [both_mm, 0.0], [-both_mm, 0.0], [0.0, 0.0], [0.0, 0.0]];
    for (moved, wanted) in moved.iter().zip(wanted) {
        assert!((moved.x - wanted[0]).abs() < 1e-9 && (moved.y - wanted[1]).abs() < 1e-9, "{moved}, wanted {wanted:?}");
    }
    assert_eq!([moved[4].z, moved[5].z], [482.0, 478.0]);
}

#[test]
fn a_random_error_turns_by_the_whole_angle_and_moves_the_centre_by_the_whole_distance() {
    let centre_mm = Point3::new(30.0, -20.0, 100.0);
    let mut stream = Stream::new(0, &[1]);
    for _ in 0..20 {
        let error: Pose<ScannerFrame, ScannerFrame> = random_error(&ERROR, &centre_mm, &mut stream);
        assert!((error.isometry().rotation.angle().to_degrees() - 1.0).abs() < 1e-9);
        assert!(((error.point(&centre_mm) - centre_mm).norm() - 2.0).abs() < 1e-9);
    }
}

#[test]
fn the_draws_are_told_by_their_worst_their_5th_percentile_and_their_mean() {
    let drawn = Drawn::new(0.9, (0..=20).rev().map(|i| f64::from(i) / 20.0).collect());
    assert_eq!((drawn.draws(), drawn.worst()), (21, 0.0));
    assert!((drawn.p5() - 0.05).abs() < 1e-12 && (drawn.mean() - 0.5).abs() < 1e-12);
    let few = Drawn::new(0.9, vec![0.8, 0.6]);
    assert!((few.p5() - 0.61).abs() < 1e-12, "linear between the draws");
}

fn params(error: Option<PoseErrorParams>) -> PlanParams {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.02), Some(20.0));
    (params.visibility.engine, params.missed.remedies) = (Engine::Rays, 0);
    params.selection.max_views = Some(3);
    (params.robust.pose_error, params.robust.draws, params.robust.part_draws) = (error, 3, 3);
    params
}

fn planned(params: &PlanParams) -> Outcome {
    let (mesh, scanner) = (trough(), nominal_scanner());
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None };
    plan(&input, params, &Context::new(&AtomicBool::new(false), &Silent)).expect("a plan")
}

#[test]
fn no_error_changes_nothing_and_a_large_one_costs_coverage() {
    let none = planned(&params(Some(PoseErrorParams { angle_deg: 0.0, translation_mm: 0.0 }))).plan.coverage;
    let robust = none.robust.expect("asked for");
    for drawn in [&robust.views, &robust.part] {
        assert_eq!((drawn.draws(), drawn.worst(), drawn.p5()), (3, drawn.nominal, drawn.nominal));
        assert!((drawn.mean() - drawn.nominal).abs() < 1e-12);
    }
    assert_eq!(robust.views.nominal, none.independent.of_asked());
    let large = planned(&params(Some(PoseErrorParams { angle_deg: 15.0, translation_mm: 60.0 }))).plan.coverage;
    let robust = large.robust.expect("asked for");
    assert!(robust.views.worst() < robust.views.nominal && robust.part.worst() < robust.part.nominal, "{robust:?}");
    assert!(planned(&params(None)).plan.coverage.robust.is_none());
}

#[test]
fn the_second_samples_are_other_points_as_dense_of_the_same_surface() {
    let outcome = planned(&params(None));
    let (coverage, samples) = (&outcome.plan.coverage, outcome.surface.sample_mm.len());
    assert_eq!(coverage.independent.samples, samples);
    assert!((coverage.independent.total_area_mm2 / coverage.total_area_mm2 - 1.0).abs() < 1e-12);
    assert!(coverage.independent.measured_area_mm2 != coverage.measured_area_mm2, "the same points");
    assert!((coverage.independent.of_asked() - coverage.of_asked()).abs() < 0.03, "{coverage:?}");
}

#[test]
fn views_that_shall_bear_an_error_are_chosen_by_less_than_they_measure() {
    let mut params = params(Some(PoseErrorParams { angle_deg: 3.0, translation_mm: 10.0 }));
    params.robust.select = true;
    let (mesh, scanner) = (trough(), nominal_scanner());
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None };
    let cancel = AtomicBool::new(false);
    let ctx = Context::new(&cancel, &Silent);
    let table = tabulate(&input, &params, &ctx).expect("a table");
    let occluders = Occluders::new([&mesh]);
    let scene = VisibilityInput { surface: &table.surface, scanner: &scanner, occluders: &occluders, params: &params };
    let candidates = crate::planning::candidates::CandidateSet { kept: table.candidates, ..Default::default() };
    let visible = visibility::VisibilityMatrix { rows: table.rows, furthest_cause: Vec::new() };
    let evaluated = EvaluatedCandidates { candidates, matrix: visible, reach: None };
    let robust = rows(&scene, &evaluated, &ctx).expect("not cancelled").expect("asked for");
    let mut lost = 0;
    for (robust, nominal) in robust.iter().zip(&evaluated.matrix.rows) {
        let kept: Vec<_> = nominal.graded().filter(|(sample, _)| robust.holds(*sample)).collect();
        assert_eq!(robust.graded().collect::<Vec<_>>(), kept, "the quality of the view as planned");
        lost += nominal.count() - robust.count();
    }
    assert!(lost > 0, "no error takes anything");
    let mut as_ever = params.clone();
    as_ever.robust.select = false;
    let scene = VisibilityInput { params: &as_ever, ..scene };
    assert!(rows(&scene, &evaluated, &ctx).expect("not cancelled").is_none());
}
