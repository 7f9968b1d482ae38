use std::sync::atomic::AtomicBool;

use nalgebra::{Point3, Vector3};

use super::draws::spread_error;
use super::*;
use crate::geometry::Mesh;
use crate::planning::context::Silent;
use crate::planning::params::{CandidateParams, Engine, InterestParams, PoseErrorParams, Region};
use crate::planning::plan;
use crate::planning::plan::{Drawn, Outcome};
use crate::planning::random::Stream;
use crate::testing::{box_mesh, nominal_scanner, trough};

const ERROR: PoseErrorParams = PoseErrorParams { angle_deg: 1.0, translation_mm: 2.0 };

/// The six errors of a block.
fn block(number: u64, centre_mm: &Point3<f64>) -> [Pose<ScannerFrame, ScannerFrame>; 6] {
    std::array::from_fn(|place| spread_error(&ERROR, place, centre_mm, &mut Stream::new(0, &[number])))
}

#[test]
fn six_errors_turn_and_shift_by_all_of_it_both_ways_along_three_axes_at_right_angles() {
    let centre_mm = Point3::new(30.0, -20.0, 100.0);
    for number in 0..20 {
        let errors = block(number, &centre_mm);
        let turns = errors.map(|error| error.isometry().rotation.scaled_axis() / ERROR.angle_deg.to_radians());
        let shifts = errors.map(|error| (error.point(&centre_mm) - centre_mm) / ERROR.translation_mm);
        for directions in [turns, shifts] {
            let sum = directions.iter().fold(Vector3::<f64>::zeros(), |sum, direction| sum + direction);
            assert!(sum.norm() < 1e-9, "{directions:?}");
            for direction in &directions {
                let count = |cos: f64| directions.iter().filter(|&other| (direction.dot(other) - cos).abs() < 1e-9).count();
                assert_eq!([count(1.0), count(-1.0), count(0.0)], [1, 1, 4], "{directions:?}");
            }
        }
        // The two turns about an axis: their shifts are no mirror images.
        for (a, b) in (0..6_usize).flat_map(|a| (0..a).map(move |b| (a, b))) {
            let is_opposite = turns[a].dot(&turns[b]) < -0.5;
            assert!(!is_opposite || shifts[a].dot(&shifts[b]).abs() < 1e-9, "{shifts:?}");
        }
    }
}

