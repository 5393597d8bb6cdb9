//! OpenEXR in and out: the only module that knows the `exr` crate. Files are uncompressed 32-bit float: noise fills the
//! mantissas, and compression costs far more time than it saves space.

mod behind;
mod rows;

pub use rows::{Place, write_radiance, write_strips};

use super::files::{check_regular, escaped, shown};
use crate::numerics::image::{Image, RadianceImage};
use crate::pipeline::contain::contained;
use exr::meta::MetaData;
use exr::meta::attribute::AttributeValue;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image as ExrImage, ImageAttributes, IntegerBounds, Layer,
    LayerAttributes, ReadChannels, ReadLayers, Text, Vec2, WritableImage,
};
use std::collections::HashMap;
use std::io::{Cursor, Read};
use std::path::Path;

/// Why an EXR file cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}")]
pub struct ExrError {
    /// The file.
    pub path: String,
    /// What is wrong and what to do.
    pub reason: String,
}

fn error(path: &Path, reason: impl Into<String>) -> ExrError {
    ExrError { path: shown(path), reason: reason.into() }
}

/// Name of the one text attribute that carries what the pixels are; a single one, so that equal images give equal bytes.
const ATTRIBUTE: &str = "rigd";

/// Float planes of one size, named, somewhere inside a full frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes {
    /// Left column and top row inside the full frame.
    pub origin: (usize, usize),
    /// Width and height of the full frame, pixels.
    pub full: (usize, usize),
    /// Width and height of the planes, pixels.
    pub size: (usize, usize),
    /// Channel name and its pixels, row by row.
    pub channels: Vec<(String, Vec<f32>)>,
}

impl Planes {
    pub(super) fn take(&mut self, name: &str) -> Option<Vec<f32>> {
        let index = self.channels.iter().position(|(known, _)| known == name)?;
        Some(self.channels.swap_remove(index).1)
    }

    fn names(&self) -> String {
        let names: Vec<String> = self.channels.iter().map(|(name, _)| escaped(name)).collect();
        names.join(", ")
    }
}

/// Writes planes with a text that says what the pixels are.
pub fn write_planes(path: &Path, planes: Planes, about: &str) -> Result<(), ExrError> {
    described(path, planes, about)?.write().to_file(path).map_err(|e| error(path, e.to_string()))
}

/// The bytes of a file of this name, as [`write_planes`] writes it.
pub fn encode_planes(name: &str, planes: Planes, about: &str) -> Result<Vec<u8>, ExrError> {
    let (path, mut bytes) = (Path::new(name), Vec::new());
    let image = described(path, planes, about)?;
    image.write().to_buffered(Cursor::new(&mut bytes)).map_err(|e| error(path, e.to_string()))?;
    Ok(bytes)
}

fn described(path: &Path, planes: Planes, about: &str) -> Result<ExrImage<Layer<AnyChannels<FlatSamples>>>, ExrError> {
    let named = planes.channels.into_iter().map(|(name, pixels)| Ok((text(path, &name)?, pixels)));
    let channels = named
        .map(|channel| channel.map(|(name, pixels)| AnyChannel::new(name, FlatSamples::F32(pixels))))
        .collect::<Result<_, ExrError>>()?;
    let position = Vec2(signed(path, planes.origin.0)?, signed(path, planes.origin.1)?);
    let attributes = LayerAttributes { layer_position: position, ..LayerAttributes::default() };
    let layer =
        Layer::new(Vec2(planes.size.0, planes.size.1), attributes, Encoding::UNCOMPRESSED, AnyChannels::sort(channels));
    let mut shared = ImageAttributes::new(IntegerBounds::from_dimensions(Vec2(planes.full.0, planes.full.1)));
    shared.other = HashMap::from([(text(path, ATTRIBUTE)?, AttributeValue::Text(text(path, about)?))]);
    Ok(ExrImage::new(shared, layer))
}

