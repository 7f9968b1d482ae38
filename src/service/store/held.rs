//! Files that no row names yet, though somebody is about to write that row: nobody removes them meanwhile. Holding waits
//! for no transaction and no job, so a job that waits for room on the disk stops no deletion that would make some.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How often each file is held, by its hash.
#[derive(Clone, Debug, Default)]
pub(super) struct HeldFiles(Arc<State>);

#[derive(Debug, Default)]
struct State {
    counts: Mutex<HashMap<String, usize>>,
    /// Held while one file is removed, from the look at the counts until it is gone.
    removing: tokio::sync::Mutex<()>,
}

/// Keeps files from being removed while it lives.
#[derive(Debug)]
pub(crate) struct Hold {
    files: HeldFiles,
    hashes: Vec<String>,
}

impl HeldFiles {
    /// Holds files, which may or may not be there yet.
    pub(super) async fn hold(&self, hashes: Vec<String>) -> Hold {
        let _between_removals = self.0.removing.lock().await;
        let mut counts = self.lock();
        for hash in &hashes {
            *counts.entry(hash.clone()).or_default() += 1;
        }
        drop(counts);
        Hold { files: self.clone(), hashes }
    }

    /// Begins to remove a file; `None` when somebody holds it. Nobody can hold it until the guard is dropped.
    pub(super) async fn begin_removal(&self, hash: &str) -> Option<tokio::sync::MutexGuard<'_, ()>> {
        let removing = self.0.removing.lock().await;
        let is_held = self.lock().contains_key(hash);
        (!is_held).then_some(removing)
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<String, usize>> {
        // The counts are whole after every operation.
        self.0.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Hold {
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
