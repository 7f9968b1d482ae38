//! Outcomes that cannot be stored, and jobs that an earlier process left on a full disk.

use std::time::Duration;

use sqlx::{Connection as _, SqliteConnection};

use super::*;
use crate::cell::FieldError;
use crate::planning::context::Context;
use crate::service::plan_job::REFUSED_FILE;
use crate::service::planner::JobInput;
use crate::service::tests::{ended_job, job, keep_no_reserve, options, service, service_below_the_floor, service_with};
use crate::wire::run::RunRequest;
use crate::wire::warnings::WarningCode;
use crate::wire::{EventKind, ReadinessSubject};

/// A job that runs: the dispatcher, with one job at a time, starts none beside it.
async fn running(app: &App) -> JobId {
    app.0.runner.schedule().seat(JobId::generate(), Share::Pool, None);
    let id = job(app).await;
    app.0.store.claim(&id.to_string()).await.expect("the queue").expect("the job");
    id
}

/// Names of results are unique, so that these cannot be stored.
#[tokio::test]
async fn a_job_whose_results_cannot_be_stored_fails_with_the_reason() {
    let twice = ["plan.json"; 2].map(|name| Artifact { name: name.into(), bytes: b"{}".to_vec() });
    let (app, _folder) = service_with(twice.into()).await;
    let ended = ended_job(&app).await;
    assert_eq!((ended.state, ended.problem.expect("the reason").code.as_str()), (JobState::Failed, "internal"));
}

#[tokio::test]
async fn an_outcome_is_recorded_once_the_disk_has_room() {
    let (app, _folder) = service().await;
    let id = running(&app).await;
    app.0.store.fill_disk_at("UPDATE ON job WHEN NEW.state = 'cancelled'").await;
    let recorded = app.record_outcome(id, AttemptOutcome::Cancelled, &BTreeMap::new()).await;
    assert_eq!((recorded, app.job_state(id).await.expect("it")), (Some(JobState::Cancelled), JobState::Cancelled));
}

