//! `rigd relight`: the radiance images a fitted material sends under the lights of a dataset.

use super::error::{bad_input, print_json, print_line};
use super::place;
use super::progress::Progress;
use crate::numerics::brdf;
use crate::numerics::image::{Image, RadianceImage};
use crate::pipeline::relight::relight;
use crate::store::{dataset, exr, files, result};
use std::fmt::Display;
use std::path::PathBuf;

/// Predict the radiance image of every light of a dataset: same camera and object.
#[derive(clap::Args)]
pub struct Args {
    /// Result directory written by `rigd fit --out`, a session's directory, or DATA/ID.
    pub result: PathBuf,
    /// Dataset directory whose lights are used, as a session's is; DATA/ID as well. Its images need not exist.
    #[arg(long)]
    pub lights: PathBuf,
    /// Where to write one EXR a light; a file of the result or of the dataset is never written over.
    #[arg(long)]
    pub out: PathBuf,
    /// Print the files that were written, a light each, as JSON and nothing else.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let lights = &place::dataset(&args.lights).map_err(bad_input)?;
    let result = &place::result(&args.result).map_err(bad_input)?;
    let stored = result::read_material(result).map_err(bad_input)?;
    let geometry = dataset::read_geometry(lights).map_err(bad_input)?;
    let size = [geometry.width, geometry.height];
    if size != stored.material.size {
        return Err(bad_input(format!(
            "{}: {} x {} pixels, but the material in {} was fitted at {} x {}: relight with the same camera",
            lights.display(),
            size[0],
            size[1],
            result.display(),
            stored.material.size[0],
            stored.material.size[1]
        )));
    }
    let Some(lobe) = brdf::by_name(&stored.material.model) else {
        return Err(bad_input(format!("unknown BRDF model {}", stored.material.model)));
    };
    let names: Vec<String> = (0..geometry.lights.len()).map(|index| format!("{index:03}.exr")).collect();
    let mut inputs = dataset::inputs(lights).map_err(bad_input)?;
    inputs.extend(result::inputs(result));
    files::make_ready(&args.out, names.iter().map(String::as_str), &inputs).map_err(at_path).map_err(bad_input)?;
    let materials = stored.material.materials();
    let progress = Progress::counted_unless(args.json, "images");
    for ((index, light), name) in geometry.lights.iter().enumerate().zip(&names) {
        let radiance = relight(lobe, &materials, &stored.weights, &geometry, &light.light);
        if let Some(pixel) = radiance.pixels.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
            return Err(bad_input(format!(
                "light {index} ({}): the radiance at column {}, row {} is beyond 3.4e38: give the light less strength",
                light.name,
                pixel % geometry.width,
                pixel / geometry.width
            )));
        }
        let lit = radiance.pixels.iter().map(|p| p.iter().any(|&v| v > 0.0)).collect();
        let image = RadianceImage {
            valid: Image { width: radiance.width, height: radiance.height, pixels: lit },
            radiance,
            variance: None,
        };
        let about = [("predicted", format!("light {index} ({}) of the dataset", light.name))];
        let mut unfinished = files::Unfinished::within(&args.out);
        let path = unfinished.path(name);
        exr::write_radiance(&path, &image, (0, 0), (geometry.width, geometry.height), &about)?;
        unfinished.finish().map_err(at_path).map_err(anyhow::Error::msg)?;
        progress.count(index + 1, names.len());
    }
    progress.end();
    if args.json {
        let file = |(light, name): (&_, &String)| serde_json::json!({ "light": light, "file": files::shown(&args.out.join(name)) });
        let files: Vec<_> = geometry.lights.iter().map(|light| &light.name).zip(&names).map(file).collect();
        return print_json(&files);
    }
    Ok(print_line(format!("{} images in {}", geometry.lights.len(), args.out.display()))?)
}

/// A path and what is wrong with it, as one line.
fn at_path((path, reason): (PathBuf, impl Display)) -> String {
    format!("{}: {reason}", files::shown(&path))
}
