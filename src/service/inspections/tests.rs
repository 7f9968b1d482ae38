//! Inspections while the disk is full, and of what was deleted or damaged meanwhile.

use futures_util::FutureExt as _;

use super::*;
use crate::inspection::InspectionParams;
use crate::service::ScanUpload;
use crate::service::planner::Artifact;
use crate::service::tests::{ended_job, job, no_steps, service, service_with};
use crate::wire::run::{ReportedState, Run, RunRequest};

fn inspection_of(job_id: JobId, state: JobState) -> InspectionJob {
    InspectionJob {
        id: InspectionId::generate(),
        job_id,
        state,
        scans: Vec::new(),
        run_id: None,
        params: InspectionParams::default(),
        fraction: 0.0,
        submitted_by: None,
        created_at: String::new(),
        ended_at: None,
        summary: None,
        files: Vec::new(),
        problem: None,
    }
}

async fn inserted(app: &App, job: &InspectionJob) -> InspectionId {
    app.0.store.insert_inspection(job, &StoredInspection { scans: Vec::new() }, None, 10).await.expect("an inspection").id
}

/// A service whose jobs have a plan.
async fn planning() -> (App, tempfile::TempDir) {
    service_with(vec![Artifact { name: PLAN_FILE.into(), bytes: b"{}".to_vec() }]).await
}

/// A planned job with a scan.
async fn scanned_job(app: &App) -> JobId {
    let job_id = ended_job(app).await.id;
    let mut upload = app.receive(0).await.expect("room");
    upload.write("1 2 3\n".into()).await.expect("written");
    app.add_scan(job_id, upload.finish(None).await.expect("a file"), ScanUpload::default()).await.expect("a scan");
    job_id
}

async fn inspection(app: &App, state: JobState) -> InspectionId {
    inserted(app, &inspection_of(job(app).await, state)).await
}

#[tokio::test]
async fn an_end_is_stored_once_the_disk_has_room() {
    let (app, _folder) = service().await;
    let id = inspection(&app, JobState::Running).await;
    app.0.store.fill_disk_at("UPDATE ON inspection WHEN NEW.state = 'failed'").await;
    let problem = failure(FailureCode::Internal, "a fault".to_owned(), Vec::new());
    app.end_inspection(id, Some(problem.clone())).await.expect("stored");
    let ended = app.inspection(id).await.expect("it");
    assert_eq!((ended.state, ended.problem), (JobState::Failed, Some(problem)));
}

#[tokio::test]
async fn a_cancellation_has_the_room_that_is_kept_for_it() {
    let (app, folder) = service().await;
    let id = inspection(&app, JobState::Queued).await;
    std::fs::write(folder.path().join("reserve"), b"room").expect("a file");
    app.0.store.fill_disk_at("UPDATE ON inspection WHEN NEW.state = 'cancelled'").await;
    assert_eq!(app.cancel_inspection(id).await.expect("cancelled").state, JobState::Cancelled);
}

#[tokio::test]
async fn what_an_earlier_process_left_is_recovered_on_the_room_that_is_kept_for_it() {
    let (app, folder) = service().await;
    let id = inspection(&app, JobState::Cancelling).await;
    std::fs::write(folder.path().join("reserve"), b"room").expect("a file");
    app.0.store.fill_disk_at("UPDATE ON inspection WHEN NEW.state = 'cancelled'").await;
    app.recover_inspections().await.expect("recovered");
    assert_eq!(app.inspection(id).await.expect("it").state, JobState::Cancelled);
}

#[tokio::test]
async fn one_whose_bytes_are_no_text_keeps_no_server_from_starting() {
    let (app, _folder) = service().await;
    let id = inspection(&app, JobState::Running).await;
    app.0.store.damage_text("inspection SET body", &format!("id = '{id}'")).await;
    app.recover_inspections().await.expect("the others go on");
    app.delete_inspection(id).await.expect("it counts as failed");
}

#[tokio::test]
async fn a_scan_that_was_deleted_since_the_request_was_checked_is_not_inspected() {
    let (app, _folder) = service().await;
    let job = inspection_of(job(&app).await, JobState::Queued);
    let (id, created_at) = (ScanId::generate(), String::new());
    let scan = Scan {
        id,
        job_id: job.job_id,
        view: None,
        name: None,
        unit: None,
        frame: None,
        sha256: "ab".to_owned(),
        size_bytes: 1,
        created_at,
    };
    let refused = app.0.store.insert_inspection(&job, &StoredInspection { scans: vec![scan] }, None, 10).await;
    assert!(matches!(refused, Err(Error::ScanNotFound(gone)) if gone == id), "{refused:?}");
    assert!(matches!(app.inspection(job.id).await, Err(Error::InspectionNotFound(_))));
}

