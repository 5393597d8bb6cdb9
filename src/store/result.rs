//! Result directories (docs/dataset.md): report.json, material.json, weights.exr, valid.png, residual.exr, preview.png, and
//! beside them weights_sigma.exr with the standard error of every weight.

use super::exr::{Planes, read_planes, write_planes};
use crate::numerics::brdf;
use crate::numerics::fit::predict;
use crate::numerics::image::Image;
use crate::pipeline::fit::FitResult;
use crate::pipeline::preview::preview;
use crate::pipeline::report::MaterialFile;
use std::path::Path;

/// The files of a result, all of them written by [`write()`].
pub const FILES: [&str; 7] =
    ["report.json", "material.json", "weights.exr", "weights_sigma.exr", "valid.png", "residual.exr", "preview.png"];

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
    ResultError { path: path.display().to_string(), reason: reason.to_string() }
}

/// Writes every file of a result into `directory` (made if missing).
pub fn write(directory: &Path, result: &FitResult) -> Result<(), ResultError> {
    std::fs::create_dir_all(directory).map_err(|e| error(directory, e))?;
    write_json(&directory.join("material.json"), &result.material)?;
    write_weights(
        &directory.join("weights.exr"),
        result,
        &result.mixture.gamma,
        "material weight gamma, gauge: max = 1 per material",
    )?;
    write_weights(
        &directory.join("weights_sigma.exr"),
        result,
        &result.uncertainty.gamma,
        "standard error of the material weight, BRDF parameters fixed",
    )?;
    write_residual(&directory.join("residual.exr"), result)?;
    let mut valid = Image::filled(result.size[0], result.size[1], [0_u8; 3]);
    for &pixel in &result.observations.pixel {
        valid.pixels[pixel] = [255; 3];
    }
    write_png(&directory.join("valid.png"), &valid)?;
    write_png(&directory.join("preview.png"), &preview(result))?;
    // The report comes last: where it is, the result is whole.
    write_json(&directory.join("report.json"), &result.report)
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

fn write_png(path: &Path, picture: &Image<[u8; 3]>) -> Result<(), ResultError> {
    let bytes: Vec<u8> = picture.pixels.iter().flatten().copied().collect();
    let (width, height) = (picture.width as u32, picture.height as u32);
    image::save_buffer(path, &bytes, width, height, image::ExtendedColorType::Rgb8).map_err(|e| error(path, e))
}

/// A material read back: its description and one weight map a material.
pub struct StoredMaterial {
    /// `material.json`.
    pub material: MaterialFile,
    /// Weight maps, in the order of the materials.
    pub weights: Vec<Image<f32>>,
}

/// Reads material.json and weights.exr of a result directory.
pub fn read_material(directory: &Path) -> Result<StoredMaterial, ResultError> {
    let path = directory.join("material.json");
    let text = std::fs::read_to_string(&path)
        .map_err(|e| error(&path, format!("{e}; give a directory written by `rigd fit --out`")))?;
    let material: MaterialFile = serde_json::from_str(&text).map_err(|e| error(&path, e))?;
    if material.format != 1 || brdf::by_name(&material.model).is_none() {
        return Err(error(
            &path,
            format!("format {} with model \"{}\" cannot be read by this version", material.format, material.model),
        ));
    }
    let path = directory.join("weights.exr");
    let [width, height] = material.size;
    let planes = read_planes(&path, (width, height)).map_err(|e| ResultError { path: e.path, reason: e.reason })?;
    if planes.size != planes.full {
        return Err(error(&path, "the weight map does not fill its frame"));
    }
    let mut weights = Vec::new();
    for m in 0..material.materials.len() {
        let name = channel_name(m);
        let found = planes.channels.iter().find(|(known, _)| *known == name);
        let (_, pixels) = found.ok_or_else(|| error(&path, format!("the channel {name} is missing")))?;
        if let Some(bad) = pixels.iter().find(|v| !v.is_finite() || **v < 0.0) {
            return Err(error(&path, format!("the channel {name} holds {bad}; weights are finite and not negative")));
        }
        weights.push(Image { width, height, pixels: pixels.clone() });
    }
    Ok(StoredMaterial { material, weights })
}
