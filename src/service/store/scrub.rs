//! Looking for damage before somebody needs what is damaged: rows that cannot be read, files that are missing, and files
//! whose bytes are not those that their names stand for. What is found is named in the log and kept for whoever asks.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use sqlx::Row;

use super::meshes::read_health;
use super::stored::read_leniently;
use super::{Store, blocking};
use crate::service::error::Error;
use crate::wire::JobRequest;

/// Rows read at a time.
const ROWS_AT_ONCE: i64 = 500;
/// A thorough look pauses this many times as long as it reads, so that it takes a tenth of a disk at most.
const PAUSE_PER_READ: u32 = 9;
/// Findings that are kept; what is beyond is counted only.
const MAX_KEPT: usize = 1000;

/// What is damaged: its name, and what is wrong with it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Damage {
    /// `mesh ID`, `job ID` or `file SHA-256`.
    pub name: String,
    /// What is wrong with it.
    pub reason: String,
}

/// What is known to be damaged.
#[derive(Debug, Default)]
pub(super) struct Findings(Mutex<BTreeMap<String, String>>);

impl Findings {
    fn lock(&self) -> std::sync::MutexGuard<'_, BTreeMap<String, String>> {
        // Entries are put in whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set(&self, name: String, reason: Option<String>) {
        let mut found = self.lock();
        match reason {
            None => drop(found.remove(&name)),
            Some(reason) if found.get(&name) != Some(&reason) && found.len() < MAX_KEPT => {
                tracing::error!(name, reason, "damage in the store");
                found.insert(name, reason);
            }
            Some(_) => {}
        }
    }
}

impl Store {
    /// What is known to be damaged, by name.
    pub(crate) fn damage(&self) -> Vec<Damage> {
        self.damage.lock().iter().map(|(name, reason)| Damage { name: name.clone(), reason: reason.clone() }).collect()
    }

    /// Looks at every row and at whether every file that rows name is there.
    pub(crate) async fn scrub_rows(&self) -> Result<(), Error> {
        self.scrub_jobs().await?;
        self.scrub_meshes().await?;
        let (files, named) = (self.files.clone(), self.named_files().await?);
        let found = blocking(move || Ok(files.list()?)).await?;
        let there: std::collections::HashSet<_> = found.into_iter().map(|file| file.sha256).collect();
        for sha256 in named {
            if !there.contains(&sha256) {
                self.damage.set(format!("file {sha256}"), Some("is missing".to_owned()));
            }
        }
        Ok(())
    }

    async fn scrub_jobs(&self) -> Result<(), Error> {
        let mut after = String::new();
        loop {
            let rows = sqlx::query("SELECT job_id, version, request FROM job_body WHERE job_id > ?1 ORDER BY job_id LIMIT ?2")
                .bind(&after)
                .bind(ROWS_AT_ONCE)
                .fetch_all(&self.reader)
                .await?;
            let Some(last) = rows.last() else { return Ok(()) };
            after = last.try_get("job_id")?;
            let requests: Vec<(String, i64, String)> =
                rows.iter().map(|row| Ok((row.try_get(0)?, row.try_get(1)?, row.try_get(2)?))).collect::<Result<_, Error>>()?;
            let read = |(id, version, request): (String, i64, String)| {
                (format!("job {id}"), read_leniently::<JobRequest>(version, &request).err())
            };
            self.note(blocking(move || Ok(requests.into_iter().map(read).collect())).await?);
        }
    }

    fn note(&self, looked_at: Vec<(String, Option<String>)>) {
        looked_at.into_iter().for_each(|(name, reason)| self.damage.set(name, reason));
    }

    async fn scrub_meshes(&self) -> Result<(), Error> {
        let mut after = String::new();
        loop {
            let rows = sqlx::query("SELECT id, health FROM mesh WHERE id > ?1 ORDER BY id LIMIT ?2")
                .bind(&after)
                .bind(ROWS_AT_ONCE)
                .fetch_all(&self.reader)
                .await?;
            let Some(last) = rows.last() else { return Ok(()) };
            after = last.try_get("id")?;
            let reports: Vec<(String, String)> =
                rows.iter().map(|row| Ok((row.try_get(0)?, row.try_get(1)?))).collect::<Result<_, Error>>()?;
            let read = |(id, health): (String, String)| (format!("mesh {id}"), read_health(&health).err());
            self.note(blocking(move || Ok(reports.into_iter().map(read).collect())).await?);
        }
    }

    /// Reads every file that rows name and compares it with its name, at a tenth of the disk's speed.
    pub(crate) async fn scrub_files(&self) -> Result<(), Error> {
        for sha256 in self.named_files().await? {
            let (files, hash) = (self.files.clone(), sha256.clone());
            let began = Instant::now();
            let checked = blocking(move || files.check(&hash).map(drop)).await;
            match checked {
                Ok(()) => self.damage.set(format!("file {sha256}"), None),
                Err(Error::FileDamaged { missing, .. }) => {
                    // It may have been deleted since the list was made.
                    let named = self.is_named(&sha256).await?;
                    let reason = if missing { "is missing" } else { "does not have the bytes that its name stands for" };
                    self.damage.set(format!("file {sha256}"), named.then(|| reason.to_owned()));
                }
                Err(error) => return Err(error),
            }
            tokio::time::sleep(began.elapsed() * PAUSE_PER_READ).await;
        }
        Ok(())
    }
}
