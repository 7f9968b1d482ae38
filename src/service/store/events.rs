//! Events of jobs: appended in the transaction that changes the job, told to listeners once that is on the disk.

use std::sync::Arc;

use sqlx::sqlite::SqliteRow;
use sqlx::{Row, SqliteConnection};
use tokio::sync::broadcast;

use super::Store;
use super::stored::{VERSION, read_leniently};
use crate::service::error::{Error, Fault};
use crate::wire::{EventKind, JobEvent, JobId, JobState};

/// Events dropped in one transaction.
const PRUNED_AT_ONCE: i64 = 2000;

/// What an event says beyond the job and its kind.
pub(super) struct Saying<'a> {
    pub kind: EventKind,
    pub state: JobState,
    pub stage: Option<&'a str>,
    pub fraction: f64,
    pub code: Option<&'a str>,
}

/// Events read from the database.
pub(crate) struct EventBatch {
    /// The events, in order; without those that cannot be read.
    pub events: Vec<Arc<JobEvent>>,
    /// Number of the last one that was looked at.
    pub through: i64,
    /// There may be more.
    pub is_full: bool,
}

impl Saying<'_> {
    /// A change of state, without a stage.
    pub(super) fn state(kind: EventKind, state: JobState) -> Self {
        Self { kind, state, stage: None, fraction: 0.0, code: None }
    }
}

/// Appends an event; it is told by [`Store::tell`] after the commit.
pub(super) async fn append(tx: &mut SqliteConnection, job_id: JobId, saying: Saying<'_>) -> Result<Arc<JobEvent>, Error> {
    let mut event = JobEvent {
        id: 0,
        job_id,
        kind: saying.kind,
        at: String::new(),
        state: saying.state,
        stage: saying.stage.map(str::to_owned),
        fraction: saying.fraction,
        code: saying.code.map(str::to_owned),
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
    /// Tells a committed event to whoever listens. Called while the writer is held, so that ids are told in order.
    pub(super) fn tell(&self, event: Arc<JobEvent>) {
        // Nobody listening is no error.
        let _ = self.feed.send(event);
    }

    /// Events from now on.
    pub(crate) fn listen(&self) -> broadcast::Receiver<Arc<JobEvent>> {
        self.feed.subscribe()
    }

    /// At most `limit` events after number `after`, of one job or of all, in order.
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

    /// Number of the newest event that ever was; 0 before the first.
    pub(crate) async fn newest_event(&self) -> Result<i64, Error> {
        Ok(sqlx::query_scalar("SELECT seq FROM sqlite_sequence WHERE name = 'event'")
            .fetch_optional(&self.reader)
            .await?
            .unwrap_or(0))
    }

    /// Whether events after number `after` have been pruned, so that a listener who saw `after` last has missed some.
    pub(crate) async fn is_pruned_after(&self, after: i64) -> Result<bool, Error> {
        let pruned_through: Option<i64> =
            sqlx::query_scalar("SELECT pruned_through FROM event_retention").fetch_optional(&self.reader).await?;
        Ok(pruned_through.is_some_and(|pruned| after < pruned))
    }

    /// Drops events older than `hours`, but for those of jobs that have not ended; a few at a time, so that nobody who
    /// writes waits long.
    pub(crate) async fn prune_events(&self, hours: u32) -> Result<(), Error> {
        // Times rise with the numbers, so the newest old one is found from the other end.
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
            .bind(PRUNED_AT_ONCE)
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
            sqlx::query("INSERT OR REPLACE INTO event_retention (only_row, pruned_through) VALUES (1, ?1)")
                .bind(through)
                .execute(&mut *tx)
                .await?;
            tx.commit().await?;
        }
    }
}

/// An event, or nothing where its row cannot be read.
fn read(row: &SqliteRow) -> Option<Arc<JobEvent>> {
    let event = || -> Result<JobEvent, Error> {
        let (mut event, _): (JobEvent, _) = read_leniently(VERSION, &row.try_get::<String, _>("body")?).map_err(Fault::Row)?;
        event.id = row.try_get("id")?;
        event.at = row.try_get("at")?;
        Ok(event)
    };
    event()
        .inspect_err(|error| tracing::warn!(error = error as &dyn std::error::Error, "an event cannot be read"))
        .ok()
        .map(Arc::new)
}
