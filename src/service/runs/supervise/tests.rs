//! Ends of runs while the disk is full, and of the work for them.

use std::io::{Read as _, Write as _};
use std::time::Duration;

use nalgebra::Isometry3;

use super::super::{RunCursor, RunMessage};
use super::*;
use crate::cell::{CollisionScene, Presets, SpecLibrary};
use crate::execution::audit::{AuditLimits, verify};
use crate::execution::record::{DeviceStop, PoseDeviation};
use crate::execution::session::{Hashes, RunJob, RunOptions, RunReason, RunState, simulate};
use crate::geometry::Pose;
use crate::program::{Program, Step};
use crate::service::Options;
use crate::service::plan_job::PLAN_FILE;
use crate::service::planner::{Artifact, JobInput};
use crate::service::submit::Submission;
use crate::service::tests::{ended_job_in, no_steps, options, service, service_with};
use crate::testing::box_mesh;
use crate::wire::JobId;
use crate::wire::echo::Echo;
use crate::wire::program::ProgramDocument;
use crate::wire::run::{RunAudit, RunRequest, RunSelection};

async fn supervisor(app: &App) -> Supervisor {
    let program = no_steps();
    let run = Run::new(&RunRequest::new(JobId::generate()), None, "cell", &program, "");
    let open = app.0.runs.enter(run.id, &run.cell, run.mode).expect("free");
    let (run, _) = app.0.store.insert_run(&run, None, 1).await.expect("stored");
    Supervisor { app: app.clone(), run, open, stored: DoneSteps::default() }
}

#[tokio::test]
async fn an_end_is_stored_once_the_disk_has_room_and_a_run_is_deleted_on_what_is_kept_for_it() {
    let (app, folder) = service().await;
    let mut supervisor = supervisor(&app).await;
    let id = supervisor.run.id;
    app.0.store.fill_disk_at("UPDATE ON run WHEN NEW.state = 'failed'").await;
    supervisor.end_early((ReportedState::Failed, ReportedReason::NotAllowed, None)).await;
    let run = app.run(id).await.expect("it");
    assert_eq!((run.state, run.reason), (ReportedState::Failed, ReportedReason::NotAllowed));
    assert!(run.ended_at.is_some() && run.ended_at == supervisor.run.ended_at);
    std::fs::write(folder.path().join("reserve"), b"room").expect("a file");
    app.0.store.fill_disk_at("DELETE ON run").await;
    app.delete_run(id).await.expect("deleted");
}

/// A stop waits for no store: the session's next change tells as much.
#[tokio::test]
async fn a_change_before_the_end_is_not_tried_again() {
    let (app, _folder) = service().await;
    let mut supervisor = supervisor(&app).await;
    app.0.store.fill_disk_at("UPDATE ON run WHEN NEW.state = 'ready'").await;
    supervisor.run.state = ReportedState::Ready;
    supervisor.store(RunEventKind::State, &[]).await;
    assert_eq!(app.run(supervisor.run.id).await.expect("it").state, ReportedState::Preparing);
    supervisor.store(RunEventKind::State, &[]).await;
    assert_eq!(app.run(supervisor.run.id).await.expect("it").state, ReportedState::Ready);
}

/// A crash while the coverage was evaluated made a finished run look interrupted.
#[tokio::test]
async fn a_run_is_stored_as_done_before_its_coverage_is_evaluated() {
    let (app, _folder) = service().await;
    let mut supervisor = supervisor(&app).await;
    let id = supervisor.run.id;
    (supervisor.run.state, supervisor.run.reason) = (ReportedState::Done, ReportedReason::AllSteps);
    let coverage = RunCoverage { planned_of_asked: 0.75, measured_of_asked: 0.5 };
    let (of_evaluation, waiting) = (app.clone(), app.clone());
    let waiting = tokio::spawn(async move { waiting.run_when_ended(id, Duration::from_secs(60)).await });
    let evaluated = async move {
        let run = of_evaluation.run(id).await.expect("it");
        assert_eq!((run.state, run.coverage), (ReportedState::Done, None));
        // As the next process does: nothing is open any more.
        let stopped = of_evaluation.0.store.stop_open_runs("", &std::collections::BTreeMap::new()).await.expect("none");
        assert!(stopped.is_empty());
        Some(coverage)
    };
    supervisor.store_end(&[], evaluated).await;
    assert_eq!(app.run(id).await.expect("it").coverage, Some(coverage));
    drop(supervisor);
    let told = waiting.await.expect("no panic").expect("it");
    assert_eq!((told.state, told.coverage), (ReportedState::Done, Some(coverage)), "whoever waits for its end finds it");
}

