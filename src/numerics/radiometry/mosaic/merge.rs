//! Merge of raw frames on the mosaic, then half-size: red, mean of both greens, blue. Nothing is interpolated, so
//! neighbouring pixels share no noise.
//!
//! A photosite of radiance X has the signal X t with the variance X t e + r^2 (photons; e is one electron, r the read
//! noise). Its estimate starts from the sum of signals over the sum of times and takes inverse-variance weights of the
//! estimate itself, three times over (the form of Granados et al. 2010 and Hasinoff et al. 2010): weights of the
//! estimate do not bias it as weights of the noisy sample would. Counts below black stay negative.

use super::super::merge::Estimator;
use super::{PLACES, RawBracket, RawFrame, Signal};
use crate::numerics::image::RadianceImage;
use rayon::prelude::*;

/// Rounds of weights and estimate.
const ROUNDS: usize = 3;
/// Trust in a frame fades out between these signals as estimated. Were samples only cut off where they clip, noise
/// would choose among those near it.
const FADING: (f32, f32) = (0.95, super::CLIPPED as f32);

/// A raw bracket ready to give its radiance strip by strip. Radiance 1 saturates a photosite in one second.
///
/// A frame is open to a photosite unless it is clipped there, or a neighbour overflows and may spill: one that is
/// clipped in the next shorter frame already (of the shortest: in itself). A pixel is valid if each of its four
/// photosites has an open frame, and every channel is above its own standard error. Where photosites are clipped
/// throughout, the value is the nearest bound known, with a variance as large as its square; where it is too dark,
/// value and variance are those merged. Rows are independent of each other: neither strips nor threads change a bit.
pub struct RawMerger<'a> {
    bracket: &'a RawBracket,
    frames: Vec<Sampling>,
    rounds: usize,
    /// Signal of one electron.
    electron: f32,
}

/// How a frame samples radiance.
struct Sampling {
    signal: Signal,
    time: f32,
    /// Squared read noise, signal squared.
    read_variance: f32,
}

impl<'a> RawMerger<'a> {
    /// Gets a merge ready; none for an estimator whose weights are made for levels, not for linear samples.
    pub fn new(bracket: &'a RawBracket, estimator: Estimator) -> Option<Self> {
        let rounds = match estimator {
            Estimator::InverseVariance => ROUNDS,
            Estimator::Poisson => 0,
            Estimator::Debevec | Estimator::Robertson => return None,
        };
        let full_well_e = bracket.converter.full_well_e;
        let sampling = |frame: &RawFrame| {
            let noise = frame.black.noise / bracket.range();
            Sampling { signal: bracket.signal(frame), time: frame.time_s as f32, read_variance: (noise * noise) as f32 }
        };
        let frames = bracket.frames.iter().map(sampling).collect();
        Some(Self { bracket, frames, rounds, electron: (1.0 / full_well_e) as f32 })
    }

    /// All rows.
    pub fn whole(&self) -> RadianceImage {
        let mut image = RadianceImage::empty(self.bracket.width(), self.bracket.height());
        self.strip(0, &mut image);
        image
    }

    /// Merges rows `first_row` onwards into all of `strip`, whose rows beyond the end of the frame keep what they held.
    pub fn strip(&self, first_row: usize, strip: &mut RadianceImage) {
        let width = self.bracket.width();
        let rows = self.bracket.height().saturating_sub(first_row).min(strip.radiance.height);
        let Some(variance) = strip.variance.as_mut().filter(|_| width > 0) else { return };
        let lines = strip.radiance.pixels[..rows * width]
            .par_chunks_mut(width)
            .zip(variance.pixels[..rows * width].par_chunks_mut(width))
            .zip(strip.valid.pixels[..rows * width].par_chunks_mut(width));
        lines.enumerate().for_each(|(row, ((radiance, variance), valid))| {
            let [above, below] = [0, 1].map(|half| self.line(2 * (first_row + row) + half));
            for (x, pixel) in radiance.iter_mut().enumerate() {
                let sites = [above[2 * x], above[2 * x + 1], below[2 * x], below[2 * x + 1]];
                (*pixel, variance[x], valid[x]) = binned(sites);
            }
        });
    }

