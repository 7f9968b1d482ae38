//! Ends that come while a stream is begun.

use std::time::Duration;

use crate::service::tests::{job, service};
use crate::wire::EventKind;

#[tokio::test]
async fn an_end_after_the_store_was_read_is_told() {
    let (app, _folder) = service().await;
    let id = job(&app).await;
    let last = app.0.store.newest_event().await.expect("a number");
    let mut stream = app.events(Some(id), Some(last)).await.expect("a stream");
    app.cancel(id).await.expect("cancelled");
    assert!(!stream.is_over(), "its last event was not told");
    let told = stream.next().await.expect("read").expect("an event");
    assert_eq!(told.kind, EventKind::Cancelled);
    let after = app.events(Some(id), Some(told.id)).await.expect("a stream");
    assert!(stream.is_over() && after.is_over());
}

/// The answer was that everything had been seen, and the browser never learned of the end.
#[tokio::test]
async fn a_job_whose_end_was_pruned_is_told_to_be_read_anew_once() {
    let (app, _folder) = service().await;
    let id = job(&app).await;
    let first = app.0.store.events_after(Some(id), 0, 1).await.expect("events").through;
    app.cancel(id).await.expect("cancelled");
    // Times have milliseconds: the end has to lie in the past.
    tokio::time::sleep(Duration::from_millis(5)).await;
    app.0.store.prune_events(0).await.expect("pruned");
    let mut stream = app.events(Some(id), Some(first)).await.expect("a stream");
    assert!(stream.has_gap() && !stream.is_over());
    let newest = app.0.store.newest_event().await.expect("a number");
    assert_eq!(stream.only_gap(), Some(newest));
    assert!(stream.next().await.expect("read").is_none(), "nothing follows");
    let again = app.events(Some(id), Some(newest)).await.expect("a stream");
    assert!(again.is_over() && !again.has_gap());
    // So is a reader whose number is of the database before a restore.
    let of_another_database = app.events(Some(id), Some(newest + 7)).await.expect("a stream");
    assert!(of_another_database.has_gap() && of_another_database.only_gap() == Some(newest));
    // Whoever followed it for the first time got no event, and did not learn how it had ended.
    let mut fresh = app.events(Some(id), None).await.expect("a stream");
    assert!(fresh.has_gap() && !fresh.is_over());
    assert_eq!(fresh.only_gap(), Some(newest));
    assert!(fresh.next().await.expect("read").is_none(), "nothing follows");
}

/// A gap is told only to whom something is missing.
#[tokio::test]
async fn an_ended_job_whose_events_are_kept_is_told_from_its_beginning() {
    let (app, _folder) = service().await;
    let id = job(&app).await;
    app.cancel(id).await.expect("cancelled");
    let mut stream = app.events(Some(id), None).await.expect("a stream");
    assert!(!stream.has_gap() && !stream.is_over() && stream.only_gap().is_none());
    let mut told = Vec::new();
    while let Some(event) = stream.next().await.expect("read") {
        told.push(event.kind);
    }
    assert_eq!(told, [EventKind::Queued, EventKind::Cancelled]);
}
