//! Summaries of the plans of jobs, which lists show: a row each, written with the results.

use sqlx::SqliteConnection;

use super::stored::{VERSION, read_leniently};
use crate::service::error::Error;
use crate::wire::JobId;
use crate::wire::summary::Summary;

/// Inserts the summary of a job's plan, if there is one.
pub(super) async fn insert(tx: &mut SqliteConnection, id: JobId, summary: Option<&Summary>) -> Result<(), Error> {
    let Some(summary) = summary else { return Ok(()) };
    sqlx::query("INSERT INTO job_summary (job_id, summary) VALUES (?1, ?2)")
        .bind(id.to_string())
        .bind(serde_json::to_string(summary)?)
        .execute(&mut *tx)
        .await?;
    Ok(())
}

/// Stored summary; `None` if it cannot be read, so that its job still can.
pub(super) fn read(text: Option<String>) -> Option<Summary> {
    let read = read_leniently(VERSION, &text?).map(|(summary, _)| summary);
    read.inspect_err(|reason| tracing::warn!(reason, "the stored summary of a job cannot be read")).ok()
}