/// A second inspection was stored and computed.
#[tokio::test]
async fn a_key_starts_one_inspection_of_a_job_however_often_it_comes() {
    let (app, _folder) = planning().await;
    let job_id = scanned_job(&app).await;
    let _turn = app.0.inspections.turn.lock().await;
    let submit = async |scans: Option<Vec<ScanId>>| {
        let submission = Submission { idempotency_key: Some("key".to_owned()), ..Submission::default() };
        app.submit_inspection(job_id, InspectionRequest { scans, ..InspectionRequest::default() }, submission).await
    };
    let refused = submit(Some(Vec::new())).await;
    assert!(matches!(refused, Err(Error::Invalid(_))), "it has used no key: {refused:?}");
    let (first, second) = tokio::join!(submit(None), submit(None));
    let first = first.expect("accepted");
    assert_eq!(second.expect("the same"), first);
    assert_eq!(submit(None).await.expect("the same"), first);
    let refused = submit(Some(first.scans.clone())).await;
    assert!(matches!(refused, Err(Error::IdempotencyMismatch)), "{refused:?}");
    let all = app.inspections(&InspectionSelection::default(), 10, None).await.expect("a list");
    assert_eq!(all.items, [first]);
}

/// Each of them was compared with all before it, and told in a message of its own.
#[tokio::test]
async fn a_request_names_no_more_scans_than_are_allowed() {
    let (app, _folder) = planning().await;
    let job_id = scanned_job(&app).await;
    let named = vec![ScanId::generate(); InspectionRequest::MAX_SCANS + 1];
    let request = InspectionRequest { scans: Some(named), ..InspectionRequest::default() };
    let Err(Error::Invalid(errors)) = app.submit_inspection(job_id, request, Submission::default()).await else {
        panic!("too many")
    };
    assert_eq!(errors.len(), 1, "{} findings", errors.len());
    assert_eq!(
        (errors[0].pointer.as_str(), errors[0].detail.as_str()),
        ("/scans", "has 10001 entries; at most 10000 are allowed")
    );
}

/// A dry run was once taken for one that scans, and a run that had taken no scan for one of all: the planned poses counted without a word.
#[tokio::test]
async fn a_dry_run_and_a_run_without_scans_are_none_in_which_scans_were_taken() {
    let (app, _folder) = service().await;
    let job_id = job(&app).await;
    let program = no_steps();
    for (mode, scans, told) in [
        (RunMode::Simulate, 3, None),
        (RunMode::Live, 3, None),
        (RunMode::DryRun, 3, Some("dry run")),
        (RunMode::Live, 0, Some("has taken no scan")),
    ] {
        let run = Run::new(&RunRequest { mode, ..RunRequest::new(job_id) }, Some(job_id), "cell", &program, "");
        let run = Run { scans, ..run };
        let (run, _) = app.0.store.insert_run(&run, None, 8).await.expect("stored");
        let checked = app.check_run(job_id, run.id).await;
        match (&checked, told) {
            (Ok(()), None) => {}
            (Err(Error::Invalid(errors)), Some(words)) => {
                assert!(errors[0].pointer == "/run_id" && errors[0].detail.contains(words), "{errors:?}");
            }
            _ => panic!("{mode:?} with {scans} scans: {checked:?}"),
        }
    }
}

#[tokio::test]
async fn a_run_that_was_deleted_and_a_plan_that_is_damaged_are_no_faults_of_the_server() {
    let (app, _folder) = planning().await;
    let planned = ended_job(&app).await;
    let (job_id, sha256) = (planned.id, planned.plan_sha256.expect("a plan"));
    let problem = async |run_id: Option<RunId>| {
        let id = inserted(&app, &InspectionJob { run_id, ..inspection_of(job_id, JobState::Queued) }).await;
        app.clone().carry_out_inspection(id).await;
        app.inspection(id).await.expect("it").problem.expect("a reason")
    };
    let gone = problem(Some(RunId::generate())).await;
    assert_eq!((gone.code.as_str(), gone.errors[0].pointer.as_str()), ("job_input_invalid", "/run_id"), "{gone:?}");
    std::fs::write(app.0.store.files().path(&sha256), b"other").expect("damaged");
    assert_eq!(problem(None).await.code, "file_damaged");
}

