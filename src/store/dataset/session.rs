//! The dataset that a session leaves.

use super::raw::RawDataset;
use super::{FILE, error};
use crate::store::files::shown;
use crate::store::{Disk, keep};
use std::path::Path;

/// Path of a station's radiance image inside a session directory.
pub fn radiance_name(station: usize) -> String {
    format!("radiance/{station:02}.exr")
}

/// One light of a session.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SessionLight {
    /// Position, camera frame, mm.
    pub position_mm: [f64; 3],
    /// Radiant intensity per channel, radiance units x mm^2.
    pub intensity: [f64; 3],
}

/// Writes `directory/dataset.toml` for a rig's session: one light a station in the order of the plan, mm, images by
/// [`radiance_name`]. `origin` says in one line where the geometry comes from. Durable when this returns; a file cut off by a full
/// disk or a crash would spoil every later fit.
///
/// # Errors
/// In words.
pub fn write_for_session(
    disk: &dyn Disk,
    directory: &Path,
    rig: &rig_config::Rig,
    lights: &[SessionLight],
    origin: &str,
) -> Result<(), String> {
    let path = directory.join(FILE);
    let text =
        toml::to_string(&RawDataset::of_session(rig, lights)).map_err(|e| error(&path, e.to_string()).to_string())?;
    let text = format!("# {origin}\n{text}");
    keep::file(disk, &path, |unfinished| {
        std::fs::write(unfinished, text).map_err(|e| format!("{}: {e}", shown(unfinished)))
    })
}
