//! One file a resource: read the request, ask the service, write the answer.

pub(super) mod events;
pub(super) mod jobs;
pub(super) mod meshes;
pub(super) mod results;
pub(super) mod session;
mod specs;
pub(super) mod storage;
pub(super) mod system;

pub(super) use specs::{cells, robots, scanners, turntables};

use std::io::{self, Read};

use axum::body::{Body, Bytes};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, ETAG};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};

use futures_util::stream;

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

/// Bytes of a file that are read at a time, on a thread that may block.
const PIECE_BYTES: usize = 256 * 1024;

/// A body that is read while it is sent: it takes one piece of memory, and no thread while the client is slow.
fn streamed(reader: Box<dyn Read + Send>) -> Body {
    Body::from_stream(stream::try_unfold(reader, |reader| async move {
        let (piece, reader) = tokio::task::spawn_blocking(move || next_piece(reader)).await.map_err(io::Error::other)??;
        Ok::<_, io::Error>((!piece.is_empty()).then_some((piece, reader)))
    }))
}

fn next_piece(mut reader: Box<dyn Read + Send>) -> io::Result<(Bytes, Box<dyn Read + Send>)> {
    let mut piece = Vec::with_capacity(PIECE_BYTES);
    reader.by_ref().take(PIECE_BYTES as u64).read_to_end(&mut piece)?;
    Ok((piece.into(), reader))
}
