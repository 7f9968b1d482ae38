use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};

use super::{Expected, Fault, Program, Step, check, compile};
use crate::cell::{Cell, CollisionScene, Configuration, Presets, SpecLibrary};
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
