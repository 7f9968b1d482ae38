//! Retention: jobs and meshes that the policy deletes, and those that it never does.

use super::*;
use crate::wire::RetentionReason::{Age, Count, Disk};
use crate::wire::inspection::Scan;
use crate::wire::{RunId, ScanId};

fn policy() -> Policy {
    Policy { job_days: 0, jobs_per_part: 0, unused_mesh_days: 0, run_days: 0, max_bytes: 0, hold_label: "hold".into() }
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
    let back = "UPDATE job SET created_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-3 days'),
        ended_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-3 days') WHERE ended_at IS NOT NULL";
    sqlx::query(back).execute(&store.reader).await.expect("days pass");
    assert_eq!(due(store, Policy { job_days: 4, ..policy() }).await, []);
    assert_eq!(due(store, Policy { job_days: 2, jobs_per_part: 1, ..policy() }).await, [(a, Age), (b, Age), (c, Age)]);
    assert_eq!(store.job(waiting).await.expect("it").state, JobState::Queued);
}

/// An empty one counted as a part of its own, so that jobs of different parts deleted each other.
#[tokio::test]
async fn jobs_with_a_blank_part_number_belong_to_their_meshes() {
    let opened = open().await;
    let store = &opened.store;
    let [one, two, three] =
        [add_mesh(store, b"one").await.id, add_mesh(store, b"two").await.id, add_mesh(store, b"three").await.id];
    let (first, second) = (ended(store, one, Some(""), 10).await, ended(store, two, Some(""), 10).await);
    ended(store, three, Some("  "), 10).await;
    assert_eq!(due(store, Policy { jobs_per_part: 1, ..policy() }).await, []);
    ended(store, one, None, 10).await;
    ended(store, two, Some("  "), 10).await;
    assert_eq!(due(store, Policy { jobs_per_part: 1, ..policy() }).await, [(first, Count), (second, Count)]);
    assert_eq!(store.job(first).await.expect("it").part_number, None);
}

/// Such jobs were deleted first, with their problem and their events, and left as little room as before.
#[tokio::test]
async fn a_job_without_files_is_not_deleted_for_room() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let failed = submit(store, mesh).await;
    store.claim_next().await.expect("the queue").expect("it");
    succeed(store, failed, Vec::new()).await;
    let large = ended(store, mesh, None, 900).await;
    assert_eq!(due(store, Policy { max_bytes: 1, ..policy() }).await, [(large, Disk)]);
    // Once the mesh is deleted, its file goes with the last job that read it.
    store.delete_mesh(mesh, 0).await.expect("no open job needs it");
    assert_eq!(due(store, Policy { max_bytes: 1, ..policy() }).await, [(failed, Disk), (large, Disk)]);
}

/// Previews took room that nothing counted.
#[tokio::test]
async fn previews_count_as_stored_files() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    store.put_preview(mesh, b"preview".to_vec()).await.expect("stored");
    assert_eq!(store.stored_bytes().await.expect("a sum"), 10);
    let back = "UPDATE mesh SET created_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-3 days')";
    sqlx::query(back).execute(&store.reader).await.expect("days pass");
    assert_eq!(store.due(&Policy { unused_mesh_days: 2, ..policy() }).await.expect("a list").meshes, [(mesh, 10)]);
}

/// A scan of a job, as it is uploaded under a name.
async fn scan(store: &Store, job_id: JobId, name: &str, bytes: &[u8]) -> Scan {
    let received = store.files().write(bytes).expect("a file");
    let scan = Scan {
        id: ScanId::generate(),
        job_id,
        view: None,
        name: Some(name.to_owned()),
        unit: None,
        frame: None,
        sha256: String::new(),
        size_bytes: 0,
        created_at: String::new(),
    };
    store.add_scan(scan, received).await.expect("a scan")
}

#[tokio::test]
async fn the_same_scan_is_stored_once_and_its_file_lives_as_long_as_one_upload_refers_to_it() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let job = ended(store, mesh, None, 10).await;
    let before = stored_files(&opened);
    let first = scan(store, job, "view_00.xyz", b"0 0 0").await;
    assert_eq!(scan(store, job, "view_00.xyz", b"0 0 0").await, first, "the same upload is the same scan");
    let other = scan(store, job, "view_01.xyz", b"0 0 0").await;
    assert_ne!(other.id, first.id, "of another view");
    assert_eq!(stored_files(&opened), before + 1);
    let due = store.due(&Policy { max_bytes: 1, ..policy() }).await.expect("a list");
    assert_eq!(due.jobs, [(job, Disk, 15)], "its file counts once");
    store.delete_scan(first.id, "hold").await.expect("no inspection reads it");
    store.files().read(&other.sha256).expect("kept for the other upload");
    store.delete_scan(other.id, "hold").await.expect("no inspection reads it");
    assert_eq!(stored_files(&opened), before);
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

