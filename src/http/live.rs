//! A session's fit as it goes on, and whether its frames are still what they were.

use super::extract::SessionId;
use super::problem::Problem;
use super::{HttpState, ask};
use crate::session::handle::{LiveFit, VerifyStatus};
use axum::extract::State;
use axum::http::StatusCode;

/// Watch a fit
///
/// The fit of the session that goes on or was the daemon's last: step, candidates, iterations (at most 400), materials, residual map. The
/// event stream of the session says when to look again: `fit.live`, at most some ten times a second. The fit's outcome is in `material`.
#[utoipa::path(get, path = "/v1/sessions/{id}/fit", tag = "results", params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 200, body = LiveFit, description = "The fit as it stands."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session."),
        (status = 409, description = "The daemon's last fit was not of this session, or it has made none since it started."),
    ))]
pub(super) async fn fit(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
) -> Result<axum::Json<LiveFit>, Problem> {
    let (fit, standing) = ask(&state, move |engine| Ok((engine.live_fit(&id)?, engine.session(&id)?.state))).await?;
    let detail = "the daemon's last fit was not of this session, or it has made none since it started: see GET .../material for what came of earlier ones";
    fit.map(axum::Json).ok_or_else(|| Problem::not_yet(standing, detail))
}

/// Whether a session's frames are sound
///
/// As it was last found, by this daemon or by `rigd verify`.
#[utoipa::path(get, path = "/v1/sessions/{id}/verify", tag = "results", params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 200, body = VerifyStatus, description = "What is known."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session."),
    ))]
pub(super) async fn verified(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
) -> Result<axum::Json<VerifyStatus>, Problem> {
    ask(&state, move |engine| engine.verify_status(&id)).await.map(axum::Json)
}

/// Verify a session
///
/// Begins to read every frame of a session that has ended and to hold it against the journal, whose chain of hashes is walked first; one
/// session at a time, and none while a session or a calibration holds the rig. What is found is told by GET; what is sound gets its
/// `verified.json`, what is not loses it.
#[utoipa::path(post, path = "/v1/sessions/{id}/verify", tag = "results", params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 202, body = VerifyStatus, description = "Begun, or going on already."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session."),
        (status = 409, description = "The session has not ended, another one holds the rig, or another one is being verified."),
    ))]
pub(super) async fn verify(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
) -> Result<(StatusCode, axum::Json<VerifyStatus>), Problem> {
    let status = ask(&state, move |engine| engine.verify(&id)).await?;
    Ok((StatusCode::ACCEPTED, axum::Json(status)))
}
