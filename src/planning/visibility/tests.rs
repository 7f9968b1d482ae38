use std::collections::BTreeSet;
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::view::SHADOWS;
use super::*;
use crate::cell::{Presets, SpecLibrary};
use crate::geometry::{Mesh, demo_parts};
use crate::planning::context::Silent;
use crate::planning::ids::SampleId;
use crate::planning::params::{FeatureParams, InterestParams, NoiseParams, PartParams, Region, RegionParams};
use crate::planning::surface::requirements::Requirements;
use crate::planning::surface::sample;
use crate::planning::verdict::Grade;
use crate::testing::{box_mesh, nominal_scanner};

/// A scanner above the origin that looks straight down from `height_mm`, its baseline along x.
fn looking_down(height_mm: f64) -> Pose<Part, ScannerFrame> {
    Pose::from_parts(Vector3::new(0.0, 0.0, height_mm), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI))
}

fn sampled(mesh: &Mesh, density: f64) -> Surface {
    let part = PartParams { patch_edge_mm: Some(20.0), samples_per_mm2: Some(density), ..PartParams::default() };
    sample(mesh, &part, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"))
}

fn table(mesh: &Mesh, surface: &Surface, poses: &[Pose<Part, ScannerFrame>], params: &PlanParams) -> VisibilityMatrix {
    table_by(&nominal_scanner(), mesh, surface, poses, params)
}

fn table_by(
    scanner: &Scanner,
    mesh: &Mesh,
    surface: &Surface,
    poses: &[Pose<Part, ScannerFrame>],
    params: &PlanParams,
) -> VisibilityMatrix {
    let (scene, flag) = (Occluders::new([mesh]), AtomicBool::new(false));
    cast(surface, poses, &vec![true; poses.len()], scanner, &scene, params, &Context::new(&flag, &Silent))
        .unwrap_or_else(|_| unreachable!())
}

fn top_area_mm2(surface: &Surface, row: &Row) -> f64 {
    let up = |sample: &SampleId| surface.patch_of(*sample).normal.z > 0.9;
    row.samples().filter(up).map(|sample| surface.sample_area_mm2(sample)).sum()
}

/// Area of a plate's top at depth `z_mm` that one view from above measures.
fn plate_area_mm2(z_mm: f64) -> f64 {
    let mesh = box_mesh([-200.0, -150.0, -5.0], [200.0, 150.0, 0.0]);
    let surface = sampled(&mesh, 1.0);
    top_area_mm2(&surface, &table(&mesh, &surface, &[looking_down(z_mm)], &PlanParams::default()).rows[0])
}

#[test]
fn a_plate_at_best_focus_is_measured_over_the_common_field() {
    // The field of the nominal rig at its best focus is 289 × 190 mm (`crate::planning::method::scanner`).
    let area_mm2 = plate_area_mm2(480.0);
    assert!((area_mm2 / (289.0 * 190.0) - 1.0).abs() < 0.01, "{area_mm2}");
}

#[test]
fn nothing_is_measured_outside_the_working_depth() {
    assert!(plate_area_mm2(410.5) > 0.0 && plate_area_mm2(564.5) > 0.0);
    assert_eq!((plate_area_mm2(409.5), plate_area_mm2(565.5)), (0.0, 0.0));
}

#[test]
fn quality_is_best_below_the_viewpoint_and_falls_with_depth() {
    let mesh = box_mesh([-0.5, -0.5, -5.0], [0.5, 0.5, 0.0]);
    let surface = sampled(&mesh, 50.0);
    let worst = |depth_mm: f64| {
        let row = table(&mesh, &surface, &[looking_down(depth_mm)], &PlanParams::default()).rows.remove(0);
        row.graded().map(|(_, quality)| f64::from(quality)).fold(f64::INFINITY, f64::min)
    };
    assert!((worst(480.0) - 1.0).abs() < 0.01);
    // D is 70 mm on the near side and 85 on the far side of F: half of it makes Q_dis 0, so 0.6 · 1 + 0.4 · 0.
    assert!((worst(445.0) - 0.6).abs() < 0.01);
    assert!((worst(522.5) - 0.6).abs() < 0.01);
}

#[test]
fn quality_falls_over_the_depth_that_the_devices_leave() {
    let mesh = box_mesh([-0.5, -0.5, -5.0], [0.5, 0.5, 0.0]);
    let surface = sampled(&mesh, 50.0);
    let mut spec = Presets.scanner("transcan-c-nominal").expect("a preset");
    spec.projector.in_focus_mm = Some([440.0, 520.0]);
    let scanner = spec.build().expect("valid");
    let worst = |depth_mm: f64| {
        let row = table_by(&scanner, &mesh, &surface, &[looking_down(depth_mm)], &PlanParams::default()).rows.remove(0);
        row.graded().map(|(_, quality)| f64::from(quality)).fold(f64::INFINITY, f64::min)
    };
    // D is 40 mm on both sides now, not 70 and 85: half of it makes Q_dis 0, so 0.6 · 1 + 0.4 · 0; the end −1, so 0.2.
    for (depth_mm, quality) in [(480.0, 1.0), (460.0, 0.6), (500.0, 0.6), (440.5, 0.21), (519.5, 0.21)] {
        assert!((worst(depth_mm) - quality).abs() < 0.01, "{depth_mm}: {}", worst(depth_mm));
    }
    assert!(worst(439.5).is_infinite() && worst(520.5).is_infinite());
}

/// Remedies are tried by points whose rays go in packets; the plan's own misses come from the engine.
#[test]
fn points_measured_in_packets_fail_at_the_step_that_the_engine_of_single_rays_gives() {
    let mesh = demo_parts::base(8_000).unwrap_or_else(|error| panic!("{error}"));
    let (surface, scanner, flag) = (sampled(&mesh, 1.0), nominal_scanner(), AtomicBool::new(false));
    let (scene, ctx, mut params) = (Occluders::new([&mesh]), Context::new(&flag, &Silent), PlanParams::default());
    params.visibility.engine = Engine::Rays;
    let optics = Optics::new(&scanner, &params, &surface.requirements);
    let tilted = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI - 0.5);
    let pose = Pose::from_parts(mesh.aabb().centre().coords - tilted * Vector3::z() * 480.0, tilted);
    let points: Vec<_> = surface.samples().map(|sample| surface.asked_point(sample)).collect();
    let in_packets = Probe::new(&optics, &pose, scene.rays(), ctx.simd_level()).measure(&points);
    let single = cast(&surface, &[pose], &[true], &scanner, &scene, &params, &ctx).unwrap_or_else(|_| unreachable!());
    let differing = |sample: &SampleId| match in_packets[sample.index()] {
        Ok(_) => !single.rows[0].holds(*sample),
        Err(cause) => single.rows[0].holds(*sample) || single.furthest_cause[sample.index()] != cause,
    };
    let shadowed =
        in_packets.iter().filter(|result| result.is_err_and(|cause| SHADOWS.into_iter().any(|shadow| shadow == cause)));
    assert!(shadowed.count() > 100 && single.rows[0].count() > 1000, "{} points", points.len());
    assert_eq!(surface.samples().filter(differing).count(), 0);
}

