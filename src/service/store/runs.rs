//! Rows of runs: the run as it stands, the steps that were completed and the events that are stored. Every change appends its event
//! in the same transaction; samples of the live state never come here.

use std::collections::BTreeMap;
use std::sync::Arc;

use sqlx::sqlite::SqliteRow;
use sqlx::{QueryBuilder, Row, Sqlite, SqliteConnection};

use super::idempotency::IdempotencyKey;
use super::job_rows;
use super::jobs::{check_hold, check_idle};
use super::pages::entry;
use super::stored::{VERSION, read_leniently};
use super::{Page, Store, end_time, now};
use crate::service::error::{Error, InternalError, MissingRun, RunDeletion};
use crate::wire::run::{
    LeaseDocument, ReportedReason, ReportedState, Run, RunAudit, RunCoverage, RunEventDocument, RunEventKind, RunPage,
    RunSelection, RunStepOp, RunStepRecord,
};
use crate::wire::{JobId, RunId, UtcTime};

/// Events of a run read at a time.
const BATCH: u32 = 256;
/// Words in the last event of a run that the retention policy deleted.
const BY_RETENTION: &str = "deleted by the retention policy (retention.run_days)";

/// SQL condition of the states before the end.
macro_rules! not_ended {
    () => {
        "run.state NOT IN ('done', 'stopped', 'failed')"
    };
}
pub(super) use not_ended;

/// Events of a run, in order.
pub(crate) struct RunEventBatch {
    pub events: Vec<RunEventDocument>,
    /// Number of the last event read.
    pub through: i64,
    /// True if there may be more.
    pub is_full: bool,
}

impl Store {
    /// Inserts a run with its first event and its idempotency key, unless so many have not ended or its job was deleted; `created_at`
    /// becomes the store's time.
    pub(crate) async fn insert_run(
        &self,
        run: &Run,
        idempotency: Option<&IdempotencyKey>,
        max_open: usize,
    ) -> Result<(Run, Arc<RunEventDocument>), Error> {
        let mut tx = self.writer.begin().await?;
        let open: i64 = sqlx::query_scalar(concat!("SELECT count(*) FROM run WHERE ", not_ended!())).fetch_one(&mut *tx).await?;
        if open.unsigned_abs() >= max_open as u64 {
            return Err(Error::TooManyRuns { open: open.unsigned_abs() });
        }
        if let Some(job) = run.job_id {
            // It may have been deleted since its program was read; from here on the run keeps it.
            job_rows::state_of(&mut tx, job).await?;
        }
        let mut run = run.clone();
        run.created_at = sqlx::query_scalar(concat!("SELECT ", now!())).fetch_one(&mut *tx).await?;
        sqlx::query("INSERT INTO run (id, job_id, cell, mode, state, body, created_at) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)")
            .bind(run.id.to_string())
            .bind(run.job_id.map(|id| id.to_string()))
            .bind(&run.cell)
            .bind(run.mode.as_str())
            .bind(run.state.as_str())
            .bind(serde_json::to_string(&run)?)
            .bind(&run.created_at)
            .execute(&mut *tx)
            .await?;
        let event = append(&mut tx, &run, RunEventKind::State).await?;
        if let Some(key) = idempotency {
            key.record(&mut tx, &run).await?;
        }
        tx.commit().await?;
        Ok((run, event))
    }

    /// Stores a run as it stands now, steps that it completed, numbered from `first`, and the event of the change. An ended run is
    /// not changed any more.
    pub(crate) async fn update_run(
        &self,
        run: &mut Run,
        kind: RunEventKind,
        (first, steps): (usize, &[RunStepRecord]),
    ) -> Result<Option<Arc<RunEventDocument>>, Error> {
        let mut tx = self.writer.begin().await?;
        if state_of(&mut tx, run.id).await?.is_ended() {
            return Ok(None);
        }
        if run.state.is_ended() {
            run.ended_at = Some(end_time(&mut tx, &run.created_at).await?);
        }
        write(&mut tx, run).await?;
        for (number, step) in steps.iter().enumerate() {
            insert_step(&mut tx, run.id, first + number, step).await?;
        }
        let event = append(&mut tx, run, kind).await?;
        tx.commit().await?;
        Ok(Some(event))
    }

