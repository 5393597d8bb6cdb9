//! PNG pictures out.

use crate::numerics::image::Image;
use std::io::Cursor;
use std::path::Path;

/// A picture of 8 bits a channel as the bytes of a PNG file.
///
/// # Errors
/// It cannot be encoded.
pub fn encode(picture: &Image<[u8; 3]>) -> Result<Vec<u8>, String> {
    let (width, height) = (picture.width as u32, picture.height as u32);
    let mut encoded = Cursor::new(Vec::new());
    let (colour, format) = (image::ExtendedColorType::Rgb8, image::ImageFormat::Png);
    let bytes = picture.pixels.as_flattened();
    image::write_buffer_with_format(&mut encoded, bytes, width, height, colour, format).map_err(|e| e.to_string())?;
    Ok(encoded.into_inner())
}

/// Writes a picture of 8 bits a channel.
///
/// # Errors
/// It cannot be encoded or written; the reason does not name the path.
pub fn write(path: &Path, picture: &Image<[u8; 3]>) -> Result<(), String> {
    // In one piece: the encoder's own buffer does not tell of a full disk.
    std::fs::write(path, encode(picture)?).map_err(|e| e.to_string())
}
