use std::sync::atomic::AtomicBool;

use nalgebra::Point3;

use super::draws::random_error;
use super::*;
use crate::planning::context::Silent;
use crate::planning::params::{CandidateParams, Engine, PoseErrorParams};
use crate::planning::plan;
use crate::planning::plan::{Drawn, Outcome};
use crate::planning::random::Stream;
use crate::testing::{nominal_scanner, trough};

const ERROR: PoseErrorParams = PoseErrorParams { angle_deg: 1.0, translation_mm: 2.0 };

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
    (params.robust.pose_error, params.robust.draws) = (error, 3);
    (params.robust.part_draws, params.robust.hand_eye_draws) = (3, 3);
    params
}

fn planned(params: &PlanParams) -> Outcome {
    let (mesh, scanner) = (trough(), nominal_scanner());
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    plan(&input, params, &Context::new(&AtomicBool::new(false), &Silent)).expect("a plan")
}

#[test]
#[ignore = "long: tests/all runs it"]
fn no_error_changes_nothing_and_a_large_one_costs_coverage() {
    let none = planned(&params(Some(PoseErrorParams { angle_deg: 0.0, translation_mm: 0.0 }))).plan.coverage;
    let robust = none.robust.expect("asked for");
    for drawn in [&robust.views, &robust.part, &robust.hand_eye] {
        assert_eq!((drawn.draws(), drawn.worst(), drawn.p5()), (3, drawn.nominal, drawn.nominal));
        assert!((drawn.mean() - drawn.nominal).abs() < 1e-12);
    }
    assert_eq!(robust.views.nominal, none.independent.of_asked());
    let large = planned(&params(Some(PoseErrorParams { angle_deg: 15.0, translation_mm: 60.0 }))).plan.coverage;
    let robust = large.robust.expect("asked for");
    for drawn in [&robust.views, &robust.part, &robust.hand_eye] {
        assert!(drawn.worst() < drawn.nominal, "{robust:?}");
    }
    assert!(planned(&params(None)).plan.coverage.robust.is_none());
}

#[test]
fn the_second_samples_are_other_points_as_dense_of_the_same_surface() {
    let outcome = planned(&params(None));
    let (coverage, samples) = (&outcome.plan.coverage, outcome.surface.sample_mm.len());
    assert_eq!(coverage.independent.samples, samples);
    assert!((coverage.independent.total_area_mm2 / coverage.total_area_mm2 - 1.0).abs() < 1e-12);
    assert!(coverage.independent.measured.area_mm2 != coverage.measured.area_mm2, "the same points");
    assert!((coverage.independent.of_asked() - coverage.of_asked()).abs() < 0.03, "{coverage:?}");
}
