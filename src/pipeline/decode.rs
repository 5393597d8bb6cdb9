//! Bytes of a picture file to 8-bit RGB and the facts its EXIF states. Any bytes give a picture or a typed error.

#[cfg(feature = "libjpeg-turbo")]
mod turbo;

use super::contain::contained;
use crate::numerics::image::Image;
use std::io::Cursor;
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// Larger pictures are refused before any memory is taken: no body this is made for has more than 61 megapixels.
pub const MAX_PIXELS: usize = 64_000_000;
/// Longest side accepted, pixels.
const MAX_SIDE: usize = 20_000;

/// What decodes JPEG files in this build.
pub const JPEG_DECODER: &str = if cfg!(feature = "libjpeg-turbo") { "libjpeg-turbo" } else { "zune-jpeg" };

/// Why bytes are no usable picture.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// No known file type.
    #[error("neither JPEG, PNG nor BMP (it starts with {start:02x?}): give the file as the camera wrote it")]
    UnknownFormat {
        /// The first bytes, at most 8.
        start: Vec<u8>,
    },
    /// A raw file.
    #[error(
        "a Canon raw file: only `rigd merge` reads these, a folder with nothing else in it; set the camera to JPEG"
    )]
    Raw,
    /// Larger than any camera's picture.
    #[error("{width}x{height} pixels are more than the {MAX_PIXELS} accepted: give a smaller picture")]
    TooLarge {
        /// Columns claimed.
        width: usize,
        /// Rows claimed.
        height: usize,
    },
    /// The file is damaged.
    #[error("the {format} file is damaged or cut short ({reason}): fetch it from the camera again")]
    Damaged {
        /// File type.
        format: &'static str,
        /// What the decoder said.
        reason: String,
    },
}

/// Type of a picture file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Lossy; a camera's own.
    Jpeg,
    /// Lossless.
    Png,
    /// Lossless.
    Bmp,
}

impl Format {
    /// The type that the first bytes show.
    pub fn of(bytes: &[u8]) -> Result<Self, DecodeError> {
        match bytes {
            [0xff, 0xd8, 0xff, ..] => Ok(Self::Jpeg),
            [0x89, b'P', b'N', b'G', ..] => Ok(Self::Png),
            [b'B', b'M', ..] => Ok(Self::Bmp),
            [b'I', b'I', 0x2a, 0, _, _, _, _, b'C', b'R', ..] => Err(DecodeError::Raw),
            _ => Err(DecodeError::UnknownFormat { start: bytes.iter().take(8).copied().collect() }),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Jpeg => "JPEG",
            Self::Png => "PNG",
            Self::Bmp => "BMP",
        }
    }
}

/// Decodes a JPEG, PNG or BMP file to 8-bit RGB as stored: an EXIF orientation is not applied, because the rig's geometry
/// is the sensor's.
pub fn decode(bytes: &[u8]) -> Result<Image<[u8; 3]>, DecodeError> {
    let mut picture = Image::filled(0, 0, [0; 3]);
    decode_into(bytes, &mut picture)?;
    Ok(picture)
}

/// As [`decode`], into the memory of another picture: taking a frame's memory anew costs a third of decoding it. After an error
/// the picture has no pixels.
pub fn decode_into(bytes: &[u8], picture: &mut Image<[u8; 3]>) -> Result<(), DecodeError> {
    let format = Format::of(bytes)?;
    let pixels = std::mem::take(&mut picture.pixels);
    let decoded = contained(|| match format {
        Format::Jpeg => decode_jpeg(bytes, pixels),
        Format::Png => decode_lossless(bytes, format, image::ImageFormat::Png),
        Format::Bmp => decode_lossless(bytes, format, image::ImageFormat::Bmp),
    });
    *picture = decoded.unwrap_or_else(|| Err(damaged(format, "the decoder gave up")))?;
    Ok(())
}

