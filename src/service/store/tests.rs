//! The store by itself: persistence, recovery, refusals.

mod damage;
mod list;
mod retention;
mod summary;
mod upgrade;

use sha2::{Digest, Sha256};
use sqlx::{QueryBuilder, Sqlite};

use super::*;
use crate::cell::Named;
use crate::inspection::InspectionParams;
use crate::planning::params::{PlanParams, Preset};
use crate::service::planner::Artifact;
use crate::service::rescan_job::RESCAN_STATE_FILE;
use crate::service::store::specs::Precondition;
use crate::service::tests::no_steps;
use crate::wire::inspection::InspectionJob;
use crate::wire::run::{ReportedState, Run, RunEventKind, RunRequest};
use crate::wire::{
    EventKind, InspectionId, Job, JobFile, JobId, JobProblem, JobRequest, JobState, MeshHealthReport, MeshId, SpecCollection,
    UploadedMesh, hex,
};

struct Opened {
    store: Store,
    folder: tempfile::TempDir,
}

async fn open() -> Opened {
    let folder = tempfile::tempdir().expect("a folder");
    Opened { store: Store::open(folder.path()).await.expect("a store"), folder }
}

impl Opened {
    async fn reopen(self) -> Self {
        let Self { store, folder } = self;
        drop(store);
        Self { store: Store::open(folder.path()).await.expect("the store again"), folder }
    }
}

