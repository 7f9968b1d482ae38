//! Runs of programs: start, read, wait, follow, record, delete.

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE, LOCATION, RETRY_AFTER, VARY};
use axum::http::{HeaderMap, HeaderName, StatusCode};
use axum::response::{IntoResponse, Response};

use super::jobs::duration;
use super::streamed;
use crate::http::client::Client;
use crate::http::events::run_event_stream;
use crate::http::extract::{Json, Params};
use crate::http::negotiate::{Representation, choose};
use crate::http::prefix::Prefix;
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::service::Submission;
use crate::wire::RunId;
use crate::wire::run::{ReportedState, Run, RunMode, RunPage, RunRecordDocument, RunRequest, RunSelection};

/// Polling interval that responses suggest, seconds.
const POLL_AFTER_SECS: &str = "1";
/// Largest fencing token, 2⁵³ − 1: what every JSON client holds exactly (RFC 8259, section 6).
const MAX_TOKEN: u64 = 9_007_199_254_740_991;
/// Media type of a record as a table.
const CSV: &str = "text/csv; charset=utf-8";
/// Media type of an audit log: text, an entry a line.
const AUDIT_TEXT: &str = "text/plain; charset=utf-8";

/// Parses the run id in a path. A malformed id is answered like an unknown one.
pub(super) fn run_id(text: &str) -> Result<RunId, ApiError> {
    text.parse().map_err(|_| ApiError::new(Code::RunNotFound, format!("{text:?} is not the id of a run")))
}

/// Takes the fencing token of the lease.
pub(super) fn token(params: &mut Params) -> Result<Option<u64>, ApiError> {
    params.whole_number("token", MAX_TOKEN)
}

/// The answer to a request that was accepted.
pub(super) type Accepted = (StatusCode, [(HeaderName, String); 2], Json<Run>);

pub(super) fn accepted(run: Run, prefix: &Prefix) -> Accepted {
    let location = prefix.at(&format!("/api/v1/runs/{}", run.id));
    (StatusCode::ACCEPTED, [(LOCATION, location), (RETRY_AFTER, POLL_AFTER_SECS.to_owned())], Json(run))
}

/// Start a run
///
/// Executes the program of a job that succeeded. In the mode `simulate`, the default, a simulated twin of arm and table moves,
/// and the run begins at once. `dry_run` connects to the controllers of the operator's cell file, reads their state and sends no
/// motion. `live` moves arm and table: it needs the setting `execution.live`, the lease of the cell (`token`), and to be armed by
/// the operator (`POST /runs/{id}/arm`). Controllers are named only in the operator's cell file, never in a request.
///
/// Vantage is not safety-rated, and its stop is not an emergency stop: keep the cell's own safety system active.
#[utoipa::path(
    post,
    path = "/runs",
    tag = "runs",
    operation_id = "create_run",
    params(
        ("token" = Option<u64>, Query, minimum = 0, maximum = 9_007_199_254_740_991_i64, description = "Fencing token of the cell's lease; needed in the mode `live`."),
        ("Idempotency-Key" = Option<String>, Header, pattern = "^[ \\t]*[\\x21-\\x7e]{1,255}[ \\t]*$",
            description = "Within 24 hours, the same key with the same request gives the same response and starts no second run. \
                           Surrounding white space is ignored (RFC 9110, section 5.5)."),
    ),
    request_body = RunRequest,
    responses(
        (status = 202, description = "The run was accepted.", body = Run,
            headers(("Location" = String, description = "Path of the run."),
                    ("Retry-After" = String, description = "Seconds to wait before polling the run."))),
    )
)]
pub(in crate::http) async fn create(
    State(state): State<ApiState>,
    submission: Submission,
    prefix: Prefix,
    mut params: Params,
    Json(request): Json<RunRequest>,
) -> Result<Accepted, ApiError> {
    let token = token(&mut params)?;
    params.deny_unknown()?;
    Ok(accepted(state.app.submit_run(request, token, submission).await?, &prefix))
}

