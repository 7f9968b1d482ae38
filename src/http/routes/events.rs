//! Live events of jobs.

use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::Response;

use super::job_id;
use crate::http::client::Client;
use crate::http::events::event_stream;
use crate::http::extract::Params;
use crate::http::problem::ApiError;
use crate::http::router::ApiState;

/// Follow all jobs
///
/// Server-sent events, from now on or resumed after `Last-Event-ID`. `event` is an `EventKind`, `data` a `JobEvent` as JSON.
/// The event `reset` means that events after the given id are no longer stored: reload the list.
#[utoipa::path(
    get,
    path = "/events",
    tag = "events",
    operation_id = "follow_all",
    params(("Last-Event-ID" = Option<i64>, Header, minimum = 0, description = "Id of the last event that the client saw.")),
    responses((status = 200, description = "The event stream; it does not end.", content_type = "text/event-stream",
        body = inline(super::super::openapi::EventText)))
)]
pub(in crate::http) async fn all(
    State(state): State<ApiState>,
    client: Client,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    event_stream(&state, client, None, &headers).await
}

/// Follow a job to its end
///
/// Server-sent events, from the job's beginning or resumed after `Last-Event-ID`; the stream ends with the job. The event `reset`
/// means that events after the given id are no longer stored: reload the job. It is the only event if all events of an ended job
/// were deleted for their age.
#[utoipa::path(
    get,
    path = "/jobs/{id}/events",
    tag = "events",
    operation_id = "follow_job",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the job."),
        ("Last-Event-ID" = Option<i64>, Header, minimum = 0, description = "Id of the last event that the client saw."),
    ),
    responses(
        (status = 200, description = "The event stream.", content_type = "text/event-stream",
        body = inline(super::super::openapi::EventText)),
        (status = 204, description = "The job has ended and the client has seen all its events."),
    )
)]
pub(in crate::http) async fn of_job(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    client: Client,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    event_stream(&state, client, Some(job_id(&id)?), &headers).await
}
