//! The page at `/`: files of `static/`, out of the binary.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use axum::extract::Path;
use axum::http::HeaderMap;
use axum::response::Response;
use rust_embed::RustEmbed;

use super::packed::Packed;
use super::problem::{Code, Problem};

#[derive(RustEmbed)]
#[folder = "static/"]
struct Files;

/// The page.
pub(super) async fn index(headers: HeaderMap) -> Result<Response, Problem> {
    serve("index.html", &headers)
}

/// A script, style or picture of the page.
pub(super) async fn asset(Path(name): Path<String>, headers: HeaderMap) -> Result<Response, Problem> {
    serve(&name, &headers)
}

fn serve(name: &str, headers: &HeaderMap) -> Result<Response, Problem> {
    static PACKED: LazyLock<BTreeMap<String, Packed>> = LazyLock::new(|| {
        let named = Files::iter().filter_map(|name| Files::get(&name).map(|file| (name, file)));
        named.map(|(name, file)| (name.to_string(), Packed::new(file.data.into_owned(), media_type(&name).to_owned()))).collect()
    });
    let file = PACKED.get(name).ok_or_else(|| Problem::new(Code::NoSuchRoute, format!("there is no file {name:?}")))?;
    Ok(file.answer(headers))
}

fn media_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map_or("", |(_, extension)| extension) {
        "html" => "text/html; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "svg" => "image/svg+xml",
        _ => "application/octet-stream",
    }
}
