//! Sphere, cube and step, whose coverage can be written down; visibility without a tree; the same plan on any number
//! of threads.

mod brute_force;
pub(crate) mod caps;

use std::f64::consts::PI;
use std::sync::atomic::AtomicBool;

use nalgebra::{Point3, Rotation3, UnitQuaternion, Vector3};
use vantage::cell::{OpticalDevice, PerDevice, Scanner};
use vantage::geometry::{Mesh, Part, Pose, ScannerFrame};
use vantage::planning::context::{Context, Silent};
use vantage::planning::ids::SampleId;
use vantage::planning::params::{Engine, Objective, PlanParams};
use vantage::planning::plan::AdviceKind;
use vantage::planning::surface::{self, Surface};
use vantage::planning::visibility::{self, Row};
use vantage::wire::echo::Echo;
use vantage::wire::plan::PlanDocument;

use crate::support::shapes::{sphere, step};
use crate::support::{box_mesh, limited_to, nominal_scanner, plan_viewpoints, preset_scanner};
use caps::Cap;

/// Samples of a mesh, about `count` of them.
pub(crate) fn sampled(mesh: &Mesh, count: f64) -> Surface {
    let mut params = PlanParams::default();
    (params.part.patch_edge_mm, params.part.samples_per_mm2) = (Some(20.0), Some(count / mesh.area_mm2()));
    surface::sample(mesh, &params.part, &params.regions, 0).expect("valid parameters")
}

/// Samples that each of `poses` measures.
pub(crate) fn rows(
    mesh: &Mesh,
    surface: &Surface,
    poses: &[Pose<Part, ScannerFrame>],
    scanner: &Scanner,
    params: &PlanParams,
) -> Vec<Row> {
    let (scene, cancel) = (visibility::Occluders::new([mesh]), AtomicBool::new(false));
    visibility::cast(surface, poses, &vec![true; poses.len()], scanner, &scene, params, &Context::new(&cancel, &Silent))
        .expect("not cancelled")
        .rows
}

/// Share of the surface that one view measures.
fn share(mesh: &Mesh, pose: Pose<Part, ScannerFrame>, scanner: &Scanner, params: &PlanParams) -> f64 {
    let surface = sampled(mesh, 60_000.0);
    let row = rows(mesh, &surface, &[pose], scanner, params).remove(0);
    row.samples().map(|sample| surface.sample_area_mm2(sample)).sum::<f64>() / mesh.area_mm2()
}

fn limits(camera_deg: f64, projector_deg: f64) -> PlanParams {
    let mut params = PlanParams::default();
    (params.limits.camera_deg, params.limits.projector_deg) = (Some(camera_deg), Some(projector_deg));
    params
}

/// A scanner that looks at the origin from `distance_mm` in direction `from`, turned by `roll_rad`.
fn looking_at_origin(from: Vector3<f64>, distance_mm: f64, roll_rad: f64) -> Pose<Part, ScannerFrame> {
    let axis = -from.normalize();
    let rotation =
        Rotation3::face_towards(&axis, &Vector3::new(0.3, -0.8, 0.5)) * Rotation3::from_axis_angle(&Vector3::z_axis(), roll_rad);
    Pose::from_parts(-axis * distance_mm, UnitQuaternion::from_rotation_matrix(&rotation))
}

/// Straight down on the origin from `height_mm`, baseline along x.
fn looking_down(height_mm: f64) -> Pose<Part, ScannerFrame> {
    Pose::from_parts(Vector3::new(0.0, 0.0, height_mm), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI))
}

/// The points of a sphere about the origin that a device at distance L from its centre sees at an incidence up to θ are
/// a cap: by the law of sines its half angle is θ − asin(R sin θ / L). A view measures where the three caps meet.
fn caps_of(scanner: &Scanner, pose: &Pose<Part, ScannerFrame>, radius_mm: f64, limits_deg: PerDevice<f64>) -> Vec<Cap> {
    let limits_rad = limits_deg.map(f64::to_radians);
    let cap = |(device, limit_rad): (OpticalDevice, f64)| {
        let centre = pose.point(&device.scanner_from_device.origin_mm()).coords;
        Cap { axis: centre.normalize(), half_angle: limit_rad - (radius_mm * limit_rad.sin() / centre.norm()).asin() }
    };
    scanner.devices.into_iter().zip(limits_rad).map(cap).collect()
}

