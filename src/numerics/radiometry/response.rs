//! Camera response g: pixel level to log exposure (Debevec & Malik 1997), kept monotone.

use super::bracket::{Bracket, BracketError, Exposure};
use super::monotone::non_negative_least_squares;
use super::sampling::choose_pixels;
use nalgebra::{DMatrix, DVector};

/// Level whose exposure is the unit: g(REFERENCE_LEVEL) = 0 in every channel, as Debevec & Malik fix the scale.
/// A pixel of radiance 1 reaches this level after 1 s.
pub const REFERENCE_LEVEL: usize = 128;

/// Number of 8-bit levels.
pub(super) const LEVELS: usize = 256;

/// A recovered response: natural logarithm of exposure (radiance x seconds) per channel and 8-bit level.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    /// `log_exposure[channel][level]`, non-decreasing in level.
    pub log_exposure: [Vec<f64>; 3],
}

/// A response with what is known about how it was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Recovered {
    /// The curves.
    pub response: Response,
    /// Levels per channel that only the demand for a non-decreasing curve holds up; many of them mean a poor bracket.
    pub active_constraints: [usize; 3],
    /// Pixels the curves were solved from.
    pub pixels: usize,
}

/// Smoothness weight of Debevec & Malik's objective per sampled pixel: enough to bridge levels without samples.
const SMOOTHNESS_PER_PIXEL: f64 = 0.02;
/// Weight of a sample of which another channel is clipped: a camera's colour matrix may have spoilt it too, but the upper
/// levels of the weakest channel of a coloured object are seen in no other samples.
const CLIPPED_NEIGHBOUR: f64 = 0.25;
/// Pixels with usable levels in two frames that a channel needs.
const MIN_PIXELS: usize = 50;
/// Rounds after the published objective.
const PREDICTION_ROUNDS: usize = 3;
/// Frames needed: two leave the curve undetermined between their ratio's powers.
pub const MIN_FRAMES: usize = 3;
const CHANNEL_NAMES: [&str; 3] = ["red", "green", "blue"];

/// Solves for the response of every channel from one bracket (Debevec & Malik 1997, Eq. 3) under the condition that it does
/// not decrease. Refuses brackets that are too short, cover too few levels, or whose images contradict their times.
///
/// The published objective looks a pixel up at its noisy level, which biases the curve where noise is large: the level that is
/// seen comes more often from the commoner exposure beside it. So the objective is solved again, linearised about the level
/// that the last curve predicts, until the curve gives the mean level of every exposure.
pub fn recover(bracket: &Bracket) -> Result<Recovered, BracketError> {
    let exposures = bracket.exposures();
    if exposures.len() < MIN_FRAMES {
        return Err(BracketError::TooFewFrames { found: exposures.len(), needed: MIN_FRAMES });
    }
    if let Some(pair) = exposures.windows(2).find(|pair| pair[0].time_s == pair[1].time_s) {
        let [a, b] = [&pair[0], &pair[1]].map(|frame| frame.name.clone());
        return Err(BracketError::SameTime { a, b, time_s: pair[0].time_s });
    }
    bracket.check_times()?;
    let pixels = choose_pixels(bracket);
    let curves: [Result<Vec<f64>, BracketError>; 3] =
        [0, 1, 2].map(|channel| solve_channel(exposures, &pixels, channel));
    let [red, green, blue] = curves;
    let log_exposure = [red?, green?, blue?];
    let active_constraints =
        log_exposure.each_ref().map(|curve| curve.windows(2).filter(|step| step[0] == step[1]).count());
    Ok(Recovered { response: Response { log_exposure }, active_constraints, pixels: pixels.len() })
}

/// Debevec & Malik's hat: trust in a level, 0 at the ends, 1 in the middle.
fn hat(level: f64) -> f64 {
    level.min(255.0 - level).max(0.0) / 127.0
}

fn solve_channel(exposures: &[Exposure], pixels: &[usize], channel: usize) -> Result<Vec<f64>, BracketError> {
    let seen: Vec<Vec<Sample>> = pixels
        .iter()
        .map(|&pixel| exposures.iter().map(|frame| Sample::new(frame, pixel, channel)).collect::<Vec<_>>())
        .filter(|samples| samples.iter().filter(|s| s.weight > 0.0).count() >= 2)
        .collect();
    let used = || seen.iter().flatten().filter(|s| s.weight > 0.0).map(|s| s.level as u8);
    let (lowest, highest) = (used().min().unwrap_or(0), used().max().unwrap_or(0));
    let no_coverage = || BracketError::NoCoverage {
        channel: CHANNEL_NAMES[channel],
        pixels: seen.len(),
        lowest,
        highest,
        needed: MIN_PIXELS,
    };
    if seen.len() < MIN_PIXELS || usize::from(lowest) > REFERENCE_LEVEL || usize::from(highest) < REFERENCE_LEVEL {
        return Err(no_coverage());
    }
    let mut curve = Normal::new(&seen).solve_monotone().ok_or_else(no_coverage)?;
    for _ in 0..PREDICTION_ROUNDS {
        let predicted: Vec<Vec<Sample>> = seen.iter().filter_map(|samples| predict(samples, &curve)).collect();
        curve = Normal::new(&predicted).solve_monotone().ok_or_else(no_coverage)?;
    }
    Ok(curve)
}

/// One level of one pixel, as g(level) + offset = ln radiance + ln time.
#[derive(Clone)]
struct Sample {
    /// Where the curve is looked up.
    level: f64,
    offset: f64,
    log_time: f64,
    weight: f64,
    /// Trust in the frame at this pixel apart from its level.
    trust: f64,
}

