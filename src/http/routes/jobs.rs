//! Jobs: create, read, wait, change, cancel, delete; one, or several at once.

use std::time::Duration;

use axum::extract::{FromRequest, FromRequestParts, Path, Request, State};
use axum::http::header::{LOCATION, RETRY_AFTER};
use axum::http::{HeaderName, StatusCode};
use axum::response::Response;
use serde::de::DeserializeOwned;
use serde_json::Value;
use utoipa::ToSchema;

use super::job_id;
use crate::http::extract::{Json, Params, json_body};
use crate::http::fields::Fields;
use crate::http::prefix::Prefix;
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::planning::params::Preset;
use crate::service::{Error, JobQuery, Submission};
use crate::wire::preset::check_beside_preset;
use crate::wire::{
    DeletedJobs, Job, JobBatch, JobBatchRequest, JobId, JobListItem, JobPage, JobProblem, JobRequest, JobSelection, JobSort,
    JobState, JobUpdate, LabelsRequest, label_filter_fault, parse, parse_document, problem_type,
};

/// Polling interval that responses suggest, seconds.
const POLL_AFTER_SECS: &str = "2";
/// Longest wait for a job's end.
const MAX_WAIT: Duration = Duration::from_secs(60);

/// A change of a job: its id in the path, and what is to become of it in the body.
pub(in crate::http) struct ChangeOf<T> {
    id: JobId,
    prefix: Prefix,
    body: T,
}

impl<T: DeserializeOwned + ToSchema + 'static> FromRequest<ApiState> for ChangeOf<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &ApiState) -> Result<Self, ApiError> {
        let (mut parts, body) = request.into_parts();
        let Ok(prefix) = Prefix::from_request_parts(&mut parts, state).await;
        let unreadable = |_| ApiError::new(Code::BadRequest, "the path is not UTF-8 text");
        let Path(id) = Path::<String>::from_request_parts(&mut parts, state).await.map_err(unreadable)?;
        let params = Params::from_request_parts(&mut parts, state).await?;
        let Json(body) = Json::from_request(Request::from_parts(parts, body), state).await?;
        params.deny_unknown()?;
        Ok(Self { id: job_id(&id)?, prefix, body })
    }
}

/// A request for jobs that gives nothing which a preset of parameters sets otherwise.
pub(in crate::http) struct NewJobs<T>(T);

/// A request with requests for jobs in it.
pub(in crate::http) trait HasJobs: DeserializeOwned + ToSchema + 'static {
    /// Requests for jobs, as many as are accepted at once, each with the pointer to it.
    fn jobs(&self) -> Vec<(String, &JobRequest)>;
}

impl HasJobs for JobRequest {
    fn jobs(&self) -> Vec<(String, &JobRequest)> {
        vec![(String::new(), self)]
    }
}

impl HasJobs for JobBatchRequest {
    fn jobs(&self) -> Vec<(String, &JobRequest)> {
        self.jobs.iter().take(Self::MAX_JOBS).enumerate().map(|(index, job)| (format!("/jobs/{index}"), job)).collect()
    }
}

impl<T: HasJobs> FromRequest<ApiState> for NewJobs<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &ApiState) -> Result<Self, ApiError> {
        let bytes = json_body(request, state).await?;
        let request: T = parse_document(&bytes)?;
        check_beside_presets(&request, &bytes)?;
        Ok(Self(request))
    }
}

