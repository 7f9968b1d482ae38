//! A plan for a part on the table of the default cell: what must hold of every such plan.

use std::sync::atomic::AtomicBool;

use nalgebra::{Point3, Vector3};
use vantage::cell::{BodySpec, Cell, CollisionScene, PoseSpec, Presets, ShapeSpec, SpecLibrary};
use vantage::geometry::demo_parts::DemoPart;
use vantage::geometry::{Mesh, Part, Plate, Pose, ScannerFrame, Table, table_from_plate};
use vantage::planning::certificate::recheck;
use vantage::planning::context::{Context, NoPlan, Silent};
use vantage::planning::ids::SampleId;
use vantage::planning::params::{CandidateParams, Corners, Hemisphere, PlanParams, Region, Roll, SelectionGoal};
use vantage::planning::plan::{Advice, Cause, Outcome, Plan, PlannedView, StopReason, Verdict};
use vantage::planning::sequence::Sequence;
use vantage::planning::verdict::Rejection;
use vantage::planning::{PlanError, PlanInput, plan};
use vantage::program::dialects::{CheckedProgram, CheckedWith, Dialect, DialectError};
use vantage::program::{check, compile, off_coverage, scan_poses};
use vantage::wire::echo::Echo;
use vantage::wire::program::ProgramDocument;

use crate::support::box_mesh;

fn default_cell() -> Cell {
    Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset")
}

fn planned(mesh: &Mesh, fixture: Option<&Mesh>, cell: &Cell, params: &PlanParams) -> Result<Outcome, PlanError> {
    let cancel = AtomicBool::new(false);
    let input = PlanInput { mesh, fixture, part_sha256: "", scanner: &cell.scanner, cell: Some(cell), roadmaps: None };
    plan(&input, params, &Context::new(&cancel, &Silent))
}

fn quick() -> PlanParams {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    params.part.samples_per_mm2 = Some(0.3);
    params
}

fn missed_mm2(outcome: &Outcome, cause: Cause) -> f64 {
    outcome.plan.missed.iter().filter(|missed| missed.cause == cause).map(|missed| missed.area_mm2).sum()
}

#[test]
fn a_box_on_the_table_is_measured_but_for_the_face_it_stands_on() {
    let (cell, mesh) = (default_cell(), box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]));
    let outcome = planned(&mesh, None, &cell, &quick()).expect("a plan");
    let coverage = &outcome.plan.coverage;
    assert!((missed_mm2(&outcome, Cause::ExcludedResting) - 2400.0).abs() < 1e-6);
    for (visible_mm2, asked_mm2) in [
        (coverage.visible_area_mm2, coverage.asked_area_mm2),
        (coverage.independent.visible_area_mm2, coverage.independent.asked_area_mm2),
    ] {
        assert!((visible_mm2 - (asked_mm2 - 2400.0)).abs() < 1e-6, "all but the face it stands on: {visible_mm2} of {asked_mm2}");
    }
    assert!((coverage.asked_area_mm2 - 12_800.0).abs() < 1e-6);
    assert!((coverage.coverable_area_mm2 - 10_400.0).abs() < 1e-6, "all but the underside: {coverage:?}");
    assert!((coverage.measured.grade_area_mm2.iter().sum::<f64>() - coverage.measured.area_mm2).abs() < 1e-6);
    let missed: f64 = outcome.plan.missed.iter().map(|missed| missed.area_mm2).sum();
    assert!((coverage.measured.area_mm2 + missed - coverage.asked_area_mm2).abs() < 1e-6);
    assert!(coverage.curve_area_mm2.windows(2).all(|pair| pair[0] <= pair[1]));
    assert!(coverage.of_coverable() >= 0.985);
    let sequence = outcome.plan.setups[0].sequence.as_ref().expect("with a cell");
    let (moving_secs, lower_secs) = (sequence.motion_secs(), sequence.moving_lower_secs);
    assert!(0.0 < lower_secs && lower_secs <= moving_secs + 1e-9, "{lower_secs} s is a lower bound of {moving_secs} s");
}

