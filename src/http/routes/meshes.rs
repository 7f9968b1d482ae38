//! Meshes: upload, look, fetch, delete.

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
use crate::http::extract::{Pace, Params, broken, check_encoding, has_stalled, text, too_slow};
use crate::http::problem::{Code, Problem};
use crate::http::router::Site;
use crate::service::{FinishedUpload, MeshUpload, Upload};
use crate::wire::{Mesh, MeshPage};

const CONTENT_DIGEST: HeaderName = HeaderName::from_static("content-digest");

/// Upload a mesh
///
/// The body is the file, under any `Content-Type`; or a multipart form with the file as `file`. STL, OBJ and PLY are
/// recognised by their content. The same file with the same unit and name is the same mesh: uploading it again is
/// harmless and gives the same answer.
#[utoipa::path(
    post,
    path = "/meshes",
    tag = "meshes",
    operation_id = "upload_mesh",
    params(
        ("unit" = inline(super::super::openapi::Unit), Query, description = "Unit of the file's coordinates; none of the formats says it."),
        ("name" = Option<String>, Query, description = "Name for reports and lists.", min_length = 1, max_length = 200, pattern = r"^[^\x00-\x1f\x7f-\x9f]+$"),
        ("Content-Digest" = Option<String>, Header, example = "sha-256=:UlyIVPZkKMF2W79h/j+NOtwd0gzmxKMkNC3h9hDeLdI=:", pattern = "^sha-256=:[A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=:$", description = "`sha-256=:…:` (RFC 9530); the upload is refused when it is another."),
    ),
    request_body(description = "The file.", content((inline(super::super::openapi::Bytes) = "application/octet-stream"))),
    responses(
        (status = 201, description = "The mesh, with its health report.", body = Mesh,
            headers(("Location" = String, description = "Path of the mesh."))),
    )
)]
pub(in crate::http) async fn upload(
    State(site): State<Site>,
    mut params: Params,
    request: Request,
) -> Result<(StatusCode, [(HeaderName, String); 1], axum::Json<Mesh>), Problem> {
    let unit: LengthUnit = params.required("unit")?;
    let name = params.name("name", 200)?;
    params.end()?;
    check_encoding(request.headers())?;
    check_length(request.headers(), site.app.options().max_upload_bytes)?;
    let announced = announced_sha256(request.headers())?;
    let upload = site.app.receive(announced_length(request.headers())).await?;
    let finished = if is_multipart(request.headers()) {
        receive_form(upload, request, &site, announced.as_deref()).await?
    } else {
        receive_body(upload, request.into_body(), &site, announced.as_deref()).await?
    };
    let mesh = site.app.add_mesh(finished, MeshUpload { unit, name }).await?;
    Ok((StatusCode::CREATED, [(LOCATION, format!("/api/v1/meshes/{}", mesh.id))], axum::Json(mesh)))
}

/// The announced length of the body; 0 where it is not announced.
fn announced_length(headers: &HeaderMap) -> u64 {
    text(headers, &CONTENT_LENGTH).and_then(|value| value.parse().ok()).unwrap_or_default()
}

fn check_length(headers: &HeaderMap, limit: u64) -> Result<(), Problem> {
    match announced_length(headers) {
        bytes if bytes > limit => Err(Problem::new(Code::TooLarge, format!("the file has {bytes} bytes; allowed are {limit}"))),
        _ => Ok(()),
    }
}

/// The SHA-256 in `Content-Digest`, lower-case hexadecimal. Other algorithms in it are passed over.
fn announced_sha256(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(value) = headers.get(CONTENT_DIGEST) else { return Ok(None) };
    let refuse = || Problem::at(Code::BadDigest, "Content-Digest", "has to be sha-256=:BASE64: (RFC 9530)");
    let value = value.to_str().map_err(|_| refuse())?;
    let entry = value.split(',').find_map(|entry| entry.trim().strip_prefix("sha-256=")).ok_or_else(refuse)?;
    let encoded = entry.strip_prefix(':').and_then(|entry| entry.strip_suffix(':')).ok_or_else(refuse)?;
    let digest = BASE64_STANDARD.decode(encoded).ok().filter(|digest| digest.len() == 32).ok_or_else(refuse)?;
    Ok(Some(digest.iter().map(|byte| format!("{byte:02x}")).collect()))
}

fn is_multipart(headers: &HeaderMap) -> bool {
    text(headers, &CONTENT_TYPE).is_some_and(|value| value.to_ascii_lowercase().starts_with("multipart/form-data"))
}

async fn receive_body(mut upload: Upload, body: Body, site: &Site, announced: Option<&str>) -> Result<FinishedUpload, Problem> {
    let (mut pieces, mut pace) = (body.into_data_stream(), Pace::new(site.options.body_idle_timeout));
    while let Some(piece) = pieces.next().await {
        let piece = piece.map_err(|error| broken(&error))?;
        pace.count(piece.len())?;
        upload.write(piece).await?;
    }
    Ok(upload.finish(announced).await?)
}