    /// Adds to an ended run its coverage at the measured poses, which is evaluated after its end; to none that was deleted meanwhile.
    pub(crate) async fn add_run_coverage(&self, id: RunId, coverage: RunCoverage) -> Result<(), Error> {
        let mut tx = self.writer.begin().await?;
        let row = sqlx::query("SELECT body FROM run WHERE id = ?1").bind(id.to_string()).fetch_optional(&mut *tx).await?;
        if let Some(row) = row {
            let run = Run { coverage: Some(coverage), ..read(&row)? };
            write(&mut tx, &run).await?;
        }
        tx.commit().await
    }

    /// Notes that a program was completed live in a cell.
    pub(crate) async fn note_completed(&self, program_sha256: &str, cell_sha256: &str) -> Result<(), Error> {
        let mut tx = self.writer.begin().await?;
        sqlx::query("INSERT OR IGNORE INTO run_completed VALUES (?1, ?2)")
            .bind(program_sha256)
            .bind(cell_sha256)
            .execute(&mut *tx)
            .await?;
        tx.commit().await
    }

    /// Returns true if a program was completed live in a cell before.
    pub(crate) async fn was_completed(&self, program_sha256: &str, cell_sha256: &str) -> Result<bool, Error> {
        let query = "SELECT EXISTS (SELECT 1 FROM run_completed WHERE program_sha256 = ?1 AND cell_sha256 = ?2)";
        Ok(sqlx::query_scalar(query).bind(program_sha256).bind(cell_sha256).fetch_one(&self.reader).await?)
    }

    /// One run.
    pub(crate) async fn run(&self, id: RunId) -> Result<Run, Error> {
        let mut connection = self.reader.acquire().await?;
        let row = sqlx::query("SELECT body FROM run WHERE id = ?1").bind(id.to_string()).fetch_optional(&mut *connection).await?;
        match row {
            Some(row) => read(&row),
            None => Err(missing(&mut connection, id).await?),
        }
    }

    /// Runs that have not ended.
    pub(crate) async fn open_run_ids(&self) -> Result<Vec<RunId>, Error> {
        let ids: Vec<String> =
            sqlx::query_scalar(concat!("SELECT id FROM run WHERE ", not_ended!())).fetch_all(&self.reader).await?;
        Ok(ids.iter().filter_map(|id| id.parse().ok()).collect())
    }

    /// Runs whose deletion is among the events that are kept.
    pub(crate) async fn deleted_runs(&self) -> Result<Vec<RunId>, Error> {
        let ids: Vec<String> = sqlx::query_scalar(
            "SELECT DISTINCT run_id FROM run_event WHERE CASE WHEN json_valid(body) THEN body ->> '$.kind' END = ?1
               AND NOT EXISTS (SELECT 1 FROM run WHERE run.id = run_event.run_id) ORDER BY run_id",
        )
        .bind(RunEventKind::Deleted.as_str())
        .fetch_all(&self.reader)
        .await?;
        Ok(ids.iter().filter_map(|id| id.parse().ok()).collect())
    }

    /// Steps that a run completed, in order.
    pub(crate) async fn run_steps(&self, id: RunId) -> Result<Vec<RunStepRecord>, Error> {
        let rows = sqlx::query("SELECT body FROM run_step WHERE run_id = ?1 ORDER BY number")
            .bind(id.to_string())
            .fetch_all(&self.reader)
            .await?;
        rows.iter().map(read).collect()
    }

    /// A page of runs, newest first. Rows that cannot be read are left out.
    pub(crate) async fn runs(&self, selection: &RunSelection, page: &Page) -> Result<RunPage, Error> {
        let rows = query(selection, page).build().fetch_all(&self.reader).await?;
        let (items, next_page_token) = page.cut(rows.iter().map(|row| entry(row, read)))?;
        Ok(RunPage { items, next_page_token })
    }

