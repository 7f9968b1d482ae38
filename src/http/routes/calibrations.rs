//! Calibrations: submit, read, wait, list, cancel, delete; their results as a document, a cell and a report.

use axum::extract::{Path, State};
use axum::http::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE, LOCATION, RETRY_AFTER};
use axum::http::{HeaderName, StatusCode};
use axum::response::{IntoResponse, Response};

use super::jobs::{duration, refer};
use super::results::REPORT_POLICY;
use crate::cell::CellSpec;
use crate::http::extract::{Json, Params};
use crate::http::prefix::Prefix;
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::service::Submission;
use crate::wire::CalibrationId;
use crate::wire::calibration::{
    CalibrationDocument, CalibrationJob, CalibrationPage, CalibrationRequest, CalibrationSelection, CalibrationState,
};

/// Polling interval that responses suggest, seconds.
const POLL_AFTER_SECS: &str = "1";
/// Media type of a report.
const HTML: &str = "text/html; charset=utf-8";

/// Parses the calibration id in a path. A malformed id is answered like an unknown one.
fn calibration_id(text: &str) -> Result<CalibrationId, ApiError> {
    text.parse().map_err(|_| ApiError::new(Code::CalibrationNotFound, format!("{text:?} is not the id of a calibration")))
}

/// Calibrate a cell
///
/// Solves for the pose of the scanner on the flange, the axis of the table and the pose of the board from observations of a
/// board. Names the observations that do not fit, and states how accurate the result is. Calibrations are computed one after
/// another and take seconds at most. To use the result, send the cell of `GET /calibrations/{id}/cell` to `PUT /cells/{name}`.
#[utoipa::path(
    post,
    path = "/calibrations",
    tag = "calibrations",
    operation_id = "create_calibration",
    params(("Idempotency-Key" = Option<String>, Header, pattern = "^[ \\t]*[\\x21-\\x7e]{1,255}[ \\t]*$",
        description = "Within 24 hours, the same key with the same request gives the same response and starts no second calibration. \
                       Surrounding white space is ignored (RFC 9110, section 5.5).")),
    request_body = CalibrationRequest,
    responses(
        (status = 202, description = "The calibration was accepted.", body = CalibrationJob,
            headers(("Location" = String, description = "Path of the calibration."),
                    ("Retry-After" = String, description = "Seconds to wait before polling the calibration."))),
    )
)]
pub(in crate::http) async fn create(
    State(state): State<ApiState>,
    submission: Submission,
    prefix: Prefix,
    params: Params,
    Json(request): Json<CalibrationRequest>,
) -> Result<(StatusCode, [(HeaderName, String); 2], Json<CalibrationJob>), ApiError> {
    params.deny_unknown()?;
    let job = state.app.submit_calibration(request, submission).await?;
    let location = prefix.at(&format!("/api/v1/calibrations/{}", job.id));
    Ok((StatusCode::ACCEPTED, [(LOCATION, location), (RETRY_AFTER, POLL_AFTER_SECS.to_owned())], Json(job)))
}

/// List calibrations
///
/// Newest first. Only items that match all given filters are listed.
#[utoipa::path(
    get,
    path = "/calibrations",
    tag = "calibrations",
    operation_id = "list_calibrations",
    params(
        ("state" = Option<CalibrationState>, Query, description = "Only calibrations in this state."),
        ("cell" = Option<String>, Query, example = "e05-transcan", description = "Only calibrations of the cell with this name."),
        ("page_size" = Option<u32>, Query, description = "Largest number of entries on the page; 50 by default.", minimum = 1, maximum = 1000),
        ("page_token" = inline(Option<super::super::openapi::PageToken>), Query, description = "`next_page_token` of the previous page; filters must be the same."),
    ),
    responses((status = 200, description = "A page of calibrations.", body = CalibrationPage))
)]
pub(in crate::http) async fn list(
    State(state): State<ApiState>,
    prefix: Prefix,
    mut params: Params,
) -> Result<Json<CalibrationPage>, ApiError> {
    let states = format!("one of {}", CalibrationState::ALL.map(CalibrationState::as_str).join(", "));
    let selection = CalibrationSelection { state: params.value("state", &states)?, cell: params.text("cell") };
    let (page_size, page_token) = params.page()?;
    params.deny_unknown()?;
    let mut page = state.app.calibrations(&selection, page_size, page_token.as_deref()).await?;
    page.items.iter_mut().for_each(|calibration| refer(&mut calibration.problem, &prefix));
    Ok(Json(page))
}

