//! Strict extractors: JSON bodies, with JSON pointers to what is wrong; query parameters; preconditions; idempotency keys.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::io;
use std::str::FromStr;
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::extract::{FromRequest, FromRequestParts, Query, Request};
use axum::http::header::{CONTENT_ENCODING, CONTENT_TYPE, IF_MATCH, IF_NONE_MATCH};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use serde::Serialize;
use serde::de::DeserializeOwned;
use utoipa::ToSchema;

use super::keys::KeyName;
use super::problem::{ApiError, Code};
use super::router::ApiState;
use crate::service::{Error, Precondition, Submission};
use crate::wire;
use crate::wire::words::is_control;

/// Extractor of a JSON body; as an answer, its JSON.
pub(super) struct Json<T>(pub T);

/// Written by the serialiser that documents and stored rows are written by: with one of `axum::Json`'s own, every type would be
/// compiled for both.
impl<T: Serialize> IntoResponse for Json<T> {
    fn into_response(self) -> Response {
        json_response(serde_json::to_vec(&self.0))
    }
}

fn json_response(body: serde_json::Result<Vec<u8>>) -> Response {
    match body {
        Ok(body) => ([(CONTENT_TYPE, "application/json")], body).into_response(),
        Err(error) => ApiError::from(Error::from(error)).into_response(),
    }
}

impl<T: DeserializeOwned + ToSchema + 'static> FromRequest<ApiState> for Json<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &ApiState) -> Result<Self, ApiError> {
        Ok(Self(wire::parse_document(&json_body(request, state).await?)?))
    }
}

/// Bytes of a JSON body.
pub(super) async fn json_body(request: Request, state: &ApiState) -> Result<Vec<u8>, ApiError> {
    let (parts, body) = request.into_parts();
    check_json(&parts.headers)?;
    read(body, state.options.max_json_bytes, BodyRate::new(state.options.body_idle_timeout)).await
}

fn check_json(headers: &HeaderMap) -> Result<(), ApiError> {
    check_encoding(headers)?;
    let refuse =
        |said: &str| ApiError::header(Code::UnsupportedMediaType, "Content-Type", &format!("{said}; send application/json"));
    let value = headers.get(CONTENT_TYPE).ok_or_else(|| refuse("is missing"))?;
    let text = value.to_str().map_err(|_| refuse("is not visible ASCII text"))?;
    let essence = text.split(';').next().unwrap_or_default().trim();
    if essence.eq_ignore_ascii_case("application/json") { Ok(()) } else { Err(refuse(&format!("is {essence:?}"))) }
}

/// Refuses compressed bodies: their size does not bound what they decompress to.
pub(super) fn check_encoding(headers: &HeaderMap) -> Result<(), ApiError> {
    match header_text(headers, &CONTENT_ENCODING) {
        None => Ok(()),
        Some(encoding) if encoding.eq_ignore_ascii_case("identity") => Ok(()),
        Some(encoding) => {
            let said = format!("is {encoding:?}; send the body uncompressed");
            Err(ApiError::header(Code::UnsupportedMediaType, "Content-Encoding", &said))
        }
    }
}

async fn read(body: Body, limit: usize, mut rate: BodyRate) -> Result<Vec<u8>, ApiError> {
    let mut stream = body.into_data_stream();
    let mut bytes = Vec::new();
    while let Some(chunk) = stream.next().await {
        let chunk = chunk.map_err(|error| body_error(&error))?;
        rate.count(chunk.len())?;
        bytes.extend_from_slice(&chunk);
        if bytes.len() > limit {
            return Err(ApiError::new(Code::TooLarge, format!("the body is larger than the {limit} bytes allowed")));
        }
    }
    Ok(bytes)
}

