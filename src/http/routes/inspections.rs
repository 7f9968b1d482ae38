//! Inspections: submit, read, wait, list, cancel, delete; their results as documents, tables, point clouds and a report.

use axum::extract::{Path, State};
use axum::http::header::{LOCATION, RETRY_AFTER};
use axum::http::{HeaderMap, HeaderName, StatusCode};
use axum::response::Response;

use super::job_id;
use super::jobs::{duration, refer};
use super::results::respond;
use crate::http::download::{Disposition, content_disposition, result_name};
use crate::http::extract::{Json, Params};
use crate::http::negotiate::{Representation, choose};
use crate::http::prefix::Prefix;
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::service::Submission;
use crate::wire::inspection::{
    InspectionDocument, InspectionJob, InspectionPage, InspectionRequest, InspectionSelection, LearnedDocument, LossListing,
    RescanRequest,
};
use crate::wire::{InspectionId, Job, JobId, JobState};

/// Polling interval that responses suggest, seconds.
const POLL_AFTER_SECS: &str = "1";
const JSON: &str = "application/json";
const CSV: &str = "text/csv; charset=utf-8";
const HTML: &str = "text/html; charset=utf-8";
const TEXT: &str = "text/plain; charset=utf-8";
const PLY: &str = "application/octet-stream";

const fn representation(name: &'static str, media_type: &'static str, file: &'static str) -> Representation {
    Representation { name, media_type, file: std::borrow::Cow::Borrowed(file) }
}

const RESULT: [Representation; 1] = [representation("json", JSON, "inspection.json")];
const LOSSES: [Representation; 2] = [representation("json", JSON, "losses.json"), representation("csv", CSV, "coverage.csv")];
const DEVIATION: [Representation; 2] = [representation("csv", CSV, "deviation.csv"), representation("ply", PLY, "deviation.ply")];
const LEARNED: [Representation; 1] = [representation("json", JSON, "learned.json")];
const REPORT: [Representation; 2] =
    [representation("html", HTML, "inspection.html"), representation("text", TEXT, "inspection.txt")];

/// Parses the inspection id in a path. A malformed id is answered like an unknown one.
fn inspection_id(text: &str) -> Result<InspectionId, ApiError> {
    text.parse().map_err(|_| ApiError::new(Code::InspectionNotFound, format!("{text:?} is not the id of an inspection")))
}

/// Inspect a part
///
/// Registers the scans of the job to its part, compares what they measured with what was planned, names the cause of every loss,
/// and measures how the surface deviates. Inspections are computed one after another.
#[utoipa::path(
    post,
    path = "/jobs/{id}/inspections",
    tag = "inspections",
    operation_id = "create_inspection",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the job whose plan was scanned."),
        ("Idempotency-Key" = Option<String>, Header, pattern = "^[ \\t]*[\\x21-\\x7e]{1,255}[ \\t]*$",
            description = "Within 24 hours, the same key with the same request gives the same response and starts no second \
                           inspection. Surrounding white space is ignored (RFC 9110, section 5.5)."),
    ),
    request_body = InspectionRequest,
    responses(
        (status = 202, description = "The inspection was accepted.", body = InspectionJob,
            headers(("Location" = String, description = "Path of the inspection."),
                    ("Retry-After" = String, description = "Seconds to wait before polling the inspection."))),
    )
)]
pub(in crate::http) async fn create(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    submission: Submission,
    prefix: Prefix,
    params: Params,
    Json(request): Json<InspectionRequest>,
) -> Result<(StatusCode, [(HeaderName, String); 2], Json<InspectionJob>), ApiError> {
    params.deny_unknown()?;
    let job = state.app.submit_inspection(job_id(&id)?, request, submission).await?;
    let location = prefix.at(&format!("/api/v1/inspections/{}", job.id));
    Ok((StatusCode::ACCEPTED, [(LOCATION, location), (RETRY_AFTER, POLL_AFTER_SECS.to_owned())], Json(job)))
}

/// Plan further views
///
/// Plans the fewest views for what the scans lack, as a new job. Its part, cell, parameters and labels are those of the inspected
/// job, and its label `rescan_of` names the inspection. Surface that no view can recover is left out; the job fails with
/// `no_plan` if no further view is worth taking.
#[utoipa::path(
    post,
    path = "/inspections/{id}/rescans",
    tag = "inspections",
    operation_id = "create_rescan",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the inspection."),
        ("Idempotency-Key" = Option<String>, Header, pattern = "^[ \\t]*[\\x21-\\x7e]{1,255}[ \\t]*$",
            description = "Within 24 hours, the same key with the same request gives the same response and starts no second job. \
                           Surrounding white space is ignored (RFC 9110, section 5.5)."),
    ),
    request_body = RescanRequest,
    responses(
        (status = 202, description = "The job was accepted.", body = Job,
            headers(("Location" = String, description = "Path of the job."),
                    ("Retry-After" = String, description = "Seconds to wait before polling the job."))),
    )
)]
pub(in crate::http) async fn rescan(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    submission: Submission,
    prefix: Prefix,
    params: Params,
    Json(request): Json<RescanRequest>,
) -> Result<(StatusCode, [(HeaderName, String); 2], Json<Job>), ApiError> {
    params.deny_unknown()?;
    let job = state.app.submit_rescan_of(inspection_id(&id)?, request, submission).await?;
    let location = prefix.at(&format!("/api/v1/jobs/{}", job.id));
    Ok((StatusCode::ACCEPTED, [(LOCATION, location), (RETRY_AFTER, POLL_AFTER_SECS.to_owned())], Json(job)))
}

