//! `rigd merge`: response and HDR merge of a folder of frames.

mod corrections;
mod list;
mod raw;

use super::calibrate::response::{summary, times_table};
use super::error::{print_json, print_line};
use super::progress::Progress;
use super::target::Target;
use crate::numerics::image::RadianceImage;
use crate::numerics::radiometry::bracket::{Bracket, PairTest};
use crate::numerics::radiometry::dark::Dark;
use crate::numerics::radiometry::flat::Flat;
use crate::numerics::radiometry::merge::{Estimator, Merger};
use crate::numerics::radiometry::noise::SensorNoise;
use crate::numerics::radiometry::response::Response;
use crate::pipeline::calibration::response::{Calibrated, Method, ResponseCalibration, calibrate};
use crate::pipeline::develop::{BracketFrame, read_bracket};
use corrections::{Corrections, Merge, Rows, check_dark};
use list::{Folder, Frame};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Merge the frames of a folder to linear radiance: response and HDR.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Folder of JPEG, PNG or BMP frames of one bracket, or of Canon CR2 files, with exposures.toml or EXIF exposure
    /// times.
    #[arg(value_name = "DIR")]
    pub dir: PathBuf,
    /// Where the radiance goes; DIR/radiance.exr if left out.
    #[arg(long, value_name = "FILE.exr")]
    pub out: Option<PathBuf>,
    /// How samples are weighed: inverse-variance, poisson, debevec or robertson (raw frames: the first two).
    #[arg(long, default_value = Estimator::InverseVariance.name(), value_parser = estimator)]
    pub estimator: Estimator,
    /// Print what was measured and written as JSON and nothing else.
    #[arg(long)]
    pub json: bool,
}

fn estimator(name: &str) -> Result<Estimator, String> {
    let names = Estimator::ALL.map(Estimator::name).join(", ");
    Estimator::by_name(name).ok_or_else(|| format!("no such estimator: choose one of {names}"))
}

/// The folder or a file in it is unusable: what, where, what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct MergeInputError(String);

/// An EOS 5D at ISO 100, as far as known: photographs from elsewhere say nothing of their sensor, and the weights
/// hardly depend on it.
const TYPICAL_SENSOR: SensorNoise = SensorNoise { full_well_e: 80_000.0, read_noise_e: 30.0 };

/// Merges the folder, writes the EXR and says on stdout what was found.
pub fn run(args: Args) -> anyhow::Result<()> {
    let folder = list::read(&args.dir)?;
    let out = args.out.unwrap_or_else(|| args.dir.join("radiance.exr"));
    let target = Target::new(&out, "exr", &folder.inputs(&args.dir)).map_err(MergeInputError)?;
    let progress = Progress::stages_unless(args.json);
    if folder.is_raw(&args.dir)? {
        return raw::run(&args.dir, folder, (args.estimator, args.json), &target, &progress);
    }
    progress.stage(&format!("reading and measuring {} frames", folder.frames.len()));
    let merged = merge(&args.dir, folder)?;
    let merger = merged.merger(args.estimator);
    let merge = |first: usize, strip: &mut RadianceImage| merger.strip(first, strip);
    let rows = merged.rows(&merge)?;
    let unit = "level 128 is reached after 1 / radiance seconds".to_owned();
    let table = times_table(&merged.calibration.exposures, &merged.calibration.reference);
    progress.stage("merging");
    let valid = target.write(|path| rows.write(path, &attributes(args.estimator, table, unit)))?;
    progress.end();
    if args.json {
        let size = (merged.bracket.width(), merged.bracket.height());
        let measured = ("calibration", serde_json::to_value(&merged.calibration)?);
        return print_json(&record(&target, merged.bracket.exposures().len(), size, valid, measured));
    }
    Ok(print_line(format!("{}{}wrote {}", merged.summary(), rows.told(valid), target.path().display()))?)
}

/// What was merged, and under a name what was measured on the frames.
fn record(target: &Target, frames: usize, size: (usize, usize), valid: f64, measured: (&str, Value)) -> Value {
    let (out, (width, height), (name, measured)) = (target.path(), size, measured);
    json!({ "out": out, "frames": frames, "width": width, "height": height, "valid_share": valid, name: measured })
}