fn damaged(format: Format, reason: impl ToString) -> DecodeError {
    DecodeError::Damaged { format: format.name(), reason: reason.to_string() }
}

fn check_size(width: usize, height: usize) -> Result<(), DecodeError> {
    if width > MAX_SIDE || height > MAX_SIDE || width * height > MAX_PIXELS {
        return Err(DecodeError::TooLarge { width, height });
    }
    Ok(())
}

fn decode_jpeg(bytes: &[u8], mut pixels: Vec<[u8; 3]>) -> Result<Image<[u8; 3]>, DecodeError> {
    let broken = |reason: zune_jpeg::errors::DecodeErrors| damaged(Format::Jpeg, reason);
    if !has_end(bytes) {
        return Err(damaged(Format::Jpeg, "it has no end marker"));
    }
    // Strict: a truncated file is an error, not a picture with a grey lower part.
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(MAX_SIDE)
        .set_max_height(MAX_SIDE)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(broken)?;
    let (width, height) = decoder.dimensions().ok_or_else(|| damaged(Format::Jpeg, "it has no size"))?;
    check_size(width, height)?;
    if pixels.len() != width * height {
        pixels = vec![[0; 3]; width * height];
    }
    if pixels.is_empty() || decoder.output_buffer_size() != Some(pixels.as_flattened().len()) {
        return Err(damaged(Format::Jpeg, "it has fewer samples than its size says"));
    }
    #[cfg(not(feature = "libjpeg-turbo"))]
    decoder.decode_into(pixels.as_flattened_mut()).map_err(broken)?;
    #[cfg(feature = "libjpeg-turbo")]
    turbo::decode(bytes, width, height, pixels.as_flattened_mut()).map_err(|e| damaged(Format::Jpeg, e))?;
    Ok(Image { width, height, pixels })
}

/// True when an end marker follows the last start of a scan. Inside a scan neither occurs, and the scan and end of a thumbnail
/// lie before the picture's own; the decoder itself takes a file that lacks its last rows' bits.
fn has_end(bytes: &[u8]) -> bool {
    let mut from_the_end = bytes.windows(2).rev();
    from_the_end.find(|pair| matches!(pair, [0xff, 0xd9 | 0xda])).is_some_and(|pair| pair[1] == 0xd9)
}

fn decode_lossless(bytes: &[u8], format: Format, kind: image::ImageFormat) -> Result<Image<[u8; 3]>, DecodeError> {
    let reader = || image::ImageReader::with_format(Cursor::new(bytes), kind);
    let (width, height) = reader().into_dimensions().map_err(|e| damaged(format, e))?;
    let (width, height) = (width as usize, height as usize);
    check_size(width, height)?;
    let picture = reader().decode().map_err(|e| damaged(format, e))?;
    rgb(format, width, height, &picture.into_rgb8())
}

fn rgb(format: Format, width: usize, height: usize, samples: &[u8]) -> Result<Image<[u8; 3]>, DecodeError> {
    let (pixels, rest) = samples.as_chunks::<3>();
    if pixels.is_empty() || pixels.len() != width * height || !rest.is_empty() {
        return Err(damaged(format, "it has fewer samples than its size says"));
    }
    Ok(Image { width, height, pixels: pixels.to_vec() })
}

/// What a frame's EXIF says of its shot; each field absent where the file does not say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameInfo {
    /// Exposure time as labelled on the body, seconds: the shutter opens for [`FrameInfo::true_time_s`].
    pub exposure_time_s: Option<f64>,
    /// Aperture, f-number.
    pub f_number: Option<f64>,
    /// ISO speed.
    pub iso: Option<u32>,
    /// The body's model.
    pub model: Option<String>,
    /// Its serial number.
    pub serial: Option<String>,
    /// Focal length the lens was set to, mm.
    pub focal_length_mm: Option<f64>,
    /// Date and time of the shot as the camera writes it, `YYYY:MM:DD HH:MM:SS`.
    pub time: Option<String>,
}