impl Sample {
    fn new(frame: &Exposure, pixel: usize, channel: usize) -> Self {
        let levels = frame.levels.pixels[pixel];
        let level = f64::from(levels[channel]);
        let trust = if levels.contains(&u8::MAX) { CLIPPED_NEIGHBOUR } else { 1.0 };
        Self { level, offset: 0.0, log_time: frame.time_s.ln(), weight: trust * hat(level).powi(2), trust }
    }
}

/// Moves the samples of one pixel to the levels that `curve` predicts for them, the observed level as a first-order offset.
fn predict(seen: &[Sample], curve: &[f64]) -> Option<Vec<Sample>> {
    let total: f64 = seen.iter().map(|s| s.weight).sum();
    let log_radiance = seen.iter().map(|s| s.weight * (interpolate(curve, s.level) - s.log_time)).sum::<f64>() / total;
    let moved: Vec<Sample> = seen
        .iter()
        .map(|s| {
            let level = level_of(curve, log_radiance + s.log_time);
            let offset = slope(curve, level) * (s.level - level);
            Sample { level, offset, log_time: s.log_time, weight: s.trust * hat(level).powi(2), trust: s.trust }
        })
        .collect();
    (moved.iter().filter(|s| s.weight > 0.0).count() >= 2).then_some(moved)
}

fn interpolate(curve: &[f64], level: f64) -> f64 {
    taps(level).iter().map(|(at, share)| curve[*at] * share).sum()
}

/// The level at which a non-decreasing curve reaches `log_exposure`, 0 to 255.
pub(super) fn level_of(curve: &[f64], log_exposure: f64) -> f64 {
    let above = curve.partition_point(|&g| g <= log_exposure);
    if above == 0 || above == LEVELS {
        return if above == 0 { 0.0 } else { 255.0 };
    }
    let (low, high) = (curve[above - 1], curve[above]);
    (above - 1) as f64 + (log_exposure - low) / (high - low)
}

/// dg/dlevel, over two levels each side: single steps are noisy.
pub(super) fn slope(curve: &[f64], level: f64) -> f64 {
    let middle = level.round() as usize;
    let (below, above) = (middle.saturating_sub(2), (middle + 2).min(LEVELS - 1));
    (curve[above] - curve[below]) / (above - below) as f64
}

/// The quadratic form g'Hg/2 - b'g of the objective after the log radiance of every pixel is eliminated.
struct Normal {
    matrix: DMatrix<f64>,
    rhs: DVector<f64>,
}

/// The two levels a fractional level lies between, with their shares.
fn taps(level: f64) -> [(usize, f64); 2] {
    let below = (level as usize).min(LEVELS - 2);
    let part = level - below as f64;
    [(below, 1.0 - part), (below + 1, part)]
}

impl Normal {
    fn new(pixels: &[Vec<Sample>]) -> Self {
        let mut normal = Self { matrix: DMatrix::zeros(LEVELS, LEVELS), rhs: DVector::zeros(LEVELS) };
        for samples in pixels {
            normal.add_pixel(samples);
        }
        normal.add_smoothness(SMOOTHNESS_PER_PIXEL * pixels.len() as f64);
        normal
    }

    /// Adds the samples of one pixel, its log radiance eliminated: it is the weighted mean of g(level) + offset - ln(time).
    fn add_pixel(&mut self, samples: &[Sample]) {
        let total: f64 = samples.iter().map(|s| s.weight).sum();
        let mean = samples.iter().map(|s| s.weight * (s.log_time - s.offset)).sum::<f64>() / total;
        let used = || samples.iter().filter(|s| s.weight > 0.0);
        for a in used() {
            for (row, share) in taps(a.level) {
                self.rhs[row] += share * a.weight * (a.log_time - a.offset - mean);
                for (column, other) in taps(a.level) {
                    self.matrix[(row, column)] += share * other * a.weight;
                }
                for b in used() {
                    for (column, other) in taps(b.level) {
                        self.matrix[(row, column)] -= share * other * a.weight * b.weight / total;
                    }
                }
            }
        }
    }

    /// Adds the squared second differences, weighted with the hat; a floor keeps the ends of the curve determined.
    fn add_smoothness(&mut self, lambda: f64) {
        const STENCIL: [f64; 3] = [1.0, -2.0, 1.0];
        for middle in 1..LEVELS - 1 {
            let weight = lambda * hat(middle as f64).powi(2).max(1e-4);
            for (i, a) in STENCIL.iter().enumerate() {
                for (j, b) in STENCIL.iter().enumerate() {
                    self.matrix[(middle + i - 1, middle + j - 1)] += weight * a * b;
                }
            }
        }
    }

    /// Minimises over non-decreasing curves: the unknowns are the increments from level to level, none negative.
    /// The objective does not see a constant, so the curve is shifted to g(REFERENCE_LEVEL) = 0 at the end.
    fn solve_monotone(self) -> Option<Vec<f64>> {
        let Self { mut matrix, mut rhs } = self;
        // Increment k raises every level from k on: sum rows and columns from the end.
        for level in (0..LEVELS - 1).rev() {
            rhs[level] += rhs[level + 1];
            for other in 0..LEVELS {
                matrix[(level, other)] += matrix[(level + 1, other)];
            }
        }
        for level in (0..LEVELS - 1).rev() {
            for other in 0..LEVELS {
                matrix[(other, level)] += matrix[(other, level + 1)];
            }
        }
        let gram = matrix.view((1, 1), (LEVELS - 1, LEVELS - 1)).into_owned();
        let increments = non_negative_least_squares(&gram, &rhs.rows(1, LEVELS - 1).into_owned())?;
        let mut curve = vec![0.0; LEVELS];
        for level in 1..LEVELS {
            curve[level] = curve[level - 1] + increments[level - 1];
        }
        let shift = curve[REFERENCE_LEVEL];
        Some(curve.into_iter().map(|g| g - shift).collect())
    }
}
