//! Events of planning jobs.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::ids::JobId;
use super::job::JobState;

/// Kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// The job was accepted, or returned to the queue after an interruption.
    Queued,
    /// An attempt began.
    Started,
    /// A stage began or advanced.
    Progress,
    /// Cancellation was requested.
    Cancelling,
    /// The job succeeded; its results are available.
    Succeeded,
    /// The job ended with a problem and without a result.
    Failed,
    /// The job was cancelled.
    Cancelled,
    /// The job was deleted, with its results.
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

/// An event of a job. Ids increase by one over the events of all jobs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobEvent {
    /// Number of the event.
    pub id: i64,
    /// Id of the job.
    pub job_id: JobId,
    /// Kind of the event.
    pub kind: EventKind,
    /// Time of the event, UTC.
    #[schema(format = DateTime)]
    pub at: String,
    /// State of the job after the event.
    pub state: JobState,
    /// Stage of planning, while the job runs.
    #[schema(value_type = Option<crate::planning::context::Stage>)]
    pub stage: Option<String>,
    /// Completed share of the work, 0 to 1.
    pub fraction: f64,
    /// Code of the problem if the job failed, or reason of the deletion if retention deleted it; absent otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
}
