//! Rows of uploaded scans.

use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::files::Received;
use super::jobs::check_hold_of;
use super::pages::{Page, entry};
use super::stored::{VERSION, read_leniently};
use super::{Store, blocking, now};
use crate::service::error::{Error, InternalError};
use crate::wire::inspection::{Scan, ScanPage};
use crate::wire::{JobId, JobState, ScanId};

impl Store {
    /// Stores a scan of a planned job. `scan` has no time and no file yet. An upload with the same bytes and the same facts as a
    /// stored scan of the job returns that scan.
    pub(crate) async fn add_scan(&self, mut scan: Scan, received: Received) -> Result<Scan, Error> {
        (scan.sha256, scan.size_bytes) = (received.sha256.clone(), received.size_bytes);
        let _pin = self.pinned.pin(vec![scan.sha256.clone()]).await;
        let files = self.files.clone();
        blocking(move || files.persist(received)).await?;
        let mut tx = self.writer.begin().await?;
        let same = sqlx::query("SELECT body FROM scan WHERE job_id = ?1 AND sha256 = ?2 ORDER BY id")
            .bind(scan.job_id.to_string())
            .bind(&scan.sha256)
            .fetch_all(&mut *tx)
            .await?;
        let facts = |scan: &Scan| (scan.view, scan.name.clone(), scan.unit.clone(), scan.frame);
        if let Some(stored) = same.iter().filter_map(|row| read(row).ok()).find(|stored| facts(stored) == facts(&scan)) {
            return Ok(stored);
        }
        scan.created_at = sqlx::query_scalar(concat!("SELECT ", now!())).fetch_one(&mut *tx).await?;
        let inserted = sqlx::query(
            "INSERT INTO scan (id, job_id, sha256, size_bytes, body, created_at)
             SELECT ?1, id, ?3, ?4, ?5, ?6 FROM job WHERE id = ?2",
        )
        .bind(scan.id.to_string())
        .bind(scan.job_id.to_string())
        .bind(&scan.sha256)
        .bind(i64::try_from(scan.size_bytes).unwrap_or(i64::MAX))
        .bind(serde_json::to_string(&scan)?)
        .bind(&scan.created_at)
        .execute(&mut *tx)
        .await?;
        if inserted.rows_affected() == 0 {
            return Err(Error::JobNotFound(scan.job_id));
        }
        tx.commit().await?;
        Ok(scan)
    }

    /// A page of a job's scans, oldest first. Rows that cannot be read are left out.
    pub(crate) async fn scans(&self, job: JobId, page: &Page) -> Result<ScanPage, Error> {
        let rows = sqlx::query("SELECT id, body FROM scan WHERE job_id = ?1 AND id > ?2 ORDER BY id LIMIT ?3")
            .bind(job.to_string())
            .bind(page.after.as_ref().map_or("", |place| &place.id))
            .bind(page.limit())
            .fetch_all(&self.reader)
            .await?;
        let (items, next_page_token) = page.cut(rows.iter().map(|row| entry(row, read)))?;
        Ok(ScanPage { items, next_page_token })
    }

    /// Every scan of a job, oldest first.
    pub(crate) async fn all_scans(&self, job: JobId) -> Result<Vec<Scan>, Error> {
        let rows = sqlx::query("SELECT body FROM scan WHERE job_id = ?1 ORDER BY id")
            .bind(job.to_string())
            .fetch_all(&self.reader)
            .await?;
        rows.iter().map(read).collect()
    }

    /// One scan.
    pub(crate) async fn scan(&self, id: ScanId) -> Result<Scan, Error> {
        let row = sqlx::query("SELECT body FROM scan WHERE id = ?1").bind(id.to_string()).fetch_optional(&self.reader).await?;
        read(&row.ok_or(Error::ScanNotFound(id))?)
    }

    /// Deletes a scan that no unfinished inspection reads, unless its job has the label `hold`.
    pub(crate) async fn delete_scan(&self, id: ScanId, hold: &str) -> Result<(), Error> {
        let orphan: String = {
            let mut tx = self.writer.begin().await?;
            check_hold_of(&mut tx, "SELECT job_id FROM scan WHERE id = ?1", id.to_string(), hold).await?;
            let open: i64 = sqlx::query_scalar(
                "SELECT count(*) FROM inspection JOIN scan ON scan.job_id = inspection.job_id
                 WHERE scan.id = ?1 AND inspection.state IN (?2, ?3, ?4)",
            )
            .bind(id.to_string())
            .bind(JobState::Queued.as_str())
            .bind(JobState::Running.as_str())
            .bind(JobState::Cancelling.as_str())
            .fetch_one(&mut *tx)
            .await?;
            if open > 0 {
                return Err(Error::ScanInUse(id));
            }
            let deleted = sqlx::query_scalar("DELETE FROM scan WHERE id = ?1 RETURNING sha256")
                .bind(id.to_string())
                .fetch_optional(&mut *tx)
                .await?;
            tx.commit().await?;
            deleted.ok_or(Error::ScanNotFound(id))?
        };
        self.remove_unreferenced(vec![orphan]).await
    }
}

fn read(row: &SqliteRow) -> Result<Scan, Error> {
    let (scan, _) = read_leniently(VERSION, &row.try_get::<String, _>("body")?).map_err(InternalError::Row)?;
    Ok(scan)
}
