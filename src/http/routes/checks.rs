//! Checks of documents.

use axum::extract::State;

use crate::http::extract::{Json, Params};
use crate::http::problem::ApiError;
use crate::http::router::ApiState;
use crate::wire::{CheckReport, CheckRequest};

/// Check a specification, parameters, a plan or a program
///
/// Nothing is stored. A program is recomputed from itself alone: limits, times, collisions along every segment and where the
/// scanner is at each capture; with plan and part also the area that its captures measure, by the reference engine.
///
/// A plan is checked for structure and ranges; with the cell, that it was made in this cell with this scanner, and each of its
/// stations: limits, pose and collisions; with the part also collisions with the part, and the coverage that it states, by the
/// reference engine. The description says what was checked and what was not.
#[utoipa::path(
    post,
    path = "/check",
    tag = "specifications",
    operation_id = "check_document",
    request_body = CheckRequest,
    responses((status = 200, description = "The findings; none if the document is sound.", body = CheckReport))
)]
pub(in crate::http) async fn check(
    State(state): State<ApiState>,
    params: Params,
    Json(request): Json<CheckRequest>,
) -> Result<Json<CheckReport>, ApiError> {
    params.deny_unknown()?;
    Ok(Json(state.app.check(request, Some(state.options.request_timeout)).await?))
}
