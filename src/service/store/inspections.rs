//! Rows of inspections: the resource, what it is computed from, and its files.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sqlx::sqlite::SqliteRow;
use sqlx::{QueryBuilder, Row, Sqlite, SqliteConnection};

use super::artifacts::{ResultFile, StoredArtifacts, read_file};
use super::idempotency::IdempotencyKey;
use super::jobs::check_hold_of;
use super::pages::{Page, entry};
use super::stored::{VERSION, read_leniently};
use super::{Store, end_time, now};
use crate::service::error::{Error, InternalError};
use crate::service::rescan_job::RESCAN_STATE_FILE;
use crate::wire::inspection::{InspectionJob, InspectionPage, InspectionSelection, Scan};
use crate::wire::{InspectionId, JobFile, JobState};

/// Input of an inspection, as stored with it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct StoredInspection {
    /// Scans.
    pub scans: Vec<Scan>,
}

impl Store {
    /// Inserts an inspection and its idempotency key, unless so many wait or one of its scans was deleted; `created_at` becomes
    /// the store's time. Or returns the earlier answer to the same request, which has another id.
    pub(crate) async fn insert_inspection(
        &self,
        job: &InspectionJob,
        input: &StoredInspection,
        idempotency: Option<&IdempotencyKey>,
        max_queued: u64,
    ) -> Result<InspectionJob, Error> {
        let mut tx = self.writer.begin().await?;
        if let Some(key) = idempotency
            && let Some(answer) = key.replay(&mut tx, &self.clock).await?
        {
            tx.commit().await?;
            return Ok(answer);
        }
        let queued: i64 =
            sqlx::query_scalar("SELECT count(*) FROM inspection WHERE state = 'queued'").fetch_one(&mut *tx).await?;
        let queued = queued.unsigned_abs();
        if queued >= max_queued {
            return Err(Error::QueueFull { queued, asked: 1, limit: max_queued });
        }
        let mut job = job.clone();
        job.created_at = sqlx::query_scalar(concat!("SELECT ", now!())).fetch_one(&mut *tx).await?;
        let inserted = sqlx::query(
            "INSERT INTO inspection (id, job_id, state, body, input, created_at) SELECT ?1, id, ?3, ?4, ?5, ?6 FROM job WHERE id = ?2",
        )
        .bind(job.id.to_string())
        .bind(job.job_id.to_string())
        .bind(job.state.as_str())
        .bind(serde_json::to_string(&job)?)
        .bind(serde_json::to_string(input)?)
        .bind(&job.created_at)
        .execute(&mut *tx)
        .await?;
        if inserted.rows_affected() == 0 {
            return Err(Error::JobNotFound(job.job_id));
        }
        check_scans(&mut tx, &input.scans).await?;
        if let Some(key) = idempotency {
            key.record(&mut tx, &job).await?;
        }
        tx.commit().await?;
        Ok(job)
    }

    /// Changes an inspection that is in one of the states; otherwise returns it unchanged. `files` become its files.
    pub(crate) async fn change_inspection(
        &self,
        id: InspectionId,
        from: &[JobState],
        change: impl FnOnce(&mut InspectionJob) + Send,
        files: Option<&StoredArtifacts>,
    ) -> Result<InspectionJob, Error> {
        let mut tx = self.writer.begin().await?;
        let mut job = job_of(&mut tx, id).await?;
        if !from.contains(&job.state) {
            return Ok(job);
        }
        change(&mut job);
        if job.state.is_ended() {
            job.ended_at = Some(end_time(&mut tx, &job.created_at).await?);
        }
        for file in files.iter().flat_map(|stored| &stored.files) {
            insert_file(&mut tx, id, file).await?;
            let ResultFile { result, .. } = file;
            let (sha256, size_bytes) = (Some(result.sha256.clone()), Some(result.size_bytes));
            job.files.push(JobFile { name: result.name.clone(), sha256, size_bytes });
        }
        let mut job = listed(job);
        job.files.sort_by(|a, b| a.name.cmp(&b.name));
        sqlx::query("UPDATE inspection SET state = ?2, body = ?3, ended_at = ?4 WHERE id = ?1")
            .bind(id.to_string())
            .bind(job.state.as_str())
            .bind(serde_json::to_string(&job)?)
            .bind(&job.ended_at)
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        Ok(job)
    }

    /// One inspection.
    pub(crate) async fn inspection(&self, id: InspectionId) -> Result<InspectionJob, Error> {
        self.column_of_inspection(id, "SELECT body AS document FROM inspection WHERE id = ?1").await.map(listed)
    }

    /// Input of an inspection.
    pub(crate) async fn inspection_input(&self, id: InspectionId) -> Result<StoredInspection, Error> {
        self.column_of_inspection(id, "SELECT input AS document FROM inspection WHERE id = ?1").await
    }

    async fn column_of_inspection<T: DeserializeOwned>(&self, id: InspectionId, query: &'static str) -> Result<T, Error> {
        let row = sqlx::query(query).bind(id.to_string()).fetch_optional(&self.reader).await?;
        read(&row.ok_or(Error::InspectionNotFound(id))?)
    }

