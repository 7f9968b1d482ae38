//! Middleware of every request: its id, its entry in the log and the metrics, uniform problem responses, security headers;
//! time limits on pauses of the body and on the response; what pages of other origins may do.

use std::any::Any;
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::header::{
    ACCEPT_RANGES, AUTHORIZATION, CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_ENCODING, CONTENT_RANGE, CONTENT_SECURITY_POLICY,
    CONTENT_TYPE, ETAG, HeaderName, IF_MATCH, IF_NONE_MATCH, IF_RANGE, LOCATION, RANGE, REFERRER_POLICY, RETRY_AFTER,
    TRANSFER_ENCODING, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tower_http::cors::CorsLayer;
use tower_http::timeout::TimeoutBody;
use tracing::Instrument;
use tracing::field::Empty;
use uuid::Uuid;

use super::auth::is_change;
use super::client::Client;
use super::connection_limiter::ExceededLimit;
use super::extract::header_text;
use super::prefix::Prefix;
use super::problem::{self, ApiError, Code};
use super::router::ApiState;
use crate::service::metrics;

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// Content security policy of our pages: our own files, nothing inline and nothing from elsewhere.
const POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; object-src 'none'",
);

/// Adds id, log span and metrics to a request, and finishes its response. The outermost layer.
pub(super) async fn observe(State(state): State<ApiState>, request: Request, next: Next) -> Response {
    let began = Instant::now();
    let id = request_id(request.headers());
    let path = request.uri().path().to_owned();
    let method = request.method().clone();
    let route = request.extensions().get::<MatchedPath>().map_or("none".to_owned(), |route| route.as_str().to_owned());
    let span = tracing::info_span!("request", %id, %method, path, client = Empty, key = Empty);
    let idle = state.options.body_idle_timeout;
    let (mut parts, body) = request.into_parts();
    let prefix = Prefix::of(&parts, &state.options);
    parts.extensions.insert(prefix.clone());
    if parts.method == Method::HEAD {
        // A range is one of a GET alone (RFC 9110, section 14.2); the headers of a HEAD are those of the whole.
        parts.headers.remove(RANGE);
    }
    span.record("client", tracing::field::display(Client::from_parts(&parts, &state.options.trusted_proxies).address));
    let request = Request::from_parts(parts, Body::new(TimeoutBody::new(idle, body)));
    let response = next.run(request).instrument(span.clone()).await;
    let _entered = span.enter();
    let mut response = problem::finish(response, &prefix, &path, &id);
    set_headers(response.headers_mut(), &id);
    let (status, seconds) = (response.status().as_u16(), began.elapsed().as_secs_f64());
    count(&method, &route, status, seconds);
    if is_told(&method, &route, status) {
        tracing::info!(status, seconds, "done");
    } else {
        tracing::debug!(status, seconds, "answered");
    }
    response
}

/// Counts a response.
fn count(method: &Method, route: &str, status: u16, seconds: f64) {
    // A method that a client invents must not become a time series.
    let method = match *method {
        Method::GET | Method::HEAD | Method::POST | Method::PUT | Method::DELETE | Method::OPTIONS | Method::PATCH => {
            method.as_str()
        }
        _ => "other",
    };
    metrics::record(|metrics| {
        metrics.http_requests.with_label_values(&[method, route, &status.to_string()]).inc();
        metrics.http_seconds.with_label_values(&[route]).observe(seconds);
    });
}

/// Returns true for a change that was made, of which the log tells whose it was. Renewals of a lease, which come several times a second, and
/// checks leave nothing behind.
fn is_told(method: &Method, route: &str, status: u16) -> bool {
    let is_kept = !matches!((method.as_str(), route), ("PUT", "/api/v1/leases/{id}") | ("POST", "/api/v1/check"));
    is_change(method) && (200..300).contains(&status) && is_kept
}

/// Max number of characters of a header that a message quotes.
const MAX_QUOTED: usize = 64;
/// Paths that are served on reserved connections.
const PROBES: [&str; 3] = ["/healthz", "/readyz", "/metrics"];
/// Routes of a POST that brings arm and table to rest.
const STOPS: [&str; 2] = ["/api/v1/runs/{id}/pause", "/api/v1/runs/{id}/stop"];

/// Returns true for a request to pause or to stop a run. No limit of connections and no header of its body refuses it: arm and table would
/// go on moving.
fn brings_to_rest(request: &Request) -> bool {
    let route = request.extensions().get::<MatchedPath>().map(|route| route.as_str().trim_end_matches('/'));
    request.method() == Method::POST && route.is_some_and(|route| STOPS.contains(&route))
}

