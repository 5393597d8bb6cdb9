//! `rigd calibrate lights`: light positions from frames of balls, intensities from radiance of a grey card.

mod folder;

use super::files;
use crate::cli::error::{bad_input, print_line};
use crate::cli::target::Target;
use crate::numerics::calibration::lights::highlight::Spots;
use crate::numerics::image::RadianceImage;
use crate::pipeline::calibration::lights::{
    CardFrame, LightFrames, LightsCalibration, LightsSettings, calibrate_intensity, calibrate_lights, frames,
};
use crate::pipeline::decode::decode;
use crate::store::exr::read_radiance;
use folder::{CameraFile, LightsFile};
use std::path::{Path, PathBuf};

/// Measure light positions with balls, and light intensity with a grey card.
///
/// FOLDER holds lights.toml: for every light a `[[light]]` with `silhouette` and `highlight` (JPEG, PNG, BMP, or EXR radiance; the
/// same file if nothing in it is clipped), `angle_deg` if the arm knows it, and `card` (EXR radiance) if the grey card was shot.
/// `[card]` holds `corners_px` (four, in order), `width_mm` and `height_mm` or `point_mm` and `normal`, and `reflectance`
/// (0.18 if left out) with `reflectance_sigma` (relative, 0.05 if left out).
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Folder with lights.toml and the frames it names.
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// The camera: a calibration (.json) or a rig file (.toml).
    #[arg(long, value_name = "FILE")]
    camera: PathBuf,
    /// Radius of the balls by caliper, mm: 0.05 mm of 20 are 5 mm of depth at 2 m.
    #[arg(long, value_name = "MM", value_parser = positive)]
    radius_mm: f64,
    /// How many balls stand on the stage.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(2..=12))]
    balls: u8,
    /// Standard deviation of the arm's angles, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.05, value_parser = positive)]
    angle_sigma_deg: f64,
    /// Write the calibration to this file.
    #[arg(long, value_name = "FILE.json")]
    out: Option<PathBuf>,
    /// Print the calibration as JSON and nothing else.
    #[arg(long)]
    json: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("give a number greater than 0".into()),
    }
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let target = Target::optional(args.out.as_deref(), "json", std::slice::from_ref(&args.camera))?;
    let camera = CameraFile::read(&args.camera).map_err(bad_input)?;
    let list = LightsFile::read(&args.folder).map_err(bad_input)?;
    let settings = LightsSettings {
        projection: camera.projection(),
        size: (camera.width, camera.height),
        radius_mm: args.radius_mm,
        balls: usize::from(args.balls),
        angle_sigma_deg: args.angle_sigma_deg,
    };
    let lights: Vec<LightFrames> = list.light.iter().map(folder::ListedLight::frames).collect();
    let load = |name: &str| ball_frame(&args.folder.join(name), settings.size);
    let in_folder = |error: &dyn std::fmt::Display| bad_input(format!("{}: {error}", args.folder.display()));
    let mut found = calibrate_lights(&lights, &load, &settings).map_err(|error| in_folder(&error))?;
    if let Some((card, warning)) = list.card(&settings.projection).map_err(bad_input)? {
        let cards: Vec<CardFrame> = list
            .light
            .iter()
            .enumerate()
            .filter_map(|(light, listed)| listed.card.clone().map(|file| CardFrame { light, file }))
            .collect();
        let load = |name: &str| card_frame(&args.folder.join(name), settings.size);
        found = calibrate_intensity(&found, &settings.projection, &card, &cards, &load)
            .map_err(|error| in_folder(&error))?;
        found.warnings.extend(warning);
    }
    let json = serde_json::to_string_pretty(&found)?;
    if let Some(target) = target {
        target.write_text(&json)?;
    }
    Ok(print_line(if args.json { json } else { summary(&found, &lights).trim_end().to_owned() })?)
}

fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("exr"))
}

fn ball_frame(path: &Path, size: (usize, usize)) -> Result<Spots, String> {
    if is_exr(path) {
        return read_radiance(path, size).map(|image| frames::from_radiance(&image)).map_err(|e| e.reason);
    }
    decode(&files::read(path)?).map(|picture| frames::from_levels(&picture)).map_err(|e| e.to_string())
}

fn card_frame(path: &Path, size: (usize, usize)) -> Result<RadianceImage, String> {
    if !is_exr(path) {
        return Err(
            "levels of a picture are no radiance: merge its bracket first (`rigd merge`) and name the .exr".into()
        );
    }
    read_radiance(path, size).map_err(|e| e.reason)
}

/// What a person wants to know, a line each.
fn summary(found: &LightsCalibration, lights: &[LightFrames]) -> String {
    let mut text = String::new();
    for (index, ball) in found.balls.iter().enumerate() {
        let [x, y, z] = ball.center_mm;
        text += &format!(
            "ball {}: centre ({x:.2}, {y:.2}, {z:.2}) mm, outline {:.1} px radius, {:.3} px rms, {:.0} % seen\n",
            index + 1,
            ball.image_radius_px,
            ball.outline_rms_px,
            100.0 * ball.outline_covered
        );
    }
    for (index, light) in found.lights.iter().enumerate() {
        let [x, y, z] = light.position_mm;
        let sigma: Vec<String> = (0..3).map(|k| format!("{:.2}", light.covariance_mm2[k][k].max(0.0).sqrt())).collect();
        let angle = lights[index].angle_deg.map_or(String::new(), |a| format!(" ({a} degrees)"));
        text += &format!(
            "light {}{angle}: ({x:.1}, {y:.1}, {z:.1}) mm +- ({}), {} balls",
            index + 1,
            sigma.join(", "),
            light.balls_used
        );
        if let Some([r, g, b]) = light.intensity {
            text += &format!(", intensity {r:.4e} {g:.4e} {b:.4e}");
        }
        text += "\n";
    }
    if let Some(circle) = &found.circle {
        let [x, y, z] = circle.center_mm;
        text += &format!(
            "arm: radius {:.1} +- {:.1} mm about ({x:.1}, {y:.1}, {z:.1}) mm, axis ({:.4}, {:.4}, {:.4})\n",
            circle.radius_mm, circle.radius_sigma_mm, circle.axis[0], circle.axis[1], circle.axis[2]
        );
    }
    text += &format!("highlights {:.3} px rms, chi^2 {:.2} a degree of freedom\n", found.rms_px, found.reduced_chi2);
    for warning in found.warnings.iter().chain(found.lights.iter().flat_map(|light| &light.warnings)) {
        text += &format!("warning: {warning}\n");
    }
    text
}