#[test]
#[ignore = "long: tests/all runs it"]
fn sphere_is_measured_where_three_caps_meet() {
    let radius_mm = 20.0;
    let ball = sphere(radius_mm, 6);
    for scanner in [nominal_scanner(), preset_scanner("transcan-c")].map(|scanner| limited_to(scanner, [89.9; 3])) {
        for (camera_deg, projector_deg) in [(85.0, 85.0), (85.0, 77.5), (60.0, 55.0), (30.0, 40.0), (12.0, 60.0)] {
            for (from, roll_rad) in [(Vector3::z(), 0.0), (Vector3::new(1.0, -2.0, 0.4), 0.7)] {
                let params = limits(camera_deg, projector_deg);
                let pose = looking_at_origin(from, 480.0, roll_rad);
                let caps = caps_of(&scanner, &pose, radius_mm, PerDevice::of_cameras(camera_deg, projector_deg));
                let expected = caps::common_area(&caps) / (4.0 * PI);
                let measured = share(&ball, pose, &scanner, &params);
                assert!(
                    (measured - expected).abs() < 1e-3,
                    "{} {camera_deg}/{projector_deg} from {from:?}: {measured}, in closed form {expected}",
                    scanner.name
                );
            }
        }
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn sphere_is_measured_up_to_each_device_s_own_limit() {
    let (radius_mm, pose) = (20.0, looking_at_origin(Vector3::new(1.0, -2.0, 0.4), 480.0, 0.7));
    let ball = sphere(radius_mm, 6);
    for [left, right, projector] in [[85.0, 45.0, 77.5], [45.0, 85.0, 77.5], [70.0, 55.0, 40.0]] {
        let scanner = limited_to(nominal_scanner(), [left, right, projector]);
        let caps = caps_of(&scanner, &pose, radius_mm, PerDevice { left, right, projector });
        let expected = caps::common_area(&caps) / (4.0 * PI);
        for engine in [Engine::Raster, Engine::Rays] {
            let mut params = PlanParams::default();
            params.visibility.engine = engine;
            let measured = share(&ball, pose, &scanner, &params);
            assert!((measured - expected).abs() < 1e-3, "{left}/{right}/{projector} {engine:?}: {measured}, expected {expected}");
        }
    }
}

#[test]
fn sphere_that_only_the_baseline_hides_is_not_measured_at_all() {
    // At 10° the two caps are each 9.6° wide and 23.8° apart: no point is seen by both cameras.
    let params = limits(10.0, 60.0);
    let pose = looking_at_origin(Vector3::z(), 480.0, 0.0);
    assert_eq!(share(&sphere(20.0, 5), pose, &nominal_scanner(), &params), 0.0);
}

#[test]
fn sphere_is_cut_by_the_working_depth_into_a_zone() {
    // A zone's area is 2πR times its height (Archimedes): with the centre 15 mm behind the far depth, the cap in front
    // of it is R − 15 mm high.
    let (radius_mm, scanner) = (40.0, limited_to(nominal_scanner(), [89.0; 3]));
    let pose = looking_at_origin(Vector3::z(), scanner.far_mm + 15.0, 0.0);
    let measured = share(&sphere(radius_mm, 6), pose, &scanner, &limits(89.0, 89.0));
    let expected = (radius_mm - 15.0) / (2.0 * radius_mm);
    assert!((measured - expected).abs() < 1e-3, "{measured}, in closed form {expected}");
}

#[test]
fn cube_shows_whole_faces_or_none() {
    let cube = box_mesh([-30.0; 3], [30.0; 3]);
    let scanner = nominal_scanner();
    let params = limits(85.0, 77.5);
    for (from, faces) in [
        // The left camera also sees the face x = −30 and the right one x = 30: not both, so neither is measured.
        (Vector3::z(), 1.0),
        (Vector3::new(0.0, 1.0, 1.0), 2.0),
        (Vector3::new(1.0, 1.0, 1.0), 3.0),
        (Vector3::new(-1.0, 1.0, -1.0), 3.0),
    ] {
        let pose = Pose::from_parts(from.normalize() * 480.0, level(&from));
        let measured = share(&cube, pose, &scanner, &params);
        assert!((measured - faces / 6.0).abs() < 1e-9, "from {from:?}: {measured}");
    }
    // The corner view meets every face at 54.7° and, off its middle, up to 12° more: under 40° nothing is left.
    let corner = Vector3::new(1.0, 1.0, 1.0);
    let pose = Pose::from_parts(corner.normalize() * 480.0, level(&corner));
    assert_eq!(share(&cube, pose, &scanner, &limits(40.0, 40.0)), 0.0);
}

/// Looking back along `from` with the baseline level.
fn level(from: &Vector3<f64>) -> UnitQuaternion<f64> {
    let z = -from.normalize();
    let side = z.cross(&Vector3::z());
    let x = if side.norm() > 1e-9 { side.normalize() } else { Vector3::x() };
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&[x, z.cross(&x), z]))
}

