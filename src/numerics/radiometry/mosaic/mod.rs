//! A bracket of raw frames: linear counts behind a Bayer pattern, red at the top left.

pub mod black;
pub mod merge;

use super::bracket::BracketError;
use super::noise::SensorNoise;
use super::times::LinearSamples;
use crate::numerics::image::Image;
use black::Black;

/// Places of the pattern: red, green beside red, green beside blue, blue; place of a photosite is 2 (row % 2) + column
/// % 2.
pub const PLACES: usize = 4;

/// One raw frame.
#[derive(Clone, Debug)]
pub struct RawFrame {
    /// Name for messages.
    pub name: String,
    /// Counts of the lit photosites as converted; even width and height, red at the top left.
    pub counts: Image<u16>,
    /// What the frame's masked photosites say.
    pub black: Black,
    /// The time the shutter was open, seconds.
    pub time_s: f64,
}

/// What turns counts into light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Converter {
    /// Counts at which a photosite saturates.
    pub white: u16,
    /// Charge at that count, electrons, at the ISO speed of the frames.
    pub full_well_e: f64,
}

/// Frames of one scene, one size, one ISO speed, from the shortest to the longest exposure.
#[derive(Clone, Debug)]
pub struct RawBracket {
    frames: Vec<RawFrame>,
    converter: Converter,
}

/// Share of the way from black to white from which a sample is clipped: sensors bend before they saturate, and not all
/// photosites saturate at one count.
const CLIPPED: f64 = 0.985;
/// Cells of two by two photosites that ratios are measured on, at most: with four places as many samples as of 8-bit
/// frames.
const MOST_CELLS: usize = 40_000;

impl RawBracket {
    /// Checks and orders `frames`.
    ///
    /// # Errors
    /// No frame, different sizes, or a time no shutter has.
    pub fn new(mut frames: Vec<RawFrame>, converter: Converter) -> Result<Self, BracketError> {
        let Some(first) = frames.first() else {
            return Err(BracketError::TooFewFrames { found: 0, needed: 1 });
        };
        for frame in &frames {
            if !(frame.time_s.is_finite() && frame.time_s > 0.0) {
                return Err(BracketError::BadTime { name: frame.name.clone(), time_s: frame.time_s });
            }
            let size = |frame: &RawFrame| (frame.counts.width, frame.counts.height);
            if size(frame) != size(first) {
                return Err(BracketError::SizeDiffers {
                    name: frame.name.clone(),
                    width: frame.counts.width,
                    height: frame.counts.height,
                    first: first.name.clone(),
                    first_width: first.counts.width,
                    first_height: first.counts.height,
                });
            }
        }
        frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(Self { frames, converter })
    }

    /// The frames, shortest exposure first; at least one.
    pub fn frames(&self) -> &[RawFrame] {
        &self.frames
    }

    /// Columns of cells: half those of the mosaic.
    pub fn width(&self) -> usize {
        self.frames[0].counts.width / 2
    }

    /// Rows of cells.
    pub fn height(&self) -> usize {
        self.frames[0].counts.height / 2
    }

    /// The times of the frames, seconds, shortest first.
    pub fn times_s(&self) -> Vec<f64> {
        self.frames.iter().map(|frame| frame.time_s).collect()
    }

    /// The same frames with other times (seconds, in the order of the frames, one each).
    ///
    /// # Errors
    /// Another number of times than frames, or a time no shutter has.
    pub fn with_times(mut self, times_s: &[f64]) -> Result<Self, BracketError> {
        if times_s.len() != self.frames.len() {
            return Err(BracketError::TooFewFrames { found: self.frames.len(), needed: times_s.len() });
        }
        self.frames.iter_mut().zip(times_s).for_each(|(frame, &time_s)| frame.time_s = time_s);
        Self::new(self.frames, self.converter)
    }

    /// Charge at saturation and read noise, the latter as the masked photosites of all frames show it.
    pub fn noise(&self) -> SensorNoise {
        let squares: f64 = self.frames.iter().map(|frame| frame.black.noise.powi(2)).sum();
        let counts = (squares / self.frames.len() as f64).sqrt();
        SensorNoise { full_well_e: self.converter.full_well_e, read_noise_e: counts * self.electrons_per_count() }
    }

    /// Counts from black to white. One number for all frames: the black level drifts, the converter's gain does not.
    fn range(&self) -> f64 {
        let blacks = self.frames.iter().flat_map(|frame| frame.black.level).sum::<f64>();
        f64::from(self.converter.white) - blacks / (PLACES * self.frames.len()) as f64
    }

    fn electrons_per_count(&self) -> f64 {
        self.converter.full_well_e / self.range()
    }

    fn signal(&self, frame: &RawFrame) -> Signal {
        let lowest = frame.black.level.iter().copied().fold(f64::INFINITY, f64::min);
        Signal {
            black: frame.black.level.map(|black| black as f32),
            per_count: (1.0 / self.range()) as f32,
            clipped: (lowest + CLIPPED * (f64::from(self.converter.white) - lowest)) as u16,
        }
    }

    /// Samples of cells on a regular grid, one channel a place.
    pub fn linear_samples(&self) -> LinearSamples {
        let cells = (self.width() * self.height()) as f64;
        let stride = (cells / MOST_CELLS as f64).sqrt().ceil().max(1.0) as usize;
        let grid = || {
            let rows = (0..self.height()).step_by(stride);
            rows.flat_map(|row| (0..self.width()).step_by(stride).map(move |column| (2 * column, 2 * row)))
        };
        let sample = |frame: &RawFrame, place: usize, (x, y): (usize, usize)| {
            let (x, y) = (x + place % 2, y + place / 2);
            let signal = self.signal(frame);
            if signal.clipped_near(frame, x, y) { f32::INFINITY } else { signal.at(*frame.counts.at(x, y), place) }
        };
        let of_frame = |place: usize| {
            let samples = |frame: &RawFrame| grid().map(|cell| sample(frame, place, cell)).collect();
            self.frames.iter().map(samples).collect()
        };
        LinearSamples { signals: (0..PLACES).map(of_frame).collect() }
    }
}

/// From counts to signals: 0 at black, 1 at white.
#[derive(Clone, Copy, Debug)]
struct Signal {
    black: [f32; PLACES],
    per_count: f32,
    /// From this count on a sample is clipped.
    clipped: u16,
}

impl Signal {
    fn at(&self, count: u16, place: usize) -> f32 {
        (f32::from(count) - self.black[place]) * self.per_count
    }

    /// Whether the sample or one of its eight neighbours is clipped.
    fn clipped_near(&self, frame: &RawFrame, x: usize, y: usize) -> bool {
        let around = |at: usize, size: usize| at.saturating_sub(1)..(at + 2).min(size);
        let (columns, rows) = (around(x, frame.counts.width), around(y, frame.counts.height));
        rows.clone().any(|row| columns.clone().any(|column| *frame.counts.at(column, row) >= self.clipped))
    }
}