/// Refuses everything but probes, pauses and stops on a reserved connection, which then closes.
pub(super) async fn restrict_reserve(request: Request, next: Next) -> Response {
    let Some(limit) = request.extensions().get::<ExceededLimit>().copied() else { return next.run(request).await };
    if PROBES.contains(&request.uri().path()) || brings_to_rest(&request) {
        return next.run(request).await;
    }
    let detail = match limit {
        ExceededLimit::Address => {
            "this address, of IPv6 its /64, has the maximum number of connections open (server.max_connections_per_address)"
        }
        ExceededLimit::Server => "the server has the maximum number of connections open (server.max_connections)",
    };
    ApiError::new(limit.code(), detail).into_response()
}

/// Refuses a body in another transfer coding than `chunked` (RFC 9112, section 6.1): hyper takes the chunks apart, and would hand on
/// what is compressed in them as if it were the body. A pause or a stop is let pass: its body is never read.
pub(super) async fn refuse_transfer_codings(request: Request, next: Next) -> Response {
    match transfer_codings(request.headers()).as_str() {
        "" | "chunked" => next.run(request).await,
        _ if brings_to_rest(&request) => next.run(request).await,
        codings => {
            let quoted: String = codings.chars().take(MAX_QUOTED).collect();
            let detail = format!("the Transfer-Encoding is {quoted:?}; send the body without it, or as chunked");
            ApiError::at(Code::UnsupportedTransferCoding, "Transfer-Encoding", detail).into_response()
        }
    }
}

/// The transfer codings of a body, in the order in which they were applied, in lower case.
fn transfer_codings(headers: &HeaderMap) -> String {
    let values = headers.get_all(TRANSFER_ENCODING).iter().map(|value| String::from_utf8_lossy(value.as_bytes()).to_lowercase());
    let lists = values.collect::<Vec<_>>().join(",");
    lists.split(',').map(str::trim).filter(|coding| !coding.is_empty()).collect::<Vec<_>>().join(", ")
}

/// The client's own id if it can be logged safely, else a new one.
fn request_id(headers: &HeaderMap) -> String {
    let fits = |id: &&str| (1..=128).contains(&id.len()) && id.bytes().all(|c| c.is_ascii_graphic());
    header_text(headers, &REQUEST_ID).filter(fits).map_or_else(|| Uuid::now_v7().to_string(), str::to_owned)
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
    if headers.contains_key(CONTENT_ENCODING) {
        weaken(headers);
    }
}

/// Makes the entity tag of a response weak: it is a hash of the uncompressed bytes, and compressed ones are sent, or would be.
pub(super) fn weaken(headers: &mut HeaderMap) {
    if let Some(weak) =
        header_text(headers, &ETAG).filter(|tag| tag.starts_with('"')).and_then(|tag| format!("W/{tag}").parse().ok())
    {
        headers.insert(ETAG, weak);
    }
}

/// Answers OPTIONS with 204 where there is a route (RFC 9110, section 9.3.7). The router, which refuses the method, adds `Allow` to that as
/// to its refusals.
pub(super) async fn answer_options(request: Request, next: Next) -> Response {
    let is_options = request.method() == Method::OPTIONS;
    let response = next.run(request).await;
    let is_route = is_options && response.status() == StatusCode::METHOD_NOT_ALLOWED;
    if is_route { StatusCode::NO_CONTENT.into_response() } else { response }
}

/// Answers 503 if the response does not begin within `request_timeout`.
pub(super) async fn limit_response_time(State(state): State<ApiState>, request: Request, next: Next) -> Response {
    match tokio::time::timeout(state.options.request_timeout, next.run(request)).await {
        Ok(response) => response,
        Err(_) => ApiError::new(Code::TooSlow, "the server did not respond in time").into_response(),
    }
}

/// The response to a request whose handler panicked.
pub(super) fn panic_response(panic: Box<dyn Any + Send>) -> Response {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
    tracing::error!(panic = text, "a handler panicked");
    ApiError::new(Code::Internal, "the request failed; the server's log has the cause under this request_id").into_response()
}

/// Time for which a browser may remember what an origin may do.
const PREFLIGHT_LIFETIME: Duration = Duration::from_secs(3600);

