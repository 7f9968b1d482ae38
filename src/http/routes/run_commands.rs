//! Commands to a run: arm, pause, resume, stop, step, override, located. Pause and stop need no token: anybody may. They read
//! neither query nor body, since a refusal would leave arm and table moving.

use axum::extract::{Path, State};

use super::runs::{Accepted, accepted, run_id, token};
use crate::http::extract::{Json, Params};
use crate::http::prefix::Prefix;
use crate::http::problem::ApiError;
use crate::http::router::ApiState;
use crate::wire::run::{ArmRequest, LocatedRequest, OverrideRequest, Run};

/// Arm a live run
///
/// Releases motion on behalf of the operator, who stands at the cell and has made sure that nobody is in it. Needs the lease of
/// the cell. The state of arm and table, their pose, and the hashes of plan, program and cell are checked; then the run begins.
/// The first live run of a program is slow.
///
/// Vantage is not safety-rated, and its stop is not an emergency stop: keep the cell's own safety system active.
#[utoipa::path(
    post,
    path = "/runs/{id}/arm",
    tag = "runs",
    operation_id = "arm_run",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the run."),
        ("token" = Option<u64>, Query, minimum = 0, maximum = 9_007_199_254_740_991_i64, description = "Fencing token of the cell's lease."),
    ),
    request_body = ArmRequest,
    responses((status = 200, description = "The run.", body = Run))
)]
pub(in crate::http) async fn arm(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    mut params: Params,
    Json(request): Json<ArmRequest>,
) -> Result<Json<Run>, ApiError> {
    let token = token(&mut params)?;
    params.deny_unknown()?;
    Ok(Json(state.app.arm_run(run_id(&id)?, request, token).await?))
}

/// Pause a run
///
/// Stops the run in a controlled way where it is, and holds it there until it is resumed. Pausing a paused run has no effect.
/// Anybody may pause. A query or a body is ignored.
///
/// This is not an emergency stop: Vantage is not safety-rated.
#[utoipa::path(
    post,
    path = "/runs/{id}/pause",
    tag = "runs",
    operation_id = "pause_run",
    params(("id" = uuid::Uuid, Path, description = "Id of the run.")),
    responses((status = 200, description = "The run.", body = Run))
)]
pub(in crate::http) async fn pause(State(state): State<ApiState>, Path(id): Path<String>) -> Result<Json<Run>, ApiError> {
    Ok(Json(state.app.pause_run(run_id(&id)?).await?))
}

/// Resume a paused run
///
/// Checks the state and the pose again before moving. In the mode `live`, it needs the lease of the cell, and moves arm and
/// table.
///
/// Vantage is not safety-rated, and its stop is not an emergency stop: keep the cell's own safety system active.
#[utoipa::path(
    post,
    path = "/runs/{id}/resume",
    tag = "runs",
    operation_id = "resume_run",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the run."),
        ("token" = Option<u64>, Query, minimum = 0, maximum = 9_007_199_254_740_991_i64, description = "Fencing token of the cell's lease; needed in the mode `live`."),
    ),
    responses((status = 200, description = "The run.", body = Run))
)]
pub(in crate::http) async fn resume(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    mut params: Params,
) -> Result<Json<Run>, ApiError> {
    let token = token(&mut params)?;
    params.deny_unknown()?;
    Ok(Json(state.app.resume_run(run_id(&id)?, token).await?))
}

/// Stop a run
///
/// Asks the controllers to stop in a controlled way, and ends the run; it cannot be resumed. The field `stop` of the run states
/// separately when the request was put on the wire, when the controllers acknowledged it, and when arm and table were measured at
/// rest. Until then the run has the reason `stopping`: the answer has it too if arm and table are not at rest within 2 s. Anybody
/// may stop; stopping an ended run has no effect. A query or a body is ignored.
///
/// This is not an emergency stop: Vantage is not safety-rated, and this request can be late or lost.
#[utoipa::path(
    post,
    path = "/runs/{id}/stop",
    tag = "runs",
    operation_id = "stop_run",
    params(("id" = uuid::Uuid, Path, description = "Id of the run.")),
    responses(
        (status = 202, description = "The run stops, or has ended.", body = Run,
            headers(("Location" = String, description = "Path of the run."),
                    ("Retry-After" = String, description = "Seconds to wait before polling the run."))),
    )
)]
pub(in crate::http) async fn stop(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    prefix: Prefix,
) -> Result<Accepted, ApiError> {
    Ok(accepted(state.app.stop_run(run_id(&id)?).await?, &prefix))
}

/// Execute one step
///
/// Executes one step of a paused run, or of an armed run that pauses after each step; the run pauses again after it. In the mode
/// `live`, it needs the lease of the cell, and moves arm and table.
///
/// Vantage is not safety-rated, and its stop is not an emergency stop: keep the cell's own safety system active.
#[utoipa::path(
    post,
    path = "/runs/{id}/step",
    tag = "runs",
    operation_id = "step_run",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the run."),
        ("token" = Option<u64>, Query, minimum = 0, maximum = 9_007_199_254_740_991_i64, description = "Fencing token of the cell's lease; needed in the mode `live`."),
    ),
    responses((status = 200, description = "The run.", body = Run))
)]
pub(in crate::http) async fn step(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    mut params: Params,
) -> Result<Json<Run>, ApiError> {
    let token = token(&mut params)?;
    params.deny_unknown()?;
    Ok(Json(state.app.step_run(run_id(&id)?, token).await?))
}

/// Change the speed of a run
///
/// Takes effect with the next segment of motion. The first live run of a program stays below the cap in the cell file.
#[utoipa::path(
    post,
    path = "/runs/{id}/override",
    tag = "runs",
    operation_id = "override_run",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the run."),
        ("token" = Option<u64>, Query, minimum = 0, maximum = 9_007_199_254_740_991_i64, description = "Fencing token of the cell's lease; needed in the mode `live`."),
    ),
    request_body = OverrideRequest,
    responses((status = 200, description = "The run.", body = Run))
)]
pub(in crate::http) async fn set_override(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    mut params: Params,
    Json(request): Json<OverrideRequest>,
) -> Result<Json<Run>, ApiError> {
    let token = token(&mut params)?;
    params.deny_unknown()?;
    Ok(Json(state.app.override_run(run_id(&id)?, request, token).await?))
}

/// Set the pose of the part
///
/// Answers a locating scan, for which the run waits (`paused`, reason `locating`). The program is checked again for reach,
/// collisions and coverage with the part in that pose. Within bounds, the run continues with corrected targets; otherwise it
/// stops and says how to correct the pose of the part.
#[utoipa::path(
    post,
    path = "/runs/{id}/located",
    tag = "runs",
    operation_id = "locate_part",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the run."),
        ("token" = Option<u64>, Query, minimum = 0, maximum = 9_007_199_254_740_991_i64, description = "Fencing token of the cell's lease; needed in the mode `live`."),
    ),
    request_body = LocatedRequest,
    responses((status = 200, description = "The run.", body = Run))
)]
pub(in crate::http) async fn located(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    mut params: Params,
    Json(request): Json<LocatedRequest>,
) -> Result<Json<Run>, ApiError> {
    let token = token(&mut params)?;
    params.deny_unknown()?;
    Ok(Json(state.app.locate_run(run_id(&id)?, request, token).await?))
}
