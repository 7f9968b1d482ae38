//! Meshes: upload, list, read, download, delete.

use axum::extract::{Path, Request, State};
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_RANGE, LOCATION, VARY};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};

use super::uploads::{self, MAX_NAME_CHARS};
use super::{UploadedFile, immutable, mesh_id, not_modified, uploaded};
use crate::geometry::LengthUnit;
use crate::http::download::{AskedPart, Disposition, asked_part, beyond_end, content_disposition, content_range};
use crate::http::extract::{Json, Params};
use crate::http::negotiate::{Representation, choose};
use crate::http::prefix::Prefix;
use crate::http::problem::ApiError;
use crate::http::router::ApiState;
use crate::service::MeshUpload;
use crate::wire::{MeshPage, UploadedMesh};

const BYTES: &str = "application/octet-stream";

/// Media types of the preview; the second is for clients that know no type of models.
static PREVIEW: [Representation; 2] = [
    Representation { name: "glb", media_type: "model/gltf-binary", file: std::borrow::Cow::Borrowed("preview.glb") },
    Representation { name: "bytes", media_type: BYTES, file: std::borrow::Cow::Borrowed("preview.glb") },
];

/// Upload a mesh
///
/// The body is the file, with any `Content-Type`, or a multipart form with the file in the field `file`. STL, OBJ and PLY are
/// recognised by content. Uploading the same file with the same unit and name again returns the same mesh, with the time of the
/// last upload as `created_at`. The file of the example always gets the id that other examples use.
#[utoipa::path(
    post,
    path = "/meshes",
    tag = "meshes",
    operation_id = "upload_mesh",
    params(
        ("unit" = inline(crate::wire::MeshUnit), Query, example = "mm", description = "Unit of the file's coordinates, which mesh files do not state."),
        ("name" = Option<String>, Query, description = "Name shown in reports and lists. Without it, the file name that a multipart form gives.", example = "tetrahedron", min_length = 1, max_length = 200, pattern = r"^[^\x00-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]+$"),
        ("Content-Digest" = Option<String>, Header, example = json!(crate::wire::example::MESH_DIGEST), pattern = "^sha-256=:[A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=:$", description = "`sha-256=:…:`, the SHA-256 of the body (RFC 9530); of a form, that of its file is accepted too. The upload is refused if the digest differs."),
    ),
    request_body(description = "The mesh file.", content((inline(super::super::openapi::Bytes) = "application/octet-stream"))),
    responses(
        (status = 201, description = "The mesh, with its health report.", body = UploadedMesh,
            headers(("Location" = String, description = "Path of the mesh."))),
    )
)]
pub(in crate::http) async fn upload(
    State(state): State<ApiState>,
    prefix: Prefix,
    mut params: Params,
    request: Request,
) -> Result<(StatusCode, [(HeaderName, String); 1], Json<UploadedMesh>), ApiError> {
    let unit: LengthUnit = params.required("unit", &LengthUnit::ALL.map(LengthUnit::as_str).join(", "))?;
    let name = params.name("name", MAX_NAME_CHARS)?;
    params.deny_unknown()?;
    let (finished, file_name) = uploads::received(&state, request).await?;
    let name = name.or(file_name);
    let mesh = state.app.add_mesh(finished, MeshUpload { unit, name }).await?;
    Ok((StatusCode::CREATED, [(LOCATION, prefix.at(&format!("/api/v1/meshes/{}", mesh.id)))], Json(mesh)))
}

/// List meshes, newest first
///
/// Sorted by their first upload: uploading a mesh again changes its `created_at` but not its place.
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
pub(in crate::http) async fn list(State(state): State<ApiState>, mut params: Params) -> Result<Json<MeshPage>, ApiError> {
    let (page_size, page_token) = params.page()?;
    params.deny_unknown()?;
    Ok(Json(state.app.meshes(page_size, page_token.as_deref()).await?))
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
) -> Result<Json<UploadedMesh>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.mesh(mesh_id(&id)?).await?))
}

/// Delete a mesh
///
/// Refused while a job that has not ended needs the mesh, or a stored specification names it. Ended jobs keep their results, and
/// the mesh file for inspections, further views and runs.
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
///
/// `Range` gives a part of it (RFC 9110, section 14), so that a download can be resumed.
#[utoipa::path(
    get,
    path = "/meshes/{id}/file",
    tag = "meshes",
    operation_id = "get_mesh_file",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the mesh."),
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
    let mesh = state.app.mesh(mesh_id(&id)?).await?;
    let about = UploadedFile { sha256: &mesh.sha256, size_bytes: mesh.size_bytes, name: &file_name(&mesh) };
    uploaded(&state, &headers, &about, state.app.open_mesh(&mesh)).await
}

/// Name of a mesh's file: that of the mesh, else its id, with the extension of its format.
fn file_name(mesh: &UploadedMesh) -> String {
    let name = mesh.name.clone().unwrap_or_else(|| mesh.id.to_string());
    let extension = mesh.health.format.split('_').next().unwrap_or_default();
    let has_it = name.rsplit_once('.').is_some_and(|(_, own)| own.eq_ignore_ascii_case(extension));
    if has_it || extension.is_empty() { name } else { format!("{name}.{extension}") }
}

/// Download a simplified mesh for viewers
///
/// Binary glTF in millimetres, in the part frame, with at most 300 000 triangles. `Range` gives a part of it.
#[utoipa::path(
    get,
    path = "/meshes/{id}/preview.glb",
    tag = "meshes",
    operation_id = "get_mesh_preview",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the mesh."),
        ("Range" = Option<String>, Header, description = "One range of bytes, for example `bytes=0-99`."),
        ("If-Range" = Option<String>, Header, description = "Entity tag of the version that the range is for; if the file is another version, the whole of it is sent."),
    ),
    responses(
        (status = 200, description = "The preview, as binary glTF.", content(
            (inline(super::super::openapi::Bytes) = "model/gltf-binary"),
            (inline(super::super::openapi::Bytes) = "application/octet-stream"),
        )),
        (status = 206, description = "The requested part of the preview.", content(
            (inline(super::super::openapi::Bytes) = "model/gltf-binary"),
            (inline(super::super::openapi::Bytes) = "application/octet-stream"),
        )),
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
    let id = mesh_id(&id)?;
    let mesh = state.app.mesh(id).await?;
    let form = choose(&headers, None, &PREVIEW)?;
    let (sha256, bytes) = state.app.preview(id).await?;
    let vary = [(VARY, HeaderValue::from_static("accept"))];
    if let Some(response) = not_modified(&headers, &sha256)? {
        return Ok((vary, response).into_response());
    }
    let length = bytes.len() as u64;
    let name = format!("{}_preview.glb", mesh.name.unwrap_or_else(|| mesh.id.to_string()));
    let inline = content_disposition(Disposition::Inline, &name);
    let common = (immutable(&sha256, form.media_type), vary, [(CONTENT_DISPOSITION, inline)]);
    match asked_part(&headers, &format!("\"{sha256}\""), length) {
        AskedPart::Whole => Ok((common, bytes).into_response()),
        AskedPart::BeyondEnd => Ok(beyond_end(length)),
        AskedPart::Bytes(part) => {
            let range = [(CONTENT_RANGE, content_range(&part, length))];
            // A part of what is in memory.
            let bytes = bytes[part.start as usize..part.end as usize].to_vec();
            Ok((StatusCode::PARTIAL_CONTENT, common, range, bytes).into_response())
        }
    }
}
