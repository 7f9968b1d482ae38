//! Requests about several jobs at once, and the change of one that waits.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::ids::{JobId, MeshId};
use super::job::{Job, JobRequest, JobState, MAX_PRIORITY, label_filter_fault};
use super::utc_time::UtcTime;
use crate::cell::{FieldError, Findings, field_ranges};

/// Several planning jobs, of which all are accepted or none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct JobBatchRequest {
    /// Jobs, at most 100. Of the same priority, an earlier one starts first.
    #[schema(min_items = 1, max_items = 100)]
    pub jobs: Vec<JobRequest>,
}

impl JobBatchRequest {
    /// Largest number of jobs.
    pub const MAX_JOBS: usize = 100;

    /// Checks the number of jobs; the service checks each of them.
    ///
    /// # Errors
    /// The finding.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        findings.require((1..=Self::MAX_JOBS).contains(&self.jobs.len()), "/jobs", || {
            format!("has {} entries; allowed are 1 to {}", self.jobs.len(), Self::MAX_JOBS)
        });
        findings.into_result()
    }
}

/// Jobs of a batch, in the order of the request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobBatch {
    /// Accepted jobs.
    pub jobs: Vec<Job>,
}

/// A change to a queued job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct JobUpdate {
    /// New priority, -100 to 100; jobs with a higher one start first.
    pub priority: i32,
}

field_ranges! {
    JobUpdate {
        PRIORITY = "priority", [-MAX_PRIORITY, MAX_PRIORITY] "";
    }
}

impl JobUpdate {
    /// Checks the range of the priority.
    ///
    /// # Errors
    /// The finding.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        Self::PRIORITY.check("", &self.priority, &mut findings);
        findings.into_result()
    }
}

/// Jobs that match all of the given fields. At least one field must be given.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default, expecting = "an object")]
#[schema(min_properties = 1)]
pub struct JobSelection {
    /// Ids of the jobs, at most 1000.
    #[schema(max_items = 1000)]
    pub ids: Option<Vec<JobId>>,
    /// State of the jobs.
    pub state: Option<JobState>,
    /// Label of the jobs: `key` or `key=value`.
    #[schema(pattern = "^[^=]")]
    pub label: Option<String>,
    /// Part number of the jobs.
    pub part_number: Option<String>,
    /// Serial number of the jobs.
    pub serial: Option<String>,
    /// Id of the planned mesh.
    pub mesh_id: Option<MeshId>,
    /// Name of the cell, or `none`.
    pub cell: Option<String>,
    /// Jobs accepted at this time or later (RFC 3339).
    pub created_after: Option<UtcTime>,
    /// Jobs accepted before this time (RFC 3339).
    pub created_before: Option<UtcTime>,
}

impl JobSelection {
    /// Largest number of ids.
    pub const MAX_IDS: usize = 1000;

    /// Checks that something is selected by, and that a label has a key.
    ///
    /// # Errors
    /// All invalid fields.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        findings.require(*self != Self::default(), "", || {
            "no filter given; give at least one of ids, state, label, part_number, serial, mesh_id, cell, created_after and \
             created_before"
                .to_owned()
        });
        let count = self.ids.as_ref().map_or(0, Vec::len);
        findings
            .require(count <= Self::MAX_IDS, "/ids", || format!("has {count} entries; at most {} are allowed", Self::MAX_IDS));
        if let Some(detail) = self.label.as_deref().and_then(label_filter_fault) {
            findings.push("/label", detail);
        }
        findings.into_result()
    }
}

/// Numbers of selected jobs by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DeletedJobs {
    /// Jobs that were deleted or, with `dry_run`, would be.
    pub deleted: u64,
    /// Jobs that were kept because they have the hold label.
    pub held: u64,
    /// Jobs that were kept because they have not ended.
    pub not_ended: u64,
    /// True if nothing was deleted, only counted.
    pub dry_run: bool,
}
