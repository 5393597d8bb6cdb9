//! Merges a bracket to linear radiance with a variance: inverse-variance weights (Granados 2010 / Hasinoff 2010 form).

use super::bracket::{Bracket, Exposure};
use super::noise::SensorNoise;
use super::response::{LEVELS, Response, level_of, slope};
use crate::numerics::image::{Image, RadianceImage};
use rayon::prelude::*;

/// Exposures outside those of these levels are not used: the response is known well in between.
const TRUSTED_LEVELS: (usize, usize) = (10, 245);
/// From this level on a frame counts as clipped; above [`TRUSTED_LEVELS`], so that noise does not select among good samples.
const CLIPPED_LEVEL: u8 = 252;
/// Rounds of reweighting, after the Poisson start.
const ROUNDS: usize = 3;

/// Merges `bracket` through `response`.
///
/// Weights are those of the estimate, never of the noisy sample, so that noise does not choose what is believed. A pixel is
/// valid when every channel has a sample in the trusted range; elsewhere the value is the nearest bound known, with a variance
/// as large as its square. Rows are independent: the result does not depend on the number of threads.
pub fn merge(bracket: &Bracket, response: &Response, noise: &SensorNoise) -> RadianceImage {
    let channels: [Channel; 3] =
        std::array::from_fn(|c| Channel::new(bracket, &response.log_exposure[c], noise, bracket.level_variance()[c]));
    let merged: Vec<[Estimate; 3]> = (0..bracket.height())
        .into_par_iter()
        .flat_map_iter(|y| {
            let channels = &channels;
            (0..bracket.width()).map(move |x| {
                let pixel = y * bracket.width() + x;
                std::array::from_fn(|c| channels[c].estimate(bracket.exposures(), pixel, c))
            })
        })
        .collect();
    let image = |pixels| Image { width: bracket.width(), height: bracket.height(), pixels };
    RadianceImage {
        radiance: image(merged.iter().map(|p| p.map(|e| e.radiance as f32)).collect()),
        variance: Some(image(merged.iter().map(|p| p.map(|e| e.variance as f32)).collect())),
        valid: Image {
            width: bracket.width(),
            height: bracket.height(),
            pixels: merged.iter().map(|p| p.iter().all(|e| e.valid)).collect(),
        },
    }
}

#[derive(Clone, Copy)]
struct Estimate {
    radiance: f64,
    variance: f64,
    valid: bool,
}

/// What one channel needs to merge a pixel.
struct Channel {
    /// Exposure of every level.
    exposure: Vec<f64>,
    weights: WeightTable,
    /// Time and its logarithm of every frame.
    times: Vec<(f64, f64)>,
}

impl Channel {
    fn new(bracket: &Bracket, log_exposure: &[f64], noise: &SensorNoise, level_variance: f64) -> Self {
        Self {
            exposure: log_exposure.iter().map(|g| g.exp()).collect(),
            weights: WeightTable::new(log_exposure, noise, level_variance),
            times: bracket.exposures().iter().map(|frame| (frame.time_s, frame.time_s.ln())).collect(),
        }
    }

    fn estimate(&self, frames: &[Exposure], pixel: usize, channel: usize) -> Estimate {
        // Once a frame is clipped all longer ones are too, whatever level a lossy file gives them.
        let level = |frame: &Exposure| frame.levels.pixels[pixel][channel];
        let open = frames.iter().position(|frame| level(frame) >= CLIPPED_LEVEL).unwrap_or(frames.len());
        let samples = || frames[..open].iter().map(|frame| self.exposure[usize::from(level(frame))]).zip(&self.times);
        let (charge, time) = samples().fold((0.0, 0.0), |(y, t), (exposure, (time, _))| (y + exposure, t + time));
        if time == 0.0 {
            let bound = self.exposure[usize::from(CLIPPED_LEVEL)] / self.times[0].0;
            return Estimate { radiance: bound, variance: bound * bound, valid: false };
        }
        let mut radiance = charge / time;
        let mut precision = 0.0;
        for _ in 0..ROUNDS {
            let log_radiance = radiance.ln();
            let (mut weighted, mut total) = (0.0, 0.0);
            for (exposure, (time, log_time)) in samples() {
                let inverse_variance = self.weights.inverse_variance(log_radiance + log_time);
                weighted += inverse_variance * time * exposure;
                total += inverse_variance * time * time;
            }
            precision = total;
            if total == 0.0 {
                break;
            }
            radiance = weighted / total;
        }
        if precision > 0.0 {
            Estimate { radiance, variance: 1.0 / precision, valid: true }
        } else {
            Estimate { radiance, variance: radiance * radiance, valid: false }
        }
    }
}

/// Inverse variance of an exposure as a function of its logarithm; zero outside the trusted range.
struct WeightTable {
    lowest: f64,
    bins_per_unit: f64,
    inverse_variance: Vec<f64>,
}

impl WeightTable {
    const BINS: usize = 2048;

    /// `level_variance`: what storing the frame added, levels squared; the slope of the response turns it into exposure.
    fn new(log_exposure: &[f64], noise: &SensorNoise, level_variance: f64) -> Self {
        let (low, high) = TRUSTED_LEVELS;
        let (lowest, highest) = (log_exposure[low], log_exposure[high]);
        let bins_per_unit = Self::BINS as f64 / (highest - lowest).max(f64::MIN_POSITIVE);
        let saturation = log_exposure[LEVELS - 1].exp();
        let inverse_variance = (0..Self::BINS)
            .map(|bin| {
                let log = lowest + (bin as f64 + 0.5) / bins_per_unit;
                let exposure = log.exp();
                let per_level = exposure * slope(log_exposure, level_of(log_exposure, log));
                1.0 / (noise.exposure_variance(exposure, saturation) + level_variance * per_level * per_level)
            })
            .collect();
        Self { lowest, bins_per_unit, inverse_variance }
    }

    fn inverse_variance(&self, log_exposure: f64) -> f64 {
        let bin = (log_exposure - self.lowest) * self.bins_per_unit;
        // Truncation sends everything in (-1, 0) to bin 0: the sign must be looked at first.
        if bin >= 0.0 { self.inverse_variance.get(bin as usize).copied().unwrap_or(0.0) } else { 0.0 }
    }
}