#[test]
fn every_station_puts_the_scanner_where_the_view_wants_it() {
    let (cell, mesh) = (default_cell(), box_mesh([100.0, 50.0, -7.0], [160.0, 90.0, 33.0]));
    let outcome = planned(&mesh, None, &cell, &quick()).expect("a plan");
    let table_from_part: Pose<Table, Part> = outcome.plan.table_from_part.expect("a cell");
    let plate_from_part: Pose<Plate, Part> = Pose::claim(*table_from_part.isometry());
    assert!(!outcome.plan.views.is_empty());
    for view in &outcome.plan.views {
        let station = view.station.expect("every view has a station");
        let reached = cell.base_from_scanner(&station.joints_rad);
        let asked = cell.base_from_table * table_from_plate(station.table_angle_rad) * plate_from_part * view.part_from_scanner;
        assert!((reached.origin_mm() - asked.origin_mm()).norm() < 1e-6);
        for axis in [Vector3::x(), Vector3::z()] {
            assert!((reached.direction(&axis) - asked.direction(&axis)).norm() < 1e-9);
        }
    }
    let visited: Vec<_> = outcome.plan.visits().map(|(view, _)| *view).collect();
    let mut sorted = visited.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, outcome.plan.views.iter().map(|view| view.id).collect::<Vec<_>>());
}

#[test]
fn what_is_excluded_is_neither_asked_for_nor_missed() {
    let (cell, mesh) = (default_cell(), box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]));
    let mut params = quick();
    params.regions.exclude = vec![Region::HalfSpace { point_mm: [0.0, 0.0, 20.0], normal: [0.0, 0.0, 1.0] }];
    let outcome = planned(&mesh, None, &cell, &params).expect("a plan");
    let coverage = &outcome.plan.coverage;
    assert!((coverage.asked_area_mm2 / (12_800.0 / 2.0) - 1.0).abs() < 0.01, "{coverage:?}");
    assert_eq!(missed_mm2(&outcome, Cause::ExcludedResting), 0.0);
    assert!((coverage.total_area_mm2 - 12_800.0).abs() < 1e-6);
    params.regions.exclude = vec![Region::Box { min_mm: [-99.0; 3], max_mm: [99.0; 3] }];
    let refused = planned(&mesh, None, &cell, &params).expect_err("nothing is left");
    assert!(refused.to_string().starts_with("/regions/exclude: leaves nothing"), "{refused}");
}

#[test]
fn a_fixture_hides_what_lies_behind_it_and_is_not_measured() {
    let (cell, mesh) = (default_cell(), box_mesh([-20.0, -20.0, 0.0], [20.0, 20.0, 40.0]));
    // A wall 2 mm beside the right face, as high as the part: nothing can look in between.
    let wall = box_mesh([22.0, -30.0, 0.0], [30.0, 30.0, 40.0]);
    let outcome = planned(&mesh, Some(&wall), &cell, &quick()).expect("a plan");
    let coverage = &outcome.plan.coverage;
    assert!((coverage.total_area_mm2 - 9600.0).abs() < 1e-6, "the wall does not count");
    let open_mm2 = 9600.0 - 1600.0 - 1600.0;
    assert!((coverage.coverable_area_mm2 / open_mm2 - 1.0).abs() < 0.05, "{coverage:?}");
    let hidden_mm2: f64 =
        [Cause::ShadowLeft, Cause::ShadowRight, Cause::ShadowProjector].map(|c| missed_mm2(&outcome, c)).iter().sum();
    assert!(hidden_mm2 > 1200.0, "the wall hides {hidden_mm2} of 1600 mm²");
}

#[test]
fn a_part_beyond_the_arm_is_no_plan_with_reasons() {
    let (mut cell, mesh) = (default_cell(), box_mesh([-20.0, -20.0, 0.0], [20.0, 20.0, 40.0]));
    let away = cell.base_from_table.origin_mm() + Vector3::new(3000.0, 0.0, 0.0);
    cell.base_from_table = Pose::from_parts((away - Point3::origin()).cast(), nalgebra::UnitQuaternion::identity());
    let refused = planned(&mesh, None, &cell, &quick()).expect_err("out of reach");
    let PlanError::NoPlan(NoPlan::NothingMeasured { candidates, .. }) = refused else { panic!("{refused}") };
    assert_eq!((candidates.kept, candidates.rejected.get(&Rejection::Unreachable)), (0, Some(&33)));
}

