//! Dataset directories (docs/dataset.md): reading with every reason for refusal, and writing one for a finished session.

mod maps;
mod object;
mod paths;
mod picture;
mod raw;
mod session;

pub use paths::inputs;
pub(super) use picture::read_mask;
pub use session::{SessionLight, radiance_name, write_for_session};

use super::exr;
use super::files::{self, shown};
use crate::numerics::geometry::{Light, Projection, Shape, Vec3};
use crate::numerics::image::RadianceImage;
use crate::pipeline::dataset::{Dataset, Geometry, NamedLight};
use object::Object;
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
    DatasetError { path: shown(path), reasons: vec![reason.into()] }
}

/// Where images of a dataset stop being usable.
#[derive(Clone, Copy, Debug)]
struct Samples {
    saturation: f64,
    cosine_cutoff: f64,
}

/// A dataset.toml, checked as far as its text alone allows.
struct Description {
    size: (usize, usize),
    projection: Projection,
    object: Object,
    mask: Option<String>,
    lights: Vec<NamedLight>,
    samples: Samples,
}

/// Reads `directory/dataset.toml` and its images.
pub fn read(directory: &Path) -> Result<Dataset, DatasetError> {
    let (geometry, samples) = read_description(directory)?;
    let mut images = Vec::new();
    let mut reasons = paths::used_twice(directory, &geometry.lights);
    for light in &geometry.lights {
        match read_image(&directory.join(&light.name), (geometry.width, geometry.height), samples.saturation) {
            Ok(image) => images.push(image),
            Err(reason) => reasons.push(reason),
        }
    }
    if reasons.is_empty() {
        Ok(Dataset { geometry, images })
    } else {
        Err(DatasetError { path: shown(&directory.join(FILE)), reasons })
    }
}

/// Reads the image of one light, counted from 0: for those who need not hold all of them at once.
///
/// # Errors
/// dataset.toml or the image cannot be read, or there is no such light.
pub fn read_light(directory: &Path, index: usize) -> Result<RadianceImage, DatasetError> {
    let Description { size, lights, samples, .. } = describe(directory)?;
    let path = directory.join(FILE);
    let light = lights.get(index).ok_or_else(|| error(&path, format!("it has no light {index}")))?;
    read_image(&directory.join(&light.name), size, samples.saturation).map_err(|reason| error(&path, reason))
}

/// Reads camera, object and lights of `directory/dataset.toml`, without the images.
pub fn read_geometry(directory: &Path) -> Result<Geometry, DatasetError> {
    Ok(read_description(directory)?.0)
}

fn read_description(directory: &Path) -> Result<(Geometry, Samples), DatasetError> {
    let path = directory.join(FILE);
    let described = describe(directory)?;
    if let Some([x, y]) = described.projection.lost_pixel(described.size.0, described.size.1) {
        let reason = format!(
            "camera.distortion has no inverse at pixel ({x:.0}, {y:.0}) of the frame: check the coefficients k1 k2 p1 p2 k3 and focal_px"
        );
        return Err(error(&path, reason));
    }
    let object = read_object(directory, &described).map_err(|reason| error(&path, reason))?;
    let mask = described.mask.map(|mask| picture::read_mask(&directory.join(mask), described.size));
    let geometry = Geometry {
        width: described.size.0,
        height: described.size.1,
        projection: described.projection,
        object,
        mask: mask.transpose().map_err(|reason| error(&path, reason))?,
        lights: described.lights,
        cosine_cutoff: described.samples.cosine_cutoff,
    };
    Ok((geometry, described.samples))
}

/// What `directory/dataset.toml` says.
fn describe(directory: &Path) -> Result<Description, DatasetError> {
    if !directory.is_dir() {
        return Err(error(directory, "there is no such directory: give one that holds a dataset.toml"));
    }
    let path = directory.join(FILE);
    let text = files::read_text(&path, "dataset description (dataset.toml)").map_err(|reason| error(&path, reason))?;
    parse(&text).map_err(|reasons| DatasetError { path: shown(&path), reasons })
}

