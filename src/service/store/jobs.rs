//! Rows of jobs and the only ways in which a job changes its state:
//!
//! ```text
//! queued ──► running ──► succeeded | failed
//!   │ ▲         │ └────► queued (interrupted, or the process died; at most so many attempts, then failed)
//!   │ └─────────┘
//!   ▼           ▼
//! cancelled ◄─ cancelling
//! ```
//! Every change appends its event in the same transaction.

use sqlx::sqlite::SqliteRow;
use sqlx::{Connection, Row, SqliteConnection};

use super::events::{self, Saying};
use super::idempotency::IdempotencyKey;
use super::pages::Page;
use super::{Store, now, parsed};
use crate::service::error::Error;
use crate::service::failpoint;
use crate::wire::{EventKind, Job, JobFile, JobId, JobPage, JobProblem, JobRequest, JobState, MeshId};

/// A job to be accepted.
pub(crate) struct NewJob {
    pub request: JobRequest,
    /// What it is planned with, every name resolved, as JSON.
    pub input: String,
    /// Meshes that it reads.
    pub meshes: Vec<MeshId>,
    pub idempotency: Option<IdempotencyKey>,
    /// Jobs that may wait at most.
    pub queue_limit: u64,
}

/// A started attempt at a job.
#[derive(Clone, Debug)]
pub(crate) struct Attempt {
    pub id: JobId,
    pub request: JobRequest,
    pub input: String,
    pub number: u32,
}

/// How an attempt ended.
#[derive(Clone, Debug)]
pub(crate) enum Outcome {
    /// With these files, all of them stored.
    Succeeded(Vec<JobFile>),
    /// Without a result.
    Failed(JobProblem),
    /// Since its cancel flag was raised.
    Cancelled,
    /// Since the server stops: the attempt does not count.
    Interrupted,
}

/// Which jobs are listed.
#[derive(Clone, Debug, Default)]
pub(crate) struct JobFilter {
    pub state: Option<JobState>,
    /// Key, and value if given.
    pub label: Option<(String, Option<String>)>,
    pub part_number: Option<String>,
}

/// `SELECT` of everything that [`read`] needs.
macro_rules! select_job {
    () => {
        "SELECT id, state, request, priority, stage, fraction, attempts, timings, problem, created_at, started_at, ended_at,
            CASE WHEN state = 'queued' THEN (SELECT count(*) FROM job AS other WHERE other.state = 'queued'
                AND (other.priority > job.priority OR (other.priority = job.priority AND other.id <= job.id))) END AS position,
            (SELECT json_group_array(json_object('name', name, 'sha256', sha256, 'size_bytes', size_bytes))
                FROM (SELECT * FROM artifact WHERE job_id = job.id ORDER BY name)) AS results
         FROM job "
    };
}

impl Store {
    /// Accepts a job, its idempotency key and its first event in one transaction; or gives the answer that the same
    /// request got before.
    pub(crate) async fn submit(&self, new: NewJob) -> Result<Job, Error> {
        let mut writer = self.writer.lock().await;
        let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
        if let Some(key) = &new.idempotency
            && let Some(answer) = key.replay(&mut tx).await?
        {
            tx.commit().await?;
            return Ok(answer);
        }
        check_room(&mut tx, new.queue_limit).await?;
        check_meshes(&mut tx, &new.meshes).await?;
        failpoint::hit("job", "before_insert");
        let id = JobId::generate();
        insert(&mut tx, id, &new).await?;
        let event = events::append(&mut tx, id, Saying::state(EventKind::Queued, JobState::Queued)).await?;
        let job = fetch(&mut tx, id).await?;
        if let Some(key) = &new.idempotency {
            key.keep(&mut tx, &job).await?;
        }
        tx.commit().await?;
        failpoint::hit("job", "inserted");
        self.tell(event);
        Ok(job)
    }

    /// The answer given to this request before, if any.
    pub(crate) async fn replay(&self, key: &IdempotencyKey) -> Result<Option<Job>, Error> {
        key.replay(&mut *self.writer.lock().await).await
    }

    /// One job.
    pub(crate) async fn job(&self, id: JobId) -> Result<Job, Error> {
        let row = sqlx::query(concat!(select_job!(), "WHERE id = ?1"))
            .bind(id.to_string())
            .fetch_optional(&self.reader)
            .await?
            .ok_or(Error::JobNotFound(id))?;
        read(&row)
    }

