//! `rigd merge`: response and HDR merge of a folder of frames.

use super::calibrate::response::{summary, times_table};
use super::error::print_line;
use crate::numerics::image::RadianceImage;
use crate::numerics::radiometry::bracket::{Bracket, PairTest};
use crate::numerics::radiometry::merge::merge;
use crate::numerics::radiometry::noise::SensorNoise;
use crate::pipeline::calibration::response::{Calibrated, Method, ResponseCalibration, calibrate};
use crate::pipeline::decode::FrameInfo;
use crate::pipeline::develop::{BracketFrame, read_bracket};
use crate::store::exr::write_radiance;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Merge the frames of a folder to linear radiance: response and HDR.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Folder of JPEG, PNG or BMP frames of one bracket, with exposures.toml or EXIF exposure times.
    #[arg(value_name = "DIR")]
    pub dir: PathBuf,
    /// Where the radiance goes; DIR/radiance.exr if left out.
    #[arg(long, value_name = "FILE.exr")]
    pub out: Option<PathBuf>,
}

/// The folder or a file in it is unusable: what, where, what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct MergeInputError(String);

/// The list of frames beside them.
const LIST: &str = "exposures.toml";
/// A larger file is no camera's frame, bytes.
const MAX_FILE: u64 = 256 << 20;
/// An EOS 5D at ISO 100, as far as known: photographs from elsewhere say nothing of their sensor, and the weights hardly
/// depend on it.
const TYPICAL_SENSOR: SensorNoise = SensorNoise { full_well_e: 80_000.0, read_noise_e: 30.0 };

/// Merges the folder, writes the EXR and says on stdout what was found.
pub fn run(args: Args) -> anyhow::Result<()> {
    let merged = merge_folder(&args.dir)?;
    let out = args.out.unwrap_or_else(|| args.dir.join("radiance.exr"));
    let (width, height) = (merged.image.radiance.width, merged.image.radiance.height);
    let attributes = [
        ("software", format!("rigd {}", env!("CARGO_PKG_VERSION"))),
        ("exposures", times_table(&merged.calibration)),
        ("radianceUnit", "level 128 is reached after 1 / radiance seconds".to_owned()),
    ];
    write_radiance(&out, &merged.image, (0, 0), (width, height), &attributes)?;
    Ok(print_line(format!("{}wrote {}", merged.summary(), out.display()))?)
}

/// A merged folder.
pub struct Merged {
    /// The radiance.
    pub image: RadianceImage,
    /// The response, the times, and how they were found.
    pub calibration: ResponseCalibration,
    /// What exposures compared with longer ones say of their times.
    pub pairs: Vec<PairTest>,
}

impl Merged {
    /// What a person wants to know of the merge, a line each.
    fn summary(&self) -> String {
        let valid = self.image.valid.pixels.iter().filter(|v| **v).count() as f64;
        format!(
            "{} frames, {}x{} pixels, {:.1} % valid\n{}",
            self.calibration.exposures.len(),
            self.image.radiance.width,
            self.image.radiance.height,
            100.0 * valid / self.image.valid.pixels.len() as f64,
            summary(&self.calibration),
        )
    }
}

/// Reads a folder of frames, measures their times, recovers the response and merges.
pub fn merge_folder(dir: &Path) -> Result<Merged, MergeInputError> {
    let bracket = bracket_of(dir)?;
    let Calibrated { calibration, bracket, pairs } =
        calibrate(bracket, Method::Debevec).map_err(|e| MergeInputError(format!("{}: {e}", dir.display())))?;
    let response = calibration.response().map_err(MergeInputError)?;
    let image = merge(&bracket, &response, &TYPICAL_SENSOR);
    Ok(Merged { image, calibration, pairs })
}

/// The bracket in a folder, with its nominal times: those listed, or those of the EXIF.
pub(super) fn bracket_of(dir: &Path) -> Result<Bracket, MergeInputError> {
    let list = frames_of(dir)?;
    let frames: Vec<BracketFrame<'_>> = list
        .iter()
        .map(|frame| BracketFrame { name: &frame.name, bytes: &frame.bytes, time_s: frame.time_s })
        .collect();
    read_bracket(&frames, None).map_err(|e| MergeInputError(format!("{}: {e}", dir.display())))
}

struct Frame {
    name: String,
    bytes: Vec<u8>,
    /// Nominal, seconds.
    time_s: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ExposureList {
    frame: Vec<ListedFrame>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ListedFrame {
    file: PathBuf,
    time_s: f64,
}

fn frames_of(dir: &Path) -> Result<Vec<Frame>, MergeInputError> {
    let list = dir.join(LIST);
    if list.is_file() { listed_frames(dir, &list) } else { exif_frames(dir) }
}

/// Frames and times of exposures.toml; its paths are relative to the folder.
fn listed_frames(dir: &Path, list: &Path) -> Result<Vec<Frame>, MergeInputError> {
    let refuse = |reason: String| MergeInputError(format!("{}: {reason}", list.display()));
    let text = String::from_utf8(read_file(list)?).map_err(|_| refuse("it is not UTF-8 text".into()))?;
    let parsed: ExposureList = toml::from_str(&text)
        .map_err(|e| refuse(format!("{e}; write one [[frame]] with file = \"...\" and time_s = seconds per frame")))?;
    parsed
        .frame
        .into_iter()
        .map(|ListedFrame { file, time_s }| {
            let bytes = read_file(&dir.join(&file))?;
            Ok(Frame { name: file.display().to_string(), bytes, time_s })
        })
        .collect()
}

/// Every picture of the folder, with the time of its EXIF.
fn exif_frames(dir: &Path) -> Result<Vec<Frame>, MergeInputError> {
    let refuse = |reason: String| MergeInputError(format!("{}: {reason}", dir.display()));
    let unreadable = |e: std::io::Error| refuse(format!("{e}: give a folder of frames"));
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        if ["jpg", "jpeg", "png", "bmp"].contains(&ending.as_str()) {
            paths.push(path);
        }
    }
    if paths.is_empty() {
        return Err(refuse("no .jpg, .png or .bmp file in it: give a folder of frames".into()));
    }
    paths.sort();
    let mut frames = Vec::new();
    let mut timeless = Vec::new();
    for path in paths {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let bytes = read_file(&path)?;
        match FrameInfo::read(&bytes).exposure_time_s {
            Some(time_s) => frames.push(Frame { name, bytes, time_s }),
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

fn read_file(path: &Path) -> Result<Vec<u8>, MergeInputError> {
    let refuse = |reason: String| MergeInputError(format!("{}: {reason}", path.display()));
    let size = std::fs::metadata(path).map_err(|e| refuse(e.to_string()))?.len();
    if size > MAX_FILE {
        return Err(refuse(format!("{size} bytes are no camera's frame: give files of at most {MAX_FILE} bytes")));
    }
    std::fs::read(path).map_err(|e| refuse(e.to_string()))
}