/// List runs
///
/// Newest first. Only items that match all given filters are listed.
#[utoipa::path(
    get,
    path = "/runs",
    tag = "runs",
    operation_id = "list_runs",
    params(
        ("state" = Option<ReportedState>, Query, description = "Only runs in this state."),
        ("mode" = Option<RunMode>, Query, example = "simulate", description = "Only runs in this mode."),
        ("cell" = Option<String>, Query, example = "e05-transcan", description = "Only runs in the cell of this name."),
        ("job" = Option<uuid::Uuid>, Query, description = "Only runs of the job of this id."),
        ("created_after" = Option<String>, Query, format = DateTime, example = "2026-01-01T00:00:00Z", description = "Only runs accepted at this time or later (RFC 3339)."),
        ("created_before" = Option<String>, Query, format = DateTime, example = "2100-01-01T00:00:00+01:00", description = "Only runs accepted before this time (RFC 3339)."),
        ("page_size" = Option<u32>, Query, description = "Largest number of entries on the page; 50 by default.", minimum = 1, maximum = 1000),
        ("page_token" = inline(Option<super::super::openapi::PageToken>), Query, description = "`next_page_token` of the previous page; filters must be the same."),
    ),
    responses((status = 200, description = "A page of runs.", body = RunPage))
)]
pub(in crate::http) async fn list(State(state): State<ApiState>, mut params: Params) -> Result<Json<RunPage>, ApiError> {
    const TIME: &str = "a time of RFC 3339, for example 2026-01-31T12:00:00Z";
    let states = format!("one of {}", ReportedState::ALL.map(ReportedState::as_str).join(", "));
    let modes = format!("one of {}", RunMode::ALL.map(RunMode::as_str).join(", "));
    let selection = RunSelection {
        state: params.value("state", &states)?,
        mode: params.value("mode", &modes)?,
        cell: params.text("cell"),
        job_id: params.value("job", "the id of a job, a UUID")?,
        created_after: params.value("created_after", TIME)?,
        created_before: params.value("created_before", TIME)?,
    };
    let (page_size, page_token) = params.page()?;
    params.deny_unknown()?;
    Ok(Json(state.app.runs(&selection, page_size, page_token.as_deref()).await?))
}

/// Get a run, or wait for its end
#[utoipa::path(
    get,
    path = "/runs/{id}",
    tag = "runs",
    operation_id = "get_run",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the run."),
        ("wait" = Option<String>, Query, pattern = "^([0-9]|[1-5][0-9]|60)s?$", example = "5s",
            description = "Respond when the run has ended, or after this time: up to 60 seconds, for example `30s`."),
    ),
    responses((status = 200, description = "The run.", body = Run))
)]
pub(in crate::http) async fn get(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    mut params: Params,
) -> Result<Json<Run>, ApiError> {
    let wait = params.text("wait").as_deref().map(duration).transpose()?;
    params.deny_unknown()?;
    let id = run_id(&id)?;
    Ok(Json(match wait {
        Some(wait) => state.app.run_when_ended(id, wait).await?,
        None => state.app.run(id).await?,
    }))
}

/// Follow a run to its end
///
/// Server-sent events, from the run's beginning or resumed after `Last-Event-ID`; the stream ends with the run. Events other than
/// `live` are stored: `event` is a `RunEventKind`, `data` a `RunEventDocument` as JSON. `live` is the measured state, 10 to 50
/// times a second: `data` is a `RunSample`; the latest ones are replayed too, without `Last-Event-ID` those since the last change
/// of state, and a slow reader loses some. The event `reset` means that events after the given id are no longer stored: reload the
/// run. It is the only event if all events of an ended run were deleted for their age.
#[utoipa::path(
    get,
    path = "/runs/{id}/events",
    tag = "runs",
    operation_id = "follow_run",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the run."),
        ("Last-Event-ID" = Option<String>, Header, pattern = "^[0-9]{1,19}(\\.[0-9]{1,19})?$", description = "Id of the last event that the client saw."),
    ),
    responses(
        (status = 200, description = "The event stream.", content_type = "text/event-stream",
        body = inline(super::super::openapi::RunEventText)),
        (status = 204, description = "The run has ended and the client has seen all its events."),
    )
)]
pub(in crate::http) async fn events(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    client: Client,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    run_event_stream(&state, client, run_id(&id)?, &headers).await
}