#[test]
fn step_hides_a_strip_of_its_floor_from_one_camera() {
    let (width_mm, height_mm, half_length_mm, above_mm) = (60.0, 30.0, 25.0, 480.0);
    let part = step(width_mm, height_mm, half_length_mm);
    let scanner = nominal_scanner();
    let surface = sampled(&part, 150_000.0);
    let row = rows(&part, &surface, &[looking_down(above_mm)], &scanner, &limits(85.0, 77.5)).remove(0);
    let z_mm = |sample: &SampleId| surface.sample_mm[sample.index()].z;
    let up = |sample: &SampleId, z: f64| surface.patch_of(*sample).normal.z > 0.9 && (z_mm(sample) - z).abs() < 1e-9;
    let area =
        |z: f64| -> f64 { row.samples().filter(|sample| up(sample, z)).map(|sample| surface.sample_area_mm2(sample)).sum() };
    // Seen from above, +x of the scanner is +x of the part: the left camera stands over x = −101, and the line from it
    // past the step's edge meets the floor at height · 101 / (above − height). The others see the whole floor.
    let strip_mm = height_mm * 101.0 / (above_mm - height_mm);
    let floor_mm2 = (width_mm - strip_mm) * 2.0 * half_length_mm;
    assert!((area(0.0) - floor_mm2).abs() < 0.1 * 2.0 * half_length_mm, "{} against {floor_mm2}", area(0.0));
    assert!((area(height_mm) - 20.0 * 2.0 * half_length_mm).abs() < 1e-6, "the step's top is seen whole");
    let in_strip = |sample: &SampleId| surface.sample_mm[sample.index()].x < strip_mm - 1e-3;
    let hidden = surface.samples().filter(|sample| up(sample, 0.0) && in_strip(sample));
    assert!(hidden.clone().count() > 1000);
    assert!(hidden.into_iter().all(|sample| !row.holds(sample)), "the strip is hidden");
}

#[test]
fn rolled_by_a_quarter_the_scanner_sees_the_whole_floor_of_the_step() {
    let part = step(60.0, 30.0, 25.0);
    let surface = sampled(&part, 50_000.0);
    // Baseline along the step, 1 mm off its edge, so that the projector does not look along the wall.
    let rotation =
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI) * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI / 2.0);
    let pose = Pose::from_parts(Vector3::new(1.0, 0.0, 480.0), rotation);
    let row = rows(&part, &surface, &[pose], &nominal_scanner(), &limits(85.0, 77.5)).remove(0);
    let level = |sample: &SampleId| surface.sample_mm[sample.index()].z.abs() < 1e-9;
    let floor = |sample: &SampleId| surface.patch_of(*sample).normal.z > 0.9 && level(sample);
    let all = surface.samples().filter(floor).count();
    assert_eq!(row.samples().filter(floor).count(), all);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn cube_is_planned_whole_from_opposite_corners() {
    let cube = box_mesh([-30.0; 3], [30.0; 3]);
    let mut params = PlanParams::default();
    params.selection.target = 1.0;
    let plan = plan_viewpoints(&cube, &nominal_scanner(), &params).plan;
    assert!((plan.coverage.asked_area_mm2 - 6.0 * 3600.0).abs() < 1e-6);
    assert!((plan.coverage.of_asked() - 1.0).abs() < 1e-12, "{:?}", plan.coverage);
    // A view shows at most three faces.
    assert!((2..=3).contains(&plan.views.len()), "{} views", plan.views.len());
    assert!(plan.coverage.curve_area_mm2[0] <= 3.0 * 3600.0 + 1e-6);
}