fn health() -> MeshHealthReport {
    serde_json::from_value(serde_json::json!({
        "format": "stl_binary", "triangles_in_file": 1, "triangles": 1, "vertices": 3,
        "bbox_mm": {"min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 0.0]}, "area_mm2": 0.5, "volume_mm3": null,
        "watertight": false, "bodies": 1, "degenerate_triangles": 0, "duplicate_triangles": 0, "boundary_edges": 3,
        "non_manifold_edges": 0, "inconsistent_edges": 0, "flipped_bodies": 0, "warnings": []
    }))
    .expect("a health report")
}

async fn add_mesh(store: &Store, bytes: &'static [u8]) -> UploadedMesh {
    let mut receiver = store.files().receive().expect("a receiver");
    receiver.write(bytes).expect("written");
    let received = receiver.finish().expect("finished");
    let new = NewMesh { received, unit: "mm".into(), name: None, health: health() };
    store.add_mesh(new).await.expect("a mesh")
}

fn new_job(mesh: MeshId, priority: i32) -> NewJob {
    let request = JobRequest { priority, ..JobRequest::new(mesh) };
    NewJob { request, input: "{}".into(), meshes: vec![mesh], warnings: Vec::new(), submitted_by: None, scanned: None }
}

/// Room in the queue of these tests.
const ROOM: u64 = 1000;

impl Store {
    /// Starts the next job of the queue; those that cannot be read fail before it.
    async fn claim_next(&self) -> Result<Option<Attempt>, Error> {
        while let Some(id) = self.queue(1).await?.pop() {
            if let Some(attempt) = self.claim(&id).await? {
                return Ok(Some(attempt));
            }
        }
        Ok(None)
    }

    /// Lets the disk be full at the next change such as `UPDATE ON run`, once: what a full disk refuses closes the connection, and the
    /// trigger with it.
    pub(in crate::service) async fn fill_disk_at(&self, change: &str) {
        let mut tx = self.writer.begin().await.expect("a transaction");
        let pages: i64 = sqlx::query_scalar("PRAGMA page_count").fetch_one(&mut *tx).await.expect("a number");
        let limit = format!("PRAGMA max_page_count = {}", pages + 100);
        let grow = "INSERT INTO run_event (run_id, body) VALUES ('', hex(zeroblob(1000000)))";
        let trigger = format!("CREATE TEMP TRIGGER out_of_room AFTER {change} BEGIN {grow}; END");
        for statement in [limit, trigger] {
            QueryBuilder::<Sqlite>::new(statement).build().execute(&mut *tx).await.expect("done");
        }
        tx.commit().await.expect("committed");
    }

    /// Lets a column hold bytes that are no text, as a flipped bit does.
    pub(in crate::service) async fn damage_text(&self, column: &str, of: &str) {
        let mut tx = self.writer.begin().await.expect("a transaction");
        let damage = format!("UPDATE {column} = CAST(x'7bff7d' AS TEXT) WHERE {of}");
        let damaged = QueryBuilder::<Sqlite>::new(damage).build().execute(&mut *tx).await.expect("damaged");
        assert_eq!(damaged.rows_affected(), 1);
        tx.commit().await.expect("committed");
    }

    /// Deletes a mesh in a transaction that is committed after `meanwhile`: until then all read the mesh, and nobody writes.
    pub(in crate::service) async fn delete_mesh_after(&self, mesh: MeshId, meanwhile: impl Future<Output = ()>) {
        let mut tx = self.writer.begin().await.expect("a transaction");
        sqlx::query("DELETE FROM mesh WHERE id = ?1").bind(mesh.to_string()).execute(&mut *tx).await.expect("deleted");
        meanwhile.await;
        tx.commit().await.expect("committed");
    }

    /// Stores result files whatever room there is.
    pub(in crate::service) async fn put_artifacts(&self, artifacts: Arc<Vec<Artifact>>) -> Result<StoredArtifacts, Error> {
        self.put_artifacts_if(artifacts, |_| Ok(())).await
    }

    /// Inserts a job of its own.
    async fn submit_one(&self, new: &NewJob) -> Result<Job, Error> {
        self.submit(new, None, ROOM).await
    }
}

async fn submit(store: &Store, mesh: MeshId) -> JobId {
    store.submit_one(&new_job(mesh, 0)).await.expect("a job").id
}

async fn succeed(store: &Store, id: JobId, files: Vec<(&'static str, Vec<u8>)>) -> JobState {
    let artifacts = files.into_iter().map(|(name, bytes)| Artifact { name: name.into(), bytes }).collect();
    let stored = store.put_artifacts(Arc::new(artifacts)).await.expect("files");
    let outcome = AttemptOutcome::Succeeded { files: stored.files.clone(), summary: None, warnings: Vec::new() };
    store.end_attempt(id, &outcome, "{}").await.expect("an end")
}

fn exhausted() -> JobProblem {
    JobProblem { kind: String::new(), title: String::new(), detail: String::new(), code: "exhausted".into(), errors: vec![] }
}

async fn kinds(store: &Store, id: JobId) -> Vec<EventKind> {
    store.events_after(Some(id), 0, 1000).await.expect("events").events.iter().map(|event| event.kind).collect()
}

fn stored_files(opened: &Opened) -> usize {
    opened.store.files().list().expect("a list").len()
}

#[tokio::test]
async fn the_same_upload_is_the_same_mesh() {
    let opened = open().await;
    let (a, b, c) =
        (add_mesh(&opened.store, b"one").await, add_mesh(&opened.store, b"one").await, add_mesh(&opened.store, b"two").await);
    assert_eq!(UploadedMesh { created_at: a.created_at.clone(), ..b.clone() }, a, "but for the time of the upload");
    assert!(b.created_at >= a.created_at);
    assert_ne!(a.id, c.id);
    assert_eq!(stored_files(&opened), 2);
    let opened = opened.reopen().await;
    assert_eq!(opened.store.mesh(a.id).await.expect("kept"), b);
    assert_eq!(opened.store.files().read(&a.sha256).expect("its bytes"), b"one");
}

#[tokio::test]
async fn highest_priority_goes_first_and_then_the_oldest() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let mut ids = Vec::new();
    for priority in [0, 5, 0, 5] {
        ids.push(store.submit_one(&new_job(mesh, priority)).await.expect("a job").id);
    }
    assert_eq!(store.job(ids[2]).await.expect("it").queue_position, Some(4));
    let mut claimed = Vec::new();
    while let Some(attempt) = store.claim_next().await.expect("the queue") {
        claimed.push(attempt.id);
    }
    assert_eq!(claimed, [ids[1], ids[3], ids[0], ids[2]]);
    assert_eq!(store.job(ids[2]).await.expect("it").queue_position, None);
}

#[tokio::test]
async fn a_process_that_died_leaves_jobs_that_start_again_until_it_is_their_fault() {
    let mut opened = open().await;
    let mesh = add_mesh(&opened.store, b"one").await.id;
    let id = submit(&opened.store, mesh).await;
    for attempt in 1..=3 {
        assert_eq!(opened.store.claim_next().await.expect("the queue").expect("a job").number, attempt);
        opened = opened.reopen().await;
        assert_eq!(opened.store.recover(3, &exhausted()).await.expect("order"), 1);
        let job = opened.store.job(id).await.expect("it");
        assert_eq!(job.attempts, attempt);
        assert_eq!(job.state, if attempt < 3 { JobState::Queued } else { JobState::Failed });
    }
    let job = opened.store.job(id).await.expect("it");
    assert_eq!(job.problem.expect("the reason").code, "exhausted");
    assert!(job.ended_at.is_some());
    use EventKind::{Failed, Queued, Started};
    assert_eq!(kinds(&opened.store, id).await, [Queued, Started, Queued, Started, Queued, Started, Failed]);
}

#[tokio::test]
async fn a_cancellation_outlives_the_process() {
    let opened = open().await;
    let mesh = add_mesh(&opened.store, b"one").await.id;
    let id = submit(&opened.store, mesh).await;
    opened.store.claim_next().await.expect("the queue").expect("a job");
    assert_eq!(opened.store.cancel(id).await.expect("it").state, JobState::Cancelling);
    let opened = opened.reopen().await;
    opened.store.recover(3, &exhausted()).await.expect("order");
    assert_eq!(opened.store.job(id).await.expect("it").state, JobState::Cancelled);
}

#[tokio::test]
async fn an_interrupted_attempt_does_not_count() {
    let opened = open().await;
    let store = &opened.store;
    let id = submit(store, add_mesh(store, b"one").await.id).await;
    for _ in 0..5 {
        assert_eq!(store.claim_next().await.expect("the queue").expect("a job").number, 1);
        assert_eq!(store.end_attempt(id, &AttemptOutcome::Interrupted, "{}").await.expect("an end"), JobState::Queued);
    }
    assert_eq!(store.job(id).await.expect("it").attempts, 0);
}

#[tokio::test]
async fn a_cancelled_job_never_succeeds() {
    let opened = open().await;
    let store = &opened.store;
    let id = submit(store, add_mesh(store, b"one").await.id).await;
    store.claim_next().await.expect("the queue").expect("a job");
    store.cancel(id).await.expect("cancelling");
    assert_eq!(succeed(store, id, vec![("plan.json", b"{}".to_vec())]).await, JobState::Cancelled);
    let job = store.job(id).await.expect("it");
    assert_eq!((job.state, job.results.len()), (JobState::Cancelled, 0));
    assert!(matches!(store.result(id, "plan.json").await, Err(Error::NoResults { state: JobState::Cancelled, .. })));
}

#[tokio::test]
async fn files_live_as_long_as_something_names_them() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let (a, b) = (submit(store, mesh).await, submit(store, mesh).await);
    assert!(matches!(store.delete_mesh(mesh, 0).await, Err(Error::MeshInUse(_))));
    for id in [a, b] {
        assert!(matches!(store.delete_job(id, "hold", None).await, Err(Error::JobNotEnded { .. })));
        store.claim_next().await.expect("the queue").expect("a job");
        succeed(store, id, vec![("plan.json", b"shared".to_vec()), ("report.txt", id.to_string().into_bytes())]).await;
    }
    assert_eq!(stored_files(&opened), 4);
    store.delete_mesh(mesh, 0).await.expect("free");
    assert_eq!(stored_files(&opened), 4, "the jobs' inspections and runs read the file of the mesh");
    store.delete_job(a, "hold", None).await.expect("ended");
    assert_eq!(stored_files(&opened), 3);
    assert_eq!(store.result(b, "plan.json").await.expect("kept").result.size_bytes, 6);
    store.delete_job(b, "hold", None).await.expect("ended");
    assert_eq!(stored_files(&opened), 0);
    assert_eq!(kinds(store, b).await.last(), Some(&EventKind::Deleted));
}

