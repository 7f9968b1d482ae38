//! Bodies that are files: sent as they are or as a form, hashed and written while they are received.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Poll, ready};

use axum::BoxError;
use axum::body::{Body, Bytes};
use axum::extract::multipart::MultipartError;
use axum::extract::{FromRequest, Multipart, Request};
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderName};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use futures_util::{StreamExt, stream};

use crate::http::download::upload_name;
use crate::http::extract::{BodyRate, body_error, check_encoding, header_text, is_timeout, request_timeout};
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::service::{FinishedUpload, Upload};
use crate::wire::hex;

const CONTENT_DIGEST: HeaderName = HeaderName::from_static("content-digest");
/// Largest number of characters of an uploaded file's name.
pub(super) const MAX_NAME_CHARS: usize = 200;

/// Largest number of bytes of a form beside its file: the parser keeps a field's name and headers until they are complete.
const MAX_BESIDE_FILE: usize = 1 << 20;
/// Bytes of a form that its parser gets at a time.
const PIECE: usize = 1 << 16;

/// Receives the file of a request, and the name that a form gives it.
pub(super) async fn received(state: &ApiState, request: Request) -> Result<(FinishedUpload, Option<String>), ApiError> {
    check_encoding(request.headers())?;
    check_length(request.headers(), state.app.options().max_upload_bytes)?;
    let announced = announced_sha256(request.headers())?;
    let upload = state.app.receive(announced_length(request.headers())).await?;
    let (file, name) = if is_multipart(request.headers()) {
        receive_form(upload, request, state, announced.as_deref()).await?
    } else {
        (receive_body(upload, request.into_body(), state, announced.as_deref()).await?, None)
    };
    if file.size_bytes() == 0 {
        return Err(ApiError::new(Code::BadBody, "the file is empty; send its bytes"));
    }
    Ok((file, name))
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
    let refuse = || ApiError::header(Code::BadDigest, "Content-Digest", "must be sha-256=:BASE64: (RFC 9530)");
    let value = value.to_str().map_err(|_| refuse())?;
    let entry = value.split(',').find_map(|entry| entry.trim().strip_prefix("sha-256=")).ok_or_else(refuse)?;
    let encoded = entry.strip_prefix(':').and_then(|entry| entry.strip_suffix(':')).ok_or_else(refuse)?;
    let digest = BASE64_STANDARD.decode(encoded).ok().filter(|digest| digest.len() == 32).ok_or_else(refuse)?;
    Ok(Some(hex(&digest)))
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
    let (mut chunks, mut rate) = (body.into_data_stream(), BodyRate::new(state.options.body_idle_timeout));
    while let Some(chunk) = chunks.next().await {
        let chunk = chunk.map_err(|error| body_error(&error))?;
        rate.count(chunk.len())?;
        upload.write(chunk).await?;
    }
    Ok(upload.finish(announced).await?)
}

/// The file of a form, and the name that the form gives it.
async fn receive_form(
    mut upload: Upload,
    request: Request,
    state: &ApiState,
    announced: Option<&str>,
) -> Result<(FinishedUpload, Option<String>), ApiError> {
    let meter = FormMeter::new(BodyRate::new(state.options.body_idle_timeout));
    let refused = |error: MultipartError| meter.lock().refusal.take().unwrap_or_else(|| form_error(&error));
    let request = request.map(|body| meter.metered(body));
    // The media type was looked at before: nothing but its boundary can be at fault.
    let said = "has no boundary, which separates the parts of multipart/form-data; let the client set the header itself";
    let refused_boundary = ApiError::header(Code::BadBody, "Content-Type", said);
    let mut form = Multipart::from_request(request, state).await.map_err(|_| refused_boundary)?;
    let Some(mut field) = form.next_field().await.map_err(refused)? else {
        return Err(ApiError::at(Code::BadBody, "file", "the form has no field \"file\"; send the file in a field of that name"));
    };
    check_only_file(field.name())?;
    meter.lock().is_in_file = true;
    let file_name = field.file_name().and_then(|name| upload_name(name, MAX_NAME_CHARS));
    while let Some(chunk) = field.chunk().await.map_err(refused)? {
        upload.write(chunk).await?;
    }
    drop(field);
    meter.lock().is_in_file = false;
    if let Some(second) = form.next_field().await.map_err(refused)? {
        check_only_file(second.name())?;
        return Err(ApiError::at(Code::BadBody, "file", "the form has the field \"file\" twice; send one file per request"));
    }
    Ok((upload.finish(announced).await?, file_name))
}

/// Refuses a field that a form has beside its file.
fn check_only_file(name: Option<&str>) -> Result<(), ApiError> {
    let name = name.unwrap_or_default();
    if name == "file" {
        return Ok(());
    }
    let said = format!("the form has a field {name:?}; the only field allowed is \"file\", everything else belongs in the query");
    Err(ApiError::at(Code::BadBody, name, said))
}

/// Meter of a form's bytes on their way to its parser, which sets them no limit itself.
#[derive(Clone)]
struct FormMeter(Arc<Mutex<Metered>>);

struct Metered {
    rate: BodyRate,
    beside_file: usize,
    is_in_file: bool,
    /// Reason why the body was cut off, for which the parser has no words.
    refusal: Option<ApiError>,
}

impl FormMeter {
    fn new(rate: BodyRate) -> Self {
        Self(Arc::new(Mutex::new(Metered { rate, beside_file: 0, is_in_file: false, refusal: None })))
    }

    /// Whole after every operation, also where a thread died in between.
    fn lock(&self) -> MutexGuard<'_, Metered> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The body, cut off with a refusal. The parser takes everything that is ready before it looks at it, so small pieces are
    /// handed on one at a time.
    fn metered(&self, body: Body) -> Body {
        let (meter, mut chunks) = (self.clone(), body.into_data_stream());
        let (mut rest, mut was_handed_on) = (Bytes::new(), false);
        Body::from_stream(stream::poll_fn(move |cx| {
            if std::mem::take(&mut was_handed_on) {
                cx.waker().wake_by_ref();
                return Poll::Pending;
            }
            while rest.is_empty() {
                match ready!(chunks.poll_next_unpin(cx)) {
                    Some(Ok(chunk)) => rest = chunk,
                    Some(Err(error)) => return Poll::Ready(Some(Err(error.into()))),
                    None => return Poll::Ready(None),
                }
            }
            was_handed_on = true;
            let piece = rest.split_to(rest.len().min(PIECE));
            Poll::Ready(Some(meter.lock().count(piece)))
        }))
    }
}

impl Metered {
    fn count(&mut self, chunk: Bytes) -> Result<Bytes, BoxError> {
        let is_in_time = self.rate.count(chunk.len());
        self.beside_file += if self.is_in_file { 0 } else { chunk.len() };
        let detail = || format!("the form has more than {MAX_BESIDE_FILE} bytes beside its field \"file\"");
        let is_in_room = if self.beside_file > MAX_BESIDE_FILE { Err(ApiError::new(Code::TooLarge, detail())) } else { Ok(()) };
        is_in_time.and(is_in_room).map(|()| chunk).map_err(|refusal| {
            self.refusal = Some(refusal);
            "the body was cut off".into()
        })
    }
}

fn form_error(error: &MultipartError) -> ApiError {
    if is_timeout(error) { request_timeout() } else { ApiError::new(Code::BadBody, error.body_text()) }
}
