//! Events of runs that are stored.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{ReportedReason, ReportedState, RunStop};
use crate::cell::closed_list;
use crate::wire::ids::RunId;

closed_list! {
    /// Kind of an event of a run.
    pub enum RunEventKind {
        /// The state changed, its reason, or what is known of the stop that ends the run.
        State = "state",
        /// A step is done, and the next one is told; or the first began.
        Step = "step",
        /// The speed was changed.
        Override = "override",
        /// The run was deleted, with its record.
        Deleted = "deleted",
    }
}

/// An event of a run. Ids increase over the events of all runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RunEventDocument {
    /// Number of the event.
    pub id: i64,
    /// Id of the run.
    pub run_id: RunId,
    /// Kind of the event.
    pub kind: RunEventKind,
    /// Time of the event, UTC.
    #[schema(format = DateTime)]
    pub at: String,
    /// State of the run after the event.
    pub state: ReportedState,
    /// Reason for the state.
    pub reason: ReportedReason,
    /// Reason in words; absent where there is nothing to add.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
    /// Step that the run is at, or that comes next, from 0.
    pub step: usize,
    /// Share of the program's speed.
    pub speed_override: f64,
    /// Stop that ends the run, as far as it has got; absent before it is sent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop: Option<RunStop>,
}

impl RunEventDocument {
    /// Returns true if no event of the run follows, but its deletion.
    #[must_use]
    pub fn is_last(&self) -> bool {
        match self.kind {
            RunEventKind::State => self.state.is_ended(),
            RunEventKind::Deleted => true,
            RunEventKind::Step | RunEventKind::Override => false,
        }
    }
}