#[tokio::test]
async fn a_job_that_is_inspected_or_run_is_not_deleted() {
    let opened = open().await;
    let store = &opened.store;
    let id = submit(store, add_mesh(store, b"one").await.id).await;
    store.claim_next().await.expect("the queue").expect("a job");
    succeed(store, id, vec![("plan.json", b"{}".to_vec())]).await;
    let everything =
        Policy { job_days: 0, jobs_per_part: 0, unused_mesh_days: 0, run_days: 0, max_bytes: 1, hold_label: "hold".into() };
    for (open, ended) in [
        (
            "INSERT INTO inspection (id, job_id, state, body, input) VALUES ('i', ?1, 'running', '', '')",
            "UPDATE inspection SET state = 'failed'",
        ),
        (
            "INSERT INTO run (id, job_id, cell, mode, state, body) VALUES ('r', ?1, 'c', 'live', 'paused', '')",
            "UPDATE run SET state = 'stopped'",
        ),
    ] {
        sqlx::query(open).bind(id.to_string()).execute(&store.reader).await.expect("a row");
        assert!(matches!(store.delete_job(id, "hold", None).await, Err(Error::JobInUse(_))), "{open}");
        assert_eq!(store.due(&everything).await.expect("a list").jobs, [], "{open}");
        sqlx::query(ended).execute(&store.reader).await.expect("a row");
    }
    assert_eq!(store.due(&everything).await.expect("a list").jobs.len(), 1);
    store.delete_job(id, "hold", None).await.expect("idle");
}

