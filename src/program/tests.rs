use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};

use super::{Expected, Fault, Program, ProgramCalibration, Step, check, check_calibration, compile};
use crate::cell::time_parameterisation::SmoothPath;
use crate::cell::{
    CalibrationProvenance, Cell, CollisionScene, CompensationProvenance, Configuration, PoseSpec, Presets, SpecLibrary,
    UseConditions,
};
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::context::{Context, Silent};
use crate::planning::params::PlanParams;
use crate::planning::plan::ViewId;
use crate::planning::sequence::order;
use crate::planning::stations::solve;
use crate::testing::box_mesh;

struct Job {
    cell: Cell,
    scene: CollisionScene,
    program: Program,
    expected: Expected,
}

fn view(polar: f64, azimuth: f64) -> Pose<Part, ScannerFrame> {
    let out = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
    let x = Vector3::new(-azimuth.sin(), azimuth.cos(), 0.0);
    let axes = Rotation3::from_basis_unchecked(&[x, (-out).cross(&x), -out]);
    Pose::from_parts(Vector3::new(0.0, 0.0, 50.0) + out * 520.0, UnitQuaternion::from_rotation_matrix(&axes))
}

/// Three views of a box, from their poses to the program.
fn job() -> Job {
    let cell = Presets.cell("e05-transcan").expect("preset").build(&Presets).expect("builds");
    let table_from_part = Pose::claim(Isometry3::identity());
    let part = box_mesh([-50.0, -50.0, 0.0], [50.0, 50.0, 100.0]);
    let scene = CollisionScene::new(&cell, &part, None, &table_from_part, 5.0);
    let poses = [view(0.4, 0.2), view(0.9, 2.0), view(1.1, 4.5)];
    let flag = AtomicBool::new(false);
    let ctx = Context::new(&flag, &Silent);
    let stations = solve(&poses, &cell, &scene, &table_from_part, &ctx).expect("not cancelled");
    let listed: Vec<_> =
        stations.iter().enumerate().map(|(i, found)| (ViewId::at(i), found.as_deref().expect("reached"))).collect();
    let params = PlanParams::default();
    let ordered = order(&listed, &cell, &scene, &params, None, false, &ctx).expect("not cancelled");
    let plan_sha256 = "ab".repeat(32);
    let program = compile(&ordered.sequence, 0, &cell, &plan_sha256, &params);
    let views = poses.into_iter().enumerate().map(|(i, pose)| (ViewId::at(i), pose)).collect();
    Job { cell, scene, program, expected: Expected { plan_sha256, table_from_part, table_alone: false, views } }
}

impl Job {
    fn faults(&self, program: &Program) -> Vec<Fault> {
        check(program, &self.cell, &self.scene, Some(&self.expected)).into_iter().map(|finding| finding.fault).collect()
    }

    /// The only kind of fault after a change.
    fn fault_after(&self, change: impl FnOnce(&mut Program)) -> Fault {
        let mut program = self.program.clone();
        change(&mut program);
        let faults = self.faults(&program);
        assert!(!faults.is_empty(), "the change goes unnoticed");
        faults.into_iter().next().expect("checked")
    }
}

fn first_move(program: &mut Program) -> &mut super::Move {
    let Step::Move(step) = &mut program.steps[0] else { panic!("a program begins with a move") };
    step
}

#[test]
fn a_compiled_program_is_sound_and_does_what_each_view_needs() {
    let job = job();
    assert_eq!(job.faults(&job.program), []);
    let kinds: String = job
        .program
        .steps
        .iter()
        .map(|step| match step {
            Step::Move(_) => 'm',
            Step::Settle { .. } => 's',
            Step::Scan { .. } => 'c',
        })
        .collect();
    assert_eq!(kinds, "mscmscmscm");
    let params = PlanParams::default();
    let standing = 3.0 * (params.scan.settle_secs + params.scan.capture_secs);
    let moving: f64 = job.program.steps.iter().filter(|s| matches!(s, Step::Move(_))).map(Step::secs).sum();
    assert!((job.program.cycle_secs - standing - moving).abs() < 1e-9 && moving > 1.0);
}