#[test]
fn a_part_in_the_plate_above_it_or_beside_it_is_refused() {
    let (cell, mesh) = (default_cell(), box_mesh([-20.0, -20.0, 0.0], [20.0, 20.0, 40.0]));
    let refusal = |translation_mm: [f64; 3]| {
        let mut params = quick();
        params.part.table_from_part = Some(PoseSpec { translation_mm, ..PoseSpec::default() });
        planned(&mesh, None, &cell, &params).expect_err("refused").to_string()
    };
    assert!(refusal([0.0, 0.0, -15.0]).contains("/part/table_from_part: sinks the part 15.000 mm into the plate"));
    assert!(refusal([0.0, 0.0, 30.0]).contains("leaves the part 30.000 mm above the plate"));
    assert!(refusal([400.0, 0.0, 0.0]).contains("stands the part 400.0 mm from the table's axis"));
}

#[test]
fn the_plate_hides_the_underside_from_views_below_it() {
    let (cell, mesh) = (default_cell(), box_mesh([-20.0, -20.0, 0.0], [20.0, 20.0, 40.0]));
    let mut params = quick();
    params.candidates.hemisphere = Some(Hemisphere::Full);
    let coverage = planned(&mesh, None, &cell, &params).expect("a plan").plan.coverage;
    assert!((coverage.optically_coverable_area_mm2 - (9600.0 - 1600.0)).abs() < 1e-6, "{coverage:?}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn what_the_scans_of_a_program_measure_is_what_the_plan_says() {
    let (cell, mesh) = (default_cell(), box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]));
    let Outcome { plan, .. } = planned(&mesh, None, &cell, &quick()).expect("a plan");
    let input =
        PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(&cell), roadmaps: None };
    let lies = plan.table_from_part.expect("a cell");
    let program = compile(plan.sequences().next().expect("a sequence"), 0, &cell, &"00".repeat(32), &plan.params);
    let mut poses = scan_poses(&program, &cell, &lies);
    assert_eq!(poses.len(), plan.views.len());
    let cancel = AtomicBool::new(false);
    let ctx = Context::new(&cancel, &Silent);
    let share = |poses: &[_]| {
        let measured = recheck::measured(&input, &plan.params, &lies, poses, &ctx).expect("parameters of a plan");
        measured.measured_mm2 / measured.asked_mm2
    };
    assert_eq!(off_coverage(share(&poses), plan.coverage.of_asked()), None);
    poses.pop();
    assert!(off_coverage(share(&poses), plan.coverage.of_asked()).is_some(), "one scan less measures less");
}

#[test]
fn clearances_of_stations_are_not_that_of_two_bodies_that_never_move_apart() {
    let (cell, mesh) = (default_cell(), box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]));
    let plan = planned(&mesh, None, &cell, &quick()).expect("a plan").plan;
    let clearances_mm: Vec<f64> = plan.views.iter().filter_map(|view| view.stance?.clearance_mm).collect();
    println!("{clearances_mm:.3?} mm at {} stations", plan.views.len());
    // The adapter on the flange is 11 mm from the tip of the wrist in any posture.
    assert!(clearances_mm.iter().all(|mm| (mm - 11.0).abs() > 0.01), "{clearances_mm:?}");
    let [first, rest @ ..] = &clearances_mm[..] else { panic!("nothing within 200 mm anywhere") };
    assert!(rest.len() < 2 || rest.iter().any(|mm| (mm - first).abs() > 0.01), "one distance everywhere: {clearances_mm:?}");
}

/// A beam over the table, where the scanner would look down from.
fn beamed() -> Cell {
    let mut spec = Presets.cell("e05-transcan").expect("a preset");
    let table_mm = spec.base_from_table.translation_mm;
    spec.obstacles.push(BodySpec {
        name: "beam".into(),
        owner_from_body: PoseSpec { translation_mm: [table_mm[0], table_mm[1], table_mm[2] + 640.0], ..PoseSpec::default() },
        shape: ShapeSpec::Box { size_mm: [100.0, 600.0, 60.0] },
    });
    spec.build(&Presets).expect("a valid cell")
}