#[tokio::test]
async fn two_processes_do_not_share_a_folder() {
    let opened = open().await;
    assert!(matches!(Store::open(opened.folder.path()).await, Err(OpenError::InUse(_))));
    // Some file systems cannot lock a folder.
    if opened.store._in_use._folder.is_some() {
        std::fs::remove_file(opened.folder.path().join("in-use")).expect("removed");
        assert!(matches!(Store::open(opened.folder.path()).await, Err(OpenError::InUse(_))));
    }
}

/// The refusal was "File exists".
#[tokio::test]
async fn a_file_in_the_place_of_the_data_folder_is_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    std::fs::write(&data, b"notes").expect("a file");
    let told = Store::open(&data).await.err().expect("no folder").to_string();
    assert!(told.starts_with(&format!("{} is a file, and", data.display())) && told.contains("--data"), "{told}");
    assert_eq!(std::fs::read(&data).expect("the file"), b"notes");
    // Below a file it was "Not a directory".
    let below = data.join("sub/store");
    let told = Store::open(&below).await.err().expect("no folder").to_string();
    let wanted = format!("{} is a file, and the data folder {} cannot lie below it", data.display(), below.display());
    assert!(told.starts_with(&wanted) && told.contains("name another with --data"), "{told}");
}

#[tokio::test]
async fn a_full_disk_takes_the_reserve_before_the_start_is_given_up() {
    let folder = tempfile::tempdir().expect("a folder");
    let (data, reserve) = (folder.path(), folder.path().join(RESERVE));
    let full = || OpenError::Folder { path: "data".into(), source: ErrorKind::StorageFull.into() };
    let with_room = || std::future::ready(if reserve.exists() { Err(full()) } else { Ok(()) });
    std::fs::write(&reserve, b"room").expect("a file");
    giving_up_reserve(data, with_room).await.expect("there is room then");
    std::fs::write(&reserve, b"room").expect("a file");
    for _ in 0..2 {
        let error = giving_up_reserve(data, || std::future::ready(Err::<(), _>(full()))).await.expect_err("full");
        assert!(matches!(&error, OpenError::DiskFull { .. }) && error.to_string().contains("is full"), "{error}");
    }
    std::fs::write(&reserve, b"room").expect("a file");
    let other = || std::future::ready(Err::<(), _>(OpenError::InUse("data".into())));
    assert!(matches!(giving_up_reserve(data, other).await, Err(OpenError::InUse(_))));
    assert!(reserve.exists(), "only a full disk takes it");
}

/// The folder for temporary files may be read-only.
#[tokio::test]
async fn sorts_stay_in_memory() {
    let opened = open().await;
    let store = &opened.store;
    let read: i64 = sqlx::query_scalar("PRAGMA temp_store").fetch_one(&store.reader).await.expect("a number");
    let mut tx = store.writer.begin().await.expect("a transaction");
    let written: i64 = sqlx::query_scalar("PRAGMA temp_store").fetch_one(&mut *tx).await.expect("a number");
    assert_eq!((read, written), (2, 2));
}

#[tokio::test]
async fn a_store_of_a_later_version_is_refused() {
    let opened = open().await;
    sqlx::query("UPDATE _sqlx_migrations SET version = 99 WHERE version = 2").execute(&opened.store.reader).await.expect("done");
    let Opened { store, folder } = opened;
    drop(store);
    let refused = Store::open(folder.path()).await.err().expect("refused");
    let said = refused.to_string();
    assert!(matches!(refused, OpenError::Newer { .. }) && said.contains(&folder.path().display().to_string()), "{said}");
    assert!(said.contains("a newer release of Vantage") && said.contains("restore a backup"), "{said}");
}

#[tokio::test]
async fn an_idempotency_key_lasts_a_day() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let with = async |request: &str| store.submit(&new_job(mesh, 0), Some(&IdempotencyKey::new("key", request)), ROOM).await;
    let first = with("a").await.expect("a job");
    store.claim_next().await.expect("the queue").expect("it runs");
    // The earlier answer, although the job has changed since.
    assert_eq!(with("a").await.expect("the same"), first);
    assert!(matches!(with("b").await, Err(Error::IdempotencyMismatch)));
    let back = "UPDATE idempotency SET created_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-25 hours')";
    sqlx::query(back).execute(&store.reader).await.expect("a day passes");
    assert_ne!(with("b").await.expect("another job").id, first.id);
}

