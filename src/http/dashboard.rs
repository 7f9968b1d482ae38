//! The dashboard at `/`: the files of `static/dist/`, embedded in the binary, compressed. They are built from `static/src/` by
//! `npm run build` and committed, so that a build of the program needs no Node.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use axum::extract::Path;
use axum::http::HeaderMap;
use axum::response::Response;

use super::problem::{ApiError, Code};
use super::static_response::{StaticResponse, media_type};

/// Names and compressed bytes, from the build script.
const FILES: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/dashboard.rs"));

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
    static RESPONSES: LazyLock<BTreeMap<&str, StaticResponse>> = LazyLock::new(|| {
        let read = |&(name, gzip): &(&'static str, &'static [u8])| {
            let response = StaticResponse::of_gzip(gzip, media_type(name).to_owned());
            (name, response.expect("the build script compressed it"))
        };
        FILES.iter().map(read).collect()
    });
    let file = RESPONSES.get(name).ok_or_else(|| ApiError::new(Code::NoSuchRoute, format!("there is no file {name:?}")))?;
    Ok(file.respond(headers))
}
