//! Scans: upload, list, read, download, delete.

use axum::extract::{Path, Request, State};
use axum::http::header::LOCATION;
use axum::http::{HeaderMap, HeaderName, StatusCode};
use axum::response::Response;

use super::uploads::{self, MAX_NAME_CHARS};
use super::{UploadedFile, job_id, uploaded};
use crate::geometry::LengthUnit;
use crate::http::extract::{Json, Params};
use crate::http::prefix::Prefix;
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::inspection::ingest::ScanFrame;
use crate::service::ScanUpload;
use crate::wire::ScanId;
use crate::wire::inspection::{Scan, ScanPage};
use crate::wire::words::counted;

/// Largest number of a viewpoint that an upload may state.
const MAX_VIEW: u32 = 99_999;

/// Parses the scan id in a path. A malformed id is answered like an unknown one.
fn scan_id(text: &str) -> Result<ScanId, ApiError> {
    text.parse().map_err(|_| ApiError::new(Code::ScanNotFound, format!("{text:?} is not the id of a scan")))
}

/// Upload a scan
///
/// The body is the file, with any `Content-Type`, or a multipart form with the file in the field `file`: PLY, PCD, E57, XYZ or
/// STL, of one view, or of all views together. It is read when the job is inspected. A unit or frame that is not given is
/// detected then.
#[utoipa::path(
    post,
    path = "/jobs/{id}/scans",
    tag = "inspections",
    operation_id = "upload_scan",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the job whose plan was scanned."),
        ("view" = Option<u32>, Query, minimum = 0, maximum = 99_999, example = 1, description = "Viewpoint of the plan from which the scan was taken. Default: the number in the name of the file; a file without a number contains all views together."),
        ("unit" = inline(Option<crate::wire::MeshUnit>), Query, example = "mm", description = "Unit of the coordinates."),
        ("frame" = Option<ScanFrame>, Query, example = "scanner", description = "Frame of the coordinates."),
        ("name" = Option<String>, Query, description = "Name of the file. Without it, the name that a multipart form gives.", example = "view_01.ply", min_length = 1, max_length = 200, pattern = r"^[^\x00-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]+$"),
        ("Content-Digest" = Option<String>, Header, example = json!(crate::wire::example::SCAN_DIGEST), pattern = "^sha-256=:[A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=:$", description = "`sha-256=:…:`, the SHA-256 of the body (RFC 9530); of a form, that of its file is accepted too. The upload is refused if the digest differs."),
    ),
    request_body(description = "The file.", content((inline(super::super::openapi::Bytes) = "application/octet-stream"))),
    responses(
        (status = 201, description = "The scan.", body = Scan, headers(("Location" = String, description = "Path of the scan."))),
    )
)]
pub(in crate::http) async fn upload(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    prefix: Prefix,
    mut params: Params,
    request: Request,
) -> Result<(StatusCode, [(HeaderName, String); 1], Json<Scan>), ApiError> {
    let job = job_id(&id)?;
    let view = params.whole_number("view", MAX_VIEW)?;
    let unit: Option<LengthUnit> = params.value("unit", &LengthUnit::ALL.map(LengthUnit::as_str).join(", "))?;
    let frame = params.value("frame", &ScanFrame::ALL.map(ScanFrame::as_str).join(", "))?;
    let name = params.name("name", MAX_NAME_CHARS)?;
    params.deny_unknown()?;
    let views = state.app.planned_views(job).await?;
    if let Some((view, views)) = view.zip(views).filter(|(view, views)| *view as usize >= *views) {
        return Err(ApiError::query(
            "view",
            &format!("is {view}; the plan has {}, numbered from 0", counted(views, "viewpoint")),
        ));
    }
    let (finished, file_name) = uploads::received(&state, request).await?;
    let about = ScanUpload { view, name: name.or(file_name), unit: unit.map(|unit| unit.as_str().to_owned()), frame };
    let scan = state.app.add_scan(job, finished, about).await?;
    Ok((StatusCode::CREATED, [(LOCATION, prefix.at(&format!("/api/v1/scans/{}", scan.id)))], Json(scan)))
}

/// List the scans of a job, oldest first
#[utoipa::path(
    get,
    path = "/jobs/{id}/scans",
    tag = "inspections",
    operation_id = "list_scans",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the job."),
        ("page_size" = Option<u32>, Query, description = "Largest number of entries on the page; 50 by default.", minimum = 1, maximum = 1000),
        ("page_token" = inline(Option<super::super::openapi::PageToken>), Query, description = "`next_page_token` of the previous page."),
    ),
    responses((status = 200, description = "A page of scans.", body = ScanPage))
)]
pub(in crate::http) async fn list(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    mut params: Params,
) -> Result<Json<ScanPage>, ApiError> {
    let (page_size, page_token) = params.page()?;
    params.deny_unknown()?;
    Ok(Json(state.app.scans(job_id(&id)?, page_size, page_token.as_deref()).await?))
}

/// Get a scan
#[utoipa::path(
    get,
    path = "/scans/{id}",
    tag = "inspections",
    operation_id = "get_scan",
    params(("id" = uuid::Uuid, Path, description = "Id of the scan.")),
    responses((status = 200, description = "The scan.", body = Scan))
)]
pub(in crate::http) async fn get(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<Json<Scan>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.scan(scan_id(&id)?).await?))
}

/// Download the file of a scan
///
/// `Range` gives a part of it (RFC 9110, section 14), so that a download can be resumed.
#[utoipa::path(
    get,
    path = "/scans/{id}/file",
    tag = "inspections",
    operation_id = "get_scan_file",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the scan."),
        ("Range" = Option<String>, Header, description = "One range of bytes, for example `bytes=0-99`."),
        ("If-Range" = Option<String>, Header, description = "Entity tag of the version that the range is for; if the file is another version, the whole of it is sent."),
    ),
    responses(
        (status = 200, description = "The file, byte for byte.", content_type = "application/octet-stream", body = inline(super::super::openapi::Bytes)),
        (status = 206, description = "The requested part of the file.", content_type = "application/octet-stream", body = inline(super::super::openapi::Bytes)),
        (status = 304, description = "The client has the current version."),
    )
)]
pub(in crate::http) async fn file(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    let scan = state.app.scan(scan_id(&id)?).await?;
    let name = scan.name.clone().unwrap_or_else(|| scan.id.to_string());
    let about = UploadedFile { sha256: &scan.sha256, size_bytes: scan.size_bytes, name: &name };
    uploaded(&state, &headers, &about, state.app.open_scan(&scan)).await
}

/// Delete a scan
///
/// Refused while an inspection of the scan's job has not ended, and with 409 (`job_held`) while the job has the hold label.
/// Results of inspections are kept.
#[utoipa::path(
    delete,
    path = "/scans/{id}",
    tag = "inspections",
    operation_id = "delete_scan",
    params(("id" = uuid::Uuid, Path, description = "Id of the scan.")),
    responses((status = 204, description = "The scan was deleted."))
)]
pub(in crate::http) async fn delete(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<StatusCode, ApiError> {
    params.deny_unknown()?;
    state.app.delete_scan(scan_id(&id)?).await?;
    Ok(StatusCode::NO_CONTENT)
}