#[tokio::test]
async fn a_queued_job_gets_another_place_and_no_other_job_does() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let (running, first, second) = (submit(store, mesh).await, submit(store, mesh).await, submit(store, mesh).await);
    assert_eq!(store.claim_next().await.expect("the queue").expect("a job").id, running);
    let job = store.put_priority(second, 7).await.expect("moved");
    assert_eq!((job.priority, job.queue_position), (7, Some(1)));
    assert_eq!(store.job(first).await.expect("it").queue_position, Some(2));
    assert_eq!(kinds(store, second).await, [EventKind::Queued, EventKind::Queued]);
    assert!(matches!(store.put_priority(running, 7).await, Err(Error::JobNotQueued { state: JobState::Running, .. })));
    assert_eq!(store.job(running).await.expect("it").priority, 0);
    assert_eq!(store.claim_next().await.expect("the queue").expect("a job").id, second);
}

#[tokio::test]
async fn the_queue_has_its_limit() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let limited = async || store.submit(&new_job(mesh, 0), None, 1).await;
    limited().await.expect("room");
    assert!(matches!(limited().await, Err(Error::QueueFull { queued: 1, asked: 1, limit: 1 })));
    store.claim_next().await.expect("the queue").expect("a job");
    limited().await.expect("room again");
}

#[tokio::test]
async fn old_events_go_but_not_those_of_open_jobs() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let ended = submit(store, mesh).await;
    store.claim_next().await.expect("the queue").expect("a job");
    succeed(store, ended, vec![]).await;
    let waiting = submit(store, mesh).await;
    let back = "UPDATE event SET at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-3 hours')";
    sqlx::query(back).execute(&store.reader).await.expect("hours pass");
    store.prune_events(4).await.expect("nothing is old enough");
    assert_eq!(kinds(store, ended).await.len(), 3);
    store.prune_events(2).await.expect("all are");
    assert_eq!(kinds(store, ended).await, []);
    assert_eq!(kinds(store, waiting).await, [EventKind::Queued]);
    assert!(store.is_pruned_after(2).await.expect("known"));
    assert!(!store.is_pruned_after(3).await.expect("known"));
    // Numbering continues.
    let next = submit(store, mesh).await;
    assert_eq!(store.events_after(Some(next), 0, 1).await.expect("events").events[0].id, 5);
}