    /// Number of runs in a state.
    pub(crate) async fn count_runs(&self, state: ReportedState) -> Result<u64, Error> {
        let count: i64 =
            sqlx::query_scalar("SELECT count(*) FROM run WHERE state = ?1").bind(state.as_str()).fetch_one(&self.reader).await?;
        Ok(count.unsigned_abs())
    }

    /// Deletes an ended run with its record, unless its job has the label `hold`; its last event tells so, unless the run cannot
    /// be read. Deleted by retention, a run of a job that is in use stays too, and the event says who deleted the run.
    pub(crate) async fn delete_run(
        &self,
        id: RunId,
        hold: &str,
        by_retention: bool,
    ) -> Result<Option<Arc<RunEventDocument>>, Error> {
        let mut tx = self.writer.begin().await?;
        let state = state_of(&mut tx, id).await?;
        if !state.is_ended() {
            return Err(Error::RunNotEnded { run: id, state });
        }
        let job: Option<String> =
            sqlx::query_scalar("SELECT job_id FROM run WHERE id = ?1").bind(id.to_string()).fetch_one(&mut *tx).await?;
        if let Some(job) = job.and_then(|job| job.parse::<JobId>().ok()) {
            check_hold(&mut tx, job, hold).await?;
            if by_retention {
                check_idle(&mut tx, job).await?;
            }
        }
        let row = sqlx::query("DELETE FROM run WHERE id = ?1 RETURNING body").bind(id.to_string()).fetch_one(&mut *tx).await?;
        sqlx::query("DELETE FROM run_event WHERE run_id = ?1").bind(id.to_string()).execute(&mut *tx).await?;
        let event = match read::<Run>(&row) {
            Ok(mut run) => {
                if by_retention {
                    run.detail = Some(BY_RETENTION.to_owned());
                }
                Some(append(&mut tx, &run, RunEventKind::Deleted).await?)
            }
            Err(_) => None,
        };
        tx.commit().await?;
        Ok(event)
    }

    /// Stops the runs that an earlier process left open: none is ever resumed by itself. Each is linked with the end of its audit log,
    /// of `logs`. Returns their events.
    pub(crate) async fn stop_open_runs(
        &self,
        detail: &str,
        logs: &BTreeMap<RunId, RunAudit>,
    ) -> Result<Vec<Arc<RunEventDocument>>, Error> {
        let mut events = Vec::new();
        let mut tx = self.writer.begin().await?;
        let rows = sqlx::query(concat!("SELECT id, body FROM run WHERE ", not_ended!())).fetch_all(&mut *tx).await?;
        for row in &rows {
            let Ok(mut run) = read::<Run>(row) else {
                // What cannot be read harms itself alone: it counts as failed, and can be deleted.
                let id: String = row.try_get("id")?;
                tracing::error!(run = id, "a stored run cannot be read; it counts as failed");
                sqlx::query("UPDATE run SET state = 'failed' WHERE id = ?1").bind(id).execute(&mut *tx).await?;
                continue;
            };
            (run.state, run.reason, run.detail) =
                (ReportedState::Stopped, ReportedReason::ServerRestarted, Some(detail.to_owned()));
            run.audit = run.audit.take().or_else(|| logs.get(&run.id).cloned());
            // Earlier releases counted the scans at the end alone.
            run.scans = count_scans(&mut tx, run.id).await?;
            run.ended_at = Some(end_time(&mut tx, &run.created_at).await?);
            write(&mut tx, &run).await?;
            events.push(append(&mut tx, &run, RunEventKind::State).await?);
        }
        tx.commit().await?;
        Ok(events)
    }

    /// Events of a run after number `after`.
    pub(crate) async fn run_events(&self, id: RunId, after: i64) -> Result<RunEventBatch, Error> {
        let rows = sqlx::query("SELECT id, at, body FROM run_event WHERE run_id = ?1 AND id > ?2 ORDER BY id LIMIT ?3")
            .bind(id.to_string())
            .bind(after)
            .bind(BATCH)
            .fetch_all(&self.reader)
            .await?;
        let through = rows.last().map_or(Ok(after), |row| row.try_get("id"))?;
        let events = rows.iter().filter_map(|row| read_event(row).ok()).collect();
        Ok(RunEventBatch { events, through, is_full: rows.len() == BATCH as usize })
    }

