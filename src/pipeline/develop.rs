//! Bracket to radiance: decode, response, merge (paper 3.3).

use super::calibration::response::ResponseCalibration;
use super::decode::{DecodeError, Format, decode_into};
use super::fine::{Unread, fine_levels};
use crate::numerics::image::{Image, RadianceImage};
use crate::numerics::radiometry::bracket::{Bracket, BracketError, Exposure, MANY};
use crate::numerics::radiometry::merge::merge;
use crate::numerics::radiometry::noise::SensorNoise;
use crate::numerics::radiometry::response::{Response, recover};
use crate::numerics::radiometry::times::{MeasuredTime, MeasuredTimes};
use rayon::prelude::*;

/// A frame of a bracket.
#[derive(Clone, Copy, Debug)]
pub struct BracketFrame<'a> {
    /// Name for messages.
    pub name: &'a str,
    /// The file as the camera wrote it.
    pub bytes: &'a [u8],
    /// The time the shutter is expected to have been open, seconds.
    pub time_s: f64,
}

/// A rectangle of pixels kept; the rest of the frame is dropped right after decoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// Left column.
    pub x: usize,
    /// Top row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// A developed bracket.
#[derive(Clone, Debug)]
pub struct Developed {
    /// Radiance, variance and validity of the crop.
    pub image: RadianceImage,
    /// What was used, for the brackets that follow.
    pub known: Known,
    /// Names of the frames, shortest first, with the times measured on them; no standard error where they tell nothing.
    pub times: Vec<(String, MeasuredTime)>,
}

/// What one bracket tells about the next ones of the same exposures.
#[derive(Clone, Debug)]
pub struct Known {
    /// The response.
    pub response: Response,
    /// Relative standard error of the exponent that it and the times have in common.
    pub exponent_sigma: f64,
    /// Times that were expected, seconds, shortest first: an exposure is known by them.
    pub expected_s: Vec<f64>,
    /// Measured times, seconds, in the same order.
    pub times_s: Vec<f64>,
    /// The exposure that keeps its time: one reference for all lights.
    pub reference: usize,
}

impl Known {
    /// What a calibration tells of a bracket of these expected times (seconds, any order): its response, and its times where it has
    /// measured them.
    ///
    /// # Errors
    /// A response that is none.
    pub fn of(calibration: &ResponseCalibration, expected_s: &[f64]) -> Result<Self, String> {
        let near = |t: f64| calibration.exposures.iter().find(|e| (e.nominal_s / t).ln().abs() < SAME_TIME);
        let mut frames: Vec<(f64, bool, f64)> = expected_s
            .iter()
            .map(|&t| near(t).map_or((t, false, t), |e| (e.estimated_s, e.name == calibration.reference, t)))
            .collect();
        frames.sort_by(|a, b| a.0.total_cmp(&b.0));
        let from_one_second = |i: &usize| frames[*i].0.ln().abs();
        let nearest = (0..frames.len()).min_by(|a, b| from_one_second(a).total_cmp(&from_one_second(b)));
        Ok(Self {
            response: calibration.response()?,
            exponent_sigma: calibration.exponent_sigma,
            reference: frames.iter().position(|(_, reference, _)| *reference).or(nearest).unwrap_or(0),
            expected_s: frames.iter().map(|(_, _, expected)| *expected).collect(),
            times_s: frames.into_iter().map(|(time_s, ..)| time_s).collect(),
        })
    }

    /// Which of its exposures is expected to take this time, seconds.
    ///
    /// # Errors
    /// None is.
    pub fn exposure(&self, expected_s: f64) -> Result<usize, DevelopError> {
        let same = |known: &f64| (known / expected_s).ln().abs() < SAME_TIME;
        self.expected_s.iter().position(same).ok_or_else(|| {
            DevelopError::Bracket(format!("an exposure of {expected_s:.4} s is none of those the first bracket had"))
        })
    }

    /// What it tells of a bracket that has these of its exposures alone (seconds, shortest first). Where the reference is not among them,
    /// the one nearest to it keeps its measured time.
    fn of_part(&self, expected_s: &[f64]) -> Result<Self, DevelopError> {
        let exposures = expected_s.iter().map(|&t| self.exposure(t)).collect::<Result<Vec<_>, _>>()?;
        let from_reference = |&i: &usize| (self.times_s[exposures[i]] / self.times_s[self.reference]).ln().abs();
        let nearest = (0..exposures.len()).min_by(|a, b| from_reference(a).total_cmp(&from_reference(b))).unwrap_or(0);
        Ok(Self {
            response: self.response.clone(),
            exponent_sigma: self.exponent_sigma,
            expected_s: expected_s.to_vec(),
            times_s: exposures.iter().map(|&i| self.times_s[i]).collect(),
            reference: nearest,
        })
    }
}

/// Times that differ by less than this, in natural logarithms, are the same third of a stop.
const SAME_TIME: f64 = 0.1;