/// EXR text is one byte a character: what does not fit is written as its escape.
fn text(path: &Path, text: &str) -> Result<Text, ExrError> {
    let escaped: String =
        text.chars().flat_map(|c| if c.is_ascii() { vec![c] } else { c.escape_unicode().collect() }).collect();
    Text::new_or_none(&escaped).ok_or_else(|| error(path, format!("\"{escaped}\" cannot be stored as text")))
}

fn signed(path: &Path, value: usize) -> Result<i32, ExrError> {
    i32::try_from(value).map_err(|_| error(path, "the image is too large"))
}

/// The first bytes of every OpenEXR file.
const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Most values a file may hold over all its channels: what its header claims is checked before memory is taken.
const MAX_VALUES: usize = 1 << 30;

/// Reads the first layer of a file whose full frame must be `full` pixels.
pub fn read_planes(path: &Path, full: (usize, usize)) -> Result<Planes, ExrError> {
    check_regular(path, "OpenEXR file").map_err(|reason| error(path, reason))?;
    contained(|| read_layer(path, full)).unwrap_or_else(|| Err(unreadable(path, "the decoder gave up")))
}

/// Why the decoder could not read a file, as far as its first bytes tell, and what to do.
fn unreadable(path: &Path, reason: impl ToString) -> ExrError {
    let mut first = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(MAGIC.len() as u64).read_to_end(&mut first));
    let remedy = match read {
        Err(_) => "make it readable",
        Ok(0) => "the file is empty: write or copy it again",
        Ok(_) if first == MAGIC => "the file is damaged or cut short: write or copy it again",
        Ok(_) => "this is no OpenEXR file, whatever its name says: convert it to OpenEXR",
    };
    error(path, format!("{remedy} ({})", reason.to_string()))
}

fn read_layer(path: &Path, full: (usize, usize)) -> Result<Planes, ExrError> {
    let meta = MetaData::read_from_file(path, false).map_err(|e| unreadable(path, e))?;
    // Any of the layers may turn out to be the first that can be read.
    for header in &meta.headers {
        let at = header.own_attributes.layer_position;
        place(path, header.shared_attributes.display_window, at, header.layer_size, full)?;
        let values = header.channels.list.len().saturating_mul(full.0.saturating_mul(full.1));
        if values > MAX_VALUES {
            return Err(error(path, format!("{} channels are too many for its size", header.channels.list.len())));
        }
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|e| unreadable(path, e))?;
    let layer = image.layer_data;
    let origin = place(path, image.attributes.display_window, layer.attributes.layer_position, layer.size, full)?;
    let channels: Vec<(String, Vec<f32>)> = layer
        .channel_data
        .list
        .into_iter()
        .map(|channel| (channel.name.to_string(), channel.sample_data.values_as_f32().collect()))
        .collect();
    match channels.iter().find(|(_, pixels)| pixels.len() != layer.size.area()) {
        Some((name, _)) => {
            Err(error(path, format!("the channel {name} has not one value a pixel; write it unsampled")))
        }
        None => Ok(Planes { origin, full, size: (layer.size.0, layer.size.1), channels }),
    }
}

/// Where in its frame a layer begins, pixels; the frame must be `full` and hold all of the layer.
fn place(
    path: &Path,
    frame: IntegerBounds,
    at: Vec2<i32>,
    size: Vec2<usize>,
    full: (usize, usize),
) -> Result<(usize, usize), ExrError> {
    if (frame.size.0, frame.size.1) != full {
        let reason =
            format!("the image is {} x {} pixels, {} x {} expected", frame.size.0, frame.size.1, full.0, full.1);
        return Err(error(path, reason));
    }
    let begin = |at: i32, frame: i32| usize::try_from(i64::from(at) - i64::from(frame));
    let (Ok(x), Ok(y)) = (begin(at.0, frame.position.0), begin(at.1, frame.position.1)) else {
        return Err(error(path, "its data begin outside its frame"));
    };
    if x.saturating_add(size.0) > full.0 || y.saturating_add(size.1) > full.1 {
        return Err(error(path, "its data reach outside its frame"));
    }
    Ok((x, y))
}