    /// Number of the newest event of a run, even if it was pruned; 0 before the first.
    pub(crate) async fn newest_run_event(&self) -> Result<i64, Error> {
        Ok(sqlx::query_scalar("SELECT seq FROM sqlite_sequence WHERE name = 'run_event'")
            .fetch_optional(&self.reader)
            .await?
            .unwrap_or(0))
    }

    /// Returns true if events of runs after number `after` have been pruned, so that a subscriber who saw `after` last may have missed
    /// some.
    pub(crate) async fn is_run_event_pruned_after(&self, after: i64) -> Result<bool, Error> {
        let through: i64 = sqlx::query_scalar("SELECT pruned_through FROM run_event_retention").fetch_one(&self.reader).await?;
        Ok(after < through)
    }

    /// The highest fencing token that was ever given.
    pub(crate) async fn last_fence(&self) -> Result<u64, Error> {
        let last: i64 = sqlx::query_scalar("SELECT last FROM run_fence").fetch_one(&self.reader).await?;
        Ok(last.unsigned_abs())
    }

    /// Notes a fencing token, so that none below it is given after a restart, and the lease with it under its idempotency key.
    pub(crate) async fn note_fence(&self, token: u64, given: Option<(&IdempotencyKey, &LeaseDocument)>) -> Result<(), Error> {
        let mut tx = self.writer.begin().await?;
        let token = i64::try_from(token).unwrap_or(i64::MAX);
        sqlx::query("UPDATE run_fence SET last = max(last, ?1)").bind(token).execute(&mut *tx).await?;
        if let Some((key, lease)) = given {
            key.record(&mut tx, lease).await?;
        }
        tx.commit().await
    }

