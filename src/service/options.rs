//! What the service has to be told when it is opened.

use std::path::PathBuf;

/// Folders, sizes and numbers of the service.
#[derive(Clone, Debug, PartialEq, Eq)]
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
    /// Largest upload.
    pub max_upload_bytes: u64,
    /// Most triangles of a mesh.
    pub max_triangles: usize,
    /// Events of ended jobs are kept this long.
    pub event_retention_hours: u32,
}
