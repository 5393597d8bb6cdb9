//! What the rig is and whether it can work.

use super::problem::Problem;
use super::{HttpState, ask};
use crate::session::handle::LampStatus;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The rig and its readiness.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct RigStatus {
    /// Name of the rig.
    name: String,
    /// True when arm or camera is simulated.
    simulated: bool,
    /// Version of the daemon.
    version: String,
    /// True when a session could start now.
    ready: bool,
    /// Why none could; empty when ready.
    reasons: Vec<String>,
    /// The lamp and its hours.
    lamp: LampStatus,
}

/// The rig
#[utoipa::path(get, path = "/v1/rig", tag = "rig", responses((status = 200, body = RigStatus, description = "The rig.")))]
pub(super) async fn rig(State(state): State<HttpState>) -> Result<axum::Json<RigStatus>, Problem> {
    let (ready, lamp) = ask(&state, |engine| Ok((engine.readiness(), engine.lamp()))).await?;
    let reasons = ready.err().unwrap_or_default();
    Ok(axum::Json(RigStatus {
        name: state.rig.name.clone(),
        simulated: state.rig.is_simulated(),
        version: env!("CARGO_PKG_VERSION").into(),
        ready: reasons.is_empty(),
        reasons,
        lamp,
    }))
}

/// Answer of a health check.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct Health {
    /// Always `ok`: anything else is a problem.
    #[schema(pattern = "^ok$")]
    status: String,
}

/// Whether the daemon answers
#[utoipa::path(get, path = "/livez", tag = "health", responses((status = 200, body = Health, description = "It does.")))]
pub(super) async fn livez() -> axum::Json<Health> {
    axum::Json(Health { status: "ok".into() })
}

/// Whether a session could start
#[utoipa::path(get, path = "/readyz", tag = "health", responses(
    (status = 200, body = Health, description = "It could."),
    (status = 503, description = "It could not; `reasons` lists why."),
))]
pub(super) async fn readyz(State(state): State<HttpState>) -> Result<axum::Json<Health>, Problem> {
    match ask(&state, |engine| Ok(engine.readiness())).await? {
        Ok(()) => Ok(livez().await),
        Err(reasons) => Err(Problem::not_ready(reasons)),
    }
}
