//! Canon CR2 files to a bracket of raw frames with measured times: decode, black level, exposure ratios.
//!
//! Frames are read one after the other; of each only the lit photosites stay in memory. An orientation is never
//! applied: the rig's geometry is the sensor's.

pub mod bodies;
pub mod container;
mod unpack;

use super::calibration::doubts::{doubtful_times, wide_scatter};
use super::calibration::response::{CalibrateError, Expected, ExposureTime, exposure_times, nearest};
use super::decode::power_of_two_s;
use super::develop::DevelopError;
use crate::numerics::image::Image;
use crate::numerics::radiometry::mosaic::black::{Black, Masked};
use crate::numerics::radiometry::mosaic::{Converter, RawBracket, RawFrame};
use crate::numerics::radiometry::times::MeasuredTimes;
use bodies::{Body, bodies};
use container::Container;

/// Why bytes are no usable raw frame.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RawError {
    /// The feature is not there.
    #[error(
        "a Canon raw file, and this rigd was built without raw files: build it with \
         `cargo build --release --features raw`"
    )]
    NotBuilt,
    /// Another kind of file.
    #[error("it is no Canon raw file (CR2): give the file as the camera wrote it")]
    NotCr2,
    /// A body without facts.
    #[error("raw files of {model:?} are not known, only those of {}: shoot JPEG with it", known())]
    UnknownBody {
        /// Model as the file says.
        model: String,
    },
    /// The file does not say how it was taken.
    #[error("its EXIF states no ISO speed: give the file as the camera wrote it")]
    NoIso,
    /// The file is damaged.
    #[error("the CR2 file is damaged or cut short ({0}): fetch it from the camera again")]
    Damaged(&'static str),
}

fn known() -> String {
    bodies().iter().map(|body| body.model.as_str()).collect::<Vec<_>>().join(", ")
}

/// A raw file decoded.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// Counts of the lit photosites, red at the top left; even width and height.
    pub counts: Image<u16>,
    /// What the masked photosites say.
    pub black: Black,
    /// The body.
    pub body: &'static Body,
    /// ISO speed.
    pub iso: u32,
}

/// Decodes a CR2 file. Any bytes give a frame or a typed error.
///
/// # Errors
/// The file is damaged, of an unknown body, or raw files are not built in.
pub fn decode(bytes: &[u8]) -> Result<Decoded, RawError> {
    let container = Container::open(bytes)?;
    let model = &container.model;
    let body = Body::of(model).ok_or_else(|| RawError::UnknownBody { model: model.clone() })?;
    let iso = container.info.iso.filter(|iso| *iso > 0).ok_or(RawError::NoIso)?;
    let mut counts = unpack::unpack(&container, body)?;
    if counts.pixels.iter().any(|count| count >> body.bits != 0) {
        return Err(RawError::Damaged("it holds counts that the sensor's converter does not have"));
    }
    if counts.width < body.left + 2 || counts.height < body.top + 2 {
        return Err(RawError::Damaged("it is smaller than the masked border"));
    }
    let black = black(&counts, body).ok_or(RawError::Damaged("its masked border is too small to tell black"))?;
    if black.level.iter().any(|level| *level > BRIGHTEST_BLACK * body.white.value) {
        return Err(RawError::Damaged("its masked border is not dark"));
    }
    crop(&mut counts, body);
    Ok(Decoded { counts, black, body, iso })
}

/// Black levels above this share of white are none.
const BRIGHTEST_BLACK: f64 = 0.25;

fn black(counts: &Image<u16>, body: &Body) -> Option<Black> {
    let mut masked = Masked::none(u16::MAX >> (u16::BITS - body.bits));
    let (columns, rows) = (body.masked_columns, body.masked_rows);
    for (y, row) in counts.pixels.chunks_exact(counts.width).enumerate().skip(rows.0) {
        let end = if y < rows.1 { counts.width } else { columns.1 };
        (columns.0..end).for_each(|x| masked.add(x, y, row[x]));
    }
    masked.black()
}