    /// A page of jobs, newest first.
    pub(crate) async fn jobs(&self, filter: &JobFilter, page: &Page) -> Result<JobPage, Error> {
        let (label, value) = filter.label.clone().unzip();
        let rows = sqlx::query(concat!(
            select_job!(),
            "WHERE id < ?1 AND (?3 IS NULL OR state = ?3) AND (?4 IS NULL OR part_number = ?4)
                AND (?5 IS NULL OR EXISTS
                    (SELECT 1 FROM json_each(job.labels) AS label WHERE label.key = ?5 AND (?6 IS NULL OR label.value = ?6)))
             ORDER BY id DESC LIMIT ?2"
        ))
        .bind(&page.before)
        .bind(page.limit())
        .bind(filter.state.map(JobState::as_str))
        .bind(&filter.part_number)
        .bind(label)
        .bind(value.flatten())
        .fetch_all(&self.reader)
        .await?;
        let mut items = rows.iter().map(read).collect::<Result<Vec<_>, _>>()?;
        let next_page_token = page.cut(&mut items, |job| job.id.to_string());
        Ok(JobPage { items, next_page_token })
    }

    /// Jobs in each state.
    pub(crate) async fn count_jobs(&self, state: JobState) -> Result<u64, Error> {
        let count: i64 =
            sqlx::query_scalar("SELECT count(*) FROM job WHERE state = ?1").bind(state.as_str()).fetch_one(&self.reader).await?;
        Ok(count.unsigned_abs())
    }

    /// Starts an attempt at the next job in the queue: highest priority first, then oldest.
    pub(crate) async fn claim(&self) -> Result<Option<Attempt>, Error> {
        let mut writer = self.writer.lock().await;
        let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
        let row = sqlx::query(concat!(
            "UPDATE job SET state = 'running', attempts = attempts + 1, stage = NULL, fraction = 0, timings = '{}', started_at = ",
            now!(),
            "WHERE id = (SELECT id FROM job WHERE state = 'queued' ORDER BY priority DESC, id LIMIT 1)
             RETURNING id, request, input, attempts"
        ))
        .fetch_optional(&mut *tx)
        .await?;
        let Some(row) = row else { return Ok(None) };
        let attempt = Attempt {
            id: parsed("job.id", &row.try_get::<String, _>("id")?)?,
            request: serde_json::from_str(&row.try_get::<String, _>("request")?)?,
            input: row.try_get("input")?,
            number: row.try_get("attempts")?,
        };
        let event = events::append(&mut tx, attempt.id, Saying::state(EventKind::Started, JobState::Running)).await?;
        tx.commit().await?;
        self.tell(event);
        Ok(Some(attempt))
    }

    /// Records how far a running job is. A job that does not run stays as it is.
    pub(crate) async fn progress(&self, id: JobId, stage: &str, fraction: f64, timings: &str) -> Result<(), Error> {
        let mut writer = self.writer.lock().await;
        let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
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
        let state = parsed("job.state", &state)?;
        let saying = Saying { kind: EventKind::Progress, state, stage: Some(stage), fraction, code: None };
        let event = events::append(&mut tx, id, saying).await?;
        tx.commit().await?;
        self.tell(event);
        Ok(())
    }

    /// Ends an attempt. A job whose cancellation was asked for becomes `cancelled`, whatever its attempt came to.
    pub(crate) async fn end_attempt(&self, id: JobId, outcome: &Outcome, timings: &str) -> Result<JobState, Error> {
        let mut writer = self.writer.lock().await;
        let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
        let before = state_of(&mut tx, id).await?;
        let (kind, after) = match (before, outcome) {
            (JobState::Cancelling, _) | (_, Outcome::Cancelled) => (EventKind::Cancelled, JobState::Cancelled),
            (_, Outcome::Succeeded(_)) => (EventKind::Succeeded, JobState::Succeeded),
            (_, Outcome::Failed(_)) => (EventKind::Failed, JobState::Failed),
            (_, Outcome::Interrupted) => (EventKind::Queued, JobState::Queued),
        };
        let mut problem = None;
        match outcome {
            Outcome::Succeeded(files) if after == JobState::Succeeded => insert_files(&mut tx, id, files).await?,
            Outcome::Failed(why) if after == JobState::Failed => problem = Some(why),
            _ => {}
        }
        failpoint::hit("result", "before_commit");
        let event = end(&mut tx, id, kind, after, problem).await?;
        let uncounted = u32::from(after == JobState::Queued);
        sqlx::query("UPDATE job SET timings = ?2, attempts = attempts - ?3 WHERE id = ?1")
            .bind(id.to_string())
            .bind(timings)
            .bind(uncounted)
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        failpoint::hit("result", "committed");
        self.tell(event);
        Ok(after)
    }

