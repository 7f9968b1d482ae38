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
    /// A file of the store is not what its name says.
    #[error("file {0} of the store is damaged")]
    Damaged(String),
    /// A row holds what cannot be read.
    #[error("a row of the store cannot be read: {0}")]
    Row(String),
    /// A task ended without an answer.
    #[error("a task ended without an answer: {0}")]
    Task(String),
}

impl From<sqlx::Error> for Error {
    fn from(error: sqlx::Error) -> Self {
        const SQLITE_FULL: &str = "13";
        if error.as_database_error().and_then(|e| e.code()).as_deref() == Some(SQLITE_FULL) {
            return Self::StorageFull;
        }
        Fault::Database(Arc::new(error)).into()
    }
}

impl From<std::io::Error> for Error {
    fn from(error: std::io::Error) -> Self {
        use std::io::ErrorKind;
        match error.kind() {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => Self::StorageFull,
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