/// The report of an inspection had no such time.
#[tokio::test]
async fn an_inspection_knows_when_its_plan_was_asked_for() {
    let (app, _folder) = planning().await;
    let planned = ended_job(&app).await;
    let id = inserted(&app, &inspection_of(planned.id, JobState::Queued)).await;
    let inspection = app.inspection(id).await.expect("it");
    let order = app.inspection_order(&inspection).await.expect("an order");
    assert_eq!(order.input.accepted_at, Some(planned.created_at));
}

#[tokio::test]
async fn a_run_that_was_deleted_is_told_at_its_field_with_when_by_whom_and_what_remains() {
    let (app, _folder) = service().await;
    let job_id = job(&app).await;
    let ran = async || {
        let run = Run::new(&RunRequest::new(job_id), Some(job_id), "cell", &no_steps(), "");
        let run = Run { state: ReportedState::Done, ..run };
        app.0.store.insert_run(&run, None, 8).await.expect("stored").0.id
    };
    let told = async |run: RunId| {
        let refused = app.check_run(job_id, run).await.expect_err("it is gone");
        let Error::Invalid(errors) = &refused else { panic!("{refused}") };
        assert_eq!(errors[0].pointer, "/run_id");
        errors[0].detail.clone()
    };
    let (retired, deleted) = (ran().await, ran().await);
    app.delete_run_row(retired, true).await.expect("due");
    app.delete_run(deleted).await.expect("ended");
    let said = told(retired).await;
    assert!(said.starts_with(&format!("is {retired}; that run was deleted at 2")), "{said}");
    assert!(said.contains("Z by the retention policy (retention.run_days)"), "{said}");
    assert!(said.ends_with("scans and plan remain: inspect without run_id, which uses the poses of the plan"), "{said}");
    assert!(told(deleted).await.contains("Z by a request"));
    assert!(told(RunId::generate()).await.contains("no run has this id"));
    let said = app.run(retired).await.expect_err("it is gone").to_string();
    assert!(said.starts_with(&format!("there is no run {retired}; it was deleted at 2")), "{said}");
    let never = RunId::generate();
    assert_eq!(app.delete_run(never).await.expect_err("none").to_string(), format!("there is no run {never}"));
}

/// Such files stayed for a month, on a full disk too.
#[tokio::test]
async fn what_a_cancelled_inspection_has_stored_already_is_taken_back() {
    let (app, _folder) = service().await;
    let id = inspection(&app, JobState::Running).await;
    let stored = || app.0.store.files().list().expect("a list").len();
    let before = stored();
    app.cancel_inspection(id).await.expect("cancelling");
    let file = Artifact { name: "inspection.json".into(), bytes: b"a result".to_vec() };
    let result = app.0.store.put_artifacts(Arc::new(vec![file])).await.expect("files");
    assert_eq!(stored(), before + 1);
    let summary = InspectionSummary {
        planned_of_asked: 0.9,
        measured_of_asked: 0.8,
        measured_in_all_of_asked: 0.8,
        unexplained_of_asked: 0.0,
        deviation_rms_mm: None,
        not_found: None,
        verdicts: None,
    };
    app.keep_inspection(id, summary, result).await.expect("its end");
    assert_eq!((app.inspection(id).await.expect("it").state, stored()), (JobState::Cancelled, before));
}

/// An inspection was cancelling in the store, and computed to its end.
#[tokio::test]
async fn an_inspection_is_cancelled_though_whoever_asked_for_it_goes_away() {
    let (app, _folder) = service().await;
    let id = inspection(&app, JobState::Running).await;
    let flag = Arc::new(AtomicBool::new(false));
    app.0.inspections.running().insert(id, (Arc::clone(&flag), 0.0));
    assert!(app.cancel_inspection(id).now_or_never().is_none(), "it waits for the store");
    let is_told = async {
        while !flag.load(Ordering::Relaxed) {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(Duration::from_secs(60), is_told).await.expect("the computation is told");
    assert_eq!(app.inspection(id).await.expect("it").state, JobState::Cancelling);
}