#[test]
fn a_step_hides_a_strip_from_the_camera_behind_it() {
    // A wall of height h at x = 0 hides from a device at (c, 480) above the floor the strip of width h·c/(480 − h)
    // beyond it. The left camera at −101 loses the strip right of the wall, the right camera at +101 that on its left.
    let (half_mm, wall_mm, depth_mm) = (40.0, 30.0, 480.0);
    let floor = box_mesh([-half_mm, -half_mm, -5.0], [half_mm, half_mm, 0.0]);
    let wall = box_mesh([-0.5, -half_mm, 0.0], [0.5, half_mm, wall_mm]);
    let both = Mesh {
        vertices_mm: floor.vertices_mm.iter().chain(&wall.vertices_mm).copied().collect(),
        faces: floor.faces.iter().copied().chain(wall.faces.iter().map(|face| face.map(|v| v + 8))).collect(),
        source_face: (0..24).collect(),
        groups: Vec::new(),
    };
    let surface = sampled(&both, 10.0);
    let row = table(&both, &surface, &[looking_down(depth_mm)], &PlanParams::default()).rows.remove(0);
    let on_floor = |sample: &SampleId| surface.sample_mm[sample.index()].z == 0.0;
    let area_mm2: f64 = row.samples().filter(on_floor).map(|sample| surface.sample_area_mm2(sample)).sum();
    let centre_mm = 101.0;
    let hidden_to_mm = 0.5 + (centre_mm + 0.5) * wall_mm / (depth_mm - wall_mm);
    let expected_mm2 = 2.0 * half_mm * 2.0 * (half_mm - hidden_to_mm);
    assert!((area_mm2 / expected_mm2 - 1.0).abs() < 0.01, "{area_mm2} against {expected_mm2}");
}