#[tokio::test]
async fn a_version_is_never_given_twice() {
    let opened = open().await;
    let store = &opened.store;
    let put = async |only_if: Precondition| store.put_spec(SpecCollection::Robot, "r", "{}", &only_if).await;
    let first = put(Precondition::None).await.expect("new");
    assert!(first.created);
    assert!(matches!(put(Precondition::None).await, Err(Error::PreconditionRequired { etag, .. }) if etag == first.etag));
    assert!(matches!(put(Precondition::Absent).await, Err(Error::PreconditionFailed(Some(_)))));
    let second = put(Precondition::Match(vec![first.etag.clone()])).await.expect("replaced");
    assert!(!second.created);
    assert!(matches!(put(Precondition::Match(vec![first.etag.clone()])).await, Err(Error::PreconditionFailed(_))));
    store.put_spec(SpecCollection::Cell, "c", r#"{"robot": "r"}"#, &Precondition::None).await.expect("a cell");
    let named = store.delete_spec(SpecCollection::Robot, "r", &Precondition::None).await;
    assert!(matches!(named, Err(Error::SpecInUse { cell, .. }) if cell == "c"));
    store.delete_spec(SpecCollection::Cell, "c", &Precondition::None).await.expect("gone");
    store.delete_spec(SpecCollection::Robot, "r", &Precondition::None).await.expect("gone");
    assert!(matches!(put(Precondition::Match(vec![])).await, Err(Error::PreconditionFailed(None))));
    let third = put(Precondition::Absent).await.expect("new again");
    assert!(![first.etag, second.etag].contains(&third.etag));
}

#[tokio::test]
async fn a_specification_names_only_what_is_there_when_it_is_stored() {
    let opened = open().await;
    let store = &opened.store;
    let put = async |body: String| store.put_spec(SpecCollection::Cell, "c", &body, &Precondition::Absent).await;
    let mesh = add_mesh(store, b"one").await.id;
    let cell = |robot: &str| {
        format!(
            r#"{{"robot": "{robot}", "scanner": "transcan-c", "turntable": {{"name": "t"}}, "obstacles": [{{"mesh": "{mesh}"}}]}}"#
        )
    };
    let unknown = put(cell("r")).await;
    assert!(matches!(&unknown, Err(Error::SpecNotFound { kind: SpecCollection::Robot, name }) if name == "r"), "{unknown:?}");
    store.delete_mesh(mesh, 0).await.expect("free");
    let gone = put(cell("hans-e05")).await;
    assert!(matches!(gone, Err(Error::MeshNotFound(id)) if id == mesh), "{gone:?}");
    let other = add_mesh(store, b"two").await.id;
    put(cell("hans-e05").replace(&mesh.to_string(), &other.to_string().to_uppercase())).await.expect("all are there");
    // `vantage robot --surfaces` writes files into a robot, which are looked up where a cell takes the robot.
    let robot = r#"{"surfaces": [{"shape": {"kind": "mesh", "mesh": "links/00.stl"}}]}"#;
    store.put_spec(SpecCollection::Robot, "r", robot, &Precondition::Absent).await.expect("stored");
}

/// A list of large specifications takes no more memory than their names.
#[tokio::test]
async fn a_list_of_specifications_reads_none_of_them() {
    let opened = open().await;
    let store = &opened.store;
    let stored = store.put_spec(SpecCollection::Robot, "r", "{}", &Precondition::None).await.expect("new");
    store.damage_text("spec SET body", "name = 'r'").await;
    assert_eq!(store.specs(SpecCollection::Robot).await.expect("a list"), [("r".to_owned(), stored.etag)]);
    assert!(store.spec(SpecCollection::Robot, "r").await.is_err());
}

#[tokio::test]
async fn what_a_job_lacks_is_told_with_the_way_to_get_it() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let claimed = async |cell: &str| {
        let request = JobRequest { cell: Named::Name(cell.to_owned()), ..JobRequest::new(mesh) };
        let id = store.submit_one(&NewJob { request, ..new_job(mesh, 0) }).await.expect("a job").id;
        store.claim_next().await.expect("the queue").expect("the job");
        id
    };
    let told = async |id: JobId, name: &str| store.result(id, name).await.expect_err("there is none").to_string();
    let (without_cell, in_cell) = (claimed("none").await, claimed("e05-transcan").await);
    for id in [without_cell, in_cell] {
        succeed(store, id, vec![("plan.json", b"{}".to_vec())]).await;
    }
    for name in ["program.json", "program.mod"] {
        let said = told(without_cell, name).await;
        assert!(said.contains(&format!("has no {name}; it was planned without a cell")), "{said}");
        assert_eq!(told(in_cell, name).await, format!("job {in_cell} has no {name}"));
    }
    assert!(told(in_cell, "candidates.json").await.contains("params.output.candidates"));
    let mut params = PlanParams::default();
    params.output.candidates = true;
    let request = JobRequest { params, ..JobRequest::new(mesh) };
    let listed = store.submit_one(&NewJob { request, ..new_job(mesh, 0) }).await.expect("a job").id;
    store.claim_next().await.expect("the queue").expect("the job");
    succeed(store, listed, vec![("plan.json", b"{}".to_vec())]).await;
    let said = told(listed, "candidates.json").await;
    assert!(said.ends_with("it would have been too large: what to do stands in warnings of the job"), "{said}");
    assert_eq!(told(without_cell, "nothing").await, format!("job {without_cell} has no nothing"));
    let failed = claimed("none").await;
    let report = Artifact { name: "report.txt".into(), bytes: b"no plan".to_vec() };
    let stored = store.put_artifacts(Arc::new(vec![report])).await.expect("files");
    let problem = JobProblem { code: "no_plan".into(), ..exhausted() };
    store.end_attempt(failed, &AttemptOutcome::Failed(problem, stored.files.clone()), "{}").await.expect("an end");
    let said = told(failed, "plan.json").await;
    assert!(said.contains(&format!("is failed (no_plan, see /api/v1/jobs/{failed}/report); only")), "{said}");
    let crashed = claimed("none").await;
    store.end_attempt(crashed, &AttemptOutcome::Failed(exhausted(), Vec::new()), "{}").await.expect("an end");
    let said = store.no_results(crashed, JobState::Failed).await.to_string();
    assert!(said.contains(&format!("(exhausted, see /api/v1/jobs/{crashed});")), "{said}");
}

#[tokio::test]
async fn a_deleted_job_that_had_succeeded_is_not_said_to_be_at_its_beginning() {
    let opened = open().await;
    let store = &opened.store;
    let id = submit(store, add_mesh(store, b"one").await.id).await;
    store.claim_next().await.expect("the queue").expect("a job");
    succeed(store, id, Vec::new()).await;
    store.delete_job(id, "hold", None).await.expect("ended");
    let events = store.events_after(Some(id), 0, 100).await.expect("events").events;
    let done: Vec<_> = events.iter().map(|event| (event.kind, event.fraction > 0.5)).collect();
    assert_eq!(
        done,
        [(EventKind::Queued, false), (EventKind::Started, false), (EventKind::Succeeded, true), (EventKind::Deleted, true)]
    );
}