#[test]
fn plan_has_the_same_bytes_on_any_number_of_threads() {
    let scanner = preset_scanner("transcan-c");
    let part = step(90.0, 45.0, 40.0);
    let bytes_on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let outcome = pool.install(|| plan_viewpoints(&part, &scanner, &limits(60.0, 55.0)));
        assert!(outcome.plan.views.len() > 2, "a plan with something to choose");
        PlanDocument::new(&outcome, &scanner, None, Echo::default()).to_bytes()
    };
    let one = bytes_on(1);
    for threads in [1, 2, 5] {
        assert!(bytes_on(threads) == one, "{threads} threads give another plan");
    }
}

#[test]
fn plan_has_the_same_bytes_whether_the_table_kept_quality() {
    let scanner = preset_scanner("transcan-c");
    let part = step(90.0, 45.0, 40.0);
    // A weight so small that it adds nothing to the area: the same choices, from a table with quality.
    let mut by_score = limits(60.0, 55.0);
    (by_score.score.a, by_score.score.b) = (1.0, 1e-300);
    by_score.selection.max_grade_loss = None;
    // Areas of all samples are such that sums of them are the same in either way.
    by_score.selection.samples = Some(40_000_000);
    let mut by_area = by_score.clone();
    by_area.selection.objective = Objective::Coverage;
    let bare = plan_viewpoints(&part, &scanner, &by_area);
    let mut full = plan_viewpoints(&part, &scanner, &by_score);
    assert!(
        bare.plan.views.len() > 2 && bare.plan.coverage.measured.grade_area_mm2.iter().filter(|area| **area > 0.0).count() > 1
    );
    assert_eq!(bare.measured_by_view, full.measured_by_view);
    full.plan.params = bare.plan.params.clone();
    // Without quality nothing is advised for grades.
    full.plan.advice.retain(|advice| advice.kind != AdviceKind::BetterGrades);
    let bytes = |outcome| PlanDocument::new(outcome, &scanner, None, Echo::default()).to_bytes();
    assert!(bytes(&bare) == bytes(&full), "another plan");
}

#[test]
fn moving_part_and_scanner_together_changes_nothing() {
    let part = step(60.0, 30.0, 25.0);
    let scanner = preset_scanner("transcan-c");
    let move_ = nalgebra::Isometry3::new(Vector3::new(300.0, -200.0, 77.0), Vector3::new(0.4, 1.1, -0.6));
    let moved = Mesh { vertices_mm: part.vertices_mm.iter().map(|v| move_ * v).collect(), ..part.clone() };
    let poses: Vec<_> = [Vector3::z(), Vector3::new(1.0, 1.0, 1.0), Vector3::new(0.5, -2.0, 0.8)]
        .map(|from| looking_at_origin(from, 480.0, 0.3))
        .to_vec();
    let moved_poses: Vec<_> = poses.iter().map(|pose| Pose::claim(move_ * pose.isometry())).collect();
    let surface = sampled(&part, 30_000.0);
    let moved_surface = Surface {
        patches: surface
            .patches
            .iter()
            .map(|patch| surface::Patch {
                normal: move_ * patch.normal,
                corners_mm: patch.corners_mm.map(|c| move_ * c),
                ..*patch
            })
            .collect(),
        sample_mm: surface.sample_mm.iter().map(|p: &Point3<f64>| move_ * p).collect(),
        ..surface.clone()
    };
    let params = limits(85.0, 77.5);
    let before = rows(&part, &surface, &poses, &scanner, &params);
    let after = rows(&moved, &moved_surface, &moved_poses, &scanner, &params);
    for (before, after) in before.iter().zip(&after) {
        assert!(before.count() > 1000);
        assert_eq!(before.measured(), after.measured());
    }
}
