//! The interface described for people: Swagger UI out of the binary, and the list of problems.

use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use axum::extract::Path;
use axum::http::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Redirect, Response};
use utoipa_swagger_ui::Config;

use super::packed::Packed;
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
pub(super) async fn index(headers: HeaderMap) -> Result<Response, Problem> {
    ui("index.html", &headers)
}

/// A file of the documentation. The document lies beside it, since the one under `/api` may need the key.
pub(super) async fn file(Path(name): Path<String>, headers: HeaderMap) -> Result<Response, Problem> {
    if name == "openapi.json" {
        return Ok(DOCUMENT.answer(&headers));
    }
    ui(&name, &headers)
}

/// The OpenAPI document.
pub(super) static DOCUMENT: LazyLock<Packed> = LazyLock::new(|| {
    // Strings, numbers and maps with string keys: it cannot fail.
    Packed::new(serde_json::to_vec(&super::openapi()).unwrap_or_default(), "application/json".to_owned())
});

/// Files of Swagger UI that were asked for.
static UI: LazyLock<Mutex<BTreeMap<String, Arc<Packed>>>> = LazyLock::new(Mutex::default);

fn ui(name: &str, headers: &HeaderMap) -> Result<Response, Problem> {
    let known = UI.lock().unwrap_or_else(PoisonError::into_inner).get(name).cloned();
    let file = match known {
        Some(file) => file,
        None => {
            let config = Arc::new(Config::from("/docs/openapi.json").try_it_out_enabled(true).persist_authorization(true));
            let nothing = || Problem::new(Code::NoSuchRoute, format!("the documentation has no file {name:?}"));
            let file = utoipa_swagger_ui::serve(name, config).ok().flatten().ok_or_else(nothing)?;
            let file = Arc::new(Packed::new(file.bytes.into_owned(), file.content_type));
            UI.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned(), Arc::clone(&file));
            file
        }
    };
    let mut response = file.answer(headers);
    response.headers_mut().insert(CONTENT_SECURITY_POLICY, UI_POLICY);
    Ok(response)
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
