//! Reading requests strictly: JSON bodies with the pointer of what is wrong, query parameters by name, preconditions.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::str::FromStr;
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::extract::{FromRequest, FromRequestParts, OptionalFromRequestParts, Query, Request};
use axum::http::header::{CONTENT_ENCODING, CONTENT_TYPE, IF_MATCH, IF_NONE_MATCH};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName};
use futures_util::StreamExt;
use serde::de::DeserializeOwned;

use super::problem::{Code, Problem};
use super::router::Site;
use crate::service::Precondition;
use crate::wire;

/// A JSON body.
pub(super) struct Json<T>(pub T);

impl<T: DeserializeOwned> FromRequest<Site> for Json<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, site: &Site) -> Result<Self, Problem> {
        let (parts, body) = request.into_parts();
        check_json(&parts.headers)?;
        let bytes = read(body, site.options.max_json_bytes).await?;
        Ok(Self(wire::parse(&bytes)?))
    }
}

fn check_json(headers: &HeaderMap) -> Result<(), Problem> {
    check_encoding(headers)?;
    let essence = text(headers, &CONTENT_TYPE).and_then(|value| value.split(';').next()).map(str::trim).unwrap_or_default();
    if essence.eq_ignore_ascii_case("application/json") {
        return Ok(());
    }
    let detail = format!("the body is announced as {essence:?}; send application/json");
    Err(Problem::at(Code::UnsupportedMediaType, "Content-Type", detail))
}

/// Compressed bodies are refused: their size says nothing about what they unpack to.
pub(super) fn check_encoding(headers: &HeaderMap) -> Result<(), Problem> {
    match text(headers, &CONTENT_ENCODING) {
        None => Ok(()),
        Some(encoding) if encoding.eq_ignore_ascii_case("identity") => Ok(()),
        Some(encoding) => {
            let detail = format!("the body is encoded as {encoding:?}; send it as it is");
            Err(Problem::at(Code::UnsupportedMediaType, "Content-Encoding", detail))
        }
    }
}

async fn read(body: Body, limit: usize) -> Result<Vec<u8>, Problem> {
    let mut stream = body.into_data_stream();
    let mut bytes = Vec::new();
    while let Some(piece) = stream.next().await {
        bytes.extend_from_slice(&piece.map_err(|error| broken(&error))?);
        if bytes.len() > limit {
            return Err(Problem::new(Code::TooLarge, format!("the body is larger than the allowed {limit} bytes")));
        }
    }
    Ok(bytes)
}

