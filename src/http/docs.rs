//! Documentation for API users: Swagger UI, embedded in the binary, and the list of problems.

use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use axum::extract::Path;
use axum::http::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Redirect, Response};
use utoipa_swagger_ui::Config;

use super::problem::{ApiError, Code};
use super::static_response::StaticResponse;

/// Content security policy of Swagger UI, whose scripts set styles and whose images are `data:` URLs.
const UI_POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; base-uri 'none'; frame-ancestors 'none'",
);

/// Redirects to the documentation's folder, so that its relative links resolve.
pub(super) async fn redirect() -> Redirect {
    Redirect::permanent("/docs/")
}

/// Start page of the documentation.
pub(super) async fn index(headers: HeaderMap) -> Result<Response, ApiError> {
    ui("index.html", &headers)
}

/// A file of the documentation. The OpenAPI document is served here too, since the one under `/api` may need the key.
pub(super) async fn file(Path(name): Path<String>, headers: HeaderMap) -> Result<Response, ApiError> {
    if name == "openapi.json" {
        return Ok(DOCUMENT.respond(&headers));
    }
    ui(&name, &headers)
}

/// The OpenAPI document.
pub(super) static DOCUMENT: LazyLock<StaticResponse> = LazyLock::new(|| {
    // Serialising strings, numbers and maps with string keys cannot fail.
    StaticResponse::new(serde_json::to_vec(&super::openapi()).unwrap_or_default(), "application/json".to_owned())
});

/// Cache of the Swagger UI files requested so far.
static UI: LazyLock<Mutex<BTreeMap<String, Arc<StaticResponse>>>> = LazyLock::new(Mutex::default);

fn ui(name: &str, headers: &HeaderMap) -> Result<Response, ApiError> {
    let cached = UI.lock().unwrap_or_else(PoisonError::into_inner).get(name).cloned();
    let file = match cached {
        Some(file) => file,
        None => {
            let config = Arc::new(Config::from("/docs/openapi.json").try_it_out_enabled(true).persist_authorization(true));
            let missing = || ApiError::new(Code::NoSuchRoute, format!("the documentation has no file {name:?}"));
            let file = utoipa_swagger_ui::serve(name, config).ok().flatten().ok_or_else(missing)?;
            let file = Arc::new(StaticResponse::new(file.bytes.into_owned(), file.content_type));
            UI.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned(), Arc::clone(&file));
            file
        }
    };
    let mut response = file.respond(headers);
    response.headers_mut().insert(CONTENT_SECURITY_POLICY, UI_POLICY);
    Ok(response)
}

/// List the problem codes
///
/// The `type` of a problem links to its row of this list.
#[utoipa::path(
    get,
    path = "/problems",
    tag = "server",
    operation_id = "problems",
    responses((status = 200, description = "All problem codes with their status and meaning.", content_type = "text/markdown", body = String))
)]
pub(super) async fn problems() -> impl IntoResponse {
    ([(CONTENT_TYPE, "text/markdown; charset=utf-8")], super::problem::document())
}
