//! Ends that come while a stream is begun.

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
