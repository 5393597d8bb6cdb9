//! Is this the frame that was asked for? A body's read-back proves nothing (it may ignore a setting without an error), so every
//! frame is judged by what it says of itself: a whole JPEG of the rig's size, the exposure in its EXIF, and not the last frame again.

use super::plan::third_stop;
use crate::devices::camera::{RawFrame, Shot};
use exif::{Exif, In, Tag, Value};
use serde::{Deserialize, Serialize};
use zune_core::bytestream::ZCursor;
use zune_jpeg::JpegDecoder;

/// The end marker must lie this close to the end of the file, bytes: bodies pad, but a cut file has none.
const END_WITHIN: usize = 4096;

/// What tells one frame from another.
#[derive(Clone, Debug, PartialEq)]
pub struct Fingerprint {
    /// blake3 of the file.
    pub blake3: String,
    /// DateTimeOriginal with sub-seconds, in EXIF's sortable spelling.
    pub taken: Option<String>,
    /// The camera's number of the picture, if it writes one.
    pub number: Option<String>,
}

impl Fingerprint {
    /// Of any bytes a camera delivered, good or not.
    pub fn of(frame: &RawFrame) -> Self {
        let exif = read_exif(&frame.bytes).ok();
        let blake3 = blake3::hash(&frame.bytes).to_hex().to_string();
        let text = |tag| exif.as_ref().and_then(|e| text(e, tag));
        let taken = text(Tag::DateTimeOriginal).map(|seconds| match text(Tag::SubSecTimeOriginal) {
            Some(fraction) => format!("{seconds}.{fraction}"),
            None => seconds,
        });
        let number = text(Tag::ImageUniqueID).or_else(|| text(IMAGE_NUMBER));
        Self { blake3, taken, number }
    }
}

/// ImageNumber of EXIF 2.31 (0x9211), which the reader does not name.
const IMAGE_NUMBER: Tag = Tag(exif::Context::Exif, 0x9211);

/// Body and lens as a frame's EXIF names them, as far as it does: a calibration holds for these only.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Optics {
    /// Serial number of the body.
    pub body_serial: Option<String>,
    /// Focal length set on the lens, mm.
    pub focal_mm: Option<f64>,
}

impl Optics {
    /// Of a frame as the camera wrote it.
    pub fn of(bytes: &[u8]) -> Self {
        let exif = read_exif(bytes).ok();
        let exif = exif.as_ref();
        Self {
            body_serial: exif.and_then(|exif| text(exif, Tag::BodySerialNumber)),
            focal_mm: exif.and_then(|exif| number(exif, Tag::FocalLength).ok()),
        }
    }
}

/// Refuses a frame that is not what `shot` asked for, with the reason in words. `last` is the frame delivered before it.
pub fn check(
    frame: &RawFrame,
    shot: &Shot,
    size: (usize, usize),
    fingerprint: &Fingerprint,
    last: Option<&Fingerprint>,
) -> Result<(), String> {
    check_image(&frame.bytes, size)?;
    let exif = read_exif(&frame.bytes)?;
    last.map_or(Ok(()), |last| check_new(fingerprint, last))?;
    check_settings(&exif, shot)
}

fn check_image(bytes: &[u8], size: (usize, usize)) -> Result<(), String> {
    let mut decoder = JpegDecoder::new(ZCursor::new(bytes));
    decoder.decode_headers().map_err(|e| format!("it is no JPEG ({e:?}): set the camera to JPEG"))?;
    let info = decoder.info().ok_or("it is no JPEG: set the camera to JPEG")?;
    let found = (usize::from(info.width), usize::from(info.height));
    if found != size {
        let ((w, h), (rig_w, rig_h)) = (found, size);
        return Err(format!("it has {w} x {h} pixels, the rig file says {rig_w} x {rig_h}: set the image size"));
    }
    let tail = bytes.get(bytes.len().saturating_sub(END_WITHIN)..).unwrap_or_default();
    if !tail.windows(2).any(|pair| pair == [0xff, 0xd9]) {
        return Err(format!("it is cut off after {} bytes: check cable and card", bytes.len()));
    }
    Ok(())
}

fn read_exif(bytes: &[u8]) -> Result<Exif, String> {
    exif::Reader::new().read_from_container(&mut std::io::Cursor::new(bytes)).map_err(|e| {
        format!("it has no readable EXIF ({e}), so its exposure cannot be proved: let the camera write EXIF")
    })
}

fn check_settings(exif: &Exif, shot: &Shot) -> Result<(), String> {
    let time = number(exif, Tag::ExposureTime)?;
    if time <= 0.0 || third_stop(time) != third_stop(shot.shutter.true_s) {
        let asked = &shot.shutter.label;
        return Err(format!("EXIF says {time} s, {asked} was asked for: the body ignored the shutter speed"));
    }
    let f_number = number(exif, Tag::FNumber)?;
    if (f_number / shot.f_number - 1.0).abs() > 0.01 {
        return Err(format!("EXIF says f/{f_number}, f/{} was asked for: set the aperture", shot.f_number));
    }
    let iso = number(exif, Tag::PhotographicSensitivity)?;
    if iso != f64::from(shot.iso) {
        return Err(format!("EXIF says ISO {iso}, {} was asked for: set the ISO speed", shot.iso));
    }
    Ok(())
}

fn check_new(this: &Fingerprint, last: &Fingerprint) -> Result<(), String> {
    if this.blake3 == last.blake3 {
        return Err("it is the last frame again, byte for byte: switch the camera off and on".into());
    }
    if this.number.is_some() && this.number == last.number {
        let number = this.number.as_deref().unwrap_or_default();
        return Err(format!("it is picture {number} again: switch the camera off and on"));
    }
    match (&this.taken, &last.taken) {
        (Some(this), Some(last)) if this < last => Err(format!(
            "it was taken at {this}, before the last frame ({last}), a stale picture: switch the camera off and on"
        )),
        _ => Ok(()),
    }
}

fn number(exif: &Exif, tag: Tag) -> Result<f64, String> {
    let field = exif.get_field(tag, In::PRIMARY).ok_or_else(|| format!("its EXIF has no {tag}"))?;
    let value = match &field.value {
        Value::Rational(values) => values.first().map(exif::Rational::to_f64),
        value => value.get_uint(0).map(f64::from),
    };
    value.filter(|v| v.is_finite()).ok_or_else(|| format!("its EXIF {tag} is no number"))
}

fn text(exif: &Exif, tag: Tag) -> Option<String> {
    let value = &exif.get_field(tag, In::PRIMARY)?.value;
    let text = match value {
        Value::Ascii(lines) => String::from_utf8_lossy(lines.first()?).into_owned(),
        value => value.get_uint(0)?.to_string(),
    };
    (!text.trim().is_empty()).then_some(text)
}
