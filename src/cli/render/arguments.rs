//! Arguments of `rigd render`.

use crate::numerics::geometry::{Light, Vec3};
use std::path::PathBuf;

/// Render a mesh with a captured material: its weight map as texture, its BRDF parameters as fitted.
///
/// Writes render.exr (radiance) and render.png (the same through the camera's response). The mesh has its own frame:
/// right-handed, y up, any unit. Nothing but the light shines, and light reflected twice is not followed.
#[derive(clap::Args)]
pub struct Args {
    /// Result directory written by `rigd fit --out`, a session's directory, or DATA/ID.
    pub result: PathBuf,
    /// A file (.obj, .gltf, .glb), or one of the shapes that come with rigd: sphere, cylinder, knot.
    #[arg(long, default_value = "knot")]
    pub mesh: PathBuf,
    /// Where to write render.exr and render.png; a file that is read is never written over.
    #[arg(long)]
    pub out: PathBuf,
    /// Side of the square of the weight map that becomes the texture, pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 64, value_parser = clap::value_parser!(u16).range(8..=4096))]
    pub patch: u16,
    /// How often the texture repeats along one unit of the mesh's texture coordinates, or along its longest side if it has none.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub repeats: u16,
    /// From where the mesh is seen.
    #[command(flatten)]
    pub view: ViewArgs,
    /// What shines.
    #[command(flatten)]
    pub light: LightArgs,
    /// Exposure time of render.png.
    #[arg(long, value_name = "SECONDS", default_value = "2", value_parser = time, allow_negative_numbers = true)]
    pub exposure: f64,
    /// The camera's response: calibration.json, or what `rigd calibrate response --out` wrote. Default: that of the session which
    /// the result lies in; levels as sRGB has them where there is none.
    #[arg(long, value_name = "FILE.json")]
    pub response: Option<PathBuf>,
    /// Rays a pixel, each way: 3 takes nine, and edges are smoother.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub samples: u8,
    /// Print what was rendered and written as JSON and nothing else.
    #[arg(long)]
    pub json: bool,
}

/// From where the mesh is seen.
#[derive(clap::Args)]
pub struct ViewArgs {
    /// Where the camera stands; default: in front, a little above, with the whole mesh in view.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub camera: Option<Vec3>,
    /// The point in the middle of the picture; default: the middle of the mesh.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub look_at: Option<Vec3>,
    /// Vertical field of view.
    #[arg(long, value_name = "DEGREES", default_value_t = 30.0, allow_negative_numbers = true)]
    pub field: f64,
    /// Columns and rows of the picture.
    #[arg(long, value_name = "COLUMNSxROWS", default_value = "1024x1024", value_parser = size)]
    pub size: (usize, usize),
}

/// What shines: a distant light unless a position is given.
#[derive(clap::Args)]
pub struct LightArgs {
    /// Towards a distant light.
    #[arg(long, value_name = "X,Y,Z", default_value = "-0.3,0.4,1", value_parser = direction, allow_hyphen_values = true)]
    pub light_direction: Vec3,
    /// Its irradiance on a surface that faces it, radiance units: one number, or red, green and blue.
    #[arg(long, value_name = "R,G,B", default_value = "6", value_parser = strength, allow_hyphen_values = true)]
    pub irradiance: Strength,
    /// Where a small lamp stands instead.
    #[arg(
        long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true, requires = "intensity",
        conflicts_with_all = ["light_direction", "irradiance"]
    )]
    pub light_position: Option<Vec3>,
    /// Its intensity, radiance units x the mesh's unit of length squared: irradiance at distance d is intensity / d^2.
    #[arg(
        long, value_name = "R,G,B", value_parser = strength, allow_hyphen_values = true, requires = "light_position"
    )]
    pub intensity: Option<Strength>,
}

/// A value per channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strength([f64; 3]);

impl LightArgs {
    /// The light.
    pub fn light(&self) -> Light {
        match (self.light_position, self.intensity) {
            (Some(position), Some(Strength(intensity))) => Light::Point { position, intensity },
            _ => Light::Distant { direction: self.light_direction, irradiance: self.irradiance.0 },
        }
    }
}

/// Most pixels of a picture: 3.4e7 take half a gigabyte.
const MAX_PIXELS: usize = 1 << 25;

/// Largest coordinate.
const LARGEST: f64 = 1e30;

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let number = |word: &str| word.trim().parse::<f64>().map_err(|_| format!("\"{word}\" is no number"));
    text.split(',').map(number).collect()
}

fn vector(text: &str) -> Result<Vec3, String> {
    match numbers(text)?.as_slice() {
        &[x, y, z] if [x, y, z].iter().all(|c| c.abs() <= LARGEST) => Ok(Vec3::new(x, y, z)),
        _ => Err(format!("three numbers of at most {LARGEST:e}, separated by commas, are needed")),
    }
}

fn direction(text: &str) -> Result<Vec3, String> {
    vector(text)?.try_normalize(0.0).ok_or_else(|| "a direction has a length".to_owned())
}

fn strength(text: &str) -> Result<Strength, String> {
    let triple = match *numbers(text)? {
        [all] => [all; 3],
        [r, g, b] => [r, g, b],
        _ => return Err("one number, or three separated by commas, are needed".to_owned()),
    };
    let range = f64::from(f32::MIN_POSITIVE)..=f64::from(f32::MAX);
    if triple.iter().all(|value| range.contains(value)) {
        return Ok(Strength(triple));
    }
    Err("numbers from 1.2e-38 to 3.4e38 are needed".to_owned())
}

fn time(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|time: &f64| *time > 0.0 && *time <= LARGEST)
        .ok_or_else(|| "more than 0 s is needed".to_owned())
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let parts = text
        .split_once('x')
        .and_then(|(width, height)| Some((width.parse::<usize>().ok()?, height.parse::<usize>().ok()?)));
    let fits =
        |&(width, height): &(usize, usize)| width > 0 && height > 0 && width.saturating_mul(height) <= MAX_PIXELS;
    parts
        .filter(fits)
        .ok_or_else(|| format!("columns and rows, as in 1024x768, of at most {MAX_PIXELS} pixels are needed"))
}