/// The error response to a body that broke off.
pub(super) fn body_error(error: &(dyn std::error::Error + 'static)) -> ApiError {
    if is_timeout(error) {
        return request_timeout();
    }
    let said = if is_malformed(error) {
        "the body has a malformed chunk; let the client write Transfer-Encoding: chunked itself (RFC 9112, section 7.1)"
    } else {
        "the body ended early"
    };
    ApiError::new(Code::BadBody, said)
}

/// Returns true if the bytes that came were not chunks; a connection that ended early is an error of another kind.
fn is_malformed(error: &(dyn std::error::Error + 'static)) -> bool {
    std::iter::successors(Some(error), |error| error.source())
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|cause| matches!(cause.kind(), io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput))
}

/// Returns true if the body stalled for longer than `body_idle_timeout`.
pub(super) fn is_timeout(error: &(dyn std::error::Error + 'static)) -> bool {
    std::iter::successors(Some(error), |error| error.source()).any(|cause| cause.is::<tower_http::timeout::TimeoutError>())
}

/// The 408 response to a body that arrives too slowly.
pub(super) fn request_timeout() -> ApiError {
    let detail = format!(
        "the body arrived too slowly: it stalled for longer than server.body_idle_timeout_secs, or brought less than \
         {MIN_BODY_RATE} bytes a second on average"
    );
    ApiError::new(Code::RequestTimeout, detail)
}

/// Check of a body's average rate. A few bytes now and then keep a connection alive; for a body, which holds one of the client's
/// connections, and of an upload a thread, they are not enough.
pub(super) struct BodyRate {
    began: Instant,
    grace: Duration,
    received_bytes: u64,
}

/// Lower bound of a body's average rate, bytes per second.
const MIN_BODY_RATE: f64 = 1024.0;

impl BodyRate {
    /// Starts the clock; the rate is checked once `grace` has passed.
    pub(super) fn new(grace: Duration) -> Self {
        Self { began: Instant::now(), grace, received_bytes: 0 }
    }

    /// Counts one more chunk.
    ///
    /// # Errors
    /// `request_timeout` below the minimum rate.
    pub(super) fn count(&mut self, bytes: usize) -> Result<(), ApiError> {
        self.received_bytes += bytes as u64;
        let elapsed = self.began.elapsed();
        let too_few = (self.received_bytes as f64) < MIN_BODY_RATE * elapsed.as_secs_f64();
        if elapsed > self.grace && too_few { Err(request_timeout()) } else { Ok(()) }
    }
}

/// The value of a header, if it is visible ASCII.
pub(super) fn header_text<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Option<&'a str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// Query parameters, each given at most once. A handler takes those it knows, then refuses the rest.
pub(super) struct Params {
    given: BTreeMap<String, String>,
    /// Names of the parameters that the handler knows.
    known: Vec<&'static str>,
}

impl FromRequestParts<ApiState> for Params {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, _: &ApiState) -> Result<Self, ApiError> {
        let unreadable = || ApiError::new(Code::BadQuery, "The query is not UTF-8 text in the form name=value&name=value.");
        let pairs = Query::<Vec<(String, String)>>::try_from_uri(&parts.uri).map_err(|_| unreadable())?;
        let mut given = BTreeMap::new();
        for (name, value) in pairs.0 {
            // What the parser makes of other bytes.
            if [&name, &value].iter().any(|text| text.contains(char::REPLACEMENT_CHARACTER)) {
                return Err(unreadable());
            }
            if given.contains_key(&name) {
                return Err(ApiError::query(&name, "is given more than once"));
            }
            given.insert(name, value);
        }
        Ok(Self { given, known: Vec::new() })
    }
}

impl Params {
    /// Takes a parameter as text.
    pub(super) fn text(&mut self, name: &'static str) -> Option<String> {
        self.known.push(name);
        self.given.remove(name)
    }

    /// Takes a parameter and parses it; `allowed` says which values there are.
    pub(super) fn value<T: FromStr>(&mut self, name: &'static str, allowed: &str) -> Result<Option<T>, ApiError> {
        let parse = |text: String| text.parse().map_err(|_| ApiError::query(name, &format!("is {text:?}; allowed is {allowed}")));
        self.text(name).map(parse).transpose()
    }

    /// Takes and parses a parameter that must be given.
    pub(super) fn required<T: FromStr>(&mut self, name: &'static str, allowed: &str) -> Result<T, ApiError> {
        self.value(name, allowed)?.ok_or_else(|| ApiError::query(name, &format!("is missing; give {allowed}")))
    }

    /// Takes a whole number from 0 to `max`.
    pub(super) fn whole_number<T: FromStr + PartialOrd + Display>(
        &mut self,
        name: &'static str,
        max: T,
    ) -> Result<Option<T>, ApiError> {
        let Some(text) = self.text(name) else { return Ok(None) };
        let number = text.parse().ok().filter(|number| *number <= max);
        let refused = || ApiError::query(name, &format!("is {text:?}; allowed is a whole number from 0 to {max}"));
        number.ok_or_else(refused).map(Some)
    }

    /// Takes a text of 1 to `max_chars` characters, none of them a control character.
    pub(super) fn name(&mut self, name: &'static str, max_chars: usize) -> Result<Option<String>, ApiError> {
        let value = self.text(name);
        if value.as_ref().is_some_and(|v| v.is_empty() || v.chars().count() > max_chars || v.chars().any(is_control)) {
            let said = format!("must have 1 to {max_chars} characters, none of them a control character");
            return Err(ApiError::query(name, &said));
        }
        Ok(value)
    }

    /// Takes `page_size` and `page_token`.
    pub(super) fn page(&mut self) -> Result<(u32, Option<String>), ApiError> {
        let size = self.text("page_size").map_or(Ok(DEFAULT_PAGE_SIZE), |text| {
            let size = text.parse().ok().filter(|size| (1..=MAX_PAGE_SIZE).contains(size));
            let said = || format!("is {text:?}; allowed is a whole number from 1 to {MAX_PAGE_SIZE}");
            size.ok_or_else(|| ApiError::query("page_size", &said()))
        })?;
        Ok((size, self.text("page_token")))
    }

    /// Refuses parameters that the handler did not take.
    pub(super) fn deny_unknown(self) -> Result<(), ApiError> {
        let Some(name) = self.given.into_keys().next() else { return Ok(()) };
        let known = match &self.known[..] {
            [] => "it has none".to_owned(),
            known => format!("known are {}", known.join(", ")),
        };
        Err(ApiError::query(&name, &format!("is unknown to this route; {known}")))
    }
}

/// Entries of a page by default.
const DEFAULT_PAGE_SIZE: u32 = 50;
/// Largest number of entries of a page.
const MAX_PAGE_SIZE: u32 = 1000;

impl FromRequestParts<ApiState> for Precondition {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, _: &ApiState) -> Result<Self, ApiError> {
        let header = |name: &HeaderName| match parts.headers.get_all(name).iter().collect::<Vec<_>>()[..] {
            [] => Ok(None),
            [value] => value
                .to_str()
                .map(Some)
                .map_err(|_| ApiError::header(Code::BadRequest, name.as_str(), "is not visible ASCII text")),
            _ => Err(ApiError::header(Code::BadRequest, name.as_str(), "is given more than once")),
        };
        match (header(&IF_MATCH)?, header(&IF_NONE_MATCH)?) {
            (None, None) => Ok(Self::None),
            (Some(tags), None) => Ok(Self::Match(if tags.trim() == "*" { Vec::new() } else { split_tags(tags) })),
            (of, Some(tags)) if tags.trim() == "*" => Ok(of.map_or(Self::Absent, |_| Self::Never)),
            (_, Some(_)) => Err(ApiError::header(Code::BadRequest, "If-None-Match", "must be * here")),
        }
    }
}

