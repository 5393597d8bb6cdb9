//! A request to fit a finished session again, and what any fit can be asked.

use super::plan::PlanError;
use crate::numerics::fit::MAX_MATERIALS;
pub use crate::pipeline::options::{GAINS, lobes, models, objectives, solvers};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The body of a refit request; everything left out comes from the rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FitRequest {
    /// Number of materials; null lets left-out lights decide.
    pub materials: Option<usize>,
    /// BRDF model name, or `auto`: left-out lights decide.
    pub model: Option<String>,
    /// Colour of the lobe: `none`, `achromatic`, `coloured`, or `auto`.
    pub lobe: Option<String>,
    /// Light gains: `on`, `off`, or `auto`.
    pub gains: Option<String>,
    /// Solver name.
    pub solver: Option<String>,
    /// Objective name.
    pub objective: Option<String>,
    /// Indices of lights left out of the fit and used to judge it.
    pub leave_out: Option<Vec<usize>>,
}

impl FitRequest {
    /// Lists every mistake that can be known before the fit runs; the session has `lights` lights.
    pub fn check(&self, lights: usize) -> Result<(), PlanError> {
        let mut reasons = Vec::new();
        check_materials(self.materials, &mut reasons);
        check_name("model", self.model.as_deref(), &models(), &mut reasons);
        check_name("lobe", self.lobe.as_deref(), &lobes(), &mut reasons);
        check_name("gains", self.gains.as_deref(), &GAINS, &mut reasons);
        check_name("solver", self.solver.as_deref(), &solvers(), &mut reasons);
        check_name("objective", self.objective.as_deref(), &objectives(), &mut reasons);
        check_left_out(self.leave_out.as_deref().unwrap_or_default(), lights, &mut reasons);
        if reasons.is_empty() { Ok(()) } else { Err(PlanError { reasons }) }
    }
}

/// What `[fit]` of a rig file asks that no fit could do: it must show before a night is shot, not after.
pub fn check_rig(fit: &rig_config::Fit) -> Result<(), PlanError> {
    let mut reasons = Vec::new();
    check_materials(fit.materials, &mut reasons);
    check_name("model", Some(&fit.model), &models(), &mut reasons);
    check_name("lobe", Some(&fit.lobe), &lobes(), &mut reasons);
    check_name("gains", Some(&fit.gains), &GAINS, &mut reasons);
    check_name("solver", Some(&fit.solver), &solvers(), &mut reasons);
    check_name("objective", Some(&fit.objective), &objectives(), &mut reasons);
    let reasons: Vec<_> = reasons.into_iter().map(|reason| format!("fit.{reason}")).collect();
    if reasons.is_empty() { Ok(()) } else { Err(PlanError { reasons }) }
}

fn check_materials(materials: Option<usize>, reasons: &mut Vec<String>) {
    if let Some(materials) = materials.filter(|m| !(1..=MAX_MATERIALS).contains(m)) {
        reasons.push(format!("materials: {materials}: 1 to {MAX_MATERIALS} are possible, or leave the key out"));
    }
}

fn check_name(key: &str, name: Option<&str>, known: &[&str], reasons: &mut Vec<String>) {
    if let Some(name) = name.filter(|name| !known.contains(name)) {
        let name: String = name.chars().take(40).collect();
        reasons.push(format!("{key}: `{name}` is unknown: take one of {}", known.join(", ")));
    }
}

fn check_left_out(left_out: &[usize], lights: usize, reasons: &mut Vec<String>) {
    for (i, &light) in left_out.iter().enumerate() {
        if light >= lights {
            reasons.push(format!("leave_out[{i}]: {light}: the session has lights 0 to {}", lights.saturating_sub(1)));
        } else if left_out.iter().take(i).any(|&other| other == light) {
            reasons.push(format!("leave_out[{i}]: {light} is named twice: remove one"));
        }
    }
    if (0..lights).all(|light| left_out.contains(&light)) {
        reasons.push("leave_out: every light is left out: keep at least one to fit".to_owned());
    }
}