fn read_object(directory: &Path, described: &Description) -> Result<Shape, String> {
    match &described.object {
        Object::Solid(shape) => Ok(shape.clone()),
        Object::Maps { normals, positions } => {
            let positions = positions.as_ref().map(|name| directory.join(name));
            let normals = directory.join(normals);
            let map = maps::read(&normals, positions.as_deref(), described.size, &described.projection)?;
            Ok(Shape::Map(map))
        }
    }
}

/// Text of a dataset.toml to what it describes, or every reason why not.
fn parse(text: &str) -> Result<Description, Vec<String>> {
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
    let object = raw.object.object(&projection, &mut reasons);
    if raw.light.is_empty() {
        reasons.push("there is no [[light]]: list at least one".to_owned());
    }
    let lights =
        raw.light.iter().enumerate().map(|(index, light)| named(index, light, &object, &mut reasons)).collect();
    let samples = Samples {
        saturation: in_range(raw.samples.saturation, SATURATION, 1.0, "saturation", &mut reasons),
        cosine_cutoff: in_range(raw.samples.cosine_cutoff, COSINE_CUTOFF, 0.999, "cosine_cutoff", &mut reasons),
    };
    match object {
        Some(object) if reasons.is_empty() => {
            Ok(Description { size: sides.into(), projection, object, mask: raw.object.mask, lights, samples })
        }
        _ => Err(reasons),
    }
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

fn named(index: usize, raw: &RawLight, object: &Option<Object>, reasons: &mut Vec<String>) -> NamedLight {
    let mut complain =
        |reason: String| reasons.push(format!("light {index} ({}): {reason}", files::escaped(&raw.image)));
    // Radiance is kept in single precision, and so must be what it is compared with.
    let positive = |rgb: [f64; 3]| rgb.iter().all(|v| (f64::from(f32::MIN_POSITIVE)..=f64::from(f32::MAX)).contains(v));
    let light = match (raw.position_mm, raw.intensity, raw.direction, raw.irradiance) {
        (Some(position), Some(intensity), None, None) => {
            let position = Vec3::from(position);
            if !position.iter().all(|v| v.is_finite()) {
                complain("position_mm must be finite".to_owned());
            } else if matches!(object, Some(Object::Solid(shape)) if shape.contains(&position)) {
                complain("position_mm lies inside the object: check the unit (mm) and the sign of z".to_owned());
            }
            if !positive(intensity) {
                complain(format!("intensity must be positive in every channel{WITHIN_SINGLE}"));
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
                complain(format!("irradiance must be positive in every channel{WITHIN_SINGLE}"));
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

/// What a refusal of a light's strength adds.
const WITHIN_SINGLE: &str = ", from 1.2e-38 to 3.4e38: change the unit";

fn read_image(path: &Path, size: (usize, usize), saturation: f64) -> Result<RadianceImage, String> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    match extension.as_str() {
        "exr" => exr::read_radiance(path, size).map_err(|e| e.to_string()),
        "png" | "tif" | "tiff" => picture::read_integer(path, size, saturation),
        _ => Err(format!("{}: images are .exr, .png or .tiff", shown(path))),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

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

    const CYLINDER: &str = include_str!("../../fuzz/seeds/dataset_toml/cylinder.toml");
    const NORMALS: &str = include_str!("../../fuzz/seeds/dataset_toml/normals.toml");

    /// Why `text` is refused after one replacement.
    #[track_caller]
    fn refused(text: &str, from: &str, to: &str, expected: &str) {
        assert!(text.contains(from), "{from} is not there to be replaced");
        let found = parse(&text.replace(from, to)).err().unwrap_or_default().join("; ");
        assert!(found.contains(expected), "{from} -> {to}: {found}");
    }

    #[test]
    fn a_sound_description_is_read_and_directions_are_normalised() {
        let described = parse(GOOD).unwrap();
        assert_eq!(described.lights[0].light, Light::Distant { direction: -Vec3::z(), irradiance: [1.0; 3] });
        assert_eq!(described.samples.cosine_cutoff, COSINE_CUTOFF);
        assert!(matches!(described.projection, Projection::Orthographic { mm_per_px: 1.0 }));
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
            ("\"sphere\"", "\"cylinder\"", "center_px does not belong to a cylinder"),
            ("\"sphere\"", "\"cylinder\"", "a cylinder needs axis_start_mm, axis_end_mm and radius_mm"),
            ("\"sphere\"", "\"normals\"", "needs normals"),
            ("\"sphere\"", "\"cube\"", "`sphere`, `cylinder`, `normals`"),
            ("radius_px = 3.0", "radius_px = 3.0\nnormals = \"n.exr\"", "normals does not belong to a sphere"),
            ("\"orthographic\"", "\"pinhole\"", "focal_px"),
            ("width = 8", "width = 0", "0 x 8"),
            ("width = 8", "width = 8\nwidht = 9", "widht"),
            (
                "direction = [0, 0, -2]\n        irradiance",
                "position_mm = [4, 4, 0]\n        intensity",
                "inside the object",
            ),
        ] {
            refused(GOOD, from, to, expected);
        }
    }

    #[test]
    fn every_mistake_in_a_cylinder_is_named() {
        for (from, to, expected) in [
            ("[40.0, -5.0, 1490.0]", "[-40.0, 5.0, 1500.0]", "the axis must have a length"),
            ("[40.0, -5.0, 1490.0]", "[inf, 0, 1500]", "the axis must have a length"),
            ("radius_mm = 20.0", "radius_mm = 0", "radius be positive"),
            ("radius_mm = 20.0", "radius_mm = nan", "radius be positive"),
            ("radius_mm = 20.0", "", "radius_mm"),
            ("1490.0]", "-1490.0]", "wholly in front of the camera"),
            ("radius_mm = 20.0", "radius_mm = 1600", "wholly in front of the camera"),
            (
                "radius_mm = 20.0",
                "radius_mm = 20.0\ncenter_mm = [0, 0, 1500]",
                "center_mm does not belong to a cylinder",
            ),
            ("[600.0, 0.0, 1500.0]", "[0, 0, 1500]", "inside the object"),
        ] {
            refused(CYLINDER, from, to, expected);
        }
        let from_the_end = GOOD.replace(
            "shape = \"sphere\"\n        center_px = [4.0, 4.0]\n        radius_px = 3.0",
            "shape = \"cylinder\"\naxis_start_mm = [4, 4, 0]\naxis_end_mm = [4, 4, 9]\nradius_mm = 3",
        );
        refused(&from_the_end, "format", "format", "along the axis");
    }

    #[test]
    fn every_mistake_in_a_map_is_named() {
        for (from, to, expected) in [
            ("normals = \"normals.exr\"", "", "needs normals"),
            ("positions = \"positions.exr\"", "", "need positions as well"),
            ("mask =", "radius_mm = 3\nmask =", "radius_mm does not belong to shape = \"normals\""),
        ] {
            refused(NORMALS, from, to, expected);
        }
    }

    #[test]
    fn what_is_written_is_what_was_read() {
        for text in [GOOD, CYLINDER, NORMALS] {
            let written = toml::to_string(&toml::from_str::<RawDataset>(text).unwrap()).unwrap();
            let (was, is) = (parse(text).unwrap(), parse(&written).unwrap());
            assert_eq!((was.projection, was.object, was.mask), (is.projection, is.object, is.mask));
        }
    }

    #[test]
    fn a_file_of_another_encoding_is_said_to_be_one() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(FILE), b"format = 1\n# caf\xe9\n").unwrap();
        let error = read_geometry(folder.path()).unwrap_err().to_string();
        assert!(error.contains("line 2 is not UTF-8"), "{error}");
    }

    #[test]
    fn lights_that_share_an_image_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let light =
            |name: &str| format!("[[light]]\nimage = \"{name}\"\ndirection = [0, 0, -2]\nirradiance = [1, 1, 1]\n");
        let text = GOOD.to_owned() + &["b/c.exr", "./a.png", "c.exr", "b/./c.exr"].map(light).concat();
        std::fs::write(folder.path().join(FILE), text).unwrap();
        let reasons = read(folder.path()).unwrap_err().reasons;
        assert!(reasons[0].contains("lights 0 and 2 use the same image ./a.png"), "{reasons:?}");
        assert!(reasons[1].contains("lights 1 and 4 use the same image b/./c.exr"), "{reasons:?}");
        assert!(!reasons[2].contains("same image"), "{reasons:?}");
    }
}
