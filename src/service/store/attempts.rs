//! Attempts at jobs, and all transitions between their states:
//!
//! ```text
//! queued ──► running ──► succeeded | failed
//!   │ ▲         │ └────► queued (interrupted, or the process died; failed after the max number of attempts)
//!   │ └─────────┘
//!   ▼           ▼
//! cancelled ◄─ cancelling
//! ```
//! Every transition appends its event in the same transaction.

use std::sync::Arc;

use sqlx::{Row, SqliteConnection};

use super::artifacts::{self, ResultFile};
use super::events::{self, EventBody};
use super::job_rows::{fetch, fraction_of, read_state, state_of, unreadable};
use super::stored::{read_leniently, text};
use super::{Store, now, now_since, parsed, summaries};
use crate::service::error::Error;
use crate::service::failpoint;
use crate::wire::summary::Summary;
use crate::wire::warnings::FieldWarning;
use crate::wire::{EventKind, Job, JobEvent, JobId, JobProblem, JobRequest, JobState, parse};

/// An attempt at a job: a started one, or the one that a queued job waits for.
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
    /// The result files, all of them stored, the summary of the plan among them, and what the plan warns of.
    Succeeded { files: Vec<ResultFile>, summary: Option<Box<Summary>>, warnings: Vec<FieldWarning> },
    /// The problem, and the files that tell of it, all of them stored: the report where no plan is possible.
    Failed(JobProblem, Vec<ResultFile>),
    /// Ended by its cancel flag.
    Cancelled,
    /// Ended because the server stops; the attempt does not count.
    Interrupted,
}

impl Store {
    /// Ids of the first jobs in the queue as they are stored: highest priority first, then oldest.
    pub(crate) async fn queue(&self, max: u32) -> Result<Vec<String>, Error> {
        let ids = sqlx::query_scalar(
            "SELECT id FROM job INDEXED BY job_queue WHERE state = 'queued' ORDER BY priority DESC, id LIMIT ?1",
        )
        .bind(max)
        .fetch_all(&self.reader)
        .await?;
        Ok(ids)
    }

    /// Request and input of a job, whatever its state, as of an attempt with the number 0; `None` if they cannot be read.
    pub(crate) async fn body(&self, id: JobId) -> Result<Option<Attempt>, Error> {
        Ok(body_of(&mut *self.reader.acquire().await?, id).await?.ok())
    }

