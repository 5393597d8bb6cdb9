//! Result directories (CONTRACT.md): report.json, material.json, weights.exr, valid.png, residual.exr, preview.png.

use crate::pipeline::fit::FitResult;
use std::path::Path;

/// Why a result cannot be written or read.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}")]
pub struct ResultError {
    /// The file.
    pub path: String,
    /// What is wrong and what to do.
    pub reason: String,
}

/// Writes every file of a result into `directory` (made if missing).
pub fn write(_directory: &Path, _result: &FitResult) -> Result<(), ResultError> {
    unimplemented!("filled on the fit branch")
}
