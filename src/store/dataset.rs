//! Dataset directories (CONTRACT.md): reading with every reason for refusal, and writing one for a finished session.

mod raw;

use super::exr;
use crate::numerics::geometry::{Light, Sphere, Vec3};
use crate::numerics::image::{Image, RadianceImage};
use crate::pipeline::dataset::{Dataset, Geometry, NamedLight};
use raw::{RawDataset, RawLight};
use std::path::Path;

/// File that describes a dataset.
pub const FILE: &str = "dataset.toml";

/// Default of `[samples] saturation`: part of the format's full scale.
const SATURATION: f64 = 0.98;

/// Default of `[samples] cosine_cutoff`.
const COSINE_CUTOFF: f64 = 0.15;

/// Largest frame side accepted, pixels.
const MAX_SIDE: usize = 32_768;

/// Most pixels of a frame accepted.
const MAX_PIXELS: usize = 100_000_000;

/// Why a directory is no usable dataset.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {}", .reasons.join("; "))]
pub struct DatasetError {
    /// The file or directory.
    pub path: String,
    /// Every reason found: what, where, what to do.
    pub reasons: Vec<String>,
}

fn error(path: &Path, reason: impl Into<String>) -> DatasetError {
    DatasetError { path: path.display().to_string(), reasons: vec![reason.into()] }
}

/// Where images of a dataset stop being usable.
#[derive(Clone, Copy, Debug)]
struct Samples {
    saturation: f64,
    cosine_cutoff: f64,
}

/// Reads `directory/dataset.toml` and its images.
pub fn read(directory: &Path) -> Result<Dataset, DatasetError> {
    let (geometry, samples) = read_description(directory)?;
    let mut images = Vec::new();
    let mut reasons = Vec::new();
    for light in &geometry.lights {
        match read_image(&directory.join(&light.name), (geometry.width, geometry.height), samples.saturation) {
            Ok(image) => images.push(image),
            Err(reason) => reasons.push(reason),
        }
    }
    if reasons.is_empty() {
        Ok(Dataset { geometry, images })
    } else {
        Err(DatasetError { path: directory.join(FILE).display().to_string(), reasons })
    }
}

/// Reads camera, object and lights of `directory/dataset.toml`, without the images.
pub fn read_geometry(directory: &Path) -> Result<Geometry, DatasetError> {
    Ok(read_description(directory)?.0)
}

fn read_description(directory: &Path) -> Result<(Geometry, Samples), DatasetError> {
    if !directory.is_dir() {
        return Err(error(directory, "there is no such directory: give one that holds a dataset.toml"));
    }
    let path = directory.join(FILE);
    let text = std::fs::read_to_string(&path)
        .map_err(|e| error(&path, format!("{e}: give a directory that holds a dataset.toml")))?;
    let (mut geometry, samples, mask) =
        parse(&text).map_err(|reasons| DatasetError { path: path.display().to_string(), reasons })?;
    if let Some(mask) = mask {
        let size = (geometry.width, geometry.height);
        geometry.mask = Some(read_mask(&directory.join(mask), size).map_err(|reason| error(&path, reason))?);
    }
    Ok((geometry, samples))
}

/// Text of a dataset.toml to its geometry (mask not yet read), sample limits and mask path; or every reason why not.
fn parse(text: &str) -> Result<(Geometry, Samples, Option<String>), Vec<String>> {
    let raw: RawDataset = toml::from_str(text).map_err(|e| vec![e.to_string().trim_end().replace('\n', "\n  ")])?;
    let mut reasons = Vec::new();
    if raw.format != 1 {
        reasons.push(format!("format = {}: this program reads format 1", raw.format));
    }
    let sides = [raw.camera.width, raw.camera.height];
    if sides.iter().any(|side| !(1..=MAX_SIDE).contains(side)) || sides[0].saturating_mul(sides[1]) > MAX_PIXELS {
        reasons.push(format!("[camera] {} x {} pixels: give the size of the images", sides[0], sides[1]));
    }
    let projection = raw.projection(&mut reasons);
    let object = raw.sphere(&projection, &mut reasons);
    if raw.light.is_empty() {
        reasons.push("there is no [[light]]: list at least one".to_owned());
    }
    let lights =
        raw.light.iter().enumerate().map(|(index, light)| named(index, light, &object, &mut reasons)).collect();
    let samples = Samples {
        saturation: in_range(raw.samples.saturation, SATURATION, 1.0, "saturation", &mut reasons),
        cosine_cutoff: in_range(raw.samples.cosine_cutoff, COSINE_CUTOFF, 0.999, "cosine_cutoff", &mut reasons),
    };
    if !reasons.is_empty() {
        return Err(reasons);
    }
    let geometry = Geometry {
        width: raw.camera.width,
        height: raw.camera.height,
        projection,
        object,
        mask: None,
        lights,
        cosine_cutoff: samples.cosine_cutoff,
    };
    Ok((geometry, samples, raw.object.mask))
}