#[tokio::test]
async fn the_events_of_a_job_that_ends_tell_how_far_it_came_as_the_job_does() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    for (outcome, kind) in
        [(AttemptOutcome::Failed(exhausted(), Vec::new()), EventKind::Failed), (AttemptOutcome::Cancelled, EventKind::Cancelled)]
    {
        let id = submit(store, mesh).await;
        store.claim_next().await.expect("the queue").expect("a job");
        store.record_progress(id, "views", 0.75, "{}").await.expect("noted");
        if kind == EventKind::Cancelled {
            store.cancel(id).await.expect("running");
        }
        store.end_attempt(id, &outcome, "{}").await.expect("an end");
        let fraction = store.job(id).await.expect("it").fraction;
        store.delete_job(id, "hold", None).await.expect("ended");
        let events = store.events_after(Some(id), 0, 100).await.expect("events").events;
        let after_progress = events.iter().filter(|event| !matches!(event.kind, EventKind::Queued | EventKind::Started));
        let told: Vec<f64> = after_progress.map(|event| event.fraction).collect();
        assert!(fraction.to_bits() == 0.75_f64.to_bits() && told.len() >= 3, "{kind:?}: {fraction} {told:?}");
        assert!(told.iter().all(|told| told.to_bits() == fraction.to_bits()), "{kind:?}: {told:?}");
    }
}

/// Clients send the parameters of a job again as they are shown, and beside a preset what it sets otherwise is refused.
#[tokio::test]
async fn a_job_is_shown_with_what_its_preset_sets() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let params = PlanParams { preset: Preset::Thesis, ..PlanParams::default() };
    let request = JobRequest { params: params.clone(), ..JobRequest::new(mesh) };
    let job = store.submit_one(&NewJob { request, ..new_job(mesh, 0) }).await.expect("a job");
    assert_eq!(job.params, Preset::Thesis.apply(&params));
    assert_eq!(store.job(job.id).await.expect("it").params, job.params);
}

/// Results that were left on a full disk took the room that others needed.
#[tokio::test]
async fn of_results_that_cannot_all_be_stored_none_is_left() {
    let opened = open().await;
    let store = &opened.store;
    add_mesh(store, b"one").await;
    let last = b"blocked".to_vec();
    let path = store.files().path(&hex(&Sha256::digest(&last)));
    std::fs::write(path.parent().expect("a folder"), b"in its way").expect("a file");
    let artifacts = [b"one".to_vec(), b"first".to_vec(), last];
    let artifacts = artifacts.map(|bytes| Artifact { name: "coverage.bin".into(), bytes });
    store.put_artifacts(Arc::new(artifacts.into())).await.expect_err("no folder for the last");
    assert_eq!(stored_files(&opened), 1, "what was there before stays");
}

/// Files for which there was no room filled the disk again and again.
#[tokio::test]
async fn results_are_stored_if_there_is_room_for_the_files_that_are_new() {
    let opened = open().await;
    let store = &opened.store;
    add_mesh(store, b"one").await;
    let artifacts = [b"one".to_vec(), b"first".to_vec(), b"first".to_vec(), vec![b' '; 1 << 16]];
    let artifacts = Arc::new(artifacts.map(|bytes| Artifact { name: "coverage.bin".into(), bytes }).to_vec());
    let (sender, asked) = std::sync::mpsc::channel();
    let no_room = move |new_bytes: u64| {
        sender.send(new_bytes).expect("a number");
        Err(Error::StorageFull)
    };
    let refused = store.put_artifacts_if(Arc::clone(&artifacts), no_room).await;
    assert!(matches!(refused, Err(Error::StorageFull)), "{refused:?}");
    assert_eq!(stored_files(&opened), 1, "nothing is written");
    let stored = store.put_artifacts(artifacts).await.expect("there is room");
    let spaces = &stored.files[3];
    assert_eq!(spaces.encoding, FileEncoding::Gzip);
    assert_eq!(asked.recv().expect("a number"), 5 + spaces.file_bytes, "each new file once, as it is stored");
}