/// Clients that listened while the recovery waited for room saw the run go on.
#[tokio::test]
async fn a_run_that_recovery_stops_is_told_to_whoever_listens() {
    let (app, _folder) = service().await;
    let run = Run::new(&RunRequest::new(JobId::generate()), None, "cell", &no_steps(), "");
    app.0.store.insert_run(&run, None, 1).await.expect("stored");
    let mut events = app.0.runs.subscribe();
    app.recover_runs().await.expect("recovered");
    let event = events.try_recv().expect("an event");
    assert_eq!((event.run_id, event.state), (run.id, ReportedState::Stopped));
}

#[tokio::test]
async fn work_that_nobody_waits_for_is_stopped() {
    let flag = FlagOf::new(CancellationToken::new());
    let raised = Arc::clone(&flag.0);
    assert!(!raised.load(Ordering::Relaxed));
    drop(flag);
    assert!(raised.load(Ordering::Relaxed));
}

#[tokio::test]
async fn an_end_after_the_store_was_read_is_told_to_who_follows_the_run() {
    let (app, _folder) = service().await;
    let mut supervisor = supervisor(&app).await;
    let id = supervisor.run.id;
    let mut first = app.run_events(id, None).await.expect("a stream");
    let Some(RunMessage::Event(_, at)) = first.next().await.expect("read") else { panic!("no event") };
    let mut stream = app.run_events(id, Some(at)).await.expect("a stream");
    supervisor.end_early((ReportedState::Stopped, ReportedReason::ByClient, None)).await;
    assert!(!stream.is_over(), "its last event was not told");
    let Some(RunMessage::Event(told, at)) = stream.next().await.expect("read") else { panic!("no event") };
    assert_eq!(told.state, ReportedState::Stopped);
    assert!(app.run_events(id, Some(at)).await.expect("a stream").is_over());
}

/// The answer was that everything had been seen, and the browser never learned of the end.
#[tokio::test]
async fn a_run_whose_end_was_pruned_is_told_to_be_read_anew_once() {
    let (app, _folder) = service().await;
    let mut supervisor = supervisor(&app).await;
    let id = supervisor.run.id;
    let mut first = app.run_events(id, None).await.expect("a stream");
    let Some(RunMessage::Event(_, begun)) = first.next().await.expect("read") else { panic!("no event") };
    supervisor.end_early((ReportedState::Stopped, ReportedReason::ByClient, None)).await;
    let mut kept = app.run_events(id, None).await.expect("a stream");
    assert!(!kept.has_gap() && !kept.is_over() && kept.only_gap().is_none());
    while kept.next().await.expect("read").is_some() {}
    // Times have milliseconds: the end has to lie in the past.
    tokio::time::sleep(Duration::from_millis(5)).await;
    app.0.store.prune_run_events(0).await.expect("pruned");
    let newest = RunCursor { event: app.0.store.newest_run_event().await.expect("a number"), sample: 0 };
    assert!(newest.event > begun.event);
    let of_another_database = RunCursor { event: newest.event + 7, sample: 3 };
    for after in [None, Some(begun), Some(of_another_database)] {
        let mut stream = app.run_events(id, after).await.expect("a stream");
        assert!(stream.has_gap() && !stream.is_over(), "{after:?}");
        assert_eq!(stream.only_gap(), Some(newest), "{after:?}");
        assert!(stream.next().await.expect("read").is_none(), "nothing follows");
    }
    let again = app.run_events(id, Some(newest)).await.expect("a stream");
    assert!(again.is_over() && !again.has_gap());
}

/// Events of other runs that were pruned are no gap in those of an open run, of which none is.
#[tokio::test]
async fn an_open_run_is_told_from_where_its_reader_was_without_a_gap() {
    let (app, _folder) = service().await;
    let mut ended = supervisor(&app).await;
    ended.end_early((ReportedState::Stopped, ReportedReason::ByClient, None)).await;
    tokio::time::sleep(Duration::from_millis(5)).await;
    app.0.store.prune_run_events(0).await.expect("pruned");
    let id = supervisor(&app).await.run.id;
    let mut stream = app.run_events(id, Some(RunCursor::default())).await.expect("a stream");
    assert!(!stream.has_gap() && stream.only_gap().is_none());
    assert!(matches!(stream.next().await.expect("read"), Some(RunMessage::Event(..))));
}

