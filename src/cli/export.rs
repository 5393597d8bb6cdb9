//! `rigd export`: a fitted material in the formats of other programs, or the pictures or files that it was made of.

mod rti;
mod session;

use super::error::{bad_input, print_line};
use super::{place, render};
use crate::numerics::brdf;
use crate::numerics::render::shapes;
use crate::pipeline::export::loss::Loss;
use crate::pipeline::export::surface::Surface;
use crate::pipeline::export::{self, Captured, Format, archive, sentence};
use crate::store::files::{self, shown};
use crate::store::{export as written, result};
use clap::builder::{PossibleValue, PossibleValuesParser};
use serde::Serialize;
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Export a fitted material to a format of other programs, and say what that loses.
///
/// Beside the files of the format README.txt and loss.json tell what they carry, what is lost as measured, and how to open them.
#[derive(clap::Args, Clone)]
pub struct Args {
    /// Result directory written by `rigd fit --out`, a session's directory, or DATA/ID.
    pub result: PathBuf,
    /// The format (docs/export.md says what each carries and loses).
    #[arg(long, value_parser = PossibleValuesParser::new(formats()))]
    pub format: String,
    /// Where to write; a file that is read is never written over.
    #[arg(long)]
    pub out: PathBuf,
    /// Side of the square of the weight map that becomes the texture, pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 64, value_parser = clap::value_parser!(u16).range(8..=4096))]
    pub patch: u16,
    /// The shape that wears it, in formats that hold one.
    #[arg(long, default_value = "sphere", value_parser = PossibleValuesParser::new(shapes::NAMES))]
    pub mesh: String,
    /// How often the texture repeats along one unit of the shape's texture coordinates.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub repeats: u16,
    /// Print a summary as JSON and nothing else.
    #[arg(long)]
    pub json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Summary<'a> {
    format: &'a str,
    out: String,
    files: &'a [String],
    model: &'a str,
    materials: usize,
    tile: Square,
    /// Null where the files hold the very numbers of the result.
    loss: Option<Loss>,
}

/// Where in the weight map the texture was cut, pixels.
#[derive(Serialize)]
struct Square {
    side: usize,
    column: usize,
    row: usize,
}

/// A format that is not made of a material, what it is, and what makes it.
type OfSession = (&'static str, &'static str, fn(&Args) -> anyhow::Result<()>);

/// Formats made of what the material was fitted to.
const OF_SESSION: [OfSession; 2] = [
    (export::rti::NAME, "A picture a light, for RTI programs", rti::run),
    (archive::NAME, "The whole session as RO-Crate in a BagIt bag", session::run),
];

/// Every format there is.
fn names() -> Vec<&'static str> {
    export::names().into_iter().chain(OF_SESSION.map(|(name, ..)| name)).collect()
}

/// The same with a word each.
fn formats() -> Vec<PossibleValue> {
    let of_material = export::FORMATS.iter().map(|format| (format.name, format.about));
    let all = of_material.chain(OF_SESSION.map(|(name, about, _)| (name, about)));
    all.map(|(name, about)| PossibleValue::new(name).help(about)).collect()
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let args = &Args { result: place::result(&args.result).map_err(bad_input)?, ..args.clone() };
    if let Some((_, _, make)) = OF_SESSION.iter().find(|(name, ..)| *name == args.format) {
        return make(args);
    }
    let Some(format) = export::by_name(&args.format) else {
        return Err(bad_input(format!("--format {}: one of {}", args.format, names().join(", "))));
    };
    let captured = captured(args)?;
    let finished = captured.export(format).map_err(|reason| bad_input(format!("{}: {reason}", shown(&args.result))))?;
    let names: Vec<String> = finished.files.iter().map(|file| file.name.clone()).collect();
    let inputs = result::FILES.map(|name| args.result.join(name));
    files::make_ready(&args.out, names.iter().map(String::as_str), &inputs).map_err(at_path).map_err(bad_input)?;
    written::write(&args.out, finished.files).map_err(at_path).map_err(anyhow::Error::msg)?;
    Ok(print_line(told(args, format, &captured, &names, finished.loss)?)?)
}

fn captured(args: &Args) -> anyhow::Result<Captured> {
    let stored = result::read_material(&args.result).map_err(bad_input)?;
    let sigma = result::read_sigma(&args.result, &stored.material).map_err(bad_input)?;
    let maps = result::read_maps_of_fit(&args.result, &stored.material).map_err(bad_input)?;
    let (tile, patch) = render::tile(&args.result, args.patch, &stored.weights, &sigma)?;
    let Some(lobe) = brdf::by_name(&stored.material.model) else {
        return Err(bad_input(format!("unknown BRDF model {}", stored.material.model)));
    };
    let Some(surface) = Surface::of(&args.mesh, args.repeats) else {
        return Err(bad_input(format!("--mesh {}: one of {}", args.mesh, shapes::NAMES.join(", "))));
    };
    Ok(Captured {
        materials: stored.material.materials(),
        description: stored.material,
        lobe,
        weights: stored.weights,
        sigma,
        valid: maps.valid,
        residual: maps.residual,
        tile,
        patch,
        repeats: args.repeats,
        surface,
    })
}

fn told(
    args: &Args,
    format: &Format,
    captured: &Captured,
    files: &[String],
    loss: Option<Loss>,
) -> anyhow::Result<String> {
    let (side, patch) = (captured.side(), captured.patch);
    if args.json {
        let summary = Summary {
            format: format.name,
            out: shown(&args.out),
            files,
            model: &captured.description.model,
            materials: captured.materials.len(),
            tile: Square { side, column: patch.x, row: patch.y },
            loss,
        };
        return Ok(serde_json::to_string_pretty(&summary)?);
    }
    Ok(format!(
        "{}\ntexture: {side} x {side} weights from column {}, row {} of weights.exr\n{}\n{} in {}",
        format.about,
        patch.x,
        patch.y,
        sentence(loss.as_ref()),
        files.join(", "),
        shown(&args.out)
    ))
}

/// The folder in which a result lies, if it holds a file of this name. `why` says what needs it.
fn folder_with(result: &Path, name: &str, why: &str) -> anyhow::Result<PathBuf> {
    let refuse = |reason: String| bad_input(format!("{}: {reason}", shown(result)));
    let inside = result.canonicalize().map_err(|e| refuse(format!("{e}: give the `result` of a session")))?;
    match inside.parent() {
        Some(folder) if folder.join(name).is_file() && inside.ends_with("result") => Ok(folder.to_owned()),
        _ => Err(refuse(format!("no {name} beside it: {why}; give the `result` of a session"))),
    }
}

/// A path and what is wrong with it, as one line.
fn at_path((path, reason): (PathBuf, impl Display)) -> String {
    format!("{}: {reason}", shown(&path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_offers_every_format_and_no_other() {
        let script = include_str!("../../web/command.js");
        let list =
            script.split("const FORMATS = {").nth(1).and_then(|rest| rest.split("};").next()).unwrap_or_default();
        let mut offered: Vec<&str> =
            list.lines().filter_map(|line| line.trim().split_once(": ")).map(|pair| pair.0).collect();
        let mut all = names();
        offered.sort_unstable();
        all.sort_unstable();
        assert_eq!(offered, all);
    }
}
