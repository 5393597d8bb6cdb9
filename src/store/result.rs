//! Result directories (docs/dataset.md): report.json, material.json, weights.exr, valid.png, residual.exr, residual.png, preview.png, and
//! beside them weights_sigma.exr with the standard error of every weight.

use super::dataset;
use super::exr::{self, Planes, read_planes, write_planes};
use super::files::{self, Unfinished, shown};
use super::png;
use crate::numerics::brdf;
use crate::numerics::fit::predict;
use crate::numerics::image::Image;
use crate::pipeline::fit::FitResult;
use crate::pipeline::preview::{preview, residuals};
use crate::pipeline::report::MaterialFile;
use std::path::{Path, PathBuf};

/// The files of a result, all of them written by [`write()`].
pub const FILES: [&str; 8] = [
    "report.json",
    "material.json",
    "weights.exr",
    "weights_sigma.exr",
    "valid.png",
    "residual.exr",
    "residual.png",
    "preview.png",
];

/// Why a result cannot be written or read.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}")]
pub struct ResultError {
    /// The file.
    pub path: String,
    /// What is wrong and what to do.
    pub reason: String,
}

fn error(path: &Path, reason: impl ToString) -> ResultError {
    ResultError { path: shown(path), reason: reason.to_string() }
}

/// Makes `directory` ready for a result, before a fit is spent on it; none of its files may be one of the `inputs`.
///
/// # Errors
/// The path at fault, what is wrong with it, and what to do.
pub fn make_ready(directory: &Path, inputs: &[PathBuf]) -> Result<(), ResultError> {
    files::make_ready(directory, FILES, inputs).map_err(|(path, reason)| error(&path, reason))
}

/// Writes every file of a result into `directory` (made if missing). All are written beside their names first: where that
/// fails, an earlier result stays as it was. While the names change there is no report: where it is, the result is whole.
pub fn write(directory: &Path, result: &FitResult) -> Result<(), ResultError> {
    std::fs::create_dir_all(directory).map_err(|e| error(directory, e))?;
    let mut unfinished = Unfinished::within(directory);
    write_json(&unfinished.path("material.json"), &result.material)?;
    write_weights(
        &unfinished.path("weights.exr"),
        result,
        &result.mixture.gamma,
        "material weight gamma, gauge: max = 1 per material",
    )?;
    write_weights(
        &unfinished.path("weights_sigma.exr"),
        result,
        &result.uncertainty.gamma,
        "standard error of the material weight, BRDF parameters fixed",
    )?;
    write_residual(&unfinished.path("residual.exr"), result)?;
    let mut valid = Image::filled(result.size[0], result.size[1], [0_u8; 3]);
    for &pixel in &result.observations.pixel {
        valid.pixels[pixel] = [255; 3];
    }
    let picture = |path: PathBuf, picture: &Image<[u8; 3]>| png::write(&path, picture).map_err(|e| error(&path, e));
    picture(unfinished.path("valid.png"), &valid)?;
    picture(unfinished.path("residual.png"), &residuals(result))?;
    picture(unfinished.path("preview.png"), &preview(result))?;
    write_json(&unfinished.path("report.json"), &result.report)?;
    unfinished.finish().map_err(|(path, e)| error(&path, e))
}

fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<(), ResultError> {
    let text = serde_json::to_string_pretty(value).map_err(|e| error(path, e))?;
    std::fs::write(path, text + "\n").map_err(|e| error(path, e))
}

fn write_weights(path: &Path, result: &FitResult, values: &[f64], about: &str) -> Result<(), ResultError> {
    let count = result.mixture.materials.len();
    let [width, height] = result.size;
    let plane = |m: usize| {
        let mut pixels = vec![0.0_f32; width * height];
        for (point, &pixel) in result.observations.pixel.iter().enumerate() {
            pixels[pixel] = values[point * count + m] as f32;
        }
        (channel_name(m), pixels)
    };
    let planes = Planes {
        origin: (0, 0),
        full: (width, height),
        size: (width, height),
        channels: (0..count).map(plane).collect(),
    };
    write_planes(path, planes, about).map_err(|e| ResultError { path: e.path, reason: e.reason })
}

/// Channel of material `m` (from 0) in weights.exr.
fn channel_name(m: usize) -> String {
    format!("material_{}", m + 1)
}

