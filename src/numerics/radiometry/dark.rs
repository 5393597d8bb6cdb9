//! Dark frames: what the sensor shows without light, and the pixels that are not to be trusted.

use super::bracket::Bracket;
use super::noise::SensorNoise;
use super::response::{LEVELS, Response, slope};
use crate::numerics::image::{Image, RadianceImage};

/// A pixel this many levels above its neighbours is hot, however quiet the frame is; a glow of amplifiers is not, for it is
/// smooth.
const HOT_LEVELS: f64 = 10.0;
/// The same for linear samples, as a share of saturation in the longest dark frame.
const HOT_SIGNAL: f64 = 0.005;
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
                    dark.hot.pixels[i] |=
                        level > median + above && level > f64::from(neighbours(&frame.levels, i, c)) + above;
                }
            }
        }
        dark
    }

    /// From the radiance that linear frames taken in the dark show when they are merged, radiance 1 saturating in a second;
    /// `longest_s` is the longest of their times, seconds. Their black level is taken off already, so all of it is dark signal.
    pub fn of_radiance(dark: RadianceImage, longest_s: f64) -> Self {
        let RadianceImage { radiance: rate, variance, valid } = dark;
        let variance = variance.unwrap_or_else(|| Image::filled(rate.width, rate.height, [0.0; 3]));
        let mut hot = Image { pixels: vec![false; valid.pixels.len()], ..valid };
        for c in 0..3 {
            let (median, deviation) = median_rate(&rate, c);
            let above = (HOT_SIGNAL / longest_s).max(HOT_SIGMAS * SIGMAS_PER_DEVIATION * deviation) as f32;
            for i in 0..hot.pixels.len() {
                let own = rate.pixels[i][c];
                hot.pixels[i] |= own > median as f32 + above && own > neighbours(&rate, i, c) + above;
            }
        }
        Self { rate, variance, hot }
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

/// Median rate of a channel, and the median absolute deviation from it.
fn median_rate(rate: &Image<[f32; 3]>, c: usize) -> (f64, f64) {
    let middle = |mut values: Vec<f32>| {
        let half = values.len() / 2;
        if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(half, f32::total_cmp).1 }
    };
    let values: Vec<f32> = rate.pixels.iter().map(|pixel| pixel[c]).collect();
    let median = middle(values.clone());
    (f64::from(median), f64::from(middle(values.into_iter().map(|value| (value - median).abs()).collect())))
}

/// Median of the pixels around one, itself left out.
fn neighbours<T: Copy + Default + PartialOrd>(image: &Image<[T; 3]>, pixel: usize, c: usize) -> T {
    let (x, y) = (pixel % image.width, pixel / image.width);
    let around = |at: usize, size: usize| at.saturating_sub(1)..(at + 2).min(size);
    let mut found: Vec<T> = around(y, image.height)
        .flat_map(|row| around(x, image.width).map(move |column| row * image.width + column))
        .filter(|&i| i != pixel)
        .map(|i| image.pixels[i][c])
        .collect();
    found.sort_unstable_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    found.get(found.len() / 2).copied().unwrap_or_default()
}