    /// Starts an attempt at a queued job. A job whose rows cannot be read fails with the reason; `None` for it, and for one that
    /// is not queued any more.
    pub(crate) async fn claim(&self, id: &str) -> Result<Option<Attempt>, Error> {
        let mut tx = self.writer.begin().await?;
        let row = sqlx::query(concat!(
            "UPDATE job SET state = 'running', attempts = attempts + 1, stage = NULL, fraction = 0, timings = '{}', started_at = ",
            now_since!("created_at"),
            " WHERE id = ?1 AND state = 'queued' RETURNING attempts"
        ))
        .bind(id)
        .fetch_optional(&mut *tx)
        .await?;
        let Some(row) = row else { return Ok(None) };
        let Ok(parsed) = id.parse::<JobId>() else {
            tracing::error!(job = id, "a job's id cannot be read; the job fails");
            sqlx::query(concat!("UPDATE job SET state = 'failed', ended_at = ", now!(), " WHERE id = ?1"))
                .bind(id)
                .execute(&mut *tx)
                .await?;
            tx.commit().await?;
            return Ok(None);
        };
        let (attempt, event) = match body_of(&mut tx, parsed).await? {
            Ok(body) => {
                let event = events::append(&mut tx, parsed, EventBody::state(EventKind::Started, JobState::Running, 0.0)).await?;
                (Some(Attempt { number: row.try_get("attempts")?, ..body }), event)
            }
            Err(reason) => {
                tracing::error!(job = %parsed, reason, "a stored job cannot be read; it fails");
                let problem = unreadable(reason);
                (None, end(&mut tx, parsed, EventKind::Failed, JobState::Failed, Some(&problem)).await?)
            }
        };
        let _in_order = tx.commit_and_keep_lock().await?;
        self.publish(event);
        Ok(attempt)
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
            AttemptOutcome::Succeeded { files, summary, warnings } if after == JobState::Succeeded => {
                artifacts::insert(&mut tx, id, files).await?;
                ending.summary = summary.as_deref();
                summaries::insert(&mut tx, id, ending.summary).await?;
                add_warnings(&mut tx, id, warnings).await?;
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
                let update = "UPDATE job SET state = 'cancelling' WHERE id = ?1 RETURNING fraction";
                let fraction = fraction_of(&sqlx::query(update).bind(id.to_string()).fetch_one(&mut *tx).await?);
                events::append(&mut tx, id, EventBody::state(EventKind::Cancelling, JobState::Cancelling, fraction)).await?
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

    /// Recovers the unfinished jobs of a process that died: running ones are queued again, or fail after `max_attempts`;
    /// those being cancelled become `cancelled`. Returns their number.
    pub(crate) async fn recover(&self, max_attempts: u32, exhausted: &JobProblem) -> Result<usize, Error> {
        let mut tx = self.writer.begin().await?;
        let rows = sqlx::query("SELECT id, state, attempts FROM job WHERE state IN ('running', 'cancelling') ORDER BY id")
            .fetch_all(&mut *tx)
            .await?;
        let mut events = Vec::new();
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
            events.push(end(&mut tx, id, kind, after, problem).await?);
        }
        // On a full disk, the service is there already, and clients listen.
        let _in_order = tx.commit_and_keep_lock().await?;
        events.into_iter().for_each(|event| self.publish(event));
        Ok(rows.len())
    }
}

/// Request and input of a job as of an attempt with the number 0, or the reason why they cannot be read.
async fn body_of(tx: &mut SqliteConnection, id: JobId) -> Result<Result<Attempt, String>, Error> {
    let row = sqlx::query(
        "SELECT version, request, input, created_at FROM job_body JOIN job ON job.id = job_body.job_id WHERE job_body.job_id = ?1",
    )
    .bind(id.to_string())
    .fetch_optional(&mut *tx)
    .await?;
    let Some(row) = row else { return Ok(Err("its request is missing in the database".to_owned())) };
    let version = row.try_get("version")?;
    let read = || -> Result<Attempt, String> {
        let (request, unknown) = read_leniently(version, &text(&row, "request")?)?;
        if !unknown.is_empty() {
            tracing::warn!(job = %id, fields = unknown.join(", "), "unknown fields of a job's request are ignored");
        }
        Ok(Attempt { id, request, input: text(&row, "input")?, number: 0, created_at: text(&row, "created_at")? })
    };
    Ok(read())
}

/// Adds what its plan warns of to the warnings of a job.
async fn add_warnings(tx: &mut SqliteConnection, id: JobId, of_plan: &[FieldWarning]) -> Result<(), Error> {
    if of_plan.is_empty() {
        return Ok(());
    }
    let row = sqlx::query("SELECT warnings FROM job WHERE id = ?1").bind(id.to_string()).fetch_one(&mut *tx).await?;
    // Earlier ones that cannot be read keep no plan from being told of.
    let stored = row.try_get::<Option<String>, _>("warnings").ok().flatten();
    let mut warnings: Vec<FieldWarning> = stored.and_then(|json| parse(json.as_bytes()).ok()).unwrap_or_default();
    warnings.extend_from_slice(of_plan);
    sqlx::query("UPDATE job SET warnings = ?2 WHERE id = ?1")
        .bind(id.to_string())
        .bind(serde_json::to_string(&warnings)?)
        .execute(&mut *tx)
        .await?;
    Ok(())
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
    let ended = sqlx::query(concat!(
        "UPDATE job SET state = ?2, problem = ?3, stage = NULL,
            fraction = CASE ?2 WHEN 'succeeded' THEN 1.0 WHEN 'queued' THEN 0.0 ELSE fraction END,
            ended_at = CASE WHEN ?2 = 'queued' THEN NULL ELSE ",
        now_since!("coalesce(max(created_at, started_at), created_at)"),
        " END WHERE id = ?1 RETURNING fraction"
    ))
    .bind(id.to_string())
    .bind(after.as_str())
    .bind(problem.map(serde_json::to_string).transpose()?)
    .fetch_one(&mut *tx)
    .await?;
    let code = problem.map(|p| p.code.as_str());
    events::append(tx, id, EventBody { code, summary, ..EventBody::state(kind, after, fraction_of(&ended)) }).await
}