/// List inspections
///
/// Newest first. Only items that match all given filters are listed.
#[utoipa::path(
    get,
    path = "/inspections",
    tag = "inspections",
    operation_id = "list_inspections",
    params(
        ("state" = Option<JobState>, Query, description = "Only inspections in this state."),
        ("job_id" = Option<uuid::Uuid>, Query, example = "01900000-0000-7000-8000-000000000001", description = "Only inspections of this job."),
        ("page_size" = Option<u32>, Query, description = "Largest number of entries on the page; 50 by default.", minimum = 1, maximum = 1000),
        ("page_token" = inline(Option<super::super::openapi::PageToken>), Query, description = "`next_page_token` of the previous page; filters must be the same."),
    ),
    responses((status = 200, description = "A page of inspections.", body = InspectionPage))
)]
pub(in crate::http) async fn list(
    State(state): State<ApiState>,
    prefix: Prefix,
    mut params: Params,
) -> Result<Json<InspectionPage>, ApiError> {
    let states = format!("one of {}", JobState::ALL.map(JobState::as_str).join(", "));
    let job_id: Option<JobId> = params.value("job_id", "the id of a job")?;
    let selection = InspectionSelection { state: params.value("state", &states)?, job_id };
    let (page_size, page_token) = params.page()?;
    params.deny_unknown()?;
    let mut page = state.app.inspections(&selection, page_size, page_token.as_deref()).await?;
    page.items.iter_mut().for_each(|inspection| refer(&mut inspection.problem, &prefix));
    Ok(Json(page))
}

/// Get an inspection, or wait for its end
#[utoipa::path(
    get,
    path = "/inspections/{id}",
    tag = "inspections",
    operation_id = "get_inspection",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the inspection."),
        ("wait" = Option<String>, Query, pattern = "^([0-9]|[1-5][0-9]|60)s?$", example = "5s",
            description = "Respond when the inspection has ended, or after this time: up to 60 seconds, for example `30s`."),
    ),
    responses((status = 200, description = "The inspection.", body = InspectionJob))
)]
pub(in crate::http) async fn get(
    State(state): State<ApiState>,
    prefix: Prefix,
    Path(id): Path<String>,
    mut params: Params,
) -> Result<Json<InspectionJob>, ApiError> {
    let wait = params.text("wait").as_deref().map(duration).transpose()?;
    params.deny_unknown()?;
    let id = inspection_id(&id)?;
    let mut inspection = match wait {
        Some(wait) => state.app.inspection_when_ended(id, wait).await?,
        None => state.app.inspection(id).await?,
    };
    refer(&mut inspection.problem, &prefix);
    Ok(Json(inspection))
}

/// Cancel an inspection
#[utoipa::path(
    post,
    path = "/inspections/{id}/cancel",
    tag = "inspections",
    operation_id = "cancel_inspection",
    params(("id" = uuid::Uuid, Path, description = "Id of the inspection.")),
    responses((status = 200, description = "The inspection; a running one ends soon.", body = InspectionJob))
)]
pub(in crate::http) async fn cancel(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<Json<InspectionJob>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.cancel_inspection(inspection_id(&id)?).await?))
}

