//! What the service has to be told when it is opened.

use std::path::PathBuf;
use std::time::Duration;

/// Folders, sizes and numbers of the service.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Folder of the store; made if need be.
    pub data_dir: PathBuf,
    /// Threads that plan; 0 for one a core.
    pub planning_threads: usize,
    /// Jobs planned at the same time, on those threads.
    pub concurrent_jobs: usize,
    /// How often a job is started before the death of the process in it counts as its fault.
    pub max_attempts: u32,
    /// Jobs that may wait.
    pub max_queued_jobs: u64,
    /// Uploads at the same time; each holds a thread that writes.
    pub max_uploads: usize,
    /// Largest upload.
    pub max_upload_bytes: u64,
    /// Most triangles of a mesh.
    pub max_triangles: usize,
    /// Time to make out what an uploaded mesh is.
    pub parse_limit: Duration,
    /// Memory that a job may need.
    pub job_memory_bytes: u64,
    /// Time that a job may be planned.
    pub job_limit: Option<Duration>,
    /// Events of ended jobs are kept this long.
    pub event_retention_hours: u32,
    /// Free space that uploads and new jobs leave on the disk, unless `min_free_share` is less.
    pub min_free_bytes: u64,
    /// Share of the disk that they leave free, unless `min_free_bytes` is less.
    pub min_free_share: f64,
    /// Files that nothing refers to are swept once they are this old.
    pub orphan_hours: u32,
    /// Swept files are removed after this time.
    pub swept_hours: u32,
    /// Every file is compared with its name this often; 0 for never.
    pub scrub_hours: u32,
    /// What is let go, and when.
    pub retention: RetentionOptions,
}

/// The policy by which the store lets go what is no longer needed.
#[derive(Clone, Debug, PartialEq)]
pub struct RetentionOptions {
    /// Ended jobs older than this are deleted; 0 keeps them.
    pub job_days: u32,
    /// Of each part (its part number, else its mesh) this many ended jobs are kept; 0 keeps all.
    pub jobs_per_part: u32,
    /// Meshes that no job and no specification refers to are deleted this long after their upload; 0 keeps them.
    pub unused_mesh_days: u32,
    /// Share of the disk that stored files may take; the oldest ended jobs are deleted first. 0 for no limit.
    pub max_disk_share: f64,
    /// Key of the label that keeps a job from being deleted.
    pub hold_label: String,
}
