//! Rows of jobs: how they are inserted, changed from outside and deleted. What becomes of them in between is in `attempts.rs`.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Serialize;
use serde::de::DeserializeOwned;
use sqlx::SqliteConnection;

use super::Store;
use super::events::{self, EventBody};
use super::idempotency::IdempotencyKey;
use super::job_rows::{fetch, fraction_of, state_of};
use super::runs::not_ended;
use super::stored::VERSION;
use crate::cell::Named;
use crate::service::error::{Error, InternalError};
use crate::service::failpoint;
use crate::wire::warnings::FieldWarning;
use crate::wire::{EventKind, Job, JobBatch, JobEvent, JobId, JobRequest, JobState, MeshId};

/// SQL condition of a job of which an inspection or a run is open.
macro_rules! is_used {
    () => {
        concat!(
            "(EXISTS (SELECT 1 FROM inspection WHERE job_id = job.id AND inspection.state IN ('queued', 'running', 'cancelling'))
              OR EXISTS (SELECT 1 FROM run WHERE job_id = job.id AND ",
            not_ended!(),
            "))"
        )
    };
}
pub(super) use is_used;

/// A job to be inserted.
pub(crate) struct NewJob {
    pub request: JobRequest,
    /// Planning input, every name resolved, as JSON.
    pub input: String,
    /// Meshes that it reads.
    pub meshes: Vec<MeshId>,
    /// Warnings on what was accepted, for lists.
    pub warnings: Vec<FieldWarning>,
    /// Name of the key that its sender presented.
    pub submitted_by: Option<String>,
    /// Job whose scans it plans further views for, and whose files of meshes it reads: the meshes may have been deleted since.
    pub scanned: Option<JobId>,
}

impl Store {
    /// Inserts a job, its idempotency key and its first event in one transaction; or returns the earlier answer to the
    /// same request.
    pub(crate) async fn submit(
        &self,
        new: &NewJob,
        idempotency: Option<&IdempotencyKey>,
        queue_limit: u64,
    ) -> Result<Job, Error> {
        self.insert_all(std::slice::from_ref(new), idempotency, queue_limit, |jobs| jobs.into_iter().next()).await
    }

    /// Inserts jobs, their idempotency key and their first events in one transaction; or returns the earlier answer to the same
    /// request.
    pub(crate) async fn submit_batch(
        &self,
        jobs: &[NewJob],
        idempotency: Option<&IdempotencyKey>,
        queue_limit: u64,
    ) -> Result<JobBatch, Error> {
        self.insert_all(jobs, idempotency, queue_limit, |jobs| Some(JobBatch { jobs })).await
    }

    async fn insert_all<T: Serialize + DeserializeOwned>(
        &self,
        new: &[NewJob],
        idempotency: Option<&IdempotencyKey>,
        queue_limit: u64,
        answer: impl FnOnce(Vec<Job>) -> Option<T>,
    ) -> Result<T, Error> {
        let mut tx = self.writer.begin().await?;
        if let Some(key) = idempotency
            && let Some(answer) = key.replay(&mut tx, &self.clock).await?
        {
            tx.commit().await?;
            return Ok(answer);
        }
        check_queue_limit(&mut tx, new.len() as u64, queue_limit).await?;
        let mut inserted = Vec::with_capacity(new.len());
        for job in new {
            inserted.push(insert_queued(&mut tx, job).await?);
        }
        let mut jobs = Vec::with_capacity(new.len());
        for (id, _) in &inserted {
            jobs.push(fetch(&mut tx, *id).await?);
        }
        let answer = answer(jobs).ok_or_else(|| InternalError::Row("no job was inserted".to_owned()))?;
        if let Some(key) = idempotency {
            key.record(&mut tx, &answer).await?;
        }
        let _in_order = tx.commit_and_keep_lock().await?;
        failpoint::hit("job", "inserted");
        inserted.into_iter().for_each(|(_, event)| self.publish(event));
        Ok(answer)
    }

    /// Earlier answer to this request, if any.
    pub(crate) async fn replay<T: DeserializeOwned>(&self, key: &IdempotencyKey) -> Result<Option<T>, Error> {
        key.answer(&mut *self.reader.acquire().await?, &self.clock).await
    }

    /// One job.
    pub(crate) async fn job(&self, id: JobId) -> Result<Job, Error> {
        fetch(&mut *self.reader.acquire().await?, id).await
    }

    /// State of a job.
    pub(crate) async fn job_state(&self, id: JobId) -> Result<JobState, Error> {
        state_of(&mut *self.reader.acquire().await?, id).await
    }

    /// Number of jobs in a state.
    pub(crate) async fn count_jobs(&self, state: JobState) -> Result<u64, Error> {
        let count: i64 =
            sqlx::query_scalar("SELECT count(*) FROM job WHERE state = ?1").bind(state.as_str()).fetch_one(&self.reader).await?;
        Ok(count.unsigned_abs())
    }

    /// Deletes an ended job with its results, scans and inspections, unless it has the label `hold`, or an inspection or a run of it has
    /// not ended. The event carries `code`, the reason.
    pub(crate) async fn delete_job(&self, id: JobId, hold: &str, code: Option<&str>) -> Result<(), Error> {
        let orphans = {
            let mut tx = self.writer.begin().await?;
            let state = state_of(&mut tx, id).await?;
            if !state.is_ended() {
                return Err(Error::JobNotEnded { job: id, state });
            }
            check_hold(&mut tx, id, hold).await?;
            check_idle(&mut tx, id).await?;
            let orphans: Vec<String> = sqlx::query_scalar(
                "SELECT file_sha256 FROM artifact WHERE job_id = ?1 UNION SELECT sha256 FROM scan WHERE job_id = ?1
                 UNION SELECT sha256 FROM job_mesh WHERE job_id = ?1 AND sha256 <> ''
                 UNION SELECT file_sha256 FROM inspection_file JOIN inspection ON inspection.id = inspection_id WHERE job_id = ?1",
            )
            .bind(id.to_string())
            .fetch_all(&mut *tx)
            .await?;
            let deleted =
                sqlx::query("DELETE FROM job WHERE id = ?1 RETURNING fraction").bind(id.to_string()).fetch_one(&mut *tx).await?;
            let body = EventBody { code, ..EventBody::state(EventKind::Deleted, state, fraction_of(&deleted)) };
            let event = events::append(&mut tx, id, body).await?;
            let _in_order = tx.commit_and_keep_lock().await?;
            self.publish(event);
            orphans
        };
        self.remove_unreferenced(orphans).await
    }

    /// Gives a queued job another priority.
    pub(crate) async fn put_priority(&self, id: JobId, priority: i32) -> Result<Job, Error> {
        let mut tx = self.writer.begin().await?;
        let state = state_of(&mut tx, id).await?;
        if state != JobState::Queued {
            return Err(Error::JobNotQueued { job: id, state });
        }
        sqlx::query("UPDATE job SET priority = ?2 WHERE id = ?1").bind(id.to_string()).bind(priority).execute(&mut *tx).await?;
        let event = events::append(&mut tx, id, EventBody::state(EventKind::Queued, JobState::Queued, 0.0)).await?;
        let job = fetch(&mut tx, id).await?;
        let _in_order = tx.commit_and_keep_lock().await?;
        self.publish(event);
        Ok(job)
    }

    /// Replaces a job's labels. Its files keep the labels that it was submitted with.
    pub(crate) async fn put_labels(&self, id: JobId, labels: &BTreeMap<String, String>) -> Result<Job, Error> {
        let mut tx = self.writer.begin().await?;
        state_of(&mut tx, id).await?;
        sqlx::query("UPDATE job SET labels = ?2 WHERE id = ?1")
            .bind(id.to_string())
            .bind(serde_json::to_string(labels)?)
            .execute(&mut *tx)
            .await?;
        sqlx::query("DELETE FROM job_label WHERE job_id = ?1").bind(id.to_string()).execute(&mut *tx).await?;
        insert_labels(&mut tx, id, labels).await?;
        let job = fetch(&mut tx, id).await?;
        tx.commit().await?;
        Ok(job)
    }
}

/// Checks that the job does not have the label `hold`.
pub(super) async fn check_hold(tx: &mut SqliteConnection, id: JobId, label: &str) -> Result<(), Error> {
    let held: bool = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM job_label WHERE job_id = ?1 AND key = ?2)")
        .bind(id.to_string())
        .bind(label)
        .fetch_one(tx)
        .await?;
    if held { Err(Error::JobHeld { job: id, label: label.to_owned() }) } else { Ok(()) }
}