#[test]
fn some_error_of_a_block_has_0_577_of_the_turn_and_of_the_shift_in_any_direction() {
    let mut stream = Stream::new(1, &[]);
    for number in 0..200 {
        let (direction, errors) = (stream.direction().into_inner(), block(number, &Point3::origin()));
        let turn = errors.map(|error| error.isometry().rotation.scaled_axis().dot(&direction)).into_iter().fold(0.0, f64::max);
        let shift_mm = errors.map(|error| error.origin_mm().coords.dot(&direction)).into_iter().fold(0.0, f64::max);
        assert!(turn.to_degrees() >= 0.577 * ERROR.angle_deg, "{direction:?}");
        assert!(shift_mm >= 0.577 * ERROR.translation_mm, "{direction:?}");
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

/// A region of interest of 19.6 mm², on top of a wall of the trough or where else `centre_mm` is.
fn seat(centre_mm: [f64; 3], target: f64) -> InterestParams {
    InterestParams {
        name: None,
        region: Region::Sphere { centre_mm, radius_mm: 2.5 },
        weight: 1.0,
        target: Some(target),
        camera_deg: None,
        projector_deg: None,
        min_grade: None,
    }
}

#[test]
fn a_small_region_is_told_by_samples_of_its_own_in_both_sets() {
    let mut params = params(None);
    params.regions.interest = vec![seat([0.0, 22.5, 70.0], 0.5)];
    let coverage = planned(&params).plan.coverage;
    let region = &coverage.regions[0];
    let independent = region.independent.expect("samples of the region");
    assert!(region.samples >= 100 && independent.samples >= SAMPLES_OF_A_REGION, "{region:?}");
    for area_mm2 in [region.asked_area_mm2, independent.asked_area_mm2] {
        assert!((area_mm2 - 6.25 * std::f64::consts::PI).abs() < 1.0, "{region:?}");
    }
    assert!((independent.of_asked() - region.of_asked()).abs() < 0.1, "{region:?}");
}

/// A box of 7600 mm² of which an edge strip of so many mm along y and z is asked, 0.1 µm of it on the faces beside.
fn sliver(y_mm: f64, z_mm: f64) -> (Mesh, PlanParams) {
    let mut params = PlanParams::default();
    let ends = [([29.9999, 0.0, 0.0], 0), ([0.0, 20.0 - y_mm, 0.0], 1), ([0.0, 0.0, 15.0 - z_mm], 2)];
    let beyond = |(point_mm, axis): ([f64; 3], usize)| {
        let normal = std::array::from_fn(|own| f64::from(u8::from(own == axis)));
        Region::HalfSpace { point_mm, normal }
    };
    params.regions.exclude = ends.map(beyond).into();
    (box_mesh([-30.0, -20.0, -15.0], [30.0, 20.0, 15.0]), params)
}

/// Some seeds had such a job refused; with others the second samples held nothing of it, and the plan told 0 % beside 100 %.
#[test]
fn a_sliver_of_a_part_has_samples_in_both_sets_with_every_seed() {
    let (scanner, cancel, (mesh, mut params)) = (nominal_scanner(), AtomicBool::new(false), sliver(0.05, 0.4));
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    let ctx = Context::new(&cancel, &Silent);
    for seed in 0..6 {
        params.seed = seed;
        let first = requirements::sampled(&mesh, &params, seed, &ctx).unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        let second = SecondSampling::new(&input, &params, &[], None, &ctx).unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        for (surface, least) in [(&first, 60), (&second.surface, 240)] {
            let (asked, asked_mm2) = (surface.asked.iter().filter(|asked| **asked).count(), surface.asked_area_mm2());
            let share = asked_mm2.iter().sum::<f64>() / 0.020_045;
            assert!(asked >= least && (share - 1.0).abs() < 0.3, "seed {seed}: {asked} samples of {share} of it");
            assert!((surface.area_where(|_| true) - mesh.area_mm2()).abs() < 1e-6, "every patch stands for its area");
        }
    }
}

#[test]
fn what_is_too_little_for_samples_is_refused_with_every_seed() {
    let (cancel, (mesh, params)) = (AtomicBool::new(false), sliver(1e-4, 1e-4));
    for seed in 0..3 {
        let refused = requirements::sampled(&mesh, &params, seed, &Context::new(&cancel, &Silent)).expect_err("nothing is left");
        assert!(refused.to_string().starts_with("/regions/exclude: leaves nothing of the part"), "{refused}");
    }
}

/// The chosen samples of such a disc may all lie in the half that views see: others say that the target is missed.
#[test]
fn a_disc_that_views_see_half_of_is_half_measured_on_the_second_samples() {
    let (mesh, scanner, mut params) = (trough(), nominal_scanner(), params(None));
    params.regions.interest = vec![seat([50.0, 45.0, 10.0], 0.95), seat([-500.0, 0.0, 0.0], 0.95)];
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    let cancel = AtomicBool::new(false);
    let second = SecondSampling::new(&input, &params, &[], None, &Context::new(&cancel, &Silent)).expect("samples");
    let mut measured = SampleSet::none_of(second.asked_area_mm2.len());
    let is_seen = |sample: &SampleId| second.surface.sample_mm[sample.index()].x < 50.0;
    second.surface.samples().filter(is_seen).for_each(|sample| measured.insert(sample));
    let [disc, beside] = second.of_regions(&[Row::new(measured.into_words())])[..] else { panic!("two regions") };
    // The standard error of a half of 475 plain random points is 2.3 points.
    assert!((disc.of_asked() - 0.5).abs() < 0.046, "{disc:?}");
    assert!((0.015..0.025).contains(&disc.standard_error()), "{disc:?}");
    assert_eq!((beside.samples, beside.asked_area_mm2), (0, 0.0));
}