/// Checks the text of a dataset.toml alone; for fuzzing and for programs that write one.
pub fn check_text(text: &str) -> Result<(), Vec<String>> {
    parse(text).map(|_| ())
}

fn in_range(value: Option<f64>, default: f64, most: f64, key: &str, reasons: &mut Vec<String>) -> f64 {
    let value = value.unwrap_or(default);
    if !(value >= 0.0 && value <= most) {
        reasons.push(format!("[samples] {key} = {value}: choose a value from 0 to {most}"));
    }
    value
}

fn named(index: usize, raw: &RawLight, object: &Sphere, reasons: &mut Vec<String>) -> NamedLight {
    let mut complain = |reason: String| reasons.push(format!("light {index} ({}): {reason}", raw.image));
    let positive = |rgb: [f64; 3]| rgb.iter().all(|v| v.is_finite() && *v > 0.0);
    let light = match (raw.position_mm, raw.intensity, raw.direction, raw.irradiance) {
        (Some(position), Some(intensity), None, None) => {
            let position = Vec3::from(position);
            if !position.iter().all(|v| v.is_finite()) {
                complain("position_mm must be finite".to_owned());
            } else if (position - object.center).norm() <= object.radius {
                complain("position_mm lies inside the object: check the unit (mm) and the sign of z".to_owned());
            }
            if !positive(intensity) {
                complain("intensity must be positive in every channel".to_owned());
            }
            Light::Point { position, intensity }
        }
        (None, None, Some(direction), Some(irradiance)) => {
            let direction = Vec3::from(direction);
            let length = direction.norm();
            if !length.is_finite() || length <= 0.0 {
                complain("direction has no length: give the direction from the object towards the light".to_owned());
            }
            if !positive(irradiance) {
                complain("irradiance must be positive in every channel".to_owned());
            }
            Light::Distant { direction: direction / length, irradiance }
        }
        _ => {
            complain("give either position_mm and intensity, or direction and irradiance".to_owned());
            Light::Distant { direction: -Vec3::z(), irradiance: [1.0; 3] }
        }
    };
    NamedLight { name: raw.image.clone(), light }
}

fn read_image(path: &Path, size: (usize, usize), saturation: f64) -> Result<RadianceImage, String> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if !path.is_file() {
        return Err(format!("{}: there is no such image", path.display()));
    }
    match extension.as_str() {
        "exr" => exr::read_radiance(path, size).map_err(|e| e.to_string()),
        "png" | "tif" | "tiff" => read_integer(path, size, saturation),
        _ => Err(format!("{}: images are .exr, .png or .tiff", path.display())),
    }
}

/// Opens an 8- or 16-bit image whose size must be `size`; the size is checked before any pixel is decoded.
fn open(path: &Path, size: (usize, usize)) -> Result<image::DynamicImage, String> {
    let complain = |reason: String| format!("{}: {reason}", path.display());
    let reader = || {
        let reader = image::ImageReader::open(path).map_err(|e| complain(e.to_string()))?;
        reader.with_guessed_format().map_err(|e| complain(e.to_string()))
    };
    let (width, height) = reader()?.into_dimensions().map_err(|e| complain(e.to_string()))?;
    if (width as usize, height as usize) != size {
        return Err(complain(format!("the image is {width} x {height} pixels, {} x {} expected", size.0, size.1)));
    }
    reader()?.decode().map_err(|e| complain(e.to_string()))
}

