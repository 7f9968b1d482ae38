//! Sessions of browsers that have shown the key: a cookie holds a random id, we hold its hash. They end when they are
//! ended, when nobody used them for a long time, and with the process.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use sha2::{Digest, Sha256};

use crate::service::hex;

/// A session that is not used for so long is over.
pub(super) const IDLE: Duration = Duration::from_secs(12 * 3600);
/// Sessions at the same time; beyond, the one that was not used for longest ends.
const MAX_SESSIONS: usize = 1024;
const ID_BYTES: usize = 32;

type Hash = [u8; 32];

/// The open sessions: when each was last used, by the hash of its id.
#[derive(Default)]
pub(super) struct Sessions(Mutex<HashMap<Hash, Instant>>);

impl Sessions {
    /// Begins a session; returns its id, 256 random bits in hexadecimal.
    ///
    /// # Errors
    /// The system gives no random numbers.
    pub(super) fn begin(&self, now: Instant) -> Result<String, getrandom::Error> {
        let mut id = [0; ID_BYTES];
        getrandom::fill(&mut id)?;
        let id = hex(&id);
        let mut open = self.lock();
        open.retain(|_, used| now.saturating_duration_since(*used) < IDLE);
        while open.len() >= MAX_SESSIONS {
            let Some(oldest) = open.iter().min_by_key(|(_, used)| **used).map(|(hash, _)| *hash) else { break };
            open.remove(&oldest);
        }
        open.insert(hash(&id), now);
        Ok(id)
    }

    /// Whether there is such a session; it counts as used.
    pub(super) fn is_open(&self, id: &str, now: Instant) -> bool {
        let mut open = self.lock();
        let hash = hash(id);
        match open.get_mut(&hash) {
            Some(used) if now.saturating_duration_since(*used) < IDLE => {
                *used = now;
                true
            }
            Some(_) => {
                open.remove(&hash);
                false
            }
            None => false,
        }
    }

    /// Ends a session, if there is such a one.
    pub(super) fn end(&self, id: &str) {
        self.lock().remove(&hash(id));
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Hash, Instant>> {
        // The map is whole after every operation.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn hash(id: &str) -> Hash {
    Sha256::digest(id).into()
}

#[cfg(test)]
mod tests;