#[test]
fn the_furthest_view_names_the_cause() {
    let mesh = box_mesh([-20.0, -20.0, 0.0], [20.0, 20.0, 20.0]);
    let surface = sampled(&mesh, 1.0);
    let causes = |height_mm: f64, params: &PlanParams| {
        let table = table(&mesh, &surface, &[looking_down(height_mm)], params);
        let top = |sample: &SampleId| surface.patch_of(*sample).normal.z > 0.9;
        surface.samples().filter(top).map(|sample| table.furthest_cause[sample.index()]).collect::<BTreeSet<_>>()
    };
    let plain = PlanParams::default();
    assert_eq!(causes(300.0, &plain), BTreeSet::from([Cause::Depth]));
    assert_eq!(causes(-300.0, &plain), BTreeSet::from([Cause::Facing]));
    let mut strict = PlanParams::default();
    // At the middle the cameras see the face at 11.9°: no sample is within 11.7° of both.
    strict.limits.camera_deg = Some(11.7);
    assert_eq!(causes(500.0, &strict), BTreeSet::from([Cause::IncidenceLeft, Cause::IncidenceRight]));
}

#[test]
fn a_device_that_is_out_of_focus_fails_by_depth() {
    let mesh = box_mesh([-20.0, -20.0, 0.0], [20.0, 20.0, 20.0]);
    let surface = sampled(&mesh, 1.0);
    let mut scanner = nominal_scanner();
    // From the projector, at the scanner's origin; the practical depth is 410 to 565 mm.
    scanner.devices.projector.in_focus_mm = [450.0, 520.0];
    let top = |sample: &SampleId| surface.patch_of(*sample).normal.z > 0.9;
    let count = surface.samples().filter(top).count();
    for (height_mm, in_focus) in [(460.0, false), (480.0, true), (530.0, true), (550.0, false)] {
        let limited = table_by(&scanner, &mesh, &surface, &[looking_down(height_mm)], &PlanParams::default());
        let free = table(&mesh, &surface, &[looking_down(height_mm)], &PlanParams::default());
        let measured = |table: &VisibilityMatrix| table.rows[0].samples().filter(top).count();
        assert_eq!(measured(&free), count, "at {height_mm} mm");
        assert_eq!(measured(&limited), if in_focus { count } else { 0 }, "at {height_mm} mm");
        if !in_focus {
            let causes: BTreeSet<Cause> =
                surface.samples().filter(top).map(|sample| limited.furthest_cause[sample.index()]).collect();
            assert_eq!(causes, BTreeSet::from([Cause::Depth]), "at {height_mm} mm");
        }
    }
}

#[test]
fn moving_part_and_scanner_together_changes_nothing() {
    let mesh = box_mesh([-20.0, -30.0, 0.0], [20.0, 30.0, 25.0]);
    let motion = Isometry3::from_parts(Translation3::new(310.0, -77.0, 12.5), UnitQuaternion::from_euler_angles(0.4, -1.1, 2.3));
    let moved = Mesh { vertices_mm: mesh.vertices_mm.iter().map(|p| motion * p).collect(), ..mesh.clone() };
    let still = looking_down(510.0);
    let pose = Pose::claim(motion * still.isometry());
    let params = PlanParams::default();
    let here = sampled(&mesh, 1.0);
    let mut there = here.clone();
    there.sample_mm.iter_mut().for_each(|p| *p = motion * *p);
    there.patches.iter_mut().for_each(|patch| patch.normal = motion * patch.normal);
    let rows = [table(&mesh, &here, &[still], &params).rows.remove(0), table(&moved, &there, &[pose], &params).rows.remove(0)];
    assert!(rows[0].count() > 1000);
    assert_eq!(rows[0].measured(), rows[1].measured());
    // One step of quality.
    assert!(rows[0].graded().zip(rows[1].graded()).all(|((_, a), (_, b))| (a - b).abs() < 4e-5));
}