#[test]
#[ignore = "long: tests/all runs it"]
fn what_keeps_the_cell_from_views_is_named_with_where_how_deep_and_what_helps() {
    let (cell, mesh) = (beamed(), box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]));
    let outcome = planned(&mesh, None, &cell, &quick()).expect("a plan");
    let plan = &outcome.plan;
    let beam =
        plan.obstructions.iter().find(|found| [&found.bodies.a, &found.bodies.b].into_iter().any(|name| **name == *"beam"));
    let beam = beam.expect("the beam is in the way");
    assert!(beam.without_station > 0 && beam.advice == Advice::MoveObstacle("beam".into()), "{beam:?}");
    let separation = beam.separation.as_ref().expect("of a box it is known");
    assert!(separation.distance_mm < plan.params.motion.clearance_mm && separation.place_in_base_mm.z > 400.0, "{separation:?}");
    let scene = CollisionScene::new(&cell, &mesh, None, &plan.table_from_part.expect("a cell"), 5.0);
    assert_eq!(scene.check(&beam.configuration), Some(beam.bodies.clone()));
    let counted: usize = plan.obstructions.iter().map(|found| found.without_station).sum();
    let collided = plan.candidates.rejected.iter().find(|(reason, _)| reason.as_str() == "collision").map_or(0, |found| *found.1);
    assert_eq!(counted, collided, "every candidate that collides is put down to something");
    for stance in plan.views.iter().filter_map(|view| view.stance) {
        assert!(stance.clearance_mm.is_none_or(|mm| mm >= 5.0 - 1e-3), "{stance:?}");
    }
    assert!(planned(&mesh, None, &default_cell(), &quick()).expect("a plan").plan.obstructions.len() < plan.obstructions.len());
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_shortest_cycle_has_as_many_views_meets_the_target_and_moves_less() {
    let (cell, mesh) = (default_cell(), DemoPart::Figurine.mesh(20_000).expect("a part"));
    let mut params = PlanParams::default();
    params.part.samples_per_mm2 = Some(0.3);
    params.candidates.even_directions = Some(60);
    let fewest = planned(&mesh, None, &cell, &params).expect("a plan").plan;
    params.selection.goal = SelectionGoal::MinTime;
    let quickest = planned(&mesh, None, &cell, &params).expect("a plan").plan;
    let secs = |plan: &Plan| plan.sequences().map(Sequence::motion_secs).sum::<f64>();
    println!("{} views: {:.1} s moving, exchanged {:.1} s", fewest.views.len(), secs(&fewest), secs(&quickest));
    assert_eq!((quickest.views.len(), quickest.bound), (fewest.views.len(), fewest.bound));
    assert_eq!(quickest.stopped_because, StopReason::Target);
    assert!(quickest.coverage.of_coverable() >= params.selection.target - 1e-9);
    assert!(secs(&quickest) < 0.97 * secs(&fewest), "{} and {}", secs(&quickest), secs(&fewest));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn views_are_rolled_where_moves_are_shorter_then_and_no_less_is_measured() {
    let (cell, mesh) = (default_cell(), DemoPart::Figurine.mesh(20_000).expect("a part"));
    let mut params = PlanParams::default();
    params.part.samples_per_mm2 = Some(0.3);
    params.candidates.even_directions = Some(60);
    params.motion.roll = Roll::Fixed;
    let fixed = planned(&mesh, None, &cell, &params).expect("a plan").plan;
    params.motion.roll = Roll::Free;
    let free = planned(&mesh, None, &cell, &params).expect("a plan").plan;
    let secs = |plan: &Plan| plan.sequences().map(Sequence::motion_secs).sum::<f64>();
    let about_axis = |(a, b): (&PlannedView, &PlannedView)| {
        let turn = a.part_from_scanner.inverse() * b.part_from_scanner;
        assert!(turn.origin_mm().coords.norm() < 1e-6 && (turn.direction(&Vector3::z()).z - 1.0).abs() < 1e-12);
        turn.direction(&Vector3::x()).y.atan2(turn.direction(&Vector3::x()).x).to_degrees()
    };
    let rolls_deg: Vec<_> = fixed.views.iter().zip(&free.views).map(about_axis).collect();
    println!("{:.2} s moving, rolled {:.2} s, by {rolls_deg:.1?} degrees", secs(&fixed), secs(&free));
    assert!(secs(&free) < secs(&fixed) - 0.1 && rolls_deg.iter().any(|roll| roll.abs() > 1.0));
    assert!(free.coverage.measured.area_mm2 >= fixed.coverage.measured.area_mm2 - 1e-6);
    let [of_free, of_fixed] = [&free, &fixed].map(|plan| plan.coverage.measured.grade_area_mm2);
    for grades in 1..of_free.len() {
        let [rolled_mm2, fixed_mm2] = [of_free, of_fixed].map(|grade_mm2| grade_mm2[..grades].iter().sum::<f64>());
        assert!(rolled_mm2 >= fixed_mm2 - 1e-6, "best {grades} grades: {rolled_mm2} mm² rolled, {fixed_mm2} mm² not");
    }
    let program = compile(free.sequences().next().expect("a sequence"), 0, &cell, &"00".repeat(32), &free.params);
    let scene = CollisionScene::new(&cell, &mesh, None, &free.table_from_part.expect("a cell"), 5.0 - 0.01);
    assert_eq!(check(&program, &cell, &scene, None), []);
}

/// Posts beside the table, where the arm swings from one side to the other.
fn posted() -> Cell {
    let mut spec = Presets.cell("e05-transcan").expect("a preset");
    spec.obstacles.extend([330.0, -330.0].map(|y_mm| BodySpec {
        name: "post".into(),
        owner_from_body: PoseSpec { translation_mm: [300.0, y_mm, 210.0], ..PoseSpec::default() },
        shape: ShapeSpec::Cylinder { radius_mm: 40.0, height_mm: 900.0 },
    }));
    spec.build(&Presets).expect("a valid cell")
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_program_that_passes_corners_stays_sound_through_its_file_and_no_dialect_takes_it() {
    let (cell, mesh) = (posted(), DemoPart::Base.mesh(20_000).expect("a part"));
    let mut params = PlanParams::default();
    params.part.samples_per_mm2 = Some(0.3);
    params.candidates.even_directions = Some(40);
    let stopping = planned(&mesh, None, &cell, &params).expect("a plan").plan;
    params.motion.corners = Corners::Round;
    let plan = planned(&mesh, None, &cell, &params).expect("a plan").plan;
    let secs = |plan: &Plan| plan.sequences().map(Sequence::motion_secs).sum::<f64>();
    assert!(secs(&plan) < secs(&stopping), "{} and {}", secs(&plan), secs(&stopping));
    let program = compile(plan.sequences().next().expect("a sequence"), 0, &cell, &"00".repeat(32), &plan.params);
    let read: ProgramDocument =
        serde_json::from_slice(&ProgramDocument::new(&program, Echo::default()).to_bytes()).expect("its own document");
    let read = read.program().expect("in range");
    assert!(read.passes_points());
    let scene = CollisionScene::new(&cell, &mesh, None, &plan.table_from_part.expect("a cell"), 5.0 - 0.01);
    assert_eq!(check(&read, &cell, &scene, None), []);
    let checked = CheckedProgram::new(&read, &cell, &scene, None, CheckedWith::Part).expect("sound");
    assert_eq!(checked.render(Dialect::Csv, &params.dialects), Err(DialectError::Passing));
}

/// Looks along `axis` from a place in the part's frame, level where that is not straight down.
fn looking(origin_mm: [f64; 3], axis: [f64; 3]) -> PoseSpec {
    let axis = Vector3::from(axis).normalize();
    let x = axis.cross(&Vector3::z()).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    let axes = nalgebra::Rotation3::from_basis_unchecked(&[x, axis.cross(&x), axis]);
    let turn = nalgebra::UnitQuaternion::from_rotation_matrix(&axes);
    PoseSpec::from(&Pose::<Part, ScannerFrame>::from_parts(Vector3::from(origin_mm), turn))
}

fn rejected(outcome: &Outcome, reason: Rejection) -> usize {
    outcome.plan.candidates.rejected.get(&reason).copied().unwrap_or(0)
}

#[test]
fn views_at_which_the_housing_meets_plate_or_part_are_dropped_before_stations_are_sought() {
    let (cell, mesh) = (default_cell(), box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]));
    let plain = planned(&mesh, None, &cell, &quick()).expect("a plan");
    let mut params = quick();
    params.candidates.poses = vec![
        // 30 mm above the plate and over its rim: the housing reaches 65 mm below the viewpoint.
        looking([200.0, 0.0, 30.0], [-1.0, 0.0, 0.0]),
        // 2 mm above the part's top, with a clearance of 5 mm.
        looking([0.0, 0.0, 42.0], [0.0, 0.0, -1.0]),
        // Beside the plate, where nothing lies below the housing, and 6 mm above the top.
        looking([520.0, 0.0, 30.0], [-1.0, 0.0, 0.0]),
        looking([0.0, 0.0, 46.0], [0.0, 0.0, -1.0]),
        // 1 mm above the plate's plane.
        looking([520.0, 0.0, 1.0], [-1.0, 0.0, 0.0]),
    ];
    let outcome = planned(&mesh, None, &cell, &params).expect("a plan");
    let more = |reason| rejected(&outcome, reason) - rejected(&plain, reason);
    assert_eq!([Rejection::BodyMeetsPlate, Rejection::BodyMeetsPart, Rejection::LowElevation].map(more), [1, 1, 1]);
    let poses = |outcome: &Outcome| outcome.plan.views.iter().map(|view| view.part_from_scanner).collect::<Vec<_>>();
    assert!(poses(&outcome).iter().all(|pose| pose.origin_mm().z >= 5.0), "{:?}", poses(&outcome));
}

