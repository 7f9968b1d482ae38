//! Rows of jobs, and all transitions between their states:
//!
//! ```text
//! queued ──► running ──► succeeded | failed
//!   │ ▲         │ └────► queued (interrupted, or the process died; failed after the max number of attempts)
//!   │ └─────────┘
//!   ▼           ▼
//! cancelled ◄─ cancelling
//! ```
//! Every transition appends its event in the same transaction.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::de::DeserializeOwned;
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, SqliteConnection};

use super::artifacts::{self, ResultFile};
use super::events::{self, EventBody};
use super::idempotency::IdempotencyKey;
use super::stored::{VERSION, read_leniently};
use super::{Store, now, parsed, summaries};
use crate::cell::Named;
use crate::service::error::Error;
use crate::service::failpoint;
use crate::service::jobs::failure;
use crate::wire::summary::Summary;
use crate::wire::warnings::FieldWarning;
use crate::wire::{EventKind, Job, JobBatch, JobEvent, JobId, JobProblem, JobRequest, JobState, MeshId, warnings};

/// A job to be inserted.
pub(crate) struct NewJob {
    pub request: JobRequest,
    /// Planning input, every name resolved, as JSON.
    pub input: String,
    /// Meshes that it reads.
    pub meshes: Vec<MeshId>,
    pub idempotency: Option<IdempotencyKey>,
    /// Max jobs in the queue.
    pub queue_limit: u64,
}

/// A started attempt at a job.
#[derive(Clone, Debug)]
pub(crate) struct Attempt {
    pub id: JobId,
    pub request: JobRequest,
    pub input: String,
    pub number: u32,
    /// Time at which the job was accepted.
    pub created_at: String,
}

/// Outcome of an attempt.
#[derive(Clone, Debug)]
pub(crate) enum AttemptOutcome {
    /// The result files, all of them stored, and the summary of the plan among them.
    Succeeded { files: Vec<ResultFile>, summary: Option<Box<Summary>> },
    /// The problem, and the files that tell of it, all of them stored: the report where no plan is possible.
    Failed(JobProblem, Vec<ResultFile>),
    /// Ended by its cancel flag.
    Cancelled,
    /// Ended because the server stops; the attempt does not count.
    Interrupted,
}

/// `SELECT` of everything that [`read`] needs.
macro_rules! select_job {
    () => {
        "SELECT id, state, mesh_id, part_number, serial, cell, scanner, labels, version, request, priority, stage, fraction, attempts,
            timings, problem, created_at, started_at, ended_at,
            CASE WHEN json_valid(input) THEN input -> '$.warnings' END AS found,
            CASE WHEN state = 'queued' THEN (SELECT count(*) FROM job AS other INDEXED BY job_queue WHERE other.state = 'queued'
                AND (other.priority > job.priority OR (other.priority = job.priority AND other.id <= job.id))) END AS position,
            (SELECT json_group_array(json_object('name', name, 'sha256', sha256, 'size_bytes', size_bytes))
                FROM (SELECT * FROM artifact WHERE job_id = job.id ORDER BY name)) AS results,
            (SELECT summary FROM job_summary WHERE job_id = job.id) AS summary
         FROM job LEFT JOIN job_body ON job_body.job_id = job.id "
    };
}

impl Store {
    /// Inserts a job, its idempotency key and its first event in one transaction; or returns the earlier answer to the
    /// same request.
    pub(crate) async fn submit(&self, new: NewJob) -> Result<Job, Error> {
        let mut tx = self.writer.begin().await?;
        if let Some(key) = &new.idempotency
            && let Some(answer) = key.replay(&mut tx).await?
        {
            tx.commit().await?;
            return Ok(answer);
        }
        check_queue_limit(&mut tx, 1, new.queue_limit).await?;
        let (id, event) = insert_queued(&mut tx, &new).await?;
        let job = fetch(&mut tx, id).await?;
        if let Some(key) = &new.idempotency {
            key.record(&mut tx, &job).await?;
        }
        let _in_order = tx.commit_and_keep_lock().await?;
        failpoint::hit("job", "inserted");
        self.publish(event);
        Ok(job)
    }

