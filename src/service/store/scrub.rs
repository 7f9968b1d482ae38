//! Scrubbing: finds damage before someone needs the damaged data: unreadable rows, missing files, and files whose bytes do
//! not match their hash. Findings are logged and kept for the storage report.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::meshes::read_health;
use super::stored::{read_leniently, text};
use super::{Store, blocking};
use crate::service::error::Error;
use crate::service::metrics;
use crate::wire::JobRequest;

/// Rows read per query.
const BATCH_ROWS: i64 = 500;
/// Ratio of pause to reading time when files are scrubbed: at 9, scrubbing takes at most a tenth of the disk's bandwidth.
const PAUSE_PER_READ: u32 = 9;
/// Reason that is given for a file that is not there.
const MISSING: &str = "is missing";
/// Max number of findings kept.
const MAX_KEPT: usize = 1000;

/// A damaged item and what is wrong with it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Damage {
    /// `mesh ID`, `job ID` or `file SHA-256`.
    pub name: String,
    /// Description of the damage.
    pub reason: String,
}

/// Known damage, by name. Its copies share it.
#[derive(Clone, Debug, Default)]
pub(super) struct KnownDamage(Arc<Mutex<BTreeMap<String, String>>>);

impl KnownDamage {
    fn lock(&self) -> std::sync::MutexGuard<'_, BTreeMap<String, String>> {
        // Entries are inserted whole, so a poisoned lock is usable.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Records what is wrong with an item, or that nothing is, and counts the damaged ones anew.
    pub(super) fn set(&self, name: String, reason: Option<String>) {
        let mut found = self.lock();
        match reason {
            None => drop(found.remove(&name)),
            Some(reason) if found.get(&name) != Some(&reason) && found.len() < MAX_KEPT => {
                tracing::error!(name, reason, "damage in the store");
                found.insert(name, reason);
            }
            Some(_) => {}
        }
        metrics::record(|metrics| metrics.store_damaged.set(found.len() as f64));
    }
}

impl Store {
    /// Known damage, by name.
    pub(crate) fn damage(&self) -> Vec<Damage> {
        self.files.damage.lock().iter().map(|(name, reason)| Damage { name: name.clone(), reason: reason.clone() }).collect()
    }

    /// Checks that every row can be read and that every file that rows refer to exists. Damage to what has been deleted, and
    /// files that are there again, are forgotten.
    pub(crate) async fn scrub_rows(&self) -> Result<(), Error> {
        self.scrub_jobs().await?;
        self.scrub_meshes().await?;
        let (files, referenced) = (self.files.clone(), self.referenced_files().await?);
        let found = blocking(move || Ok(files.list()?)).await?;
        let existing: std::collections::HashSet<_> = found.into_iter().map(|file| file.sha256).collect();
        for sha256 in &referenced {
            if !existing.contains(sha256) {
                self.files.damage.set(format!("file {sha256}"), Some(MISSING.to_owned()));
            }
        }
        for Damage { name, reason } in self.damage() {
            let is_gone = match name.split_once(' ') {
                Some(("file", sha256)) => !referenced.contains(sha256) || (reason == MISSING && existing.contains(sha256)),
                Some(("job", id)) => !self.has_row("SELECT EXISTS (SELECT 1 FROM job_body WHERE job_id = ?1)", id).await?,
                Some(("mesh", id)) => !self.has_row("SELECT EXISTS (SELECT 1 FROM mesh WHERE id = ?1)", id).await?,
                _ => false,
            };
            if is_gone {
                self.files.damage.set(name, None);
            }
        }
        Ok(())
    }

    async fn has_row(&self, query: &'static str, id: &str) -> Result<bool, Error> {
        Ok(sqlx::query_scalar(query).bind(id).fetch_one(&self.reader).await?)
    }

    async fn scrub_jobs(&self) -> Result<(), Error> {
        let mut after = String::new();
        loop {
            let rows = sqlx::query("SELECT job_id, version, request FROM job_body WHERE job_id > ?1 ORDER BY job_id LIMIT ?2")
                .bind(&after)
                .bind(BATCH_ROWS)
                .fetch_all(&self.reader)
                .await?;
            let Some(last) = rows.last() else { return Ok(()) };
            after = last.try_get("job_id")?;
            let stored = |row: &SqliteRow| -> Result<(String, i64, Result<String, String>), Error> {
                Ok((row.try_get("job_id")?, row.try_get("version")?, text(row, "request")))
            };
            let requests: Vec<_> = rows.iter().map(stored).collect::<Result<_, Error>>()?;
            let read = |(id, version, request): (String, i64, Result<String, String>)| {
                let read = request.and_then(|request| read_leniently::<JobRequest>(version, &request));
                (format!("job {id}"), read.err())
            };
            self.record(blocking(move || Ok(requests.into_iter().map(read).collect())).await?);
        }
    }

    fn record(&self, checked: Vec<(String, Option<String>)>) {
        checked.into_iter().for_each(|(name, reason)| self.files.damage.set(name, reason));
    }

    async fn scrub_meshes(&self) -> Result<(), Error> {
        let mut after = String::new();
        loop {
            let rows = sqlx::query("SELECT id, health FROM mesh WHERE id > ?1 ORDER BY id LIMIT ?2")
                .bind(&after)
                .bind(BATCH_ROWS)
                .fetch_all(&self.reader)
                .await?;
            let Some(last) = rows.last() else { return Ok(()) };
            after = last.try_get("id")?;
            let stored = |row: &SqliteRow| -> Result<(String, Result<String, String>), Error> {
                Ok((row.try_get("id")?, text(row, "health")))
            };
            let reports: Vec<_> = rows.iter().map(stored).collect::<Result<_, Error>>()?;
            let read = |(id, health): (String, Result<String, String>)| {
                (format!("mesh {id}"), health.and_then(|health| read_health(&health)).err())
            };
            self.record(blocking(move || Ok(reports.into_iter().map(read).collect())).await?);
        }
    }

    /// Compares every file that rows refer to with its hash, at a tenth of the disk's bandwidth. An error at one of them is returned once
    /// the others are checked.
    pub(crate) async fn scrub_files(&self) -> Result<(), Error> {
        let mut scrubbed = Ok(());
        for sha256 in self.referenced_files().await? {
            let began = Instant::now();
            scrubbed = scrubbed.and(self.scrub_file(&sha256).await);
            tokio::time::sleep(began.elapsed() * PAUSE_PER_READ).await;
        }
        scrubbed
    }

    /// Records the damage that was found while files were read.
    pub(crate) async fn scrub_suspects(&self) -> Result<(), Error> {
        let mut scrubbed = Ok(());
        for sha256 in self.files.take_suspects() {
            let checked = self.scrub_file(&sha256).await;
            if checked.is_err() {
                self.files.suspect(&sha256);
            }
            scrubbed = scrubbed.and(checked);
        }
        scrubbed
    }

    async fn scrub_file(&self, sha256: &str) -> Result<(), Error> {
        let (files, hash) = (self.files.clone(), sha256.to_owned());
        match blocking(move || files.open_compared(&hash).map(drop)).await {
            Ok(()) => self.files.damage.set(format!("file {sha256}"), None),
            Err(Error::FileDamaged { missing, .. }) => {
                // The file may have been deleted since it was listed or read.
                let is_referenced = self.is_referenced(sha256).await?;
                let reason = if missing { MISSING } else { "has bytes that cannot be read or do not match its hash" };
                self.files.damage.set(format!("file {sha256}"), is_referenced.then(|| reason.to_owned()));
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }
}