/// Delete an ended inspection
///
/// Refused with 409 (`job_held`) while the inspection's job has the hold label.
#[utoipa::path(
    delete,
    path = "/inspections/{id}",
    tag = "inspections",
    operation_id = "delete_inspection",
    params(("id" = uuid::Uuid, Path, description = "Id of the inspection.")),
    responses((status = 204, description = "The inspection was deleted."))
)]
pub(in crate::http) async fn delete(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<StatusCode, ApiError> {
    params.deny_unknown()?;
    state.app.delete_inspection(inspection_id(&id)?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Responds with a file of an inspection in the form that the query or `Accept` asks for.
async fn answer(
    state: &ApiState,
    id: &str,
    headers: &HeaderMap,
    mut params: Params,
    offered: &[Representation],
) -> Result<Response, ApiError> {
    let format = params.text("format");
    params.deny_unknown()?;
    let id = inspection_id(id)?;
    // The inspection is looked up before the representation is chosen: an unknown one is 404, whatever the representation.
    let job = state.app.inspection(id).await?.job_id;
    let chosen = choose(headers, format.as_deref().map(|form| ("format", form)), offered)?;
    let file = state.app.inspection_result(id, &chosen.file).await?;
    let shown = [JSON, HTML, TEXT].contains(&chosen.media_type);
    let disposition = if shown { Disposition::Inline } else { Disposition::Attachment };
    let name = result_name(&state.app.part_names(job).await?, &id.to_string(), &chosen.file);
    let disposition = content_disposition(disposition, &name);
    respond(state, &file, headers, chosen.media_type, disposition).await
}

/// Get the result of an inspection
///
/// The poses of the scans, what they measured compared with the plan, the losses by cause, and the deviation of the surface. It
/// never changes.
#[utoipa::path(
    get,
    path = "/inspections/{id}/result",
    tag = "inspections",
    operation_id = "get_inspection_result",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the inspection."),
        ("format" = inline(Option<super::super::openapi::JsonForm>), Query, example = "json", description = "Form of the response."),
    ),
    responses(
        (status = 200, description = "The result.", body = InspectionDocument,
            headers(("ETag" = String, description = "Strong tag: SHA-256 of the bytes."))),
        (status = 304, description = "The client has the current version."),
    )
)]
pub(in crate::http) async fn result(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    answer(&state, &id, &headers, params, &RESULT).await
}

/// Get the losses of an inspection
///
/// Every spot that was planned but not measured, with its cause and remedy; as `csv`, every face with its areas.
#[utoipa::path(
    get,
    path = "/inspections/{id}/losses",
    tag = "inspections",
    operation_id = "get_inspection_losses",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the inspection."),
        ("format" = inline(Option<super::super::openapi::LossesForm>), Query, example = "json", description = "Form of the response. Default: chosen by `Accept`."),
    ),
    responses(
        (status = 200, description = "The losses.", content((LossListing = "application/json"), (String = "text/csv")),
            headers(("ETag" = String, description = "Strong tag: SHA-256 of the bytes."))),
        (status = 304, description = "The client has the current version."),
    )
)]
pub(in crate::http) async fn losses(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    answer(&state, &id, &headers, params, &LOSSES).await
}

/// Get the deviation of the surface
///
/// A table of the faces; as `ply`, the measured points coloured by deviation. Deviations are along the outward normal: above 0 is more
/// material than nominal.
#[utoipa::path(
    get,
    path = "/inspections/{id}/deviation",
    tag = "inspections",
    operation_id = "get_inspection_deviation",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the inspection."),
        ("format" = inline(Option<super::super::openapi::DeviationForm>), Query, example = "csv", description = "Form of the response. Default: chosen by `Accept`."),
    ),
    responses(
        (status = 200, description = "The deviation.", content(
            (String = "text/csv"), (inline(super::super::openapi::Bytes) = "application/octet-stream"),
        ), headers(("ETag" = String, description = "Strong tag: SHA-256 of the bytes."))),
        (status = 304, description = "The client has the current version."),
    )
)]
pub(in crate::http) async fn deviation(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    answer(&state, &id, &headers, params, &DEVIATION).await
}

/// Get what the scans reveal about the scanner
///
/// Noise, limits of incidence, specular lobe and depth, each with its confidence interval, and suggested parameters; none of
/// these is applied automatically.
#[utoipa::path(
    get,
    path = "/inspections/{id}/learned",
    tag = "inspections",
    operation_id = "get_inspection_learned",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the inspection."),
        ("format" = inline(Option<super::super::openapi::JsonForm>), Query, example = "json", description = "Form of the response."),
    ),
    responses(
        (status = 200, description = "The findings.", body = LearnedDocument,
            headers(("ETag" = String, description = "Strong tag: SHA-256 of the bytes."))),
        (status = 304, description = "The client has the current version."),
    )
)]
pub(in crate::http) async fn learned(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    answer(&state, &id, &headers, params, &LEARNED).await
}

/// Get the report of an inspection
///
/// HTML page with the alignment, the deviation, the losses by cause, and the features.
#[utoipa::path(
    get,
    path = "/inspections/{id}/report",
    tag = "inspections",
    operation_id = "get_inspection_report",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the inspection."),
        ("format" = inline(Option<super::super::openapi::ReportForm>), Query, example = "text", description = "Form of the response. Default: chosen by `Accept`."),
    ),
    responses(
        (status = 200, description = "The report.", content((String = "text/html"), (String = "text/plain")),
            headers(("ETag" = String, description = "Strong tag: SHA-256 of the bytes."))),
        (status = 304, description = "The client has the current version."),
    )
)]
pub(in crate::http) async fn report(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    answer(&state, &id, &headers, params, &REPORT).await
}