impl FrameInfo {
    /// Reads the EXIF of a picture file; a file without any gives no fields.
    pub fn read(bytes: &[u8]) -> Self {
        contained(|| read_exif(bytes)).flatten().unwrap_or_default()
    }

    /// The time the shutter of a third-stop body aims at ([`power_of_two_s`]); none without a time.
    pub fn true_time_s(&self) -> Option<f64> {
        self.exposure_time_s.and_then(power_of_two_s)
    }
}

/// The time that the shutter of a third-stop body aims at, 2^(k/3) s, for the `label` on its dial, seconds: a label of 15 opens
/// for 16 s. None for a label that is no third of a stop.
pub fn power_of_two_s(label: f64) -> Option<f64> {
    let thirds = 3.0 * label.log2();
    // Labels are up to 0.28 thirds off (15, 1/60); half-stop labels are 0.5 off.
    ((thirds - thirds.round()).abs() < 0.35).then(|| (thirds.round() / 3.0).exp2())
}

fn read_exif(bytes: &[u8]) -> Option<FrameInfo> {
    // One broken field of a body's own must not hide the times.
    let reader = exif::Reader::new().continue_on_error(true).read_from_container(&mut Cursor::new(bytes));
    let fields = reader.or_else(|error| error.distill_partial_result(|_| ())).ok()?;
    Some(FrameInfo::of(&fields))
}

