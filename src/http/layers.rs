//! What happens to every request: its id, its line in log and metrics, problems in their one shape, headers that browsers
//! need; a limit on how long its body may pause and on how long its answer may take.

use std::any::Any;
use std::time::Instant;

use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_ENCODING, CONTENT_SECURITY_POLICY, ETAG, HeaderName, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderValue};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tower_http::timeout::TimeoutBody;
use tracing::Instrument;
use uuid::Uuid;

use super::client::Client;
use super::extract::text;
use super::places::Full;
use super::problem::{self, Code, Problem};
use super::router::Site;

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// What a page of ours may load: our own files, nothing inline and nothing from elsewhere.
const POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; object-src 'none'",
);

/// The outermost layer.
pub(super) async fn observe(State(site): State<Site>, request: Request, next: Next) -> Response {
    let began = Instant::now();
    let id = request_id(request.headers());
    let path = request.uri().path().to_owned();
    let method = request.method().clone();
    let route = request.extensions().get::<MatchedPath>().map_or("none".to_owned(), |route| route.as_str().to_owned());
    let span = tracing::info_span!("request", %id, %method, path, client = tracing::field::Empty);
    let idle = site.options.body_idle_timeout;
    let (parts, body) = request.into_parts();
    span.record("client", tracing::field::display(Client::of(&parts, &site.options.trusted_proxies).address));
    let request = Request::from_parts(parts, Body::new(TimeoutBody::new(idle, body)));
    let response = next.run(request).instrument(span.clone()).await;
    let _entered = span.enter();
    let mut response = problem::finish(response, &path, &id);
    set_headers(response.headers_mut(), &id);
    let (status, seconds) = (response.status().as_u16(), began.elapsed().as_secs_f64());
    super::metrics::count_request(&method, &route, status, seconds);
    tracing::debug!(status, seconds, "answered");
    response
}

/// What is answered in places of the reserve: whether the server lives, whether it takes work, and its numbers.
const PROBES: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// Refuses everything but probes on a connection that has a place of the reserve, and lets it end.
pub(super) async fn keep_reserve(request: Request, next: Next) -> Response {
    let Some(full) = request.extensions().get::<Full>().copied() else { return next.run(request).await };
    if PROBES.contains(&request.uri().path()) {
        return next.run(request).await;
    }
    let detail = match full {
        Full::Address => "this address has as many connections as one may have (server.max_connections_per_address)",
        Full::Server => "the server has as many connections as it may have (server.max_connections)",
    };
    Problem::new(full.code(), detail).into_response()
}

/// The client's own id, where it is one that can be written to a log; else a new one.
fn request_id(headers: &HeaderMap) -> String {
    let fits = |id: &&str| (1..=128).contains(&id.len()) && id.bytes().all(|c| c.is_ascii_graphic());
    text(headers, &REQUEST_ID).filter(fits).map_or_else(|| Uuid::now_v7().to_string(), str::to_owned)
}

fn set_headers(headers: &mut HeaderMap, id: &str) {
    if let Ok(id) = id.parse() {
        headers.insert(REQUEST_ID, id);
    }
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert("cross-origin-resource-policy", HeaderValue::from_static("same-origin"));
    headers.entry(CONTENT_SECURITY_POLICY).or_insert(POLICY);
    headers.entry(CACHE_CONTROL).or_insert(HeaderValue::from_static("no-cache"));
    // A compressed answer has other bytes than the tag was made of: it is only equivalent.
    if headers.contains_key(CONTENT_ENCODING)
        && let Some(weak) =
            text(headers, &ETAG).filter(|tag| tag.starts_with('"')).and_then(|tag| format!("W/{tag}").parse().ok())
    {
        headers.insert(ETAG, weak);
    }
}

/// Ends an answer that takes too long to begin.
pub(super) async fn limit_time(State(site): State<Site>, request: Request, next: Next) -> Response {
    match tokio::time::timeout(site.options.request_timeout, next.run(request)).await {
        Ok(response) => response,
        Err(_) => Problem::new(Code::TooSlow, "the server could not answer in time").into_response(),
    }
}

/// The answer to a request whose handler panicked.
pub(super) fn panicked(panic: Box<dyn Any + Send>) -> Response {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
    tracing::error!(panic = text, "a handler panicked");
    Problem::new(Code::Internal, "the server could not do this; its log has the cause under this request_id").into_response()
}
