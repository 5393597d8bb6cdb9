//! The outer half of a CR2 file: a TIFF whose last directory holds the sensor's counts as one lossless JPEG.
//!
//! What is needed of it is found here and nothing else is handed on: MakerNote and nested directories of a damaged file
//! never reach the decoder of the counts.

use super::RawError;
use crate::pipeline::contain::contained;
use crate::pipeline::decode::{FrameInfo, MAX_PIXELS};
use exif::{Context, Exif, In, Tag};
use std::io::Cursor;

/// Marks the directory of the counts.
const RAW_DIRECTORY: Tag = Tag(Context::Tiff, 0xc5d8);
/// Widths of the vertical slices the counts are stored in: how many of the first width, that width, the last one's.
const SLICES: Tag = Tag(Context::Tiff, 0xc640);

/// A CR2 file looked into.
#[derive(Clone, Debug)]
pub struct Container<'a> {
    /// What its EXIF says of the shot.
    pub info: FrameInfo,
    /// Model of the body.
    pub model: String,
    /// The lossless JPEG.
    pub jpeg: &'a [u8],
    /// Slices; none if the counts are stored in one piece.
    pub slices: Option<[u16; 3]>,
}

/// True for bytes that start as a CR2 file does.
pub fn is_cr2(bytes: &[u8]) -> bool {
    matches!(bytes, [b'I', b'I', 0x2a, 0, _, _, _, _, b'C', b'R', ..])
}

impl<'a> Container<'a> {
    /// Finds what is needed in the bytes of a file.
    pub fn open(bytes: &'a [u8]) -> Result<Self, RawError> {
        if !is_cr2(bytes) {
            return Err(RawError::NotCr2);
        }
        contained(|| Self::find(bytes)).unwrap_or(Err(RawError::Damaged("its directories make no sense")))
    }

    fn find(bytes: &'a [u8]) -> Result<Self, RawError> {
        let exif = exif::Reader::new()
            .continue_on_error(true)
            .read_from_container(&mut Cursor::new(bytes))
            .or_else(|error| error.distill_partial_result(|_| ()))
            .map_err(|_| RawError::Damaged("it has no directories"))?;
        let model = text(&exif, Tag::Model).ok_or(RawError::Damaged("it names no camera model"))?;
        let directory = exif.fields().find(|field| field.tag == RAW_DIRECTORY).map(|field| field.ifd_num);
        let directory = directory.ok_or(RawError::Damaged("it has no directory of sensor counts"))?;
        let number = |tag, i| exif.get_field(tag, directory).and_then(|field| field.value.get_uint(i));
        let strip = (number(Tag::StripOffsets, 0), number(Tag::StripByteCounts, 0));
        let (Some(from), Some(length)) = strip else {
            return Err(RawError::Damaged("it does not say where the sensor counts are"));
        };
        let from = from as usize;
        let jpeg = bytes.get(from..from.saturating_add(length as usize)).ok_or(RawError::Damaged("it is cut short"))?;
        check(jpeg)?;
        let slices = [0, 1, 2].map(|i| number(SLICES, i).and_then(|width| u16::try_from(width).ok()));
        let slices = match slices {
            [Some(0) | None, ..] => None,
            [Some(count), Some(width), Some(last)] if width > 0 && last > 0 => Some([count, width, last]),
            _ => return Err(RawError::Damaged("its slices make no sense")),
        };
        Ok(Self { info: FrameInfo::of(&exif), model, jpeg, slices })
    }
}

fn text(exif: &Exif, tag: Tag) -> Option<String> {
    match &exif.get_field(tag, In::PRIMARY)?.value {
        exif::Value::Ascii(lines) => lines.first().map(|line| String::from_utf8_lossy(line).trim().to_owned()),
        _ => None,
    }
}

/// Refuses a lossless JPEG that has no end, and sizes that no sensor has before any memory is taken for them.
fn check(jpeg: &[u8]) -> Result<(), RawError> {
    // In the counts 0xff is always followed by 0; padding may follow the end.
    if !jpeg.windows(2).rev().take(64).any(|pair| pair == [0xff, 0xd9]) {
        return Err(RawError::Damaged("its sensor counts have no end"));
    }
    let [height, width, components] =
        frame_header(jpeg).ok_or(RawError::Damaged("its sensor counts have no header"))?;
    let pixels = width * height * components;
    if pixels == 0 || pixels > MAX_PIXELS {
        return Err(RawError::Damaged("its size is that of no sensor"));
    }
    Ok(())
}

/// Height, width and components of the frame header (SOF3); none before the scan begins.
fn frame_header(jpeg: &[u8]) -> Option<[usize; 3]> {
    let mut rest = jpeg.strip_prefix(&[0xff, 0xd8])?;
    loop {
        let &[0xff, marker, high, low, ..] = rest else { return None };
        let segment = rest.get(2..2 + usize::from(u16::from_be_bytes([high, low])))?;
        match (marker, segment) {
            (0xc3, &[_, _, _, h1, h0, w1, w0, components, ..]) => {
                let number = |high, low| usize::from(u16::from_be_bytes([high, low]));
                return Some([number(h1, h0), number(w1, w0), usize::from(components)]);
            }
            (0xc3 | 0xda, _) => return None,
            _ => rest = &rest[2 + segment.len()..],
        }
    }
}
