//! Camera response g: pixel level to log exposure (Debevec & Malik 1997), kept monotone.

use super::bracket::{Bracket, BracketError, MANY};
use super::curve_system::CurveSystem;
use super::dark_levels::smooth;
use super::exposure_ratios::Information;
use super::groups::Group;
use super::level_samples::LevelSamples;

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

/// Levels the curve is solved from, mean of a group: outside, black and clipping bend the mean.
const SOLVED_LEVELS: (f64, f64) = (5.0, 250.0);
/// Pixels with usable levels in two frames that a channel needs.
const MIN_PIXELS: usize = 50;
/// Rounds of grouping pixels by the last curve and solving for the next.
const ROUNDS: usize = 3;
/// Frames needed: two leave the curve undetermined between their ratio's powers.
pub const MIN_FRAMES: usize = 3;
/// Names of the channels in messages.
pub(super) const CHANNEL_NAMES: [&str; 3] = ["red", "green", "blue"];

/// Solves for the response of every channel from one bracket (Debevec & Malik 1997, Eq. 3) under the condition that it does
/// not decrease. Refuses brackets that are too short, cover too few levels, or whose images contradict their times.
///
/// The published objective looks a pixel up at its noisy level, which biases the curve where noise is large: the level that is
/// seen comes more often from the commoner exposure beside it. So groups of pixels of one radiance take the place of pixels.
pub fn recover(bracket: &Bracket) -> Result<Recovered, BracketError> {
    check(bracket)?;
    let samples = LevelSamples::new(bracket, MANY);
    let times: Vec<f64> = bracket.exposures().iter().map(|frame| frame.time_s).collect();
    let log_times: Vec<f64> = times.iter().map(|t| t.ln()).collect();
    let mut response = Response::typical();
    for _ in 0..ROUNDS {
        let mut next = Vec::with_capacity(3);
        let groups = samples.groups(&response, &times, SOLVED_LEVELS);
        for (channel, groups) in groups.iter().enumerate() {
            let no_coverage = coverage(groups, channel)?;
            let rough = &response.log_exposure[channel];
            let system =
                CurveSystem::new(&Information::none(times.len()).seen(groups, &level_sigma(rough)), times.len(), rough);
            next.push(system.curve(&log_times).ok_or(no_coverage)?);
        }
        response = Response { log_exposure: std::array::from_fn(|c| std::mem::take(&mut next[c])) };
    }
    let active_constraints =
        response.log_exposure.each_ref().map(|curve| curve.windows(2).filter(|step| step[0] == step[1]).count());
    let response = Response { log_exposure: response.log_exposure.map(|curve| smooth(&curve)) };
    Ok(Recovered { response, active_constraints, pixels: samples.points() })
}

/// Refuses brackets no response can be solved from.
pub(super) fn check(bracket: &Bracket) -> Result<(), BracketError> {
    let exposures = bracket.exposures();
    if exposures.len() < MIN_FRAMES {
        return Err(BracketError::TooFewFrames { found: exposures.len(), needed: MIN_FRAMES });
    }
    if let Some(pair) = exposures.windows(2).find(|pair| pair[0].time_s == pair[1].time_s) {
        let [a, b] = [&pair[0], &pair[1]].map(|frame| frame.name.clone());
        return Err(BracketError::SameTime { a, b, time_s: pair[0].time_s });
    }
    bracket.check_exposed()?;
    bracket.check_times().map(|_| ())
}

/// Refuses groups that cover too few levels; returns the refusal for other failures.
pub(super) fn coverage(groups: &[Group], channel: usize) -> Result<BracketError, BracketError> {
    let shown = || groups.iter().filter(|group| group.means.iter().flatten().count() >= 2);
    let levels = || shown().flat_map(|group| group.means.iter().flatten().map(|(level, _)| *level));
    let lowest = levels().fold(255.0, f64::min);
    let highest = levels().fold(0.0, f64::max);
    let pixels = shown().map(|group| group.points).sum();
    let refusal = BracketError::NoCoverage {
        channel: CHANNEL_NAMES[channel],
        pixels,
        lowest: lowest.floor() as u8,
        highest: highest.ceil() as u8,
        needed: MIN_PIXELS,
    };
    let reference = REFERENCE_LEVEL as f64;
    if pixels < MIN_PIXELS || lowest > reference || highest < reference { Err(refusal) } else { Ok(refusal) }
}

/// Standard error of the log exposure of one sample: rounding, photons and the file format together are about a level.
pub(super) fn level_sigma(curve: &[f64]) -> impl Fn(f64) -> f64 {
    const LEVELS_RMS: f64 = 1.2;
    move |level| LEVELS_RMS * slope(curve, level).max(1e-4)
}

impl Response {
    /// A power law of 2.2 in every channel: where solving starts.
    pub(super) fn typical() -> Self {
        let curve: Vec<f64> =
            (0..LEVELS).map(|level| 2.2 * ((level as f64).max(0.5) / REFERENCE_LEVEL as f64).ln()).collect();
        Self { log_exposure: [curve.clone(), curve.clone(), curve] }
    }

    /// Levels as sRGB has them (IEC 61966-2-1), in every channel: for pictures where no camera's response is known.
    pub fn srgb() -> Self {
        let linear = |level: f64| {
            let part = level / 255.0;
            if part <= 0.04045 { part / 12.92 } else { ((part + 0.055) / 1.055).powf(2.4) }
        };
        let log = |level: usize| (linear((level as f64).max(0.5)) / linear(REFERENCE_LEVEL as f64)).ln();
        Self { log_exposure: std::array::from_fn(|_| (0..LEVELS).map(log).collect()) }
    }

    /// The level, 0 to 255, that this log exposure gives in a channel; between levels, straight.
    pub fn level(&self, channel: usize, log_exposure: f64) -> f64 {
        level_of(&self.log_exposure[channel], log_exposure)
    }

    /// Log exposure of a level between levels, 0 to 255.
    pub fn log_exposure_at(&self, channel: usize, level: f64) -> f64 {
        let curve = &self.log_exposure[channel];
        let below = (level.max(0.0) as usize).min(LEVELS - 2);
        let part = level - below as f64;
        curve[below] * (1.0 - part) + curve[below + 1] * part
    }
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
