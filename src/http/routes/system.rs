//! Health, version and metrics of the server, and its OpenAPI document.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};

use crate::http::docs::document;
use crate::http::extract::{Json, Params};
use crate::http::prefix::Prefix;
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::service::metrics::{TEXT_FORMAT, record, text};
use crate::wire::{Health, HealthStatus, ProblemField, Readiness, ReadinessStatus, Version};

/// Check liveness
#[utoipa::path(
    get,
    path = "/healthz",
    tag = "server",
    operation_id = "healthz",
    responses((status = 200, description = "The process responds.", body = Health))
)]
pub(in crate::http) async fn healthz() -> Json<Health> {
    Json(Health { status: HealthStatus::Ok })
}

/// Check readiness
///
/// Ready means that the server accepts jobs; the check includes a write to the store. A 503 lists the failed checks, each
/// with the reason.
#[utoipa::path(
    get,
    path = "/readyz",
    tag = "server",
    operation_id = "readyz",
    responses((status = 200, description = "The server is ready.", body = Readiness))
)]
pub(in crate::http) async fn readyz(State(state): State<ApiState>) -> Result<Json<Readiness>, ApiError> {
    let (mut checks, mut errors) = (Vec::new(), Vec::new());
    for (check, fault) in state.app.readiness().await {
        errors.extend(fault.map(|detail| ProblemField { pointer: check.name.as_str().to_owned(), detail }));
        checks.push(check);
    }
    if errors.is_empty() {
        return Ok(Json(Readiness { status: ReadinessStatus::Ready, checks }));
    }
    Err(ApiError::new(Code::NotReady, "the server cannot accept jobs now").with_errors(errors))
}

/// Get the program's name and version
#[utoipa::path(
    get,
    path = "/version",
    tag = "server",
    operation_id = "version",
    responses((status = 200, description = "Name and version of the program and of the API.", body = Version))
)]
pub(in crate::http) async fn version() -> Json<Version> {
    Json(Version::of_this_program())
}

/// Get metrics
#[utoipa::path(
    get,
    path = "/metrics",
    tag = "server",
    operation_id = "metrics",
    responses((status = 200, description = "Metrics in the Prometheus text format.", content_type = "text/plain", body = String))
)]
pub(in crate::http) async fn metrics(State(state): State<ApiState>) -> impl IntoResponse {
    // What is not known is no number; the other metrics are needed most while the store cannot be read.
    let value = |count: Option<u64>| count.map_or(f64::NAN, |count| count as f64);
    for (job_state, count) in state.app.open_jobs().await {
        record(|all| all.jobs.with_label_values(&[job_state.as_str()]).set(value(count)));
    }
    for (run_state, count) in state.app.open_runs().await {
        record(|all| all.runs.with_label_values(&[run_state.as_str()]).set(value(count)));
    }
    ([(CONTENT_TYPE, TEXT_FORMAT)], text())
}

/// Get this document
#[utoipa::path(
    get,
    path = "/openapi.json",
    tag = "server",
    operation_id = "openapi",
    responses((status = 200, description = "The OpenAPI 3.1 document.", body = Object))
)]
pub(in crate::http) async fn openapi(prefix: Prefix, headers: HeaderMap, params: Params) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    Ok(document(&prefix, &headers))
}
