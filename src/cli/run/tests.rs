use std::sync::Arc;
use std::time::Duration;

use nalgebra::Isometry3;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use super::watch::RunWatch;
use crate::cell::{Cell, CollisionScene, Configuration, Presets, SpecLibrary};
use crate::execution::session::{Hashes, RunJob, RunOptions, RunReason, RunState, StopCause, simulate};
use crate::geometry::Pose;
use crate::program::{Move, Program, Step};
use crate::testing::box_mesh;
use crate::wire::run::RunMode;

/// A program of these steps for the hardware of a cell.
pub(super) fn program(cell: &Cell, steps: Vec<Step>) -> Program {
    Program {
        plan_sha256: "ab".repeat(32),
        setup: 0,
        calibration: None,
        robot: cell.robot.name.clone(),
        turntable: cell.turntable.name.clone(),
        home_rad: cell.home_rad,
        cycle_secs: steps.iter().map(Step::secs).sum(),
        steps,
    }
}

/// A slow move away from home and back.
fn job() -> RunJob {
    let cell = Arc::new(Presets.cell("e05-transcan").expect("preset").build(&Presets).expect("builds"));
    let part = box_mesh([-50.0, -50.0, 0.0], [50.0, 50.0, 100.0]);
    let scene = CollisionScene::new(&cell, &part, None, &Pose::claim(Isometry3::identity()), 5.0);
    let (home, axes) = (cell.home_rad, cell.axes());
    let away = Configuration { joints_rad: home.joints_rad.map(|joint| joint - 0.1), table_rad: home.table_rad };
    let move_to = |from: Configuration, target_rad: Configuration| {
        let mut step =
            Move { via_rad: Vec::new(), target_rad, speed_fraction: 0.05, duration_secs: 0.0, passed_within_rad: None };
        step.duration_secs = step.derived_secs(&from, &axes);
        Step::Move(step)
    };
    let program = program(&cell, vec![move_to(home, away), move_to(away, home)]);
    let hashes = Hashes { plan: program.plan_sha256.clone(), cell: "cd".repeat(32), compensation: None };
    RunJob::new(program, cell, &scene, None, [hashes.clone(), hashes]).expect("sound")
}

/// A paused terminal takes no bytes. The lock of standard error, held here, holds up the watch in the same way.
#[test]
fn a_signal_stops_the_run_while_its_progress_cannot_be_printed() {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("a runtime");
    let (job, stop) = (job(), CancellationToken::new());
    let handle = runtime.block_on(async { simulate(job.clone(), RunOptions::default()) });
    let (_typing, lines) = mpsc::channel(1);
    std::thread::scope(|scope| {
        let paused = std::io::stderr().lock();
        let watch = RunWatch::new(handle.clone(), (job.program(), RunMode::Simulate), stop.clone(), None, Some(lines));
        scope.spawn(|| runtime.block_on(watch.until_the_end()));
        let record = runtime.block_on(async {
            let mut status = handle.watch_status();
            status.wait_for(|status| status.state == RunState::Running).await.expect("it runs");
            stop.cancel();
            tokio::time::timeout(Duration::from_secs(10), handle.ended()).await.expect("it stops")
        });
        assert_eq!(record.status.state, RunState::Stopped);
        assert_eq!(record.status.reason, RunReason::Ended(StopCause::Client));
        drop(paused);
    });
}
