//! What the body asks of the one who makes the pictures.

use crate::dials::{Aperture, ImageFormat, Iso, Shutter};

/// Settings of one exposure, as the body really used them.
#[derive(Clone, Debug, PartialEq)]
pub struct ExposureSettings {
    /// Shutter speed.
    pub shutter: Shutter,
    /// Aperture.
    pub aperture: Aperture,
    /// ISO speed.
    pub iso: Iso,
    /// Which files are wanted.
    pub format: ImageFormat,
    /// Number of the exposure since the body was made, from 1: the number in the file name.
    pub frame: u32,
}

/// Kind of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureKind {
    /// `.JPG`
    Jpeg,
    /// Canon raw, `.CR2`
    Raw,
}

/// A file as the body writes it on its card.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// The whole file, EXIF included.
    pub bytes: Vec<u8>,
    /// What kind of file it is.
    pub kind: PictureKind,
}

/// Makes the pictures. It runs on a thread of its own, called when the shutter opens.
pub trait Sensor: Send {
    /// The files of one exposure: one for JPEG or RAW, for both the raw file first. The body holds them back until the exposure
    /// has lasted its time.
    fn expose(&mut self, settings: &ExposureSettings) -> Vec<Picture>;
}
