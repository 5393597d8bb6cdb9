//! `rigd merge` on Canon raw files: no response, merged on the mosaic, half-size.

use super::corrections::{Corrections, Rows, check_dark_radiance};
use super::list::{Folder, Frame};
use super::{MergeInputError, attributes, record, refuse, same_size};
use crate::cli::calibrate::response::times_table;
use crate::cli::error::{print_json, print_line};
use crate::cli::progress::Progress;
use crate::cli::target::Target;
use crate::numerics::image::RadianceImage;
use crate::numerics::radiometry::dark::Dark;
use crate::numerics::radiometry::flat::{Fields, Flat};
use crate::numerics::radiometry::merge::Estimator;
use crate::numerics::radiometry::mosaic::RawBracket;
use crate::numerics::radiometry::mosaic::merge::RawMerger;
use crate::pipeline::decode::power_of_two_s;
use crate::pipeline::raw::{RawFolder, RawShot, measure};
use std::path::Path;

/// Read noise this far from what the table says, as a factor, is worth a word.
const SURPRISING: f64 = 1.5;
/// Merges the raw files, writes the EXR and says on stdout what was found.
pub(super) fn run(
    dir: &Path,
    folder: Folder,
    (estimator, json): (Estimator, bool),
    target: &Target,
    progress: &Progress,
) -> anyhow::Result<()> {
    let Folder { frames, dark, flat, reference } = folder;
    progress.stage(&format!("reading and measuring {} raw frames", frames.len()));
    // First the corrections, so that their frames have left the memory when the bracket comes.
    let corrections = Corrections { dark: dark_of(dir, &dark)?, flat: flat_of(dir, &flat)?, reference };
    let shot = read(dir, &frames)?;
    let size = (shot.bracket.width(), shot.bracket.height());
    let sizes = [corrections.dark.as_ref().map(Dark::size), corrections.flat.as_ref().map(Flat::size)];
    for (files, own) in [&dark, &flat].into_iter().zip(sizes) {
        if let (Some(first), Some(own)) = (files.first(), own) {
            same_size(dir, &first.name, own, size)?;
        }
    }
    let shot_with = shot_with(&shot);
    let RawShot { bracket, iso, .. } = shot;
    let (bracket, times) = measure(bracket).map_err(|e| refuse(dir, e))?;
    let merger = merger(dir, &bracket, estimator)?;
    let merge = |first: usize, strip: &mut RadianceImage| merger.strip(first, strip);
    let rows = Rows::new(&corrections, &merge, size).map_err(|e| refuse(dir, e))?;
    let table = times_table(&times.exposures, &times.reference);
    let unit = format!("a photosite saturates after 1 / radiance seconds at ISO {iso}");
    progress.stage("merging");
    let valid = target.write(|path| rows.write(path, &attributes(estimator, table.clone(), unit)))?;
    progress.end();
    if json {
        let times = serde_json::json!({
            "exposures": times.exposures, "reference": times.reference, "warnings": times.warnings,
        });
        return print_json(&record(target, bracket.frames().len(), size, valid, ("times", times)));
    }
    let written = format!("{}wrote {}", rows.told(valid), target.path().display());
    let mut found = format!("{} raw frames, {}x{} pixels\n{shot_with}{table}", bracket.frames().len(), size.0, size.1);
    times.warnings.iter().for_each(|warning| found += &format!("warning: {warning}\n"));
    Ok(print_line(found + &corrections.summary() + &written)?)
}

fn read(dir: &Path, files: &[Frame]) -> Result<RawShot, MergeInputError> {
    let mut folder = RawFolder::default();
    for file in files {
        folder.add(&file.name, &file.read()?, file.time_s).map_err(|e| refuse(dir, e))?;
    }
    folder.bracket().map_err(|e| refuse(dir, e))
}

fn merger<'a>(dir: &Path, bracket: &'a RawBracket, estimator: Estimator) -> Result<RawMerger<'a>, MergeInputError> {
    let levels_only = || {
        let [first, second] = [Estimator::InverseVariance, Estimator::Poisson].map(Estimator::name);
        refuse(dir, format!("{} weighs 8-bit levels: for raw frames say {first} or {second}", estimator.name()))
    };
    RawMerger::new(bracket, estimator).ok_or_else(levels_only)
}

/// Dark frames show the dark signal as a bracket shows radiance; none without them.
fn dark_of(dir: &Path, files: &[Frame]) -> Result<Option<Dark>, MergeInputError> {
    if files.is_empty() {
        return Ok(None);
    }
    let frames = read(dir, files)?.bracket;
    let times: Vec<f64> = frames.times_s().iter().map(|&time| power_of_two_s(time).unwrap_or(time)).collect();
    let longest = times.iter().copied().fold(0.0, f64::max);
    let frames = frames.with_times(&times).map_err(|e| refuse(dir, e))?;
    let shown = merger(dir, &frames, Estimator::InverseVariance)?.whole();
    let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
    check_dark_radiance(&names.join(", "), &shown, longest).map_err(|e| refuse(dir, e))?;
    Ok(Some(Dark::of_radiance(shown, longest)))
}

/// The flat field of single frames, one in memory at a time; none without them.
fn flat_of(dir: &Path, files: &[Frame]) -> Result<Option<Flat>, MergeInputError> {
    let mut fields: Option<Fields> = None;
    for file in files {
        let frame = read(dir, std::slice::from_ref(file))?.bracket;
        let size = (frame.width(), frame.height());
        let fields = fields.get_or_insert_with(|| Fields::new(size.0, size.1));
        same_size(dir, &file.name, size, fields.size())?;
        let field = merger(dir, &frame, Estimator::InverseVariance)?.whole();
        fields.add(&file.name, &field).map_err(|e| refuse(dir, e))?;
    }
    fields.map(|fields| fields.flat().map_err(|e| refuse(dir, e))).transpose()
}

/// Body, black level and noise, a line each.
fn shot_with(RawShot { bracket, body, iso }: &RawShot) -> String {
    let noise = bracket.noise();
    let mut text = format!(
        "{} at ISO {iso}: full well {:.0} e- ({}), read noise {:.1} e- (masked photosites of these frames)\n",
        body.model, noise.full_well_e, body.full_well_e.basis, noise.read_noise_e
    );
    let blacks = bracket.frames().iter().map(|frame| frame.black.level.iter().sum::<f64>() / 4.0);
    let (low, high) = blacks.fold((f64::INFINITY, 0.0_f64), |(low, high), black| (low.min(black), high.max(black)));
    text += &format!("black level {low:.2} to {high:.2}, white {} ({})\n", body.white.value, body.white.basis);
    if let Some(table) = body.read_noise_at(*iso)
        && (noise.read_noise_e / table.value).ln().abs() > SURPRISING.ln()
    {
        text += &format!(
            "note: the table of bodies says {} e- at ISO {} ({}): the frames' own read noise is used\n",
            table.value, table.iso, table.basis
        );
    }
    text
}
