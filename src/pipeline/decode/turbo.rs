//! libjpeg-turbo in place of the decoder in Rust: the feature `libjpeg-turbo`.

use turbojpeg::{Decompressor, Error, Image, PixelFormat};

/// Decodes a JPEG whose header said `width` and `height` into its interleaved RGB samples. libjpeg-turbo's defaults are the exact
/// transform and interpolated differences of colour; what it calls a warning (bits missing, a marker where none belongs) is an
/// error here.
pub(super) fn decode(bytes: &[u8], width: usize, height: usize, samples: &mut [u8]) -> Result<(), Error> {
    let picture = Image { pixels: samples, width, pitch: 3 * width, height, format: PixelFormat::RGB };
    Decompressor::new()?.decompress(bytes, picture)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand::{RngExt, SeedableRng};
    use zune_core::bytestream::ZCursor;

    /// Both decoders keep to the standard's accuracy: what a build merges does not depend on which it has.
    #[test]
    fn it_agrees_with_the_decoder_in_rust() {
        let (width, height) = (200_usize, 120_usize);
        let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
        let pixel = |i: usize| [i % width, i / width, (i % width + i / width) / 2].map(|v| (v + 20) as u8);
        let noisy = (0..width * height)
            .flat_map(pixel)
            .map(|v| (i32::from(v) + random.random_range(-6..=6)).clamp(0, 255) as u8);
        let noisy: Vec<u8> = noisy.collect();
        let mut file = Vec::new();
        let mut encoder = jpeg_encoder::Encoder::new(&mut file, 95);
        encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::F_2_1);
        encoder.encode(&noisy, width as u16, height as u16, jpeg_encoder::ColorType::Rgb).unwrap();

        let mut ours = vec![0; 3 * width * height];
        decode(&file, width, height, &mut ours).unwrap();
        let theirs = zune_jpeg::JpegDecoder::new(ZCursor::new(&file)).decode().unwrap();
        let differences: Vec<i32> = ours.iter().zip(&theirs).map(|(a, b)| i32::from(*a) - i32::from(*b)).collect();
        let mean = f64::from(differences.iter().sum::<i32>()) / differences.len() as f64;
        assert!(mean.abs() < 0.1, "{mean} levels apart on average");
        assert!(differences.iter().all(|d| d.abs() <= 4), "{:?}", differences.iter().map(|d| d.abs()).max());
    }
}
