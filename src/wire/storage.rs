//! Contents of the store, its damage, and deletions by the retention policy.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::ids::{JobId, MeshId, RunId};
use crate::cell::closed_list;

/// Free space, sizes and damage of the store.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Storage {
    /// Free space on the store's disk.
    pub free_bytes: u64,
    /// Size of that disk.
    pub total_bytes: u64,
    /// Min free space, below which uploads and jobs are refused with status 507.
    pub floor_bytes: u64,
    /// Size of the database.
    pub database_bytes: u64,
    /// Total size of all stored files.
    pub files_bytes: u64,
    /// Total size of the files that nothing refers to any more; they are kept for `store.swept_hours`.
    pub swept_bytes: u64,
    /// Total size of the audit logs of runs; they may lie on another disk (`execution.audit_dir`).
    pub audit_bytes: u64,
    /// Items known to be damaged; empty if there are none.
    pub damaged: Vec<DamagedItem>,
}

/// A damaged item of the store.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DamagedItem {
    /// Name of the item: `mesh ID`, `job ID`, `file SHA-256` or `audit logs`.
    pub name: String,
    /// Description of the damage.
    pub reason: String,
}

closed_list! {
    /// Reason for which retention deletes a job.
    pub enum RetentionReason {
        /// The job ended longer ago than `retention.job_days`.
        Age = "age",
        /// The job is not among the newest `retention.jobs_per_part` ended jobs of its part.
        Count = "count",
        /// Stored files and audit logs take more than `retention.max_disk_share` of the disk.
        Disk = "disk",
    }
}

impl RetentionReason {
    /// Code in the event of the deletion.
    #[must_use]
    pub fn code(self) -> &'static str {
        match self {
            Self::Age => "retention_age",
            Self::Count => "retention_count",
            Self::Disk => "retention_disk",
        }
    }
}

/// Retention policy, from the server's settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RetentionPolicy {
    /// Days after which ended jobs are deleted, with their results, scans and inspections; 0 keeps them.
    pub job_days: u32,
    /// Max number of ended jobs kept for each part (by its part number, else by its mesh); the others are deleted with their
    /// results, scans and inspections. 0 keeps all. A blank part number is the same as none.
    pub jobs_per_part: u32,
    /// Days after upload at which meshes that no job and no specification refers to are deleted; 0 keeps them.
    pub unused_mesh_days: u32,
    /// Days after its end at which a run is deleted with its record and its audit log; 0 keeps them.
    pub run_days: u32,
    /// Max share of the disk for stored files and the audit logs on it, beyond which the oldest ended jobs that have files are
    /// deleted; 0 for no limit. Meshes and their previews count, and are not deleted for it; the database, uploads under way and
    /// swept files do not count. Half of it is reserved for the stored files: no audit log is deleted to meet it, and no job
    /// because of what logs take beyond half.
    pub max_disk_share: f64,
    /// Key of the label that protects a job from deletion.
    pub hold_label: String,
}

/// Jobs, meshes and runs that retention has just deleted, or, if only asked for, would delete now.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Retention {
    /// Retention policy in force.
    pub policy: RetentionPolicy,
    /// Number of jobs.
    pub job_count: u64,
    /// Number of meshes.
    pub mesh_count: u64,
    /// Number of runs.
    pub run_count: u64,
    /// Size of their files and audit logs; files shared with items that stay are counted too.
    pub size_bytes: u64,
    /// Jobs, the oldest first; at most 1000 are listed.
    pub jobs: Vec<RetiredJob>,
    /// Meshes, the oldest first; at most 1000 are listed.
    pub meshes: Vec<RetiredMesh>,
    /// Runs, the oldest first; at most 1000 are listed.
    pub runs: Vec<RetiredRun>,
}

/// A job that retention deletes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct RetiredJob {
    /// Id of the job.
    pub id: JobId,
    /// Reason for the deletion.
    pub reason: RetentionReason,
    /// Size of the job's files.
    pub size_bytes: u64,
}

/// A mesh that retention deletes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct RetiredMesh {
    /// Id of the mesh.
    pub id: MeshId,
    /// Size of the mesh's file.
    pub size_bytes: u64,
}

/// A run that retention deletes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct RetiredRun {
    /// Id of the run.
    pub id: RunId,
    /// Size of the run's audit log; once deleted, 0 where the log could not be removed.
    pub size_bytes: u64,
}
