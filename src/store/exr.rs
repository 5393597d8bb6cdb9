//! OpenEXR in and out: the only module that knows the `exr` crate.

use crate::numerics::image::RadianceImage;
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

/// Writes radiance (R G B), its variance (variance.R ...) and validity as uncompressed f32 with `origin` (x, y) of the crop
/// inside a `full` (width, height) frame as the data window, and named text attributes.
pub fn write_radiance(
    _path: &Path,
    _image: &RadianceImage,
    _origin: (usize, usize),
    _full: (usize, usize),
    _attributes: &[(&str, String)],
) -> Result<(), ExrError> {
    unimplemented!("filled on the fit branch")
}
