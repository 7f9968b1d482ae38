//! Jobs: create, read, wait, label, cancel, delete.

use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::header::{LOCATION, RETRY_AFTER};
use axum::http::{HeaderName, StatusCode};

use super::job_id;
use crate::http::extract::{IdempotencyKeyHeader, Json, Params};
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::service::JobQuery;
use crate::wire::{Job, JobPage, JobRequest, JobState, LabelsRequest};

/// Polling interval that responses suggest, seconds.
const POLL_AFTER_SECS: &str = "2";
/// Longest wait for a job's end.
const MAX_WAIT: Duration = Duration::from_secs(60);

type Accepted = (StatusCode, [(HeaderName, String); 2], axum::Json<Job>);

/// Start a job
///
/// Everything that the request names is looked up and checked first, and stored with the job. A 202 means that the job is
/// stored durably.
#[utoipa::path(
    post,
    path = "/jobs",
    tag = "jobs",
    operation_id = "create_job",
    params(("Idempotency-Key" = Option<String>, Header, pattern = "^[ \\t]*[\\x21-\\x7e]{1,255}[ \\t]*$",
        description = "Within 24 hours, the same key with the same request gives the same response and starts no second job. \
                       Surrounding white space is ignored (RFC 9110, section 5.5).")),
    request_body = JobRequest,
    responses(
        (status = 202, description = "The job was accepted.", body = Job,
            headers(("Location" = String, description = "Path of the job."),
                    ("Retry-After" = String, description = "Seconds to wait before polling the job."))),
    )
)]
pub(in crate::http) async fn create(
    State(state): State<ApiState>,
    key: Option<IdempotencyKeyHeader>,
    params: Params,
    Json(request): Json<JobRequest>,
) -> Result<Accepted, ApiError> {
    params.deny_unknown()?;
    let limit = Some(state.options.request_timeout);
    let job = state.app.submit(request, key.as_ref().map(|IdempotencyKeyHeader(key)| key.as_str()), limit).await?;
    Ok(accepted(job))
}

fn accepted(job: Job) -> Accepted {
    let location = format!("/api/v1/jobs/{}", job.id);
    (StatusCode::ACCEPTED, [(LOCATION, location), (RETRY_AFTER, POLL_AFTER_SECS.to_owned())], axum::Json(job))
}

/// List jobs, newest first
///
/// Status of each job, without its request, which `/jobs/{id}` includes. A page ends early, with a token, if its entries
/// would exceed 4 MiB.
#[utoipa::path(
    get,
    path = "/jobs",
    tag = "jobs",
    operation_id = "list_jobs",
    params(
        ("state" = Option<JobState>, Query, description = "Only jobs in this state."),
        ("label" = Option<String>, Query, description = "Only jobs with this label: `key` or `key=value`."),
        ("part_number" = Option<String>, Query, description = "Only jobs with this part number."),
        ("page_size" = Option<u32>, Query, description = "Largest number of entries on the page; 50 by default.", minimum = 1, maximum = 1000),
        ("page_token" = inline(Option<super::super::openapi::PageToken>), Query, description = "`next_page_token` of the previous page; the filters must be the same."),
    ),
    responses((status = 200, description = "A page of jobs.", body = JobPage))
)]
pub(in crate::http) async fn list(State(state): State<ApiState>, mut params: Params) -> Result<axum::Json<JobPage>, ApiError> {
    let query = JobQuery { state: params.value("state")?, label: params.text("label"), part_number: params.text("part_number") };
    let (page_size, page_token) = params.page()?;
    params.deny_unknown()?;
    Ok(axum::Json(state.app.jobs(&query, page_size, page_token.as_deref()).await?))
}

/// Get a job, or wait for its end
#[utoipa::path(
    get,
    path = "/jobs/{id}",
    tag = "jobs",
    operation_id = "get_job",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the job."),
        ("wait" = Option<String>, Query, pattern = "^([0-9]|[1-5][0-9]|60)s?$",
            description = "Respond when the job has ended, or after this time: up to 60 seconds, for example `30s`."),
    ),
    responses((status = 200, description = "The job.", body = Job))
)]
pub(in crate::http) async fn get(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    mut params: Params,
) -> Result<axum::Json<Job>, ApiError> {
    let wait = params.text("wait").as_deref().map(duration).transpose()?;
    params.deny_unknown()?;
    let id = job_id(&id)?;
    let job = match wait {
        Some(wait) => state.app.job_when_ended(id, wait).await?,
        None => state.app.job(id).await?,
    };
    Ok(axum::Json(job))
}

fn duration(text: &str) -> Result<Duration, ApiError> {
    let seconds = text.strip_suffix('s').unwrap_or(text);
    let plain = !seconds.is_empty() && seconds.bytes().all(|c| c.is_ascii_digit());
    let wait = seconds.parse().ok().filter(|_| plain).map(Duration::from_secs);
    wait.filter(|wait| *wait <= MAX_WAIT).ok_or_else(|| {
        ApiError::at(
            Code::BadQuery,
            "wait",
            format!("is {text:?}; allowed are 0 to {} seconds, for example 30s", MAX_WAIT.as_secs()),
        )
    })
}

/// Cancel a job
///
/// A queued job is cancelled at once; a running job frees its cores within two seconds. Cancelling it again has no effect.
#[utoipa::path(
    post,
    path = "/jobs/{id}/cancel",
    tag = "jobs",
    operation_id = "cancel_job",
    params(("id" = uuid::Uuid, Path, description = "Id of the job.")),
    responses(
        (status = 202, description = "The job is cancelled, or will be.", body = Job,
            headers(("Location" = String, description = "Path of the job."),
                    ("Retry-After" = String, description = "Seconds to wait before polling the job."))),
    )
)]
pub(in crate::http) async fn cancel(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<Accepted, ApiError> {
    params.deny_unknown()?;
    Ok(accepted(state.app.cancel(job_id(&id)?).await?))
}

/// Replace a job's labels
///
/// Labels serve to find jobs, and to protect them: a job with the label named by the setting `retention.hold_label`
/// (default `hold`) cannot be deleted. The labels that its plan and program echo stay as submitted.
#[utoipa::path(
    put,
    path = "/jobs/{id}/labels",
    tag = "jobs",
    operation_id = "put_job_labels",
    params(("id" = uuid::Uuid, Path, description = "Id of the job.")),
    request_body = LabelsRequest,
    responses((status = 200, description = "The job with its new labels.", body = Job))
)]
pub(in crate::http) async fn put_labels(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
    Json(labels): Json<LabelsRequest>,
) -> Result<axum::Json<Job>, ApiError> {
    params.deny_unknown()?;
    Ok(axum::Json(state.app.put_labels(job_id(&id)?, labels).await?))
}

/// Delete an ended job and its results
#[utoipa::path(
    delete,
    path = "/jobs/{id}",
    tag = "jobs",
    operation_id = "delete_job",
    params(("id" = uuid::Uuid, Path, description = "Id of the job.")),
    responses((status = 204, description = "The job was deleted."))
)]
pub(in crate::http) async fn delete(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<StatusCode, ApiError> {
    params.deny_unknown()?;
    state.app.delete_job(job_id(&id)?).await?;
    Ok(StatusCode::NO_CONTENT)
}