/// Refuses what the body of a request gives beside a preset that sets it otherwise, defaults too, which the request as read does not
/// tell from what is not given.
pub(super) fn check_beside_presets(request: &impl HasJobs, body: &[u8]) -> Result<(), ApiError> {
    let jobs = request.jobs();
    if jobs.iter().all(|(_, job)| job.params.preset == Preset::default()) {
        return Ok(());
    }
    let given: Value = parse(body).map_err(|error| vec![error])?;
    let mut errors = Vec::new();
    for (at, job) in &jobs {
        let params = format!("{at}/params");
        let beside = given.pointer(&params).and_then(|given| check_beside_preset(given, &job.params).err());
        errors.extend(beside.into_iter().flatten().map(|error| error.below(&params)));
    }
    if errors.is_empty() {
        return Ok(());
    }
    // What else is wrong with the fields is told with it.
    let others = jobs.iter().flat_map(|(at, job)| job.check().err().into_iter().flatten().map(move |error| error.below(at)));
    let others: Vec<_> = others.filter(|error| errors.iter().all(|known| known.pointer != error.pointer)).collect();
    errors.extend(others);
    Err(Error::Invalid(errors).into())
}

type Accepted = (StatusCode, [(HeaderName, String); 2], Json<Job>);

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
    submission: Submission,
    prefix: Prefix,
    params: Params,
    NewJobs(request): NewJobs<JobRequest>,
) -> Result<Accepted, ApiError> {
    params.deny_unknown()?;
    Ok(accepted(state.app.submit(request, submission).await?, &prefix))
}

fn accepted(job: Job, prefix: &Prefix) -> Accepted {
    let location = prefix.at(&format!("/api/v1/jobs/{}", job.id));
    (StatusCode::ACCEPTED, [(LOCATION, location), (RETRY_AFTER, POLL_AFTER_SECS.to_owned())], Json(shown(job, prefix)))
}

/// The job as clients below `prefix` see it.
fn shown(mut job: Job, prefix: &Prefix) -> Job {
    refer(&mut job.problem, prefix);
    job
}

/// Makes a problem refer to its page, wherever it was stored.
pub(super) fn refer(problem: &mut Option<JobProblem>, prefix: &Prefix) {
    if let Some(problem) = problem {
        problem.kind = prefix.at(&problem_type(&problem.code));
    }
}

/// Start several jobs
///
/// Either all are accepted or none: if one cannot be, the response names the fields at fault with pointers such as
/// `/jobs/3/cell`, and nothing is stored.
#[utoipa::path(
    post,
    path = "/jobs/batch",
    tag = "jobs",
    operation_id = "create_jobs",
    params(("Idempotency-Key" = Option<String>, Header, pattern = "^[ \\t]*[\\x21-\\x7e]{1,255}[ \\t]*$",
        description = "Within 24 hours, the same key with the same request gives the same response and starts no more jobs. \
                       Surrounding white space is ignored (RFC 9110, section 5.5).")),
    request_body = JobBatchRequest,
    responses(
        (status = 202, description = "The jobs were accepted.", body = JobBatch,
            headers(("Retry-After" = String, description = "Seconds to wait before polling the jobs."))),
    )
)]
pub(in crate::http) async fn create_batch(
    State(state): State<ApiState>,
    submission: Submission,
    prefix: Prefix,
    params: Params,
    NewJobs(batch): NewJobs<JobBatchRequest>,
) -> Result<(StatusCode, [(HeaderName, &'static str); 1], Json<JobBatch>), ApiError> {
    params.deny_unknown()?;
    let batch = state.app.submit_batch(batch, submission).await?;
    let jobs = batch.jobs.into_iter().map(|job| shown(job, &prefix)).collect();
    Ok((StatusCode::ACCEPTED, [(RETRY_AFTER, POLL_AFTER_SECS)], Json(JobBatch { jobs })))
}

/// Delete several ended jobs and their results
///
/// Deletes the jobs that match all given fields; at least one field must be given. The results, the uploaded scans and the
/// inspections of a job are deleted with it; its runs are kept. Jobs that have not ended, and jobs with the hold label, are kept
/// and counted.
#[utoipa::path(
    post,
    path = "/jobs/delete",
    tag = "jobs",
    operation_id = "delete_jobs",
    params(("dry_run" = Option<bool>, Query, example = json!(false), description = "`true`: only count the jobs.")),
    request_body = JobSelection,
    responses((status = 200, description = "Numbers of the selected jobs, by outcome.", body = DeletedJobs))
)]
pub(in crate::http) async fn delete_selected(
    State(state): State<ApiState>,
    mut params: Params,
    Json(selection): Json<JobSelection>,
) -> Result<Json<DeletedJobs>, ApiError> {
    let dry_run = params.value("dry_run", "true or false")?.unwrap_or(false);
    params.deny_unknown()?;
    Ok(Json(state.app.delete_jobs(selection, dry_run).await?))
}

