//! Documentation for API users: Swagger UI, embedded in the binary, and the pages of problems. Every link is relative, so that
//! all of it works below a path prefix too.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use axum::extract::Path;
use axum::http::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Redirect, Response};
use serde_json::{Value, json};
use utoipa_swagger_ui_vendored::SWAGGER_UI_VENDORED;
use zip::ZipArchive;

use super::negotiate::{Representation, choose};
use super::pages;
use super::prefix::Prefix;
use super::problem::{ApiError, Code};
use super::static_response::{StaticResponse, media_type};

/// Content security policy of Swagger UI, whose scripts set styles and whose images are `data:` URLs.
const UI_POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; base-uri 'none'; frame-ancestors 'none'",
);

/// Redirects to the documentation's folder, so that its relative links resolve.
pub(super) async fn redirect() -> Redirect {
    Redirect::permanent("docs/")
}

/// Start page of the documentation.
pub(super) async fn index(headers: HeaderMap) -> Result<Response, ApiError> {
    ui("index.html", &headers)
}

/// A file of the documentation. The OpenAPI document is served here too, since the one under `/api` may need the key.
pub(super) async fn file(Path(name): Path<String>, headers: HeaderMap) -> Result<Response, ApiError> {
    if name == "openapi.json" {
        return Ok(DOCUMENT_OF_UI.respond(&headers));
    }
    ui(&name, &headers)
}

/// The OpenAPI document for clients that reach the server below `prefix`.
pub(super) fn document(prefix: &Prefix, headers: &HeaderMap) -> Response {
    let path = prefix.at("");
    if path.is_empty() {
        return DOCUMENT.respond(headers);
    }
    let mut made = LAST_BELOW.lock().unwrap_or_else(PoisonError::into_inner);
    match &*made {
        Some((known, document)) if *known == path => document.respond(headers),
        _ => {
            let document = document_with(Some(&path));
            let response = document.respond(headers);
            *made = Some((path, document));
            response
        }
    }
}

/// The document for the prefix that was asked for last: there is hardly ever more than one.
static LAST_BELOW: Mutex<Option<(String, StaticResponse)>> = Mutex::new(None);

static DOCUMENT: LazyLock<StaticResponse> = LazyLock::new(|| document_with(None));

/// The document in the folder of Swagger UI, which takes the server's address to be relative to that of the document.
static DOCUMENT_OF_UI: LazyLock<StaticResponse> = LazyLock::new(|| document_with(Some("../")));

/// The OpenAPI document, with the address of the server if it is not the root.
fn document_with(server: Option<&str>) -> StaticResponse {
    // Serialising strings, numbers and maps with string keys cannot fail.
    let mut document = serde_json::to_value(super::openapi()).unwrap_or_default();
    if let (Value::Object(fields), Some(url)) = (&mut document, server) {
        fields.insert("servers".to_owned(), json!([{ "url": url }]));
    }
    StaticResponse::new(serde_json::to_vec(&document).unwrap_or_default(), "application/json".to_owned())
}

/// Cache of the Swagger UI files requested so far.
static UI: LazyLock<Mutex<BTreeMap<String, Arc<StaticResponse>>>> = LazyLock::new(Mutex::default);

fn ui(name: &str, headers: &HeaderMap) -> Result<Response, ApiError> {
    let cached = UI.lock().unwrap_or_else(PoisonError::into_inner).get(name).cloned();
    let file = match cached {
        Some(file) => file,
        None => {
            let missing = || ApiError::new(Code::NoSuchRoute, format!("the documentation has no file {name:?}"));
            let bytes = match name {
                "swagger-initializer.js" => INITIALIZER.as_bytes().to_vec(),
                _ => unpacked(name).ok_or_else(missing)?,
            };
            let bytes = if name == "index.html" { start_page(&bytes) } else { bytes };
            let file = Arc::new(StaticResponse::new(bytes, media_type(name).to_owned()));
            UI.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned(), Arc::clone(&file));
            file
        }
    };
    let mut response = file.respond(headers);
    response.headers_mut().insert(CONTENT_SECURITY_POLICY, UI_POLICY);
    Ok(response)
}

/// A file of Swagger UI, from the archive of its release: `swagger-ui-VERSION/dist/NAME`.
fn unpacked(name: &str) -> Option<Vec<u8>> {
    let mut archive = ZipArchive::new(Cursor::new(SWAGGER_UI_VENDORED)).ok()?;
    let folder = archive.name_for_index(0)?.ok()?.into_owned();
    let mut file = archive.by_name(&format!("{folder}dist/{name}")).ok().filter(|file| file.is_file())?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).ok()?;
    Some(bytes)
}

/// Script that starts Swagger UI on the document beside it.
const INITIALIZER: &str = r##"window.onload = () => {
  window.ui = SwaggerUIBundle({
    url: "openapi.json",
    dom_id: "#swagger-ui",
    deepLinking: true,
    layout: "StandaloneLayout",
    persistAuthorization: true,
    tryItOutEnabled: true,
    presets: [SwaggerUIBundle.presets.apis, SwaggerUIStandalonePreset],
    plugins: [SwaggerUIBundle.plugins.DownloadUrl],
  });
};
"##;

/// Start page of Swagger UI under the name of the API, with links to the server's other pages.
fn start_page(html: &[u8]) -> Vec<u8> {
    let named = String::from_utf8_lossy(html).replacen("<title>Swagger UI</title>", "<title>API – Vantage</title>", 1);
    named.replacen(MOUNT_POINT, &format!("{SEE_ALSO}{MOUNT_POINT}"), 1).into_bytes()
}

/// Element that Swagger UI fills.
const MOUNT_POINT: &str = "<div id=\"swagger-ui\"></div>";
/// Other pages of the server, relative to the folder of Swagger UI.
const SEE_ALSO: &str = "<nav style=\"max-width: 1460px; margin: 1rem auto 0; padding: 0 20px; font-family: sans-serif\">\
    <a href=\"../\">Dashboard</a> · <a href=\"../parameters\">Parameters</a> · <a href=\"../problems\">Problems</a></nav>\n";

/// Forms of the list of problems.
static PROBLEMS: [Representation; 2] = [
    Representation { name: "markdown", media_type: "text/markdown; charset=utf-8", file: Cow::Borrowed("problems.md") },
    Representation { name: "html", media_type: pages::HTML, file: Cow::Borrowed("problems.html") },
];

/// List the problem codes
///
/// Browsers get a page. The `type` of a problem is the path of its own page, `/problems/CODE`.
#[utoipa::path(
    get,
    path = "/problems",
    tag = "server",
    operation_id = "problems",
    responses((status = 200, description = "All problem codes with their status and meaning.", content_type = "text/markdown", body = String))
)]
pub(super) async fn problems(headers: HeaderMap) -> impl IntoResponse {
    let form = choose(&headers, None, &PROBLEMS).unwrap_or(&PROBLEMS[0]);
    let text = if form.name == "html" { pages::problems() } else { super::problem::document() };
    ([(CONTENT_TYPE, form.media_type)], text)
}

/// Page of the parameters of a plan.
pub(super) async fn parameters() -> impl IntoResponse {
    ([(CONTENT_TYPE, pages::HTML)], pages::parameters())
}

/// Page of a kind of problem.
pub(super) async fn problem(Path(code): Path<String>) -> Result<impl IntoResponse, ApiError> {
    let unknown = || ApiError::new(Code::NoSuchRoute, format!("there is no kind of problem with the code {code:?}"));
    let page = pages::problem(&code).ok_or_else(unknown)?;
    Ok(([(CONTENT_TYPE, pages::HTML)], page))
}
