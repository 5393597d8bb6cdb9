//! A camera that plays a folder of frames: what was shot once is acquired again, byte for byte.

use super::Cancel;
use super::camera::{Camera, CameraError, CameraIdentity, RawFrame, Shot};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// File-name endings that count as frames, lower case.
const ENDINGS: [&str; 2] = ["jpg", "jpeg"];

/// Plays the frames of a folder: in file-name order, bracket by bracket.
#[derive(Clone, Debug)]
pub struct ReplayCamera {
    directory: PathBuf,
    files: Vec<PathBuf>,
    exposures: usize,
}

impl ReplayCamera {
    /// Lists `directory`; a bracket of the folder has `exposures` frames.
    pub fn open(directory: &Path, exposures: usize) -> Result<Self, CameraError> {
        let unusable = |reason: String| CameraError::Unusable { reason: format!("{}: {reason}", directory.display()) };
        let entries = std::fs::read_dir(directory)
            .map_err(|e| unusable(format!("{e}: set camera.directory to a folder of JPEG frames")))?;
        let mut files = Vec::new();
        for entry in entries {
            let path = entry.map_err(|e| unusable(e.to_string()))?.path();
            let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
            if ENDINGS.contains(&ending.as_str()) {
                files.push(path);
            }
        }
        if files.is_empty() {
            return Err(unusable("no .jpg file in it: set camera.directory to a folder of JPEG frames".into()));
        }
        files.sort();
        Ok(Self { directory: directory.to_path_buf(), files, exposures })
    }
}

impl Camera for ReplayCamera {
    fn identity(&self) -> CameraIdentity {
        CameraIdentity { model: format!("replay of {}", self.directory.display()) }
    }

    fn is_live(&self) -> bool {
        false
    }

    fn shoot(&mut self, shot: &Shot, cancel: &Cancel) -> Result<RawFrame, CameraError> {
        if cancel.is_cancelled() {
            return Err(CameraError::Cancelled);
        }
        let no_frame = |reason| CameraError::NoFrame { station: shot.station, exposure: shot.exposure, reason };
        let (have, needed) = (self.files.len(), shot.station * self.exposures + shot.exposure + 1);
        let path = self.files.get(needed - 1).filter(|_| shot.exposure < self.exposures).ok_or_else(|| {
            let directory = self.directory.display();
            no_frame(format!("{directory} has {have} frames in brackets of {}: plan what it holds", self.exposures))
        })?;
        let begin = Instant::now();
        let bytes = std::fs::read(path).map_err(|e| no_frame(format!("{}: {e}", path.display())))?;
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        Ok(RawFrame { bytes, name, transfer: begin.elapsed() })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use rig_config::Shutter;

    fn shot(station: usize, exposure: usize) -> Shot {
        let shutter = Shutter { label: "1".into(), nominal_s: 1.0, true_s: 1.0 };
        Shot { station, exposure, shutter, f_number: 5.6, iso: 100 }
    }

    #[test]
    fn plays_bracket_by_bracket_in_name_order() {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [("b.JPG", "1"), ("a.jpg", "0"), ("c.jpeg", "2"), ("d.jpg", "3"), ("notes.txt", "x")] {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        let mut camera = ReplayCamera::open(folder.path(), 2).unwrap();
        assert!(!camera.is_live(), "it has no picture of the room");
        for (station, exposure, text) in [(0, 0, b"0"), (0, 1, b"1"), (1, 0, b"2"), (1, 1, b"3")] {
            assert_eq!(camera.shoot(&shot(station, exposure), &Cancel::default()).unwrap().bytes, text);
        }
        for (station, exposure) in [(2, 0), (0, 2)] {
            let missing = camera.shoot(&shot(station, exposure), &Cancel::default());
            assert!(matches!(missing, Err(CameraError::NoFrame { .. })), "{missing:?}");
        }
    }

    #[test]
    fn a_missing_or_empty_folder_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        for path in [folder.path().to_path_buf(), folder.path().join("missing")] {
            let error = ReplayCamera::open(&path, 2).unwrap_err().to_string();
            assert!(error.contains(&path.display().to_string()), "{error}");
        }
    }
}
