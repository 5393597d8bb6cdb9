//! PNG and TIFF images of a dataset, 8 or 16 bit.

use crate::numerics::image::{Image, RadianceImage};
use crate::pipeline::contain::contained;
use crate::store::files::{read_bytes, shown};
use image::{DynamicImage, ImageFormat, ImageReader};
use std::io::Cursor;
use std::path::Path;

/// What a picture is for, and the formats it may be converted to.
#[derive(Clone, Copy)]
struct Use {
    name: &'static str,
    formats: &'static str,
}

const IMAGE: Use =
    Use { name: "image", formats: "linear PNG, TIFF or EXR, or merge a bracket of camera JPEGs with rigd merge" };
const MASK: Use = Use { name: "mask", formats: "PNG or TIFF" };

/// Beyond 8 bytes a pixel a file may hold so much of other things, bytes.
const BESIDE_PIXELS: u64 = 64 << 20;

/// Decodes a PNG or TIFF whose size must be `size`; the size is checked before any pixel is decoded.
fn open(path: &Path, size: (usize, usize), purpose: Use) -> Result<DynamicImage, String> {
    let complain = |reason: String| format!("{}: {reason}", shown(path));
    let most = BESIDE_PIXELS + 8 * size.0 as u64 * size.1 as u64;
    let bytes = read_bytes(path, purpose.name, most).map_err(complain)?;
    let format = format_of(&bytes, purpose).map_err(complain)?;
    let damaged = |reason: String| {
        let name = format!("{format:?}").to_uppercase();
        complain(format!("the {name} file is damaged or cut short ({reason}): copy or write it again"))
    };
    let reader = || ImageReader::with_format(Cursor::new(&bytes), format);
    let (width, height) = reader().into_dimensions().map_err(|e| damaged(e.to_string()))?;
    if (width as usize, height as usize) != size {
        return Err(complain(format!("the image is {width} x {height} pixels, {} x {} expected", size.0, size.1)));
    }
    let decoded = contained(|| reader().decode().map_err(|e| e.to_string()));
    decoded.unwrap_or_else(|| Err("the decoder gave up".to_owned())).map_err(damaged)
}

/// The type that the first bytes show, whatever the file is called.
fn format_of(bytes: &[u8], purpose: Use) -> Result<ImageFormat, String> {
    let convert = format!("convert it to {}", purpose.formats);
    if bytes.is_empty() {
        return Err(format!("the file is empty: copy or write the {} again", purpose.name));
    }
    match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Tiff)) => Ok(format),
        Ok(format) => {
            Err(format!("this is a {} file, whatever its name says: {convert}", format!("{format:?}").to_uppercase()))
        }
        Err(_) => Err(format!("this is neither a PNG nor a TIFF file: {convert}")),
    }
}

/// PNG or TIFF, taken as linear: radiance is the value over full scale, its variance that of rounding.
pub(super) fn read_integer(path: &Path, size: (usize, usize), saturation: f64) -> Result<RadianceImage, String> {
    use DynamicImage as D;
    let decoded = open(path, size, IMAGE)?;
    let step = match decoded {
        D::ImageLuma8(_) | D::ImageLumaA8(_) | D::ImageRgb8(_) | D::ImageRgba8(_) => 1.0 / 255.0,
        D::ImageLuma16(_) | D::ImageLumaA16(_) | D::ImageRgb16(_) | D::ImageRgba16(_) => 1.0 / 65_535.0,
        _ => return Err(format!("{}: only 8- and 16-bit images can be read; use EXR for float", shown(path))),
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

/// A mask: true where any channel is not zero.
pub(in crate::store) fn read_mask(path: &Path, size: (usize, usize)) -> Result<Image<bool>, String> {
    let decoded = open(path, size, MASK)?;
    let pixels: Vec<bool> = decoded.to_rgb32f().pixels().map(|p| p.0.iter().any(|&v| v > 0.0)).collect();
    if !pixels.contains(&true) {
        return Err(format!(
            "{}: every pixel of the mask is zero: give the pixels of the object another value",
            shown(path)
        ));
    }
    Ok(Image { width: size.0, height: size.1, pixels })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn what_cannot_be_read_is_said_to_be_what_it_is() {
        let png = include_bytes!("../../../fuzz/seeds/dataset_image/rgb8.png");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let refusal = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            open(&path, (10, 8), IMAGE).unwrap_err()
        };
        for cut in [20, 45, png.len() - 20] {
            let found = refusal(&png[..cut]);
            assert!(found.contains("a.png: the PNG file is damaged or cut short"), "{cut}: {found}");
        }
        let jpeg = include_bytes!("../../../fuzz/seeds/jpeg_frame/baseline.jpg");
        assert!(refusal(jpeg).contains("this is a JPEG file, whatever its name says: convert it"));
        assert!(refusal(b"not a picture").contains("neither a PNG nor a TIFF"));
        assert!(refusal(b"").contains("the file is empty"));
        std::fs::write(&path, png).unwrap();
        assert!(open(&path, (8, 10), IMAGE).unwrap_err().contains("10 x 8 pixels, 8 x 10 expected"));
        open(&path, (10, 8), IMAGE).unwrap();
    }
}