/// Get a calibration, or wait for its end
#[utoipa::path(
    get,
    path = "/calibrations/{id}",
    tag = "calibrations",
    operation_id = "get_calibration",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the calibration."),
        ("wait" = Option<String>, Query, pattern = "^([0-9]|[1-5][0-9]|60)s?$", example = "5s",
            description = "Respond when the calibration has ended, or after this time: up to 60 seconds, for example `30s`."),
    ),
    responses((status = 200, description = "The calibration.", body = CalibrationJob))
)]
pub(in crate::http) async fn get(
    State(state): State<ApiState>,
    prefix: Prefix,
    Path(id): Path<String>,
    mut params: Params,
) -> Result<Json<CalibrationJob>, ApiError> {
    let wait = params.text("wait").as_deref().map(duration).transpose()?;
    params.deny_unknown()?;
    let id = calibration_id(&id)?;
    let mut calibration = match wait {
        Some(wait) => state.app.calibration_when_ended(id, wait).await?,
        None => state.app.calibration(id).await?,
    };
    refer(&mut calibration.problem, &prefix);
    Ok(Json(calibration))
}

/// Cancel a calibration
///
/// A queued calibration is cancelled at once, a running one at the end of its stage, within seconds. One that has ended never
/// changes.
#[utoipa::path(
    post,
    path = "/calibrations/{id}/cancel",
    tag = "calibrations",
    operation_id = "cancel_calibration",
    params(("id" = uuid::Uuid, Path, description = "Id of the calibration.")),
    responses((status = 200, description = "The cancelled calibration.", body = CalibrationJob))
)]
pub(in crate::http) async fn cancel(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<Json<CalibrationJob>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.cancel_calibration(calibration_id(&id)?).await?))
}

/// Delete an ended calibration
#[utoipa::path(
    delete,
    path = "/calibrations/{id}",
    tag = "calibrations",
    operation_id = "delete_calibration",
    params(("id" = uuid::Uuid, Path, description = "Id of the calibration.")),
    responses((status = 204, description = "The calibration was deleted."))
)]
pub(in crate::http) async fn delete(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<StatusCode, ApiError> {
    params.deny_unknown()?;
    state.app.delete_calibration(calibration_id(&id)?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Get the result of a calibration
///
/// Poses, covariances, the residual of every observation, and findings about the observations. It never changes.
#[utoipa::path(
    get,
    path = "/calibrations/{id}/result",
    tag = "calibrations",
    operation_id = "get_calibration_result",
    params(("id" = uuid::Uuid, Path, description = "Id of the calibration.")),
    responses((status = 200, description = "The result.", body = CalibrationDocument))
)]
pub(in crate::http) async fn result(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<Json<CalibrationDocument>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.calibration_result(calibration_id(&id)?).await?))
}

/// Get the calibrated cell
///
/// The observed cell with the calibrated poses and their provenance, for `PUT /cells/{name}`. A preset cannot be replaced, so the
/// name of a preset gets the suffix `-calibrated`.
#[utoipa::path(
    get,
    path = "/calibrations/{id}/cell",
    tag = "calibrations",
    operation_id = "get_calibrated_cell",
    params(("id" = uuid::Uuid, Path, description = "Id of the calibration.")),
    responses((status = 200, description = "The cell.", body = CellSpec))
)]
pub(in crate::http) async fn cell(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<Json<CellSpec>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.calibrated_cell(calibration_id(&id)?).await?))
}

/// Get the report of a calibration
///
/// HTML page with the residuals, error ellipses and every observation.
#[utoipa::path(
    get,
    path = "/calibrations/{id}/report",
    tag = "calibrations",
    operation_id = "get_calibration_report",
    params(("id" = uuid::Uuid, Path, description = "Id of the calibration.")),
    responses((status = 200, description = "The report.", content_type = "text/html", body = String))
)]
pub(in crate::http) async fn report(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    let page = state.app.calibration_report(calibration_id(&id)?).await?;
    let mut response = ([(CONTENT_TYPE, HTML)], page).into_response();
    response.headers_mut().insert(CONTENT_SECURITY_POLICY, REPORT_POLICY);
    Ok(response)
}
