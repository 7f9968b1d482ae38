//! Inspections over HTTP: the request, and the inspection as a resource.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::verdicts::VerdictCounts;
use crate::inspection::InspectionParams;
use crate::inspection::registration::PartNotFound;
use crate::wire::{InspectionId, JobFile, JobId, JobProblem, JobState, RunId, ScanId};

/// Request for an inspection. Unknown fields are refused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct InspectionRequest {
    /// Scans that are compared with the plan. Default: all of the job; of two scans of one viewpoint the first by its name counts, and a
    /// finding (`view_double`) names both.
    #[schema(max_items = 10000)]
    pub scans: Option<Vec<ScanId>>,
    /// Run in which the scans were taken; its measured poses are then used. Default: the poses of the plan.
    pub run_id: Option<RunId>,
    /// Parameters of the comparison.
    pub params: InspectionParams,
}

impl InspectionRequest {
    /// Largest number of scans.
    pub const MAX_SCANS: usize = 10_000;
}

/// Figures of an inspection for a list.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct InspectionSummary {
    /// Share of the asked area that the plan measures.
    pub planned_of_asked: f64,
    /// Share of the asked area that the scans measure.
    pub measured_of_asked: f64,
    /// Share of the asked area that the scans of all rounds so far measure.
    pub measured_in_all_of_asked: f64,
    /// Share of the asked area that was planned but not measured, for no known cause.
    pub unexplained_of_asked: f64,
    /// Root mean square of the deviation, mm; `null` where nothing was measured, or the part was not found.
    pub deviation_rms_mm: Option<f64>,
    /// Reason for which the alignment counts as not found; `null` where it was found, and in inspections of earlier releases.
    #[serde(default)]
    pub not_found: Option<PartNotFound>,
    /// Numbers of features that fail, pass and are undecided; `null` without a feature that has a tolerance, where the part was not found,
    /// and in inspections of earlier releases.
    #[serde(default)]
    pub verdicts: Option<VerdictCounts>,
}

/// An inspection as the server keeps it. It never changes once it has ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct InspectionJob {
    /// Id.
    pub id: InspectionId,
    /// Job whose plan was scanned.
    pub job_id: JobId,
    /// State.
    pub state: JobState,
    /// Scans that are compared with the plan.
    pub scans: Vec<ScanId>,
    /// Run in which the scans were taken.
    pub run_id: Option<RunId>,
    /// Parameters of the comparison.
    pub params: InspectionParams,
    /// Share of the work that is done, 0 to 1.
    pub fraction: f64,
    /// Name of the key that its sender presented; `null` without keys.
    pub submitted_by: Option<String>,
    /// Time at which it was accepted, UTC.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Time at which it ended, UTC.
    #[schema(format = DateTime)]
    pub ended_at: Option<String>,
    /// Figures; `null` without a result.
    pub summary: Option<InspectionSummary>,
    /// Result files.
    pub files: Vec<JobFile>,
    /// Reason for a failure.
    pub problem: Option<JobProblem>,
}

/// A page of inspections, newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct InspectionPage {
    /// Inspections on this page.
    pub items: Vec<InspectionJob>,
    /// Token of the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_page_token: Option<String>,
}

/// Inspections that all of the given fields fit.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct InspectionSelection {
    /// State.
    pub state: Option<JobState>,
    /// Job.
    pub job_id: Option<JobId>,
}