#[test]
fn what_the_table_leaves_out_is_computed_for_the_chosen() {
    let mesh = box_mesh([-20.0, -30.0, 0.0], [20.0, 30.0, 25.0]);
    let surface = sampled(&mesh, 1.0);
    let poses = [looking_down(510.0), looking_down(470.0)];
    let by_score = PlanParams::default();
    let (mut by_area, mut without_weight) = (by_score.clone(), by_score.clone());
    by_area.selection.objective = Objective::Coverage;
    without_weight.score.b = 0.0;
    let full = table(&mesh, &surface, &poses, &by_score);
    assert!(full.rows.iter().all(|row| row.quality().is_some() && row.count() > 1000));
    for params in [by_area, without_weight] {
        let bare = table(&mesh, &surface, &poses, &params);
        assert_eq!(bare.furthest_cause, full.furthest_cause);
        for ((pose, bare), full) in poses.iter().zip(&bare.rows).zip(&full.rows) {
            assert_eq!((bare.measured(), bare.quality()), (full.measured(), None));
            assert_eq!(&grade(&surface, pose, &nominal_scanner(), &params, bare), full);
        }
    }
}

#[test]
fn cancelling_ends_it() {
    let mesh = box_mesh([-20.0; 3], [20.0; 3]);
    let (surface, scene, flag) = (sampled(&mesh, 1.0), Occluders::new([&mesh]), AtomicBool::new(true));
    let poses = [looking_down(500.0)];
    let result = cast(
        &surface,
        &poses,
        &vec![true; poses.len()],
        &nominal_scanner(),
        &scene,
        &PlanParams::default(),
        &Context::new(&flag, &Silent),
    );
    assert!(result.is_err());
}

/// Measured area of a plate at best focus, straight below, with what `features` and `interest` ask everywhere, by each engine.
fn plate_area_held_mm2(change: impl Fn(&mut PlanParams)) -> f64 {
    plate_area_held_by_mm2(&nominal_scanner(), change)
}

fn plate_area_held_by_mm2(scanner: &Scanner, change: impl Fn(&mut PlanParams)) -> f64 {
    let mesh = box_mesh([-150.0, -100.0, -5.0], [150.0, 100.0, 0.0]);
    let mut params = PlanParams::default();
    change(&mut params);
    let mut surface = sampled(&mesh, 1.0);
    surface.requirements = Requirements::new(&mesh, &surface, &params).unwrap_or_else(|errors| panic!("{errors:?}"));
    let [area_mm2, reference_mm2] = [Engine::Raster, Engine::Rays].map(|engine| {
        params.visibility.engine = engine;
        top_area_mm2(&surface, &table_by(scanner, &mesh, &surface, &[looking_down(480.0)], &params).rows[0])
    });
    assert!((area_mm2 - reference_mm2).abs() < 1e-9, "{area_mm2} by depth maps, {reference_mm2} by rays");
    area_mm2
}

fn everywhere() -> Region {
    Region::Box { min_mm: [-1e3; 3], max_mm: [1e3; 3] }
}

/// Straight below the viewpoint the noise is least, and σ_F · r / F where r is the distance: a limit leaves a disc.
#[test]
fn a_limit_of_noise_or_spacing_leaves_a_disc() {
    const RADIUS_MM: f64 = 60.0;
    let cos = 480.0 / 480.0_f64.hypot(RADIUS_MM);
    let disc_mm2 = std::f64::consts::PI * RADIUS_MM * RADIUS_MM;
    let feature = |tolerance_mm, point_spacing_mm| FeatureParams {
        name: None,
        region: everywhere(),
        tolerance_mm,
        point_spacing_mm,
        target: None,
    };
    let noise = NoiseParams::default();
    let tolerance_mm = 4.0 * noise.best_mm / cos / noise.budget;
    let by_noise_mm2 = plate_area_held_mm2(|params| params.regions.features = vec![feature(tolerance_mm, None)]);
    assert!((by_noise_mm2 / disc_mm2 - 1.0).abs() < 0.02, "{by_noise_mm2} of {disc_mm2}");
    // The nominal rig's cameras have 6668 px.
    let by_spacing_mm2 =
        plate_area_held_mm2(|params| params.regions.features = vec![feature(10.0, Some(480.0 / (6668.0 * cos)))]);
    assert!((by_spacing_mm2 / disc_mm2 - 1.0).abs() < 0.02, "{by_spacing_mm2} of {disc_mm2}");
}

