//! Errors of the service. The HTTP room maps them to status codes.

use std::fmt;
use std::sync::Arc;

use crate::cell::FieldError;
use crate::wire::calibration::CalibrationState;
use crate::wire::run::{ReportedState, RunMode};
use crate::wire::{CalibrationId, InspectionId, JobId, JobState, LeaseId, MeshId, ParseError, RunId, ScanId, SpecCollection};

/// Reasons why the service did not do what a client asked for.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Error {
    /// The mesh does not exist.
    #[error("there is no mesh {0}")]
    MeshNotFound(MeshId),
    /// The job does not exist.
    #[error("there is no job {0}")]
    JobNotFound(JobId),
    /// The specification does not exist.
    #[error("there is no {} {name:?}", kind.as_str())]
    SpecNotFound {
        /// Kind of the specification.
        kind: SpecCollection,
        /// Name of the specification.
        name: String,
    },
    /// The job succeeded without this result.
    #[error("job {job} has no {name}{advice}")]
    NoSuchResult {
        /// The job.
        job: JobId,
        /// Name of the result.
        name: String,
        /// Way to get one, if any, after a semicolon.
        advice: &'static str,
    },
    /// The job has not succeeded: it has no results yet, or ended without this one.
    #[error("job {job} is {}{reason}; only a succeeded job has results", state.as_str())]
    NoResults {
        /// The job.
        job: JobId,
        /// State of the job.
        state: JobState,
        /// Problem that it failed with and where to read on, in brackets; empty unless it failed.
        reason: String,
    },
    /// The run does not exist.
    #[error("{0}")]
    RunNotFound(MissingRun),
    /// The calibration does not exist.
    #[error("there is no calibration {0}")]
    CalibrationNotFound(CalibrationId),
    /// The calibration has not ended.
    #[error("calibration {calibration} is {}; cancel it, or wait until it has ended", state.as_str())]
    CalibrationNotEnded {
        /// The calibration.
        calibration: CalibrationId,
        /// State of the calibration.
        state: CalibrationState,
    },
    /// The calibration has ended.
    #[error("calibration {calibration} is {}; only one that is queued or running can be cancelled", state.as_str())]
    CalibrationNotQueued {
        /// The calibration.
        calibration: CalibrationId,
        /// State of the calibration.
        state: CalibrationState,
    },
    /// The calibration has no result.
    #[error("calibration {calibration} is {}; only one that succeeded has a result", state.as_str())]
    NoCalibration {
        /// The calibration.
        calibration: CalibrationId,
        /// State of the calibration.
        state: CalibrationState,
    },
    /// The calibration cannot be written into a cell.
    #[error("calibration {0} is of a scanner that stands in the cell (eye_to_hand), but a cell has its scanner on the flange")]
    NotOnFlange(CalibrationId),
    /// The scan does not exist.
    #[error("there is no scan {0}")]
    ScanNotFound(ScanId),
    /// An inspection of the scan's job has not ended.
    #[error("scan {0} belongs to a job with an inspection that has not ended; cancel that, or wait")]
    ScanInUse(ScanId),
    /// The job has no scans to inspect.
    #[error("job {0} has no scans; upload them with POST /api/v1/jobs/{0}/scans")]
    NoScans(JobId),
    /// The inspection does not exist.
    #[error("there is no inspection {0}")]
    InspectionNotFound(InspectionId),
    /// The inspection has not ended.
    #[error("inspection {inspection} is {}; cancel it, or wait until it has ended", state.as_str())]
    InspectionNotEnded {
        /// The inspection.
        inspection: InspectionId,
        /// State of the inspection.
        state: JobState,
    },
    /// The inspection has ended: there is nothing to cancel.
    #[error("inspection {inspection} is {}; there is nothing to cancel", state.as_str())]
    InspectionEnded {
        /// The inspection.
        inspection: InspectionId,
        /// State of the inspection.
        state: JobState,
    },
    /// The inspection has no result.
    #[error("inspection {inspection} is {}; only one that succeeded has a result", state.as_str())]
    NoInspection {
        /// The inspection.
        inspection: InspectionId,
        /// State of the inspection.
        state: JobState,
    },
    /// The inspection succeeded without this file.
    #[error("inspection {inspection} has no {name}")]
    NoInspectionFile {
        /// The inspection.
        inspection: InspectionId,
        /// Name of the file.
        name: String,
    },
    /// The lease does not exist, or has ended.
    #[error("there is no lease {0}: it was given back or not renewed in time; take it anew with POST /api/v1/leases")]
    LeaseNotFound(LeaseId),
    /// Somebody else holds the lease.
    #[error(
        "{0}; wait until it ends, or have its holder give it back with DELETE /api/v1/leases/{{id}}; if it is yours and its answer \
         was lost, repeat the request with its Idempotency-Key"
    )]
    LeaseHeld(String),
    /// A run that moves a cell needs the lease's token.
    #[error("moving cell {cell} needs the token of its lease: take it with POST /api/v1/leases and send ?token=")]
    LeaseRequired {
        /// Name of the cell.
        cell: String,
    },
    /// The token is not that of the lease.
    #[error("{0}")]
    TokenRefused(String),
    /// Live runs are switched off.
    #[error("live runs are switched off (execution.live); rehearse with the mode simulate or dry_run")]
    LiveDisabled,
    /// No file of the operator's names controllers of the cell.
    #[error("none of the operator's cell files (execution.cells) has controllers for cell {cell}; run it in the mode simulate")]
    NoControllers {
        /// Name of the cell.
        cell: String,
    },
    /// The operator's cell differs from the job's.
    #[error(
        "cell {cell} of the operator's file differs from the one that the job was planned in; plan the part again in the \
         operator's cell"
    )]
    OtherCell {
        /// Name of the cell.
        cell: String,
    },
    /// The job has no program to run.
    #[error("job {job} {}", without_program(*setup, *programs))]
    NoProgram {
        /// The job.
        job: JobId,
        /// The setup, from 0.
        setup: usize,
        /// Number of its programs, one for each setup; 0 without a cell.
        programs: usize,
    },
    /// The run has not ended.
    #[error("run {run} is {}; stop it and wait until it has ended", state.as_str())]
    RunNotEnded {
        /// The run.
        run: RunId,
        /// State of the run.
        state: ReportedState,
    },
    /// The run was deleted, and its audit log is still there.
    #[error(
        "run {run} was deleted with its record, but its audit log cannot be removed: the folder {run} in execution.audit_dir; let \
         the server's user write there, then send the request again. The server itself tries it every hour, while it keeps the \
         event of the deletion (store.event_retention_hours)"
    )]
    LogLeft {
        /// The run.
        run: RunId,
        /// Cause.
        #[source]
        cause: InternalError,
    },
    /// The run's state does not allow it.
    #[error("run {run} is {}; it cannot be {deed}", state.as_str())]
    RunStateRefused {
        /// The run.
        run: RunId,
        /// State of the run.
        state: ReportedState,
        /// Deed that was asked for, as a participle.
        deed: &'static str,
    },
    /// The run is being stopped.
    #[error(
        "run {run} is being stopped; it cannot be {deed}. Wait until it has ended, then start a new run from the step that it \
         reached. Cause of the stop: {cause}"
    )]
    RunStopping {
        /// The run.
        run: RunId,
        /// Deed that was asked for, as a participle.
        deed: &'static str,
        /// Words for the cause of the stop.
        cause: String,
    },
    /// The session refused a command.
    #[error("{0}")]
    RunRefused(String),
    /// The cell is in use by another run.
    #[error("cell {cell} is in use by run {run} ({}); stop that run first", mode.as_str())]
    CellInUse {
        /// Name of the cell.
        cell: String,
        /// The other run.
        run: RunId,
        /// Mode of the other run.
        mode: RunMode,
    },
    /// Limit of open runs reached.
    #[error("{open} runs have not ended, as many as execution.max_runs allows; stop one")]
    TooManyRuns {
        /// Number of runs that have not ended.
        open: u64,
    },
    /// Fields that are out of range or inconsistent.
    #[error("the request has {} invalid field{}", .0.len(), if .0.len() == 1 { "" } else { "s" })]
    Invalid(Vec<FieldError>),
    /// The file is not a usable mesh.
    #[error("{0}")]
    MeshUnreadable(String),
    /// The upload exceeds the size limit.
    #[error(
        "the file is larger than the allowed {limit_bytes} bytes; send a smaller one, or raise limits.upload_bytes of the server"
    )]
    UploadTooLarge {
        /// Max size.
        limit_bytes: u64,
    },
    /// The upload's digest differs from the announced one.
    #[error("the file's SHA-256 is {found}, not the announced {announced}; upload the file again")]
    DigestMismatch {
        /// Digest of the received bytes.
        found: String,
        /// Digest in the request.
        announced: String,
    },
    /// A job that has not ended needs the mesh.
    #[error("mesh {0} is needed by a job that has not ended")]
    MeshInUse(MeshId),
    /// A stored specification has the mesh for a body.
    #[error("mesh {mesh} is a body of the stored {} {name:?}; change or delete that first", kind)]
    MeshInSpec {
        /// The mesh.
        mesh: MeshId,
        /// Kind of the specification.
        kind: String,
        /// Name of the specification.
        name: String,
    },
    /// A stored cell names the specification.
    #[error("the stored cell {cell:?} names the {} {name:?}; change or delete that first", kind.as_str())]
    SpecInUse {
        /// Kind of the specification.
        kind: SpecCollection,
        /// Name of the specification.
        name: String,
        /// Name of the cell.
        cell: String,
    },
    /// The job has not ended.
    #[error("job {job} is {}; cancel it and wait until it has ended", state.as_str())]
    JobNotEnded {
        /// The job.
        job: JobId,
        /// State of the job.
        state: JobState,
    },
    /// An inspection or a run of the job has not ended.
    #[error("job {0} has an inspection or a run that has not ended; cancel or stop it, or wait until it has ended")]
    JobInUse(JobId),
    /// A deletion of several jobs failed after some of them.
    #[error(
        "{cause}; {deleted} of the selected jobs had been deleted before this failure; send the request again for the others"
    )]
    PartlyDeleted {
        /// Number of jobs that were deleted.
        deleted: u64,
        /// Error at the next job.
        cause: Box<Self>,
    },
    /// The job has ended: there is nothing to cancel.
    #[error("job {job} is {}; there is nothing to cancel", state.as_str())]
    JobEnded {
        /// The job.
        job: JobId,
        /// State of the job.
        state: JobState,
    },
    /// The job does not wait in the queue: its priority means nothing any more.
    #[error("job {job} is {}; only a queued job can be changed", state.as_str())]
    JobNotQueued {
        /// The job.
        job: JobId,
        /// State of the job.
        state: JobState,
    },
    /// Presets cannot be changed.
    #[error("{} {name:?} is a preset and cannot be changed; store yours under another name", kind.as_str())]
    SpecIsPreset {
        /// Kind of the specification.
        kind: SpecCollection,
        /// Name of the specification.
        name: String,
    },
    /// A replacement without a precondition.
    #[error("the {} {name:?} already exists; to replace this version, send If-Match: {etag}", kind.as_str())]
    PreconditionRequired {
        /// Kind of the specification.
        kind: SpecCollection,
        /// Name of the specification.
        name: String,
        /// Current entity tag of the specification.
        etag: String,
    },
    /// The precondition failed: someone else changed the specification.
    #[error("the precondition failed: {}", unmatched(.0.as_deref()))]
    PreconditionFailed(Option<String>),
    /// The idempotency key was used for another request.
    #[error("this Idempotency-Key was used for another request within the last 24 hours; use a new key")]
    IdempotencyMismatch,
    /// The page token is invalid, or belongs to another listing.
    #[error("the page token does not belong to this listing; list again without page_token")]
    BadPageToken,
    /// The queue is full.
    #[error("{queued} of at most {limit} entries are queued, which leaves no room for {asked} more; wait, or cancel queued ones")]
    QueueFull {
        /// Entries of the queue.
        queued: u64,
        /// Entries that were to be added.
        asked: u64,
        /// Largest number of entries.
        limit: u64,
    },
    /// The disk is full.
    #[error("the disk is full; delete jobs or meshes, or free space on the disk")]
    StorageFull,
    /// The disk is nearly full; what is left is reserved for running jobs.
    #[error(
        "the disk has {free_bytes} bytes left; {floor_bytes} bytes are reserved for running jobs (store.min_free_bytes, \
         store.min_free_share); delete jobs or meshes, or free space on the disk"
    )]
    StorageLow {
        /// Free space.
        free_bytes: u64,
        /// Reserved space.
        floor_bytes: u64,
    },
    /// Jobs, runs, calibrations or inspections that an earlier process left unfinished are not recovered, for this reason.
    #[error("{0}")]
    Unrecovered(String),
    /// The database is locked, or the machine is temporarily short of a resource.
    #[error("the store is temporarily unavailable")]
    StorageBusy(#[source] InternalError),
    /// A file of the store is missing, or its bytes do not match its hash.
    #[error("file {sha256} of the store is {}; upload the mesh again, plan the job again, or restore a backup",
        if *missing { "missing" } else { "damaged" })]
    FileDamaged {
        /// Name of the file: the hash of its original bytes.
        sha256: String,
        /// True if the file does not exist.
        missing: bool,
    },
    /// The job's hold label protects it, its scans, its inspections and its runs from deletion.
    #[error(
        "job {job} has the label {label:?}, which protects it, its scans, its inspections and its runs from deletion; remove \
         the label first"
    )]
    JobHeld {
        /// The job.
        job: JobId,
        /// Key of the label.
        label: String,
    },
    /// The meshes and specifications that the request refers to could not be checked in time.
    #[error("the meshes and specifications of the request could not be checked in time, and nothing was changed; send it again")]
    TooSlow,
    /// The server is shutting down.
    #[error("the server is shutting down; send the request again once it has been restarted")]
    Draining,
    /// An internal error.
    #[error("{0}")]
    Internal(#[from] InternalError),
}