    /// One of the files of an inspection that succeeded.
    pub(crate) async fn inspection_file(&self, id: InspectionId, name: &str) -> Result<ResultFile, Error> {
        let state = self.inspection(id).await?.state;
        if state != JobState::Succeeded {
            return Err(Error::NoInspection { inspection: id, state });
        }
        let row = sqlx::query(
            "SELECT name, sha256, size_bytes, file_sha256, file_bytes, encoding FROM inspection_file
             WHERE inspection_id = ?1 AND name = ?2",
        )
        .bind(id.to_string())
        .bind(name)
        .fetch_optional(&self.reader)
        .await?;
        read_file(&row.ok_or_else(|| Error::NoInspectionFile { inspection: id, name: name.to_owned() })?)
    }

    /// A page of inspections, newest first. Rows that cannot be read are left out.
    pub(crate) async fn inspections(&self, selection: &InspectionSelection, page: &Page) -> Result<InspectionPage, Error> {
        let rows = query(selection, page).build().fetch_all(&self.reader).await?;
        let (items, next_page_token) = page.cut(rows.iter().map(|row| entry(row, |row| read(row).map(listed))))?;
        Ok(InspectionPage { items, next_page_token })
    }

    /// Deletes an ended inspection and its files, unless its job has the label `hold`.
    pub(crate) async fn delete_inspection(&self, id: InspectionId, hold: &str) -> Result<(), Error> {
        let orphans: Vec<String> = {
            let mut tx = self.writer.begin().await?;
            let state = state_of(&mut tx, id).await?;
            if !state.is_ended() {
                return Err(Error::InspectionNotEnded { inspection: id, state });
            }
            check_hold_of(&mut tx, "SELECT job_id FROM inspection WHERE id = ?1", id.to_string(), hold).await?;
            let orphans = sqlx::query_scalar("SELECT file_sha256 FROM inspection_file WHERE inspection_id = ?1")
                .bind(id.to_string())
                .fetch_all(&mut *tx)
                .await?;
            sqlx::query("DELETE FROM inspection WHERE id = ?1").bind(id.to_string()).execute(&mut *tx).await?;
            tx.commit().await?;
            orphans
        };
        self.remove_unreferenced(orphans).await
    }
}

/// Checks that the scans still exist: one may have been deleted since the request was checked.
async fn check_scans(tx: &mut SqliteConnection, scans: &[Scan]) -> Result<(), Error> {
    let ids: Vec<String> = scans.iter().map(|scan| scan.id.to_string()).collect();
    let missing: Option<i64> = sqlx::query_scalar(
        "SELECT wanted.key FROM json_each(?1) AS wanted WHERE NOT EXISTS (SELECT 1 FROM scan WHERE id = wanted.value) LIMIT 1",
    )
    .bind(serde_json::to_string(&ids)?)
    .fetch_optional(tx)
    .await?;
    let scan = missing.and_then(|place| scans.get(usize::try_from(place).ok()?));
    scan.map_or(Ok(()), |scan| Err(Error::ScanNotFound(scan.id)))
}

async fn job_of(tx: &mut SqliteConnection, id: InspectionId) -> Result<InspectionJob, Error> {
    let row =
        sqlx::query("SELECT body AS document FROM inspection WHERE id = ?1").bind(id.to_string()).fetch_optional(tx).await?;
    read(&row.ok_or(Error::InspectionNotFound(id))?).map(listed)
}

/// The inspection as clients see it: the file that further views are planned from is stored with it, and no route serves it.
fn listed(mut job: InspectionJob) -> InspectionJob {
    job.files.retain(|file| file.name != RESCAN_STATE_FILE);
    job
}

/// State of an inspection. An unreadable one counts as failed, so that the inspection can be deleted.
async fn state_of(tx: &mut SqliteConnection, id: InspectionId) -> Result<JobState, Error> {
    let state: Option<String> =
        sqlx::query_scalar("SELECT state FROM inspection WHERE id = ?1").bind(id.to_string()).fetch_optional(tx).await?;
    Ok(state.ok_or(Error::InspectionNotFound(id))?.parse().unwrap_or(JobState::Failed))
}

async fn insert_file(tx: &mut SqliteConnection, id: InspectionId, file: &ResultFile) -> Result<(), Error> {
    sqlx::query(
        "INSERT INTO inspection_file (inspection_id, name, sha256, size_bytes, file_sha256, file_bytes, encoding)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
    )
    .bind(id.to_string())
    .bind(&file.result.name)
    .bind(&file.result.sha256)
    .bind(i64::try_from(file.result.size_bytes).unwrap_or(i64::MAX))
    .bind(&file.file_sha256)
    .bind(i64::try_from(file.file_bytes).unwrap_or(i64::MAX))
    .bind(file.encoding.as_str())
    .execute(tx)
    .await?;
    Ok(())
}

fn read<T: DeserializeOwned>(row: &SqliteRow) -> Result<T, Error> {
    let (document, _) = read_leniently(VERSION, &row.try_get::<String, _>("document")?).map_err(InternalError::Row)?;
    Ok(document)
}

/// Query of a page.
fn query(selection: &InspectionSelection, page: &Page) -> QueryBuilder<Sqlite> {
    let mut query = QueryBuilder::new("SELECT id, body AS document FROM inspection WHERE id < ");
    query.push_bind(page.before().to_owned());
    let state = selection.state.map(|state| state.as_str().to_owned());
    for (condition, value) in [("state = ", state), ("job_id = ", selection.job_id.map(|id| id.to_string()))] {
        if let Some(value) = value {
            query.push(" AND ").push(condition).push_bind(value);
        }
    }
    query.push(" ORDER BY id DESC LIMIT ").push_bind(page.limit());
    query
}
