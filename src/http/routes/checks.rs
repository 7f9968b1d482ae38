//! Checks of documents.

use axum::extract::State;

use crate::http::extract::{Json, Params};
use crate::http::problem::ApiError;
use crate::http::router::ApiState;
use crate::wire::{CheckReport, CheckRequest};

/// Check a specification, parameters, a plan or a program
///
/// Nothing is stored. A program is recomputed from itself alone: limits, times, collisions along every segment, and the pose of
/// the scanner at each capture. With its plan and part, the area that its captures measure is recomputed too, by the reference
/// engine.
///
/// A plan is checked for structure and ranges, and its parameters for agreement with the rest of it. With the cell, it must have
/// been made in this cell with this scanner, and each of its stations is checked: limits, pose and collisions. With the part,
/// also collisions with the part, and the coverage that the plan states, by the reference engine. A plan that was made without a
/// cell is checked with the cell `"none"`, as a job is planned.
///
/// Part and fixture must be those of the plan: another part is refused by its SHA-256 and its size, another fixture by the
/// SHA-256 of the mesh that the plan names, if this server has that mesh. Fields that do not apply to the kind of document are
/// refused by name. `verified` and `unverified` list what was checked and what was not, with the reason.
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
