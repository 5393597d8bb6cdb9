//! `rigd relight`: the radiance images a fitted material sends under the lights of a dataset.

use super::error::{bad_input, print_line};
use crate::numerics::brdf;
use crate::numerics::image::{Image, RadianceImage};
use crate::pipeline::relight::relight;
use crate::store::{dataset, exr, result};
use std::path::PathBuf;

/// Predict the radiance image of every light of a dataset: same camera and object.
#[derive(clap::Args)]
pub struct Args {
    /// Result directory written by `rigd fit --out`.
    pub result: PathBuf,
    /// Dataset directory whose lights are used; its images need not exist.
    #[arg(long)]
    pub lights: PathBuf,
    /// Where to write one EXR a light.
    #[arg(long)]
    pub out: PathBuf,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let stored = result::read_material(&args.result).map_err(bad_input)?;
    let geometry = dataset::read_geometry(&args.lights).map_err(bad_input)?;
    let size = [geometry.width, geometry.height];
    if size != stored.material.size {
        return Err(bad_input(format!(
            "{}: {} x {} pixels, but the material in {} was fitted at {} x {}: relight with the same camera",
            args.lights.display(),
            size[0],
            size[1],
            args.result.display(),
            stored.material.size[0],
            stored.material.size[1]
        )));
    }
    let Some(lobe) = brdf::by_name(&stored.material.model) else {
        return Err(bad_input(format!("unknown BRDF model {}", stored.material.model)));
    };
    std::fs::create_dir_all(&args.out).map_err(|e| bad_input(format!("{}: {e}", args.out.display())))?;
    let materials = stored.material.materials();
    for (index, light) in geometry.lights.iter().enumerate() {
        let radiance = relight(lobe, &materials, &stored.weights, &geometry, &light.light);
        let lit = radiance.pixels.iter().map(|p| p.iter().any(|&v| v > 0.0)).collect();
        let image = RadianceImage {
            valid: Image { width: radiance.width, height: radiance.height, pixels: lit },
            radiance,
            variance: None,
        };
        let path = args.out.join(format!("{index:03}.exr"));
        let about = [("predicted", format!("light {index} ({}) of the dataset", light.name))];
        exr::write_radiance(&path, &image, (0, 0), (geometry.width, geometry.height), &about)?;
    }
    Ok(print_line(format!("{} images in {}", geometry.lights.len(), args.out.display()))?)
}