/// Version that a precondition did not match, and what to do.
fn unmatched(etag: Option<&str>) -> String {
    match etag {
        Some(etag) => format!("the current entity tag is {etag}; read this version, and send its tag in If-Match"),
        None => "nothing is stored under this name; leave out If-Match to store the first version".to_owned(),
    }
}

/// A run that is not there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingRun {
    /// Id of the run.
    pub run: RunId,
    /// Deletion of the run, while its event is kept (`store.event_retention_hours`); `None` after that, and for a run that never
    /// was.
    pub deletion: Option<RunDeletion>,
}

/// Deletion of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunDeletion {
    /// Time of the deletion, UTC, RFC 3339.
    pub at: String,
    /// True if the retention policy deleted it for its age, false if a client did.
    pub by_retention: bool,
}

impl fmt::Display for MissingRun {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "there is no run {}", self.run)?;
        let Some(deletion) = &self.deletion else { return Ok(()) };
        write!(f, "; it was deleted {deletion}, with its record, and with its audit log unless that could not be removed")
    }
}

impl fmt::Display for RunDeletion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let by = if self.by_retention { "by the retention policy (retention.run_days)" } else { "by a request" };
        write!(f, "at {} {by}", self.at)
    }
}

/// Errors of the program or the machine, for the log and not for the client.
#[derive(Clone, Debug, thiserror::Error)]
pub enum InternalError {
    /// The database failed.
    #[error("the database failed")]
    Database(#[source] Arc<sqlx::Error>),
    /// A file could not be read or written.
    #[error(
        "a file of the store could not be read or written; check that the disk of the data folder is mounted and has no errors, \
         and that the server may write to the folder"
    )]
    File(#[source] Arc<std::io::Error>),
    /// A row cannot be read.
    #[error("a row of the store cannot be read: {0}")]
    Row(String),
    /// A task ended without a result.
    #[error("a task ended without a result: {0}")]
    Task(String),
}

