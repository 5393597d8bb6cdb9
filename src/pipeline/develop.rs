//! Bracket to radiance: decode, response, merge (paper 3.3).

use super::decode::{Format, decode};
use crate::numerics::image::{Image, RadianceImage};
use crate::numerics::radiometry::bracket::{Bracket, BracketError, Exposure};
use crate::numerics::radiometry::merge::merge;
use crate::numerics::radiometry::noise::SensorNoise;
use crate::numerics::radiometry::response::{Response, recover};

/// A frame of a bracket.
#[derive(Clone, Copy, Debug)]
pub struct BracketFrame<'a> {
    /// Name for messages.
    pub name: &'a str,
    /// The file as the camera wrote it.
    pub bytes: &'a [u8],
    /// The time the shutter really was open, seconds.
    pub time_s: f64,
}

/// A rectangle of pixels kept; the rest of the frame is dropped right after decoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// Left column.
    pub x: usize,
    /// Top row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// A developed bracket.
#[derive(Clone, Debug)]
pub struct Developed {
    /// Radiance, variance and validity of the crop.
    pub image: RadianceImage,
    /// The response used.
    pub response: Response,
}

/// Why a bracket cannot be developed.
#[derive(Clone, Debug, thiserror::Error)]
pub enum DevelopError {
    /// A frame cannot be decoded or has the wrong size.
    #[error("frame {name}: {reason}")]
    Frame {
        /// The frame.
        name: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// The bracket as a whole is unusable.
    #[error("{0}")]
    Bracket(String),
}

impl From<BracketError> for DevelopError {
    fn from(error: BracketError) -> Self {
        Self::Bracket(error.to_string())
    }
}

/// Develops one bracket; `crop` is in full-frame pixels; `response` is recovered from this bracket when none is given.
pub fn develop(
    frames: &[BracketFrame<'_>],
    crop: Option<Crop>,
    response: Option<&Response>,
    noise: &SensorNoise,
) -> Result<Developed, DevelopError> {
    let bracket = read_bracket(frames, crop)?;
    let response = match response {
        Some(response) => {
            bracket.check_times()?;
            response.clone()
        }
        None => recover(&bracket)?.response,
    };
    Ok(Developed { image: merge(&bracket, &response, noise), response })
}

/// Decodes the frames, one full frame in memory at a time, and keeps the crop of each.
pub fn read_bracket(frames: &[BracketFrame<'_>], crop: Option<Crop>) -> Result<Bracket, DevelopError> {
    let mut level_variance = LOSSLESS_VARIANCE;
    let mut exposures = Vec::with_capacity(frames.len());
    for frame in frames {
        let unusable = |reason: String| DevelopError::Frame { name: frame.name.to_owned(), reason };
        let picture = decode(frame.bytes).map_err(|e| unusable(e.to_string()))?;
        if Format::of(frame.bytes) == Ok(Format::Jpeg) {
            level_variance = JPEG_VARIANCE;
        }
        let levels = match crop {
            Some(crop) => cut(&picture, crop).map_err(unusable)?,
            None => picture,
        };
        exposures.push(Exposure { name: frame.name.to_owned(), levels, time_s: frame.time_s });
    }
    Ok(Bracket::new(exposures, level_variance)?)
}

/// Variance of rounding to a whole level, levels squared.
const LOSSLESS_VARIANCE: [f64; 3] = [1.0 / 12.0; 3];
/// What a JPEG of the finest setting (4:4:4) adds to red, green and blue, levels squared: rounding to YCbCr, of the cosine
/// coefficients and back to a level. Measured on the simulated camera's files.
const JPEG_VARIANCE: [f64; 3] = [0.9, 0.5, 1.2];

fn cut(picture: &Image<[u8; 3]>, crop: Crop) -> Result<Image<[u8; 3]>, String> {
    let inside =
        |start: usize, size: usize, full: usize| size > 0 && start.checked_add(size).is_some_and(|end| end <= full);
    if !inside(crop.x, crop.width, picture.width) || !inside(crop.y, crop.height, picture.height) {
        return Err(format!(
            "it is {}x{} pixels, the crop {}x{} at ({}, {}) does not lie inside: check the camera's size in the rig file",
            picture.width, picture.height, crop.width, crop.height, crop.x, crop.y
        ));
    }
    let rows = picture.pixels.chunks_exact(picture.width).skip(crop.y).take(crop.height);
    let pixels = rows.flat_map(|row| row[crop.x..crop.x + crop.width].iter().copied()).collect();
    Ok(Image { width: crop.width, height: crop.height, pixels })
}
