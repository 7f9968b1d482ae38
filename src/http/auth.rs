//! Authentication: with a key configured, everything under `/api` needs one as a bearer token. Health, metrics, version, the
//! dashboard, the documentation and the list of problems are open: they reveal nothing about any part.
//!
//! A browser cannot put a header on a link or an event stream, and a page that stores the key exposes it to every script.
//! So the dashboard exchanges the key for a session, whose cookie no script can read and no other site's page sends along
//! (`HttpOnly`, `SameSite=Strict`). A request that only reads needs the cookie alone. One that changes something also needs
//! the header `X-Vantage-Session`: a page of another origin cannot send it without our consent (CORS), which we never give, not
//! even to the origins in `server.cors_origins`: their pages send the key.

use std::fmt;
use std::time::Instant;

use axum::extract::{Request, State};
use axum::http::header::{AUTHORIZATION, COOKIE, HOST, HeaderName, ORIGIN};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;

use super::client::{Client, forwarded_host};
use super::extract::header_text;
use super::hosts;
use super::keys::{KeyDigest, KeyName, digest_of, same};
use super::options::ServerOptions;
use super::problem::{ApiError, Code};
use super::router::ApiState;

/// Name of the cookie that holds the session id.
pub(super) const COOKIE_NAME: &str = "vantage_session";
/// Header that a request with a session cookie needs to change anything.
const SESSION_HEADER: HeaderName = HeaderName::from_static("x-vantage-session");

/// Detail of a refusal of another site's page, for operators too whose own page is taken for one.
const CROSS_SITE: &str = "the request came from another site's page; if it is the server's own page behind a reverse proxy, the \
                          proxy must pass on the browser's Host (nginx: proxy_set_header Host $http_host), or, as one of \
                          server.trusted_proxies, send it as X-Forwarded-Host, with a name that the server answers to \
                          (server.hosts)";

/// A key of the server. Its debug form does not show it.
#[derive(Clone, PartialEq, Eq, Deserialize)]
#[serde(transparent)]
pub struct ApiKey(String);

impl ApiKey {
    /// Returns true if the key can be sent in a header and is long enough to be a secret.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        (16..=256).contains(&self.0.len()) && self.0.bytes().all(|c| c.is_ascii_graphic() && c != b';' && c != b',')
    }

    /// Compares in constant time: all bytes of the two digests.
    #[must_use]
    pub fn matches(&self, presented: &str) -> bool {
        same(&self.digest(), &digest_of(presented))
    }

    /// SHA-256 of the key.
    pub(super) fn digest(&self) -> KeyDigest {
        digest_of(&self.0)
    }
}

impl fmt::Debug for ApiKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ApiKey(…)")
    }
}

/// Admits a request that has a key, or a session that was begun with one; handlers find the key's name with the request.
pub(super) async fn require_key(State(state): State<ApiState>, request: Request, next: Next) -> Response {
    let (mut parts, body) = request.into_parts();
    match check(&state, &parts) {
        Ok(name) => {
            if let Some(name) = name {
                tracing::Span::current().record("key", &*name.0);
                parts.extensions.insert(name);
            }
            next.run(Request::from_parts(parts, body)).await
        }
        Err(error) => {
            let mut response = error.into_response();
            response.headers_mut().insert("www-authenticate", HeaderValue::from_static("Bearer"));
            response
        }
    }
}

/// Name of the request's key; `None` where none is needed.
fn check(state: &ApiState, parts: &Parts) -> Result<Option<KeyName>, ApiError> {
    if !state.keys.are_required() {
        return Ok(None);
    }
    let (now, headers) = (Instant::now(), &parts.headers);
    if let Some(presented) = bearer_token(headers) {
        return state.keys.find(presented, now).map(Some).ok_or_else(|| {
            if let Some(times) = state.keys.count_wrong(now) {
                let client = Client::from_parts(parts, &state.options.trusted_proxies).address;
                tracing::warn!(%client, times, "a wrong key was presented; `times` counts those since the last such line");
            }
            ApiError::new(Code::KeyWrong, "this is not a key that the server was configured with")
        });
    }
    let missing = |detail: &str| Err(ApiError::new(Code::KeyMissing, detail));
    let Some(session) = session_id(headers) else {
        return missing("send the server's key as Authorization: Bearer …");
    };
    // A session ends with its key.
    let name = state.sessions.key_of(session, now).and_then(|digest| state.keys.name_of(&digest, now));
    if name.is_none() {
        return Err(ApiError::new(Code::SessionEnded, "the cookie's session has ended; begin a new one with the key"));
    }
    if is_change(&parts.method) && !headers.contains_key(SESSION_HEADER) {
        return missing("with a session, a request that changes something also needs the header X-Vantage-Session");
    }
    Ok(name)
}

/// Key or session that a request was admitted with, to be asked again while its answer goes on.
pub(super) enum Admission {
    /// Digest of the key in `Authorization`.
    Key(KeyDigest),
    /// Id of the session in the cookie.
    Session(String),
}

impl Admission {
    /// Admission of a request that [`require_key`] let pass; `None` where no key is needed.
    pub(super) fn of(state: &ApiState, headers: &HeaderMap) -> Option<Self> {
        let of_session = || session_id(headers).map(|id| Self::Session(id.to_owned()));
        let key = bearer_token(headers).map(|token| Self::Key(digest_of(token)));
        state.keys.are_required().then(|| key.or_else(of_session)).flatten()
    }

