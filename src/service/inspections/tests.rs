//! Inspections while the disk is full.

use super::*;
use crate::inspection::InspectionParams;
use crate::service::tests::{job, service};

async fn inspection(app: &App, state: JobState) -> InspectionId {
    let job = InspectionJob {
        id: InspectionId::generate(),
        job_id: job(app).await,
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
    };
    app.0.store.insert_inspection(&job, &StoredInspection { scans: Vec::new() }, 1).await.expect("an inspection").id
}

#[tokio::test]
async fn an_end_is_stored_once_the_disk_has_room() {
    let (app, _folder) = service().await;
    let id = inspection(&app, JobState::Running).await;
    app.0.store.fill_disk_at("UPDATE ON inspection WHEN NEW.state = 'failed'").await;
    let problem = failure("internal", "a fault".to_owned(), Vec::new());
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