/// What the file says of its pixels.
fn attributes(estimator: Estimator, exposures: String, unit: String) -> [(&'static str, String); 4] {
    [
        ("software", format!("rigd {}", env!("CARGO_PKG_VERSION"))),
        ("estimator", estimator.name().to_owned()),
        ("exposures", exposures),
        ("radianceUnit", unit),
    ]
}

/// A folder read, its response recovered; merged as far as rows are asked for.
pub struct Merged {
    /// The frames, with the times measured on them.
    pub bracket: Bracket,
    /// The response, the times, and how they were found.
    pub calibration: ResponseCalibration,
    /// What exposures compared with longer ones say of their times.
    pub pairs: Vec<PairTest>,
    response: Response,
    corrections: Corrections,
    dir: PathBuf,
}

impl Merged {
    /// All rows, merged and corrected.
    ///
    /// # Errors
    /// The reference patch says nothing of the lamp.
    pub fn image(&self, estimator: Estimator) -> Result<RadianceImage, MergeInputError> {
        let merger = self.merger(estimator);
        let merge = |first: usize, strip: &mut RadianceImage| merger.strip(first, strip);
        Ok(self.rows(&merge)?.whole())
    }

    fn merger(&self, estimator: Estimator) -> Merger<'_> {
        Merger::new(&self.bracket, &self.response, &TYPICAL_SENSOR, estimator)
    }

    fn rows<'a>(&'a self, merge: Merge<'a>) -> Result<Rows<'a>, MergeInputError> {
        let size = (self.bracket.width(), self.bracket.height());
        Rows::new(&self.corrections, merge, size).map_err(|e| refuse(&self.dir, e))
    }

    /// What a person wants to know of the merge, a line each.
    fn summary(&self) -> String {
        format!(
            "{} frames, {}x{} pixels\n{}{}",
            self.bracket.exposures().len(),
            self.bracket.width(),
            self.bracket.height(),
            summary(&self.calibration),
            self.corrections.summary()
        )
    }
}

fn refuse(dir: &Path, reason: impl ToString) -> MergeInputError {
    MergeInputError(format!("{}: {}", dir.display(), reason.to_string()))
}

/// Reads a folder of 8-bit frames, measures their times, recovers the response and gets the corrections ready.
pub fn merge_folder(dir: &Path) -> Result<Merged, MergeInputError> {
    merge(dir, list::read(dir)?)
}

fn merge(dir: &Path, folder: Folder) -> Result<Merged, MergeInputError> {
    let Folder { frames, dark, flat, reference } = folder;
    let calibrated = calibrate(decode(dir, &frames)?, Method::Debevec).map_err(|e| refuse(dir, e))?;
    let Calibrated { calibration, bracket, pairs } = calibrated;
    let response = calibration.response().map_err(MergeInputError)?;
    let dark = optional(dir, &dark, &bracket, |frames| {
        check_dark(frames).map_err(|e| refuse(dir, e))?;
        Ok(Dark::new(frames, &response, &TYPICAL_SENSOR))
    })?;
    let flat = optional(dir, &flat, &bracket, |frames| Flat::new(frames, &response).map_err(|e| refuse(dir, e)))?;
    let corrections = Corrections { dark, flat, reference };
    Ok(Merged { bracket, calibration, pairs, response, corrections, dir: dir.to_owned() })
}

/// The bracket in a folder, with its nominal times: those listed, or those of the EXIF.
///
/// # Errors
/// The folder is unusable, or its frames are raw.
pub(super) fn bracket_of(dir: &Path) -> Result<Bracket, MergeInputError> {
    let folder = list::read(dir)?;
    if folder.is_raw(dir)? {
        return Err(refuse(
            dir,
            "raw frames are linear and need no response: give them to rigd merge, which measures their times",
        ));
    }
    decode(dir, &folder.frames)
}

fn decode(dir: &Path, files: &[Frame]) -> Result<Bracket, MergeInputError> {
    let bytes = files.iter().map(Frame::read).collect::<Result<Vec<_>, _>>()?;
    let frames: Vec<BracketFrame<'_>> =
        files.iter().zip(&bytes).map(|(f, bytes)| BracketFrame { name: &f.name, bytes, time_s: f.time_s }).collect();
    read_bracket(&frames, None).map_err(|e| refuse(dir, e))
}

/// What frames of the bracket's size give, if there are any.
fn optional<T>(
    dir: &Path,
    files: &[Frame],
    bracket: &Bracket,
    make: impl FnOnce(&Bracket) -> Result<T, MergeInputError>,
) -> Result<Option<T>, MergeInputError> {
    let Some(first) = files.first() else { return Ok(None) };
    let frames = decode(dir, files)?;
    let size = |bracket: &Bracket| (bracket.width(), bracket.height());
    same_size(dir, &first.name, size(&frames), size(bracket))?;
    make(&frames).map(Some)
}

/// Refuses frames `name` of a size (columns, rows) that is not the bracket's.
fn same_size(dir: &Path, name: &str, own: (usize, usize), bracket: (usize, usize)) -> Result<(), MergeInputError> {
    if own == bracket {
        return Ok(());
    }
    Err(refuse(
        dir,
        format!(
            "{name} is {}x{} pixels, the bracket {}x{}: give dark and flat-field frames of the same size",
            own.0, own.1, bracket.0, bracket.1
        ),
    ))
}