/// Such a job said that it was running, and nothing else, however long the disk was full.
#[tokio::test]
async fn a_job_whose_results_wait_for_room_says_so() {
    let (app, _folder) = service().await;
    let id = running(&app).await;
    let is_told = async || {
        let warnings = app.job(id).await.expect("it").warnings;
        warnings.iter().any(|warning| warning.code == WarningCode::ResultsWait)
    };
    assert!(!is_told().await, "nothing waits yet");
    app.0.store.fill_disk_at("UPDATE ON job WHEN NEW.state = 'cancelled'").await;
    let told = async {
        while !is_told().await {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    let timings = BTreeMap::new();
    let recorded = app.record_outcome(id, AttemptOutcome::Cancelled, &timings);
    let (recorded, told) = tokio::join!(recorded, tokio::time::timeout(Duration::from_secs(10), told));
    assert!(recorded == Some(JobState::Cancelled) && told.is_ok(), "{recorded:?} {told:?}");
    assert!(!is_told().await && !app.0.runner.is_waiting(id), "it is stored");
}

#[tokio::test]
async fn jobs_are_recovered_on_the_room_that_is_kept_for_it() {
    let (app, folder) = service().await;
    let id = running(&app).await;
    std::fs::write(folder.path().join("reserve"), b"room").expect("a file");
    app.0.store.fill_disk_at("UPDATE ON job WHEN NEW.state = 'queued'").await;
    app.recover().await.expect("recovered");
    assert_eq!(app.job_state(id).await.expect("it"), JobState::Queued);
}

/// One cancellation took all of the room, and the next one met the full disk.
#[tokio::test]
async fn what_a_cancellation_leaves_of_the_room_is_kept_for_the_next() {
    const RESERVE_BYTES: u64 = 1 << 20;
    let (app, folder) = service().await;
    app.0.runner.schedule().seat(JobId::generate(), Share::Pool, None);
    app.keep_reserve().await.expect("kept");
    let size = |name: &str| std::fs::metadata(folder.path().join(name)).expect("a file").len();
    for _ in 0..3 {
        assert_eq!(size("reserve"), RESERVE_BYTES);
        let id = job(&app).await;
        app.0.store.claim(&id.to_string()).await.expect("the queue").expect("the job");
        app.0.store.fill_disk_at("UPDATE ON job WHEN NEW.state = 'cancelling'").await;
        assert_eq!(app.cancel(id).await.expect("cancelled").state, JobState::Cancelling);
    }
    assert_eq!(size("reserve"), RESERVE_BYTES);
}

/// Results took the room that had been given up for a cancellation.
#[tokio::test]
async fn results_are_not_stored_while_no_room_is_kept_on_a_disk_below_its_floor() {
    let (app, folder) = service_below_the_floor().await;
    let id = running(&app).await;
    keep_no_reserve(folder.path());
    let stored = || app.0.store.files().list().expect("a list").len();
    let before = stored();
    let files = vec![Artifact { name: "coverage.bin".into(), bytes: b"a result".to_vec() }];
    // Cancelled while they wait: else they would wait until there is room.
    let state = app.store_artifacts(id, (files, None), &BTreeMap::new(), &AtomicBool::new(true)).await;
    assert_eq!((state, stored()), (Some(JobState::Cancelled), before));
}

#[test]
fn an_error_of_the_service_is_the_server_s_fault_unless_it_names_another() {
    let refused = FieldError { pointer: "/cell".to_owned(), detail: "is gone".to_owned() };
    let damaged = Error::FileDamaged { sha256: "ab".to_owned(), missing: false };
    for (error, code, fields) in
        [(Error::Invalid(vec![refused]), "job_input_invalid", 1), (damaged, "file_damaged", 0), (Error::TooSlow, "internal", 0)]
    {
        let problem = problem_of_error(&error);
        assert_eq!((problem.code.as_str(), problem.errors.len()), (code, fields), "{error}");
    }
}

/// A region without a target has none to miss: that it holds nothing of the part is in the plan alone.
#[tokio::test]
async fn a_job_tells_what_its_plan_warns_of() {
    let warning = |code: &str| serde_json::json!({"code": code, "pointer": "/params", "detail": "is", "remedy": "do"});
    let codes = ["region_empty", "part_small", "exclusion_empty", "fragile_under_pose_error"];
    let plan = serde_json::json!({"schema": "any", "warnings": codes.map(warning)});
    let file = Artifact { name: PLAN_FILE.into(), bytes: plan.to_string().into_bytes() };
    let (app, _folder) = service_with(vec![file]).await;
    let job = ended_job(&app).await;
    let is_of_plan = |warning: &&FieldWarning| warning.pointer == "/params";
    let told: Vec<_> = job.warnings.iter().filter(is_of_plan).map(|warning| warning.code.as_str()).collect();
    assert_eq!(told, ["region_empty", "exclusion_empty", "fragile_under_pose_error"]);
    assert_eq!(app.job(job.id).await.expect("it").warnings, job.warnings);
    let unreadable = Artifact { name: PLAN_FILE.into(), bytes: b"{".to_vec() };
    assert_eq!(warnings_of(&[unreadable]), []);
}

/// Whoever asked for it was told nothing, and to ask for it.
#[tokio::test]
async fn a_job_tells_that_its_list_of_candidates_is_too_large() {
    let refused = serde_json::json!({"candidates.json": "it would be larger than 512 MiB; reduce part.samples_per_mm2"});
    let files = [(PLAN_FILE, "{}".to_owned()), (REFUSED_FILE, refused.to_string())];
    let files = files.map(|(name, text)| Artifact { name: name.into(), bytes: text.into_bytes() });
    let (app, _folder) = service_with(files.into()).await;
    let job = ended_job(&app).await;
    let told = job.warnings.iter().find(|warning| warning.pointer == "/params/output/candidates").expect("a warning");
    assert_eq!((told.code, told.remedy.as_str()), (WarningCode::CandidatesLeftOut, "reduce part.samples_per_mm2"));
    assert!(told.detail.ends_with("it would be larger than 512 MiB"), "{}", told.detail);
    assert_eq!(app.job(job.id).await.expect("it").warnings, job.warnings);
}

/// Such files stayed for a month, on a full disk too.
#[tokio::test]
async fn what_a_cancelled_job_has_stored_already_is_taken_back() {
    let (app, _folder) = service().await;
    let id = running(&app).await;
    let stored = || app.0.store.files().list().expect("a list").len();
    let before = stored();
    app.0.store.cancel(id).await.expect("cancelling");
    let files = vec![Artifact { name: "coverage.bin".into(), bytes: b"a result".to_vec() }];
    let state = app.store_artifacts(id, (files, None), &BTreeMap::new(), &AtomicBool::new(false)).await;
    assert_eq!((state, stored()), (Some(JobState::Cancelled), before));
}

/// Sets the number of the latest event. After the greatest number there is, the database takes every further event as a full disk does.
async fn set_latest_event(folder: &std::path::Path, number: i64) {
    let database = format!("sqlite://{}", folder.join("vantage.db").display());
    let mut other = SqliteConnection::connect(&database).await.expect("a connection");
    let set = "UPDATE sqlite_sequence SET seq = ?1 WHERE name = 'event'";
    let done = sqlx::query(set).bind(number).execute(&mut other).await.expect("set");
    assert_eq!(done.rows_affected(), 1);
    other.close().await.expect("closed");
}

async fn fault_of_space(app: &App) -> Option<String> {
    let checks = app.readiness().await;
    checks.into_iter().find(|(check, _)| check.name == ReadinessSubject::FreeSpace).expect("a check").1
}

/// The server did not start, so that nothing could be deleted.
#[tokio::test]
async fn a_service_starts_on_a_full_disk_and_recovers_its_jobs_once_there_is_room() {
    let (app, folder) = service().await;
    let id = running(&app).await;
    assert_eq!(fault_of_space(&app).await, None);
    // So that none is written while the service stops.
    app.keep_reserve().await.expect("kept");
    app.stop().await;
    app.close().await;
    drop(app);
    set_latest_event(folder.path(), i64::MAX).await;
    let planner = Arc::new(|_: &JobInput, _: &Context<'_>| Ok(Vec::new()));
    let app = App::open_with(options(folder.path()), planner, None).await.expect("it starts");
    let fault = fault_of_space(&app).await.expect("a fault");
    assert!(fault.contains("has no room") && fault.contains("delete jobs"), "{fault}");
    assert_eq!(app.job(id).await.expect("read").state, JobState::Running);
    let refused = app.start_run(RunRequest::new(id), None, None).await;
    assert!(matches!(&refused, Err(Error::Unrecovered(reason)) if *reason == fault), "{refused:?}");
    let mut events = app.0.store.subscribe();
    set_latest_event(folder.path(), 1000).await;
    let ended = app.job_when_ended(id, Duration::from_secs(60)).await.expect("it");
    assert_eq!((ended.state, fault_of_space(&app).await), (JobState::Failed, None), "its input cannot be read");
    let mut told = std::iter::from_fn(|| events.try_recv().ok());
    assert!(told.any(|event| event.job_id == id && event.kind == EventKind::Queued), "whoever listens hears of the recovery");
}
