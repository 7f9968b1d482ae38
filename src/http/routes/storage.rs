//! The store: free space, sizes, damage and retention.

use axum::extract::State;

use crate::http::extract::{Json, Params};
use crate::http::problem::ApiError;
use crate::http::router::ApiState;
use crate::wire::{Retention, Storage};

/// Get the state of the store
///
/// Free space on the disk of the store, sizes of everything stored, including audit logs, and items known to be damaged.
#[utoipa::path(
    get,
    path = "/storage",
    tag = "server",
    operation_id = "get_storage",
    responses((status = 200, description = "The state of the store.", body = Storage))
)]
pub(in crate::http) async fn storage(State(state): State<ApiState>, params: Params) -> Result<Json<Storage>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.storage().await?))
}

/// Preview retention
///
/// Lists the jobs, meshes and runs that the policy would delete now; deletes nothing. The policy is in the server's settings, in
/// the section `[retention]`.
#[utoipa::path(
    get,
    path = "/retention",
    tag = "server",
    operation_id = "get_retention",
    responses((status = 200, description = "The jobs, meshes and runs that the policy would delete now.", body = Retention))
)]
pub(in crate::http) async fn retention(State(state): State<ApiState>, params: Params) -> Result<Json<Retention>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.retention().await?))
}

/// Apply retention now
///
/// Deletes the jobs, meshes and runs that the policy selects. The server also does this by itself every hour. A job is deleted
/// with its results, its uploaded scans and its inspections, and gets an event with the reason as `code`. A run is not deleted
/// with its job but at its own age, together with its audit log.
#[utoipa::path(
    post,
    path = "/retention",
    tag = "server",
    operation_id = "apply_retention",
    responses((status = 200, description = "The jobs, meshes and runs that were deleted.", body = Retention))
)]
pub(in crate::http) async fn apply_retention(State(state): State<ApiState>, params: Params) -> Result<Json<Retention>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.apply_retention().await?))
}
