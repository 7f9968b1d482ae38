//! The store itself: room, sizes, damage, and what retention lets go.

use axum::extract::State;

use crate::http::extract::Params;
use crate::http::problem::Problem;
use crate::http::router::Site;
use crate::wire::{Retention, Storage};

/// Look at the store
///
/// Room on its disk, sizes, and what is known to be damaged.
#[utoipa::path(
    get,
    path = "/storage",
    tag = "server",
    operation_id = "get_storage",
    responses((status = 200, description = "The store.", body = Storage))
)]
pub(in crate::http) async fn storage(State(site): State<Site>, params: Params) -> Result<axum::Json<Storage>, Problem> {
    params.end()?;
    Ok(axum::Json(site.app.storage().await?))
}

/// What retention would let go
///
/// Nothing is deleted. The policy is the server's (`[retention]` in its settings).
#[utoipa::path(
    get,
    path = "/retention",
    tag = "server",
    operation_id = "get_retention",
    responses((status = 200, description = "What the policy lets go now.", body = Retention))
)]
pub(in crate::http) async fn retention(State(site): State<Site>, params: Params) -> Result<axum::Json<Retention>, Problem> {
    params.end()?;
    Ok(axum::Json(site.app.retention().await?))
}

/// Apply retention now
///
/// The server does so every hour by itself. Each deleted job has its event, with the reason as `code`.
#[utoipa::path(
    post,
    path = "/retention",
    tag = "server",
    operation_id = "apply_retention",
    responses((status = 200, description = "What was let go.", body = Retention))
)]
pub(in crate::http) async fn apply_retention(State(site): State<Site>, params: Params) -> Result<axum::Json<Retention>, Problem> {
    params.end()?;
    Ok(axum::Json(site.app.retire().await?))
}