/// List jobs
///
/// Status of each job without its request, which `/jobs/{id}` includes; newest first unless `sort` says otherwise. Only jobs that
/// match all given filters are listed. A page ends early, with a token, if its entries would exceed 4 MiB.
#[utoipa::path(
    get,
    path = "/jobs",
    tag = "jobs",
    operation_id = "list_jobs",
    params(
        ("state" = Option<JobState>, Query, description = "Only jobs in this state."),
        ("label" = Option<String>, Query, pattern = "^[^=]", example = "line=3", description = "Only jobs with this label: `key` or `key=value`."),
        ("part_number" = Option<String>, Query, example = "PN-4711", description = "Only jobs with this part number."),
        ("serial" = Option<String>, Query, example = "S-0001", description = "Only jobs with this serial number."),
        ("mesh" = Option<uuid::Uuid>, Query, description = "Only jobs for the mesh of this id."),
        ("cell" = Option<String>, Query, example = "e05-transcan", description = "Only jobs in the cell of this name; `none` for those without one."),
        ("created_after" = Option<String>, Query, format = DateTime, example = "2026-01-01T00:00:00Z", description = "Only jobs accepted at this time or later (RFC 3339)."),
        ("created_before" = Option<String>, Query, format = DateTime, example = "2100-01-01T00:00:00+01:00", description = "Only jobs accepted before this time (RFC 3339)."),
        ("sort" = Option<JobSort>, Query, example = "-created_at", description = "Order of the jobs: a field, with `-` for descending; `-created_at` by default: latest accepted first, also where the clock was set back between two jobs. In ascending order, a job that has not ended comes after those that have, and one without a number before those with one."),
        ("fields" = Option<String>, Query, example = "id,state,part_number,serial,ended_at", description = "Fields of each job to return, separated by commas; `id` is always included. Default: all."),
        ("page_size" = Option<u32>, Query, description = "Largest number of entries on the page; 50 by default.", minimum = 1, maximum = 1000),
        ("page_token" = inline(Option<super::super::openapi::PageToken>), Query, description = "`next_page_token` of the previous page; filters and order must be the same."),
    ),
    responses((status = 200, description = "A page of jobs.", body = JobPage))
)]
pub(in crate::http) async fn list(
    State(state): State<ApiState>,
    prefix: Prefix,
    mut params: Params,
) -> Result<Response, ApiError> {
    let query = query(&mut params)?;
    let fields = Fields::take::<JobListItem>(&mut params)?;
    let (page_size, page_token) = params.page()?;
    params.deny_unknown()?;
    let mut page = state.app.jobs(&query, page_size, page_token.as_deref()).await?;
    page.items.iter_mut().for_each(|job| refer(&mut job.problem, &prefix));
    Ok(fields.of_items(&page).map_err(Error::from)?)
}

/// Takes the filters and the order of a list.
fn query(params: &mut Params) -> Result<JobQuery, ApiError> {
    const TIME: &str = "a time of RFC 3339, for example 2026-01-31T12:00:00Z";
    let states = format!("one of {}", JobState::ALL.map(JobState::as_str).join(", "));
    let selection = JobSelection {
        ids: None,
        state: params.value("state", &states)?,
        label: keyed(params.text("label"))?,
        part_number: params.text("part_number"),
        serial: params.text("serial"),
        mesh_id: params.value("mesh", "the id of a mesh, a UUID")?,
        cell: params.text("cell"),
        created_after: params.value("created_after", TIME)?,
        created_before: params.value("created_before", TIME)?,
    };
    let sort = params.value("sort", &format!("one of {}", JobSort::names().join(", ")))?.unwrap_or_default();
    Ok(JobQuery { selection, sort })
}

