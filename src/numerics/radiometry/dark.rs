//! Dark frames: what the sensor shows without light, and the pixels that are not to be trusted.

use super::bracket::Bracket;
use super::noise::SensorNoise;
use super::response::{LEVELS, Response, slope};
use crate::numerics::image::{Image, RadianceImage};

/// A pixel this many levels above its neighbours is hot, however quiet the frame is; a glow of amplifiers is not, for it is
/// smooth.
const HOT_LEVELS: f64 = 10.0;
/// A pixel this many standard deviations (from the median deviation of the frame) above them is hot, if that is more.
const HOT_SIGMAS: f64 = 6.0;
/// Standard deviations in a median absolute deviation of a normal distribution.
const SIGMAS_PER_DEVIATION: f64 = 1.4826;

/// The dark signal, found from dark frames.
#[derive(Clone, Debug)]
pub struct Dark {
    /// Dark signal above the median of the frame, in the unit of radiance: the camera itself takes the common part off.
    rate: Image<[f32; 3]>,
    /// Its variance.
    variance: Image<[f32; 3]>,
    /// Pixels that are too bright to be corrected.
    hot: Image<bool>,
}

impl Dark {
    /// From frames taken in the dark, one or more, with the ISO and, best, the longest times of the bracket.
    pub fn new(frames: &Bracket, response: &Response, noise: &SensorNoise) -> Self {
        let (width, height) = (frames.width(), frames.height());
        let mut dark = Self {
            rate: Image::filled(width, height, [0.0; 3]),
            variance: Image::filled(width, height, [0.0; 3]),
            hot: Image::filled(width, height, false),
        };
        let total_s: f64 = frames.exposures().iter().map(|frame| frame.time_s).sum();
        for frame in frames.exposures() {
            for c in 0..3 {
                let (median, deviation) = median_level(&frame.levels, c);
                let above = HOT_LEVELS.max(HOT_SIGMAS * SIGMAS_PER_DEVIATION * deviation);
                let curve = &response.log_exposure[c];
                let pedestal = curve[median as usize].exp();
                let terms: [(f64, f64); LEVELS] = std::array::from_fn(|z| {
                    let exposure = curve[z].exp();
                    let stored = exposure * slope(curve, z as f64);
                    let variance = noise.exposure_variance(exposure, curve[LEVELS - 1].exp())
                        + frames.level_variance()[c] * stored * stored;
                    ((exposure - pedestal) / total_s, variance / (total_s * total_s))
                });
                for (i, pixel) in frame.levels.pixels.iter().enumerate() {
                    let (rate, variance) = terms[usize::from(pixel[c])];
                    dark.rate.pixels[i][c] += rate as f32;
                    dark.variance.pixels[i][c] += variance as f32;
                    let level = f64::from(pixel[c]);
                    dark.hot.pixels[i] |= level > median + above && level > neighbours(&frame.levels, i, c) + above;
                }
            }
        }
        dark
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.hot.width, self.hot.height)
    }

    /// Hot pixels.
    pub fn hot_pixels(&self) -> usize {
        self.hot.pixels.iter().filter(|hot| **hot).count()
    }

    /// Takes the dark signal off rows `first_row` onwards. Hot pixels, and those with nothing left, become invalid.
    pub fn subtract(&self, first_row: usize, strip: &mut RadianceImage) {
        let from = first_row * self.hot.width;
        for i in 0..strip.radiance.pixels.len().min(self.hot.pixels.len().saturating_sub(from)) {
            for c in 0..3 {
                let left = strip.radiance.pixels[i][c] - self.rate.pixels[from + i][c];
                strip.valid.pixels[i] &= left > 0.0;
                strip.radiance.pixels[i][c] = left.max(0.0);
                if let Some(variance) = &mut strip.variance {
                    variance.pixels[i][c] += self.variance.pixels[from + i][c];
                }
            }
            strip.valid.pixels[i] &= !self.hot.pixels[from + i];
        }
    }
}

/// Median level of a channel, and the median absolute deviation from it.
fn median_level(levels: &Image<[u8; 3]>, c: usize) -> (f64, f64) {
    let mut counts = [0_usize; LEVELS];
    levels.pixels.iter().for_each(|pixel| counts[usize::from(pixel[c])] += 1);
    let half = levels.pixels.len() / 2;
    let level = |counts: &[usize; LEVELS]| {
        let mut below = 0;
        counts
            .iter()
            .take_while(|&&count| {
                below += count;
                below <= half
            })
            .count()
    };
    let median = level(&counts);
    let mut deviations = [0; LEVELS];
    counts.iter().enumerate().for_each(|(z, &count)| deviations[z.abs_diff(median)] += count);
    (median as f64, level(&deviations) as f64)
}

/// Median level of the pixels around one, itself left out.
fn neighbours(levels: &Image<[u8; 3]>, pixel: usize, c: usize) -> f64 {
    let (x, y) = (pixel % levels.width, pixel / levels.width);
    let around = |at: usize, size: usize| at.saturating_sub(1)..(at + 2).min(size);
    let mut found: Vec<u8> = around(y, levels.height)
        .flat_map(|row| around(x, levels.width).map(move |column| row * levels.width + column))
        .filter(|&i| i != pixel)
        .map(|i| levels.pixels[i][c])
        .collect();
    found.sort_unstable();
    found.get(found.len() / 2).map_or(0.0, |&level| f64::from(level))
}