impl FrameInfo {
    /// What these fields say.
    pub(super) fn of(fields: &exif::Exif) -> Self {
        let value = |tag| fields.get_field(tag, exif::In::PRIMARY).map(|field| &field.value);
        let positive = |tag| match value(tag) {
            Some(exif::Value::Rational(v)) => {
                v.first().map(exif::Rational::to_f64).filter(|v| v.is_finite() && *v > 0.0)
            }
            _ => None,
        };
        let text = |tag| match value(tag) {
            Some(exif::Value::Ascii(text)) => text.first().map(|t| String::from_utf8_lossy(t).into_owned()),
            _ => None,
        };
        Self {
            exposure_time_s: positive(exif::Tag::ExposureTime),
            f_number: positive(exif::Tag::FNumber),
            iso: value(exif::Tag::PhotographicSensitivity).and_then(|v| v.get_uint(0)),
            model: text(exif::Tag::Model),
            serial: text(exif::Tag::BodySerialNumber),
            focal_length_mm: positive(exif::Tag::FocalLength),
            time: text(exif::Tag::DateTimeOriginal),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand::{RngExt, SeedableRng};

    /// A small picture with detail in it.
    fn picture() -> Image<[u8; 3]> {
        let pixel = |i: usize| [(i * 5 % 256) as u8, (i / 48 * 7) as u8, (i % 48 * 4) as u8];
        Image { width: 48, height: 32, pixels: (0..48 * 32).map(pixel).collect() }
    }

    fn jpeg() -> Vec<u8> {
        use exif::{Field, In, Rational, Tag, Value};
        let fields = [
            (Tag::ExposureTime, Value::Rational(vec![Rational { num: 1, denom: 60 }])),
            (Tag::FNumber, Value::Rational(vec![Rational { num: 56, denom: 10 }])),
            (Tag::PhotographicSensitivity, Value::Short(vec![100])),
            (Tag::DateTimeOriginal, Value::Ascii(vec![b"2026:11:23 12:00:00".to_vec()])),
        ]
        .map(|(tag, value)| Field { tag, ifd_num: In::PRIMARY, value });
        let mut writer = exif::experimental::Writer::new();
        fields.iter().for_each(|field| writer.push_field(field));
        let mut block = Cursor::new(Vec::new());
        writer.write(&mut block, true).unwrap();
        let mut bytes = Vec::new();
        let mut encoder = jpeg_encoder::Encoder::new(&mut bytes, 95);
        encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::F_1_1);
        encoder.add_exif_metadata(&block.into_inner()).unwrap();
        encoder.encode(picture().pixels.as_flattened(), 48, 32, jpeg_encoder::ColorType::Rgb).unwrap();
        bytes
    }

    fn lossless(format: image::ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image::write_buffer_with_format(
            &mut bytes,
            picture().pixels.as_flattened(),
            48,
            32,
            image::ExtendedColorType::Rgb8,
            format,
        )
        .unwrap();
        bytes.into_inner()
    }

    #[test]
    fn lossless_files_come_back_exactly() {
        for format in [image::ImageFormat::Png, image::ImageFormat::Bmp] {
            assert_eq!(decode(&lossless(format)).unwrap(), picture(), "{format:?}");
        }
    }

    #[test]
    fn jpeg_comes_back_with_its_facts() {
        let decoded = decode(&jpeg()).unwrap();
        assert_eq!((decoded.width, decoded.height), (48, 32));
        let info = FrameInfo::read(&jpeg());
        assert_eq!((info.f_number, info.iso), (Some(5.6), Some(100)));
        assert_eq!(info.time.as_deref(), Some("2026:11:23 12:00:00"));
        assert!((info.true_time_s().unwrap() - 1.0 / 64.0).abs() < 1e-12, "a label of 1/60 opens for 1/64 s");
    }

    #[test]
    fn labels_mean_powers_of_two_and_half_stops_are_refused() {
        let true_time = |label: f64| FrameInfo { exposure_time_s: Some(label), ..FrameInfo::default() }.true_time_s();
        for (label, time) in [(15.0, 16.0), (13.0, 12.699), (6.0, 6.3496), (0.3, 0.31498), (0.01, 0.0098431)] {
            assert!((true_time(label).unwrap() / time - 1.0).abs() < 1e-4, "{label}");
        }
        for half_stop in [0.7, 1.0 / 45.0, 1.0 / 90.0] {
            assert_eq!(true_time(half_stop), None, "{half_stop}");
        }
    }

    #[test]
    fn a_truncated_file_is_an_error_at_any_length() {
        let (png, bmp) = (lossless(image::ImageFormat::Png), lossless(image::ImageFormat::Bmp));
        // A PNG's last 12 bytes are its end marker: without them every pixel is still there and checked.
        for (whole, spare) in [(jpeg(), 0), (png, 12), (bmp, 0)] {
            let needed = whole.len() - spare;
            for length in (0..needed).step_by(7).chain(needed - 80..needed) {
                assert!(decode(&whole[..length]).is_err(), "{length} of {} bytes were taken", whole.len());
            }
        }
    }

    #[test]
    fn mutated_files_give_a_picture_or_an_error() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
        for whole in [jpeg(), lossless(image::ImageFormat::Png), lossless(image::ImageFormat::Bmp)] {
            for _ in 0..3_000 {
                let mut bytes = whole.clone();
                for _ in 0..random.random_range(1..6) {
                    let at = random.random_range(0..bytes.len());
                    bytes[at] = random.random();
                }
                if let Ok(decoded) = decode(&bytes) {
                    assert_eq!(decoded.pixels.len(), decoded.width * decoded.height);
                }
                let _ = FrameInfo::read(&bytes).true_time_s();
            }
        }
    }

    #[test]
    fn huge_and_foreign_files_are_refused_by_their_headers() {
        let mut huge = lossless(image::ImageFormat::Bmp);
        huge[18..22].copy_from_slice(&15_000_i32.to_le_bytes());
        huge[22..26].copy_from_slice(&15_000_i32.to_le_bytes());
        assert_eq!(decode(&huge), Err(DecodeError::TooLarge { width: 15_000, height: 15_000 }));
        assert_eq!(decode(b"II\x2a\x00\x10\x00\x00\x00CR\x02\x00"), Err(DecodeError::Raw));
        for foreign in [&b""[..], b"GIF89a....", b"hello"] {
            assert!(matches!(decode(foreign), Err(DecodeError::UnknownFormat { .. })));
        }
    }
}