    /// Returns true while the key is one of the server's and the session is open. Asking is not a use of the session.
    pub(super) fn holds(&self, state: &ApiState, now: Instant) -> bool {
        let key = match self {
            Self::Key(digest) => Some(*digest),
            Self::Session(id) => state.sessions.begun_with(id, now),
        };
        key.is_some_and(|digest| state.keys.name_of(&digest, now).is_some())
    }
}

/// The bearer token in `Authorization`.
pub(super) fn bearer_token(headers: &HeaderMap) -> Option<&str> {
    let (scheme, token) = header_text(headers, &AUTHORIZATION)?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
}

/// The session id in the cookie. HTTP/2 may send one `Cookie` header per pair.
pub(super) fn session_id(headers: &HeaderMap) -> Option<&str> {
    let cookies = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok());
    let mut pairs = cookies.flat_map(|cookies| cookies.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.find(|(name, _)| *name == COOKIE_NAME).map(|(_, value)| value)
}

/// Returns true for a method by which a request changes something.
pub(super) fn is_change(method: &Method) -> bool {
    !matches!(*method, Method::GET | Method::HEAD | Method::OPTIONS)
}

/// Refuses a change that another site's page makes a browser send: without a key, reaching the port is all it takes. Pages of the
/// origins in `server.cors_origins` may.
pub(super) async fn refuse_cross_site(State(state): State<ApiState>, request: Request, next: Next) -> Response {
    let (parts, body) = request.into_parts();
    if is_change(&parts.method) && is_cross_site(&parts, &state.options) && !is_admitted(&parts.headers, &state) {
        return ApiError::new(Code::CrossSite, CROSS_SITE).into_response();
    }
    next.run(Request::from_parts(parts, body)).await
}

/// Returns true if the request comes from a page of an origin in `server.cors_origins`.
fn is_admitted(headers: &HeaderMap, state: &ApiState) -> bool {
    header_text(headers, &ORIGIN).is_some_and(|origin| state.options.cors_origins.iter().any(|admitted| admitted == origin))
}

fn is_cross_site(parts: &Parts, options: &ServerOptions) -> bool {
    if let Some(site) = parts.headers.get("sec-fetch-site") {
        return site != "same-origin" && site != "none";
    }
    // Browsers without Sec-Fetch-Site, and all of them over plain HTTP, send the page's origin.
    let Some(origin) = header_text(&parts.headers, &ORIGIN) else { return false };
    let Some((_, origin_host)) = origin.split_once("://") else { return true };
    if header_text(&parts.headers, &HOST).is_some_and(|host| origin_host.eq_ignore_ascii_case(host)) {
        return false;
    }
    // Another site may make its own name lead to the proxy: as of `Host`, only names that the server answers to are believed.
    let forwarded = forwarded_host(parts, &options.trusted_proxies).map(str::to_ascii_lowercase);
    forwarded.is_none_or(|host| !origin_host.eq_ignore_ascii_case(&host) || !hosts::is_answered(&host, options))
}

#[cfg(test)]
mod tests {
    use std::net::IpAddr;

    use axum::http::Request;

    use super::*;
    use crate::http::client::Peer;

    const PROXY: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1));
    const OTHER: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 2));

    fn parts(peer: IpAddr, headers: &[(&str, &str)]) -> Parts {
        let request = Request::builder().extension(Peer(peer)).header(HOST, "127.0.0.1:8080");
        let request = headers.iter().fold(request, |request, (name, value)| request.header(*name, *value));
        request.body(()).expect("a request").into_parts().0
    }

    #[test]
    fn the_host_that_a_trusted_proxy_was_asked_for_is_ours_if_we_answer_to_it() {
        let options = ServerOptions {
            trusted_proxies: vec![PROXY.into()],
            hosts: vec!["planner".to_owned()],
            ..ServerOptions::for_tests()
        };
        for (peer, origin, forwarded, is_cross) in [
            (PROXY, "http://127.0.0.1:8080", "", false),
            (PROXY, "http://planner", "", true),
            (PROXY, "http://planner", "planner", false),
            (PROXY, "http://Planner:81", "PLANNER:81", false),
            (PROXY, "http://planner", "evil.example, planner", false),
            (PROXY, "http://planner:81", "planner", true),
            (PROXY, "http://evil.example", "planner", true),
            (PROXY, "http://evil.example", "evil.example, planner", true),
            // A name that leads to the proxy, but is not ours.
            (PROXY, "http://evil.example", "evil.example", true),
            (PROXY, "null", "planner", true),
            (OTHER, "http://planner", "planner", true),
        ] {
            let parts = parts(peer, &[("origin", origin), ("x-forwarded-host", forwarded)]);
            assert_eq!(is_cross_site(&parts, &options), is_cross, "{peer} {origin} {forwarded:?}");
        }
        // What the browser itself says goes before.
        let parts =
            parts(PROXY, &[("sec-fetch-site", "cross-site"), ("origin", "http://planner"), ("x-forwarded-host", "planner")]);
        assert!(is_cross_site(&parts, &options));
    }
}