async fn receive_form(
    mut upload: Upload,
    request: Request,
    site: &Site,
    announced: Option<&str>,
) -> Result<FinishedUpload, Problem> {
    let mut pace = Pace::new(site.options.body_idle_timeout);
    let mut form = Multipart::from_request(request, site).await.map_err(|e| Problem::new(Code::BadBody, e.body_text()))?;
    while let Some(mut field) = form.next_field().await.map_err(|error| broken_form(&error))? {
        if field.name() == Some("file") {
            while let Some(piece) = field.chunk().await.map_err(|error| broken_form(&error))? {
                pace.count(piece.len())?;
                upload.write(piece).await?;
            }
            return Ok(upload.finish(announced).await?);
        }
    }
    Err(Problem::at(Code::BadBody, "file", "the form has no field of this name"))
}

fn broken_form(error: &MultipartError) -> Problem {
    if has_stalled(error) { too_slow() } else { Problem::new(Code::BadBody, error.body_text()) }
}

/// List meshes, newest first
#[utoipa::path(
    get,
    path = "/meshes",
    tag = "meshes",
    operation_id = "list_meshes",
    params(
        ("page_size" = Option<u32>, Query, description = "Entries of a page.", minimum = 1, maximum = 1000),
        ("page_token" = inline(Option<super::super::openapi::PageToken>), Query, description = "`next_page_token` of the page before."),
    ),
    responses((status = 200, description = "A page of meshes.", body = MeshPage))
)]
pub(in crate::http) async fn list(State(site): State<Site>, mut params: Params) -> Result<axum::Json<MeshPage>, Problem> {
    let (page_size, page_token) = params.page()?;
    params.end()?;
    Ok(axum::Json(site.app.meshes(page_size, page_token.as_deref()).await?))
}

/// Look at a mesh
#[utoipa::path(
    get,
    path = "/meshes/{id}",
    tag = "meshes",
    operation_id = "get_mesh",
    params(("id" = uuid::Uuid, Path, description = "Id of the mesh.")),
    responses((status = 200, description = "The mesh, with its health report.", body = Mesh))
)]
pub(in crate::http) async fn get(
    State(site): State<Site>,
    Path(id): Path<String>,
    params: Params,
) -> Result<axum::Json<Mesh>, Problem> {
    params.end()?;
    Ok(axum::Json(site.app.mesh(mesh_id(&id)?).await?))
}

/// Delete a mesh
///
/// Refused while a job that has not ended needs it. Results of ended jobs stay.
#[utoipa::path(
    delete,
    path = "/meshes/{id}",
    tag = "meshes",
    operation_id = "delete_mesh",
    params(("id" = uuid::Uuid, Path, description = "Id of the mesh.")),
    responses((status = 204, description = "It is gone."))
)]
pub(in crate::http) async fn delete(
    State(site): State<Site>,
    Path(id): Path<String>,
    params: Params,
) -> Result<StatusCode, Problem> {
    params.end()?;
    site.app.delete_mesh(mesh_id(&id)?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Fetch the uploaded file
#[utoipa::path(
    get,
    path = "/meshes/{id}/file",
    tag = "meshes",
    operation_id = "get_mesh_file",
    params(("id" = uuid::Uuid, Path, description = "Id of the mesh.")),
    responses(
        (status = 200, description = "The file, byte for byte.", content_type = "application/octet-stream", body = inline(super::super::openapi::Bytes)),
        (status = 304, description = "The client has it."),
    )
)]
pub(in crate::http) async fn file(
    State(site): State<Site>,
    Path(id): Path<String>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, Problem> {
    params.end()?;
    let mesh = site.app.mesh(mesh_id(&id)?).await?;
    if let Some(response) = not_modified(&headers, &mesh.sha256) {
        return Ok(response);
    }
    let body = streamed(Box::new(site.app.open_mesh(&mesh).await?));
    // A file that somebody uploaded must never be shown as a page of ours.
    let attachment = HeaderValue::from_static("attachment");
    let length = HeaderValue::from(mesh.size_bytes);
    let about = [(CONTENT_DISPOSITION, attachment), (CONTENT_LENGTH, length)];
    Ok((immutable(&mesh.sha256, "application/octet-stream"), about, body).into_response())
}

/// Fetch a thinned mesh for viewers
///
/// Binary glTF in millimetres, part frame; at most 300 000 triangles.
#[utoipa::path(
    get,
    path = "/meshes/{id}/preview.glb",
    tag = "meshes",
    operation_id = "get_mesh_preview",
    params(("id" = uuid::Uuid, Path, description = "Id of the mesh.")),
    responses(
        (status = 200, description = "The preview.", content_type = "model/gltf-binary", body = inline(super::super::openapi::Bytes)),
        (status = 304, description = "The client has it."),
    )
)]
pub(in crate::http) async fn preview(
    State(site): State<Site>,
    Path(id): Path<String>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, Problem> {
    params.end()?;
    let (sha256, bytes) = site.app.preview(mesh_id(&id)?).await?;
    if let Some(response) = not_modified(&headers, &sha256) {
        return Ok(response);
    }
    Ok((immutable(&sha256, "model/gltf-binary"), bytes).into_response())
}