/// A clock that was a year ahead gave a job an id and times after those of the jobs that came later.
#[tokio::test]
async fn the_job_that_came_last_is_the_newest_whatever_the_clock_said() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let early = ended(store, mesh, Some("P"), 900).await;
    let ahead = "ffffffff-ffff-7fff-bfff-ffffffffffff";
    let mut tx = store.writer.begin().await.expect("a transaction");
    sqlx::query("PRAGMA defer_foreign_keys = ON").execute(&mut *tx).await.expect("set");
    for statement in [
        "UPDATE job_body SET job_id = ?1",
        "UPDATE job_mesh SET job_id = ?1",
        "UPDATE artifact SET job_id = ?1",
        "UPDATE job SET id = ?1, created_at = '2999-01-01T00:00:00.000Z', ended_at = '2999-01-01T00:00:00.000Z'",
    ] {
        sqlx::query(statement).bind(ahead).execute(&mut *tx).await.expect(statement);
    }
    tx.commit().await.expect("committed");
    let late = ended(store, mesh, Some("P"), 900).await;
    let ahead: JobId = ahead.parse().expect("an id");
    assert!(early < late && late < ahead);
    assert_eq!(due(store, Policy { jobs_per_part: 1, ..policy() }).await, [(ahead, Count)]);
    assert_eq!(due(store, Policy { max_bytes: 1000, ..policy() }).await, [(ahead, Disk)]);
}

#[tokio::test]
async fn a_job_that_ended_while_the_clock_was_behind_is_no_older_than_the_one_before_it() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    ended(store, mesh, None, 10).await;
    let behind = ended(store, mesh, None, 10).await;
    let back = "UPDATE job SET created_at = '1970-01-01T00:00:00.000Z', ended_at = '1970-01-01T00:00:01.000Z' WHERE id = ?1";
    sqlx::query(back).bind(behind.to_string()).execute(&store.reader).await.expect("years back");
    assert_eq!(due(store, Policy { job_days: 2, ..policy() }).await, []);
}

/// All that has an age looks old after a jump, keys of answers included.
#[tokio::test]
async fn nothing_is_deleted_for_its_age_once_the_clock_has_jumped() {
    let mut opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let unused = add_mesh(store, b"two").await.id;
    let with_key = async |store: &Store| {
        let key = IdempotencyKey::new("key", "a");
        store.submit(&new_job(mesh, 0), Some(&key), ROOM).await.expect("a job").id
    };
    let id = with_key(store).await;
    store.claim_next().await.expect("the queue").expect("it");
    succeed(store, id, vec![("plan.json", b"{}".to_vec())]).await;
    for back in [
        "UPDATE job SET created_at = '2001-01-01T00:00:00.000Z', ended_at = '2001-01-01T00:00:00.000Z'",
        "UPDATE mesh SET created_at = '2001-01-01T00:00:00.000Z'",
        "UPDATE event SET at = '2001-01-01T00:00:00.000Z'",
        "UPDATE idempotency SET created_at = '2001-01-01T00:00:00.000Z'",
    ] {
        sqlx::query(back).execute(&store.reader).await.expect("years pass");
    }
    let orphan = store.files().write(b"nobody's").expect("a file");
    store.files().persist(orphan).expect("renamed");
    let aged = Policy { job_days: 2, unused_mesh_days: 2, ..policy() };

    opened.store.clock.wall -= std::time::Duration::from_secs(365 * 86_400);
    let store = &opened.store;
    assert_eq!(store.due(&aged).await.expect("a list"), Due::default());
    assert_eq!(due(store, Policy { max_bytes: 1, ..policy() }).await, [(id, Disk)], "size has nothing to do with time");
    store.sweep(std::time::Duration::ZERO, std::time::Duration::ZERO).await.expect("nothing");
    store.prune_events(1).await.expect("nothing");
    store.probe().await.expect("writable");
    assert_eq!(stored_files(&opened), 4);
    assert_eq!(kinds(store, id).await.len(), 3);
    assert_eq!(with_key(store).await, id, "the answer is still known");

    opened.store.clock = super::super::clock::Clock::start();
    let store = &opened.store;
    let found = store.due(&aged).await.expect("a list");
    assert_eq!((found.jobs.len(), found.meshes.as_slice()), (1, &[(unused, 3)][..]));
    assert_ne!(with_key(store).await, id, "a day has passed");
}

