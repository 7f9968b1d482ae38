//! Drawn reports that cannot be stored, or that no row names in the end.

use std::io::Read as _;

use super::*;
use crate::service::tests::{ended_job, keep_no_reserve, service_below_the_floor, service_with};

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

/// The disk was told to be full to whoever only read.
#[tokio::test]
async fn a_report_for_which_the_disk_has_no_room_is_given_out_all_the_same() {
    let report = || Artifact { name: REPORT_FILE.into(), bytes: b"drawn".to_vec() };
    let is_given = async |app: &App, id: JobId| {
        let given = app.keep_or_give(id, report()).await.expect("a report");
        let mut bytes = Vec::new();
        given.open(false).await.expect("open").read_to_end(&mut bytes).expect("read");
        assert_eq!((bytes.as_slice(), given.read().await.expect("read").as_slice()), (&b"drawn"[..], &b"drawn"[..]));
        assert_eq!((given.size_bytes(false), given.is_packed()), (5, false));
        given.sha256().to_owned()
    };
    let (low, folder) = service_below_the_floor().await;
    keep_no_reserve(folder.path());
    let unstored = is_given(&low, JobId::generate()).await;
    assert_eq!(low.0.store.files().list().expect("a list").len(), 0);
    let (app, _folder) = service_with(vec![Artifact { name: REPORT_DRAFT_FILE.into(), bytes: b"draft".to_vec() }]).await;
    let id = ended_job(&app).await.id;
    app.0.store.fill_disk_at("INSERT ON artifact").await;
    assert_eq!(is_given(&app, id).await, unstored);
    app.0.store.result(id, REPORT_DRAFT_FILE).await.expect("kept for the next request");
    assert_eq!(is_given(&app, id).await, unstored, "stored now, with the same tag");
    app.0.store.result(id, REPORT_FILE).await.expect("in place of the draft");
}