/// Why a bracket cannot be developed.
#[derive(Clone, Debug, thiserror::Error)]
pub enum DevelopError {
    /// A frame cannot be decoded or has the wrong size.
    #[error("frame {name}: {reason}")]
    Frame {
        /// The frame.
        name: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// The bracket as a whole is unusable.
    #[error("{0}")]
    Bracket(String),
}

impl From<BracketError> for DevelopError {
    fn from(error: BracketError) -> Self {
        Self::Bracket(error.to_string())
    }
}

/// Develops one bracket; `crop` is in full-frame pixels. Response and times are measured on this bracket when nothing is `known`;
/// otherwise the response is taken over and the times are measured through it, held to the reference and, where a frame tells
/// little, to the known ones. Then the bracket may have some of the known exposures only.
pub fn develop(
    frames: &[BracketFrame<'_>],
    crop: Option<Crop>,
    known: Option<&Known>,
    noise: &SensorNoise,
) -> Result<Developed, DevelopError> {
    let bracket = read_bracket(frames, crop)?;
    let expected_s = bracket.times_s();
    let known = known.map(|known| known.of_part(&expected_s)).transpose()?;
    let (expected, measured) = match &known {
        Some(Known { response, exponent_sigma, times_s, reference, .. }) => {
            bracket.check_times()?;
            let curve = (response, *exponent_sigma);
            (times_s.clone(), MeasuredTimes::with_response(&bracket, times_s, curve, Some(*reference)))
        }
        None => (expected_s.clone(), MeasuredTimes::without_response(&bracket, &expected_s)),
    };
    let measured = match measured {
        // Frames that share too few pixels, as of a lamp behind the object, keep the times they were expected to have.
        Err(BracketError::TooFewOverlap { .. }) => MeasuredTimes::as_expected(&expected),
        other => other?,
    };
    let names: Vec<String> = bracket.exposures().iter().map(|frame| frame.name.clone()).collect();
    let bracket = bracket.with_times(&measured.seconds())?;
    let response = match known {
        Some(known) => known.response,
        None => recover(&bracket)?.response,
    };
    Ok(Developed {
        image: merge(&bracket, &response, noise),
        times: names.into_iter().zip(measured.frames.iter().copied()).collect(),
        known: Known {
            response,
            exponent_sigma: measured.exponent_sigma,
            expected_s,
            times_s: measured.seconds(),
            reference: measured.reference,
        },
    })
}

/// Radiance of another part of frames of which response and times are known, as after [`develop`]; `crop` is in full-frame pixels.
///
/// # Errors
/// A frame cannot be decoded or does not hold the part, or there are more or fewer frames than times.
pub fn radiance(
    frames: &[BracketFrame<'_>],
    crop: Crop,
    known: &Known,
    noise: &SensorNoise,
) -> Result<RadianceImage, DevelopError> {
    let mut frames = frames.to_vec();
    frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let bracket = read_rounded(&frames, Some(crop))?.with_times(&known.times_s)?;
    Ok(merge(&bracket, &known.response, noise))
}

/// Full frames in memory at a time.
const DECODED_AT_A_TIME: usize = 2;

/// Decodes the frames, two full frames in memory at a time, and keeps the crop of each; and what their files say of some pixels
/// beyond whole levels.
pub fn read_bracket(frames: &[BracketFrame<'_>], crop: Option<Crop>) -> Result<Bracket, DevelopError> {
    let mut frames = frames.to_vec();
    frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let bracket = read_rounded(&frames, crop)?;
    let (left, top) = crop.map_or((0, 0), |crop| (crop.x, crop.y));
    let points: Vec<_> = bracket.sample_points(MANY).into_iter().map(|(x, y)| (x + left, y + top)).collect();
    let fine = frames.par_iter().map(|frame| levels_at(frame, &points)).collect::<Result<Vec<_>, _>>()?;
    Ok(match fine.into_iter().collect() {
        Some(fine) => bracket.with_fine_levels(fine),
        None => bracket,
    })
}

/// Levels of some pixels beyond whole ones; none if this kind of file does not tell.
fn levels_at(frame: &BracketFrame<'_>, points: &[(usize, usize)]) -> Result<Option<Vec<[f32; 3]>>, DevelopError> {
    match fine_levels(frame.bytes, points) {
        Ok(levels) => Ok(Some(levels)),
        Err(Unread::Unsuited) => Ok(None),
        Err(Unread::Damaged) => Err(DevelopError::Frame {
            name: frame.name.to_owned(),
            reason: DecodeError::Damaged { format: "JPEG", reason: Unread::Damaged.to_string() }.to_string(),
        }),
    }
}

fn read_rounded(frames: &[BracketFrame<'_>], crop: Option<Crop>) -> Result<Bracket, DevelopError> {
    let lossy = frames.iter().any(|frame| Format::of(frame.bytes) == Ok(Format::Jpeg));
    let mut memory: [Image<[u8; 3]>; DECODED_AT_A_TIME] = std::array::from_fn(|_| Image::filled(0, 0, [0; 3]));
    let mut exposures = Vec::with_capacity(frames.len());
    for some in frames.chunks(DECODED_AT_A_TIME) {
        let read: Vec<_> =
            some.par_iter().zip(&mut memory).map(|(frame, picture)| read_frame(frame, crop, picture)).collect();
        for exposure in read {
            exposures.push(exposure?);
        }
    }
    Ok(Bracket::new(exposures, if lossy { JPEG_VARIANCE } else { LOSSLESS_VARIANCE })?)
}

/// Decodes a frame into `picture`, which is there for the next one unless all of it is kept.
fn read_frame(
    frame: &BracketFrame<'_>,
    crop: Option<Crop>,
    picture: &mut Image<[u8; 3]>,
) -> Result<Exposure, DevelopError> {
    let unusable = |reason: String| DevelopError::Frame { name: frame.name.to_owned(), reason };
    decode_into(frame.bytes, picture).map_err(|e| unusable(e.to_string()))?;
    let levels = match crop {
        Some(crop) => cut(picture, crop).map_err(unusable)?,
        None => std::mem::replace(picture, Image::filled(0, 0, [0; 3])),
    };
    Ok(Exposure { name: frame.name.to_owned(), levels, time_s: frame.time_s })
}

/// Variance of rounding to a whole level, levels squared.
const LOSSLESS_VARIANCE: [f64; 3] = [1.0 / 12.0; 3];
/// What a JPEG of the finest setting (4:4:4) adds to red, green and blue, levels squared: rounding to YCbCr, of the cosine
/// coefficients and back to a level. Measured on the simulated camera's files at a noise of 0.8 levels (`sim::camera::exif`).
pub(crate) const JPEG_VARIANCE: [f64; 3] = [0.9, 0.5, 1.2];

pub(super) fn cut(picture: &Image<[u8; 3]>, crop: Crop) -> Result<Image<[u8; 3]>, String> {
    let inside =
        |start: usize, size: usize, full: usize| size > 0 && start.checked_add(size).is_some_and(|end| end <= full);
    if !inside(crop.x, crop.width, picture.width) || !inside(crop.y, crop.height, picture.height) {
        return Err(format!(
            "it is {}x{} pixels, the crop {}x{} at ({}, {}) does not lie inside: check the camera's size in the rig file",
            picture.width, picture.height, crop.width, crop.height, crop.x, crop.y
        ));
    }
    let rows = picture.pixels.chunks_exact(picture.width).skip(crop.y).take(crop.height);
    let pixels = rows.flat_map(|row| row[crop.x..crop.x + crop.width].iter().copied()).collect();
    Ok(Image { width: crop.width, height: crop.height, pixels })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// A PNG of 6x4 pixels whose level is 10 x column + row.
    fn png() -> Vec<u8> {
        let pixels: Vec<u8> = (0..24_u8).flat_map(|i| [10 * (i % 6) + i / 6; 3]).collect();
        let mut bytes = std::io::Cursor::new(Vec::new());
        let format = image::ImageFormat::Png;
        image::write_buffer_with_format(&mut bytes, &pixels, 6, 4, image::ExtendedColorType::Rgb8, format).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn the_crop_is_cut_from_the_full_frame() {
        let bytes = png();
        let frame = [BracketFrame { name: "a", bytes: &bytes, time_s: 1.0 }];
        let crop = Crop { x: 2, y: 1, width: 3, height: 2 };
        let bracket = read_bracket(&frame, Some(crop)).unwrap();
        let levels: Vec<u8> = bracket.exposures()[0].levels.pixels.iter().map(|p| p[1]).collect();
        assert_eq!(levels, [21, 31, 41, 22, 32, 42]);
    }

    #[test]
    fn a_crop_outside_the_frame_is_refused_by_name() {
        let bytes = png();
        let frame = [BracketFrame { name: "a.png", bytes: &bytes, time_s: 1.0 }];
        let whole = Crop { x: 0, y: 0, width: 6, height: 4 };
        for crop in [
            Crop { x: 1, ..whole },
            Crop { height: 5, ..whole },
            Crop { width: 0, ..whole },
            Crop { x: usize::MAX, ..whole },
        ] {
            let message = read_bracket(&frame, Some(crop)).unwrap_err().to_string();
            assert!(message.contains("a.png") && message.contains("6x4"), "{message}");
        }
        assert!(read_bracket(&frame, Some(whole)).is_ok());
    }

    #[test]
    fn a_broken_frame_is_refused_by_name() {
        let frame = [BracketFrame { name: "b.jpg", bytes: b"\xff\xd8\xff\xe0", time_s: 1.0 }];
        let message = read_bracket(&frame, None).unwrap_err().to_string();
        assert!(message.contains("b.jpg") && message.contains("again"), "{message}");
    }
}