/// Checks that the job of an inspection or a scan does not have the label `hold`. The query selects the job's id by that of the
/// other; without a job, nothing is held.
pub(super) async fn check_hold_of(tx: &mut SqliteConnection, job_of: &'static str, id: String, label: &str) -> Result<(), Error> {
    let job: Option<Option<String>> = sqlx::query_scalar(job_of).bind(id).fetch_optional(&mut *tx).await?;
    match job.flatten().and_then(|job| job.parse::<JobId>().ok()) {
        Some(job) => check_hold(tx, job, label).await,
        None => Ok(()),
    }
}

/// Checks that no inspection and no run of the job is open: they read its plan, and a run is continued by it.
pub(super) async fn check_idle(tx: &mut SqliteConnection, id: JobId) -> Result<(), Error> {
    let in_use: bool = sqlx::query_scalar(concat!("SELECT EXISTS (SELECT 1 FROM job WHERE id = ?1 AND ", is_used!(), ")"))
        .bind(id.to_string())
        .fetch_one(tx)
        .await?;
    if in_use { Err(Error::JobInUse(id)) } else { Ok(()) }
}

/// Checks that the queue has room for so many more jobs.
async fn check_queue_limit(tx: &mut SqliteConnection, more: u64, limit: u64) -> Result<(), Error> {
    let queued: i64 =
        sqlx::query_scalar("SELECT count(*) FROM job INDEXED BY job_queue WHERE state = 'queued'").fetch_one(tx).await?;
    let queued = queued.unsigned_abs();
    if queued + more > limit { Err(Error::QueueFull { queued, asked: more, limit }) } else { Ok(()) }
}

