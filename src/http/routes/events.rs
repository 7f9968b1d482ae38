//! What happens to jobs, as it happens.

use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::Response;

use super::job_id;
use crate::http::client::Client;
use crate::http::events::answer;
use crate::http::extract::Params;
use crate::http::problem::Problem;
use crate::http::router::Site;

/// Follow all jobs
///
/// Server-sent events, from now on or from after `Last-Event-ID`. `event` is what happened: `queued`, `started`,
/// `progress`, `cancelling`, `succeeded`, `failed`, `cancelled`, `deleted`; `data` is a `JobEvent`. `reset` says that
/// events after the given one are no longer kept: read the list anew.
#[utoipa::path(
    get,
    path = "/events",
    tag = "events",
    operation_id = "follow_all",
    params(("Last-Event-ID" = Option<i64>, Header, minimum = 0, description = "Id of the last event seen.")),
    responses((status = 200, description = "The stream; it does not end.", content_type = "text/event-stream",
        body = inline(super::super::openapi::ServerSentEvent)))
)]
pub(in crate::http) async fn all(
    State(site): State<Site>,
    client: Client,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, Problem> {
    params.end()?;
    answer(&site, client, None, &headers).await
}

/// Follow a job to its end
///
/// Server-sent events, from the job's beginning or from after `Last-Event-ID`; the stream ends with the job.
#[utoipa::path(
    get,
    path = "/jobs/{id}/events",
    tag = "events",
    operation_id = "follow_job",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the job."),
        ("Last-Event-ID" = Option<i64>, Header, minimum = 0, description = "Id of the last event seen."),
    ),
    responses(
        (status = 200, description = "The stream.", content_type = "text/event-stream",
        body = inline(super::super::openapi::ServerSentEvent)),
        (status = 204, description = "The job has ended and all its events were seen."),
    )
)]
pub(in crate::http) async fn of_job(
    State(site): State<Site>,
    Path(id): Path<String>,
    client: Client,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, Problem> {
    params.end()?;
    answer(&site, client, Some(job_id(&id)?), &headers).await
}
