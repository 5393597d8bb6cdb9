//! PNG pictures out, and in again.

use super::files::read_bytes;
use crate::numerics::image::Image;
use crate::pipeline::contain::contained;
use image::{ImageFormat, ImageReader};
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

/// Reads a picture as 8 bits a channel; none where it has more than `most` pixels, and then none is decoded.
///
/// # Errors
/// It is no PNG file, or is damaged; the reason does not name the path.
pub fn read(path: &Path, most: u64) -> Result<Option<Image<[u8; 3]>>, String> {
    let bytes = read_bytes(path, "picture", 4 * most)?;
    let remedy = "fit again, or put the file back from a copy";
    let damaged = |reason: String| format!("no sound PNG file ({reason}): {remedy}");
    let reader = || ImageReader::with_format(Cursor::new(&bytes), ImageFormat::Png);
    let (width, height) = reader().into_dimensions().map_err(|e| damaged(e.to_string()))?;
    if u64::from(width) * u64::from(height) > most {
        return Ok(None);
    }
    let decoded = contained(|| reader().decode().map_err(|e| e.to_string()));
    let decoded = decoded.unwrap_or_else(|| Err("the decoder gave up".to_owned())).map_err(damaged)?;
    let pixels = decoded.into_rgb8().pixels().map(|pixel| pixel.0).collect();
    Ok(Some(Image { width: width as usize, height: height as usize, pixels }))
}
