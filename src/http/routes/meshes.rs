//! Meshes: upload, list, read, download, delete.

use axum::body::Body;
use axum::extract::multipart::MultipartError;
use axum::extract::{FromRequest, Multipart, Path, Request, State};
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_TYPE, LOCATION};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use futures_util::StreamExt;

use super::{immutable, mesh_id, not_modified, streamed};
use crate::geometry::LengthUnit;
use crate::http::extract::{Params, UploadRate, body_error, check_encoding, header_text, is_timeout, request_timeout};
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::service::{FinishedUpload, MeshUpload, Upload};
use crate::wire::{MeshPage, UploadedMesh};

const CONTENT_DIGEST: HeaderName = HeaderName::from_static("content-digest");

/// Upload a mesh
///
/// The body is the file, with any `Content-Type`, or a multipart form with the file in the field `file`. STL, OBJ and PLY
/// are recognised by content. The same file with the same unit and name is the same mesh: uploading it again has no
/// effect and gives the same response.
#[utoipa::path(
    post,
    path = "/meshes",
    tag = "meshes",
    operation_id = "upload_mesh",
    params(
        ("unit" = inline(crate::wire::MeshUnit), Query, description = "Unit of the file's coordinates, which mesh files do not state."),
        ("name" = Option<String>, Query, description = "Name shown in reports and lists.", min_length = 1, max_length = 200, pattern = r"^[^\x00-\x1f\x7f-\x9f]+$"),
        ("Content-Digest" = Option<String>, Header, example = "sha-256=:UlyIVPZkKMF2W79h/j+NOtwd0gzmxKMkNC3h9hDeLdI=:", pattern = "^sha-256=:[A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=:$", description = "`sha-256=:…:` (RFC 9530); the upload is refused if its digest differs."),
    ),
    request_body(description = "The mesh file.", content((inline(super::super::openapi::Bytes) = "application/octet-stream"))),
    responses(
        (status = 201, description = "The mesh, with its health report.", body = UploadedMesh,
            headers(("Location" = String, description = "Path of the mesh."))),
    )
)]
pub(in crate::http) async fn upload(
    State(state): State<ApiState>,
    mut params: Params,
    request: Request,
) -> Result<(StatusCode, [(HeaderName, String); 1], axum::Json<UploadedMesh>), ApiError> {
    let unit: LengthUnit = params.required("unit")?;
    let name = params.name("name", 200)?;
    params.deny_unknown()?;
    check_encoding(request.headers())?;
    check_length(request.headers(), state.app.options().max_upload_bytes)?;
    let announced = announced_sha256(request.headers())?;
    let upload = state.app.receive(announced_length(request.headers())).await?;
    let finished = if is_multipart(request.headers()) {
        receive_form(upload, request, &state, announced.as_deref()).await?
    } else {
        receive_body(upload, request.into_body(), &state, announced.as_deref()).await?
    };
    let mesh = state.app.add_mesh(finished, MeshUpload { unit, name }).await?;
    Ok((StatusCode::CREATED, [(LOCATION, format!("/api/v1/meshes/{}", mesh.id))], axum::Json(mesh)))
}

/// The `Content-Length` of the body; 0 if there is none.
fn announced_length(headers: &HeaderMap) -> u64 {
    header_text(headers, &CONTENT_LENGTH).and_then(|value| value.parse().ok()).unwrap_or_default()
}

fn check_length(headers: &HeaderMap, limit: u64) -> Result<(), ApiError> {
    match announced_length(headers) {
        bytes if bytes > limit => {
            Err(ApiError::new(Code::TooLarge, format!("the file has {bytes} bytes; the maximum is {limit}")))
        }
        _ => Ok(()),
    }
}

/// The SHA-256 in `Content-Digest`, lower-case hexadecimal. Digests of other algorithms are ignored.
fn announced_sha256(headers: &HeaderMap) -> Result<Option<String>, ApiError> {
    let Some(value) = headers.get(CONTENT_DIGEST) else { return Ok(None) };
    let refuse = || ApiError::at(Code::BadDigest, "Content-Digest", "must be sha-256=:BASE64: (RFC 9530)");
    let value = value.to_str().map_err(|_| refuse())?;
    let entry = value.split(',').find_map(|entry| entry.trim().strip_prefix("sha-256=")).ok_or_else(refuse)?;
    let encoded = entry.strip_prefix(':').and_then(|entry| entry.strip_suffix(':')).ok_or_else(refuse)?;
    let digest = BASE64_STANDARD.decode(encoded).ok().filter(|digest| digest.len() == 32).ok_or_else(refuse)?;
    Ok(Some(digest.iter().map(|byte| format!("{byte:02x}")).collect()))
}

fn is_multipart(headers: &HeaderMap) -> bool {
    header_text(headers, &CONTENT_TYPE).is_some_and(|value| value.to_ascii_lowercase().starts_with("multipart/form-data"))
}