/// PNG or TIFF, taken as linear: radiance is the value over full scale, its variance that of rounding.
fn read_integer(path: &Path, size: (usize, usize), saturation: f64) -> Result<RadianceImage, String> {
    use image::DynamicImage as D;
    let decoded = open(path, size)?;
    let step = match decoded {
        D::ImageLuma8(_) | D::ImageLumaA8(_) | D::ImageRgb8(_) | D::ImageRgba8(_) => 1.0 / 255.0,
        D::ImageLuma16(_) | D::ImageLumaA16(_) | D::ImageRgb16(_) | D::ImageRgba16(_) => 1.0 / 65_535.0,
        _ => return Err(format!("{}: only 8- and 16-bit images can be read; use EXR for float", path.display())),
    };
    let radiance: Vec<[f32; 3]> = decoded.to_rgb32f().pixels().map(|p| p.0).collect();
    let valid = radiance.iter().map(|p| p.iter().all(|&v| f64::from(v) < saturation)).collect();
    let variance = (step * step / 12.0) as f32;
    Ok(RadianceImage {
        radiance: Image { width: size.0, height: size.1, pixels: radiance },
        variance: Some(Image::filled(size.0, size.1, [variance; 3])),
        valid: Image { width: size.0, height: size.1, pixels: valid },
    })
}

fn read_mask(path: &Path, size: (usize, usize)) -> Result<Image<bool>, String> {
    if !path.is_file() {
        return Err(format!("{}: there is no such mask", path.display()));
    }
    let decoded = open(path, size)?;
    let pixels = decoded.to_rgb32f().pixels().map(|p| p.0.iter().any(|&v| v > 0.0)).collect();
    Ok(Image { width: size.0, height: size.1, pixels })
}

/// Path of a station's radiance image inside a session directory.
pub fn radiance_name(station: usize) -> String {
    format!("radiance/{station:02}.exr")
}

/// Writes `directory/dataset.toml` for a rig's session: one light a station in the order of the plan, mm, images by
/// [`radiance_name`].
pub fn write_for_session(
    directory: &Path,
    rig: &rig_config::Rig,
    light_positions_mm: &[[f64; 3]],
) -> Result<(), DatasetError> {
    let raw = RawDataset::of_session(rig, light_positions_mm);
    let path = directory.join(FILE);
    let text = toml::to_string(&raw).map_err(|e| error(&path, e.to_string()))?;
    // A file cut off by a full disk or a kill would spoil every later fit: it appears whole or not at all.
    let unfinished = directory.join(format!(".{FILE}.tmp"));
    std::fs::write(&unfinished, text)
        .and_then(|()| std::fs::rename(&unfinished, &path))
        .map_err(|e| error(&path, e.to_string()))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::geometry::Projection;

    const GOOD: &str = r#"
        format = 1
        [camera]
        projection = "orthographic"
        width = 8
        height = 8
        [object]
        shape = "sphere"
        center_px = [4.0, 4.0]
        radius_px = 3.0
        [[light]]
        image = "a.png"
        direction = [0, 0, -2]
        irradiance = [1, 1, 1]
    "#;

    fn reasons(from: &str, to: &str) -> String {
        match parse(&GOOD.replace(from, to)) {
            Ok(_) => String::new(),
            Err(reasons) => reasons.join("; "),
        }
    }

    #[test]
    fn a_sound_description_is_read_and_directions_are_normalised() {
        let (geometry, samples, _) = parse(GOOD).unwrap();
        assert_eq!(geometry.lights[0].light, Light::Distant { direction: -Vec3::z(), irradiance: [1.0; 3] });
        assert_eq!(samples.cosine_cutoff, COSINE_CUTOFF);
        assert!(matches!(geometry.projection, Projection::Orthographic { mm_per_px: 1.0 }));
    }

    #[test]
    fn every_mistake_is_named() {
        for (from, to, expected) in [
            ("format = 1", "format = 2", "format 1"),
            ("[0, 0, -2]", "[0, 0, 0]", "direction has no length"),
            ("[0, 0, -2]", "[0, nan, 0]", "direction has no length"),
            ("irradiance = [1, 1, 1]", "irradiance = [1, 0, 1]", "positive"),
            ("irradiance = [1, 1, 1]", "", "either position_mm"),
            ("radius_px = 3.0", "radius_px = -3.0", "radius_px"),
            ("radius_px = 3.0", "", "radius_px"),
            ("\"sphere\"", "\"cylinder\"", "cylinder"),
            ("\"orthographic\"", "\"pinhole\"", "focal_px"),
            ("width = 8", "width = 0", "0 x 8"),
            ("width = 8", "width = 8\nwidht = 9", "widht"),
            (
                "direction = [0, 0, -2]\n        irradiance",
                "position_mm = [4, 4, 0]\n        intensity",
                "inside the object",
            ),
        ] {
            let found = reasons(from, to);
            assert!(found.contains(expected), "{from} -> {to}: {found}");
        }
    }
}