/// Why a body broke off.
pub(super) fn broken(error: &(dyn std::error::Error + 'static)) -> Problem {
    if has_stalled(error) { too_slow() } else { Problem::new(Code::BadBody, "the body broke off") }
}

/// Whether no piece of a body came for too long.
pub(super) fn has_stalled(error: &(dyn std::error::Error + 'static)) -> bool {
    std::iter::successors(Some(error), |error| error.source()).any(|cause| cause.is::<tower_http::timeout::TimeoutError>())
}

pub(super) fn too_slow() -> Problem {
    Problem::new(Code::RequestTimeout, "the body came too slowly")
}

/// The pace of an upload. Some bytes now and then keep a connection alive; for an upload, which holds a thread, they
/// are not enough.
pub(super) struct Pace {
    began: Instant,
    grace: Duration,
    received_bytes: u64,
}

/// Slowest upload, bytes a second, on average.
const SLOWEST_UPLOAD: f64 = 1024.0;

impl Pace {
    /// Begins to count; the pace is looked at once `grace` is over.
    pub(super) fn new(grace: Duration) -> Self {
        Self { began: Instant::now(), grace, received_bytes: 0 }
    }

    /// Counts one more piece.
    pub(super) fn count(&mut self, bytes: usize) -> Result<(), Problem> {
        self.received_bytes += bytes as u64;
        let elapsed = self.began.elapsed();
        let too_few = (self.received_bytes as f64) < SLOWEST_UPLOAD * elapsed.as_secs_f64();
        if elapsed > self.grace && too_few { Err(too_slow()) } else { Ok(()) }
    }
}

/// The value of a header, if it is text.
pub(super) fn text<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Option<&'a str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// Query parameters, each at most once. A route takes those that it knows; one that is left is refused.
pub(super) struct Params(BTreeMap<String, String>);

impl FromRequestParts<Site> for Params {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &Site) -> Result<Self, Problem> {
        let pairs = Query::<Vec<(String, String)>>::try_from_uri(&parts.uri)
            .map_err(|rejection| Problem::new(Code::BadQuery, rejection.body_text()))?;
        let mut params = BTreeMap::new();
        for (name, value) in pairs.0 {
            if params.contains_key(&name) {
                return Err(Problem::at(Code::BadQuery, name, "is given more than once"));
            }
            params.insert(name, value);
        }
        Ok(Self(params))
    }
}

impl Params {
    /// The parameter as it is written.
    pub(super) fn text(&mut self, name: &str) -> Option<String> {
        self.0.remove(name)
    }

    /// The parameter as a value.
    pub(super) fn value<T: FromStr<Err: Display>>(&mut self, name: &str) -> Result<Option<T>, Problem> {
        let parse = |text: String| text.parse().map_err(|error: T::Err| Problem::at(Code::BadQuery, name, error.to_string()));
        self.0.remove(name).map(parse).transpose()
    }

    /// The parameter, which has to be there.
    pub(super) fn required<T: FromStr<Err: Display>>(&mut self, name: &str) -> Result<T, Problem> {
        self.value(name)?.ok_or_else(|| Problem::at(Code::BadQuery, name, "is missing"))
    }

    /// A text without control characters, of at most `longest` characters.
    pub(super) fn name(&mut self, name: &str, longest: usize) -> Result<Option<String>, Problem> {
        let value = self.text(name);
        if value.as_ref().is_some_and(|v| v.is_empty() || v.chars().count() > longest || v.chars().any(char::is_control)) {
            return Err(Problem::at(Code::BadQuery, name, format!("has to be 1 to {longest} characters, none of them control")));
        }
        Ok(value)
    }

    /// `page_size` and `page_token`.
    pub(super) fn page(&mut self) -> Result<(u32, Option<String>), Problem> {
        let size = self.value::<u32>("page_size")?.unwrap_or(DEFAULT_PAGE);
        if !(1..=LARGEST_PAGE).contains(&size) {
            return Err(Problem::at(Code::BadQuery, "page_size", format!("is {size}; allowed is 1 to {LARGEST_PAGE}")));
        }
        Ok((size, self.text("page_token")))
    }

    /// Refuses what nobody took.
    pub(super) fn end(self) -> Result<(), Problem> {
        match self.0.into_keys().next() {
            Some(name) => Err(Problem::at(Code::BadQuery, name, "is no parameter of this route")),
            None => Ok(()),
        }
    }
}

/// Entries of a page, unless said otherwise.
const DEFAULT_PAGE: u32 = 50;
/// Entries of a page at most.
const LARGEST_PAGE: u32 = 1000;

impl FromRequestParts<Site> for Precondition {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &Site) -> Result<Self, Problem> {
        let header = |name: &HeaderName| match parts.headers.get_all(name).iter().collect::<Vec<_>>()[..] {
            [] => Ok(None),
            [value] => value.to_str().map(Some).map_err(|_| Problem::at(Code::BadRequest, name.as_str(), "is no text")),
            _ => Err(Problem::at(Code::BadRequest, name.as_str(), "is given more than once")),
        };
        match (header(&IF_MATCH)?, header(&IF_NONE_MATCH)?) {
            (None, None) => Ok(Self::None),
            (Some(tags), None) => Ok(Self::Match(if tags.trim() == "*" { Vec::new() } else { split_tags(tags) })),
            (of, Some(tags)) if tags.trim() == "*" => Ok(of.map_or(Self::Absent, |_| Self::Never)),
            (_, Some(_)) => Err(Problem::at(Code::BadRequest, "If-None-Match", "can only be * with this method")),
        }
    }
}

/// Entity tags of a list. Ours hold no comma; what is no tag matches none.
fn split_tags(tags: &str) -> Vec<String> {
    tags.split(',').map(|tag| tag.trim().to_owned()).collect()
}

/// Whether `If-None-Match` holds the tag (weak comparison), so that the client has the newest version.
pub(super) fn is_known(headers: &HeaderMap, etag: &str) -> bool {
    headers
        .get_all(IF_NONE_MATCH)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .any(|tags| tags.trim() == "*" || split_tags(tags).iter().any(|tag| tag.trim_start_matches("W/") == etag))
}

/// `Idempotency-Key`: 1 to 255 visible ASCII characters.
pub(super) struct IdempotencyKey(pub String);

impl OptionalFromRequestParts<Site> for IdempotencyKey {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &Site) -> Result<Option<Self>, Problem> {
        const NAME: &str = "idempotency-key";
        let mut values = parts.headers.get_all(NAME).iter();
        let Some(value) = values.next() else { return Ok(None) };
        let refuse = |detail: &str| Problem::at(Code::BadIdempotencyKey, "Idempotency-Key", detail);
        if values.next().is_some() {
            return Err(refuse("is given more than once"));
        }
        let key = value.to_str().map_err(|_| refuse("has to be visible ASCII characters"))?;
        if !(1..=255).contains(&key.len()) || !key.bytes().all(|c| c.is_ascii_graphic()) {
            return Err(refuse("has to be 1 to 255 visible ASCII characters"));
        }
        Ok(Some(Self(key.to_owned())))
    }
}