#[tokio::test]
async fn the_end_of_the_audit_log_is_kept_with_the_run() {
    let (app, folder) = service().await;
    let mut supervisor = supervisor(&app).await;
    let id = supervisor.run.id;
    let place = folder.path().join("log");
    let log = AuditLog::open(&place, AuditLimits::default()).expect("a log");
    log.mark("ready");
    supervisor.close_log(Some(log)).await;
    supervisor.end_early((ReportedState::Stopped, ReportedReason::ByClient, None)).await;
    let head = verify(&place).expect("whole");
    assert_eq!((head.lines, app.run(id).await.expect("it").audit), (2, Some(RunAudit::from(head))));
}

#[tokio::test]
async fn a_log_that_is_gone_is_not_taken_for_an_empty_one() {
    let (app, folder) = service().await;
    let simulated = supervisor(&app).await.run.clone();
    assert!(app.run_audit(simulated.id).await.expect("read").is_some());
    let read = Run { id: RunId::generate(), mode: RunMode::DryRun, ..simulated };
    app.0.store.insert_run(&read, None, 2).await.expect("stored");
    assert!(app.run_audit(read.id).await.expect("read").is_none());
    let place = folder.path().join("audit").join(read.id.to_string());
    AuditLog::open(&place, AuditLimits::default()).expect("a log").close().expect("kept");
    let mut text = String::new();
    app.run_audit(read.id).await.expect("read").expect("a log").read_to_string(&mut text).expect("text");
    assert_eq!(text.lines().count(), 1, "{text}");
}