/// Checks that the meshes still exist: one may have been deleted since the request was checked.
async fn check_meshes(tx: &mut SqliteConnection, meshes: &[MeshId]) -> Result<(), Error> {
    for mesh in meshes {
        let there: bool = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM mesh WHERE id = ?1)")
            .bind(mesh.to_string())
            .fetch_one(&mut *tx)
            .await?;
        if !there {
            return Err(Error::MeshNotFound(*mesh));
        }
    }
    Ok(())
}

/// Inserts a job with its first event.
async fn insert_queued(tx: &mut SqliteConnection, new: &NewJob) -> Result<(JobId, Arc<JobEvent>), Error> {
    check_meshes(tx, &new.meshes).await?;
    if let Some(scanned) = new.scanned {
        // Its files are there as long as it is.
        state_of(tx, scanned).await?;
    }
    failpoint::hit("job", "before_insert");
    let id = JobId::generate();
    insert(tx, id, new).await?;
    Ok((id, events::append(tx, id, EventBody::state(EventKind::Queued, JobState::Queued, 0.0)).await?))
}

async fn insert(tx: &mut SqliteConnection, id: JobId, new: &NewJob) -> Result<(), Error> {
    let request = &new.request;
    let scanner = request.scanner_or_default();
    sqlx::query(
        "INSERT INTO job (id, state, mesh_id, part_number, serial, cell, scanner, labels, priority, submitted_by, warnings)
         VALUES (?1, 'queued', ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)",
    )
    .bind(id.to_string())
    .bind(request.mesh_id.to_string())
    .bind(&request.part_number)
    .bind(&request.serial)
    .bind(name_of(&request.cell, |cell| &cell.name))
    .bind(name_of(&scanner, |scanner| &scanner.name))
    .bind(serde_json::to_string(&request.labels)?)
    .bind(request.priority)
    .bind(&new.submitted_by)
    .bind(serde_json::to_string(&new.warnings)?)
    .execute(&mut *tx)
    .await?;
    sqlx::query("INSERT INTO job_body (job_id, version, request, input) VALUES (?1, ?2, ?3, ?4)")
        .bind(id.to_string())
        .bind(VERSION)
        .bind(serde_json::to_string(request)?)
        .bind(&new.input)
        .execute(&mut *tx)
        .await?;
    insert_labels(tx, id, &request.labels).await?;
    for mesh in &new.meshes {
        sqlx::query(
            "INSERT OR IGNORE INTO job_mesh (job_id, mesh_id, sha256, size_bytes)
             SELECT ?1, id, sha256, size_bytes FROM mesh WHERE id = ?2",
        )
        .bind(id.to_string())
        .bind(mesh.to_string())
        .execute(&mut *tx)
        .await?;
    }
    if let Some(scanned) = new.scanned {
        sqlx::query(
            "INSERT OR IGNORE INTO job_mesh (job_id, mesh_id, sha256, size_bytes)
             SELECT ?1, mesh_id, sha256, size_bytes FROM job_mesh WHERE job_id = ?2",
        )
        .bind(id.to_string())
        .bind(scanned.to_string())
        .execute(&mut *tx)
        .await?;
    }
    Ok(())
}

async fn insert_labels(tx: &mut SqliteConnection, id: JobId, labels: &BTreeMap<String, String>) -> Result<(), Error> {
    for (key, value) in labels {
        sqlx::query("INSERT INTO job_label (key, value, job_id) VALUES (?1, ?2, ?3)")
            .bind(key)
            .bind(value)
            .bind(id.to_string())
            .execute(&mut *tx)
            .await?;
    }
    Ok(())
}

fn name_of<'a, T>(named: &'a Named<T>, own: impl Fn(&'a T) -> &'a String) -> &'a str {
    match named {
        Named::Name(name) => name,
        Named::Inline(spec) => own(spec),
    }
}
