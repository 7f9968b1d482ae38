//! Options of the service, given when it is opened.

use std::path::PathBuf;
use std::time::Duration;

use crate::cell::ControllersSpec;

/// Folders, limits and intervals of the service.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Folder of the store; created if needed.
    pub data_dir: PathBuf,
    /// Number of planning threads; 0 for one per core.
    pub planning_threads: usize,
    /// Jobs planned at the same time, on those threads: small ones side by side, a large one on all of them; 0 for as many as there
    /// are threads.
    pub concurrent_jobs: usize,
    /// Max attempts at a job: when the process has died in that many, the job fails.
    pub max_attempts: u32,
    /// Max jobs in the queue.
    pub max_queued_jobs: u64,
    /// Max concurrent uploads; each holds a thread that writes.
    pub max_uploads: usize,
    /// Max size of an upload.
    pub max_upload_bytes: u64,
    /// Max number of triangles of a mesh.
    pub max_triangles: usize,
    /// Max time for parsing and checking an uploaded mesh.
    pub parse_limit: Duration,
    /// Max estimated memory of the meshes that are read at the same time after uploads and for previews; one beyond it is read alone.
    pub parse_memory_bytes: u64,
    /// Max estimated memory of a job, and of all that run at the same time.
    pub job_memory_bytes: u64,
    /// Max planning time of a job.
    pub job_limit: Option<Duration>,
    /// Retention time of the events of ended jobs, hours.
    pub event_retention_hours: u32,
    /// Free space that uploads and new jobs leave on the disk; the smaller of this and `min_free_share` counts.
    pub min_free_bytes: u64,
    /// Free share of the disk that uploads and new jobs leave; the smaller of this and `min_free_bytes` counts.
    pub min_free_share: f64,
    /// Age at which orphaned files are swept, hours.
    pub orphan_hours: u32,
    /// Time after which swept files are removed, hours.
    pub swept_hours: u32,
    /// Interval at which every file is compared with its hash, hours; 0 for never.
    pub scrub_hours: u32,
    /// Retention policy.
    pub retention: RetentionOptions,
    /// Execution of programs on controllers.
    pub execution: ExecutionOptions,
}

/// Execution of programs on the controllers of the operator's cells.
#[derive(Clone, Debug, PartialEq)]
pub struct ExecutionOptions {
    /// True if controllers may be moved at all.
    pub live: bool,
    /// Cells with their controllers, from the operator's files.
    pub cells: Vec<OperatorCell>,
    /// Time after which a lease ends unless it is renewed.
    pub lease_ttl: Duration,
    /// Interval at which a holder is told to renew it.
    pub heartbeat: Duration,
    /// Folder of the audit logs, one folder a run.
    pub audit_dir: PathBuf,
    /// Size at which a file of an audit log is closed and the next begun, bytes.
    pub audit_file_bytes: u64,
    /// Files kept of one audit log; the oldest goes first.
    pub audit_files: usize,
    /// Max runs that have not ended.
    pub max_runs: usize,
}

/// A cell of the operator's, with its controllers.
#[derive(Clone, Debug, PartialEq)]
pub struct OperatorCell {
    /// Name of the cell.
    pub name: String,
    /// Digest of the cell, as [`super::runs::cell_sha256`] has it.
    pub cell_sha256: String,
    /// Controllers of the cell, checked.
    pub controllers: ControllersSpec,
}

/// Policy by which the store deletes what is no longer needed.
#[derive(Clone, Debug, PartialEq)]
pub struct RetentionOptions {
    /// Age at which ended jobs are deleted, days; 0 keeps them.
    pub job_days: u32,
    /// Ended jobs kept for each part (its part number, else its mesh); 0 keeps all.
    pub jobs_per_part: u32,
    /// Age at which meshes that no job and no specification refers to are deleted, days since their upload; 0 keeps them.
    pub unused_mesh_days: u32,
    /// Time after its end at which a run is deleted with its record and its audit log, days; 0 keeps them.
    pub run_days: u32,
    /// Max share of the disk for stored files and the audit logs on it, beyond which the oldest ended jobs are deleted; 0 for no limit.
    /// Half of it is for the stored files, whatever the logs take: no log is deleted for it, and no job for what logs take beyond half.
    pub max_disk_share: f64,
    /// Key of the label that protects a job from deletion.
    pub hold_label: String,
}