/// Cuts the lit photosites out, in the memory that is there.
fn crop(counts: &mut Image<u16>, body: &Body) {
    let even = |lit: usize, most: usize| lit.min(most) / 2 * 2;
    let width = even(counts.width - body.left, body.width);
    let height = even(counts.height - body.top, body.height);
    for row in 0..height {
        let from = (body.top + row) * counts.width + body.left;
        counts.pixels.copy_within(from..from + width, row * width);
    }
    counts.pixels.truncate(width * height);
    counts.pixels.shrink_to_fit();
    (counts.width, counts.height) = (width, height);
}

/// Raw frames of one body at one ISO speed, read one after the other.
#[derive(Clone, Debug, Default)]
pub struct RawFolder {
    frames: Vec<RawFrame>,
    /// Of the first frame: all others must have the same.
    shot: Option<(&'static Body, u32)>,
}

impl RawFolder {
    /// Decodes the file of a frame and keeps its lit photosites.
    ///
    /// # Errors
    /// The file is unusable, or of another body or ISO speed than the first; it is named.
    pub fn add(&mut self, name: &str, bytes: &[u8], time_s: f64) -> Result<(), DevelopError> {
        let unusable = |reason: String| DevelopError::Frame { name: name.to_owned(), reason };
        let Decoded { counts, black, body, iso } = decode(bytes).map_err(|e| unusable(e.to_string()))?;
        let (first, first_iso) = *self.shot.get_or_insert((body, iso));
        if (first.model.as_str(), first_iso) != (body.model.as_str(), iso) {
            return Err(unusable(format!(
                "it is of {} at ISO {iso}, the first frame of {} at ISO {first_iso}: give frames of one body and one \
                 ISO speed",
                body.model, first.model
            )));
        }
        self.frames.push(RawFrame { name: name.to_owned(), counts, black, time_s });
        Ok(())
    }

    /// The frames as a bracket, its times as given.
    ///
    /// # Errors
    /// They are no bracket: none, or of different sizes.
    pub fn bracket(self) -> Result<RawShot, DevelopError> {
        let none = || DevelopError::Bracket("no raw frame: give a folder of CR2 files".to_owned());
        let (body, iso) = self.shot.ok_or_else(none)?;
        let converter = Converter { white: body.white.value as u16, full_well_e: body.full_well_at(iso) };
        Ok(RawShot { bracket: RawBracket::new(self.frames, converter)?, body, iso })
    }
}

/// A raw bracket and what it was shot with.
#[derive(Clone, Debug)]
pub struct RawShot {
    /// The frames.
    pub bracket: RawBracket,
    /// The body.
    pub body: &'static Body,
    /// ISO speed.
    pub iso: u32,
}

/// The times of a raw bracket.
#[derive(Clone, Debug)]
pub struct RawTimes {
    /// Every frame's times, shortest first.
    pub exposures: Vec<ExposureTime>,
    /// The frame whose time is taken as expected: images tell ratios only.
    pub reference: String,
    /// What the times were expected to be before the images were asked.
    pub expected: Expected,
    /// What the operator ought to know, each with the frame and the remedy.
    pub warnings: Vec<String>,
}

/// Measures the times of raw frames, which were the nominal ones, and gives the frames theirs. Linear frames leave no
/// exponent open.
///
/// # Errors
/// The frames do not overlap, or contradict their times.
pub fn measure(bracket: RawBracket) -> Result<(RawBracket, RawTimes), CalibrateError> {
    let (samples, noise) = (bracket.linear_samples(), bracket.noise());
    let nominal = bracket.times_s();
    let names: Vec<String> = bracket.frames().iter().map(|frame| frame.name.clone()).collect();
    let thirds: Option<Vec<f64>> = nominal.iter().map(|&t| power_of_two_s(t)).collect();
    let next_to = |expected: &[f64]| MeasuredTimes::linear(&samples, expected, &noise, None);
    let (expected, measured) = nearest(&nominal, thirds.as_deref(), false, next_to)?;
    let exposures = exposure_times(&names, &nominal, &measured)?;
    let mut warnings = doubtful_times(&exposures);
    warnings.extend(wide_scatter(&measured));
    let reference = names[measured.reference].clone();
    Ok((bracket.with_times(&measured.seconds())?, RawTimes { exposures, reference, expected, warnings }))
}
