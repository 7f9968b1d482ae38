//! The dashboard at `/`: the files of `static/dist/`, embedded in the binary. They are built from `static/src/` by
//! `npm run build` and committed, so that a build of the program needs no Node.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use axum::extract::Path;
use axum::http::HeaderMap;
use axum::response::Response;
use rust_embed::RustEmbed;

use super::problem::{ApiError, Code};
use super::static_response::{StaticResponse, media_type};

#[derive(RustEmbed)]
#[folder = "static/dist/"]
struct Files;

/// The dashboard page.
pub(super) async fn index(headers: HeaderMap) -> Result<Response, ApiError> {
    serve("index.html", &headers)
}

/// A script, style sheet or image of the dashboard.
pub(super) async fn asset(Path(name): Path<String>, headers: HeaderMap) -> Result<Response, ApiError> {
    serve(&name, &headers)
}

/// Licences of the third-party software in the dashboard.
pub(super) async fn licences(headers: HeaderMap) -> Result<Response, ApiError> {
    serve("licences.txt", &headers)
}

fn serve(name: &str, headers: &HeaderMap) -> Result<Response, ApiError> {
    static FILES: LazyLock<BTreeMap<String, StaticResponse>> = LazyLock::new(|| {
        let named = Files::iter().filter_map(|name| Files::get(&name).map(|file| (name, file)));
        named
            .map(|(name, file)| (name.to_string(), StaticResponse::new(file.data.into_owned(), media_type(&name).to_owned())))
            .collect()
    });
    let file = FILES.get(name).ok_or_else(|| ApiError::new(Code::NoSuchRoute, format!("there is no file {name:?}")))?;
    Ok(file.respond(headers))
}
