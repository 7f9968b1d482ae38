//! Events of jobs: appended in the transaction that changes the job, published to subscribers after the commit.

use std::sync::Arc;

use sqlx::sqlite::SqliteRow;
use sqlx::{Row, SqliteConnection};
use tokio::sync::broadcast;

use super::Store;
use super::stored::{VERSION, read_leniently};
use crate::service::error::{Error, InternalError};
use crate::wire::summary::Summary;
use crate::wire::{EventKind, JobEvent, JobId, JobState};

/// Max events pruned in one transaction.
const MAX_PRUNED: i64 = 2000;

/// Contents of an event, without its job, number and time.
pub(super) struct EventBody<'a> {
    pub kind: EventKind,
    pub state: JobState,
    pub stage: Option<&'a str>,
    pub fraction: f64,
    pub code: Option<&'a str>,
    pub summary: Option<&'a Summary>,
}

/// Events read from the database.
pub(crate) struct EventBatch {
    /// The readable events, in order.
    pub events: Vec<Arc<JobEvent>>,
    /// Number of the last event read.
    pub through: i64,
    /// True if there may be more.
    pub is_full: bool,
}

impl EventBody<'_> {
    /// Body of a change of state of a job that is done to `fraction`.
    pub(super) fn state(kind: EventKind, state: JobState, fraction: f64) -> Self {
        Self { kind, state, stage: None, fraction, code: None, summary: None }
    }
}

/// Appends an event; [`Store::publish`] publishes it after the commit.
pub(super) async fn append(tx: &mut SqliteConnection, job_id: JobId, body: EventBody<'_>) -> Result<Arc<JobEvent>, Error> {
    let mut event = JobEvent {
        id: 0,
        job_id,
        kind: body.kind,
        at: String::new(),
        state: body.state,
        stage: body.stage.map(str::to_owned),
        fraction: body.fraction,
        code: body.code.map(str::to_owned),
        summary: body.summary.cloned(),
    };
    let row = sqlx::query("INSERT INTO event (job_id, body) VALUES (?1, ?2) RETURNING id, at")
        .bind(job_id.to_string())
        .bind(serde_json::to_string(&event)?)
        .fetch_one(tx)
        .await?;
    event.id = row.try_get("id")?;
    event.at = row.try_get("at")?;
    Ok(Arc::new(event))
}

impl Store {
    /// Publishes a committed event to all subscribers. Called while the writer is locked, so that ids are published in order.
    pub(super) fn publish(&self, event: Arc<JobEvent>) {
        // Having no subscriber is not an error.
        let _ = self.feed.send(event);
    }

    /// Subscribes to the events from now on.
    pub(crate) fn subscribe(&self) -> broadcast::Receiver<Arc<JobEvent>> {
        self.feed.subscribe()
    }

    /// Events after number `after`, of one job or of all, in order; `limit` at most.
    pub(crate) async fn events_after(&self, job: Option<JobId>, after: i64, limit: u32) -> Result<EventBatch, Error> {
        let rows = match job {
            Some(job) => sqlx::query("SELECT id, at, body FROM event WHERE job_id = ?3 AND id > ?1 ORDER BY id LIMIT ?2")
                .bind(after)
                .bind(limit)
                .bind(job.to_string()),
            None => sqlx::query("SELECT id, at, body FROM event WHERE id > ?1 ORDER BY id LIMIT ?2").bind(after).bind(limit),
        }
        .fetch_all(&self.reader)
        .await?;
        let through = rows.last().map_or(Ok(after), |row| row.try_get("id"))?;
        Ok(EventBatch { events: rows.iter().filter_map(read).collect(), through, is_full: rows.len() == limit as usize })
    }

    /// Number of the newest event, even if it was pruned; 0 before the first.
    pub(crate) async fn newest_event(&self) -> Result<i64, Error> {
        Ok(sqlx::query_scalar("SELECT seq FROM sqlite_sequence WHERE name = 'event'")
            .fetch_optional(&self.reader)
            .await?
            .unwrap_or(0))
    }

    /// Returns true if events after number `after` have been pruned, so that a subscriber who saw `after` last has missed some.
    pub(crate) async fn is_pruned_after(&self, after: i64) -> Result<bool, Error> {
        let pruned_through: Option<i64> =
            sqlx::query_scalar("SELECT pruned_through FROM event_retention").fetch_optional(&self.reader).await?;
        Ok(pruned_through.is_some_and(|pruned| after < pruned))
    }

    /// Prunes events older than `hours`, except those of jobs that have not ended; in small transactions, so that other
    /// writers do not wait long.
    pub(crate) async fn prune_events(&self, hours: u32) -> Result<(), Error> {
        if !self.clock.is_steady() {
            return Ok(());
        }
        // Times increase with the numbers, so the newest old event is found by a scan from the other end.
        let newest: Option<i64> = sqlx::query_scalar(
            "SELECT id FROM event WHERE at < strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-' || ?1 || ' hours') ORDER BY id DESC LIMIT 1",
        )
        .bind(hours)
        .fetch_optional(&self.reader)
        .await?;
        let Some(newest) = newest else { return Ok(()) };
        loop {
            let mut tx = self.writer.begin().await?;
            let through: Option<i64> = sqlx::query_scalar(
                "SELECT max(id) FROM (SELECT id FROM event WHERE id <= ?1
                   AND job_id NOT IN (SELECT id FROM job WHERE state IN ('queued', 'running', 'cancelling')) ORDER BY id LIMIT ?2)",
            )
            .bind(newest)
            .bind(MAX_PRUNED)
            .fetch_one(&mut *tx)
            .await?;
            let Some(through) = through else { return Ok(()) };
            sqlx::query(
                "DELETE FROM event WHERE id <= ?1
                   AND job_id NOT IN (SELECT id FROM job WHERE state IN ('queued', 'running', 'cancelling'))",
            )
            .bind(through)
            .execute(&mut *tx)
            .await?;
            // Events of a job that was open longer are pruned after later ones.
            sqlx::query(
                "INSERT INTO event_retention (only_row, pruned_through) VALUES (1, ?1)
                 ON CONFLICT (only_row) DO UPDATE SET pruned_through = max(pruned_through, excluded.pruned_through)",
            )
            .bind(through)
            .execute(&mut *tx)
            .await?;
            tx.commit().await?;
        }
    }
}

/// An event, or `None` if its row cannot be read.
fn read(row: &SqliteRow) -> Option<Arc<JobEvent>> {
    let event = || -> Result<JobEvent, Error> {
        let (mut event, _): (JobEvent, _) =
            read_leniently(VERSION, &row.try_get::<String, _>("body")?).map_err(InternalError::Row)?;
        event.id = row.try_get("id")?;
        event.at = row.try_get("at")?;
        Ok(event)
    };
    event()
        .inspect_err(|error| tracing::warn!(error = error as &dyn std::error::Error, "an event cannot be read"))
        .ok()
        .map(Arc::new)
}
