//! What the service cannot do, and why. The HTTP room maps these to status codes.

use std::sync::Arc;

use crate::cell::FieldError;
use crate::wire::{JobId, JobState, MeshId, SpecCollection};

/// Why the service did not do what was asked.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Error {
    /// No such mesh.
    #[error("there is no mesh {0}")]
    MeshNotFound(MeshId),
    /// No such job.
    #[error("there is no job {0}")]
    JobNotFound(JobId),
    /// No such specification.
    #[error("there is no {} {name:?}", kind.as_str())]
    SpecNotFound {
        /// Of which kind.
        kind: SpecCollection,
        /// Called what.
        name: String,
    },
    /// The job has no such result, and will not get it.
    #[error("job {job} has no {name}")]
    NoSuchResult {
        /// The job.
        job: JobId,
        /// The result.
        name: String,
    },
    /// The job has no result yet, or ended without.
    #[error("job {job} is {}; only a succeeded job has results", state.as_str())]
    NoResults {
        /// The job.
        job: JobId,
        /// Where it stands.
        state: JobState,
    },
    /// Fields that are out of range or inconsistent.
    #[error("{} of the fields cannot be accepted", .0.len())]
    Invalid(Vec<FieldError>),
    /// The file is no mesh that can be planned on.
    #[error("{0}")]
    MeshUnreadable(String),
    /// The upload is larger than allowed.
    #[error("the file is larger than the allowed {limit_bytes} bytes")]
    UploadTooLarge {
        /// Largest size.
        limit_bytes: u64,
    },
    /// The upload's digest is not the one announced.
    #[error("the file's SHA-256 is {found}, announced was {announced}")]
    DigestMismatch {
        /// Of the bytes received.
        found: String,
        /// In the request.
        announced: String,
    },
    /// The mesh is needed by a job that has not ended.
    #[error("mesh {0} is needed by a job that has not ended")]
    MeshInUse(MeshId),
    /// The job has not ended.
    #[error("job {job} is {}; cancel it and wait for its end first", state.as_str())]
    JobNotEnded {
        /// The job.
        job: JobId,
        /// Where it stands.
        state: JobState,
    },
    /// The job has ended: there is nothing to cancel.
    #[error("job {job} is {}; there is nothing to cancel", state.as_str())]
    JobEnded {
        /// The job.
        job: JobId,
        /// Where it stands.
        state: JobState,
    },
    /// A preset cannot be changed.
    #[error("{} {name:?} came with the program and cannot be changed; store yours under another name", kind.as_str())]
    SpecIsPreset {
        /// Of which kind.
        kind: SpecCollection,
        /// Called what.
        name: String,
    },
    /// An update without saying of which version.
    #[error("the {} {name:?} exists; say which version is to be replaced, with If-Match: {etag}", kind.as_str())]
    PreconditionRequired {
        /// Of which kind.
        kind: SpecCollection,
        /// Called what.
        name: String,
        /// Its entity tag now.
        etag: String,
    },
    /// Somebody changed it in between.
    #[error("the precondition does not hold: the entity tag is now {}", .0.as_deref().unwrap_or("none"))]
    PreconditionFailed(Option<String>),
    /// The key was used for another request.
    #[error("this Idempotency-Key was used for another request within 24 hours")]
    IdempotencyMismatch,
    /// The page token is none of ours, or of another listing.
    #[error("the page token is not one that this listing gave")]
    BadPageToken,
    /// Too many jobs wait.
    #[error("{queued} jobs are queued, which is the limit")]
    QueueFull {
        /// Jobs in the queue.
        queued: u64,
    },
    /// The disk is full.
    #[error("the disk has no room for it")]
    StorageFull,
    /// The disk is nearly full, and what is left is kept for jobs that run.
    #[error(
        "the disk has {free_bytes} bytes left of which {floor_bytes} are kept for jobs that run (store.min_free_bytes, \
         store.min_free_share); delete jobs and meshes or make room"
    )]
    StorageLow {
        /// Free space.
        free_bytes: u64,
        /// Free space that is kept.
        floor_bytes: u64,
    },
    /// Another process holds the database, or the machine is short of something for a moment.
    #[error("the store cannot be used at the moment: {0}")]
    StorageBusy(Fault),
    /// A file of the store is missing or does not have the bytes that its name stands for.
    #[error("file {sha256} of the store is {}; upload the same mesh or plan the same job again, or restore a backup",
        if *missing { "missing" } else { "damaged" })]
    FileDamaged {
        /// Its name: the hash of the bytes that it should have.
        sha256: String,
        /// It is not there at all.
        missing: bool,
    },
    /// The job's label keeps it from being deleted.
    #[error("job {job} has the label {label:?}, which keeps it from being deleted; take the label off first")]
    JobHeld {
        /// The job.
        job: JobId,
        /// The key of the label.
        label: String,
    },
    /// What the request names could not be looked up and checked in time.
    #[error("what the request names could not be looked up and checked in time; nothing was changed")]
    TooSlow,
    /// The server is about to stop.
    #[error("the server is about to stop")]
    Draining,
    /// A fault of ours.
    #[error("{0}")]
    Internal(#[from] Fault),
}

