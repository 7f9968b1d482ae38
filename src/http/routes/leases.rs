//! Leases, the right to move a cell.

use axum::extract::{Path, State};
use axum::http::HeaderName;
use axum::http::StatusCode;
use axum::http::header::LOCATION;

use crate::http::extract::{Json, Params};
use crate::http::prefix::Prefix;
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::service::Submission;
use crate::wire::LeaseId;
use crate::wire::run::{LeaseDocument, LeaseList, LeaseRequest};

/// Parses the lease id in a path. A malformed id is answered like an unknown one.
fn lease_id(text: &str) -> Result<LeaseId, ApiError> {
    text.parse().map_err(|_| ApiError::new(Code::LeaseNotFound, format!("{text:?} is not the id of a lease")))
}

/// Take the lease of a cell
///
/// Only one client at a time may move a cell. The lease ends after `ttl_ms` unless it is renewed; a live run then stops, and has
/// to be started and armed again. Requests that move the cell carry its `token`, which increases with every lease.
///
/// A lease protects clients from each other, not people from machines: Vantage is not safety-rated, and its stop is not an
/// emergency stop.
#[utoipa::path(
    post,
    path = "/leases",
    tag = "runs",
    operation_id = "take_lease",
    params(
        ("Idempotency-Key" = Option<String>, Header, pattern = "^[ \\t]*[\\x21-\\x7e]{1,255}[ \\t]*$",
            description = "While the lease holds, the same key with the same request gives the same lease, with the time that it has \
                           left, so that a request without a response can be repeated; once it has ended, a new one. \
                           Surrounding white space is ignored (RFC 9110, section 5.5)."),
    ),
    request_body = LeaseRequest,
    responses((status = 201, description = "The lease.", body = LeaseDocument,
        headers(("Location" = String, description = "Path of the lease."))))
)]
pub(in crate::http) async fn take(
    State(state): State<ApiState>,
    submission: Submission,
    prefix: Prefix,
    params: Params,
    Json(request): Json<LeaseRequest>,
) -> Result<(StatusCode, [(HeaderName, String); 1], Json<LeaseDocument>), ApiError> {
    params.deny_unknown()?;
    let lease = state.app.submit_lease(request, submission).await?;
    let location = prefix.at(&format!("/api/v1/leases/{}", lease.id));
    Ok((StatusCode::CREATED, [(LOCATION, location)], Json(lease)))
}

/// Renew a lease
///
/// The heartbeat of the client that moves the cell: send it at least every `heartbeat_ms`. A lease that has ended cannot be
/// renewed.
#[utoipa::path(
    put,
    path = "/leases/{id}",
    tag = "runs",
    operation_id = "renew_lease",
    params(("id" = uuid::Uuid, Path, description = "Id of the lease.")),
    responses((status = 200, description = "The lease, with its full time left.", body = LeaseDocument))
)]
pub(in crate::http) async fn renew(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<Json<LeaseDocument>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.renew_lease(lease_id(&id)?)?))
}

/// Give a lease back
///
/// A live run that depends on the lease is stopped in a controlled way.
#[utoipa::path(
    delete,
    path = "/leases/{id}",
    tag = "runs",
    operation_id = "give_lease_back",
    params(("id" = uuid::Uuid, Path, description = "Id of the lease.")),
    responses((status = 204, description = "The lease has ended."))
)]
pub(in crate::http) async fn give_back(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    params: Params,
) -> Result<StatusCode, ApiError> {
    params.deny_unknown()?;
    state.app.give_lease_back(lease_id(&id)?)?;
    Ok(StatusCode::NO_CONTENT)
}

/// List leases
#[utoipa::path(
    get,
    path = "/leases",
    tag = "runs",
    operation_id = "list_leases",
    responses((status = 200, description = "Leases that are held, without their ids.", body = LeaseList))
)]
pub(in crate::http) async fn list(State(state): State<ApiState>, params: Params) -> Result<Json<LeaseList>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.leases()))
}
