//! Tiny JPEGs with EXIF as a camera writes them.

use exif::experimental::Writer;
use exif::{Field, In, Rational, Tag, Value};
use jpeg_encoder::{ColorType, Encoder};
use rigd::devices::camera::Shot;

/// What a frame says of itself.
#[derive(Clone, Debug)]
pub struct Exif {
    pub exposure: (u32, u32),
    pub f_number: (u32, u32),
    pub iso: u16,
    pub taken: String,
    pub number: u32,
}

impl Exif {
    /// A truthful frame: the nominal label, as bodies write it.
    pub fn of(shot: &Shot, count: usize) -> Self {
        let exposure = match shot.shutter.label.split_once('/') {
            Some((n, d)) => (n.parse().unwrap(), d.parse().unwrap()),
            None => ((shot.shutter.nominal_s * 10.0).round() as u32, 10),
        };
        let f_number = ((shot.f_number * 10.0).round() as u32, 10);
        let taken = format!("2026:11:23 12:{:02}:{:02}", count / 60 % 60, count % 60);
        Self { exposure, f_number, iso: shot.iso as u16, taken, number: count as u32 + 1 }
    }
}

/// A grey JPEG whose content depends on the picture's number.
pub fn encode(size: (usize, usize), exif: Option<&Exif>) -> Vec<u8> {
    encode_at(20 + exif.map_or(0, |e| e.number % 200) as u8, size, exif)
}

/// A JPEG of one grey level.
pub fn encode_at(level: u8, size: (usize, usize), exif: Option<&Exif>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, 90);
    if let Some(exif) = exif {
        encoder.add_exif_metadata(&tiff(exif)).unwrap();
    }
    let pixels = vec![level; size.0 * size.1];
    encoder.encode(&pixels, size.0 as u16, size.1 as u16, ColorType::Luma).unwrap();
    bytes
}

fn tiff(exif: &Exif) -> Vec<u8> {
    let rational = |(num, denom)| Value::Rational(vec![Rational { num, denom }]);
    let text = |text: &str| Value::Ascii(vec![text.as_bytes().to_vec()]);
    let fields = [
        (Tag::ExposureTime, rational(exif.exposure)),
        (Tag::FNumber, rational(exif.f_number)),
        (Tag::PhotographicSensitivity, Value::Short(vec![exif.iso])),
        (Tag::DateTimeOriginal, text(&exif.taken)),
        (Tag::ImageUniqueID, text(&format!("{:032x}", exif.number))),
    ]
    .map(|(tag, value)| Field { tag, ifd_num: In::PRIMARY, value });
    let mut writer = Writer::new();
    fields.iter().for_each(|field| writer.push_field(field));
    let mut out = std::io::Cursor::new(Vec::new());
    writer.write(&mut out, false).unwrap();
    out.into_inner()
}
