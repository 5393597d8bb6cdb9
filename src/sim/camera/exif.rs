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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::pipeline::decode::decode;
    use crate::pipeline::develop::JPEG_VARIANCE;
    use rand::SeedableRng;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand_distr::{Distribution, StandardNormal};

    /// By how much the variance about the true levels is larger in the file than in what the sensor counted, whose noise has `sigma`
    /// levels: a shaded surface.
    fn added(sigma: f32) -> [f64; 3] {
        const SIDE: usize = 256;
        let mut random = Xoshiro256PlusPlus::seed_from_u64(4);
        let truth = |i: usize| {
            let (x, y) = ((i % SIDE) as f32, (i / SIDE) as f32);
            [60.0 + 0.5 * x, 40.0 + 0.4 * y + 0.2 * x, 180.0 - 0.45 * y]
        };
        let mut counted = |i: usize| {
            truth(i).map(|level| {
                let noise: f32 = StandardNormal.sample(&mut random);
                level + sigma * noise
            })
        };
        let levels = Image { width: SIDE, height: SIDE, pixels: (0..SIDE * SIDE).map(&mut counted).collect() };
        let facts = ExifFacts { model: "", nominal_s: 1.0, f_number: 5.6, iso: 100, frame_number: 1 };
        let read = decode(&jpeg(&levels, &facts).unwrap()).unwrap();
        std::array::from_fn(|c| {
            let off = |(i, pixel): (usize, &[u8; 3])| f64::from(f32::from(pixel[c]) - truth(i)[c]).powi(2);
            let variance = read.pixels.iter().enumerate().map(off).sum::<f64>() / (SIDE * SIDE) as f64;
            variance - f64::from(sigma).powi(2)
        })
    }

    /// `cargo test --lib a_file_adds_the_variance -- --nocapture` prints them: less of a smooth surface, whose noise the file drops, more
    /// of a noisy one. With the variance at 0.8 levels the errors of merged pixels are what the merge says (`tests/sim_camera.rs`).
    #[test]
    fn a_file_adds_the_variance_that_the_merge_assumes() {
        for sigma in [0.25, 0.5, 0.8, 1.0, 2.0] {
            let added = added(sigma);
            println!("noise of {sigma} levels: {added:.2?} levels squared more");
            for (added, assumed) in added.iter().zip(JPEG_VARIANCE) {
                let most = if sigma == 0.8 { 1.15 } else { 3.5 };
                assert!((1.0 / most..most).contains(&(added / assumed)), "noise {sigma}: {added} against {assumed}");
            }
        }
    }
}
