//! Jobs: start, look, wait, cancel, delete.

use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::header::{LOCATION, RETRY_AFTER};
use axum::http::{HeaderName, StatusCode};

use super::job_id;
use crate::http::extract::{IdempotencyKey, Json, Params};
use crate::http::problem::{Code, Problem};
use crate::http::router::Site;
use crate::service::JobQuery;
use crate::wire::{Job, JobLabels, JobPage, JobRequest, JobState};

/// A look at a job is worth while after this time.
const LOOK_AGAIN_SECS: &str = "2";
/// Longest wait for a job's end.
const LONGEST_WAIT: Duration = Duration::from_secs(60);

type Accepted = (StatusCode, [(HeaderName, String); 2], axum::Json<Job>);

/// Start a job
///
/// Everything that the request names is looked up and checked first; what was found is kept with the job. When the
/// answer has come, the job survives every crash.
#[utoipa::path(
    post,
    path = "/jobs",
    tag = "jobs",
    operation_id = "create_job",
    params(("Idempotency-Key" = Option<String>, Header, pattern = "^[ \\t]*[\\x21-\\x7e]{1,255}[ \\t]*$",
        description = "The same key with the same request gives the same answer for 24 hours, and starts no second job. \
                       White space around it is no part of it (RFC 9110, 5.5).")),
    request_body = JobRequest,
    responses(
        (status = 202, description = "The job was accepted.", body = Job,
            headers(("Location" = String, description = "Path of the job."),
                    ("Retry-After" = String, description = "Seconds after which a look is worth while."))),
    )
)]
pub(in crate::http) async fn create(
    State(site): State<Site>,
    key: Option<IdempotencyKey>,
    params: Params,
    Json(request): Json<JobRequest>,
) -> Result<Accepted, Problem> {
    params.end()?;
    let limit = Some(site.options.request_timeout);
    let job = site.app.submit(request, key.as_ref().map(|IdempotencyKey(key)| key.as_str()), limit).await?;
    Ok(accepted(job))
}

fn accepted(job: Job) -> Accepted {
    let location = format!("/api/v1/jobs/{}", job.id);
    (StatusCode::ACCEPTED, [(LOCATION, location), (RETRY_AFTER, LOOK_AGAIN_SECS.to_owned())], axum::Json(job))
}

/// List jobs, newest first
///
/// How each stands, without what it was asked for: that is at `/jobs/{id}`. A page ends early, with a token, where its
/// entries would take more than 4 MiB.
#[utoipa::path(
    get,
    path = "/jobs",
    tag = "jobs",
    operation_id = "list_jobs",
    params(
        ("state" = Option<JobState>, Query, description = "Only jobs in this state."),
        ("label" = Option<String>, Query, description = "Only jobs with this label: `key` or `key=value`."),
        ("part_number" = Option<String>, Query, description = "Only jobs with this part number."),
        ("page_size" = Option<u32>, Query, description = "Entries of a page.", minimum = 1, maximum = 1000),
        ("page_token" = inline(Option<super::super::openapi::PageToken>), Query, description = "`next_page_token` of the page before, with the same filters."),
    ),
    responses((status = 200, description = "A page of jobs.", body = JobPage))
)]
pub(in crate::http) async fn list(State(site): State<Site>, mut params: Params) -> Result<axum::Json<JobPage>, Problem> {
    let query = JobQuery { state: params.value("state")?, label: params.text("label"), part_number: params.text("part_number") };
    let (page_size, page_token) = params.page()?;
    params.end()?;
    Ok(axum::Json(site.app.jobs(&query, page_size, page_token.as_deref()).await?))
}

/// Look at a job, or wait for its end
#[utoipa::path(
    get,
    path = "/jobs/{id}",
    tag = "jobs",
    operation_id = "get_job",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the job."),
        ("wait" = Option<String>, Query, pattern = "^([0-9]|[1-5][0-9]|60)s?$",
            description = "Answer when the job has ended, or after this time: seconds up to 60, as in `30s`."),
    ),
    responses((status = 200, description = "The job.", body = Job))
)]
pub(in crate::http) async fn get(
    State(site): State<Site>,
    Path(id): Path<String>,
    mut params: Params,
) -> Result<axum::Json<Job>, Problem> {
    let wait = params.text("wait").as_deref().map(duration).transpose()?;
    params.end()?;
    let id = job_id(&id)?;
    let job = match wait {
        Some(wait) => site.app.job_when_ended(id, wait).await?,
        None => site.app.job(id).await?,
    };
    Ok(axum::Json(job))
}

fn duration(text: &str) -> Result<Duration, Problem> {
    let seconds = text.strip_suffix('s').unwrap_or(text);
    let plain = !seconds.is_empty() && seconds.bytes().all(|c| c.is_ascii_digit());
    let wait = seconds.parse().ok().filter(|_| plain).map(Duration::from_secs);
    wait.filter(|wait| *wait <= LONGEST_WAIT).ok_or_else(|| {
        Problem::at(Code::BadQuery, "wait", format!("is {text:?}; it is seconds up to {}, as in 30s", LONGEST_WAIT.as_secs()))
    })
}

/// Cancel a job
///
/// A queued job is cancelled at once, a running one frees its cores within two seconds. Asking again changes nothing.
#[utoipa::path(
    post,
    path = "/jobs/{id}/cancel",
    tag = "jobs",
    operation_id = "cancel_job",
    params(("id" = uuid::Uuid, Path, description = "Id of the job.")),
    responses(
        (status = 202, description = "It is cancelled, or will be.", body = Job,
            headers(("Location" = String, description = "Path of the job."),
                    ("Retry-After" = String, description = "Seconds after which a look is worth while."))),
    )
)]
pub(in crate::http) async fn cancel(
    State(site): State<Site>,
    Path(id): Path<String>,
    params: Params,
) -> Result<Accepted, Problem> {
    params.end()?;
    Ok(accepted(site.app.cancel(job_id(&id)?).await?))
}

/// Replace a job's labels
///
/// For finding it, and for a hold: a job with the label that `retention.hold_label` names (`hold`) is never deleted. What
/// its plan and program echo stays as it was submitted.
#[utoipa::path(
    put,
    path = "/jobs/{id}/labels",
    tag = "jobs",
    operation_id = "put_job_labels",
    params(("id" = uuid::Uuid, Path, description = "Id of the job.")),
    request_body = JobLabels,
    responses((status = 200, description = "The job with its new labels.", body = Job))
)]
pub(in crate::http) async fn put_labels(
    State(site): State<Site>,
    Path(id): Path<String>,
    params: Params,
    Json(labels): Json<JobLabels>,
) -> Result<axum::Json<Job>, Problem> {
    params.end()?;
    Ok(axum::Json(site.app.put_labels(job_id(&id)?, labels).await?))
}

/// Delete an ended job and its results
#[utoipa::path(
    delete,
    path = "/jobs/{id}",
    tag = "jobs",
    operation_id = "delete_job",
    params(("id" = uuid::Uuid, Path, description = "Id of the job.")),
    responses((status = 204, description = "It is gone."))
)]
pub(in crate::http) async fn delete(
    State(site): State<Site>,
    Path(id): Path<String>,
    params: Params,
) -> Result<StatusCode, Problem> {
    params.end()?;
    site.app.delete_job(job_id(&id)?).await?;
    Ok(StatusCode::NO_CONTENT)
}