const COLOURS: [&str; 3] = ["R", "G", "B"];
const VARIANCES: [&str; 3] = ["variance.R", "variance.G", "variance.B"];
const VALID: &str = "valid";

/// Reads a radiance image as a full frame: R G B, or one channel Y for grey, with variance and validity where the file has
/// them. Pixels outside the data window are invalid. NaN, infinite or negative radiance in a valid pixel is refused, and so
/// are colours or variances of which a part is missing.
pub fn read_radiance(path: &Path, full: (usize, usize)) -> Result<RadianceImage, ExrError> {
    let mut planes = read_planes(path, full)?;
    check_whole(path, &planes)?;
    let names = planes.names();
    let colours = triple(&mut planes, COLOURS).or_else(|| planes.take("Y").map(|y| [y.clone(), y.clone(), y]));
    let Some(colours) = colours else {
        return Err(error(path, format!("it has the channels {names}; R, G and B (or Y) are needed")));
    };
    let variances = triple(&mut planes, VARIANCES);
    check_room(path, full, variances.is_some())?;
    let valid = planes.take(VALID);
    let mut image = RadianceImage {
        radiance: Image::filled(full.0, full.1, [0.0; 3]),
        variance: variances.as_ref().map(|_| Image::filled(full.0, full.1, [0.0; 3])),
        valid: Image::filled(full.0, full.1, false),
    };
    for row in 0..planes.size.1 {
        for column in 0..planes.size.0 {
            let from = row * planes.size.0 + column;
            let (x, y) = (planes.origin.0 + column, planes.origin.1 + row);
            let to = y * full.0 + x;
            if valid.as_ref().is_some_and(|v| v[from] == 0.0) {
                continue;
            }
            let pixel = [colours[0][from], colours[1][from], colours[2][from]];
            check(path, "radiance", pixel, x, y)?;
            image.radiance.pixels[to] = pixel;
            image.valid.pixels[to] = true;
            if let (Some(into), Some(v)) = (&mut image.variance, &variances) {
                let variance = [v[0][from], v[1][from], v[2][from]];
                check(path, "variance", variance, x, y)?;
                into.pixels[to] = variance;
            }
        }
    }
    Ok(image)
}

/// Reads three numbers a pixel, of either sign, as a full frame: channels X Y Z or R G B. Pixels outside the data window
/// hold zeros; whether the numbers are finite is for the caller to say.
pub fn read_vectors(path: &Path, full: (usize, usize)) -> Result<Image<[f32; 3]>, ExrError> {
    let mut planes = read_planes(path, full)?;
    let names = planes.names();
    let Some([x, y, z]) = triple(&mut planes, ["X", "Y", "Z"]).or_else(|| triple(&mut planes, COLOURS)) else {
        return Err(error(path, format!("it has the channels {names}; X, Y and Z (or R, G and B) are needed")));
    };
    let mut image = Image::filled(full.0, full.1, [0.0; 3]);
    for from in 0..planes.size.0 * planes.size.1 {
        let (column, row) = (planes.origin.0 + from % planes.size.0, planes.origin.1 + from / planes.size.0);
        image.pixels[row * full.0 + column] = [x[from], y[from], z[from]];
    }
    Ok(image)
}

/// Refuses colours and variances that are there in part: the rest would be passed over unnoticed.
fn check_whole(path: &Path, planes: &Planes) -> Result<(), ExrError> {
    let there = |name: &str| planes.channels.iter().any(|(known, _)| known == name);
    let part = |names: [&str; 3]| names.into_iter().any(there) && !names.into_iter().all(there);
    let other_variance =
        |name: &str| name.split_once('.').is_some_and(|(kind, _)| kind == "variance") && !VARIANCES.contains(&name);
    let (what, wanted) = if part(COLOURS) {
        ("colour", COLOURS)
    } else if part(VARIANCES) || planes.channels.iter().any(|(name, _)| other_variance(name)) {
        ("variance", VARIANCES)
    } else {
        return Ok(());
    };
    let missing: Vec<&str> = wanted.into_iter().filter(|name| !there(name)).collect();
    let missing = if missing.is_empty() { String::new() } else { format!(", without {}", missing.join(", ")) };
    let remedy = format!("give {} and no other {what}, or none of them", wanted.join(", "));
    Err(error(path, format!("it has the channels {}{missing}: {remedy}", planes.names())))
}

