//! Who may ask: with a key configured, everything under `/api` needs it as a bearer token. Health, metrics, version, the
//! page, the documentation and the list of problems need none: they hold nothing of any part.
//!
//! A browser cannot put a header on a link or an event stream, so reading (`GET`, `HEAD`) also works with the key in the
//! cookie that the page sets. Changing never does: a cookie is sent along with other sites' requests.

use std::fmt;

use axum::extract::{Request, State};
use axum::http::header::{AUTHORIZATION, COOKIE, ORIGIN};
use axum::http::{HeaderMap, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::extract::text;
use super::problem::{Code, Problem};
use super::router::Site;

/// Name of the cookie.
const COOKIE_NAME: &str = "vantage_key";

/// The server's key. It is not shown.
#[derive(Clone, PartialEq, Eq, Deserialize)]
#[serde(transparent)]
pub struct ApiKey(String);

impl ApiKey {
    /// Whether it can be sent in a header and in a cookie, and is long enough to be a secret.
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

/// Lets a request with the key through.
pub(super) async fn require_key(State(site): State<Site>, request: Request, next: Next) -> Response {
    let Some(key) = &site.options.api_key else { return next.run(request).await };
    match presented(request.method(), request.headers()) {
        Some(presented) if key.is(presented) => next.run(request).await,
        Some(_) => refuse(Code::KeyWrong, "the key is not the one this server was configured with"),
        None => refuse(Code::KeyMissing, "send the server's key as Authorization: Bearer …"),
    }
}

fn refuse(code: Code, detail: &str) -> Response {
    let mut response = Problem::new(code, detail).into_response();
    response.headers_mut().insert("www-authenticate", HeaderValue::from_static("Bearer"));
    response
}

fn presented<'a>(method: &Method, headers: &'a HeaderMap) -> Option<&'a str> {
    let bearer = text(headers, &AUTHORIZATION).and_then(|value| {
        let (scheme, token) = value.split_once(' ')?;
        scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
    });
    let may_use_cookie = matches!(*method, Method::GET | Method::HEAD);
    bearer.or_else(|| if may_use_cookie { cookie(headers) } else { None })
}

fn cookie(headers: &HeaderMap) -> Option<&str> {
    let pairs = text(headers, &COOKIE)?.split(';').filter_map(|pair| pair.trim().split_once('='));
    pairs.filter(|(name, _)| *name == COOKIE_NAME).map(|(_, value)| value).next()
}

/// Refuses a change that a page of another site asks a browser for: without a key, reaching the port is all it takes.
pub(super) async fn refuse_cross_site(request: Request, next: Next) -> Response {
    let changes = !matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    if changes && is_cross_site(request.headers()) {
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
    let host = headers.get("host").and_then(|host| host.to_str().ok()).unwrap_or_default();
    origin.split_once("://").is_none_or(|(_, origin_host)| !origin_host.eq_ignore_ascii_case(host))
}
