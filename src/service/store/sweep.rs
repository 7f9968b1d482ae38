//! Files that no row names: left by a crash between file and row, or by a database that went back to an earlier state.
//! They are moved to `swept/` once nobody has written them for a while, and removed from there a good while later, so
//! that a mistake can be undone by moving them back.

use std::collections::HashSet;
use std::time::{Duration, SystemTime};

use super::files::Found;
use super::{Store, blocking};
use crate::service::error::Error;

/// What a sweep did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Swept {
    /// Files moved to `swept/`.
    pub moved: usize,
    /// Files removed from there.
    pub removed: usize,
}

impl Store {
    /// Moves files that no row names and that are older than `age` to `swept/`, and removes those that have been there for
    /// `retention`. Where the database names no file at all, nothing is moved: it is not the one that these files had.
    pub(crate) async fn sweep(&self, age: Duration, retention: Duration) -> Result<Swept, Error> {
        let files = self.files.clone();
        let found = blocking(move || Ok(files.list()?)).await?;
        let named = self.named_files().await?;
        let mut swept = Swept::default();
        if named.is_empty() && !found.is_empty() {
            tracing::warn!(files = found.len(), "the database names none of the files in the store; nothing is swept");
        } else {
            for file in found.iter().filter(|file| !named.contains(&file.sha256) && is_older(file, age)) {
                swept.moved += usize::from(self.sweep_one(&file.sha256).await?);
            }
        }
        let files = self.files.clone();
        for file in blocking(move || Ok(files.list_swept()?)).await? {
            if is_older(&file, retention) {
                let files = self.files.clone();
                blocking(move || Ok(files.remove_swept(&file.sha256)?)).await?;
                swept.removed += 1;
            }
        }
        if swept != Swept::default() {
            tracing::info!(moved = swept.moved, removed = swept.removed, "files that nothing refers to were swept");
        }
        Ok(swept)
    }

    /// Moves the file away, unless somebody holds it or has named it meanwhile.
    async fn sweep_one(&self, sha256: &str) -> Result<bool, Error> {
        let Some(_removing) = self.held.begin_removal(sha256).await else { return Ok(false) };
        if self.is_named(sha256).await? {
            return Ok(false);
        }
        let (files, sha256) = (self.files.clone(), sha256.to_owned());
        blocking(move || Ok(files.sweep(&sha256)?)).await?;
        Ok(true)
    }

    /// Removes those of the files that no row names and nobody holds: what somebody has deleted.
    pub(super) async fn remove_unreferenced(&self, candidates: Vec<String>) -> Result<(), Error> {
        for sha256 in candidates {
            let Some(_removing) = self.held.begin_removal(&sha256).await else { continue };
            if !self.is_named(&sha256).await? {
                let files = self.files.clone();
                blocking(move || Ok(files.remove(&sha256)?)).await?;
            }
        }
        Ok(())
    }

    /// Hashes of all files that rows name.
    pub(super) async fn named_files(&self) -> Result<HashSet<String>, Error> {
        let named: Vec<String> = sqlx::query_scalar(
            "SELECT sha256 FROM mesh UNION SELECT preview FROM mesh WHERE preview IS NOT NULL UNION SELECT file_sha256 FROM artifact",
        )
        .fetch_all(&self.reader)
        .await?;
        Ok(named.into_iter().collect())
    }

    /// Whether a row names the file.
    pub(super) async fn is_named(&self, sha256: &str) -> Result<bool, Error> {
        let named = sqlx::query_scalar(
            "SELECT EXISTS (SELECT 1 FROM mesh WHERE sha256 = ?1) OR EXISTS (SELECT 1 FROM mesh WHERE preview = ?1)
                 OR EXISTS (SELECT 1 FROM artifact WHERE file_sha256 = ?1)",
        )
        .bind(sha256)
        .fetch_one(&self.reader)
        .await?;
        Ok(named)
    }
}

fn is_older(file: &Found, age: Duration) -> bool {
    // A time in the future is that of a clock that was put back: the file is young.
    SystemTime::now().duration_since(file.modified).is_ok_and(|old| old >= age)
}
