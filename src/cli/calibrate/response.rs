//! `rigd calibrate response`: the camera's response and shutter times from a folder of frames.

use crate::cli::error::{bad_input, print_line};
use crate::cli::merge::bracket_of;
use crate::cli::target::Target;
use crate::pipeline::calibration::response::{Expected, ExposureTime, Method, ResponseCalibration, calibrate};
use std::path::PathBuf;

/// Measure shutter times and response curve on one bracket of 8-bit frames.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Folder of JPEG, PNG or BMP frames of one bracket, with exposures.toml or EXIF exposure times.
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// How the curve is solved for when the times are known.
    #[arg(long, value_enum, default_value = "debevec")]
    method: MethodName,
    /// Write the calibration to this file.
    #[arg(long, value_name = "FILE.json")]
    out: Option<PathBuf>,
    /// Print the calibration as JSON and nothing else.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum MethodName {
    /// Debevec & Malik 1997, monotone.
    Debevec,
    /// Robertson, Borman & Stevenson 2003, monotone.
    Robertson,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let target = Target::optional(args.out.as_deref(), "json", &[])?;
    let bracket = bracket_of(&args.folder)?;
    let method = match args.method {
        MethodName::Debevec => Method::Debevec,
        MethodName::Robertson => Method::Robertson,
    };
    let found = calibrate(bracket, method)
        .map_err(|error| bad_input(format!("{}: {error}", args.folder.display())))?
        .calibration;
    let json = serde_json::to_string_pretty(&found)?;
    if let Some(target) = target {
        target.write_text(&json)?;
    }
    Ok(print_line(if args.json { json } else { summary(&found).trim_end().to_owned() })?)
}

/// What a person wants to know of the times and the response, a line each.
pub fn summary(found: &ResponseCalibration) -> String {
    let [red, green, blue] = found.active_constraints;
    let mut text = times_table(&found.exposures, &found.reference);
    text += &format!("{}\n{}\n", agreement(found), found.gauge);
    text += &format!(
        "response ({:?}) from {} pixels; held up by monotony at {red} red, {green} green, {blue} blue levels of 255\n",
        found.method, found.pixels
    );
    for warning in &found.warnings {
        text += &format!("warning: {warning}\n");
    }
    text
}

/// The three times of every frame side by side.
pub fn times_table(exposures: &[ExposureTime], reference: &str) -> String {
    let wide = exposures.iter().map(|time| time.name.chars().count()).max().unwrap_or(0).max(5);
    let mut text = format!("{:wide$}   nominal s  2^(k/3) s  from images s\n", "frame");
    for time in exposures {
        let power = time.power_of_two_s.map_or("-".into(), |t| format!("{t:.5}"));
        text += &format!(
            "{:wide$}  {:>10}  {power:>9}  {:>13}  {}\n",
            time.name,
            format!("{:.5}", time.nominal_s),
            format!("{:.5}", time.estimated_s),
            remark(time, reference)
        );
    }
    text
}

fn remark(time: &ExposureTime, reference: &str) -> String {
    match time.sigma_relative {
        None => "not measured".into(),
        Some(_) if time.name == reference => "reference".into(),
        Some(sigma) => {
            format!("+- {:.2} %{}", 100.0 * sigma, if time.departs { "  DEPARTS from both" } else { "" })
        }
    }
}

fn agreement(found: &ResponseCalibration) -> String {
    let percent = |scatter: Option<f64>| scatter.map_or("-".into(), |s| format!("{:.2} %", 100.0 * s));
    let chosen = match found.expected {
        Expected::PowerOfTwo => "power-of-two",
        Expected::Nominal => "nominal",
    };
    format!(
        "the images depart from the nominal times by {}, from the power-of-two times by {} (rms, up to one exponent): {chosen} times expected",
        percent(found.scatter_nominal),
        percent(found.scatter_power_of_two),
    )
}
