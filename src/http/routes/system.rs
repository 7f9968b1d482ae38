//! Questions about the server itself.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};

use crate::http::docs::DOCUMENT;
use crate::http::extract::Params;
use crate::http::problem::{Code, Problem};
use crate::http::router::Site;
use crate::wire::{Health, ProblemField, Readiness, Version};

/// Whether the process answers
#[utoipa::path(
    get,
    path = "/healthz",
    tag = "server",
    operation_id = "healthz",
    responses((status = 200, description = "It does.", body = Health))
)]
pub(in crate::http) async fn healthz() -> axum::Json<Health> {
    axum::Json(Health { status: "ok".to_owned() })
}

/// Whether the server takes work
///
/// Writes to the store to know. 503 says what does not hold.
#[utoipa::path(
    get,
    path = "/readyz",
    tag = "server",
    operation_id = "readyz",
    responses((status = 200, description = "It does.", body = Readiness))
)]
pub(in crate::http) async fn readyz(State(site): State<Site>) -> Result<axum::Json<Readiness>, Problem> {
    let checks = site.app.readiness().await;
    let broken = |name: &str| ProblemField { pointer: name.to_owned(), detail: "does not hold".to_owned() };
    let errors: Vec<_> = checks.iter().filter(|check| !check.ok).map(|check| broken(&check.name)).collect();
    if errors.is_empty() {
        return Ok(axum::Json(Readiness { status: "ready".to_owned(), checks }));
    }
    Err(Problem::new(Code::NotReady, "the server cannot take work now").with_errors(errors))
}

/// Which program answers
#[utoipa::path(
    get,
    path = "/version",
    tag = "server",
    operation_id = "version",
    responses((status = 200, description = "Name and version.", body = Version))
)]
pub(in crate::http) async fn version() -> axum::Json<Version> {
    axum::Json(Version {
        name: env!("CARGO_PKG_NAME").to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        api: "v1".to_owned(),
    })
}

/// Numbers for Prometheus
#[utoipa::path(
    get,
    path = "/metrics",
    tag = "server",
    operation_id = "metrics",
    responses((status = 200, description = "Prometheus text format.", content_type = "text/plain", body = String))
)]
pub(in crate::http) async fn metrics(State(site): State<Site>) -> Result<impl IntoResponse, Problem> {
    for (state, count) in site.app.open_jobs().await? {
        metrics::gauge!("vantage_jobs", "state" => state.as_str()).set(count as f64);
    }
    Ok(([(CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], crate::http::metrics::text()))
}

/// This document
#[utoipa::path(
    get,
    path = "/openapi.json",
    tag = "server",
    operation_id = "openapi",
    responses((status = 200, description = "OpenAPI 3.1.", body = Object))
)]
pub(in crate::http) async fn openapi(headers: HeaderMap, params: Params) -> Result<Response, Problem> {
    params.end()?;
    Ok(DOCUMENT.answer(&headers))
}
