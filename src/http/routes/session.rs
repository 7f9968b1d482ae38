//! Browser sessions: a cookie in exchange for the key.

use std::time::Instant;

use axum::extract::State;
use axum::http::header::SET_COOKIE;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};

use crate::http::auth::{COOKIE_NAME, bearer_token, session_id};
use crate::http::client::Client;
use crate::http::extract::Params;
use crate::http::keys::digest_of;
use crate::http::prefix::Prefix;
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;

/// Begin a session
///
/// For web pages: exchanges the key for a cookie that no script can read. The cookie authorises requests that only read,
/// and, together with the header `X-Vantage-Session`, requests that change something. A session ends after 12 hours
/// without use. An open stream of events is no use of its session and ends with it. A server without a key sets no cookie.
#[utoipa::path(
    post,
    path = "/session",
    tag = "server",
    operation_id = "begin_session",
    responses((status = 204, description = "The session has begun.",
        headers(("Set-Cookie" = String, description = "`vantage_session`, `HttpOnly` and `SameSite=Strict`."))))
)]
pub(in crate::http) async fn begin(
    State(state): State<ApiState>,
    client: Client,
    prefix: Prefix,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    if !state.keys.are_required() {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    // The middleware has checked the key; a session alone must not begin another one.
    let Some(key) = bearer_token(&headers) else {
        return Err(ApiError::new(Code::KeyMissing, "beginning a session requires the key: send it as Authorization: Bearer …"));
    };
    let id = state.sessions.begin(digest_of(key), Instant::now()).map_err(|error| {
        tracing::error!(%error, "the system provides no random numbers");
        ApiError::new(Code::Internal, "the server could not create a session id")
    })?;
    Ok((StatusCode::NO_CONTENT, [(SET_COOKIE, cookie(&id, &prefix, client.is_https, ""))]).into_response())
}

/// End the session
///
/// Ends the session of the request's cookie, if any, and deletes the cookie.
#[utoipa::path(
    delete,
    path = "/session",
    tag = "server",
    operation_id = "end_session",
    responses((status = 204, description = "The session has ended.",
        headers(("Set-Cookie" = String, description = "Deletes the cookie."))))
)]
pub(in crate::http) async fn end(
    State(state): State<ApiState>,
    prefix: Prefix,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    if let Some(id) = session_id(&headers) {
        state.sessions.end(id);
    }
    Ok((StatusCode::NO_CONTENT, [(SET_COOKIE, cookie("", &prefix, false, "; Max-Age=0"))]).into_response())
}

/// The session cookie: kept until the browser closes, hidden from scripts, not sent with other sites' requests.
fn cookie(id: &str, prefix: &Prefix, is_https: bool, rest: &str) -> String {
    let (path, secure) = (prefix.at("/"), if is_https { "; Secure" } else { "" });
    format!("{COOKIE_NAME}={id}; Path={path}; HttpOnly; SameSite=Strict{secure}{rest}")
}
