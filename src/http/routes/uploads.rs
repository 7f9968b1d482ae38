//! Bodies that are files: sent as they are or as a form, hashed and written while they are received.

use std::future::poll_fn;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, ready};

use axum::BoxError;
use axum::body::{Body, BodyDataStream, Bytes};
use axum::extract::multipart::MultipartError;
use axum::extract::{FromRequest, Multipart, Request};
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderName};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use futures_util::stream::Fuse;
use futures_util::{StreamExt, stream};
use sha2::{Digest as _, Sha256};

use crate::http::download::upload_name;
use crate::http::extract::{BodyRate, body_error, check_encoding, header_text, is_timeout, request_timeout};
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::service::{Error, FinishedUpload, Upload};
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
    let (parts, body) = request.into_parts();
    let meter = FormMeter::new(body, BodyRate::new(state.options.body_idle_timeout), announced.is_some());
    let refused = |error: MultipartError| meter.lock().refusal.take().unwrap_or_else(|| form_error(&error));
    let request = Request::from_parts(parts, meter.metered());
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
    let content = meter.finish().await?;
    Ok((finish_of_form(upload, announced, content).await?, file_name))
}

/// Finishes the file of a form. The announced digest is of the content, which is the whole form (RFC 9530, section 2); clients whose
/// library writes the form know that of the file alone, which counts as well.
async fn finish_of_form(upload: Upload, announced: Option<&str>, content: Option<String>) -> Result<FinishedUpload, ApiError> {
    let of_file = announced.filter(|announced| content.as_deref() != Some(*announced));
    upload.finish(of_file).await.map_err(|error| match (error, content) {
        (Error::DigestMismatch { found, announced }, Some(content)) => {
            let said =
                format!("the form's SHA-256 is {content} and its file's {found}, not the announced {announced}; announce either");
            ApiError::new(Code::DigestMismatch, said)
        }
        (error, _) => error.into(),
    })
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
    chunks: Fuse<BodyDataStream>,
    /// Part of a chunk that is still to be handed on.
    rest: Bytes,
    was_handed_on: bool,
    rate: BodyRate,
    beside_file: usize,
    is_in_file: bool,
    /// Hash of the whole content, where a digest was announced.
    content: Option<Sha256>,
    /// Reason why the body was cut off, for which the parser has no words.
    refusal: Option<ApiError>,
}

impl FormMeter {
    fn new(body: Body, rate: BodyRate, is_hashed: bool) -> Self {
        Self(Arc::new(Mutex::new(Metered {
            chunks: body.into_data_stream().fuse(),
            rest: Bytes::new(),
            was_handed_on: false,
            rate,
            beside_file: 0,
            is_in_file: false,
            content: is_hashed.then(Sha256::new),
            refusal: None,
        })))
    }

    /// Whole after every operation, also where a thread died in between.
    fn lock(&self) -> MutexGuard<'_, Metered> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The body, cut off with a refusal.
    fn metered(&self) -> Body {
        let meter = self.clone();
        Body::from_stream(stream::poll_fn(move |cx| meter.lock().poll_piece(cx)))
    }

    /// Receives what follows the form, at which its parser stops, and returns the SHA-256 of the whole content where a digest was
    /// announced. A body that is left unread would also cost the client its connection.
    async fn finish(&self) -> Result<Option<String>, ApiError> {
        while let Some(piece) = poll_fn(|cx| self.lock().poll_piece(cx)).await {
            piece.map_err(|error| self.lock().refusal.take().unwrap_or_else(|| body_error(&*error)))?;
        }
        Ok(self.lock().content.take().map(|content| hex(&content.finalize())))
    }
}

impl Metered {
    /// The next piece. The parser takes everything that is ready before it looks at it, so small pieces are handed on one at a time.
    fn poll_piece(&mut self, cx: &mut Context<'_>) -> Poll<Option<Result<Bytes, BoxError>>> {
        if std::mem::take(&mut self.was_handed_on) {
            cx.waker().wake_by_ref();
            return Poll::Pending;
        }
        while self.rest.is_empty() {
            match ready!(self.chunks.poll_next_unpin(cx)) {
                Some(Ok(chunk)) => self.rest = chunk,
                Some(Err(error)) => return Poll::Ready(Some(Err(error.into()))),
                None => return Poll::Ready(None),
            }
        }
        self.was_handed_on = true;
        let piece = self.rest.split_to(self.rest.len().min(PIECE));
        Poll::Ready(Some(self.count(piece)))
    }

    fn count(&mut self, chunk: Bytes) -> Result<Bytes, BoxError> {
        let is_in_time = self.rate.count(chunk.len());
        self.beside_file += if self.is_in_file { 0 } else { chunk.len() };
        if let Some(content) = &mut self.content {
            content.update(&chunk);
        }
        let detail = || format!("the form has more than {MAX_BESIDE_FILE} bytes beside its field \"file\"");
        let is_in_room = if self.beside_file > MAX_BESIDE_FILE { Err(ApiError::new(Code::TooLarge, detail())) } else { Ok(()) };
        is_in_time.and(is_in_room).map(|()| chunk).map_err(|refusal| {
            self.refusal = Some(refusal);
            "the body was cut off".into()
        })
    }
}

fn form_error(error: &MultipartError) -> ApiError {
    // The stream's own error; what is not a form is the parser's.
    let causes = std::iter::successors(Some(error as &(dyn std::error::Error + 'static)), |error| error.source());
    let is_broken_off = causes.into_iter().any(|cause| cause.is::<axum::Error>());
    if is_timeout(error) {
        request_timeout()
    } else if is_broken_off {
        body_error(error)
    } else {
        ApiError::new(Code::BadBody, error.body_text())
    }
}
