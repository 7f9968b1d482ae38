//! Pinned files: no row refers to them yet, but one is about to be written, so they must not be removed meanwhile. Pinning
//! waits for no transaction and no job, so a job that waits for disk space does not block the deletions that free it.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Pin counts of files, by hash.
#[derive(Clone, Debug, Default)]
pub(super) struct PinnedFiles(Arc<State>);

#[derive(Debug, Default)]
struct State {
    counts: Mutex<HashMap<String, usize>>,
    /// Locked while a file is removed, from the check of its count until it is gone.
    removing: tokio::sync::Mutex<()>,
}

/// Guard that protects files from removal.
#[derive(Debug)]
pub(crate) struct FilePin {
    files: PinnedFiles,
    hashes: Vec<String>,
}

impl PinnedFiles {
    /// Pins files, whether or not they exist yet.
    pub(super) async fn pin(&self, hashes: Vec<String>) -> FilePin {
        let _no_removal = self.0.removing.lock().await;
        let mut counts = self.lock();
        for hash in &hashes {
            *counts.entry(hash.clone()).or_default() += 1;
        }
        drop(counts);
        FilePin { files: self.clone(), hashes }
    }

    /// Begins to remove a file; `None` if it is pinned. No file can be pinned until the guard is dropped.
    pub(super) async fn begin_removal(&self, hash: &str) -> Option<tokio::sync::MutexGuard<'_, ()>> {
        let removing = self.0.removing.lock().await;
        let is_pinned = self.lock().contains_key(hash);
        (!is_pinned).then_some(removing)
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<String, usize>> {
        // The counts are consistent after every operation, so a poisoned lock is usable.
        self.0.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for FilePin {
    fn drop(&mut self) {
        let mut counts = self.files.lock();
        for hash in &self.hashes {
            if let Some(count) = counts.get_mut(hash) {
                *count -= 1;
                if *count == 0 {
                    counts.remove(hash);
                }
            }
        }
    }
}