    /// Asks for a job's cancellation: at once when it is queued, else its attempt has to see it.
    pub(crate) async fn cancel(&self, id: JobId) -> Result<Job, Error> {
        let mut writer = self.writer.lock().await;
        let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
        let event = match state_of(&mut tx, id).await? {
            JobState::Queued => end(&mut tx, id, EventKind::Cancelled, JobState::Cancelled, None).await?,
            JobState::Running => {
                sqlx::query("UPDATE job SET state = 'cancelling' WHERE id = ?1").bind(id.to_string()).execute(&mut *tx).await?;
                events::append(&mut tx, id, Saying::state(EventKind::Cancelling, JobState::Cancelling)).await?
            }
            JobState::Cancelling | JobState::Cancelled => return fetch(&mut tx, id).await,
            state @ (JobState::Succeeded | JobState::Failed) => return Err(Error::JobEnded { job: id, state }),
        };
        let job = fetch(&mut tx, id).await?;
        failpoint::hit("cancel", "before_commit");
        tx.commit().await?;
        failpoint::hit("cancel", "committed");
        self.tell(event);
        Ok(job)
    }

    /// Deletes an ended job and its results.
    pub(crate) async fn delete_job(&self, id: JobId) -> Result<(), Error> {
        let orphans = {
            let mut writer = self.writer.lock().await;
            let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
            let state = state_of(&mut tx, id).await?;
            if !state.is_ended() {
                return Err(Error::JobNotEnded { job: id, state });
            }
            let orphans: Vec<String> = sqlx::query_scalar("SELECT sha256 FROM artifact WHERE job_id = ?1")
                .bind(id.to_string())
                .fetch_all(&mut *tx)
                .await?;
            sqlx::query("DELETE FROM job WHERE id = ?1").bind(id.to_string()).execute(&mut *tx).await?;
            let event = events::append(&mut tx, id, Saying::state(EventKind::Deleted, state)).await?;
            tx.commit().await?;
            self.tell(event);
            orphans
        };
        self.remove_unreferenced(orphans).await
    }

    /// Puts the jobs of a process that died in order: those that ran start again, or fail after `max_attempts`; those
    /// that were being cancelled are cancelled. Returns how many were found.
    pub(crate) async fn recover(&self, max_attempts: u32, exhausted: &JobProblem) -> Result<usize, Error> {
        let mut writer = self.writer.lock().await;
        let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
        let rows = sqlx::query("SELECT id, state, attempts FROM job WHERE state IN ('running', 'cancelling') ORDER BY id")
            .fetch_all(&mut *tx)
            .await?;
        for row in &rows {
            let id = parsed("job.id", &row.try_get::<String, _>("id")?)?;
            let state: JobState = parsed("job.state", &row.try_get::<String, _>("state")?)?;
            let attempts: u32 = row.try_get("attempts")?;
            let (kind, after, problem) = match state {
                JobState::Cancelling => (EventKind::Cancelled, JobState::Cancelled, None),
                _ if attempts >= max_attempts => (EventKind::Failed, JobState::Failed, Some(exhausted)),
                _ => (EventKind::Queued, JobState::Queued, None),
            };
            end(&mut tx, id, kind, after, problem).await?;
        }
        tx.commit().await?;
        Ok(rows.len())
    }

    /// The hash of one of a job's results.
    pub(crate) async fn result(&self, id: JobId, name: &str) -> Result<JobFile, Error> {
        let job = self.job(id).await?;
        if job.state != JobState::Succeeded {
            return Err(Error::NoResults { job: id, state: job.state });
        }
        let file = job.results.into_iter().find(|file| file.name == name);
        file.ok_or_else(|| Error::NoSuchResult { job: id, name: name.to_owned() })
    }

    /// Stores files that no row names yet; [`Store::hold_files`] keeps them until one does.
    pub(crate) async fn put_files(&self, artifacts: Vec<(&'static str, Vec<u8>)>) -> Result<Vec<JobFile>, Error> {
        let files = self.files.clone();
        super::blocking(move || {
            artifacts
                .into_iter()
                .map(|(name, bytes)| {
                    let sha256 = files.put(&bytes)?;
                    failpoint::hit("artifact", "written");
                    Ok(JobFile { name: name.to_owned(), sha256, size_bytes: bytes.len() as u64 })
                })
                .collect()
        })
        .await
    }

    /// Keeps files from being swept while the guard lives.
    pub(crate) async fn hold_files(&self) -> tokio::sync::RwLockReadGuard<'_, ()> {
        self.sweep.read().await
    }
}