/// Refuses a filter by a label without a key.
pub(super) fn keyed(label: Option<String>) -> Result<Option<String>, ApiError> {
    match label.as_deref().and_then(label_filter_fault) {
        Some(said) => Err(ApiError::query("label", &said)),
        None => Ok(label),
    }
}

/// Get a job, or wait for its end
#[utoipa::path(
    get,
    path = "/jobs/{id}",
    tag = "jobs",
    operation_id = "get_job",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the job."),
        ("wait" = Option<String>, Query, pattern = "^([0-9]|[1-5][0-9]|60)s?$", example = "5s",
            description = "Respond when the job has ended, or after this time: up to 60 seconds, for example `30s`."),
        ("fields" = Option<String>, Query,
            description = "Fields of the job to return, separated by commas, for example `state,fraction`; `id` is always included. Default: all."),
    ),
    responses((status = 200, description = "The job.", body = Job))
)]
pub(in crate::http) async fn get(
    State(state): State<ApiState>,
    prefix: Prefix,
    Path(id): Path<String>,
    mut params: Params,
) -> Result<Response, ApiError> {
    let wait = params.text("wait").as_deref().map(duration).transpose()?;
    let fields = Fields::take::<Job>(&mut params)?;
    params.deny_unknown()?;
    let id = job_id(&id)?;
    let job = match wait {
        Some(wait) => state.app.job_when_ended(id, wait).await?,
        None => state.app.job(id).await?,
    };
    Ok(fields.of(&shown(job, &prefix)).map_err(Error::from)?)
}

/// Parses the time of a wait.
pub(super) fn duration(text: &str) -> Result<Duration, ApiError> {
    let seconds = text.strip_suffix('s').unwrap_or(text);
    let plain = !seconds.is_empty() && seconds.bytes().all(|c| c.is_ascii_digit());
    let wait = seconds.parse().ok().filter(|_| plain).map(Duration::from_secs);
    wait.filter(|wait| *wait <= MAX_WAIT).ok_or_else(|| {
        let said = format!("is {text:?}; allowed are 0 to {} seconds, for example 30s", MAX_WAIT.as_secs());
        ApiError::query("wait", &said)
    })
}

/// Change the priority of a queued job
///
/// The job moves in the queue at once. A job that is running or has ended cannot be changed.
#[utoipa::path(
    patch,
    path = "/jobs/{id}",
    tag = "jobs",
    operation_id = "update_job",
    params(("id" = uuid::Uuid, Path, description = "Id of the job.")),
    request_body = JobUpdate,
    responses((status = 200, description = "The job with its new priority and place in the queue.", body = Job))
)]
pub(in crate::http) async fn update(State(state): State<ApiState>, change: ChangeOf<JobUpdate>) -> Result<Json<Job>, ApiError> {
    Ok(Json(shown(state.app.update_job(change.id, change.body).await?, &change.prefix)))
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
    prefix: Prefix,
    Path(id): Path<String>,
    params: Params,
) -> Result<Accepted, ApiError> {
    params.deny_unknown()?;
    Ok(accepted(state.app.cancel(job_id(&id)?).await?, &prefix))
}

/// Replace a job's labels
///
/// Labels serve to find jobs and to protect them: a job with the label named by the setting `retention.hold_label` (default
/// `hold`) cannot be deleted, nor can its scans, inspections and runs. The labels in its plan and program stay as submitted.
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
    change: ChangeOf<LabelsRequest>,
) -> Result<Json<Job>, ApiError> {
    Ok(Json(shown(state.app.put_labels(change.id, change.body).await?, &change.prefix)))
}

/// Delete an ended job and its results
///
/// The uploaded scans and the inspections of the job are deleted with it; its runs are kept. A job with the hold label is not
/// deleted (409, `job_held`).
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
