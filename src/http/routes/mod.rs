//! Handlers, one file per resource: read the request, call the service, write the response.

pub(super) mod calibrations;
pub(super) mod checks;
pub(super) mod events;
pub(super) mod inspections;
pub(super) mod jobs;
pub(super) mod leases;
pub(super) mod meshes;
pub(super) mod results;
pub(super) mod run_commands;
pub(super) mod runs;
pub(super) mod scans;
pub(super) mod session;
mod specs;
pub(super) mod storage;
pub(super) mod system;
mod uploads;

pub(super) use specs::{cells, robots, scanners, turntables};

use std::fs::File;
use std::io::{self, Read, Seek as _, SeekFrom};
use std::sync::Arc;

use axum::body::{Body, Bytes};
use axum::http::header::{ACCEPT_RANGES, CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_TYPE, ETAG};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};

use futures_util::stream;

use super::download::{AskedPart, Disposition, PartReader, asked_part, beyond_end, content_disposition, content_range};
use super::extract::{check_if_match, etag_matches};
use super::pacer::Pacer;
use super::problem::{ApiError, Code};
use super::router::ApiState;
use crate::service::Error;
use crate::wire::{JobId, MeshId};

/// Parses the mesh id in a path. A malformed id is answered like an unknown one.
fn mesh_id(text: &str) -> Result<MeshId, ApiError> {
    text.parse().map_err(|_| ApiError::new(Code::MeshNotFound, format!("{text:?} is not the id of a mesh")))
}

/// Parses the job id in a path. A malformed id is answered like an unknown one.
fn job_id(text: &str) -> Result<JobId, ApiError> {
    text.parse().map_err(|_| ApiError::new(Code::JobNotFound, format!("{text:?} is not the id of a job")))
}

/// Headers of an immutable resource: its tag is the hash of its bytes.
fn immutable(sha256: &str, media_type: &'static str) -> [(HeaderName, HeaderValue); 4] {
    let [etag, cache_control] = version(sha256);
    let bytes = HeaderValue::from_static("bytes");
    [etag, cache_control, (CONTENT_TYPE, HeaderValue::from_static(media_type)), (ACCEPT_RANGES, bytes)]
}

/// Headers of an immutable resource that a response without its bytes has too.
fn version(sha256: &str) -> [(HeaderName, HeaderValue); 2] {
    // Hexadecimal digits are a valid header value.
    let etag = HeaderValue::from_str(&format!("\"{sha256}\"")).unwrap_or(HeaderValue::from_static("\"\""));
    [(ETAG, etag), (CACHE_CONTROL, HeaderValue::from_static("private, max-age=31536000, immutable"))]
}

/// The 304 response, if the client has the current version. A cache takes its headers over, so they are those of the 200 response
/// (RFC 9110, section 15.4.5); of a resource with several representations, the caller adds the rest. A request for
/// another version only is refused.
fn not_modified(headers: &HeaderMap, sha256: &str) -> Result<Option<Response>, ApiError> {
    let etag = format!("\"{sha256}\"");
    check_if_match(headers, &etag)?;
    Ok(etag_matches(headers, &etag).then(|| (StatusCode::NOT_MODIFIED, version(sha256)).into_response()))
}

/// A file that a client uploaded.
struct UploadedFile<'a> {
    sha256: &'a str,
    size_bytes: u64,
    /// Name under which a browser keeps it.
    name: &'a str,
}

/// Responds with an uploaded file as it came, or with the part that is asked for; it is opened where it is sent.
async fn uploaded(
    state: &ApiState,
    headers: &HeaderMap,
    about: &UploadedFile<'_>,
    open: impl Future<Output = Result<File, Error>>,
) -> Result<Response, ApiError> {
    let UploadedFile { sha256, size_bytes, name } = *about;
    if let Some(response) = not_modified(headers, sha256)? {
        return Ok(response);
    }
    let bytes = match asked_part(headers, &format!("\"{sha256}\""), size_bytes) {
        AskedPart::BeyondEnd => return Ok(beyond_end(size_bytes)),
        AskedPart::Whole => None,
        AskedPart::Bytes(bytes) => Some(bytes),
    };
    let mut file = open.await?;
    // A browser must never show an uploaded file as a page of ours.
    let attachment = content_disposition(Disposition::Attachment, name);
    let common = (immutable(sha256, "application/octet-stream"), [(CONTENT_DISPOSITION, attachment)]);
    let Some(bytes) = bytes else {
        let body = streamed(Box::new(file), state.downloads.clone());
        return Ok((common, [(CONTENT_LENGTH, HeaderValue::from(size_bytes))], body).into_response());
    };
    file.seek(SeekFrom::Start(bytes.start)).map_err(Error::from)?;
    let length = bytes.end - bytes.start;
    let body = streamed(Box::new(PartReader::new(file, &(0..length))), state.downloads.clone());
    let about = [(CONTENT_LENGTH, HeaderValue::from(length)), (CONTENT_RANGE, content_range(&bytes, size_bytes))];
    Ok((StatusCode::PARTIAL_CONTENT, common, about, body).into_response())
}

/// Size of a chunk of a file, bytes; each is read on a thread that may block.
const CHUNK_BYTES: usize = 256 * 1024;

/// A body that is read while it is sent: it holds one chunk in memory, and no thread while the client is slow. The first chunk
/// is sent at once; from then on the body takes its turn with all other downloads.
fn streamed(reader: Box<dyn Read + Send>, pacer: Arc<Pacer>) -> Body {
    Body::from_stream(stream::try_unfold((reader, pacer, true), |(reader, pacer, is_first)| async move {
        let (chunk, reader) = tokio::task::spawn_blocking(move || next_chunk(reader)).await.map_err(io::Error::other)??;
        if is_first {
            pacer.charge(chunk.len());
        } else {
            pacer.wait(chunk.len()).await;
        }
        Ok::<_, io::Error>((!chunk.is_empty()).then_some((chunk, (reader, pacer, false))))
    }))
}

fn next_chunk(mut reader: Box<dyn Read + Send>) -> io::Result<(Bytes, Box<dyn Read + Send>)> {
    let mut chunk = Vec::with_capacity(CHUNK_BYTES);
    reader.by_ref().take(CHUNK_BYTES as u64).read_to_end(&mut chunk)?;
    Ok((chunk.into(), reader))
}

#[cfg(test)]
mod tests;