/// Mean over a point's samples of |I - model| / I per channel.
fn write_residual(path: &Path, result: &FitResult) -> Result<(), ResultError> {
    let Some(lobe) = brdf::by_name(&result.material.model) else {
        return Err(error(path, format!("unknown BRDF model {}", result.material.model)));
    };
    let [width, height] = result.size;
    let mut channels: Vec<(String, Vec<f32>)> =
        ["R", "G", "B"].map(|name| (name.to_owned(), vec![0.0; width * height])).to_vec();
    for (point, &pixel) in result.observations.pixel.iter().enumerate() {
        let samples = result.observations.of(point);
        let count = samples.len() as f64;
        for sample in samples {
            let model = predict(lobe, &result.mixture.materials, result.mixture.weights_of(point), &sample);
            for c in 0..3 {
                let relative = (sample.radiance[c] - model[c]).abs() / sample.radiance[c];
                channels[c].1[pixel] += (relative / count) as f32;
            }
        }
    }
    let planes = Planes { origin: (0, 0), full: (width, height), size: (width, height), channels };
    write_planes(path, planes, "mean over lights of |I - model| / I")
        .map_err(|e| ResultError { path: e.path, reason: e.reason })
}

/// A material read back: its description and one weight map a material.
pub struct StoredMaterial {
    /// `material.json`.
    pub material: MaterialFile,
    /// Weight maps, in the order of the materials.
    pub weights: Vec<Image<f32>>,
}

/// The files that [`read_material`] opens.
pub fn inputs(directory: &Path) -> [PathBuf; 2] {
    ["material.json", "weights.exr"].map(|name| directory.join(name))
}

/// Reads material.json and weights.exr of a result directory.
///
/// # Errors
/// A file is missing, or does not say all that predicting radiance needs: what, where, what to do.
pub fn read_material(directory: &Path) -> Result<StoredMaterial, ResultError> {
    let [path, weights_path] = inputs(directory);
    let text = files::read_text(&path, "material description")
        .map_err(|reason| error(&path, format!("{reason}; give a directory written by `rigd fit --out`")))?;
    let material: MaterialFile = serde_json::from_str(&text).map_err(|e| error(&path, e))?;
    material.check().map_err(|reason| error(&path, format!("{reason}; fit again or mend the file")))?;
    let weights = read_maps(&weights_path, &material)?;
    for (m, map) in weights.iter().enumerate() {
        if let Some(bad) = map.pixels.iter().find(|v| !v.is_finite() || **v < 0.0) {
            let name = channel_name(m);
            let reason = format!("the channel {name} holds {bad}; weights are finite and not negative");
            return Err(error(&weights_path, reason));
        }
    }
    Ok(StoredMaterial { material, weights })
}

/// The file that [`read_sigma`] opens.
pub fn sigma_file(directory: &Path) -> PathBuf {
    directory.join("weights_sigma.exr")
}

/// Standard errors of the weights of `material`, read from the same directory, in the order of the materials; infinite where
/// the data do not determine a weight.
///
/// # Errors
/// The file is missing, damaged, or of another material.
pub fn read_sigma(directory: &Path, material: &MaterialFile) -> Result<Vec<Image<f32>>, ResultError> {
    read_maps(&sigma_file(directory), material)
}

/// What a fit says of every pixel beside the weights.
pub struct FitMaps {
    /// Where it used samples.
    pub valid: Image<bool>,
    /// Mean over lights of |I - model| / I per channel.
    pub residual: Image<[f32; 3]>,
}

/// Reads valid.png and residual.exr of a result directory.
///
/// # Errors
/// A file is missing, damaged, or of another size than the weight map.
pub fn read_maps_of_fit(directory: &Path, material: &MaterialFile) -> Result<FitMaps, ResultError> {
    let [width, height] = material.size;
    let residual = directory.join("residual.exr");
    let residual =
        exr::read_vectors(&residual, (width, height)).map_err(|e| ResultError { path: e.path, reason: e.reason })?;
    let path = directory.join("valid.png");
    let valid = dataset::read_mask(&path, (width, height)).map_err(|reason| {
        // It names the file, as this error does.
        error(&path, reason.strip_prefix(&format!("{}: ", shown(&path))).unwrap_or(&reason))
    })?;
    Ok(FitMaps { valid, residual })
}

/// One map a material, in the order of the materials.
fn read_maps(path: &Path, material: &MaterialFile) -> Result<Vec<Image<f32>>, ResultError> {
    let [width, height] = material.size;
    let mut planes = read_planes(path, (width, height)).map_err(|e| ResultError { path: e.path, reason: e.reason })?;
    if planes.size != planes.full {
        return Err(error(path, "the weight map does not fill its frame"));
    }
    let (count, channels) = (material.materials.len(), planes.channels.len());
    if count != channels {
        let reason = format!("{channels} channels, but material.json has {count} materials: take both from one fit");
        return Err(error(path, reason));
    }
    let map = |m: usize| {
        let name = channel_name(m);
        let pixels = planes.take(&name).ok_or_else(|| error(path, format!("the channel {name} is missing")))?;
        Ok(Image { width, height, pixels })
    };
    (0..count).map(map).collect()
}
