//! Events of jobs.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::ids::JobId;
use super::job::JobState;

/// Kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// The job was accepted, or put back into the queue after an interruption.
    Queued,
    /// An attempt began.
    Started,
    /// A stage began, or moved on.
    Progress,
    /// Somebody asked to cancel it.
    Cancelling,
    /// Its results are there.
    Succeeded,
    /// It ended without a result.
    Failed,
    /// It was cancelled.
    Cancelled,
    /// It was deleted, with its results.
    Deleted,
}

impl EventKind {
    /// Name in files and events.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Started => "started",
            Self::Progress => "progress",
            Self::Cancelling => "cancelling",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
            Self::Deleted => "deleted",
        }
    }
}

/// One event. Ids rise by one over all jobs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobEvent {
    /// Its number.
    pub id: i64,
    /// The job it is about.
    pub job_id: JobId,
    /// Kind of the event.
    pub kind: EventKind,
    /// When, UTC.
    #[schema(format = DateTime)]
    pub at: String,
    /// State of the job after it.
    pub state: JobState,
    /// Stage of planning, while the job runs.
    pub stage: Option<String>,
    /// Share of the work that is done, 0 to 1.
    pub fraction: f64,
    /// Code of the problem, when the job failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
}