#[test]
fn a_program_is_refused_where_the_part_stands_in_the_housing_of_the_table() {
    let mut job = job();
    let sunk = box_mesh([-50.0, -50.0, -60.0], [50.0, 50.0, 100.0]);
    job.scene = CollisionScene::new(&job.cell, &sunk, None, &job.expected.table_from_part, 5.0);
    let faults = job.faults(&job.program);
    let [Fault::Placement { contact }] = &faults[..] else { panic!("{faults:?}") };
    assert_eq!(contact.to_string(), "turntable housing and part");
    let told = faults[0].to_string();
    // The same words for the board of calibration poses, which have no plan with a table_from_part.
    let wanted = "turntable housing and part meet wherever the arm is, as what is on the table lies (table_from_part of a plan, the \
                  board's size and height of calibration poses) or as the table turns; move it, or what it meets, and plan again";
    assert_eq!(told, wanted);
    job.scene = CollisionScene::without_part(&job.cell, 5.0);
    assert_eq!(job.faults(&job.program), [], "without the part it is not known where it lies");
}

#[test]
fn a_view_with_two_levels_is_captured_twice_at_one_pose() {
    let job = job();
    let Step::Scan { view, .. } = job.program.steps[2] else { panic!("third step scans") };
    let again = |brightness| Step::Scan { view, brightness, capture_secs: 1.0 };
    let mut twice = job.program.clone();
    twice.steps.insert(3, again(7));
    twice.cycle_secs += 1.0;
    assert_eq!(job.faults(&twice), [], "a brighter capture of the same pose");
    assert!(matches!(job.fault_after(|p| p.steps.insert(3, again(4))), Fault::Twice(v) if v == view.0), "levels ascend");
    let later = job.program.steps.len() - 1;
    assert!(matches!(job.fault_after(|p| p.steps.insert(later, again(7))), Fault::OffPose { .. } | Fault::Twice(_)));
}

#[test]
fn the_curve_that_passes_a_point_is_checked_beside_the_segments() {
    let job = job();
    let home = job.program.home_rad;
    let within_rad = 2_f64.to_radians();
    let near = |number: usize| {
        let share = |axis: usize| (number as f64 * [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0][axis].sqrt()).fract() - 0.5;
        Configuration::from_axes_rad(std::array::from_fn(|axis| home.axes_rad()[axis] + 2.0 * share(axis)))
    };
    let is_free = |ends: &[Configuration]| job.scene.check_segment(&ends[0], &ends[1]).is_none();
    let touches = |points: &[Configuration; 3]| {
        let curve = SmoothPath::through(points, within_rad);
        points.windows(2).all(is_free) && curve.bends().any(|bend| !bend.windows(2).all(is_free))
    };
    // A way around what blocks the straight one, its corner brought as near to that as is free.
    let around = |number: usize| {
        let [target, corner] = [near(2 * number), near(2 * number + 1)];
        let (middle, is_way) =
            (home.toward(&target, 0.5), |corner: &Configuration| [home, *corner, target].windows(2).all(is_free));
        if is_free(&[home, target]) || !is_way(&corner) {
            return None;
        }
        let (mut from, mut to) = (0.0, 1.0);
        for _ in 0..16 {
            let share = 0.5 * (from + to);
            if is_way(&corner.toward(&middle, share)) { from = share } else { to = share }
        }
        Some([home, corner.toward(&middle, from), target]).filter(touches)
    };
    let found = (1..4_000).find_map(around);
    let [_, corner, target] = found.expect("some corner is as near to a body as the curve leaves it");
    let passing = |passed_within_rad: Option<f64>| {
        let mut program = job.program.clone();
        let step = first_move(&mut program);
        (step.via_rad, step.target_rad, step.passed_within_rad) = (vec![corner], target, passed_within_rad);
        step.duration_secs = step.derived_secs(&home, &job.cell.axes());
        program.steps.truncate(1);
        job.faults(&program).into_iter().filter(|fault| matches!(fault, Fault::Collision { .. })).collect::<Vec<_>>()
    };
    assert_eq!(passing(None), [], "the segments are free");
    assert!(matches!(passing(Some(within_rad))[..], [Fault::Collision { segment: 0, .. }]));
}

/// Each segment moves the table or the arm; the curve that passes the point between them moves both, and went unnoticed.
#[test]
fn a_point_between_table_and_arm_that_is_passed_is_found_where_the_plan_turns_the_table_alone() {
    let mut job = job();
    let (home, axes) = (job.program.home_rad, job.cell.axes());
    let corner = Configuration { table_rad: home.table_rad + 0.2, ..home };
    let mut target = corner;
    target.joints_rad[0] += 0.1;
    let together = |job: &Job, passed_within_rad: Option<f64>| {
        let mut program = job.program.clone();
        let step = first_move(&mut program);
        (step.via_rad, step.target_rad, step.passed_within_rad) = (vec![corner], target, passed_within_rad);
        step.duration_secs = step.derived_secs(&home, &axes);
        program.steps.truncate(1);
        job.faults(&program).into_iter().filter(|fault| matches!(fault, Fault::Together { .. })).collect::<Vec<_>>()
    };
    assert_eq!(together(&job, Some(0.01)), [], "the plan lets them move together");
    job.expected.table_alone = true;
    assert_eq!(together(&job, None), [], "it stops between them");
    assert_eq!(together(&job, Some(0.01)), [Fault::Together { segment: 0 }]);
}

