//! Drawn reports that no row names in the end.

use super::*;
use crate::service::tests::{ended_job, service_with};

/// Such reports stayed for a month, on a full disk too.
#[tokio::test]
async fn a_report_that_was_drawn_for_a_job_deleted_meanwhile_is_taken_back() {
    let artifact = |name: &'static str, text: &str| Artifact { name: name.into(), bytes: text.into() };
    let (app, _folder) = service_with(vec![artifact(REPORT_DRAFT_FILE, "draft")]).await;
    let (deleted, kept) = (ended_job(&app).await.id, ended_job(&app).await.id);
    app.delete_job(deleted).await.expect("ended");
    let stored = || app.0.store.files().list().expect("a list").len();
    let before = stored();
    let refused = app.keep_drawn(deleted, artifact(REPORT_FILE, "drawn")).await;
    assert!(matches!(refused, Err(Error::JobNotFound(id)) if id == deleted), "{refused:?}");
    assert_eq!(stored(), before);
    app.0.store.fill_disk_at("INSERT ON artifact").await;
    let refused = app.keep_drawn(kept, artifact(REPORT_FILE, "drawn")).await;
    assert!(matches!(refused, Err(Error::StorageFull)), "{refused:?}");
    assert_eq!(stored(), before);
    let drawn = app.keep_drawn(kept, artifact(REPORT_FILE, "drawn")).await.expect("it has a draft still");
    assert_eq!(app.0.store.read_result(&drawn).await.expect("read"), b"drawn");
    assert_eq!(stored(), before, "in place of the draft");
}