/// A fault of the program or the machine, for the log and not for the client.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Fault {
    /// The database failed.
    #[error("the database failed")]
    Database(#[source] Arc<sqlx::Error>),
    /// A file could not be read or written.
    #[error("a file of the store failed")]
    File(#[source] Arc<std::io::Error>),
    /// A row holds what cannot be read.
    #[error("a row of the store cannot be read: {0}")]
    Row(String),
    /// A task ended without an answer.
    #[error("a task ended without an answer: {0}")]
    Task(String),
}

impl Error {
    /// Whether the same may succeed later without anybody changing the request: for want of room, of file descriptors or
    /// of the database's lock, or after a fault of the disk that was not for good.
    #[must_use]
    pub fn is_transient(&self) -> bool {
        matches!(self, Self::StorageFull | Self::StorageLow { .. } | Self::StorageBusy(_))
    }
}

/// Primary result codes of SQLite that say nothing lasting about the database (<https://www.sqlite.org/rescode.html>): BUSY,
/// LOCKED, NOMEM, IOERR, CANTOPEN, PROTOCOL.
const SQLITE_TRANSIENT: [u32; 6] = [5, 6, 7, 10, 14, 15];
const SQLITE_FULL: u32 = 13;

fn is_transient_of_database(error: &sqlx::Error) -> bool {
    match error {
        sqlx::Error::Io(error) => is_transient_io(error),
        sqlx::Error::PoolTimedOut => true,
        error => sqlite_code(error).is_some_and(|code| SQLITE_TRANSIENT.contains(&code)),
    }
}

/// The primary result code: the low byte of the extended one.
fn sqlite_code(error: &sqlx::Error) -> Option<u32> {
    let code: u32 = error.as_database_error()?.code()?.parse().ok()?;
    Some(code & 0xff)
}

/// Whether an error of the operating system says nothing lasting about the file: too many are open, in the process or on
/// the machine, the disk has no room, or a read or write failed.
pub(super) fn is_transient_io(error: &std::io::Error) -> bool {
    use std::io::ErrorKind;
    matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded) || is_shortage(error)
}

#[cfg(unix)]
fn is_shortage(error: &std::io::Error) -> bool {
    use rustix::io::Errno;
    let shortages = [Errno::MFILE, Errno::NFILE, Errno::NOMEM, Errno::IO, Errno::AGAIN].map(Errno::raw_os_error);
    error.raw_os_error().is_some_and(|code| shortages.contains(&code))
}

#[cfg(not(unix))]
fn is_shortage(_: &std::io::Error) -> bool {
    false
}

impl From<sqlx::Error> for Error {
    fn from(error: sqlx::Error) -> Self {
        if sqlite_code(&error) == Some(SQLITE_FULL) {
            return Self::StorageFull;
        }
        if is_transient_of_database(&error) {
            return Self::StorageBusy(Fault::Database(Arc::new(error)));
        }
        Fault::Database(Arc::new(error)).into()
    }
}

impl From<std::io::Error> for Error {
    fn from(error: std::io::Error) -> Self {
        use std::io::ErrorKind;
        match error.kind() {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => Self::StorageFull,
            _ if is_transient_io(&error) => Self::StorageBusy(Fault::File(Arc::new(error))),
            _ => Fault::File(Arc::new(error)).into(),
        }
    }
}

impl From<serde_json::Error> for Error {
    fn from(error: serde_json::Error) -> Self {
        Fault::Row(error.to_string()).into()
    }
}

impl From<tokio::task::JoinError> for Error {
    fn from(error: tokio::task::JoinError) -> Self {
        Fault::Task(error.to_string()).into()
    }
}

#[cfg(test)]
mod tests;
