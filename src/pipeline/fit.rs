//! Fits a material to a dataset and says how good it is.

use super::dataset::Dataset;
use std::ops::ControlFlow;

/// What to fit and how.
#[derive(Clone, Debug, PartialEq)]
pub struct FitOptions {
    /// Number of materials; none lets left-out lights decide.
    pub materials: Option<usize>,
    /// BRDF model name (`numerics::brdf::MODELS`).
    pub model: String,
    /// Solver name.
    pub solver: String,
    /// Objective name.
    pub objective: String,
    /// Indices of lights kept out of the fit and used to judge it.
    pub leave_out: Vec<usize>,
    /// Cosine cut-off; none takes the dataset's.
    pub cosine_cutoff: Option<f64>,
    /// Worker threads; none takes all cores. The result does not depend on it.
    pub threads: Option<usize>,
}

/// Progress of a fit: outer iteration and cost.
#[derive(Clone, Copy, Debug)]
pub struct FitProgress {
    /// Outer iteration, from 1.
    pub iteration: usize,
    /// Cost of the objective.
    pub cost: f64,
}

/// Callback for progress and cancelling.
pub type OnProgress<'a> = &'a mut (dyn FnMut(FitProgress) -> ControlFlow<()> + Send);

/// Why there is no fit at all. A poor fit is a report, not an error.
#[derive(Clone, Debug, thiserror::Error)]
pub enum FitError {
    /// The caller's callback broke off.
    #[error("the fit was cancelled")]
    Cancelled,
    /// The input cannot be fitted.
    #[error("{0}")]
    Input(String),
}

/// Marker so that the skeleton compiles; replaced with the result type.
pub struct FitResult;

/// Fits `dataset`.
pub fn fit(_dataset: &Dataset, _options: &FitOptions, _progress: OnProgress<'_>) -> Result<FitResult, FitError> {
    unimplemented!("filled on the fit branch")
}