/// A run stops at every point; it was predicted to pass them.
#[test]
fn a_program_with_stops_takes_the_time_of_its_stops() {
    let job = job();
    let (home, axes) = (job.program.home_rad, job.cell.axes());
    assert_eq!(job.program.clone().with_stops(&axes), job.program, "it stops everywhere already");
    let mut passing = job.program.clone();
    let step = first_move(&mut passing);
    let (target, speed_fraction) = (step.target_rad, step.speed_fraction);
    let mut corner = home.toward(&target, 0.5);
    corner.joints_rad[0] += 0.2;
    (step.via_rad, step.passed_within_rad, step.duration_secs) = (vec![corner], Some(0.01), 0.1);
    let mut stopping = passing.clone().with_stops(&axes);
    assert!(passing.passes_points() && !stopping.passes_points());
    let stopping_secs = axes.path_secs(&[home, corner, target], speed_fraction);
    let secs: f64 = stopping.steps.iter().map(Step::secs).sum();
    assert!((stopping.cycle_secs - secs).abs() < 1e-9, "{secs} s");
    let step = first_move(&mut stopping);
    assert!(step.via_rad == [corner] && (step.duration_secs - stopping_secs).abs() < 1e-9, "{stopping_secs} s: {step:?}");
}

#[test]
fn each_fault_is_found_and_named() {
    let job = job();
    let turned = |by: f64, joint: usize| move |program: &mut Program| first_move(program).target_rad.joints_rad[joint] += by;
    assert!(matches!(job.fault_after(turned(10.0, 3)), Fault::OutsideLimits { axis: 4, .. }));
    assert!(matches!(job.fault_after(|p| first_move(p).duration_secs *= 0.9), Fault::Duration { .. }));
    assert!(matches!(job.fault_after(|p| first_move(p).speed_fraction = 1.5), Fault::SpeedFraction(_)));
    let into_table = Configuration { joints_rad: [0.0, -110.0, 60.0, 0.0, 0.0, 0.0].map(f64::to_radians), table_rad: 0.0 };
    let detour = |p: &mut Program| {
        let from = p.home_rad;
        let step = first_move(p);
        step.via_rad = vec![into_table];
        step.duration_secs = job.cell.axes().path_secs(&[from, into_table, step.target_rad], step.speed_fraction);
    };
    assert!(matches!(job.fault_after(detour), Fault::Collision { segment: 0, .. }));
    assert!(matches!(job.fault_after(|p| p.robot = "other".into()), Fault::OtherHardware { what: "robot", .. }));
    assert!(matches!(job.fault_after(|p| p.plan_sha256 = "cd".repeat(32)), Fault::OtherPlan { .. }));
    assert!(matches!(job.fault_after(|p| p.home_rad.table_rad = 0.1), Fault::OtherHome));
    assert!(matches!(job.fault_after(|p| p.cycle_secs += 1.0), Fault::CycleTime { .. }));
    assert!(matches!(job.fault_after(|p| p.cycle_secs = f64::NAN), Fault::CycleTime { .. }));
    assert!(matches!(job.fault_after(|p| p.steps.truncate(9)), Fault::NotHome));
    assert!(matches!(job.fault_after(|p| p.steps[1] = Step::Settle { secs: -1.0 }), Fault::Time(_)));
    let scan = |view, brightness| Step::Scan { view: ViewId(view), brightness, capture_secs: 1.0 };
    assert!(matches!(job.fault_after(|p| p.steps[2] = scan(9, 5)), Fault::UnknownView(9)));
    let Step::Scan { view, .. } = job.program.steps[2] else { panic!("third step scans") };
    assert!(matches!(job.fault_after(|p| p.steps[2] = scan(view.0, 10)), Fault::Brightness(10)));
    assert!(matches!(job.fault_after(|p| p.steps.insert(3, scan(view.0, 5))), Fault::Twice(v) if v == view.0));
    assert!(matches!(job.fault_after(|p| drop(p.steps.remove(2))), Fault::NeverScanned(v) if v == view.0));
}

