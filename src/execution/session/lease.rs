//! The right to move a cell: one holder at a time, for a stated time, with a token that only rises. Whoever lost the lease cannot
//! move anything with the token of before.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

/// Fencing token: higher than every one before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Fence(pub u64);

/// Shortest time of a lease.
pub const MIN_TTL: Duration = Duration::from_millis(200);
/// Longest time of a lease.
pub const MAX_TTL: Duration = Duration::from_secs(30);
/// Time for which an ended lease is known, so that its holder is told that it ran out. Any name of a cell may be asked for: none is kept
/// for ever.
const KEPT_AFTER_END: Duration = Duration::from_secs(60);

/// A lease that was given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lease {
    /// Name of the cell.
    pub cell: String,
    /// Name of the holder.
    pub holder: String,
    /// Token of the lease.
    pub token: Fence,
    /// Time from a renewal to its end.
    pub ttl: Duration,
    /// End, unless it is renewed.
    pub expires_at: Instant,
}

/// Reason why a lease is not given, or no longer holds.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LeaseError {
    /// A cell whose lease another client holds.
    #[error("cell {cell} is leased to {} for another {} ms, longer if they renew it",
        if holder.is_empty() { "another client" } else { holder.as_str() }, remaining.as_millis())]
    Held {
        /// Name of the cell.
        cell: String,
        /// Name of the holder.
        holder: String,
        /// Time to its end, unless renewed.
        remaining: Duration,
    },
    /// A lease that ran out.
    #[error("the lease of cell {cell} with token {} ran out; take a new one", token.0)]
    Expired {
        /// Name of the cell.
        cell: String,
        /// Token that was shown.
        token: Fence,
    },
    /// A command to move without a token.
    #[error("moving cell {cell} needs the token of its lease; take the lease, and send its token with each command")]
    NoToken {
        /// Name of the cell.
        cell: String,
    },
    /// A token of another lease.
    #[error("token {} is not that of the lease of cell {cell}; take the lease first", token.0)]
    WrongToken {
        /// Name of the cell.
        cell: String,
        /// Token that was shown.
        token: Fence,
    },
    /// A lease for a time that is not allowed.
    #[error("a lease lasts {} to {} ms, not {} ms; set execution.lease_secs within that",
        MIN_TTL.as_millis(), MAX_TTL.as_millis(), .0.as_millis())]
    Ttl(Duration),
}

/// Leases of all cells; cheap to clone, and the same for all clones.
#[derive(Clone, Debug, Default)]
pub struct Leases(Arc<Mutex<LeaseTable>>);

#[derive(Debug, Default)]
struct LeaseTable {
    last: u64,
    of_cell: BTreeMap<String, Lease>,
}

impl Leases {
    /// Leases whose tokens are all above `last`, the highest that was ever given.
    #[must_use]
    pub fn after(last: Fence) -> Self {
        Self(Arc::new(Mutex::new(LeaseTable { last: last.0, of_cell: BTreeMap::new() })))
    }

    /// Gives the lease of a cell.
    ///
    /// # Errors
    /// [`LeaseError::Held`] by anybody, the same holder too, until it ran out or was given back; [`LeaseError::Ttl`].
    pub fn acquire(&self, cell: &str, holder: &str, ttl: Duration) -> Result<Lease, LeaseError> {
        if !(MIN_TTL..=MAX_TTL).contains(&ttl) {
            return Err(LeaseError::Ttl(ttl));
        }
        let (mut table, now) = (self.table(), Instant::now());
        if let Some(held) = table.of_cell.get(cell).filter(|held| now < held.expires_at) {
            let (cell, holder, remaining) = (held.cell.clone(), held.holder.clone(), held.expires_at - now);
            return Err(LeaseError::Held { cell, holder, remaining });
        }
        table.of_cell.retain(|_, lease| now < lease.expires_at + KEPT_AFTER_END);
        table.last += 1;
        let (token, expires_at) = (Fence(table.last), now + ttl);
        let lease = Lease { cell: cell.to_owned(), holder: holder.to_owned(), token, ttl, expires_at };
        table.of_cell.insert(cell.to_owned(), lease.clone());
        Ok(lease)
    }

    /// Puts the end of a lease off by its time, from now.
    ///
    /// # Errors
    /// A lease that is not this token's any more, or has run out: it is not brought back to life.
    pub fn renew(&self, cell: &str, token: Fence) -> Result<Lease, LeaseError> {
        let (mut table, now) = (self.table(), Instant::now());
        let lease = table.valid(cell, token, now)?;
        lease.expires_at = now + lease.ttl;
        Ok(lease.clone())
    }

    /// Gives a lease back.
    ///
    /// # Errors
    /// A lease that is not this token's any more.
    pub fn release(&self, cell: &str, token: Fence) -> Result<(), LeaseError> {
        let mut table = self.table();
        table.valid(cell, token, Instant::now())?;
        table.of_cell.remove(cell);
        Ok(())
    }

    /// Refuses a token that does not hold the lease of the cell now.
    ///
    /// # Errors
    /// [`LeaseError::Expired`] and [`LeaseError::WrongToken`].
    pub fn check(&self, cell: &str, token: Fence) -> Result<(), LeaseError> {
        self.table().valid(cell, token, Instant::now()).map(|_| ())
    }

    /// The lease of a cell that holds now.
    #[must_use]
    pub fn current(&self, cell: &str) -> Option<Lease> {
        self.table().of_cell.get(cell).filter(|lease| Instant::now() < lease.expires_at).cloned()
    }

    fn table(&self) -> MutexGuard<'_, LeaseTable> {
        // Every change is one assignment: what a panic leaves is whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LeaseTable {
    fn valid(&mut self, cell: &str, token: Fence, now: Instant) -> Result<&mut Lease, LeaseError> {
        let wrong_token = || LeaseError::WrongToken { cell: cell.to_owned(), token };
        let lease = self.of_cell.get_mut(cell).filter(|lease| lease.token == token).ok_or_else(wrong_token)?;
        if now < lease.expires_at { Ok(lease) } else { Err(LeaseError::Expired { cell: cell.to_owned(), token }) }
    }
}

#[cfg(test)]
mod tests;
