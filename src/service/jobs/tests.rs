//! Outcomes that cannot be stored, and jobs that an earlier process left on a full disk.

use std::time::Duration;

use super::*;
use crate::cell::FieldError;
use crate::service::plan_job::REFUSED_FILE;
use crate::service::tests::{ended_job, job, service, service_with};
use crate::wire::warnings::WarningCode;

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