#[tokio::test]
async fn no_run_begins_on_a_disk_that_is_nearly_full() {
    let folder = tempfile::tempdir().expect("a folder");
    let options = Options { min_free_bytes: u64::MAX, min_free_share: 1.0, ..options(folder.path()) };
    let planner = Arc::new(|_: &JobInput, _: &Context<'_>| Ok(Vec::new()));
    let app = App::open_with(options, planner, None).await.expect("a service");
    let refused = app.start_run(RunRequest::new(JobId::generate()), None, None).await;
    assert!(matches!(refused, Err(Error::StorageLow { .. })), "{refused:?}");
}

/// A second run began.
#[tokio::test]
async fn a_key_starts_one_run_however_often_it_comes() {
    let program = Program { plan_sha256: "0".repeat(64), ..no_steps() };
    let program = Artifact { name: "program.json".into(), bytes: ProgramDocument::new(&program, Echo::default()).to_bytes() };
    let (app, _folder) = service_with(vec![Artifact { name: PLAN_FILE.into(), bytes: b"{}".to_vec() }, program]).await;
    let request = RunRequest::new(ended_job_in(&app, "e05-transcan").await.id);
    let start = async |single_step: bool| {
        let submission = Submission { idempotency_key: Some("key".to_owned()), ..Submission::default() };
        app.submit_run(RunRequest { single_step, ..request.clone() }, None, submission).await
    };
    let (first, second) = tokio::join!(start(false), start(false));
    let first = first.expect("accepted");
    assert_eq!(second.expect("the same"), first);
    assert_eq!(start(false).await.expect("the same"), first);
    let refused = start(true).await;
    assert!(matches!(refused, Err(Error::IdempotencyMismatch)), "{refused:?}");
    assert_eq!(app.runs(&RunSelection::default(), 10, None).await.expect("a list").items.len(), 1);
}

/// The log of such a run was on the disk, and the run did not say so.
#[tokio::test]
async fn a_run_that_was_cut_off_is_linked_with_the_end_of_its_log() {
    let (app, folder) = service().await;
    let simulated = supervisor(&app).await.run.clone();
    let cut_off = Run { id: RunId::generate(), mode: RunMode::DryRun, state: ReportedState::Running, ..simulated.clone() };
    app.0.store.insert_run(&cut_off, None, 2).await.expect("stored");
    let place = folder.path().join("audit").join(cut_off.id.to_string());
    let log = AuditLog::open(&place, AuditLimits::default()).expect("a log");
    log.mark("running");
    let head = log.close().expect("kept");
    // Half a line, as a kill leaves it.
    let mut file = std::fs::OpenOptions::new().append(true).open(place.join("audit-00000001.log")).expect("its file");
    file.write_all(b"3 12 arm se").expect("written");
    app.recover_runs().await.expect("recovered");
    let run = app.run(cut_off.id).await.expect("it");
    assert_eq!((run.state, run.reason), (ReportedState::Stopped, ReportedReason::ServerRestarted));
    assert_eq!((head.lines, run.audit), (2, Some(RunAudit::from(head))));
    assert_eq!(app.run(simulated.id).await.expect("it").audit, None, "there is none");
}

fn completed(kind: StepKind) -> StepRecord {
    let home = no_steps().home_rad;
    StepRecord {
        step: 0,
        kind,
        view: None,
        commanded: home,
        measured: home,
        deviation: PoseDeviation::default(),
        planned_secs: 1.0,
        real_secs: 1.0,
        attempts: 1,
        capture_id: None,
        capture_took: None,
    }
}

/// The run said 0 beside the scans of its record.
#[tokio::test]
async fn the_scans_of_a_run_that_was_cut_off_are_counted_in_its_record() {
    let (app, _folder) = service().await;
    let mut supervisor = supervisor(&app).await;
    let id = supervisor.run.id;
    supervisor.run.state = ReportedState::Running;
    // As earlier releases stored them.
    let steps = [StepKind::Move, StepKind::Locate, StepKind::Scan, StepKind::Move, StepKind::Scan].map(completed);
    supervisor.store(RunEventKind::State, &steps).await;
    assert_eq!(app.run(id).await.expect("it").scans, 0);
    app.recover_runs().await.expect("recovered");
    let record = app.run_record(id).await.expect("it");
    assert_eq!((record.run.state, record.run.scans, record.steps.len()), (ReportedState::Stopped, 2, 5));
}

/// Each event copied and summed the whole record anew.
#[tokio::test]
async fn sums_over_the_steps_of_a_run_go_on_from_those_that_are_stored() {
    let (app, _folder) = service().await;
    let mut supervisor = supervisor(&app).await;
    supervisor.run.state = ReportedState::Running;
    supervisor.store(RunEventKind::Step, &[StepKind::Move, StepKind::Scan].map(completed)).await;
    assert_eq!(supervisor.stored, DoneSteps { count: 2, scans: 1, secs: 2.0 });
    let unstored = [StepKind::Scan].map(completed);
    assert_eq!(supervisor.stored.and(&unstored), DoneSteps { count: 3, scans: 2, secs: 3.0 });
    app.0.store.fill_disk_at("UPDATE ON run WHEN NEW.state = 'paused'").await;
    supervisor.run.state = ReportedState::Paused;
    supervisor.store(RunEventKind::Step, &unstored).await;
    assert_eq!(supervisor.stored.count, 2, "they are stored with the next event");
}

/// The last step alone would else take the cap off the speed of all.
#[test]
fn a_run_that_began_at_a_later_step_has_not_completed_the_program() {
    let ended = |mode: RunMode, from_step: usize, state: ReportedState| {
        let request = RunRequest { mode, from_step, ..RunRequest::new(JobId::generate()) };
        Run { state, ..Run::new(&request, None, "cell", &no_steps(), "") }
    };
    assert!(has_completed_program(&ended(RunMode::Live, 0, ReportedState::Done)));
    for (mode, from_step, state) in [
        (RunMode::Live, 1, ReportedState::Done),
        (RunMode::Live, 0, ReportedState::Stopped),
        (RunMode::Simulate, 0, ReportedState::Done),
        (RunMode::DryRun, 0, ReportedState::Done),
    ] {
        assert!(!has_completed_program(&ended(mode, from_step, state)), "{mode:?} from {from_step}, {state:?}");
    }
}

/// A run that stays armed until it is told to take its only step.
fn waiting() -> RunHandle {
    let cell = Arc::new(Presets.cell("e05-transcan").expect("preset").build(&Presets).expect("builds"));
    let part = box_mesh([-50.0, -50.0, 0.0], [50.0, 50.0, 100.0]);
    let scene = CollisionScene::new(&cell, &part, None, &Pose::claim(Isometry3::identity()), 5.0);
    let (robot, turntable, home_rad) = (cell.robot.name.clone(), cell.turntable.name.clone(), cell.home_rad);
    let (steps, cycle_secs) = (vec![Step::Settle { secs: 0.1 }; 2], 0.2);
    let program = Program { robot, turntable, home_rad, steps, cycle_secs, ..no_steps() };
    let hashes = Hashes { plan: program.plan_sha256.clone(), cell: String::new(), compensation: None };
    let job = RunJob::new(program, cell, &scene, None, [hashes.clone(), hashes]).expect("sound");
    simulate(job, RunOptions { single_step: true, ..RunOptions::default() })
}

/// A run that was taken up from the step that the store had, after a crash in the pause, scanned a view twice.
#[tokio::test]
async fn a_step_that_is_done_is_stored_with_the_next_one_before_the_pause_between_them_ends() {
    let (app, _folder) = service().await;
    let (mut supervisor, handle) = (supervisor(&app).await, waiting());
    let (id, followed) = (supervisor.run.id, handle.clone());
    let following = tokio::spawn(async move { supervisor.follow(&followed).await });
    let mut status = handle.watch_status();
    status.wait_for(|status| status.state == RunState::Armed).await.expect("it waits");
    handle.step(None).await.expect("armed");
    let is_paused = |run: &Run| run.state == ReportedState::Paused;
    let paused = app.run_when(id, Duration::from_secs(10), is_paused).await.expect("it");
    let done = app.run_record(id).await.expect("its record").steps.len();
    assert_eq!((paused.state, paused.step, done), (ReportedState::Paused, 1, 1));
    following.abort();
}

/// The state went back from that of the last event to those before it.
#[tokio::test]
async fn a_new_reader_is_told_no_sample_from_before_the_last_change_of_state() {
    let (app, _folder) = service().await;
    let (supervisor, handle) = (supervisor(&app).await, waiting());
    let mut status = handle.watch_status();
    status.wait_for(|status| status.state == RunState::Armed).await.expect("it waits");
    supervisor.open.session.send_replace(Some(handle.clone()));
    let before = RunCursor { event: 0, sample: 1 };
    for (after, state) in [(None, ReportedState::Armed), (Some(before), ReportedState::Preparing)] {
        let mut stream = app.run_events(supervisor.run.id, after).await.expect("a stream");
        let sample = loop {
            if let RunMessage::Sample(sample, _) = stream.next().await.expect("read").expect("a message") {
                break sample;
            }
        };
        assert_eq!(sample.state, state, "{after:?}");
    }
}

/// A run that is stopped was told as under way, without its stop, until both devices were at rest.
#[tokio::test]
async fn a_stop_is_stored_as_far_as_it_has_got_before_the_run_has_ended() {
    let (app, _folder) = service().await;
    let (mut supervisor, handle) = (supervisor(&app).await, waiting());
    let status = RunStatus { state: RunState::Running, reason: RunReason::Stopping(Some(StopCause::Client)) };
    let arm = DeviceStop { acknowledged: Some(Duration::from_millis(3)), ..DeviceStop::default() };
    for (arm, acknowledged_ms) in [(DeviceStop::default(), None), (arm, Some(3.0))] {
        let stop = Some([arm, DeviceStop::default()]);
        let event = LiveEvent { status: status.clone(), stop, ..handle.latest().expect("told") };
        assert!(!supervisor.hear(&handle, &event).await, "it has not ended");
        let run = app.run(supervisor.run.id).await.expect("it");
        assert_eq!((run.state, run.reason), (ReportedState::Running, ReportedReason::Stopping));
        let stop = run.stop.expect("a stop that was sent");
        assert_eq!(stop.arm.map(|arm| arm.acknowledged_ms), Some(acknowledged_ms));
    }
}

/// A disk that does not answer holds up the task, and whoever stops the server to stop the arm waits for no disk.
#[tokio::test]
async fn a_session_stops_with_the_service_whatever_its_task_waits_for() {
    let (app, _folder) = service().await;
    let (supervisor, handle) = (supervisor(&app).await, waiting());
    supervisor.open.session.send_replace(Some(handle.clone()));
    app.stop().await;
    let record = tokio::time::timeout(Duration::from_secs(5), handle.ended()).await.expect("it stops");
    assert_eq!(record.status.reason, RunReason::Ended(StopCause::ServerGone));
}
