//! `rigd merge`: response and HDR merge of a folder of frames.

mod list;

use super::calibrate::response::{summary, times_table};
use super::error::print_line;
use crate::numerics::image::RadianceImage;
use crate::numerics::radiometry::bracket::{Bracket, PairTest};
use crate::numerics::radiometry::dark::Dark;
use crate::numerics::radiometry::drift::PatchMean;
use crate::numerics::radiometry::flat::Flat;
use crate::numerics::radiometry::merge::{Estimator, Merger};
use crate::numerics::radiometry::noise::SensorNoise;
use crate::numerics::radiometry::response::Response;
use crate::pipeline::calibration::response::{Calibrated, Method, ResponseCalibration, calibrate};
use crate::pipeline::develop::{BracketFrame, read_bracket};
use crate::store::exr::{Place, write_strips};
use list::{Folder, Frame, Reference};
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
    /// How samples are weighed: inverse-variance, poisson, debevec or robertson.
    #[arg(long, default_value = Estimator::InverseVariance.name(), value_parser = estimator)]
    pub estimator: Estimator,
}

fn estimator(name: &str) -> Result<Estimator, String> {
    let names = Estimator::ALL.map(Estimator::name).join(", ");
    Estimator::by_name(name).ok_or_else(|| format!("no such estimator: choose one of {names}"))
}

/// The folder or a file in it is unusable: what, where, what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct MergeInputError(String);

/// Rows merged and written at a time.
const STRIP_ROWS: usize = 16;
/// An EOS 5D at ISO 100, as far as known: photographs from elsewhere say nothing of their sensor, and the weights hardly
/// depend on it.
const TYPICAL_SENSOR: SensorNoise = SensorNoise { full_well_e: 80_000.0, read_noise_e: 30.0 };

/// Merges the folder, writes the EXR and says on stdout what was found.
pub fn run(args: Args) -> anyhow::Result<()> {
    let merged = merge_folder(&args.dir)?;
    let out = args.out.unwrap_or_else(|| args.dir.join("radiance.exr"));
    let size = (merged.bracket.width(), merged.bracket.height());
    let attributes = [
        ("software", format!("rigd {}", env!("CARGO_PKG_VERSION"))),
        ("estimator", args.estimator.name().to_owned()),
        ("exposures", times_table(&merged.calibration)),
        ("radianceUnit", "level 128 is reached after 1 / radiance seconds".to_owned()),
    ];
    let rows = merged.rows(args.estimator)?;
    let (mut strip, mut valid) = (rows.merger.empty(STRIP_ROWS), 0);
    write_strips(&out, Place { origin: (0, 0), full: size, size }, &attributes, &mut strip, |first, strip| {
        rows.strip(first, strip);
        let inside = STRIP_ROWS.min(size.1 - first) * size.0;
        valid += strip.valid.pixels[..inside].iter().filter(|valid| **valid).count();
    })?;
    let share = 100.0 * valid as f64 / (size.0 * size.1) as f64;
    Ok(print_line(format!("{}{}{share:.1} % valid\nwrote {}", merged.summary(), rows.summary(), out.display()))?)
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
    dark: Option<Dark>,
    flat: Option<Flat>,
    reference: Option<Reference>,
    dir: PathBuf,
}

/// A merge with its corrections, ready to give any rows.
struct Rows<'a> {
    merged: &'a Merged,
    merger: Merger<'a>,
    /// The reference patch as merged, and its radiance as it should be.
    lamp: Option<(PatchMean, [f64; 3])>,
}

impl Rows<'_> {
    fn strip(&self, first: usize, strip: &mut RadianceImage) {
        self.merger.strip(first, strip);
        if let Some(dark) = &self.merged.dark {
            dark.subtract(first, strip);
        }
        if let Some(flat) = &self.merged.flat {
            flat.divide(first, strip);
        }
        if let Some((seen, reference)) = &self.lamp {
            seen.normalise(*reference, strip);
        }
    }

    fn summary(&self) -> String {
        let Some((seen, reference)) = &self.lamp else { return String::new() };
        let [red, green, blue] = seen.drift(*reference).map(|drift| 100.0 * (drift - 1.0));
        format!("reference patch {:?}: lamp off by {red:+.2} {green:+.2} {blue:+.2} %, corrected\n", seen.radiance)
    }
}

