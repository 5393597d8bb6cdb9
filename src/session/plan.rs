//! A capture plan: pure data, checked whole before anything moves.

use rig_config::Rig;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What `POST /v1/sessions` may say; everything left out comes from the rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StartRequest {
    /// A name for the sampled object, for people; at most 200 characters.
    pub name: Option<String>,
    /// Light stations: arm angles, degrees, in shooting order.
    pub stations_deg: Option<Vec<f64>>,
    /// The bracket as shutter labels (`1/100`, `0.4`, `15`), in shooting order.
    pub exposures: Option<Vec<String>>,
}

/// One light station of the plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Station {
    /// Arm angle, degrees.
    pub angle_deg: f64,
    /// Light position there, camera frame, mm.
    pub light_position_mm: [f64; 3],
}

/// One exposure of the bracket.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlannedExposure {
    /// Shutter label as set on the body.
    pub label: String,
    /// Time the shutter really opens, seconds.
    pub true_s: f64,
}

/// A checked plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CapturePlan {
    /// Name of the sampled object.
    pub name: String,
    /// Where the light goes.
    pub stations: Vec<Station>,
    /// The bracket shot at each.
    pub exposures: Vec<PlannedExposure>,
    /// Frames in all.
    pub frames: usize,
    /// Estimated duration, seconds: motion, settling, exposures, download.
    pub estimated_s: f64,
    /// Estimated disk space, bytes.
    pub estimated_bytes: u64,
}

/// Why a request is no plan: one entry a mistake.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{}", .reasons.join("; "))]
pub struct PlanError {
    /// What is wrong, where, and what to do.
    pub reasons: Vec<String>,
}

impl CapturePlan {
    /// Checks `request` against the rig; lists every mistake at once.
    pub fn new(_rig: &Rig, _request: &StartRequest) -> Result<Self, PlanError> {
        unimplemented!("filled on the session branch")
    }
}
