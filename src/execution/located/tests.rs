use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use tokio::time::sleep;

use super::{LocateBounds, Locating, Misplaced, Relocate, Relocated};
use crate::cell::{Body, Cell, Shape};
use crate::execution::record::StepKind;
use crate::execution::session::{PauseCause, RunJob, RunOptions, RunReason, RunState, StopCause, simulate, simulate_with};
use crate::execution::tests::rehearsal::{Planned, hashes, job, planned, twins, until};
use crate::geometry::{Part, Pose, Table};
use crate::planning::params::PlanParams;
use crate::program::{Program, Step, interlock, scan_poses};
use crate::testing::box_mesh;

/// Flag of a search that nobody cancels.
static NEVER: AtomicBool = AtomicBool::new(false);

fn locating() -> Locating {
    let planned = planned();
    Locating {
        cell: Arc::clone(&planned.cell),
        part: Arc::clone(&planned.part),
        fixture: None,
        planned: planned.expected.clone(),
        clearance_mm: 5.0,
        bounds: LocateBounds::default(),
        coverage: Some((PlanParams::default(), String::new())),
    }
}

/// The operator was told to turn such a part by NaN°.
#[test]
fn a_part_that_lies_upside_down_has_a_turn_that_is_a_number() {
    let planned = off(0.0, 0.0, 0.0);
    for axis in [Vector3::x(), Vector3::y(), Vector3::new(0.6, 0.8, 0.0)] {
        let over = UnitQuaternion::from_scaled_axis(axis * std::f64::consts::PI);
        let located = Pose::claim(Isometry3::from_parts(Translation3::identity(), over) * planned.isometry());
        assert!(super::yaw(&located, &planned).abs() < 1e-6, "{axis:?}: {}", super::yaw(&located, &planned));
    }
    for deg in [-179.0, -90.0, 0.0, 45.0, 179.0] {
        let told_deg = super::yaw(&off(3.0, -2.0, deg), &planned).to_degrees();
        assert!((told_deg - deg).abs() < 1e-9, "{told_deg}° for {deg}°");
    }
}

/// The part turned about the plate's axis, then moved, from where it was planned.
fn off(x_mm: f64, y_mm: f64, deg: f64) -> Pose<Table, Part> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), deg.to_radians());
    Pose::claim(Isometry3::from_parts(Translation3::new(x_mm, y_mm, 0.0), turn) * planned().expected.table_from_part.isometry())
}

#[test]
fn a_part_three_degrees_and_eight_millimetres_off_is_scanned_where_it_lies() {
    let (locating, program) = (locating(), &planned().program);
    for located in [off(8.0, 0.0, 3.0), off(-5.0, 6.0, -3.0), off(0.0, 8.0, 0.0)] {
        let relocated = locating.relocate(program, &located, &NEVER).expect("within bounds");
        let poses = scan_poses(&relocated.program, &locating.cell, &located);
        let wanted = scan_poses(program, &locating.cell, &locating.planned.table_from_part);
        for (pose, wanted) in poses.iter().zip(wanted) {
            assert!((pose.origin_mm() - wanted.origin_mm()).norm() < 1e-6);
        }
        let [planned, measured] = relocated.coverage.expect("asked for");
        assert!((planned - measured).abs() < 0.005, "{planned} and {measured}");
        let kinds = |steps: &[Step]| steps.iter().map(std::mem::discriminant).collect::<Vec<_>>();
        assert_eq!(kinds(&relocated.program.steps), kinds(&program.steps), "step by step the same");
    }
}