impl Merged {
    /// All rows, merged and corrected.
    ///
    /// # Errors
    /// The reference patch says nothing of the lamp.
    pub fn image(&self, estimator: Estimator) -> Result<RadianceImage, MergeInputError> {
        let rows = self.rows(estimator)?;
        let mut image = rows.merger.empty(self.bracket.height());
        rows.strip(0, &mut image);
        Ok(image)
    }

    fn rows(&self, estimator: Estimator) -> Result<Rows<'_>, MergeInputError> {
        let merger = Merger::new(&self.bracket, &self.response, &TYPICAL_SENSOR, estimator);
        let mut rows = Rows { merged: self, merger, lamp: None };
        if let Some(Reference { patch, radiance }) = &self.reference {
            // The patch needs its own rows alone, but in one piece.
            let end = patch.y.saturating_add(patch.height).min(self.bracket.height());
            let mut top = rows.merger.empty(end);
            rows.strip(0, &mut top);
            let seen = patch.mean(&top).map_err(|e| refuse(&self.dir, e))?;
            rows.lamp = Some((seen, *radiance));
        }
        Ok(rows)
    }

    /// What a person wants to know of the merge, a line each.
    fn summary(&self) -> String {
        let mut text = format!(
            "{} frames, {}x{} pixels\n{}",
            self.bracket.exposures().len(),
            self.bracket.width(),
            self.bracket.height(),
            summary(&self.calibration),
        );
        if let Some(dark) = &self.dark {
            text += &format!("dark frames: {} hot pixels left out\n", dark.hot_pixels());
        }
        text
    }
}

fn refuse(dir: &Path, reason: impl ToString) -> MergeInputError {
    MergeInputError(format!("{}: {}", dir.display(), reason.to_string()))
}

/// Reads a folder of frames, measures their times, recovers the response and gets the corrections ready.
pub fn merge_folder(dir: &Path) -> Result<Merged, MergeInputError> {
    let Folder { frames, dark, flat, reference } = list::read(dir)?;
    let calibrated = calibrate(decode(dir, frames)?, Method::Debevec).map_err(|e| refuse(dir, e))?;
    let Calibrated { calibration, bracket, pairs } = calibrated;
    let response = calibration.response().map_err(MergeInputError)?;
    let dark = optional(dir, dark, &bracket, |frames| Ok(Dark::new(frames, &response, &TYPICAL_SENSOR)))?;
    let flat = optional(dir, flat, &bracket, |frames| Flat::new(frames, &response).map_err(|e| refuse(dir, e)))?;
    Ok(Merged { bracket, calibration, pairs, response, dark, flat, reference, dir: dir.to_owned() })
}

/// The bracket in a folder, with its nominal times: those listed, or those of the EXIF.
pub(super) fn bracket_of(dir: &Path) -> Result<Bracket, MergeInputError> {
    decode(dir, list::read(dir)?.frames)
}

fn decode(dir: &Path, files: Vec<Frame>) -> Result<Bracket, MergeInputError> {
    let frames: Vec<BracketFrame<'_>> =
        files.iter().map(|f| BracketFrame { name: &f.name, bytes: &f.bytes, time_s: f.time_s }).collect();
    read_bracket(&frames, None).map_err(|e| refuse(dir, e))
}

/// What frames of the bracket's size give, if there are any.
fn optional<T>(
    dir: &Path,
    files: Vec<Frame>,
    bracket: &Bracket,
    make: impl FnOnce(&Bracket) -> Result<T, MergeInputError>,
) -> Result<Option<T>, MergeInputError> {
    let Some(name) = files.first().map(|file| file.name.clone()) else { return Ok(None) };
    let frames = decode(dir, files)?;
    if (frames.width(), frames.height()) != (bracket.width(), bracket.height()) {
        return Err(refuse(
            dir,
            format!(
                "{name} is {}x{} pixels, the bracket {}x{}: give dark and flat-field frames of the same size",
                frames.width(),
                frames.height(),
                bracket.width(),
                bracket.height()
            ),
        ));
    }
    make(&frames).map(Some)
}
