//! Events of planning jobs.

use serde::{Deserialize, Serialize};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

use super::ids::JobId;
use super::job::JobState;
use super::problem::FailureCode;
use super::storage::RetentionReason;
use super::summary::Summary;
use crate::cell::closed_list;

closed_list! {
    /// Kind of an event.
    pub enum EventKind {
        /// The job was accepted, returned to the queue after an interruption, or got another priority there.
        Queued = "queued",
        /// An attempt began.
        Started = "started",
        /// A stage began or advanced.
        Progress = "progress",
        /// Cancellation was requested.
        Cancelling = "cancelling",
        /// The job succeeded; its results are available.
        Succeeded = "succeeded",
        /// The job ended with a problem and without a result.
        Failed = "failed",
        /// The job was cancelled.
        Cancelled = "cancelled",
        /// The job was deleted, with its results.
        Deleted = "deleted",
    }
}

impl EventKind {
    /// Returns true if no event of the job follows.
    #[must_use]
    pub fn is_last(self) -> bool {
        match self {
            Self::Queued | Self::Started | Self::Progress | Self::Cancelling => false,
            Self::Succeeded | Self::Failed | Self::Cancelled | Self::Deleted => true,
        }
    }
}

/// Code of an event, for the API document.
struct EventCode;

impl PartialSchema for EventCode {
    fn schema() -> RefOr<Schema> {
        let of_failures = FailureCode::ALL.map(FailureCode::as_str);
        let of_deletions = RetentionReason::ALL.map(RetentionReason::code);
        ObjectBuilder::new()
            .schema_type(Type::String)
            .description(Some("Code of the problem of a job that failed, or reason for which retention deleted it."))
            .enum_values(Some(of_failures.into_iter().chain(of_deletions)))
            .into()
    }
}

impl ToSchema for EventCode {}

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
    #[schema(value_type = Option<EventCode>)]
    pub code: Option<String>,
    /// Summary of the plan if the job succeeded; absent otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub summary: Option<Summary>,
}