async fn receive_body(
    mut upload: Upload,
    body: Body,
    state: &ApiState,
    announced: Option<&str>,
) -> Result<FinishedUpload, ApiError> {
    let (mut chunks, mut rate) = (body.into_data_stream(), UploadRate::new(state.options.body_idle_timeout));
    while let Some(chunk) = chunks.next().await {
        let chunk = chunk.map_err(|error| body_error(&error))?;
        rate.count(chunk.len())?;
        upload.write(chunk).await?;
    }
    Ok(upload.finish(announced).await?)
}

async fn receive_form(
    mut upload: Upload,
    request: Request,
    state: &ApiState,
    announced: Option<&str>,
) -> Result<FinishedUpload, ApiError> {
    let mut rate = UploadRate::new(state.options.body_idle_timeout);
    let mut form = Multipart::from_request(request, state).await.map_err(|e| ApiError::new(Code::BadBody, e.body_text()))?;
    while let Some(mut field) = form.next_field().await.map_err(|error| form_error(&error))? {
        if field.name() == Some("file") {
            while let Some(chunk) = field.chunk().await.map_err(|error| form_error(&error))? {
                rate.count(chunk.len())?;
                upload.write(chunk).await?;
            }
            return Ok(upload.finish(announced).await?);
        }
    }
    Err(ApiError::at(Code::BadBody, "file", "the form has no field of this name"))
}

fn form_error(error: &MultipartError) -> ApiError {
    if is_timeout(error) { request_timeout() } else { ApiError::new(Code::BadBody, error.body_text()) }
}

/// List meshes, newest first
#[utoipa::path(
    get,
    path = "/meshes",
    tag = "meshes",
    operation_id = "list_meshes",
    params(
        ("page_size" = Option<u32>, Query, description = "Largest number of entries on the page; 50 by default.", minimum = 1, maximum = 1000),
        ("page_token" = inline(Option<super::super::openapi::PageToken>), Query, description = "`next_page_token` of the previous page."),
    ),
    responses((status = 200, description = "A page of meshes.", body = MeshPage))
)]
pub(in crate::http) async fn list(State(state): State<ApiState>, mut params: Params) -> Result<axum::Json<MeshPage>, ApiError> {
    let (page_size, page_token) = params.page()?;
    params.deny_unknown()?;
    Ok(axum::Json(state.app.meshes(page_size, page_token.as_deref()).await?))
}

/// Get a mesh
#[utoipa::path(
    get,
    path = "/meshes/{id}",
    tag = "meshes",
    operation_id = "get_mesh",
    params(("id" = uuid::Uuid, Path, description = "Id of the mesh.")),
    responses((status = 200, description = "The mesh, with its health report.", body = UploadedMesh))
)]
pub(in crate::http) async fn get(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<axum::Json<UploadedMesh>, ApiError> {
    params.deny_unknown()?;
    Ok(axum::Json(state.app.mesh(mesh_id(&id)?).await?))
}

/// Delete a mesh
///
/// Refused while a job that has not ended needs the mesh. Results of ended jobs are kept.
#[utoipa::path(
    delete,
    path = "/meshes/{id}",
    tag = "meshes",
    operation_id = "delete_mesh",
    params(("id" = uuid::Uuid, Path, description = "Id of the mesh.")),
    responses((status = 204, description = "The mesh was deleted."))
)]
pub(in crate::http) async fn delete(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<StatusCode, ApiError> {
    params.deny_unknown()?;
    state.app.delete_mesh(mesh_id(&id)?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Download the uploaded file
#[utoipa::path(
    get,
    path = "/meshes/{id}/file",
    tag = "meshes",
    operation_id = "get_mesh_file",
    params(("id" = uuid::Uuid, Path, description = "Id of the mesh.")),
    responses(
        (status = 200, description = "The file, byte for byte.", content_type = "application/octet-stream", body = inline(super::super::openapi::Bytes)),
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
    let mesh = state.app.mesh(mesh_id(&id)?).await?;
    if let Some(response) = not_modified(&headers, &mesh.sha256) {
        return Ok(response);
    }
    let body = streamed(Box::new(state.app.open_mesh(&mesh).await?), state.downloads.clone());
    // A browser must never show an uploaded file as a page of ours.
    let attachment = HeaderValue::from_static("attachment");
    let length = HeaderValue::from(mesh.size_bytes);
    let extra = [(CONTENT_DISPOSITION, attachment), (CONTENT_LENGTH, length)];
    Ok((immutable(&mesh.sha256, "application/octet-stream"), extra, body).into_response())
}

/// Download a simplified mesh for viewers
///
/// Binary glTF in millimetres, in the part frame, with at most 300 000 triangles.
#[utoipa::path(
    get,
    path = "/meshes/{id}/preview.glb",
    tag = "meshes",
    operation_id = "get_mesh_preview",
    params(("id" = uuid::Uuid, Path, description = "Id of the mesh.")),
    responses(
        (status = 200, description = "The preview, as binary glTF.", content_type = "model/gltf-binary", body = inline(super::super::openapi::Bytes)),
        (status = 304, description = "The client has the current version."),
    )
)]
pub(in crate::http) async fn preview(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    let (sha256, bytes) = state.app.preview(mesh_id(&id)?).await?;
    if let Some(response) = not_modified(&headers, &sha256) {
        return Ok(response);
    }
    Ok((immutable(&sha256, "model/gltf-binary"), bytes).into_response())
}
