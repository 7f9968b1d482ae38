//! The interface described: the OpenAPI document's frame, Swagger UI out of the binary, and the list of problems.

use std::sync::Arc;

use axum::extract::Path;
use axum::http::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::http::{HeaderValue, StatusCode};
use axum::response::{IntoResponse, Redirect, Response};
use utoipa::ToSchema;
use utoipa::openapi::path::Operation;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::openapi::{ContentBuilder, OpenApi, Ref, ResponseBuilder, SecurityRequirement};
use utoipa_swagger_ui::Config;

use super::problem::{Code, PROBLEM_JSON, Problem};
use crate::wire;

/// The document's frame; the routes add themselves.
#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "Vantage",
        description = "Plans automated 3D scans: mesh and cell in; viewpoints, proof of coverage, reasons for what is missed, \
                       collision-free motion and robot program out.\n\nUnits are in the keys. Unknown fields are refused. \
                       Every answer that is not 2xx or 3xx is a problem (RFC 9457) with a stable `code`.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
        contact()
    ),
    tags(
        (name = "meshes", description = "Parts and fixtures."),
        (name = "specifications", description = "Scanners, robots, turntables and cells."),
        (name = "jobs", description = "Planning."),
        (name = "results", description = "What came out of a job."),
        (name = "events", description = "What happens to jobs, as it happens."),
        (name = "server", description = "The server itself.")
    ),
    components(schemas(wire::Problem, wire::JobEvent))
)]
pub(super) struct ApiDoc;

/// Unit of length of a mesh file.
#[derive(ToSchema)]
#[schema(rename_all = "lowercase")]
#[expect(dead_code, reason = "only its schema is used; the geometry room knows no schemas")]
pub(super) enum Unit {
    Mm,
    Cm,
    M,
    Inch,
}

/// Bytes.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "only its schema is used")]
pub(super) struct Bytes(Vec<u8>);

/// Adds what all routes share: that they may answer with a problem, and the key.
pub(super) fn complete(openapi: &mut OpenApi) {
    for (path, item) in &mut openapi.paths.paths {
        let operations = [&mut item.get, &mut item.put, &mut item.post, &mut item.delete];
        for operation in operations.into_iter().flatten() {
            add_problems(operation);
            if path.starts_with("/api/") {
                let keys = [SecurityRequirement::default(), SecurityRequirement::new::<_, _, &str>("key", [])];
                operation.security = Some(keys.into());
            }
        }
    }
    let key = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some("The server's key, where it has one.")).build();
    openapi.components.get_or_insert_default().add_security_scheme("key", SecurityScheme::Http(key));
}

fn add_problems(operation: &mut Operation) {
    let schema = Ref::from_schema_name("Problem");
    let content = ContentBuilder::new().schema(Some(schema)).build();
    for (status, description) in [("4XX", "The request is refused; `code` says why."), ("5XX", "The server cannot do this now.")]
    {
        let response = ResponseBuilder::new().description(description).content(PROBLEM_JSON, content.clone()).build();
        operation.responses.responses.insert(status.to_owned(), response.into());
    }
}

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