async fn check_room(tx: &mut SqliteConnection, limit: u64) -> Result<(), Error> {
    let queued: i64 = sqlx::query_scalar("SELECT count(*) FROM job WHERE state = 'queued'").fetch_one(tx).await?;
    let queued = queued.unsigned_abs();
    if queued >= limit { Err(Error::QueueFull { queued }) } else { Ok(()) }
}

/// A mesh may have been deleted since the request was checked.
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

async fn insert(tx: &mut SqliteConnection, id: JobId, new: &NewJob) -> Result<(), Error> {
    let request = &new.request;
    sqlx::query(
        "INSERT INTO job (id, state, mesh_id, request, input, part_number, labels, priority)
         VALUES (?1, 'queued', ?2, ?3, ?4, ?5, ?6, ?7)",
    )
    .bind(id.to_string())
    .bind(request.mesh_id.to_string())
    .bind(serde_json::to_string(request)?)
    .bind(&new.input)
    .bind(&request.part_number)
    .bind(serde_json::to_string(&request.labels)?)
    .bind(request.priority)
    .execute(&mut *tx)
    .await?;
    for mesh in &new.meshes {
        sqlx::query("INSERT OR IGNORE INTO job_mesh (job_id, mesh_id) VALUES (?1, ?2)")
            .bind(id.to_string())
            .bind(mesh.to_string())
            .execute(&mut *tx)
            .await?;
    }
    Ok(())
}

async fn insert_files(tx: &mut SqliteConnection, id: JobId, files: &[JobFile]) -> Result<(), Error> {
    for file in files {
        sqlx::query("INSERT INTO artifact (job_id, name, sha256, size_bytes) VALUES (?1, ?2, ?3, ?4)")
            .bind(id.to_string())
            .bind(&file.name)
            .bind(&file.sha256)
            .bind(i64::try_from(file.size_bytes).unwrap_or(i64::MAX))
            .execute(&mut *tx)
            .await?;
    }
    Ok(())
}

/// Takes a job out of its attempt or out of the queue.
async fn end(
    tx: &mut SqliteConnection,
    id: JobId,
    kind: EventKind,
    after: JobState,
    problem: Option<&JobProblem>,
) -> Result<std::sync::Arc<crate::wire::JobEvent>, Error> {
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
    events::append(tx, id, Saying { kind, state: after, stage: None, fraction, code: problem.map(|p| p.code.as_str()) }).await
}

async fn state_of(tx: &mut SqliteConnection, id: JobId) -> Result<JobState, Error> {
    let state: Option<String> =
        sqlx::query_scalar("SELECT state FROM job WHERE id = ?1").bind(id.to_string()).fetch_optional(tx).await?;
    parsed("job.state", &state.ok_or(Error::JobNotFound(id))?)
}

async fn fetch(tx: &mut SqliteConnection, id: JobId) -> Result<Job, Error> {
    let row = sqlx::query(concat!(select_job!(), "WHERE id = ?1")).bind(id.to_string()).fetch_optional(tx).await?;
    read(&row.ok_or(Error::JobNotFound(id))?)
}

fn read(row: &SqliteRow) -> Result<Job, Error> {
    let request: JobRequest = serde_json::from_str(&row.try_get::<String, _>("request")?)?;
    let results: Vec<JobFile> = serde_json::from_str(&row.try_get::<String, _>("results")?)?;
    let problem: Option<String> = row.try_get("problem")?;
    let position: Option<i64> = row.try_get("position")?;
    Ok(Job {
        id: parsed("job.id", &row.try_get::<String, _>("id")?)?,
        state: parsed("job.state", &row.try_get::<String, _>("state")?)?,
        mesh_id: request.mesh_id,
        cell: request.cell,
        scanner: request.scanner,
        params: request.params,
        labels: request.labels,
        part_number: request.part_number,
        serial: request.serial,
        priority: request.priority,
        stage: row.try_get("stage")?,
        fraction: row.try_get("fraction")?,
        queue_position: position.map(i64::unsigned_abs),
        attempts: row.try_get("attempts")?,
        created_at: row.try_get("created_at")?,
        started_at: row.try_get("started_at")?,
        ended_at: row.try_get("ended_at")?,
        timings: serde_json::from_str(&row.try_get::<String, _>("timings")?)?,
        problem: problem.map(|text| serde_json::from_str(&text)).transpose()?,
        plan_sha256: results.iter().find(|file| file.name == "plan.json").map(|file| file.sha256.clone()),
        results,
    })
}