/// The steps of a program without any took "-0.000000 s".
#[test]
fn the_steps_of_an_empty_program_take_no_time_and_not_minus_zero() {
    let job = job();
    let empty = Program { steps: Vec::new(), cycle_secs: 3.0, ..job.program.clone() };
    let told: Vec<String> = check(&empty, &job.cell, &job.scene, None).iter().map(ToString::to_string).collect();
    assert_eq!(told, ["/cycle_secs: is 3.000000; the steps take 0.000000 s"]);
}

/// A cell whose compensation is of another cell, out of bounds or too old, and a program of another calibration.
#[test]
fn calibrated_poses_that_may_not_be_used_are_found() {
    let mut job = job();
    let compensation = CompensationProvenance {
        cell: job.cell.name.clone(),
        calibration_id: "ab".repeat(32),
        at: "2026-11-23T06:00:00Z".into(),
        temperature_c: Some(22.0),
        flange_from_scanner: PoseSpec::from(&job.cell.flange_from_scanner),
        rotation_deg: 0.05,
        translation_mm: 0.4,
        max_rotation_deg: 1.0,
        max_translation_mm: 8.4,
        max_age_hours: 24.0,
        max_temperature_change_k: 5.0,
    };
    let calibrated = CalibrationProvenance {
        by: "vantage".into(),
        at: "2026-11-20T09:00:00Z".into(),
        calibration_id: "ab".repeat(32),
        data_sha256: "cd".repeat(32),
        rms_rotation_deg: 0.01,
        rms_translation_mm: 0.1,
        point_sd_mm: 0.05,
        rotation_sd_deg: 0.004,
        translation_sd_mm: 0.04,
        temperature_c: None,
        max_age_hours: None,
        max_temperature_change_k: None,
        compensation_sha256: Some("ef".repeat(32)),
        compensation: Some(compensation),
    };
    job.cell.calibrated = Some(calibrated.clone());
    assert!(matches!(job.faults(&job.program)[..], [Fault::OtherCalibration { program: None, .. }]));
    job.program.calibration = ProgramCalibration::of(&job.cell);
    assert_eq!(job.faults(&job.program), []);
    let spoilt = |change: fn(&mut CompensationProvenance)| {
        let mut known = calibrated.clone();
        known.compensation.iter_mut().for_each(change);
        let cell = Cell { calibrated: Some(known), ..job.cell.clone() };
        let found = check(&job.program, &cell, &job.scene, Some(&job.expected));
        assert_eq!(found.len(), 1, "{found:?}");
        found[0].to_string()
    };
    assert!(spoilt(|known| known.cell = "line-4".into()).contains("is of cell \"line-4\""));
    assert!(spoilt(|known| known.rotation_deg = 2.0).contains("allowed are 8.4 mm and 1°"));
    assert!(spoilt(|known| known.calibration_id = "00".repeat(32)).contains("corrects calibration"));
    // Age and temperature are held against a clock that the caller has.
    let at = |hours: f64, celsius: f64| {
        let compensation_age_hours = Some(hours);
        let conditions = UseConditions { compensation_age_hours, temperature_c: Some(celsius), ..UseConditions::default() };
        check_calibration(&job.cell, &conditions).len()
    };
    assert_eq!((at(23.9, 26.9), at(24.1, 26.9), at(23.9, 27.1), at(24.1, 27.1)), (0, 1, 1, 2));
}

#[test]
fn a_scan_off_its_pose_is_found_at_a_tenth_of_a_millimetre() {
    let job = job();
    let off_by = |angle: f64| {
        let mut program = job.program.clone();
        first_move(&mut program).target_rad.joints_rad[0] += angle;
        job.faults(&program).into_iter().any(|fault| matches!(fault, Fault::OffPose { .. }))
    };
    // About a metre from axis 1: 0.1 mm is near 1e-4 rad, 0.01° is 1.7e-4 rad.
    assert!(!off_by(1e-5));
    assert!(off_by(4e-4));
}

#[test]
fn a_part_that_is_not_where_it_was_planned_makes_scans_miss() {
    let mut job = job();
    job.expected.table_from_part = Pose::claim(Isometry3::translation(0.0, 0.0, 0.2));
    let missed = job.faults(&job.program).iter().filter(|fault| matches!(fault, Fault::OffPose { .. })).count();
    assert_eq!(missed, 3);
}