/// Refuses a frame for which there is no memory. A small crop in a huge frame is a small file, and takes room only where it
/// has data; but a limit of the process counts all of it.
fn check_room(path: &Path, full: (usize, usize), with_variance: bool) -> Result<(), ExrError> {
    let bytes_a_pixel = MAPS_BYTES + if with_variance { 25 } else { 13 };
    let bytes = full.0.saturating_mul(full.1).saturating_mul(bytes_a_pixel);
    // Asked for and given back at once: the frame itself is taken as zeroed memory, which cannot be asked for with an answer.
    Vec::<u8>::new().try_reserve_exact(bytes).map_err(|_| {
        let (width, height, megabytes) = (full.0, full.1, bytes >> 20);
        let remedy = "lift the limit, or cut images and camera (width, height, principal_px) to the object";
        error(path, format!("no memory for a frame of {width} x {height} pixels ({megabytes} MiB): {remedy}"))
    })
}

/// Bytes a pixel that the maps of a result take while they are written.
const MAPS_BYTES: usize = 24;

fn triple(planes: &mut Planes, names: [&str; 3]) -> Option<[Vec<f32>; 3]> {
    Some([planes.take(names[0])?, planes.take(names[1])?, planes.take(names[2])?])
}

fn check(path: &Path, what: &str, pixel: [f32; 3], x: usize, y: usize) -> Result<(), ExrError> {
    match pixel.iter().find(|value| !value.is_finite() || **value < 0.0) {
        None => Ok(()),
        Some(value) => Err(error(
            path,
            format!(
                "the {what} at column {x}, row {y} is {value}; values must be finite and not negative (mark bad pixels in a channel \"valid\")"
            ),
        )),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn sample() -> RadianceImage {
        let pixel = |i: usize| [i as f32 * 0.5, i as f32 + 0.25, 3.0];
        RadianceImage {
            radiance: Image { width: 4, height: 3, pixels: (0..12).map(pixel).collect() },
            variance: Some(Image::filled(4, 3, [0.1, 0.2, 0.3])),
            valid: Image { width: 4, height: 3, pixels: (0..12).map(|i| i != 5).collect() },
        }
    }

    #[test]
    fn a_crop_comes_back_in_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let image = sample();
        write_radiance(&path, &image, (2, 1), (10, 8), &[("unit", "1".to_owned())]).unwrap();
        let back = read_radiance(&path, (10, 8)).unwrap();
        for y in 0..8 {
            for x in 0..10 {
                let inside = (2..6).contains(&x) && (1..4).contains(&y);
                let valid = inside && *image.valid.at(x - 2, y - 1);
                assert_eq!(*back.valid.at(x, y), valid);
                if valid {
                    assert_eq!(back.radiance.at(x, y), image.radiance.at(x - 2, y - 1));
                    assert_eq!(back.variance.as_ref().unwrap().at(x, y), &[0.1, 0.2, 0.3]);
                }
            }
        }
    }

    #[test]
    fn wrong_size_nan_and_missing_channels_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let mut image = sample();
        write_radiance(&path, &image, (0, 0), (4, 3), &[]).unwrap();
        assert!(read_radiance(&path, (5, 3)).unwrap_err().to_string().contains("4 x 3"));
        image.radiance.pixels[6][1] = f32::NAN;
        write_radiance(&path, &image, (0, 0), (4, 3), &[]).unwrap();
        assert!(read_radiance(&path, (4, 3)).unwrap_err().to_string().contains("column 2, row 1"));
        let planes = Planes { origin: (0, 0), full: (1, 1), size: (1, 1), channels: vec![("Q".to_owned(), vec![1.0])] };
        write_planes(&path, planes, "").unwrap();
        assert!(read_radiance(&path, (1, 1)).unwrap_err().to_string().contains('Q'));
    }
}