/// Get the record of a run
///
/// Every completed step, as commanded and as measured, also while the run is under way. As a table with `Accept: text/csv`, or
/// from `/runs/{id}/record.csv`.
#[utoipa::path(
    get,
    path = "/runs/{id}/record",
    tag = "runs",
    operation_id = "get_run_record",
    params(("id" = uuid::Uuid, Path, description = "Id of the run.")),
    responses((status = 200, description = "The record; with `Accept: text/csv`, its table.", body = RunRecordDocument))
)]
pub(in crate::http) async fn record(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    let offered = [("json", "application/json"), ("csv", CSV)];
    let offered = offered.map(|(name, media_type)| Representation { name, media_type, file: "record".into() });
    let chosen = choose(&headers, None, &offered)?.name;
    let record = state.app.run_record(run_id(&id)?).await?;
    let mut response = if chosen == "csv" { csv(&record) } else { Json(record).into_response() };
    response.headers_mut().insert(VARY, axum::http::HeaderValue::from_static("accept"));
    Ok(response)
}

/// Get the record of a run as a table
#[utoipa::path(
    get,
    path = "/runs/{id}/record.csv",
    tag = "runs",
    operation_id = "get_run_record_csv",
    params(("id" = uuid::Uuid, Path, description = "Id of the run.")),
    responses((status = 200, description = "The steps of the record.", content_type = "text/csv", body = String))
)]
pub(in crate::http) async fn record_csv(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    Ok(csv(&state.app.run_record(run_id(&id)?).await?))
}

fn csv(record: &RunRecordDocument) -> Response {
    let name = format!("attachment; filename=\"run-{}.csv\"", record.run.id);
    ([(CONTENT_TYPE, CSV.to_owned()), (CONTENT_DISPOSITION, name)], record.to_csv()).into_response()
}

/// Get the audit log of a run
///
/// Every byte that was exchanged with the controllers, as text with one entry per line: its number, nanoseconds of a monotonic
/// clock since the log was opened, the device, `sent` or `received`, the bytes in hexadecimal, and the SHA-256 that chains the
/// line to the one before. Its size is bounded: the oldest part of a long log is missing. A simulated run exchanges no bytes.
#[utoipa::path(
    get,
    path = "/runs/{id}/audit",
    tag = "runs",
    operation_id = "get_run_audit",
    params(("id" = uuid::Uuid, Path, description = "Id of the run.")),
    responses((status = 200, description = "The log.", content_type = "text/plain", body = String))
)]
pub(in crate::http) async fn audit(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    let id = run_id(&id)?;
    let log = state.app.run_audit(id).await?.ok_or_else(|| {
        let detail = format!(
            "run {id} has no audit log: it ended before it connected to the controllers, or the log was deleted or left out of a backup"
        );
        ApiError::new(Code::ResultNotFound, detail)
    })?;
    let name = format!("attachment; filename=\"run-{id}.log\"");
    let body: Body = streamed(log, state.downloads.clone());
    Ok(([(CONTENT_TYPE, AUDIT_TEXT.to_owned()), (CONTENT_DISPOSITION, name)], body).into_response())
}

/// Delete an ended run with its record and its audit log
///
/// If the audit log cannot be removed, the run is deleted all the same, and the response, with status 500, says that the log
/// remains: sending the same request again removes it. Refused with 409 (`job_held`) while the run's job has the hold label.
#[utoipa::path(
    delete,
    path = "/runs/{id}",
    tag = "runs",
    operation_id = "delete_run",
    params(("id" = uuid::Uuid, Path, description = "Id of the run.")),
    responses((status = 204, description = "The run was deleted."))
)]
pub(in crate::http) async fn delete(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<StatusCode, ApiError> {
    params.deny_unknown()?;
    state.app.delete_run(run_id(&id)?).await?;
    Ok(StatusCode::NO_CONTENT)
}