#[test]
fn what_only_a_view_with_the_housing_in_the_plate_would_measure_is_missed_for_collision() {
    let (cell, mesh) = (default_cell(), box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]));
    let mut params = quick();
    (params.limits.camera_deg, params.limits.projector_deg, params.missed.remedies) = (Some(35.0), Some(35.0), 0);
    // Near the rim, so that a level view of the wall at +x from 415 mm has its housing over the plate.
    params.part.table_from_part = Some(PoseSpec { translation_mm: [-220.0, 0.0, 0.0], ..PoseSpec::default() });
    params.candidates.strategies.clear();
    // From above at 30°, all around, where walls are seen at 60°; from straight above; and that level view.
    params.candidates.poses = (0..8)
        .map(|step| {
            let (sin, cos) = (std::f64::consts::FRAC_PI_4 * f64::from(step)).sin_cos();
            looking([240.0 * cos, 240.0 * sin, 40.0 + 415.7], [-0.5 * cos, -0.5 * sin, -0.866_025])
        })
        .chain([looking([0.0, 0.0, 40.0 + 480.0], [0.0, 0.0, -1.0])])
        .chain([looking([30.0 + 415.0, 0.0, 20.0], [-1.0, 0.0, 0.0])])
        .collect();
    let outcome = planned(&mesh, None, &cell, &params).expect("a plan");
    assert_eq!((rejected(&outcome, Rejection::BodyMeetsPlate), rejected(&outcome, Rejection::BodyMeetsPart)), (1, 0));
    let mut walls = [0_u32; 2];
    for (sample, verdict) in SampleId::number(&outcome.verdicts) {
        let towards_x = outcome.surface.patch_of(sample).normal.x;
        if towards_x > 0.5 {
            assert_eq!(*verdict, Verdict::Missed(Cause::Collision));
            walls[0] += 1;
        } else if towards_x < -0.5 {
            assert!(matches!(verdict, Verdict::Missed(cause) if *cause < Cause::Collision), "the other wall: {verdict:?}");
            walls[1] += 1;
        }
    }
    assert!(walls.iter().all(|samples| *samples > 100), "{walls:?}");
}
