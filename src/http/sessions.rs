//! Sessions of browsers that presented the key: a cookie holds a random id, the server holds its hash. A session ends on
//! request, when it is idle for too long, and with the process.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use sha2::{Digest, Sha256};

use super::keys::KeyDigest;
use crate::wire::hex;

/// Time without use after which a session ends.
pub(super) const IDLE_TIMEOUT: Duration = Duration::from_secs(12 * 3600);
/// Largest number of open sessions; one more ends the least recently used.
const MAX_SESSIONS: usize = 1024;
const ID_BYTES: usize = 32;

type Hash = [u8; 32];

/// An open session.
#[derive(Clone, Copy)]
struct Session {
    /// Time of its last use.
    used: Instant,
    /// Digest of the key that it was begun with.
    key: KeyDigest,
}

/// Open sessions, by hash of the id.
#[derive(Default)]
pub(super) struct Sessions(Mutex<HashMap<Hash, Session>>);

impl Sessions {
    /// Begins a session with a key and returns its id, 256 random bits in hexadecimal.
    ///
    /// # Errors
    /// The system provides no random numbers.
    pub(super) fn begin(&self, key: KeyDigest, now: Instant) -> Result<String, getrandom::Error> {
        let mut id = [0; ID_BYTES];
        getrandom::fill(&mut id)?;
        let id = hex(&id);
        let mut open = self.lock();
        open.retain(|_, session| now.saturating_duration_since(session.used) < IDLE_TIMEOUT);
        while open.len() >= MAX_SESSIONS {
            let Some(oldest) = open.iter().min_by_key(|(_, session)| session.used).map(|(hash, _)| *hash) else { break };
            open.remove(&oldest);
        }
        open.insert(hash(&id), Session { used: now, key });
        Ok(id)
    }

    /// Digest of the key that an open session was begun with; asking counts as use.
    pub(super) fn key_of(&self, id: &str, now: Instant) -> Option<KeyDigest> {
        let mut open = self.lock();
        let hash = hash(id);
        match open.get_mut(&hash) {
            Some(session) if now.saturating_duration_since(session.used) < IDLE_TIMEOUT => {
                session.used = now;
                Some(session.key)
            }
            Some(_) => {
                open.remove(&hash);
                None
            }
            None => None,
        }
    }

    /// Digest of the key that an open session was begun with; asking is not a use.
    pub(super) fn begun_with(&self, id: &str, now: Instant) -> Option<KeyDigest> {
        let session = self.lock().get(&hash(id)).copied();
        session.filter(|session| now.saturating_duration_since(session.used) < IDLE_TIMEOUT).map(|session| session.key)
    }

    /// Ends a session; unknown ids are ignored.
    pub(super) fn end(&self, id: &str) {
        self.lock().remove(&hash(id));
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Hash, Session>> {
        // No operation leaves the map half changed.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn hash(id: &str) -> Hash {
    Sha256::digest(id).into()
}

#[cfg(test)]
mod tests;
