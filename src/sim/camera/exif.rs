//! The file the simulated camera writes: JPEG 4:4:4 with the EXIF of a real body.

use crate::numerics::image::Image;
use exif::experimental::Writer;
use exif::{Context, Field, In, Rational, Tag, Value};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use std::io::Cursor;

/// Quality of the body's finest setting.
const QUALITY: u8 = 99;
/// TIFF/EP's running number of the frame.
const IMAGE_NUMBER: Tag = Tag(Context::Exif, 0x9211);

/// What the EXIF states.
pub(super) struct ExifFacts {
    pub model: &'static str,
    pub nominal_s: f64,
    pub f_number: f64,
    pub iso: u32,
    pub frame_number: u32,
}

/// Encodes the picture; the error is a sentence.
pub(super) fn jpeg(levels: &Image<[f32; 3]>, facts: &ExifFacts) -> Result<Vec<u8>, String> {
    let size = |pixels: usize| u16::try_from(pixels).map_err(|_| format!("{pixels} pixels do not fit a JPEG"));
    let (width, height) = (size(levels.width)?, size(levels.height)?);
    let exif = exif_block(facts).map_err(|e| format!("EXIF cannot be written: {e}"))?;
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, QUALITY);
    encoder.set_sampling_factor(SamplingFactor::F_1_1);
    encoder.add_exif_metadata(&exif).map_err(|e| e.to_string())?;
    let pixels: Vec<[u8; 3]> = levels.pixels.iter().map(luminance_and_differences).collect();
    encoder.encode(pixels.as_flattened(), width, height, ColorType::Ycbcr).map_err(|e| e.to_string())?;
    Ok(bytes)
}

/// JFIF 1.02, straight from what the sensor counted: rounding to whole levels of red, green and blue first would leave the blue
/// difference a twelfth of a level low, because its fractions are sixths and halves are rounded down.
fn luminance_and_differences([red, green, blue]: &[f32; 3]) -> [u8; 3] {
    let luminance = 0.299 * red + 0.587 * green + 0.114 * blue;
    let difference = |colour: f32, scale: f32| 128.0 + (colour - luminance) / scale;
    [luminance, difference(*blue, 1.772), difference(*red, 1.402)].map(|value| value.round() as u8)
}

fn exif_block(facts: &ExifFacts) -> Result<Vec<u8>, exif::Error> {
    let now = jiff::Zoned::now();
    let text = |text: String| Value::Ascii(vec![text.into_bytes()]);
    let fields = [
        (Tag::Make, text("Canon".to_owned())),
        (Tag::Model, text(facts.model.to_owned())),
        (Tag::ExposureTime, Value::Rational(vec![shutter(facts.nominal_s)])),
        (Tag::FNumber, Value::Rational(vec![Rational { num: (facts.f_number * 10.0).round() as u32, denom: 10 }])),
        (Tag::PhotographicSensitivity, Value::Short(vec![u16::try_from(facts.iso).unwrap_or(u16::MAX)])),
        (Tag::DateTimeOriginal, text(now.strftime("%Y:%m:%d %H:%M:%S").to_string())),
        (IMAGE_NUMBER, Value::Long(vec![facts.frame_number])),
    ]
    .map(|(tag, value)| Field { tag, ifd_num: In::PRIMARY, value });
    let mut writer = Writer::new();
    for field in &fields {
        writer.push_field(field);
    }
    let mut block = Cursor::new(Vec::new());
    writer.write(&mut block, true)?;
    Ok(block.into_inner())
}

/// As bodies write it: 1/100 for short times, tenths of a second above a third of a second.
fn shutter(nominal_s: f64) -> Rational {
    if nominal_s < 0.29 {
        Rational { num: 1, denom: (1.0 / nominal_s).round() as u32 }
    } else {
        Rational { num: (nominal_s * 10.0).round() as u32, denom: 10 }
    }
}
