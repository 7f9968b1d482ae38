//! The interface described for people: Swagger UI out of the binary, and the list of problems.

use std::sync::Arc;

use axum::extract::Path;
use axum::http::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::http::{HeaderValue, StatusCode};
use axum::response::{IntoResponse, Redirect, Response};
use utoipa_swagger_ui::Config;

use super::problem::{Code, Problem};

/// Swagger UI sets styles from its scripts and has pictures as data.
const UI_POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; base-uri 'none'; frame-ancestors 'none'",
);

/// To the documentation's folder, so that its relative links hold.
pub(super) async fn redirect() -> Redirect {
    Redirect::permanent("/docs/")
}

/// The documentation.
pub(super) async fn index() -> Result<Response, Problem> {
    ui("index.html")
}

/// A file of the documentation. The document lies beside it, since the one under `/api` may need the key.
pub(super) async fn file(Path(name): Path<String>) -> Result<Response, Problem> {
    if name == "openapi.json" {
        return Ok(axum::Json(super::openapi()).into_response());
    }
    ui(&name)
}

fn ui(name: &str) -> Result<Response, Problem> {
    let config = Arc::new(Config::from("/docs/openapi.json").try_it_out_enabled(true).persist_authorization(true));
    let nothing = || Problem::new(Code::NoSuchRoute, format!("the documentation has no file {name:?}"));
    let file = utoipa_swagger_ui::serve(name, config).ok().flatten().ok_or_else(nothing)?;
    let kind = HeaderValue::from_str(&file.content_type).unwrap_or(HeaderValue::from_static("application/octet-stream"));
    let headers = [(CONTENT_TYPE, kind), (CONTENT_SECURITY_POLICY, UI_POLICY)];
    Ok((StatusCode::OK, headers, file.bytes.into_owned()).into_response())
}

/// Kinds of problem
///
/// What `type` of a problem points to.
#[utoipa::path(
    get,
    path = "/problems",
    tag = "server",
    operation_id = "problems",
    responses((status = 200, description = "Every kind of problem, as Markdown.", content_type = "text/markdown", body = String))
)]
pub(super) async fn problems() -> impl IntoResponse {
    ([(CONTENT_TYPE, "text/markdown; charset=utf-8")], super::problem::document())
}
