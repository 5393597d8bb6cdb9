//! The manifest of a session: what was meant to happen, on what, with which software.

use super::files::check_regular;
use super::{Disk, StoreError, io_error, replace};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;

/// Version of the file.
pub const FORMAT: u32 = 1;
/// File name in the session directory.
pub const FILE: &str = "manifest.json";

/// What is fixed about a session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of this file's shape.
    pub format: u32,
    /// Session id, a UUID v7.
    pub id: String,
    /// Name of the sampled object.
    pub name: String,
    /// Start, RFC 3339.
    pub started: String,
    /// Program and version that made the session.
    pub software: String,
    /// True when arm or camera is simulated.
    pub simulated: bool,
    /// The plan as accepted.
    pub plan: Value,
    /// The rig file, word for word.
    pub rig_file: String,
    /// Firmware of the arm, once it has answered.
    pub arm: Option<String>,
    /// Model of the camera, once it has answered.
    pub camera: Option<String>,
    /// The request's Idempotency-Key, if it had one.
    pub idempotency: Option<Idempotency>,
    /// Consecutive number of a calibration run; a session has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<u64>,
}

impl Manifest {
    /// Folder of the data directory in which a run of this kind is kept.
    pub fn shelf(&self) -> &'static str {
        if self.version.is_some() { CALIBRATIONS } else { SESSIONS }
    }
}

/// Where sessions are kept.
pub const SESSIONS: &str = "sessions";
/// Where calibration runs are kept.
pub const CALIBRATIONS: &str = "calibrations";

/// An Idempotency-Key and the request it belongs to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Idempotency {
    /// The key.
    pub key: String,
    /// blake3 of the request's canonical JSON.
    pub request_blake3: String,
}

/// Reads `directory/manifest.json`.
pub fn read(directory: &Path) -> Result<Manifest, StoreError> {
    let path = directory.join(FILE);
    let corrupt = |reason| StoreError::Corrupt { path: path.display().to_string(), reason };
    check_regular(&path, "manifest").map_err(corrupt)?;
    let bytes = std::fs::read(&path).map_err(|e| io_error("read", &path, &e))?;
    let manifest: Manifest = serde_json::from_slice(&bytes).map_err(|e| corrupt(format!("no manifest: {e}")))?;
    if manifest.format != FORMAT {
        return Err(corrupt(format!("it has format {}, this version reads {FORMAT}", manifest.format)));
    }
    if directory.file_name().is_none_or(|name| name != manifest.id.as_str()) {
        return Err(corrupt(format!(
            "it is the manifest of {}: a copy must not be taken for the original",
            manifest.id
        )));
    }
    Ok(manifest)
}

/// Writes `directory/manifest.json`; a crash leaves the old one or the new one, never half of either.
pub fn write(disk: &dyn Disk, directory: &Path, manifest: &Manifest) -> Result<(), StoreError> {
    let bytes = serde_json::to_vec_pretty(manifest)
        .map_err(|e| StoreError::Corrupt { path: directory.join(FILE).display().to_string(), reason: e.to_string() })?;
    replace(disk, directory, FILE, &bytes)
}