/// Description of a job without a program of a setup.
fn without_program(setup: usize, programs: usize) -> String {
    match programs {
        0 => "was planned without a cell and has no program; plan the part in a cell".to_owned(),
        1 => format!("has one setup, and setup is {setup}; allowed is 0"),
        more => format!("has {more} setups, and setup is {setup}; allowed are 0 to {}", more - 1),
    }
}

impl Error {
    /// Returns true if the same request may succeed later: the disk is full, file descriptors have run out, the database is locked,
    /// or an I/O error may have been temporary.
    #[must_use]
    pub fn is_transient(&self) -> bool {
        matches!(self, Self::StorageFull | Self::StorageLow { .. } | Self::Unrecovered(_) | Self::StorageBusy(_))
    }

    /// Returns true if an exhausted quota may be the cause, of which the database tells no more than that it could not write.
    pub(super) fn may_be_over_quota(&self) -> bool {
        matches!(self, Self::StorageBusy(InternalError::Database(error)) if may_be_over_quota(error))
    }

    /// The error, or a full disk where a file that was written beside the database found no room.
    pub(super) fn or_full(self, probed: Result<(), Self>) -> Self {
        match probed {
            Err(full @ Self::StorageFull) => full,
            Ok(()) | Err(_) => self,
        }
    }
}