/// Layer that lets pages of these origins use the API from a browser; none without origins. They need the server's key, if it has
/// one: `Access-Control-Allow-Credentials` is never sent and `X-Vantage-Session` never allowed, so that a session remains our own
/// page's.
pub(super) fn cross_origin(origins: &[String]) -> Option<CorsLayer> {
    let origins: Vec<HeaderValue> = origins.iter().filter_map(|origin| origin.parse().ok()).collect();
    let named = HeaderName::from_static;
    let layer = || {
        CorsLayer::new()
            .allow_methods([Method::GET, Method::HEAD, Method::POST, Method::PUT, Method::PATCH, Method::DELETE])
            .allow_headers([
                AUTHORIZATION,
                CONTENT_TYPE,
                IF_MATCH,
                IF_NONE_MATCH,
                IF_RANGE,
                RANGE,
                REQUEST_ID,
                named("content-digest"),
                named("idempotency-key"),
                named("last-event-id"),
            ])
            .expose_headers([ACCEPT_RANGES, CONTENT_DISPOSITION, CONTENT_RANGE, ETAG, LOCATION, RETRY_AFTER, REQUEST_ID])
            .max_age(PREFLIGHT_LIFETIME)
    };
    (!origins.is_empty()).then(|| layer().allow_origin(origins))
}

#[cfg(test)]
mod tests {
    use axum::Router;
    use axum::middleware::from_fn;
    use axum::routing::post;
    use tower::ServiceExt as _;

    use super::*;

    #[test]
    fn the_log_tells_of_changes_that_were_made() {
        for (method, route, status, told) in [
            (Method::DELETE, "/api/v1/jobs/{id}", 204, true),
            (Method::PUT, "/api/v1/scanners/{name}", 201, true),
            (Method::POST, "/api/v1/runs/{id}/arm", 202, true),
            (Method::DELETE, "/api/v1/jobs/{id}", 404, false),
            (Method::DELETE, "/api/v1/jobs/{id}", 401, false),
            (Method::GET, "/api/v1/jobs/{id}", 200, false),
            (Method::PUT, "/api/v1/leases/{id}", 200, false),
            (Method::DELETE, "/api/v1/leases/{id}", 204, true),
            (Method::POST, "/api/v1/check", 200, false),
        ] {
            assert_eq!(is_told(&method, route, status), told, "{method} {route} {status}");
        }
    }

    /// A refusal would leave arm and table moving.
    #[tokio::test]
    async fn a_pause_and_a_stop_are_let_pass_in_any_transfer_coding_and_on_a_reserved_connection() {
        let done = || async { "done" };
        let router: Router = Router::new()
            .route("/api/v1/runs/{id}/pause", post(done))
            .route("/api/v1/runs/{id}/stop", post(done))
            .route("/api/v1/runs/{id}/stop/", post(done))
            .route("/api/v1/runs/{id}/resume", post(done))
            .layer(from_fn(refuse_transfer_codings))
            .layer(from_fn(restrict_reserve));
        for (command, is_obeyed) in [("pause", true), ("stop", true), ("stop/", true), ("resume", false)] {
            let request = || axum::http::Request::post(format!("/api/v1/runs/7/{command}"));
            let coded = request().header(TRANSFER_ENCODING, "gzip, chunked").body(Body::empty()).expect("a request");
            let reserved = request().extension(ExceededLimit::Server).body(Body::empty()).expect("a request");
            for (request, refusal) in [(coded, StatusCode::NOT_IMPLEMENTED), (reserved, StatusCode::SERVICE_UNAVAILABLE)] {
                let answer = router.clone().oneshot(request).await.expect("an answer");
                assert_eq!(answer.status(), if is_obeyed { StatusCode::OK } else { refusal }, "{command}");
            }
        }
    }

    #[tokio::test]
    async fn a_body_comes_in_chunks_and_in_no_other_transfer_coding() {
        let router: Router = Router::new().route("/", post(|| async { "well" })).layer(from_fn(refuse_transfer_codings));
        for (lists, status) in [
            (&["chunked"][..], StatusCode::OK),
            (&[], StatusCode::OK),
            (&[" , Chunked"], StatusCode::OK),
            (&["gzip, chunked"], StatusCode::NOT_IMPLEMENTED),
            (&["gzip", "chunked"], StatusCode::NOT_IMPLEMENTED),
            (&["chunked, chunked"], StatusCode::NOT_IMPLEMENTED),
            (&["gz\u{e4}p, chunked"], StatusCode::NOT_IMPLEMENTED),
        ] {
            let mut request = axum::http::Request::post("/");
            for list in lists {
                request = request.header(TRANSFER_ENCODING, HeaderValue::from_bytes(list.as_bytes()).expect("a value"));
            }
            let answer = router.clone().oneshot(request.body(Body::empty()).expect("a request")).await.expect("an answer");
            assert_eq!(answer.status(), status, "{lists:?}");
            let error = answer.extensions().get::<ApiError>().map(ApiError::code);
            assert_eq!(error, (status != StatusCode::OK).then_some(Code::UnsupportedTransferCoding), "{lists:?}");
        }
    }
}
