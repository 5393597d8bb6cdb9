//! Bracket to radiance: decode, response, merge (paper 3.3).

use crate::numerics::image::RadianceImage;
use crate::numerics::radiometry::noise::SensorNoise;
use crate::numerics::radiometry::response::Response;

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

/// Develops one bracket; `crop` is in full-frame pixels; `response` is recovered from this bracket when none is given.
pub fn develop(
    _frames: &[BracketFrame<'_>],
    _crop: Option<Crop>,
    _response: Option<&Response>,
    _noise: &SensorNoise,
) -> Result<Developed, DevelopError> {
    unimplemented!("filled on the imaging branch")
}