/// Primary result codes of SQLite that may be temporary (<https://www.sqlite.org/rescode.html>): BUSY, LOCKED, NOMEM,
/// IOERR, CANTOPEN, PROTOCOL.
const SQLITE_TRANSIENT: [u32; 6] = [5, 6, 7, 10, 14, 15];
const SQLITE_FULL: u32 = 13;
/// Primary result codes of SQLite for a file that it could not write or create: IOERR, CANTOPEN. It tells a full disk apart, but not an
/// exhausted quota (`EDQUOT`).
const SQLITE_UNWRITTEN: [u32; 2] = [10, 14];
/// Extended result code of a disk without room for the index of the write-ahead log, which every connection needs.
const SQLITE_IOERR_SHMSIZE: u32 = 4874;

fn is_transient_database(error: &sqlx::Error) -> bool {
    if let sqlx::Error::Io(error) = error {
        return is_transient_io(error);
    }
    let is_transient_code = || sqlite_code(error).is_some_and(|code| SQLITE_TRANSIENT.contains(&code));
    matches!(error, sqlx::Error::PoolTimedOut) || is_transient_code()
}

/// Primary result code: the low byte of the extended one.
fn sqlite_code(error: &sqlx::Error) -> Option<u32> {
    extended_code(error).map(|code| code & 0xff)
}