#[test]
fn a_turn_about_the_plates_axis_is_the_tables_alone() {
    let relocated = locating().relocate(&planned().program, &off(0.0, 0.0, 4.0), &NEVER).expect("within bounds");
    let stations = crate::program::scan_configurations(&relocated.program);
    for (station, planned) in stations.iter().zip(crate::program::scan_configurations(&planned().program)) {
        assert!((station.table_rad - planned.table_rad + 4.0_f64.to_radians()).abs() < 1e-9);
        assert!(station.joints_rad.iter().zip(planned.joints_rad).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}

#[test]
fn a_part_too_far_off_is_said_how_to_put_right() {
    let refusal = |located| locating().relocate(&planned().program, &located, &NEVER).expect_err("too far").to_string();
    let words = refusal(off(30.0, 0.0, 0.0));
    assert!(words.contains("30.0 mm") && words.contains("move it 30.0 mm towards −x"), "{words}");
    let words = refusal(off(0.0, 0.0, 6.0));
    assert!(words.contains("6.0°") && words.contains("turn it 6.0° clockwise"), "{words}");
    let nowhere = locating().relocate(&planned().program, &off(f64::NAN, 0.0, 0.0), &NEVER);
    assert!(matches!(nowhere, Err(Misplaced::TooFar { .. })));
}

/// The part hangs down over the plate's rim, and a quarter turn away a wall of the table stands 5 mm beside its path.
#[test]
fn a_part_that_lies_where_it_runs_into_the_table_as_that_turns_is_refused() {
    let owner_from_body = Isometry3::translation(0.0, -265.0, -40.0);
    let wall = Body { name: "wall".into(), owner_from_body, shape: Shape::Box { size_mm: [40.0; 3] } };
    let cell = Arc::new(Cell { table_bodies: vec![wall], ..Cell::clone(&planned().cell) });
    let part = Arc::new(box_mesh([200.0, -10.0, -50.0], [240.0, 10.0, 50.0]));
    let locating = Locating { cell, part, coverage: None, ..locating() };
    let relocated = |located| locating.relocate(&planned().program, &located, &NEVER).map(|_| ());
    assert_eq!(relocated(off(0.0, 0.0, 0.0)), Ok(()));
    let words = relocated(off(8.0, 0.0, 0.0)).expect_err("into the wall").to_string();
    assert!(words.contains("wall and part meet") && words.contains("move it 8.0 mm towards −x"), "{words}");
}

#[test]
fn a_search_that_is_cancelled_ends_without_a_program() {
    let relocated = |cancelled: bool| {
        let flag = AtomicBool::new(cancelled);
        let locating = Locating { coverage: None, ..locating() };
        locating.relocate(&planned().program, &off(8.0, 0.0, 3.0), &flag).map(|_| ())
    };
    assert_eq!([relocated(false), relocated(true)], [Ok(()), Err(Misplaced::Cancelled)]);
}

/// A search that ends when it is cancelled and not before, and tells that it began and ended.
#[derive(Default)]
struct Endless {
    began: AtomicBool,
    ended: AtomicBool,
}

impl Relocate for Endless {
    fn relocate(&self, _: &Program, _: &Pose<Table, Part>, cancelled: &AtomicBool) -> Result<Relocated, Misplaced> {
        self.began.store(true, Ordering::Relaxed);
        while !cancelled.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.ended.store(true, Ordering::Relaxed);
        Err(Misplaced::Cancelled)
    }
}

/// The search went on for as long as it took, on a thread of its own.
#[tokio::test]
async fn a_run_that_is_stopped_cancels_the_search_for_its_program() {
    let search = Arc::new(Endless::default());
    let relocate = Arc::clone(&search);
    let handle = simulate(job(), RunOptions { time_factor: 20.0, relocate: Some(relocate), ..RunOptions::default() });
    until(&handle, RunState::Paused).await;
    handle.located(None, off(8.0, 0.0, 3.0)).await.expect("waits");
    let soon = |flag: fn(&Endless) -> &AtomicBool| {
        let search = Arc::clone(&search);
        async move {
            for _ in 0..2000 {
                if flag(&search).load(Ordering::Relaxed) {
                    return true;
                }
                sleep(Duration::from_millis(1)).await;
            }
            false
        }
    };
    assert!(soon(|search| &search.began).await);
    handle.stop(StopCause::Client);
    assert_eq!(handle.ended().await.status.state, RunState::Stopped);
    assert!(soon(|search| &search.ended).await);
}

#[tokio::test]
async fn a_run_locates_the_part_and_goes_on_or_stops() {
    for (located, ends) in [(off(8.0, 0.0, 3.0), RunState::Done), (off(30.0, 0.0, 0.0), RunState::Stopped)] {
        let options = RunOptions { time_factor: 20.0, relocate: Some(Arc::new(locating())), ..RunOptions::default() };
        let handle = simulate(job(), options);
        until(&handle, RunState::Paused).await;
        assert_eq!(handle.status().reason, RunReason::Paused(PauseCause::Locating));
        assert!(handle.resume(None).await.is_err(), "it waits for the pose");
        handle.located(None, located).await.expect("waits");
        let record = handle.ended().await;
        assert_eq!(record.status.state, ends, "{}", record.status.reason);
        assert_eq!(record.steps.iter().filter(|step| step.kind == StepKind::Locate).count(), 1);
        if ends == RunState::Done {
            assert_eq!((record.scans().count(), record.located), (3, Some(located)));
            let meant = scan_poses(&planned().program, &planned().cell, &planned().expected.table_from_part);
            for (taken, meant) in record.taken_views(&planned().cell, &located).iter().zip(meant) {
                assert!((taken.part_from_scanner.origin_mm() - meant.origin_mm()).norm() < 2.0);
            }
        } else {
            assert!(matches!(record.status.reason, RunReason::Ended(StopCause::Misplaced(_))));
        }
    }
}

/// Each has a controller of its own there, and two controllers do not keep in step.
#[tokio::test(start_paused = true)]
async fn arm_and_table_that_move_in_turn_do_so_to_the_first_station_of_the_part_where_it_lies() {
    let Planned { cell, scene, program, expected, .. } = planned();
    let program = interlock(program, cell, scene).expect("free");
    let job = RunJob::new(program, Arc::clone(cell), scene, Some(expected), [hashes(), hashes()]).expect("sound");
    let (machine, trigger, access) = twins();
    let relocate = Arc::new(Locating { coverage: None, ..locating() });
    let handle = simulate_with(job, machine, trigger, RunOptions { relocate: Some(relocate), ..RunOptions::default() });
    until(&handle, RunState::Paused).await;
    handle.located(None, off(8.0, 0.0, 3.0)).await.expect("waits");
    let (mut moved, mut turned) = (false, false);
    while handle.steps_from(0).iter().all(|step| step.kind != StepKind::Scan) {
        assert!(!handle.status().state.is_final(), "{}", handle.status().reason);
        let (moves, turns) = (access.arm.is_moving(), access.table.is_moving());
        assert!(!(moves && turns), "both at once");
        (moved, turned) = (moved || moves, turned || turns);
        sleep(Duration::from_millis(10)).await;
    }
    assert!(moved && turned);
}