    /// Inserts jobs, their idempotency key and their first events in one transaction; or returns the earlier answer to the same
    /// request.
    pub(crate) async fn submit_batch(
        &self,
        jobs: &[NewJob],
        idempotency: Option<&IdempotencyKey>,
        queue_limit: u64,
    ) -> Result<JobBatch, Error> {
        let mut tx = self.writer.begin().await?;
        if let Some(key) = idempotency
            && let Some(answer) = key.replay(&mut tx).await?
        {
            tx.commit().await?;
            return Ok(answer);
        }
        check_queue_limit(&mut tx, jobs.len() as u64, queue_limit).await?;
        let mut inserted = Vec::with_capacity(jobs.len());
        for new in jobs {
            inserted.push(insert_queued(&mut tx, new).await?);
        }
        let mut answer = JobBatch { jobs: Vec::with_capacity(jobs.len()) };
        for (id, _) in &inserted {
            answer.jobs.push(fetch(&mut tx, *id).await?);
        }
        if let Some(key) = idempotency {
            key.record(&mut tx, &answer).await?;
        }
        let _in_order = tx.commit_and_keep_lock().await?;
        inserted.into_iter().for_each(|(_, event)| self.publish(event));
        Ok(answer)
    }

    /// Earlier answer to this request, if any.
    pub(crate) async fn replay<T: DeserializeOwned>(&self, key: &IdempotencyKey) -> Result<Option<T>, Error> {
        key.answer(&mut *self.reader.acquire().await?).await
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

    /// Starts an attempt at the next job in the queue: highest priority first, then oldest. Jobs whose rows cannot be read
    /// fail with the reason and are skipped.
    pub(crate) async fn claim(&self) -> Result<Option<Attempt>, Error> {
        loop {
            match self.claim_next().await? {
                Claimed::Attempt(attempt) => return Ok(Some(*attempt)),
                Claimed::Unreadable => {}
                Claimed::Nothing => return Ok(None),
            }
        }
    }

    async fn claim_next(&self) -> Result<Claimed, Error> {
        let mut tx = self.writer.begin().await?;
        let row = sqlx::query(concat!(
            "UPDATE job SET state = 'running', attempts = attempts + 1, stage = NULL, fraction = 0, timings = '{}', started_at = ",
            now!(),
            "WHERE id = (SELECT id FROM job INDEXED BY job_queue WHERE state = 'queued' ORDER BY priority DESC, id LIMIT 1) RETURNING id, attempts, created_at"
        ))
        .fetch_optional(&mut *tx)
        .await?;
        let Some(row) = row else { return Ok(Claimed::Nothing) };
        let text: String = row.try_get("id")?;
        let Ok(id) = text.parse::<JobId>() else {
            tracing::error!(job = text, "a job's id cannot be read; the job fails");
            sqlx::query(concat!("UPDATE job SET state = 'failed', ended_at = ", now!(), " WHERE id = ?1"))
                .bind(text)
                .execute(&mut *tx)
                .await?;
            tx.commit().await?;
            return Ok(Claimed::Unreadable);
        };
        let (claimed, event) = match body_of(&mut tx, id).await? {
            Ok((request, input)) => {
                let number = row.try_get("attempts")?;
                let event = events::append(&mut tx, id, EventBody::state(EventKind::Started, JobState::Running)).await?;
                let created_at = row.try_get("created_at")?;
                (Claimed::Attempt(Box::new(Attempt { id, request, input, number, created_at })), event)
            }
            Err(reason) => {
                tracing::error!(job = %id, reason, "a stored job cannot be read; it fails");
                let problem = unreadable(reason);
                (Claimed::Unreadable, end(&mut tx, id, EventKind::Failed, JobState::Failed, Some(&problem)).await?)
            }
        };
        let _in_order = tx.commit_and_keep_lock().await?;
        self.publish(event);
        Ok(claimed)
    }

    /// Records the progress of a running job; ignored for a job that is not running.
    pub(crate) async fn record_progress(&self, id: JobId, stage: &str, fraction: f64, timings: &str) -> Result<(), Error> {
        let mut tx = self.writer.begin().await?;
        let state: Option<String> = sqlx::query_scalar(
            "UPDATE job SET stage = ?2, fraction = ?3, timings = ?4 WHERE id = ?1 AND state IN ('running', 'cancelling')
             RETURNING state",
        )
        .bind(id.to_string())
        .bind(stage)
        .bind(fraction)
        .bind(timings)
        .fetch_optional(&mut *tx)
        .await?;
        let Some(state) = state else { return Ok(()) };
        let state = read_state(&state).unwrap_or(JobState::Running);
        let body = EventBody { kind: EventKind::Progress, state, stage: Some(stage), fraction, code: None, summary: None };
        let event = events::append(&mut tx, id, body).await?;
        let _in_order = tx.commit_and_keep_lock().await?;
        self.publish(event);
        Ok(())
    }

    /// Ends an attempt. A job whose cancellation was requested becomes `cancelled`, whatever the outcome. A job that has ended
    /// is not changed: an earlier commit may have reached the disk although it returned an error.
    pub(crate) async fn end_attempt(&self, id: JobId, outcome: &AttemptOutcome, timings: &str) -> Result<JobState, Error> {
        let mut tx = self.writer.begin().await?;
        let before = state_of(&mut tx, id).await?;
        if before.is_ended() || before == JobState::Queued {
            return Ok(before);
        }
        let (kind, after) = match (before, outcome) {
            (JobState::Cancelling, _) | (_, AttemptOutcome::Cancelled) => (EventKind::Cancelled, JobState::Cancelled),
            (_, AttemptOutcome::Succeeded { .. }) => (EventKind::Succeeded, JobState::Succeeded),
            (_, AttemptOutcome::Failed(..)) => (EventKind::Failed, JobState::Failed),
            (_, AttemptOutcome::Interrupted) => (EventKind::Queued, JobState::Queued),
        };
        let mut ending = Ending { kind, after, problem: None, summary: None };
        match outcome {
            AttemptOutcome::Succeeded { files, summary } if after == JobState::Succeeded => {
                artifacts::insert(&mut tx, id, files).await?;
                ending.summary = summary.as_deref();
                summaries::insert(&mut tx, id, ending.summary).await?;
            }
            AttemptOutcome::Failed(reason, files) if after == JobState::Failed => {
                artifacts::insert(&mut tx, id, files).await?;
                ending.problem = Some(reason);
            }
            AttemptOutcome::Succeeded { .. }
            | AttemptOutcome::Failed(..)
            | AttemptOutcome::Cancelled
            | AttemptOutcome::Interrupted => {}
        }
        failpoint::hit("result", "before_commit");
        let event = end_with(&mut tx, id, &ending).await?;
        let uncounted = u32::from(after == JobState::Queued);
        sqlx::query("UPDATE job SET timings = ?2, attempts = attempts - ?3 WHERE id = ?1")
            .bind(id.to_string())
            .bind(timings)
            .bind(uncounted)
            .execute(&mut *tx)
            .await?;
        let _in_order = tx.commit_and_keep_lock().await?;
        failpoint::hit("result", "committed");
        self.publish(event);
        Ok(after)
    }

    /// Requests a job's cancellation: a queued job is cancelled at once, a running one when its attempt notices.
    pub(crate) async fn cancel(&self, id: JobId) -> Result<Job, Error> {
        let mut tx = self.writer.begin().await?;
        let event = match state_of(&mut tx, id).await? {
            JobState::Queued => end(&mut tx, id, EventKind::Cancelled, JobState::Cancelled, None).await?,
            JobState::Running => {
                sqlx::query("UPDATE job SET state = 'cancelling' WHERE id = ?1").bind(id.to_string()).execute(&mut *tx).await?;
                events::append(&mut tx, id, EventBody::state(EventKind::Cancelling, JobState::Cancelling)).await?
            }
            JobState::Cancelling | JobState::Cancelled => return fetch(&mut tx, id).await,
            state @ (JobState::Succeeded | JobState::Failed) => return Err(Error::JobEnded { job: id, state }),
        };
        let job = fetch(&mut tx, id).await?;
        failpoint::hit("cancel", "before_commit");
        let _in_order = tx.commit_and_keep_lock().await?;
        failpoint::hit("cancel", "committed");
        self.publish(event);
        Ok(job)
    }

    /// Deletes an ended job and its results, unless it has the label `hold`. The event carries `code`, the reason.
    pub(crate) async fn delete_job(&self, id: JobId, hold: &str, code: Option<&str>) -> Result<(), Error> {
        let orphans = {
            let mut tx = self.writer.begin().await?;
            let state = state_of(&mut tx, id).await?;
            if !state.is_ended() {
                return Err(Error::JobNotEnded { job: id, state });
            }
            check_hold(&mut tx, id, hold).await?;
            let orphans: Vec<String> = sqlx::query_scalar("SELECT file_sha256 FROM artifact WHERE job_id = ?1")
                .bind(id.to_string())
                .fetch_all(&mut *tx)
                .await?;
            sqlx::query("DELETE FROM job WHERE id = ?1").bind(id.to_string()).execute(&mut *tx).await?;
            let event = events::append(&mut tx, id, EventBody { code, ..EventBody::state(EventKind::Deleted, state) }).await?;
            let _in_order = tx.commit_and_keep_lock().await?;
            self.publish(event);
            orphans
        };
        self.remove_unreferenced(orphans).await
    }

    /// Recovers the unfinished jobs of a process that died: running ones are queued again, or fail after `max_attempts`;
    /// those being cancelled become `cancelled`. Returns their number.
    pub(crate) async fn recover(&self, max_attempts: u32, exhausted: &JobProblem) -> Result<usize, Error> {
        let mut tx = self.writer.begin().await?;
        let rows = sqlx::query("SELECT id, state, attempts FROM job WHERE state IN ('running', 'cancelling') ORDER BY id")
            .fetch_all(&mut *tx)
            .await?;
        for row in &rows {
            let text: String = row.try_get("id")?;
            let Ok(id) = text.parse::<JobId>() else {
                tracing::error!(job = text, "a job's id cannot be read; the job is left as it is");
                continue;
            };
            let state: JobState = parsed("job.state", &row.try_get::<String, _>("state")?)?;
            let attempts: u32 = row.try_get("attempts")?;
            let (kind, after, problem) = if state == JobState::Cancelling {
                (EventKind::Cancelled, JobState::Cancelled, None)
            } else if attempts >= max_attempts {
                (EventKind::Failed, JobState::Failed, Some(exhausted))
            } else {
                (EventKind::Queued, JobState::Queued, None)
            };
            end(&mut tx, id, kind, after, problem).await?;
        }
        tx.commit().await?;
        Ok(rows.len())
    }

    /// Gives a queued job another priority.
    pub(crate) async fn put_priority(&self, id: JobId, priority: i32) -> Result<Job, Error> {
        let mut tx = self.writer.begin().await?;
        let state = state_of(&mut tx, id).await?;
        if state != JobState::Queued {
            return Err(Error::JobNotQueued { job: id, state });
        }
        sqlx::query("UPDATE job SET priority = ?2 WHERE id = ?1").bind(id.to_string()).bind(priority).execute(&mut *tx).await?;
        let event = events::append(&mut tx, id, EventBody::state(EventKind::Queued, JobState::Queued)).await?;
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

/// Result of claiming the next job.
enum Claimed {
    Attempt(Box<Attempt>),
    Unreadable,
    Nothing,
}

/// Request and input of a job, or the reason why they cannot be read.
async fn body_of(tx: &mut SqliteConnection, id: JobId) -> Result<Result<(JobRequest, String), String>, Error> {
    let row = sqlx::query("SELECT version, request, input FROM job_body WHERE job_id = ?1")
        .bind(id.to_string())
        .fetch_optional(&mut *tx)
        .await?;
    let Some(row) = row else { return Ok(Err("its request is missing in the database".to_owned())) };
    let request = read_leniently::<JobRequest>(row.try_get("version")?, &row.try_get::<String, _>("request")?);
    let input: String = row.try_get("input")?;
    Ok(request.map(|(request, unknown)| {
        if !unknown.is_empty() {
            tracing::warn!(job = %id, fields = unknown.join(", "), "unknown fields of a job's request are ignored");
        }
        (request, input)
    }))
}

fn unreadable(reason: String) -> JobProblem {
    failure("job_unreadable", reason, Vec::new())
}

async fn check_hold(tx: &mut SqliteConnection, id: JobId, label: &str) -> Result<(), Error> {
    let held: bool = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM job_label WHERE job_id = ?1 AND key = ?2)")
        .bind(id.to_string())
        .bind(label)
        .fetch_one(tx)
        .await?;
    if held { Err(Error::JobHeld { job: id, label: label.to_owned() }) } else { Ok(()) }
}

/// Checks that the queue has room for so many more jobs.
async fn check_queue_limit(tx: &mut SqliteConnection, more: u64, limit: u64) -> Result<(), Error> {
    let queued: i64 =
        sqlx::query_scalar("SELECT count(*) FROM job INDEXED BY job_queue WHERE state = 'queued'").fetch_one(tx).await?;
    let queued = queued.unsigned_abs();
    if queued + more > limit { Err(Error::QueueFull { queued }) } else { Ok(()) }
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
    failpoint::hit("job", "before_insert");
    let id = JobId::generate();
    insert(tx, id, new).await?;
    Ok((id, events::append(tx, id, EventBody::state(EventKind::Queued, JobState::Queued)).await?))
}

async fn insert(tx: &mut SqliteConnection, id: JobId, new: &NewJob) -> Result<(), Error> {
    let request = &new.request;
    sqlx::query(
        "INSERT INTO job (id, state, mesh_id, part_number, serial, cell, scanner, labels, priority)
         VALUES (?1, 'queued', ?2, ?3, ?4, ?5, ?6, ?7, ?8)",
    )
    .bind(id.to_string())
    .bind(request.mesh_id.to_string())
    .bind(&request.part_number)
    .bind(&request.serial)
    .bind(name_of(&request.cell, |cell| &cell.name))
    .bind(name_of(&request.scanner, |scanner| &scanner.name))
    .bind(serde_json::to_string(&request.labels)?)
    .bind(request.priority)
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
        sqlx::query("INSERT OR IGNORE INTO job_mesh (job_id, mesh_id) VALUES (?1, ?2)")
            .bind(id.to_string())
            .bind(mesh.to_string())
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

/// End of a job's time in a state, with what is told of it.
struct Ending<'a> {
    kind: EventKind,
    after: JobState,
    problem: Option<&'a JobProblem>,
    summary: Option<&'a Summary>,
}

/// Moves a job to the state `after`, from its attempt or from the queue, and appends the event.
async fn end(
    tx: &mut SqliteConnection,
    id: JobId,
    kind: EventKind,
    after: JobState,
    problem: Option<&JobProblem>,
) -> Result<Arc<JobEvent>, Error> {
    end_with(tx, id, &Ending { kind, after, problem, summary: None }).await
}

async fn end_with(tx: &mut SqliteConnection, id: JobId, ending: &Ending<'_>) -> Result<Arc<JobEvent>, Error> {
    let Ending { kind, after, problem, summary } = *ending;
    sqlx::query(concat!(
        "UPDATE job SET state = ?2, problem = ?3, stage = NULL,
            fraction = CASE ?2 WHEN 'succeeded' THEN 1 WHEN 'queued' THEN 0 ELSE fraction END,
            ended_at = CASE WHEN ?2 = 'queued' THEN NULL ELSE ",
        now!(),
        " END WHERE id = ?1"
    ))
    .bind(id.to_string())
    .bind(after.as_str())
    .bind(problem.map(serde_json::to_string).transpose()?)
    .execute(&mut *tx)
    .await?;
    let fraction = if after == JobState::Succeeded { 1.0 } else { 0.0 };
    let code = problem.map(|p| p.code.as_str());
    events::append(tx, id, EventBody { kind, state: after, stage: None, fraction, code, summary }).await
}

/// State of a job. An unreadable state counts as failed, so that the job can be deleted.
async fn state_of(tx: &mut SqliteConnection, id: JobId) -> Result<JobState, Error> {
    let state: Option<String> =
        sqlx::query_scalar("SELECT state FROM job WHERE id = ?1").bind(id.to_string()).fetch_optional(tx).await?;
    Ok(read_state(&state.ok_or(Error::JobNotFound(id))?).unwrap_or(JobState::Failed))
}

async fn fetch(tx: &mut SqliteConnection, id: JobId) -> Result<Job, Error> {
    let row = sqlx::query(concat!(select_job!(), "WHERE id = ?1")).bind(id.to_string()).fetch_optional(tx).await?;
    read(&row.ok_or(Error::JobNotFound(id))?)
}

/// Parses a job's state; if it is unreadable, returns the problem to show with the job.
pub(super) fn read_state(text: &str) -> Result<JobState, JobProblem> {
    text.parse().map_err(|_| unreadable(format!("its state {text:?} is unknown to this version")))
}

/// Stored problem of a failed job.
pub(super) fn read_problem(text: Option<String>) -> Option<JobProblem> {
    let text = text?;
    let read = read_leniently(VERSION, &text).map(|(problem, _)| problem);
    Some(read.unwrap_or_else(|reason| unreadable(format!("the stored reason for its failure cannot be read: {reason}"))))
}

/// Reads a row. An unreadable request is replaced by the defaults, with the reason as `problem`, so that the job can still be
/// seen, cancelled and deleted.
fn read(row: &SqliteRow) -> Result<Job, Error> {
    let text = |column: &str| row.try_get::<Option<String>, _>(column).ok().flatten();
    let (state, mesh_id) = (read_state(&text("state").unwrap_or_default()), text("mesh_id").unwrap_or_default());
    let request = match (text("request"), row.try_get("version")) {
        (Some(request), Ok(version)) => read_leniently::<JobRequest>(version, &request).map(|(request, _)| request),
        _ => Err("its request is missing in the database".to_owned()),
    };
    let (request, unreadable_request) = match request {
        Ok(request) => (request, None),
        Err(reason) => (JobRequest::new(parsed("job.mesh_id", &mesh_id)?), Some(unreadable(reason))),
    };
    let results = artifacts::listed(serde_json::from_str(&row.try_get::<String, _>("results")?)?);
    let position: Option<i64> = row.try_get("position")?;
    let problem = read_problem(text("problem")).or(unreadable_request);
    let mut warnings = warnings::of_params(&request.params, "/params");
    // Jobs of earlier versions have none; one that cannot be read tells no less of the job.
    warnings.extend(text("found").and_then(|json| serde_json::from_str::<Vec<FieldWarning>>(&json).ok()).unwrap_or_default());
    Ok(Job {
        id: parsed("job.id", &row.try_get::<String, _>("id")?)?,
        state: state.as_ref().copied().unwrap_or(JobState::Failed),
        mesh_id: request.mesh_id,
        cell: request.cell,
        scanner: request.scanner,
        params: request.params,
        labels: text("labels").and_then(|json| serde_json::from_str(&json).ok()).unwrap_or_default(),
        part_number: text("part_number"),
        serial: text("serial"),
        priority: row.try_get("priority")?,
        stage: text("stage"),
        fraction: row.try_get("fraction")?,
        queue_position: position.map(i64::unsigned_abs),
        attempts: row.try_get("attempts")?,
        created_at: row.try_get("created_at")?,
        started_at: text("started_at"),
        ended_at: text("ended_at"),
        timings: text("timings").and_then(|json| serde_json::from_str(&json).ok()).unwrap_or_default(),
        warnings,
        regions: Vec::new(),
        problem: state.err().or(problem),
        plan_sha256: results.iter().find(|file| file.name == "plan.json").and_then(|file| file.sha256.clone()),
        summary: summaries::read(text("summary")),
        results,
    })
}