    /// The photosites of one row of the mosaic.
    fn line(&self, y: usize) -> Vec<Site> {
        let samples: Vec<Samples> = (0..self.frames.len()).map(|frame| self.samples(frame, y)).collect();
        let width = self.bracket.frames[0].counts.width;
        let mut sums = Sums::none(width);
        for (sampling, samples) in self.frames.iter().zip(&samples) {
            sums.add(sampling, samples, |_| 1.0);
        }
        let mut variances = self.poisson_variances(&sums, &samples);
        for _ in 0..self.rounds {
            let estimates = sums.estimates();
            sums = Sums::none(width);
            for (frame, (sampling, samples)) in self.frames.iter().zip(&samples).enumerate() {
                let (time, read, electron) = (sampling.time, sampling.read_variance, self.electron);
                sums.add(sampling, samples, |x| {
                    let signal = estimates[x] * time;
                    // The shortest frame is all there is where the others are clipped.
                    let trust = ((FADING.1 - signal) / (FADING.1 - FADING.0)).clamp(0.0, 1.0);
                    let trust = if frame == 0 { 1.0 } else { trust };
                    trust * time / (signal.max(0.0) * electron + read)
                });
            }
            variances = sums.weights.iter().map(|weight| 1.0 / weight).collect();
        }
        let bound = super::CLIPPED as f32 / self.frames[0].time;
        let site = |x: usize| {
            if sums.weights[x] > 0.0 {
                Site { radiance: sums.signals[x] / sums.weights[x], variance: variances[x], known: true }
            } else {
                Site { radiance: bound, variance: bound * bound, known: false }
            }
        };
        (0..width).map(site).collect()
    }

    fn samples(&self, frame: usize, y: usize) -> Samples {
        let signal = &self.frames[frame].signal;
        let counts = self.bracket.frames[frame].counts.row(y);
        let spills = self.overflowing(frame.saturating_sub(1), y);
        let at = |x: usize| signal.at(counts[x], 2 * (y % 2) + x % 2);
        let open = |x: usize| f32::from(u8::from(counts[x] < signal.clipped && !spills[x]));
        Samples { signal: (0..counts.len()).map(at).collect(), open: (0..counts.len()).map(open).collect() }
    }

    /// Where in a row the photosite or one of its eight neighbours is clipped in a frame.
    fn overflowing(&self, frame: usize, y: usize) -> Vec<bool> {
        let counts = &self.bracket.frames[frame].counts;
        let [above, own, below] = [y.saturating_sub(1), y, (y + 1).min(counts.height - 1)].map(|y| counts.row(y));
        let highest: Vec<u16> = (0..counts.width).map(|x| above[x].max(own[x]).max(below[x])).collect();
        let around =
            |x: usize| highest[x.saturating_sub(1)].max(highest[x]).max(highest[(x + 1).min(counts.width - 1)]);
        (0..counts.width).map(|x| around(x) >= self.frames[frame].signal.clipped).collect()
    }

    /// Variances of sums of signals over sums of times.
    fn poisson_variances(&self, sums: &Sums, samples: &[Samples]) -> Vec<f32> {
        let variance = |x: usize| {
            let read: f32 = samples.iter().zip(&self.frames).map(|(s, frame)| s.open[x] * frame.read_variance).sum();
            (sums.signals[x].max(0.0) * self.electron + read) / (sums.weights[x] * sums.weights[x])
        };
        (0..sums.weights.len()).map(variance).collect()
    }
}

/// A row of a frame: signals, and 1 where they are open, 0 elsewhere.
struct Samples {
    signal: Vec<f32>,
    open: Vec<f32>,
}

/// Sums over the frames by photosite of a row.
struct Sums {
    /// Weight times signal.
    signals: Vec<f32>,
    /// Weight times time.
    weights: Vec<f32>,
}

impl Sums {
    fn none(width: usize) -> Self {
        Self { signals: vec![0.0; width], weights: vec![0.0; width] }
    }

    fn add(&mut self, sampling: &Sampling, samples: &Samples, weight: impl Fn(usize) -> f32) {
        let sums = self.signals.iter_mut().zip(&mut self.weights);
        for (x, (signals, weights)) in sums.enumerate() {
            let weight = samples.open[x] * weight(x);
            *signals += weight * samples.signal[x];
            *weights += weight * sampling.time;
        }
    }

    /// Radiance by photosite; a number wherever a frame is open.
    fn estimates(&self) -> Vec<f32> {
        self.signals.iter().zip(&self.weights).map(|(signals, weights)| signals / weights).collect()
    }
}

/// A merged photosite.
#[derive(Clone, Copy)]
struct Site {
    radiance: f32,
    variance: f32,
    known: bool,
}

/// Radiance, variance and validity of a cell.
fn binned([red, green, other, blue]: [Site; PLACES]) -> ([f32; 3], [f32; 3], bool) {
    let known = green.known && other.known;
    let radiance = 0.5 * (green.radiance + other.radiance);
    let variance = if known { 0.25 * (green.variance + other.variance) } else { radiance * radiance };
    let channels = [red, Site { radiance, variance, known }, blue];
    let bright = |site: &Site| site.known && site.radiance > 0.0 && site.radiance * site.radiance > site.variance;
    (channels.map(|site| site.radiance), channels.map(|site| site.variance), channels.iter().all(bright))
}