fn extended_code(error: &sqlx::Error) -> Option<u32> {
    error.as_database_error()?.code()?.parse().ok()
}

/// Returns true if the disk or its quota has no room for what the database writes.
pub(super) fn is_full_database(error: &sqlx::Error) -> bool {
    if let sqlx::Error::Io(error) = error {
        return is_full_io(error);
    }
    sqlite_code(error) == Some(SQLITE_FULL) || extended_code(error) == Some(SQLITE_IOERR_SHMSIZE)
}

/// Returns true if a quota may have refused what the database writes: whether it did shows in a file that is written beside it.
pub(super) fn may_be_over_quota(error: &sqlx::Error) -> bool {
    sqlite_code(error).is_some_and(|code| SQLITE_UNWRITTEN.contains(&code))
}

/// Returns true if the disk or its quota has no room for a file.
pub(super) fn is_full_io(error: &std::io::Error) -> bool {
    use std::io::ErrorKind;
    matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)
}

/// Returns true if an I/O error may be temporary: too many files are open in the process or on the machine, the disk is full, or a
/// read or write failed.
pub(super) fn is_transient_io(error: &std::io::Error) -> bool {
    is_full_io(error) || is_resource_shortage(error)
}

#[cfg(unix)]
fn is_resource_shortage(error: &std::io::Error) -> bool {
    use rustix::io::Errno;
    let shortages = [Errno::MFILE, Errno::NFILE, Errno::NOMEM, Errno::IO, Errno::AGAIN].map(Errno::raw_os_error);
    error.raw_os_error().is_some_and(|code| shortages.contains(&code))
}

/// Returns true if the disk did not give back what it holds.
#[cfg(unix)]
pub(super) fn is_read_failure(error: &std::io::Error) -> bool {
    error.raw_os_error() == Some(rustix::io::Errno::IO.raw_os_error())
}

#[cfg(not(unix))]
pub(super) fn is_read_failure(_: &std::io::Error) -> bool {
    false
}

#[cfg(not(unix))]
fn is_resource_shortage(_: &std::io::Error) -> bool {
    false
}

impl From<sqlx::Error> for Error {
    fn from(error: sqlx::Error) -> Self {
        if is_full_database(&error) {
            return Self::StorageFull;
        }
        if matches!(error, sqlx::Error::ColumnDecode { .. } | sqlx::Error::Decode(_)) {
            return InternalError::Row(error.to_string()).into();
        }
        if is_transient_database(&error) {
            return Self::StorageBusy(InternalError::Database(Arc::new(error)));
        }
        InternalError::Database(Arc::new(error)).into()
    }
}

impl From<std::io::Error> for Error {
    fn from(error: std::io::Error) -> Self {
        if is_full_io(&error) {
            return Self::StorageFull;
        }
        let is_transient = is_transient_io(&error);
        let error = InternalError::File(Arc::new(error));
        if is_transient { Self::StorageBusy(error) } else { error.into() }
    }
}

impl From<serde_json::Error> for Error {
    fn from(error: serde_json::Error) -> Self {
        InternalError::Row(error.to_string()).into()
    }
}

impl From<ParseError> for Error {
    fn from(error: ParseError) -> Self {
        InternalError::Row(error.to_string()).into()
    }
}

impl From<tokio::task::JoinError> for Error {
    fn from(error: tokio::task::JoinError) -> Self {
        InternalError::Task(error.to_string()).into()
    }
}

#[cfg(test)]
mod tests;
