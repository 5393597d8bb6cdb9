//! Radiance written strip by strip: a full frame of radiance, variance and validity is 28 bytes a pixel, and need never be in
//! memory at once.

use super::behind::Behind;
use super::{ATTRIBUTE, COLOURS, ExrError, VALID, VARIANCES, error, signed, text};
use crate::numerics::image::{Image, RadianceImage};
use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::{ChunksWriter, write_chunks_with};
use exr::compression::Compression;
use exr::error::UnitResult;
use exr::meta::BlockDescription;
use exr::meta::attribute::{AttributeValue, ChannelDescription, IntegerBounds, LineOrder, SampleType, Text};
use exr::meta::header::{Header, ImageAttributes, LayerAttributes};
use exr::prelude::Vec2;
use rayon::prelude::*;
use std::collections::HashMap;
use std::fs::File;
use std::path::Path;

/// Where a crop lies in its frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Left column and top row inside the full frame.
    pub origin: (usize, usize),
    /// Width and height of the full frame, pixels.
    pub full: (usize, usize),
    /// Width and height of the crop, pixels.
    pub size: (usize, usize),
}

/// Writes radiance (R G B), its variance (variance.R ...) and validity (valid: 1 or 0) as uncompressed f32 with `origin`
/// (x, y) of the crop inside a `full` (width, height) frame as the data window; `attributes` say what the pixels are.
pub fn write_radiance(
    path: &Path,
    image: &RadianceImage,
    origin: (usize, usize),
    full: (usize, usize),
    attributes: &[(&str, String)],
) -> Result<(), ExrError> {
    let place = Place { origin, full, size: (image.radiance.width, image.radiance.height) };
    write(path, place, image.variance.is_some(), attributes, |put| put(image))
}

/// As [`write_radiance`], of rows that `fill` merges into `strip` when they are wanted: it is told the first row of each strip,
/// in order. Rows of the last strip beyond the end of the crop are not looked at.
pub fn write_strips(
    path: &Path,
    place: Place,
    attributes: &[(&str, String)],
    strip: &mut RadianceImage,
    mut fill: impl FnMut(usize, &mut RadianceImage),
) -> Result<(), ExrError> {
    write(path, place, strip.variance.is_some(), attributes, |put| {
        for first in (0..place.size.1).step_by(strip.radiance.height.max(1)) {
            fill(first, strip);
            put(strip)?;
        }
        Ok(())
    })
}

/// Takes the next rows of the image.
type Put<'a> = &'a mut dyn FnMut(&RadianceImage) -> UnitResult;

fn write(
    path: &Path,
    place: Place,
    with_variance: bool,
    attributes: &[(&str, String)],
    rows: impl FnOnce(Put<'_>) -> UnitResult,
) -> Result<(), ExrError> {
    let headers = [header(path, place, with_variance, attributes)?].into_iter().collect();
    let top = signed(path, place.origin.1)?;
    let mut file = File::create(path).and_then(Behind::new).map_err(|e| error(path, e.to_string()))?;
    let written = write_chunks_with(&mut file, headers, true, |_, writer| {
        let (mut next, mut y_coordinate) = (0, top);
        rows(&mut |strip| {
            let left = strip.radiance.height.min(place.size.1 - next);
            let lines: Vec<Vec<u8>> = (0..left).into_par_iter().map(|row| line(strip, row)).collect();
            for compressed_pixels_le in lines {
                let block = CompressedScanLineBlock { y_coordinate, compressed_pixels_le };
                let chunk = Chunk { layer_index: 0, compressed_block: CompressedBlock::ScanLine(block) };
                writer.write_chunk(next, chunk)?;
                next += 1;
                y_coordinate += 1;
            }
            Ok(())
        })
    });
    // What the system said of the file comes before what the format's writer made of it.
    file.finish().map_err(|e| error(path, e.to_string()))?;
    written.map_err(|e| error(path, e.to_string()))
}

fn header(path: &Path, place: Place, with_variance: bool, attributes: &[(&str, String)]) -> Result<Header, ExrError> {
    // In the order of the alphabet, as the format wants it; `line` writes the same.
    let [red, green, blue] = COLOURS;
    let mut names = vec![blue, green, red, VALID];
    if with_variance {
        let [red, green, blue] = VARIANCES;
        names.extend([blue, green, red]);
    }
    let channel = |name| Ok(ChannelDescription::named(text(path, name)?, SampleType::F32));
    let channels = names.into_iter().map(channel).collect::<Result<_, ExrError>>()?;
    let about: Vec<String> = attributes.iter().map(|(key, value)| format!("{key}: {value}")).collect();
    let mut shared = ImageAttributes::new(IntegerBounds::from_dimensions(Vec2(place.full.0, place.full.1)));
    shared.other = HashMap::from([(text(path, ATTRIBUTE)?, AttributeValue::Text(text(path, &about.join("\n"))?))]);
    let position = Vec2(signed(path, place.origin.0)?, signed(path, place.origin.1)?);
    Ok(Header::new(Text::default(), Vec2(place.size.0, place.size.1), channels)
        .with_encoding(Compression::Uncompressed, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_attributes(LayerAttributes { layer_position: position, ..LayerAttributes::default() })
        .with_shared_attributes(shared))
}

/// The bytes of a row: each channel's values, one channel after the other.
fn line(strip: &RadianceImage, row: usize) -> Vec<u8> {
    fn pixels<T>(image: &Image<T>, row: usize) -> &[T] {
        &image.pixels[row * image.width..][..image.width]
    }
    let mut values: Vec<[u8; 4]> = Vec::with_capacity(7 * strip.radiance.width);
    let colours = |values: &mut Vec<[u8; 4]>, image: &Image<[f32; 3]>| {
        for c in [2, 1, 0] {
            values.extend(pixels(image, row).iter().map(|pixel| pixel[c].to_le_bytes()));
        }
    };
    colours(&mut values, &strip.radiance);
    values.extend(pixels(&strip.valid, row).iter().map(|&valid| f32::from(u8::from(valid)).to_le_bytes()));
    if let Some(variance) = &strip.variance {
        colours(&mut values, variance);
    }
    values.into_flattened()
}