/// The file was listed with its hash and size, and no route gave it.
#[tokio::test]
async fn the_file_that_further_views_are_planned_from_is_stored_and_not_listed() {
    let opened = open().await;
    let store = &opened.store;
    let running = InspectionJob {
        id: InspectionId::generate(),
        job_id: submit(store, add_mesh(store, b"one").await.id).await,
        state: JobState::Running,
        scans: Vec::new(),
        run_id: None,
        params: InspectionParams::default(),
        fraction: 0.0,
        submitted_by: None,
        created_at: String::new(),
        ended_at: None,
        summary: None,
        // As earlier releases stored it.
        files: vec![JobFile { name: RESCAN_STATE_FILE.to_owned(), sha256: None, size_bytes: None }],
        problem: None,
    };
    let id = running.id;
    store.insert_inspection(&running, &StoredInspection { scans: Vec::new() }, None, 10).await.expect("an inspection");
    assert_eq!(store.inspection(id).await.expect("it").files, []);
    let files = [RESCAN_STATE_FILE, "inspection.json"].map(|name| Artifact { name: name.into(), bytes: b"{}".to_vec() });
    let stored = store.put_artifacts(Arc::new(files.into())).await.expect("files");
    let end = |job: &mut InspectionJob| job.state = JobState::Succeeded;
    let ended = store.change_inspection(id, &[JobState::Running], end, Some(&stored)).await.expect("an end");
    let names: Vec<&str> = ended.files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(names, ["inspection.json"]);
    assert_eq!(store.inspection(id).await.expect("it"), ended);
    store.inspection_file(id, RESCAN_STATE_FILE).await.expect("what further views need");
}

/// The run went on without its job.
#[tokio::test]
async fn no_run_begins_of_a_job_that_was_deleted_since_its_program_was_read() {
    let opened = open().await;
    let store = &opened.store;
    let id = submit(store, add_mesh(store, b"one").await.id).await;
    store.claim_next().await.expect("the queue").expect("a job");
    succeed(store, id, vec![("plan.json", b"{}".to_vec())]).await;
    let run = |state| Run { state, ..Run::new(&RunRequest::new(id), Some(id), "cell", &no_steps(), "") };
    store.insert_run(&run(ReportedState::Done), None, 8).await.expect("its job is there");
    store.delete_job(id, "hold", None).await.expect("idle");
    let refused = store.insert_run(&run(ReportedState::Preparing), None, 8).await;
    assert!(matches!(refused, Err(Error::JobNotFound(gone)) if gone == id));
    assert_eq!(store.open_run_ids().await.expect("a list"), []);
}

/// The clock was set back between two processes: what came last went before what had waited, in the queue and in lists.
#[tokio::test]
async fn new_ids_follow_those_of_the_store_whatever_the_clock_said_then() {
    let opened = open().await;
    let mesh = add_mesh(&opened.store, b"one").await.id;
    let id = JobId::generate().to_string();
    let millis = u64::from_str_radix(&[&id[..8], &id[9..13]].concat(), 16).expect("digits") + 3_600_000;
    let digits = format!("{millis:012x}");
    let ahead = format!("{}-{}{}", &digits[..8], &digits[8..], &id[13..]);
    for id in [ahead.as_str(), "zz is none"] {
        sqlx::query("INSERT INTO job (id, state, mesh_id, labels, priority) VALUES (?1, 'queued', ?2, '{}', 0)")
            .bind(id)
            .bind(mesh.to_string())
            .execute(&opened.store.reader)
            .await
            .expect("a row");
    }
    let opened = opened.reopen().await;
    let after = [submit(&opened.store, mesh).await, submit(&opened.store, mesh).await].map(|id| id.to_string());
    let queue = opened.store.queue(9).await.expect("ids");
    assert_eq!(queue, [ahead.as_str(), &after[0], &after[1], "zz is none"]);
}

#[tokio::test]
async fn nothing_ends_before_it_began_though_the_clock_was_set_back() {
    let opened = open().await;
    let store = &opened.store;
    let began = "2999-01-01T00:00:00.000Z".to_owned();
    let id = submit(store, add_mesh(store, b"one").await.id).await;
    sqlx::query("UPDATE job SET created_at = ?1").bind(&began).execute(&store.reader).await.expect("a row");
    store.claim_next().await.expect("the queue").expect("a job");
    store.end_attempt(id, &AttemptOutcome::Cancelled, "{}").await.expect("an end");
    let job = store.job(id).await.expect("it");
    assert_eq!((job.started_at, job.ended_at), (Some(began.clone()), Some(began.clone())));
    let run = Run::new(&RunRequest::new(id), None, "cell", &no_steps(), "");
    let (run, _) = store.insert_run(&run, None, 8).await.expect("stored");
    let mut run = Run { created_at: began.clone(), state: ReportedState::Stopped, ..run };
    store.update_run(&mut run, RunEventKind::State, (0, &[])).await.expect("an end");
    assert_eq!(store.run(run.id).await.expect("it").ended_at, Some(began));
}
