//! Rows of calibrations: the resource, what it is computed from, and its result.

use serde::{Deserialize, Serialize};
use sqlx::sqlite::SqliteRow;
use sqlx::{QueryBuilder, Row, Sqlite, SqliteConnection};

use super::idempotency::IdempotencyKey;
use super::pages::entry;
use super::stored::{VERSION, read_leniently};
use super::{Page, Store, end_time, now};
use crate::cell::CellSpec;
use crate::service::error::{Error, InternalError};
use crate::wire::CalibrationId;
use crate::wire::calibration::{
    CalibrationData, CalibrationDocument, CalibrationJob, CalibrationPage, CalibrationSelection, CalibrationState,
};

/// Input of a calibration, as stored with it.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct CalibrationInput {
    /// The cell, its devices inlined.
    pub cell: CellSpec,
    /// Observations.
    pub data: CalibrationData,
}

impl Store {
    /// Inserts a calibration and its idempotency key, unless so many wait; `created_at` becomes the store's time. Or returns the
    /// earlier answer to the same request, which has another id.
    pub(crate) async fn insert_calibration(
        &self,
        job: &CalibrationJob,
        input: &CalibrationInput,
        idempotency: Option<&IdempotencyKey>,
        max_queued: u64,
    ) -> Result<CalibrationJob, Error> {
        let mut tx = self.writer.begin().await?;
        if let Some(key) = idempotency
            && let Some(answer) = key.replay(&mut tx, &self.clock).await?
        {
            tx.commit().await?;
            return Ok(answer);
        }
        let queued: i64 =
            sqlx::query_scalar("SELECT count(*) FROM calibration WHERE state = 'queued'").fetch_one(&mut *tx).await?;
        let queued = queued.unsigned_abs();
        if queued >= max_queued {
            return Err(Error::QueueFull { queued, asked: 1, limit: max_queued });
        }
        let mut job = job.clone();
        job.created_at = sqlx::query_scalar(concat!("SELECT ", now!())).fetch_one(&mut *tx).await?;
        sqlx::query("INSERT INTO calibration (id, cell, state, body, input, created_at) VALUES (?1, ?2, ?3, ?4, ?5, ?6)")
            .bind(job.id.to_string())
            .bind(&job.cell)
            .bind(job.state.as_str())
            .bind(serde_json::to_string(&job)?)
            .bind(serde_json::to_string(input)?)
            .bind(&job.created_at)
            .execute(&mut *tx)
            .await?;
        if let Some(key) = idempotency {
            key.record(&mut tx, &job).await?;
        }
        tx.commit().await?;
        Ok(job)
    }

    /// Changes a calibration that is in one of the states; otherwise returns it unchanged.
    pub(crate) async fn change_calibration(
        &self,
        id: CalibrationId,
        from: &[CalibrationState],
        change: impl FnOnce(&mut CalibrationJob) + Send,
        result: Option<&CalibrationDocument>,
    ) -> Result<CalibrationJob, Error> {
        let result = result.map(serde_json::to_string).transpose()?;
        let mut tx = self.writer.begin().await?;
        let mut job = job_of(&mut tx, id).await?;
        if !from.contains(&job.state) {
            return Ok(job);
        }
        change(&mut job);
        if job.state.is_ended() {
            job.ended_at = Some(end_time(&mut tx, &job.created_at).await?);
        }
        sqlx::query("UPDATE calibration SET state = ?2, body = ?3, result = ?4, ended_at = ?5 WHERE id = ?1")
            .bind(id.to_string())
            .bind(job.state.as_str())
            .bind(serde_json::to_string(&job)?)
            .bind(result)
            .bind(&job.ended_at)
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        Ok(job)
    }

    /// One calibration.
    pub(crate) async fn calibration(&self, id: CalibrationId) -> Result<CalibrationJob, Error> {
        let row =
            sqlx::query("SELECT body FROM calibration WHERE id = ?1").bind(id.to_string()).fetch_optional(&self.reader).await?;
        read(&row.ok_or(Error::CalibrationNotFound(id))?, "body")
    }

    /// Input of a calibration.
    pub(crate) async fn calibration_input(&self, id: CalibrationId) -> Result<CalibrationInput, Error> {
        let row =
            sqlx::query("SELECT input FROM calibration WHERE id = ?1").bind(id.to_string()).fetch_optional(&self.reader).await?;
        read(&row.ok_or(Error::CalibrationNotFound(id))?, "input")
    }

    /// Result of a calibration; `None` if it has none.
    pub(crate) async fn calibration_result(&self, id: CalibrationId) -> Result<Option<CalibrationDocument>, Error> {
        let row = sqlx::query("SELECT result FROM calibration WHERE id = ?1 AND result IS NOT NULL")
            .bind(id.to_string())
            .fetch_optional(&self.reader)
            .await?;
        row.map(|row| read(&row, "result")).transpose()
    }

    /// A page of calibrations, newest first. Rows that cannot be read are left out.
    pub(crate) async fn calibrations(&self, selection: &CalibrationSelection, page: &Page) -> Result<CalibrationPage, Error> {
        let rows = query(selection, page).build().fetch_all(&self.reader).await?;
        let (items, next_page_token) = page.cut(rows.iter().map(|row| entry(row, |row| read(row, "body"))))?;
        Ok(CalibrationPage { items, next_page_token })
    }

    /// Deletes an ended calibration.
    pub(crate) async fn delete_calibration(&self, id: CalibrationId) -> Result<(), Error> {
        let mut tx = self.writer.begin().await?;
        let state = state_of(&mut tx, id).await?;
        if !state.is_ended() {
            return Err(Error::CalibrationNotEnded { calibration: id, state });
        }
        sqlx::query("DELETE FROM calibration WHERE id = ?1").bind(id.to_string()).execute(&mut *tx).await?;
        tx.commit().await
    }
}

async fn job_of(tx: &mut SqliteConnection, id: CalibrationId) -> Result<CalibrationJob, Error> {
    let row = sqlx::query("SELECT body FROM calibration WHERE id = ?1").bind(id.to_string()).fetch_optional(tx).await?;
    read(&row.ok_or(Error::CalibrationNotFound(id))?, "body")
}

/// State of a calibration. An unreadable one counts as failed, so that the calibration can be deleted.
async fn state_of(tx: &mut SqliteConnection, id: CalibrationId) -> Result<CalibrationState, Error> {
    let state: Option<String> =
        sqlx::query_scalar("SELECT state FROM calibration WHERE id = ?1").bind(id.to_string()).fetch_optional(tx).await?;
    Ok(state.ok_or(Error::CalibrationNotFound(id))?.parse().unwrap_or(CalibrationState::Failed))
}

/// The document in a column.
fn read<T: serde::de::DeserializeOwned>(row: &SqliteRow, column: &str) -> Result<T, Error> {
    let (document, _) = read_leniently(VERSION, &row.try_get::<String, _>(column)?).map_err(InternalError::Row)?;
    Ok(document)
}

/// Query of a page.
fn query(selection: &CalibrationSelection, page: &Page) -> QueryBuilder<Sqlite> {
    let mut query = QueryBuilder::new("SELECT id, body FROM calibration WHERE id < ");
    query.push_bind(page.before().to_owned());
    for (condition, value) in
        [("state = ", selection.state.map(|state| state.as_str().to_owned())), ("cell = ", selection.cell.clone())]
    {
        if let Some(value) = value {
            query.push(" AND ").push(condition).push_bind(value);
        }
    }
    query.push(" ORDER BY id DESC LIMIT ").push_bind(page.limit());
    query
}
