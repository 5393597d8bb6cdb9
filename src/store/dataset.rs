//! Dataset directories (CONTRACT.md): reading with every reason for refusal, and writing one for a finished session.

use crate::pipeline::dataset::Dataset;
use std::path::Path;

/// Why a directory is no usable dataset.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {}", .reasons.join("; "))]
pub struct DatasetError {
    /// The file or directory.
    pub path: String,
    /// Every reason found: what, where, what to do.
    pub reasons: Vec<String>,
}

/// Reads `directory/dataset.toml` and its images.
pub fn read(_directory: &Path) -> Result<Dataset, DatasetError> {
    unimplemented!("filled on the fit branch")
}

/// Writes `directory/dataset.toml` for a rig's session: one light a station, images `radiance/NN.exr`.
pub fn write_for_session(
    _directory: &Path,
    _rig: &rig_config::Rig,
    _light_positions_mm: &[[f64; 3]],
) -> Result<(), DatasetError> {
    unimplemented!("filled on the fit branch")
}
