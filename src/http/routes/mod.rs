//! One file a resource: read the request, ask the service, write the answer.

pub(super) mod events;
pub(super) mod jobs;
pub(super) mod meshes;
pub(super) mod results;
mod specs;
pub(super) mod system;

pub(super) use specs::{cells, robots, scanners, turntables};

use axum::body::Body;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, ETAG};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};

use super::extract::is_known;
use super::problem::{Code, Problem};
use crate::wire::{JobId, MeshId};

/// The id in a path. What is no id names nothing.
fn mesh_id(text: &str) -> Result<MeshId, Problem> {
    text.parse().map_err(|_| Problem::new(Code::MeshNotFound, format!("{text:?} is not the id of a mesh")))
}

/// The id in a path. What is no id names nothing.
fn job_id(text: &str) -> Result<JobId, Problem> {
    text.parse().map_err(|_| Problem::new(Code::JobNotFound, format!("{text:?} is not the id of a job")))
}

/// Headers of what never changes: its tag is the hash of its bytes.
fn immutable(sha256: &str, media_type: &'static str) -> [(axum::http::HeaderName, HeaderValue); 3] {
    // Hexadecimal digits are a proper header value.
    let etag = HeaderValue::from_str(&format!("\"{sha256}\"")).unwrap_or(HeaderValue::from_static("\"\""));
    let lasting = HeaderValue::from_static("private, max-age=31536000, immutable");
    [(ETAG, etag), (CACHE_CONTROL, lasting), (CONTENT_TYPE, HeaderValue::from_static(media_type))]
}

/// The answer to a client that has the newest version, if it has.
fn not_modified(headers: &HeaderMap, sha256: &str) -> Option<Response> {
    let etag = format!("\"{sha256}\"");
    is_known(headers, &etag).then(|| (StatusCode::NOT_MODIFIED, [(ETAG, etag)], Body::empty()).into_response())
}
