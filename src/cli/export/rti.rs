//! `rigd export --format rti`: the pictures of the dataset in whose folder a result lies.

use super::{Args, at_path, folder_with};
use crate::cli::error::{bad_input, print_line};
use crate::cli::render::response;
use crate::pipeline::export::rti::{ABOUT, Brightness, LIGHTS, LIST, Loss, NAME, Stage, Sums, picture};
use crate::pipeline::export::{LOSS, README, Words, readme_of};
use crate::session::SOFTWARE;
use crate::session::calibration::file;
use crate::store::files::{self, Unfinished, shown};
use crate::store::{dataset, png, result};
use serde::Serialize;
use serde_json::json;
use std::path::Path;

/// What `--json` prints.
#[derive(Serialize)]
struct Summary {
    format: &'static str,
    out: String,
    files: Vec<String>,
    loss: Loss,
}

/// Runs the command. One picture at a time is in memory; each is read twice, because all have one exposure.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let folder = folder_with(&args.result, dataset::FILE, "--format rti is made of the pictures of a dataset")?;
    let geometry = dataset::read_geometry(&folder).map_err(bad_input)?;
    let found = response::find(None, &args.result).map_err(bad_input)?;
    let about = |reason: String| bad_input(format!("{}: {reason}", shown(&folder.join(dataset::FILE))));
    let stage = Stage::of(&geometry).map_err(about)?;
    let names: Vec<String> = stage
        .lamps
        .iter()
        .map(|lamp| lamp.file.clone())
        .chain([LIST, LIGHTS, LOSS, README].map(str::to_owned))
        .collect();
    let mut inputs = dataset::inputs(&folder).map_err(bad_input)?;
    inputs.extend(result::FILES.map(|name| args.result.join(name)));
    inputs.push(folder.join(file::NAME));
    files::make_ready(&args.out, names.iter().map(String::as_str), &inputs).map_err(at_path).map_err(bad_input)?;
    let mut brightness = Brightness::default();
    for (index, lamp) in stage.lamps.iter().enumerate() {
        brightness.add(&dataset::read_light(&folder, index).map_err(bad_input)?, lamp.gain);
    }
    let time_s = brightness.time_s(&found.response).map_err(about)?;
    let (mut unfinished, mut sums) = (Unfinished::within(&args.out), Sums::default());
    for (index, lamp) in stage.lamps.iter().enumerate() {
        let image = dataset::read_light(&folder, index).map_err(bad_input)?;
        let levels = picture(&image, lamp, &found.response, time_s);
        sums.add(&stage, index, &image, &levels, (&found.response, time_s));
        let path = unfinished.path(&lamp.file);
        png::write(&path, &levels).map_err(|reason| anyhow::anyhow!("{}: {reason}", shown(&path)))?;
    }
    let loss = sums.loss();
    let words = words(&loss);
    for (name, text) in [
        (LIST, stage.list()),
        (LIGHTS, stage.lights(time_s, &found.name)),
        (LOSS, format!("{:#}\n", json!({"format": NAME, "same_numbers": false, "loss": loss, "loses": words.loses}))),
        (README, readme_of(&format!("Pictures for RTI, exported by {SOFTWARE}: {ABOUT}\n"), &words)),
    ] {
        write(&unfinished.path(name), &text)?;
    }
    unfinished.finish().map_err(at_path).map_err(anyhow::Error::msg)?;
    if args.json {
        let summary = Summary { format: NAME, out: shown(&args.out), files: names, loss };
        return Ok(print_line(serde_json::to_string_pretty(&summary)?)?);
    }
    let told = loss.sentences().join("\n");
    Ok(print_line(format!(
        "{ABOUT}\nexposed {time_s:.3} s through {}\n{told}\n{} in {}",
        found.name,
        names.join(", "),
        shown(&args.out)
    ))?)
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).map_err(|e| anyhow::anyhow!("{}: {e}", shown(path)))
}

fn words(loss: &Loss) -> Words {
    let mut loses = vec![
        "Levels of 8 bits; what is brighter than 99 % of the surface may be clipped.".to_owned(),
        format!("The list has one direction a picture, as if the lamps were far away; {LIGHTS} has their positions."),
        "The fitted material itself: RTI fits its own functions to the pictures.".to_owned(),
    ];
    loses.extend(loss.sentences());
    Words {
        carries: vec![
            format!("{LIST}: the number of pictures, then a line each with its name and the unit direction of its light, x right, y up, z towards the camera."),
            "light-NNN.png: the radiance under that light, exposed alike for all, through the camera's response, and scaled so that the middle of the surface has the same irradiance in all.".to_owned(),
            format!("{LIGHTS}: lamp positions in mm, intensities, the scale of each picture, exposure time."),
        ],
        loses,
        open: vec![format!("relight-cli {LIST} OUT, or RTIBuilder with this folder as its pictures and {LIST} as its light position file.")],
    }
}
