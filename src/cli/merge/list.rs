//! What `rigd merge` finds in a folder: frames and their times, dark and flat-field frames, the reference patch.

use super::MergeInputError;
use crate::numerics::radiometry::drift::Patch;
use crate::pipeline::decode::FrameInfo;
use crate::store::files::{read_bytes, read_text, shown};
use serde::Deserialize;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// The list of frames beside them.
const LIST: &str = "exposures.toml";
/// How the names of raw files end.
const RAW: &str = "cr2";
/// A larger file is no camera's frame, bytes.
const MAX_FILE: u64 = 256 << 20;
/// Shutter times that cameras have, seconds: the fastest one sold makes 1/80000 s (Sony ILCE-9M3, specifications of 2023), and an
/// hour on bulb is far beyond any bracket.
const SHUTTER_S: std::ops::RangeInclusive<f64> = 1.0 / 80_000.0..=3600.0;
/// A listed time may differ from the one in the file by half a stop: a dial's label by 0.1, a measured time hardly more.
const LISTED_OFF_EV: f64 = 0.5;

/// Everything a folder holds.
#[derive(Default)]
pub(super) struct Folder {
    pub frames: Vec<Frame>,
    pub dark: Vec<Frame>,
    pub flat: Vec<Frame>,
    pub reference: Option<Reference>,
}

/// A file with its exposure time.
pub(super) struct Frame {
    pub name: String,
    path: PathBuf,
    /// Nominal, seconds.
    pub time_s: f64,
}

impl Frame {
    /// The bytes of the file.
    ///
    /// # Errors
    /// It cannot be read, or its exposure time is none that a camera has, or another than its EXIF says.
    pub fn read(&self) -> Result<Vec<u8>, MergeInputError> {
        let refuse = |reason: String| MergeInputError(format!("{}: {reason}", shown(&self.path)));
        if !SHUTTER_S.contains(&self.time_s) {
            let (least, most) = (1.0 / SHUTTER_S.start(), SHUTTER_S.end());
            return Err(refuse(format!(
                "exposure time {} s: cameras open for 1/{least:.0} to {most} s; give seconds in {LIST}",
                self.time_s
            )));
        }
        let bytes = read_file(&self.path)?;
        match FrameInfo::read(&bytes).exposure_time_s {
            Some(shot) if (self.time_s / shot).log2().abs() > LISTED_OFF_EV => Err(refuse(format!(
                "{LIST} says {} s, the EXIF of the file {shot} s: correct the time, or the file that is meant",
                self.time_s
            ))),
            _ => Ok(bytes),
        }
    }

    fn is_raw(&self) -> bool {
        ending(&self.path) == RAW
    }
}

impl Folder {
    /// Every file that is read: none may be written over.
    pub fn inputs(&self, dir: &Path) -> Vec<PathBuf> {
        let all = self.frames.iter().chain(&self.dark).chain(&self.flat);
        all.map(|frame| frame.path.clone()).chain([dir.join(LIST)]).collect()
    }

    /// Whether the frames are raw files.
    ///
    /// # Errors
    /// Some are and some are not.
    pub fn is_raw(&self, dir: &Path) -> Result<bool, MergeInputError> {
        let all = || self.frames.iter().chain(&self.dark).chain(&self.flat);
        let (raw, other) = (all().find(|frame| frame.is_raw()), all().find(|frame| !frame.is_raw()));
        match (raw, other) {
            (Some(raw), Some(other)) => Err(MergeInputError(format!(
                "{}: {} is a raw file, {} is not: keep one kind in the folder, or list it in {LIST}",
                dir.display(),
                raw.name,
                other.name
            ))),
            (raw, _) => Ok(raw.is_some()),
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ExposureList {
    frame: Vec<ListedFrame>,
    #[serde(default)]
    dark: Vec<ListedFrame>,
    #[serde(default)]
    flat: Vec<ListedFrame>,
    reference_patch: Option<ListedPatch>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ListedPatch {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
    radiance: [f64; 3],
}

/// A patch of the picture and the radiance it has when the lamp is as bright as it should be.
pub(super) struct Reference {
    pub patch: Patch,
    pub radiance: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ListedFrame {
    file: PathBuf,
    time_s: f64,
}

/// Reads the files of a folder.
pub(super) fn read(dir: &Path) -> Result<Folder, MergeInputError> {
    let list = dir.join(LIST);
    if list.symlink_metadata().is_ok() {
        return listed(dir, &list);
    }
    Ok(Folder { frames: exif_frames(dir)?, ..Folder::default() })
}

/// Frames and times of exposures.toml; its paths are relative to the folder.
fn listed(dir: &Path, list: &Path) -> Result<Folder, MergeInputError> {
    let refuse = |reason: String| MergeInputError(format!("{}: {reason}", list.display()));
    let text = read_text(list, "list of frames").map_err(refuse)?;
    let parsed: ExposureList = toml::from_str(&text)
        .map_err(|e| refuse(format!("{e}; write one [[frame]] with file = \"...\" and time_s = seconds per frame")))?;
    let files = |listed: Vec<ListedFrame>| {
        let file = |ListedFrame { file, time_s }: ListedFrame| Frame {
            name: file.display().to_string(),
            path: dir.join(&file),
            time_s,
        };
        listed.into_iter().map(file).collect()
    };
    let mut named = HashSet::new();
    if let Some(twice) = parsed.frame.iter().find(|frame| !named.insert(&frame.file)) {
        return Err(refuse(format!("{} is listed twice: give each frame once", twice.file.display())));
    }
    let reference = parsed.reference_patch.map(|ListedPatch { x, y, width, height, radiance }| Reference {
        patch: Patch { x, y, width, height },
        radiance,
    });
    if reference.as_ref().is_some_and(|r| r.radiance.iter().any(|v| !(v.is_finite() && *v > 0.0))) {
        return Err(refuse(
            "reference_patch: radiance must be three positive numbers: take those rigd merge prints".into(),
        ));
    }
    Ok(Folder { frames: files(parsed.frame), dark: files(parsed.dark), flat: files(parsed.flat), reference })
}

/// Every picture of the folder, with the time of its EXIF.
fn exif_frames(dir: &Path) -> Result<Vec<Frame>, MergeInputError> {
    let refuse = |reason: String| MergeInputError(format!("{}: {reason}", dir.display()));
    let unreadable = |e: std::io::Error| refuse(format!("{e}: give a folder of frames"));
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if [RAW, "jpg", "jpeg", "png", "bmp"].contains(&ending(&path).as_str()) {
            paths.push(path);
        }
    }
    if paths.is_empty() {
        return Err(refuse("no .jpg, .png, .bmp or .cr2 file in it: give a folder of frames".into()));
    }
    paths.sort();
    let mut frames = Vec::new();
    let mut timeless = Vec::new();
    for path in paths {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        match FrameInfo::read(&read_file(&path)?).exposure_time_s {
            Some(time_s) => frames.push(Frame { name, path, time_s }),
            None => timeless.push(name),
        }
    }
    if timeless.is_empty() {
        return Ok(frames);
    }
    Err(refuse(format!(
        "no exposure time in the EXIF of {}: write {LIST} with file and time_s of every [[frame]]",
        timeless.join(", ")
    )))
}

fn ending(path: &Path) -> String {
    path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default()
}

fn read_file(path: &Path) -> Result<Vec<u8>, MergeInputError> {
    read_bytes(path, "camera's frame", MAX_FILE).map_err(|reason| MergeInputError(format!("{}: {reason}", shown(path))))
}