#[tokio::test]
async fn the_bytes_that_deletions_remove_are_counted_once_and_when_the_last_reference_goes() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let shared = async || {
        let id = submit(store, mesh).await;
        store.claim_next().await.expect("the queue").expect("it");
        succeed(store, id, vec![("coverage.bin", b"shared".to_vec())]).await;
        id
    };
    let (a, b) = (shared().await, shared().await);
    let before = store.stored_bytes().await.expect("a sum");
    store.delete_job(a, "hold", None).await.expect("deleted");
    assert_eq!(store.removed_bytes(), 0, "the other job has the same file");
    store.delete_job(b, "hold", None).await.expect("deleted");
    assert_eq!(store.removed_bytes(), 6);
    assert_eq!(store.stored_bytes().await.expect("a sum"), before - 6);
}

/// A run by its rows: `days` since its acceptance and its end.
async fn run(store: &Store, job: Option<JobId>, state: &str, days: u32) -> RunId {
    let id = RunId::generate();
    let insert = "INSERT INTO run (id, job_id, cell, mode, state, body, created_at, ended_at)
        SELECT ?1, ?2, 'c', 'live', ?3, '{}', past, past
        FROM (SELECT strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-' || ?4 || ' days') AS past)";
    let query = sqlx::query(insert).bind(id.to_string()).bind(job.map(|id| id.to_string())).bind(state).bind(days);
    query.execute(&store.reader).await.expect("a run");
    id
}

#[tokio::test]
async fn runs_go_by_an_age_of_their_own_unless_they_are_open_or_their_job_is_held_or_in_use() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let (idle, held, inspected, driven) = (
        ended(store, mesh, None, 10).await,
        ended(store, mesh, None, 10).await,
        ended(store, mesh, None, 10).await,
        ended(store, mesh, None, 10).await,
    );
    store.put_labels(held, &std::collections::BTreeMap::from([("hold".to_owned(), String::new())])).await.expect("held");
    let inspection = "INSERT INTO inspection (id, job_id, state, body, input) VALUES ('i', ?1, 'running', '', '')";
    sqlx::query(inspection).bind(inspected.to_string()).execute(&store.reader).await.expect("a row");
    let of_deleted_job = run(store, Some(JobId::generate()), "done", 3).await;
    let of_idle_job = run(store, Some(idle), "failed", 3).await;
    let of_held_job = run(store, Some(held), "done", 3).await;
    let of_inspected_job = run(store, Some(inspected), "done", 3).await;
    let of_driven_job = run(store, Some(driven), "stopped", 3).await;
    run(store, Some(driven), "paused", 3).await;
    run(store, None, "running", 3).await;
    run(store, None, "done", 1).await;
    let due = async |run_days: u32| {
        let policy = Policy { run_days, ..policy() };
        store.due_runs(&policy).await.expect("a list").into_iter().map(|run| run.id).collect::<Vec<_>>()
    };
    assert_eq!(due(0).await, [], "they are kept unless it is asked for");
    assert_eq!(due(4).await, []);
    assert_eq!(due(2).await, [of_deleted_job, of_idle_job], "the oldest first");
    // What has changed since they were found due.
    for by_retention in [true, false] {
        assert!(matches!(store.delete_run(of_held_job, "hold", by_retention).await, Err(Error::JobHeld { .. })));
    }
    for in_use in [of_inspected_job, of_driven_job] {
        assert!(matches!(store.delete_run(in_use, "hold", true).await, Err(Error::JobInUse(_))));
    }
    store.delete_run(of_driven_job, "hold", false).await.expect("whoever asks for this run may");
    store.delete_run(of_deleted_job, "hold", true).await.expect("due");
    assert_eq!(due(2).await, [of_idle_job]);
    let everything = Policy { job_days: 1, jobs_per_part: 1, unused_mesh_days: 1, max_bytes: 1, ..policy() };
    assert_eq!(store.due_runs(&everything).await.expect("a list"), [], "nothing else deletes a run");
    store.delete_job(idle, "hold", None).await.expect("deleted");
    assert_eq!(due(2).await, [of_idle_job], "it outlives its job");
}

#[tokio::test]
async fn no_run_is_deleted_for_its_age_once_the_clock_has_jumped_or_was_behind() {
    let mut opened = open().await;
    let old = run(&opened.store, None, "done", 30).await;
    let policy = Policy { run_days: 2, ..policy() };
    assert_eq!(opened.store.due_runs(&policy).await.expect("a list").len(), 1);
    opened.store.clock.wall -= std::time::Duration::from_secs(365 * 86_400);
    assert_eq!(opened.store.due_runs(&policy).await.expect("a list"), []);
    opened.store.clock = super::super::clock::Clock::start();
    let store = &opened.store;
    run(store, None, "done", 0).await;
    let behind = run(store, None, "done", 20_000).await;
    let due: Vec<RunId> = store.due_runs(&policy).await.expect("a list").into_iter().map(|run| run.id).collect();
    assert_eq!(due, [old], "{behind} is no older than the one before it");
}
