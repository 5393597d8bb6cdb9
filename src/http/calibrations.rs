//! Calibrations: start, list, look at; tell that what is asked for is in place; abort; the result.

use super::extract::{CalibrationId, Json, NoQuery, Query};
use super::problem::Problem;
use super::{HttpState, ask};
use crate::session::handle::{CalibrationRequest, CalibrationSnapshot};
use crate::session::state::Verb;
use axum::extract::State;
use axum::http::{StatusCode, header as names};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

/// Start a calibration
///
/// Board, card and balls, exposures and stations come from `[calibration]` of the rig file. The answer comes before anything moves; follow
/// the run at its Location: in state `awaiting` do what `instruction` says, then POST to `shoot`. A run of kind `settle` asks for nothing: the
/// arm makes the largest step of `[plan]` and a short one, and bursts of frames show how long it swings.
#[utoipa::path(post, path = "/v1/calibrations", tag = "calibrations", request_body = CalibrationRequest, responses(
    (status = 202, body = CalibrationSnapshot, description = "Accepted.",
        headers(("Location" = String, description = "Path of the calibration."))),
    (status = 400, description = "No JSON."),
    (status = 409, description = "A session or another calibration holds the rig; `running` names it."),
    (status = 413, description = "The body is too large."),
    (status = 415, description = "The body is not sent as application/json."),
    (status = 422, description = "The request is refused, or the rig file has no usable `[calibration]` (kind `rig`); `reasons` lists why."),
    (status = 507, description = "Not enough disk space."),
))]
pub(super) async fn start(
    State(state): State<HttpState>,
    Query(NoQuery {}): Query<NoQuery>,
    Json(request): Json<CalibrationRequest>,
) -> Result<Response, Problem> {
    let started = ask(&state, move |engine| engine.start_calibration(&request)).await?;
    let location = format!("/v1/calibrations/{}", started.id);
    Ok((StatusCode::ACCEPTED, [(names::LOCATION, location)], axum::Json(started)).into_response())
}

/// Every calibration.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct CalibrationList {
    /// Newest first.
    calibrations: Vec<CalibrationSnapshot>,
}

/// List calibrations, newest first
#[utoipa::path(get, path = "/v1/calibrations", tag = "calibrations", responses(
    (status = 200, body = CalibrationList, description = "All of them: they are few."),
))]
pub(super) async fn list(State(state): State<HttpState>) -> Result<axum::Json<CalibrationList>, Problem> {
    let calibrations = ask(&state, |engine| Ok(engine.calibrations())).await?;
    Ok(axum::Json(CalibrationList { calibrations }))
}

/// Look at a calibration
#[utoipa::path(get, path = "/v1/calibrations/{id}", tag = "calibrations", params(("id" = String, Path, description = "Calibration id.")),
    responses(
        (status = 200, body = CalibrationSnapshot, description = "The calibration as it stands."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such calibration."),
    ))]
pub(super) async fn show(
    State(state): State<HttpState>,
    CalibrationId(id): CalibrationId,
) -> Result<axum::Json<CalibrationSnapshot>, Problem> {
    ask(&state, move |engine| engine.calibration(&id)).await.map(axum::Json)
}

/// What a calibration measured
///
/// `calibration.json`: camera, response and lights with their uncertainties, date, frames and number. Of kind `settle`, `settle.json`: settle
/// time, what `arm.settle_s` should be, and every frame's difference from the last ones.
#[utoipa::path(get, path = "/v1/calibrations/{id}/result", tag = "calibrations", params(("id" = String, Path, description = "Calibration id.")),
    responses(
        (status = 200, body = Object, description = "The calibration."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such calibration."),
        (status = 409, description = "No result in `current_state`; or, without it, `calibration.json` is damaged or gone: `detail` says what to do."),
    ))]
pub(super) async fn result(
    State(state): State<HttpState>,
    CalibrationId(id): CalibrationId,
) -> Result<axum::Json<Value>, Problem> {
    let asked = id.clone();
    match ask(&state, move |engine| engine.calibration_result(&asked)).await? {
        Some(result) => Ok(axum::Json(result)),
        None => {
            let run = ask(&state, move |engine| engine.calibration(&id)).await?;
            let detail = format!("calibration {} has no result: it is there once every step is accepted", run.id);
            Err(Problem::not_yet(run.state, detail))
        }
    }
}

/// Shoot the step in hand
///
/// Tells that what `instruction` asks for is in place. A step whose frames do not serve is refused with its reason in `verdicts` and asked
/// for again.
#[utoipa::path(post, path = "/v1/calibrations/{id}/shoot", tag = "calibrations", params(("id" = String, Path, description = "Calibration id.")),
    responses(
        (status = 202, body = CalibrationSnapshot, description = "Taken; the calibration as it stands."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such calibration."),
        (status = 409, description = "Not possible in `current_state`; `allowed` lists what is."),
    ))]
pub(super) async fn shoot(state: State<HttpState>, id: CalibrationId) -> Result<Response, Problem> {
    command(state, id, Verb::Shoot).await
}

/// Abort a calibration
///
/// Ends now, cleans up; nothing is calibrated.
#[utoipa::path(post, path = "/v1/calibrations/{id}/abort", tag = "calibrations", params(("id" = String, Path, description = "Calibration id.")),
    responses(
        (status = 202, body = CalibrationSnapshot, description = "Taken; the calibration as it stands."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such calibration."),
        (status = 409, description = "Not possible in `current_state`; `allowed` lists what is."),
    ))]
pub(super) async fn abort(state: State<HttpState>, id: CalibrationId) -> Result<Response, Problem> {
    command(state, id, Verb::Abort).await
}

async fn command(
    State(state): State<HttpState>,
    CalibrationId(id): CalibrationId,
    verb: Verb,
) -> Result<Response, Problem> {
    let snapshot = ask(&state, move |engine| engine.command_calibration(&id, verb)).await?;
    Ok((StatusCode::ACCEPTED, axum::Json(snapshot)).into_response())
}
