//! Sessions of browsers: a cookie in exchange for the key.

use std::time::Instant;

use axum::extract::State;
use axum::http::header::SET_COOKIE;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};

use crate::http::auth::{COOKIE_NAME, bearer, session};
use crate::http::client::Client;
use crate::http::extract::Params;
use crate::http::problem::{Code, Problem};
use crate::http::router::Site;

/// Begin a session
///
/// For pages: in exchange for the key, a cookie that no script can read. It serves for reading; with the header
/// `X-Vantage-Session` also for changing. A session that is not used for 12 hours is over. A server without a key needs
/// none and sets no cookie.
#[utoipa::path(
    post,
    path = "/session",
    tag = "server",
    operation_id = "begin_session",
    responses((status = 204, description = "It has begun.",
        headers(("Set-Cookie" = String, description = "`vantage_session`, `HttpOnly` and `SameSite=Strict`."))))
)]
pub(in crate::http) async fn begin(
    State(site): State<Site>,
    client: Client,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    params.end()?;
    if site.options.api_key.is_none() {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    // That it is the right one has been looked at on the way here; a session begins no other.
    if bearer(&headers).is_none() {
        return Err(Problem::new(Code::KeyMissing, "a session begins with the key: send it as Authorization: Bearer …"));
    }
    let id = site.sessions.begin(Instant::now()).map_err(|error| {
        tracing::error!(%error, "the system gives no random numbers");
        Problem::new(Code::Internal, "the server has no random numbers for a session")
    })?;
    Ok((StatusCode::NO_CONTENT, [(SET_COOKIE, cookie(&id, client.is_https, ""))]).into_response())
}

/// End the session
///
/// The one of the cookie that the request carries, if any; the cookie is taken back.
#[utoipa::path(
    delete,
    path = "/session",
    tag = "server",
    operation_id = "end_session",
    responses((status = 204, description = "It is over.",
        headers(("Set-Cookie" = String, description = "Takes the cookie back."))))
)]
pub(in crate::http) async fn end(State(site): State<Site>, params: Params, headers: HeaderMap) -> Result<Response, Problem> {
    params.end()?;
    if let Some(id) = session(&headers) {
        site.sessions.end(id);
    }
    Ok((StatusCode::NO_CONTENT, [(SET_COOKIE, cookie("", false, "; Max-Age=0"))]).into_response())
}

/// Lives as long as the browser, is no business of scripts, and is not sent along with other sites' requests.
fn cookie(id: &str, is_https: bool, rest: &str) -> String {
    let secure = if is_https { "; Secure" } else { "" };
    format!("{COOKIE_NAME}={id}; Path=/; HttpOnly; SameSite=Strict{secure}{rest}")
}
