//! Who may ask: with a key configured, everything under `/api` needs it as a bearer token. Health, metrics, version, the
//! page, the documentation and the list of problems need none: they hold nothing of any part.
//!
//! A browser cannot put a header on a link or an event stream, and a page that keeps the key keeps it within reach of
//! every script. So the page exchanges the key for a session, whose cookie no script can read and no other site's page
//! sends along (`HttpOnly`, `SameSite=Strict`). Reading works with the cookie alone. Changing also needs the header
//! `X-Vantage-Session`: a page of another origin cannot send it without asking us first (CORS), and we never agree.

use std::fmt;
use std::time::Instant;

use axum::extract::{Request, State};
use axum::http::header::{AUTHORIZATION, COOKIE, HOST, HeaderName, ORIGIN};
use axum::http::{HeaderMap, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::extract::text;
use super::problem::{Code, Problem};
use super::router::Site;

/// Name of the cookie that holds a session's id.
pub(super) const COOKIE_NAME: &str = "vantage_session";
/// Header without which a session changes nothing.
const SESSION_HEADER: HeaderName = HeaderName::from_static("x-vantage-session");

/// The server's key. It is not shown.
#[derive(Clone, PartialEq, Eq, Deserialize)]
#[serde(transparent)]
pub struct ApiKey(String);

impl ApiKey {
    /// Whether it can be sent in a header, and is long enough to be a secret.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        (16..=256).contains(&self.0.len()) && self.0.bytes().all(|c| c.is_ascii_graphic() && c != b';' && c != b',')
    }

    /// Compares without telling by its duration how much is equal: digests of the two, all bytes.
    #[must_use]
    pub fn is(&self, presented: &str) -> bool {
        let (own, presented) = (Sha256::digest(&self.0), Sha256::digest(presented));
        own.iter().zip(presented.iter()).fold(0, |differing, (a, b)| differing | (a ^ b)) == 0
    }
}

impl fmt::Debug for ApiKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ApiKey(…)")
    }
}

/// Lets a request with the key through, or with a session that the key began.
pub(super) async fn require_key(State(site): State<Site>, request: Request, next: Next) -> Response {
    match check(&site, request.method(), request.headers()) {
        Ok(()) => next.run(request).await,
        Err(problem) => {
            let mut response = problem.into_response();
            response.headers_mut().insert("www-authenticate", HeaderValue::from_static("Bearer"));
            response
        }
    }
}

fn check(site: &Site, method: &Method, headers: &HeaderMap) -> Result<(), Problem> {
    let Some(key) = &site.options.api_key else { return Ok(()) };
    if let Some(presented) = bearer(headers) {
        let wrong = || Problem::new(Code::KeyWrong, "the key is not the one this server was configured with");
        return if key.is(presented) { Ok(()) } else { Err(wrong()) };
    }
    let missing = |detail: &str| Err(Problem::new(Code::KeyMissing, detail));
    let Some(session) = session(headers) else {
        return missing("send the server's key as Authorization: Bearer …");
    };
    if !site.sessions.is_open(session, Instant::now()) {
        return Err(Problem::new(Code::SessionEnded, "the session of the cookie is over; begin another with the key"));
    }
    if is_change(method) && !headers.contains_key(SESSION_HEADER) {
        return missing("with a session, a request that changes something also has to carry the header X-Vantage-Session");
    }
    Ok(())
}

/// The token in `Authorization`.
pub(super) fn bearer(headers: &HeaderMap) -> Option<&str> {
    let (scheme, token) = text(headers, &AUTHORIZATION)?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
}

/// The session's id in the cookie. HTTP/2 may send a header for each pair.
pub(super) fn session(headers: &HeaderMap) -> Option<&str> {
    let cookies = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok());
    let mut pairs = cookies.flat_map(|cookies| cookies.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.find(|(name, _)| *name == COOKIE_NAME).map(|(_, value)| value)
}

fn is_change(method: &Method) -> bool {
    !matches!(*method, Method::GET | Method::HEAD | Method::OPTIONS)
}

/// Refuses a change that a page of another site asks a browser for: without a key, reaching the port is all it takes.
pub(super) async fn refuse_cross_site(request: Request, next: Next) -> Response {
    if is_change(request.method()) && is_cross_site(request.headers()) {
        return Problem::new(Code::CrossSite, "the request comes from a page of another site").into_response();
    }
    next.run(request).await
}

fn is_cross_site(headers: &HeaderMap) -> bool {
    if let Some(site) = headers.get("sec-fetch-site") {
        return site != "same-origin" && site != "none";
    }
    // Browsers that do not say it send the page's origin.
    let Some(origin) = text(headers, &ORIGIN) else { return false };
    let host = text(headers, &HOST).unwrap_or_default();
    origin.split_once("://").is_none_or(|(_, origin_host)| !origin_host.eq_ignore_ascii_case(host))
}