/// Nothing is near a pose that is none, and a comparison with it holds neither way.
#[test]
fn a_part_whose_pose_is_none_is_on_no_viewpoint() {
    let mut job = job();
    job.expected.table_from_part = PoseSpec { translation_mm: [0.0; 3], quaternion_xyzw: [0.0; 4] }.pose();
    let missed = job.faults(&job.program).iter().filter(|fault| matches!(fault, Fault::OffPose { .. })).count();
    assert_eq!(missed, 3);
    assert!(super::off_coverage(f64::NAN, 0.9).is_some() && super::off_coverage(0.9, 0.9).is_none());
}

/// A pass of points that the plan does not order was not held against it.
#[test]
fn points_passed_farther_off_than_the_plan_allows_are_found() {
    let job = job();
    let levels: BTreeMap<_, _> = job.expected.views.iter().map(|(view, _)| (*view, vec![5])).collect();
    let mut params = PlanParams::default();
    let mut program = job.program.clone();
    first_move(&mut program).passed_within_rad = Some(0.1_f64.to_radians());
    let found = |program: &Program, params: &PlanParams| program.check_orders(params, &levels);
    let stops = found(&program, &params);
    assert!(matches!(stops[..], [ref one] if matches!(one.fault, Fault::PassedWide { .. })), "{stops:?}");
    params.motion.corners = crate::planning::params::Corners::Round;
    params.motion.path_tolerance_deg = 0.1;
    assert_eq!(found(&program, &params), []);
    assert_eq!(found(&job.program, &params), [], "a stop is as good");
    first_move(&mut program).passed_within_rad = Some(0.2_f64.to_radians());
    let wide = found(&program, &params);
    assert!(matches!(wide[..], [ref one] if one.step == Some(0)), "{wide:?}");
}

/// Settling, time and brightness of captures and the speed were not held against the plan.
#[test]
fn what_the_plan_orders_besides_poses_is_found_where_it_is_not_kept() {
    let job = job();
    let Step::Scan { view: first, .. } = job.program.steps[2] else { panic!("third step scans") };
    let mut params = PlanParams::default();
    let mut levels: BTreeMap<_, _> = job.expected.views.iter().map(|(view, _)| (*view, vec![5])).collect();
    let found = |program: &Program, params: &PlanParams, levels: &BTreeMap<_, _>| program.check_orders(params, levels);
    assert_eq!(found(&job.program, &params, &levels), []);
    let after = |change: &dyn Fn(&mut Program)| {
        let mut program = job.program.clone();
        change(&mut program);
        found(&program, &params, &levels)
    };
    let scan = |brightness, capture_secs| Step::Scan { view: first, brightness, capture_secs };
    let unsettled = after(&|p| p.steps.retain(|step| !matches!(step, Step::Settle { .. })));
    assert_eq!(unsettled.len(), 3);
    assert!(matches!(unsettled[0].fault, Fault::Unsettled { view, .. } if view == first.0));
    assert!(matches!(after(&|p| p.steps[1] = Step::Settle { secs: 0.0 })[..], [ref one] if one.step == Some(2)));
    assert!(matches!(after(&|p| p.steps[2] = scan(5, 0.01))[..], [ref one] if matches!(one.fault, Fault::ShortCapture { .. })));
    assert!(
        matches!(after(&|p| first_move(p).speed_fraction = 1.0)[..], [ref one] if matches!(one.fault, Fault::TooFast { .. }))
    );
    let brighter = after(&|p| p.steps[2] = scan(9, 1.0));
    assert_eq!(brighter.len(), 1);
    assert_eq!(
        brighter[0].to_string(),
        format!("/steps/2: viewpoint {} is captured at brightness [9]; the plan has [5]", first.0)
    );
    let slower = |p: &mut Program| {
        first_move(p).speed_fraction = 0.1;
        (p.steps[1], p.steps[2]) = (Step::Settle { secs: 2.0 }, scan(5, 3.0));
    };
    assert_eq!(after(&slower), [], "slower and longer are as good");
    levels.insert(first, vec![5, 7]);
    let missing = found(&job.program, &params, &levels);
    assert!(matches!(missing[0].fault, Fault::OtherLevels { view, .. } if view == first.0), "the second capture is missing");
    let mut twice = job.program.clone();
    twice.steps.insert(3, scan(7, 1.0));
    assert_eq!(found(&twice, &params, &levels), []);
    params.scan.settle_secs = 0.0;
    twice.steps.remove(1);
    assert_eq!(found(&twice, &params, &levels), [], "nothing has to settle");
}
