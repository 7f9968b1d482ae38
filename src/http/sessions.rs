//! Sessions of browsers that presented the key: a cookie holds a random id, the server holds its hash. A session ends on
//! request, when it is idle for too long, and with the process.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use sha2::{Digest, Sha256};

use crate::service::hex;

/// Time without use after which a session ends.
pub(super) const IDLE_TIMEOUT: Duration = Duration::from_secs(12 * 3600);
/// Largest number of open sessions; one more ends the least recently used.
const MAX_SESSIONS: usize = 1024;
const ID_BYTES: usize = 32;

type Hash = [u8; 32];

/// Open sessions: time of last use by hash of the id.
#[derive(Default)]
pub(super) struct Sessions(Mutex<HashMap<Hash, Instant>>);

impl Sessions {
    /// Begins a session and returns its id, 256 random bits in hexadecimal.
    ///
    /// # Errors
    /// The system provides no random numbers.
    pub(super) fn begin(&self, now: Instant) -> Result<String, getrandom::Error> {
        let mut id = [0; ID_BYTES];
        getrandom::fill(&mut id)?;
        let id = hex(&id);
        let mut open = self.lock();
        open.retain(|_, used| now.saturating_duration_since(*used) < IDLE_TIMEOUT);
        while open.len() >= MAX_SESSIONS {
            let Some(oldest) = open.iter().min_by_key(|(_, used)| **used).map(|(hash, _)| *hash) else { break };
            open.remove(&oldest);
        }
        open.insert(hash(&id), now);
        Ok(id)
    }

    /// True if the session is open; asking counts as use.
    pub(super) fn is_open(&self, id: &str, now: Instant) -> bool {
        let mut open = self.lock();
        let hash = hash(id);
        match open.get_mut(&hash) {
            Some(used) if now.saturating_duration_since(*used) < IDLE_TIMEOUT => {
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

    /// Ends a session; unknown ids are ignored.
    pub(super) fn end(&self, id: &str) {
        self.lock().remove(&hash(id));
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Hash, Instant>> {
        // No operation leaves the map half changed.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn hash(id: &str) -> Hash {
    Sha256::digest(id).into()
}

#[cfg(test)]
mod tests;
