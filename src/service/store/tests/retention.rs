//! Retention: jobs and meshes that the policy deletes, and those that it never does.

use super::*;
use crate::wire::RetentionReason::{Age, Count, Disk};

fn policy() -> Policy {
    Policy { job_days: 0, jobs_per_part: 0, unused_mesh_days: 0, max_bytes: 0, hold_label: "hold".into() }
}

/// A succeeded job of a part, with a result of this many bytes.
async fn ended(store: &Store, mesh: MeshId, part: Option<&str>, bytes: usize) -> JobId {
    let request = JobRequest { part_number: part.map(str::to_owned), ..JobRequest::new(mesh) };
    let id = store.submit_one(&NewJob { request, ..new_job(mesh, 0) }).await.expect("a job").id;
    store.claim_next().await.expect("the queue").expect("it");
    let text: Vec<u8> = id.to_string().bytes().cycle().take(bytes).collect();
    succeed(store, id, vec![("coverage.bin", text)]).await;
    id
}

async fn due(store: &Store, policy: Policy) -> Vec<(JobId, crate::wire::RetentionReason)> {
    store.due(&policy).await.expect("a list").jobs.into_iter().map(|(id, reason, _)| (id, reason)).collect()
}

#[tokio::test]
async fn old_many_and_large_go_the_oldest_first() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let other = add_mesh(store, b"two").await.id;
    let (a, b, c) = (
        ended(store, mesh, Some("P"), 900).await,
        ended(store, other, Some("P"), 900).await,
        ended(store, mesh, None, 900).await,
    );
    let waiting = submit(store, mesh).await;
    assert_eq!(due(store, policy()).await, [], "nothing goes unless it is asked for");
    assert_eq!(due(store, Policy { jobs_per_part: 1, ..policy() }).await, [(a, Count)]);
    assert_eq!(due(store, Policy { max_bytes: 2000, ..policy() }).await, [(a, Disk)]);
    assert_eq!(due(store, Policy { max_bytes: 1, ..policy() }).await, [(a, Disk), (b, Disk), (c, Disk)]);
    let back = "UPDATE job SET ended_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-3 days') WHERE ended_at IS NOT NULL";
    sqlx::query(back).execute(&store.reader).await.expect("days pass");
    assert_eq!(due(store, Policy { job_days: 4, ..policy() }).await, []);
    assert_eq!(due(store, Policy { job_days: 2, jobs_per_part: 1, ..policy() }).await, [(a, Age), (b, Age), (c, Age)]);
    assert_eq!(store.job(waiting).await.expect("it").state, JobState::Queued);
}

#[tokio::test]
async fn a_hold_keeps_a_job_from_everybody() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let id = ended(store, mesh, None, 10).await;
    let held = std::collections::BTreeMap::from([("hold".to_owned(), "case 7".to_owned())]);
    assert_eq!(store.put_labels(id, &held).await.expect("labelled").labels, held);
    assert_eq!(due(store, Policy { max_bytes: 1, jobs_per_part: 1, ..policy() }).await, []);
    assert!(matches!(store.delete_job(id, "hold", None).await, Err(Error::JobHeld { .. })));
    store.put_labels(id, &std::collections::BTreeMap::new()).await.expect("labels off");
    assert_eq!(due(store, Policy { max_bytes: 1, ..policy() }).await, [(id, Disk)]);
    store.delete_job(id, "hold", Some(Disk.code())).await.expect("deleted");
    let events = store.events_after(Some(id), 0, 100).await.expect("events").events;
    assert_eq!(events.last().expect("the last").code.as_deref(), Some("retention_disk"));
}

#[tokio::test]
async fn only_meshes_that_nothing_names_are_unused() {
    let opened = open().await;
    let store = &opened.store;
    let (used, named, unused) =
        (add_mesh(store, b"one").await.id, add_mesh(store, b"two").await.id, add_mesh(store, b"three").await.id);
    submit(store, used).await;
    let body = format!(r#"{{"obstacles": [{{"shape": {{"kind": "mesh", "mesh": "{named}"}}}}]}}"#);
    store.put_spec(SpecCollection::Cell, "c", &body, &Precondition::None).await.expect("a cell");
    let policy = Policy { unused_mesh_days: 2, ..policy() };
    assert_eq!(store.due(&policy).await.expect("a list").meshes, []);
    let back = "UPDATE mesh SET created_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-3 days')";
    sqlx::query(back).execute(&store.reader).await.expect("days pass");
    assert_eq!(store.due(&policy).await.expect("a list").meshes, [(unused, 5)]);
    assert!(matches!(store.delete_mesh(named, 0).await, Err(Error::MeshInSpec { name, .. }) if name == "c"));
    // Uploaded again, it is as new, also for a policy that has just found it unused.
    assert_eq!(add_mesh(store, b"three").await.id, unused);
    assert_eq!(store.due(&policy).await.expect("a list").meshes, []);
    assert!(matches!(store.delete_mesh(unused, 2).await, Err(Error::MeshNotFound(_))));
    sqlx::query(back).execute(&store.reader).await.expect("days pass");
    store.delete_mesh(unused, 2).await.expect("unused again");
}
