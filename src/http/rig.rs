//! What the rig is and whether it can work.

use super::problem::Problem;
use super::{HttpState, ask};
use crate::session::handle::{ComputerStatus, LampStatus, OwnPlan};
use axum::extract::State;
use rig_config::{Arm, ArmDriver, Camera, CameraDriver};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The arm as the rig file has it.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct ArmSetup {
    /// `rigproto`, `grbl` or `simulated`.
    driver: String,
    /// Permitted angles, degrees: lower, upper.
    travel_deg: [f64; 2],
}

/// The camera as the rig file has it.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct CameraSetup {
    /// `gphoto2`, `replay` or `simulated`.
    driver: String,
    /// Frame width, pixels.
    width: usize,
    /// Frame height, pixels.
    height: usize,
}

fn arm(arm: &Arm) -> ArmSetup {
    let driver = match arm.driver {
        ArmDriver::Rigproto { .. } => "rigproto",
        ArmDriver::Grbl { .. } => "grbl",
        ArmDriver::Simulated => "simulated",
    };
    ArmSetup { driver: driver.into(), travel_deg: arm.travel_deg }
}

fn camera(camera: &Camera) -> CameraSetup {
    let driver = match camera.driver {
        CameraDriver::Gphoto2 { .. } => "gphoto2",
        CameraDriver::Replay { .. } => "replay",
        CameraDriver::Simulated => "simulated",
    };
    CameraSetup { driver: driver.into(), width: camera.width, height: camera.height }
}

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
    /// Id of the session or calibration that has the rig; null when it is free.
    running: Option<String>,
    /// The arm.
    arm: ArmSetup,
    /// The camera.
    camera: CameraSetup,
    /// The lamp and its hours.
    lamp: LampStatus,
    /// What the computer has.
    computer: ComputerStatus,
    /// What a session of the rig file's own plan would need and use; null where that plan is refused.
    own_plan: Option<OwnPlan>,
}

/// The rig
#[utoipa::path(get, path = "/v1/rig", tag = "rig", responses((status = 200, body = RigStatus, description = "The rig.")))]
pub(super) async fn rig(State(state): State<HttpState>) -> Result<axum::Json<RigStatus>, Problem> {
    let (ready, running, lamp) =
        ask(&state, |engine| Ok((engine.readiness(), engine.running(), engine.lamp()))).await?;
    let (computer, own_plan) = ask(&state, |engine| Ok((engine.computer(), engine.own_plan()))).await?;
    let reasons = ready.err().unwrap_or_default();
    Ok(axum::Json(RigStatus {
        name: state.rig.name.clone(),
        simulated: state.rig.is_simulated(),
        version: env!("CARGO_PKG_VERSION").into(),
        ready: reasons.is_empty(),
        reasons,
        running,
        arm: arm(&state.rig.arm),
        camera: camera(&state.rig.camera),
        lamp,
        computer,
        own_plan,
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