/// The left camera stands at x = −101: within 30° of it lies a disc of radius 480 · tan 30° around that point, cut by the
/// right camera's.
#[test]
fn a_region_s_own_limit_of_incidence_replaces_the_job_s() {
    let radius_mm = 480.0 * 15.0_f64.to_radians().tan();
    let half_mm = 101.0_f64;
    let lens_mm2 = 2.0 * radius_mm * radius_mm * (half_mm / radius_mm).acos()
        - 2.0 * half_mm * (radius_mm * radius_mm - half_mm * half_mm).sqrt();
    let interest = |deg| InterestParams {
        name: None,
        region: everywhere(),
        weight: 1.0,
        target: None,
        camera_deg: Some(deg),
        projector_deg: None,
        min_grade: None,
    };
    let own_mm2 = plate_area_held_mm2(|params| params.regions.interest = vec![interest(15.0)]);
    assert!((own_mm2 / lens_mm2 - 1.0).abs() < 0.03, "{own_mm2} of {lens_mm2}");
    // Also where the job's own limit is the stricter one.
    let looser_mm2 = plate_area_held_mm2(|params| {
        params.limits.camera_deg = Some(5.0);
        params.regions.interest = vec![interest(15.0)];
    });
    assert_eq!(looser_mm2, own_mm2);
}

#[test]
fn a_least_grade_leaves_what_is_measured_so_well() {
    let mut areas = [Grade::D, Grade::C, Grade::B, Grade::A]
        .map(|grade| plate_area_held_mm2(|params| params.selection.min_grade = Some(grade)));
    let whole_mm2 = plate_area_held_mm2(|_| ());
    assert_eq!(areas[0], whole_mm2);
    areas.windows(2).for_each(|pair| assert!(pair[0] >= pair[1], "{areas:?}"));
    // Q = c (1 − 2δ/δ_max) + d at best focus is above 0.5 within δ = δ_max (1 − 0.1 / 0.6) / 2 of the viewpoint's axis.
    let mut scanner = nominal_scanner();
    scanner.devices.projector.incidence_max_rad = 30.0_f64.to_radians();
    areas[3] = plate_area_held_by_mm2(&scanner, |params| {
        params.selection.min_grade = Some(Grade::A);
        params.limits.camera_deg = Some(80.0);
    });
    let radius_mm = 480.0 * (30.0_f64 * (1.0 - 0.1 / 0.6) / 2.0).to_radians().tan();
    let in_frame_mm2 = areas[3] / (std::f64::consts::PI * radius_mm * radius_mm);
    assert!(in_frame_mm2 > 0.9 && in_frame_mm2 < 1.01, "{in_frame_mm2}");
}

#[test]
fn grades_of_two_jobs_mean_the_same() {
    let mesh = box_mesh([-150.0, -100.0, -5.0], [150.0, 100.0, 0.0]);
    let surface = sampled(&mesh, 0.05);
    let mut tight = PlanParams::default();
    tight.limits.projector_deg = Some(12.0);
    for engine in [Engine::Raster, Engine::Rays] {
        tight.visibility.engine = engine;
        let mut wide = tight.clone();
        wide.limits.projector_deg = None;
        let [wide, tight] = [wide, tight.clone()]
            .map(|params| table(&mesh, &surface, &[looking_down(480.0)], &params).rows.remove(0).graded().collect::<Vec<_>>());
        assert!(tight.len() > 500 && tight.len() < wide.len(), "{} of {}", tight.len(), wide.len());
        assert!(tight.iter().all(|graded| wide.contains(graded)), "the job's limit changes what is measured, not how well");
    }
}

#[test]
fn no_limit_of_job_or_region_goes_beyond_a_device_s_own() {
    let mut scanner = nominal_scanner();
    scanner.devices.right.incidence_max_rad = 15.0_f64.to_radians();
    let own_mm2 = plate_area_held_by_mm2(&scanner, |_| ());
    assert_eq!(plate_area_held_by_mm2(&scanner, |params| params.limits.camera_deg = Some(80.0)), own_mm2);
    let region = |params: &mut PlanParams| {
        params.regions.interest = vec![InterestParams {
            name: None,
            region: everywhere(),
            weight: 1.0,
            target: None,
            camera_deg: Some(80.0),
            projector_deg: None,
            min_grade: None,
        }];
    };
    assert_eq!(plate_area_held_by_mm2(&scanner, region), own_mm2);
    assert!(own_mm2 < 0.7 * plate_area_held_mm2(|_| ()), "the right camera alone sees less");
}