    /// Prunes the events of ended runs older than `hours`; those of their changes of state remain in the run itself.
    pub(crate) async fn prune_run_events(&self, hours: u32) -> Result<(), Error> {
        if !self.clock.is_steady() {
            return Ok(());
        }
        let mut tx = self.writer.begin().await?;
        let pruned: Vec<i64> = sqlx::query_scalar(concat!(
            "DELETE FROM run_event WHERE at < strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-' || ?1 || ' hours')
               AND run_id NOT IN (SELECT id FROM run WHERE ",
            not_ended!(),
            ") RETURNING id"
        ))
        .bind(hours)
        .fetch_all(&mut *tx)
        .await?;
        // Events of a run that was open longer are pruned after later ones.
        sqlx::query("UPDATE run_event_retention SET pruned_through = max(pruned_through, ?1)")
            .bind(pruned.into_iter().max().unwrap_or(0))
            .execute(&mut *tx)
            .await?;
        tx.commit().await
    }
}

/// State of a run. An unreadable one counts as failed, so that the run can be deleted.
async fn state_of(tx: &mut SqliteConnection, id: RunId) -> Result<ReportedState, Error> {
    let state: Option<String> =
        sqlx::query_scalar("SELECT state FROM run WHERE id = ?1").bind(id.to_string()).fetch_optional(&mut *tx).await?;
    match state {
        Some(state) => Ok(state.parse().unwrap_or(ReportedState::Failed)),
        None => Err(missing(tx, id).await?),
    }
}

/// Error of a run that is not there; tells of its deletion while the event of that is kept.
async fn missing(connection: &mut SqliteConnection, run: RunId) -> Result<Error, Error> {
    let last = sqlx::query("SELECT id, at, body FROM run_event WHERE run_id = ?1 ORDER BY id DESC LIMIT 1")
        .bind(run.to_string())
        .fetch_optional(connection)
        .await?;
    // What cannot be read tells of none.
    let last = last.and_then(|row| read_event(&row).ok()).filter(|event| event.kind == RunEventKind::Deleted);
    let deletion = last.map(|event| RunDeletion { at: event.at, by_retention: event.detail.as_deref() == Some(BY_RETENTION) });
    Ok(Error::RunNotFound(MissingRun { run, deletion }))
}

async fn write(tx: &mut SqliteConnection, run: &Run) -> Result<(), Error> {
    sqlx::query("UPDATE run SET state = ?2, body = ?3, ended_at = ?4 WHERE id = ?1")
        .bind(run.id.to_string())
        .bind(run.state.as_str())
        .bind(serde_json::to_string(run)?)
        .bind(&run.ended_at)
        .execute(tx)
        .await?;
    Ok(())
}

/// Number of scans among the steps that a run completed.
async fn count_scans(tx: &mut SqliteConnection, id: RunId) -> Result<usize, Error> {
    let query = "SELECT count(*) FROM run_step WHERE run_id = ?1 AND CASE WHEN json_valid(body) THEN body ->> '$.op' END = ?2";
    let count: i64 = sqlx::query_scalar(query).bind(id.to_string()).bind(RunStepOp::Scan.as_str()).fetch_one(tx).await?;
    Ok(usize::try_from(count).unwrap_or_default())
}

async fn insert_step(tx: &mut SqliteConnection, id: RunId, number: usize, step: &RunStepRecord) -> Result<(), Error> {
    sqlx::query("INSERT OR REPLACE INTO run_step (run_id, number, body) VALUES (?1, ?2, ?3)")
        .bind(id.to_string())
        .bind(i64::try_from(number).unwrap_or(i64::MAX))
        .bind(serde_json::to_string(step)?)
        .execute(tx)
        .await?;
    Ok(())
}

async fn append(tx: &mut SqliteConnection, run: &Run, kind: RunEventKind) -> Result<Arc<RunEventDocument>, Error> {
    let mut event = RunEventDocument {
        id: 0,
        run_id: run.id,
        kind,
        at: String::new(),
        state: run.state,
        reason: run.reason,
        detail: run.detail.clone(),
        step: run.step,
        speed_override: run.speed_override,
        stop: run.stop.clone(),
    };
    let row = sqlx::query("INSERT INTO run_event (run_id, body) VALUES (?1, ?2) RETURNING id, at")
        .bind(run.id.to_string())
        .bind(serde_json::to_string(&event)?)
        .fetch_one(tx)
        .await?;
    (event.id, event.at) = (row.try_get("id")?, row.try_get("at")?);
    Ok(Arc::new(event))
}

/// The document in the column `body`.
fn read<T: serde::de::DeserializeOwned>(row: &SqliteRow) -> Result<T, Error> {
    let (document, _) = read_leniently(VERSION, &row.try_get::<String, _>("body")?).map_err(InternalError::Row)?;
    Ok(document)
}

fn read_event(row: &SqliteRow) -> Result<RunEventDocument, Error> {
    let mut event: RunEventDocument = read(row)?;
    (event.id, event.at) = (row.try_get("id")?, row.try_get("at")?);
    Ok(event)
}

/// Query of a page.
fn query(selection: &RunSelection, page: &Page) -> QueryBuilder<Sqlite> {
    let mut query = QueryBuilder::new("SELECT id, body FROM run WHERE id < ");
    query.push_bind(page.before().to_owned());
    let time = |time: &Option<UtcTime>| time.as_ref().map(|time| time.as_str().to_owned());
    for (condition, value) in [
        ("state = ", selection.state.map(|state| state.as_str().to_owned())),
        ("mode = ", selection.mode.map(|mode| mode.as_str().to_owned())),
        ("cell = ", selection.cell.clone()),
        ("job_id = ", selection.job_id.map(|id| id.to_string())),
        ("created_at >= ", time(&selection.created_after)),
        ("created_at < ", time(&selection.created_before)),
    ] {
        if let Some(value) = value {
            query.push(" AND ").push(condition).push_bind(value);
        }
    }
    query.push(" ORDER BY id DESC LIMIT ").push_bind(page.limit());
    query
}
