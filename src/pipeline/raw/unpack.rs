//! From the lossless JPEG of a CR2 file to counts: by the crate `rawloader`, if this build has it (feature `raw`).

use super::RawError;
use super::bodies::Body;
use super::container::Container;
use crate::numerics::image::Image;

/// The counts of the whole sensor, masked border included.
#[cfg(not(feature = "raw"))]
pub(super) fn unpack(_: &Container<'_>, _: &Body) -> Result<Image<u16>, RawError> {
    Err(RawError::NotBuilt)
}

/// The counts of the whole sensor, masked border included.
#[cfg(feature = "raw")]
pub(super) fn unpack(container: &Container<'_>, body: &Body) -> Result<Image<u16>, RawError> {
    use crate::pipeline::contain::contained;
    use rawloader::RawImageData;
    use std::io::Read;

    let head = wrapper::head(&body.model, container.slices);
    let decoded = contained(|| rawloader::decode(&mut head.as_slice().chain(container.jpeg)));
    let Some(Ok(decoded)) = decoded else {
        return Err(RawError::Damaged("its sensor counts cannot be decoded"));
    };
    let (width, height) = (decoded.width, decoded.height);
    match decoded.data {
        RawImageData::Integer(pixels) if decoded.cpp == 1 && pixels.len() == width * height => {
            Ok(Image { width, height, pixels })
        }
        _ => Err(RawError::Damaged("it holds no Bayer mosaic: set the body to full-size raw")),
    }
}

/// The least CR2 file that the decoder takes.
#[cfg(feature = "raw")]
mod wrapper {
    const ASCII: u16 = 2;
    const SHORT: u16 = 3;
    const LONG: u16 = 4;

    /// All of it up to the lossless JPEG: a directory with the model of the body, the mark of the counts, and their
    /// slices.
    pub fn head(model: &str, slices: Option<[u16; 3]>) -> Vec<u8> {
        let text = |text: &str| [text.as_bytes(), b"\0"].concat();
        let (make, model) = (text("Canon"), text(model));
        let widths: Vec<u8> = slices.iter().flatten().flat_map(|width| width.to_le_bytes()).collect();
        let entries = if slices.is_some() { 5_u16 } else { 4 };
        // Header, directory, the values that do not fit into it, the JPEG.
        let values = 8 + 2 + 12 * u32::from(entries) + 4;
        let at_model = values + make.len() as u32;
        let at_widths = at_model + model.len() as u32;
        let jpeg = at_widths + widths.len() as u32;

        let mut head = b"II\x2a\0\x08\0\0\0".to_vec();
        head.extend(entries.to_le_bytes());
        entry(&mut head, 0x010f, ASCII, make.len() as u32, values);
        entry(&mut head, 0x0110, ASCII, model.len() as u32, at_model);
        entry(&mut head, 0x0111, LONG, 1, jpeg);
        entry(&mut head, 0xc5d8, LONG, 1, 1);
        if slices.is_some() {
            entry(&mut head, 0xc640, SHORT, 3, at_widths);
        }
        head.extend(0_u32.to_le_bytes());
        [head, make, model, widths].concat()
    }

    fn entry(head: &mut Vec<u8>, tag: u16, kind: u16, count: u32, value: u32) {
        head.extend(tag.to_le_bytes());
        head.extend(kind.to_le_bytes());
        head.extend(count.to_le_bytes());
        head.extend(value.to_le_bytes());
    }
}
