//! A request to fit a finished session again.

use super::plan::PlanError;
use crate::numerics::brdf;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The body of a refit request; everything left out comes from the rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FitRequest {
    /// Number of materials; null lets left-out lights decide.
    pub materials: Option<usize>,
    /// BRDF model name.
    pub model: Option<String>,
    /// Objective name.
    pub objective: Option<String>,
    /// Indices of lights left out of the fit and used to judge it.
    pub leave_out: Option<Vec<usize>>,
}

impl FitRequest {
    /// Lists every mistake that can be known before the fit runs; the session has `lights` lights.
    pub fn check(&self, lights: usize) -> Result<(), PlanError> {
        let mut reasons = Vec::new();
        if self.materials == Some(0) {
            reasons.push("materials: 0: at least 1 is needed, or leave the key out".to_owned());
        }
        if let Some(model) = self.model.as_deref().filter(|model| brdf::by_name(model).is_none()) {
            let known: Vec<_> = brdf::MODELS.iter().map(|m| m.name()).collect();
            let model: String = model.chars().take(40).collect();
            reasons.push(format!("model: `{model}` is unknown: take one of {}", known.join(", ")));
        }
        let left_out = self.leave_out.as_deref().unwrap_or_default();
        for (i, &light) in left_out.iter().enumerate() {
            if light >= lights {
                reasons
                    .push(format!("leave_out[{i}]: {light}: the session has lights 0 to {}", lights.saturating_sub(1)));
            } else if left_out.iter().take(i).any(|&other| other == light) {
                reasons.push(format!("leave_out[{i}]: {light} is named twice: remove one"));
            }
        }
        if reasons.is_empty() { Ok(()) } else { Err(PlanError { reasons }) }
    }
}
