use std::sync::Arc;
use std::time::Duration;

use nalgebra::Isometry3;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use super::watch::{LineEffect, RunWatch};
use crate::cell::{Cell, CollisionScene, Configuration, Presets, SpecLibrary};
use crate::execution::session::{
    Hashes, Pair, RunJob, RunOptions, RunReason, RunState, RunStatus, Safeguards, StopCause, simulate, simulate_with,
};
use crate::execution::twin::{Twin, TwinTrigger};
use crate::geometry::Pose;
use crate::planning::plan::ViewId;
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
    job_with(Vec::new())
}

/// A slow move away from home, these steps there, and a move back.
fn job_with(away_from_home: Vec<Step>) -> RunJob {
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
    let program = program(&cell, [vec![move_to(home, away)], away_from_home, vec![move_to(away, home)]].concat());
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
    let steps_by = Some((lines, LineEffect::StepsInTurn));
    std::thread::scope(|scope| {
        let paused = std::io::stderr().lock();
        let watch = RunWatch::new(handle.clone(), (job.program(), RunMode::Simulate), stop.clone(), None, steps_by);
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

/// Lines of a pipe were read while a step was under way, and lost; their end stopped the run in the middle of a step.
#[test]
fn each_line_of_a_pipe_takes_a_step_and_their_end_stops_the_run_between_two() {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("a runtime");
    for (given, state, steps) in [(2, RunState::Done, 2), (1, RunState::Stopped, 1), (0, RunState::Stopped, 0)] {
        let job = job();
        let (sender, lines) = mpsc::channel(2);
        (0..given).for_each(|_| sender.try_send(()).expect("room"));
        drop(sender);
        let record = runtime.block_on(async {
            let handle = simulate(job.clone(), RunOptions { single_step: true, time_factor: 10.0, ..RunOptions::default() });
            let steps_by = Some((lines, LineEffect::StepsInTurn));
            let mode = (job.program(), RunMode::Simulate);
            let watch = RunWatch::new(handle.clone(), mode, CancellationToken::new(), None, steps_by);
            tokio::time::timeout(Duration::from_secs(30), watch.until_the_end()).await.expect("it ends");
            handle.ended().await
        });
        assert_eq!((record.status.state, record.steps.len()), (state, steps), "{given} lines: {}", record.status.reason);
    }
}

/// The record said that a stop was requested, and nothing of the capture.
#[test]
fn a_run_that_nobody_can_resume_ends_with_the_capture_that_never_came() {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("a runtime");
    let scan = Step::Scan { view: ViewId(7), brightness: 5, capture_secs: 0.2 };
    let job = job_with(vec![Step::Settle { secs: 0.1 }, scan]);
    let (sender, lines) = mpsc::channel(1);
    drop(sender);
    let record = runtime.block_on(async {
        let home = job.program().home_rad;
        let machine = Pair { arm: Twin::at(home.joints_rad, 1.0), table: Twin::at([home.table_rad], 1.0) };
        let trigger = TwinTrigger::new(1.0);
        trigger.access().silence(true);
        // Longer than a busy machine takes.
        let (watchdog, state_max_age) = (Duration::from_secs(60), Duration::from_secs(10));
        let trigger_timeout = Duration::from_millis(50);
        let safeguards = Safeguards { watchdog, state_max_age, trigger_timeout, ..Safeguards::default() };
        let handle = simulate_with(job.clone(), machine, trigger, RunOptions { safeguards, ..RunOptions::default() });
        let (mode, stop) = ((job.program(), RunMode::Simulate), CancellationToken::new());
        let watch = RunWatch::new(handle.clone(), mode, stop, None, Some((lines, LineEffect::Resumes)));
        tokio::time::timeout(Duration::from_secs(30), watch.until_the_end()).await.expect("it ends");
        handle.ended().await
    });
    let RunStatus { state, reason } = &record.status;
    assert_eq!((*state, reason.code(), record.steps.len()), (RunState::Stopped, "trigger_silent", 2), "{reason}");
    let told = reason.to_string();
    assert!(told.starts_with("the capture of viewpoint 7 (step 2) was not acknowledged: "), "{told}");
    assert!(told.contains("; nobody could resume: ") && !told.contains("resume to take it again"), "{told}");
}

/// Whoever presses Enter twice wants one step.
#[test]
fn a_line_that_is_typed_while_a_step_is_under_way_starts_no_other() {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("a runtime");
    let (job, (sender, lines)) = (job(), mpsc::channel(2));
    let record = runtime.block_on(async {
        let handle = simulate(job.clone(), RunOptions { single_step: true, ..RunOptions::default() });
        let steps_by = Some((lines, LineEffect::StepsIfAwaited));
        let mode = (job.program(), RunMode::Simulate);
        let watch = RunWatch::new(handle.clone(), mode, CancellationToken::new(), None, steps_by);
        let typing = async {
            let mut status = handle.watch_status();
            status.wait_for(|status| status.state == RunState::Armed).await.expect("it waits");
            // The watch learns of it by an event.
            tokio::time::sleep(Duration::from_millis(200)).await;
            sender.send(()).await.expect("heard");
            status.wait_for(|status| status.state == RunState::Running).await.expect("it moves");
            sender.send(()).await.expect("heard");
            drop(sender);
        };
        let both = async { tokio::join!(watch.until_the_end(), typing) };
        tokio::time::timeout(Duration::from_secs(30), both).await.expect("it ends");
        handle.ended().await
    });
    assert_eq!((record.status.state, record.steps.len()), (RunState::Stopped, 1), "{}", record.status.reason);
}
