//! Sweep of orphans: files that no row refers to, left by a crash between file and row or by a database restored to an
//! earlier state. They are first moved to `swept/`, once they are old enough, and removed from there later, so that a mistake
//! can be undone by moving them back.

use std::collections::BTreeSet;
use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime};

use super::files::StoredFile;
use super::{Store, blocking};
use crate::service::error::Error;

/// Counts of a sweep.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct SweepReport {
    /// Files moved to `swept/`.
    pub moved: usize,
    /// Files removed from there.
    pub removed: usize,
}

impl Store {
    /// Moves orphans older than `age` to `swept/`, and removes files that have been there for `retention`. If the database
    /// refers to no file at all, nothing is moved: the files may belong to another database. Nothing is moved or removed while the
    /// clock is not steady.
    pub(crate) async fn sweep(&self, age: Duration, retention: Duration) -> Result<SweepReport, Error> {
        if !self.clock.is_steady() {
            return Ok(SweepReport::default());
        }
        let files = self.files.clone();
        let found = blocking(move || Ok(files.list()?)).await?;
        let referenced = self.referenced_files().await?;
        let mut report = SweepReport::default();
        if referenced.is_empty() && !found.is_empty() {
            tracing::warn!(files = found.len(), "the database refers to none of the files in the store; nothing is swept");
        } else {
            for file in found.iter().filter(|file| !referenced.contains(&file.sha256) && is_older(file, age)) {
                report.moved += usize::from(self.sweep_one(&file.sha256).await?);
            }
        }
        let files = self.files.clone();
        for file in blocking(move || Ok(files.list_swept()?)).await? {
            if is_older(&file, retention) {
                let files = self.files.clone();
                blocking(move || Ok(files.remove_swept(&file.sha256)?)).await?;
                report.removed += 1;
            }
        }
        if report != SweepReport::default() {
            tracing::info!(moved = report.moved, removed = report.removed, "orphaned files were swept");
        }
        Ok(report)
    }

    /// Moves a file to `swept/`, unless it is pinned or referenced by now.
    async fn sweep_one(&self, sha256: &str) -> Result<bool, Error> {
        let Some(_removing) = self.pinned.begin_removal(sha256).await else { return Ok(false) };
        if self.is_referenced(sha256).await? {
            return Ok(false);
        }
        let (files, sha256) = (self.files.clone(), sha256.to_owned());
        blocking(move || Ok(files.sweep(&sha256)?)).await?;
        Ok(true)
    }

    /// Removes those of the files that no row refers to any more and that are not pinned.
    pub(super) async fn remove_unreferenced(&self, candidates: Vec<String>) -> Result<(), Error> {
        for sha256 in candidates {
            let Some(_removing) = self.pinned.begin_removal(&sha256).await else { continue };
            if !self.is_referenced(&sha256).await? {
                let files = self.files.clone();
                let size_bytes = blocking(move || Ok(files.remove(&sha256)?)).await?;
                self.removed_bytes.fetch_add(size_bytes, Ordering::Relaxed);
            }
        }
        Ok(())
    }

    /// Total size of the files removed by this process because no row refers to them any more.
    pub(crate) fn removed_bytes(&self) -> u64 {
        self.removed_bytes.load(Ordering::Relaxed)
    }

    /// Hashes of all files that rows refer to.
    pub(super) async fn referenced_files(&self) -> Result<BTreeSet<String>, Error> {
        let referenced: Vec<String> =
            sqlx::query_scalar("SELECT DISTINCT sha256 FROM file_reference").fetch_all(&self.reader).await?;
        Ok(referenced.into_iter().collect())
    }

    /// Returns true if a row refers to the file.
    pub(super) async fn is_referenced(&self, sha256: &str) -> Result<bool, Error> {
        let is_referenced = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM file_reference WHERE sha256 = ?1)")
            .bind(sha256)
            .fetch_one(&self.reader)
            .await?;
        Ok(is_referenced)
    }
}

fn is_older(file: &StoredFile, age: Duration) -> bool {
    // A time in the future means that the clock was set back: such a file counts as young.
    SystemTime::now().duration_since(file.modified).is_ok_and(|old| old >= age)
}