/// Splits a list of entity tags. Ours contain no comma; a malformed tag matches none.
fn split_tags(tags: &str) -> Vec<String> {
    tags.split(',').map(|tag| tag.trim().to_owned()).collect()
}

/// Refuses a request to read whose `If-Match` does not list this tag (strong comparison; RFC 9110, section 13.1.1).
pub(super) fn check_if_match(headers: &HeaderMap, etag: &str) -> Result<(), ApiError> {
    let is_listed = |tags: &str| tags.trim() == "*" || split_tags(tags).iter().any(|tag| tag == etag);
    let lists = |value: &HeaderValue| value.to_str().is_ok_and(is_listed);
    if headers.contains_key(IF_MATCH) && !headers.get_all(IF_MATCH).iter().any(lists) {
        return Err(Error::PreconditionFailed(Some(etag.to_owned())).into());
    }
    Ok(())
}

/// Returns true if `If-None-Match` lists the tag (weak comparison): the client has the current version.
pub(super) fn etag_matches(headers: &HeaderMap, etag: &str) -> bool {
    headers
        .get_all(IF_NONE_MATCH)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .any(|tags| tags.trim() == "*" || split_tags(tags).iter().any(|tag| tag.trim_start_matches("W/") == etag))
}

impl FromRequestParts<ApiState> for Submission {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &ApiState) -> Result<Self, ApiError> {
        let submitted_by = parts.extensions.get::<KeyName>().map(|KeyName(name)| name.to_string());
        Ok(Self { idempotency_key: idempotency_key(&parts.headers)?, limit: Some(state.options.request_timeout), submitted_by })
    }
}

/// The header `Idempotency-Key`: 1 to 255 visible ASCII characters.
fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, ApiError> {
    const NAME: &str = "idempotency-key";
    let mut values = headers.get_all(NAME).iter();
    let Some(value) = values.next() else { return Ok(None) };
    let refuse = |detail: &str| ApiError::header(Code::BadIdempotencyKey, "Idempotency-Key", detail);
    if values.next().is_some() {
        return Err(refuse("is given more than once"));
    }
    let key = value.to_str().map_err(|_| refuse("must be visible ASCII characters"))?;
    if !(1..=255).contains(&key.len()) || !key.bytes().all(|c| c.is_ascii_graphic()) {
        return Err(refuse("must be 1 to 255 visible ASCII characters"));
    }
    Ok(Some(key.to_owned()))
}
