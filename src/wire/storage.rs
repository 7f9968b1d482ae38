//! What the store holds, what is wrong with it, and what the policy of retention lets go.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::ids::{JobId, MeshId};

/// Room, sizes and damage of the store.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Storage {
    /// Free space on the store's disk.
    pub free_bytes: u64,
    /// Size of that disk.
    pub total_bytes: u64,
    /// Below this much free space uploads and jobs are refused with 507.
    pub floor_bytes: u64,
    /// Size of the database.
    pub database_bytes: u64,
    /// Size of all stored files.
    pub files_bytes: u64,
    /// What is known to be damaged; empty when all is well.
    pub damaged: Vec<DamagedItem>,
}

/// Something of the store that is damaged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DamagedItem {
    /// `mesh ID`, `job ID` or `file SHA-256`.
    pub name: String,
    /// What is wrong with it.
    pub reason: String,
}

/// Why a job is let go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RetentionReason {
    /// It ended longer ago than `retention.job_days`.
    Age,
    /// Its part has more than `retention.jobs_per_part` newer ones.
    Count,
    /// The store takes more than `retention.max_disk_share` of its disk.
    Disk,
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

/// The policy of retention, from the server's settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RetentionPolicy {
    /// Ended jobs older than this are let go; 0 keeps them.
    pub job_days: u32,
    /// Of each part (its part number, else its mesh) this many ended jobs are kept; 0 keeps all.
    pub jobs_per_part: u32,
    /// Meshes that no job and no specification refers to are let go this long after their upload; 0 keeps them.
    pub unused_mesh_days: u32,
    /// Share of the disk that stored files may take, the oldest ended jobs going first; 0 for no limit.
    pub max_disk_share: f64,
    /// Key of the label that keeps a job from being deleted.
    pub hold_label: String,
}

/// What the policy lets go: now, where it was only asked, or in the run that this answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Retention {
    /// The policy.
    pub policy: RetentionPolicy,
    /// How many jobs.
    pub job_count: u64,
    /// How many meshes.
    pub mesh_count: u64,
    /// Size of their files; files that others share are counted though they stay.
    pub size_bytes: u64,
    /// The jobs, the oldest first; at most 1000 are listed.
    pub jobs: Vec<RetiredJob>,
    /// The meshes, the oldest first; at most 1000 are listed.
    pub meshes: Vec<RetiredMesh>,
}

/// A job that is let go.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct RetiredJob {
    /// Its id.
    pub id: JobId,
    /// Why.
    pub reason: RetentionReason,
    /// Size of its files.
    pub size_bytes: u64,
}

/// A mesh that is let go.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct RetiredMesh {
    /// Its id.
    pub id: MeshId,
    /// Size of its file.
    pub size_bytes: u64,
}
