//! Shutter times measured on the images of a bracket, beside the times its labels mean.

use super::bracket::{Bracket, BracketError, MANY};
use super::curve_system::CurveSystem;
use super::dark_levels::smoothed_sigma;
use super::exposure_ratios::Information;
pub use super::gauge::SHUTTER;
use super::gauge::{Gauge, gauge, scatter, single_faults};
use super::groups::Channel;
use super::level_samples::LevelSamples;
use super::noise::SensorNoise;
use super::response::{MIN_FRAMES, Response, coverage, level_sigma};
use nalgebra::{DMatrix, DVector};

/// Measured times of a bracket, in the order of its frames.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredTimes {
    /// Every frame's.
    pub frames: Vec<MeasuredTime>,
    /// The frame whose time is taken as expected: images give ratios only.
    pub reference: usize,
    /// Relative standard error of the exponent that the images leave open, or that the known response has; 0 of linear samples.
    pub exponent_sigma: f64,
    /// True if the frames' scatter shows that error; false if fewer than four agree, and it rests on what shutters are like.
    pub exponent_told: bool,
    /// Relative scatter of the measured about the expected times, frames that stand apart not counted.
    pub scatter: f64,
    /// Scatter of the log ratios in units of what their weights expect.
    pub chi_squared: f64,
}

/// One frame's time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredTime {
    /// Seconds; the expected time where the images do not tell.
    pub time_s: f64,
    /// Relative standard error against the reference; none where the images do not tell.
    pub sigma: Option<f64>,
    /// Pixels (one a channel) that another frame shows as well.
    pub overlap: usize,
}

/// Levels that ratios are read from, mean of a group: below, read noise bends the mean; above, clipping.
const RATIO_LEVELS: (f64, f64) = (20.0, 240.0);
/// Pixels, counted once a channel, a frame must share with others for its time to be measured: from fewer, ratios
/// came out half a percent off.
const MIN_OVERLAP: usize = 1000;
/// How well a shutter and a lamp repeat a bracket, relative: frames that overlap little are held to the earlier measurement.
const REPEATED: f64 = 0.005;
/// Rounds of grouping, solving for the curve, solving for the times; a known curve leaves little to repeat.
const ROUNDS: usize = 3;
const ROUNDS_WITH_RESPONSE: usize = 2;

/// The fraction of full scale that ratios are read from: below, an error of the black level counts; above, the sensor bends.
const RATIO_SIGNALS: (f64, f64) = (0.01, 0.95);

/// Linear samples of the same points in every frame: raw, black subtracted, 1 at saturation; infinite where a neighbour is
/// clipped and may have spilt into it, so that no group of pixels mixes such samples with sound ones.
#[derive(Clone, Debug)]
pub struct LinearSamples {
    /// `signals[channel][frame][point]`; as many channels as the mosaic has colours.
    pub signals: Vec<Vec<Vec<f32>>>,
}

impl MeasuredTimes {
    /// Times of 8-bit frames through a known response, next to the `expected_s` ones (seconds, in the order of the frames): nothing
    /// but the common factor is taken from these. `exponent_sigma` is the relative standard error of the response's exponent. With
    /// `repeated`, the reference frame of an earlier bracket whose measured times are expected to come again, that frame keeps its
    /// own.
    pub fn with_response(
        bracket: &Bracket,
        expected_s: &[f64],
        (response, exponent_sigma): (&Response, f64),
        repeated: Option<usize>,
    ) -> Result<Self, BracketError> {
        let samples = LevelSamples::new(bracket, MANY);
        let measured = iterate(&logarithms(bracket, expected_s)?, false, repeated, |information, log_times| {
            let groups = samples.groups(response, &seconds(log_times), RATIO_LEVELS);
            for (channel, groups) in groups.iter().enumerate() {
                let log_exposure = |level: f64| response.log_exposure_at(channel, level);
                information.add_known(groups, &log_exposure, &smoothed_sigma(&response.log_exposure[channel]));
            }
            Ok(())
        });
        measured.map(|measured| measured.with_exponent(exponent_sigma))
    }

    /// Adds to the standard errors what an exponent known to `sigma` leaves open.
    fn with_exponent(mut self, sigma: f64) -> Self {
        let reference = self.frames[self.reference].time_s;
        for frame in &mut self.frames {
            let open = sigma * (frame.time_s / reference).ln();
            frame.sigma = frame.sigma.map(|own| own.hypot(open));
        }
        self.exponent_sigma = sigma;
        self
    }

    /// Times of 8-bit frames with the response unknown. The images then tell the times up to one exponent on all of them, which
    /// is taken from the `expected_s` times (seconds, in the order of the frames), as is the common factor.
    pub fn without_response(bracket: &Bracket, expected_s: &[f64]) -> Result<Self, BracketError> {
        let expected = logarithms(bracket, expected_s)?;
        if expected.len() < MIN_FRAMES {
            return Err(BracketError::TooFewFrames { found: expected.len(), needed: MIN_FRAMES });
        }
        bracket.check_exposed()?;
        let samples = LevelSamples::new(bracket, MANY);
        let mut response = Response::typical();
        let mut systems: Vec<CurveSystem> = Vec::new();
        iterate(&expected, true, None, |information, log_times| {
            let curves: Option<Vec<Vec<f64>>> = systems.iter().map(|system| system.curve(log_times)).collect();
            if let Some(Ok(curves)) = curves.map(<[Vec<f64>; 3]>::try_from) {
                response = Response { log_exposure: curves };
            }
            systems.clear();
            let groups = samples.groups(&response, &seconds(log_times), RATIO_LEVELS);
            for (channel, groups) in groups.iter().enumerate() {
                let no_coverage = coverage(groups, channel)?;
                let curve = &response.log_exposure[channel];
                systems.push(information.add_unknown(groups, curve, &level_sigma(curve)).ok_or(no_coverage)?);
            }
            Ok(())
        })
    }

    /// Times of linear frames next to the `expected_s` ones (seconds); no response, no exponent left open. `repeated` as in
    /// [`MeasuredTimes::with_response`].
    pub fn linear(
        samples: &LinearSamples,
        expected_s: &[f64],
        noise: &SensorNoise,
        repeated: Option<usize>,
    ) -> Result<Self, BracketError> {
        let expected: Vec<f64> = expected_s.iter().map(|t| t.ln()).collect();
        let sigma = |signal: f64| noise.exposure_variance(signal, 1.0).sqrt() / signal;
        iterate(&expected, false, repeated, |information, log_times| {
            for signals in &samples.signals {
                let (exposure, trust) = (|signal| signal, |_, _| 1.0);
                let (trusted, clipped) = (RATIO_SIGNALS, RATIO_SIGNALS.1);
                let channel = Channel { signals, exposure: &exposure, trusted, clipped, trust: &trust };
                information.add_known(&channel.groups(&seconds(log_times)), &f64::ln, &sigma);
            }
            Ok(())
        })
    }
}

impl MeasuredTimes {
    /// The `expected_s` times, nothing measured.
    pub fn as_expected(expected_s: &[f64]) -> Self {
        let log_times: Vec<f64> = expected_s.iter().map(|t| t.ln()).collect();
        let frames = expected_s.iter().map(|&time_s| MeasuredTime { time_s, sigma: None, overlap: 0 }).collect();
        let reference = choose_reference(&log_times, &log_times, 0.0);
        Self { frames, reference, exponent_sigma: 0.0, exponent_told: true, scatter: 0.0, chi_squared: 0.0 }
    }

    /// The measured times, seconds.
    pub fn seconds(&self) -> Vec<f64> {
        self.frames.iter().map(|frame| frame.time_s).collect()
    }

    /// Every way in which a single wrong time explains the images, if their response is unknown: the frame, and its time (s) by the
    /// images if the other frames' are the `expected_s` ones.
    pub fn single_faults(&self, expected_s: &[f64]) -> Vec<(usize, f64)> {
        let told: Vec<usize> = (0..self.frames.len()).filter(|&i| self.frames[i].sigma.is_some()).collect();
        let measured: Vec<f64> = told.iter().map(|&i| self.frames[i].time_s.ln()).collect();
        let expected: Vec<f64> = told.iter().map(|&i| expected_s[i].ln()).collect();
        let fault = |(at, off): (usize, f64)| (told[at], expected_s[told[at]] * (-off).exp());
        single_faults(&measured, &expected).into_iter().map(fault).collect()
    }

    /// Relative rms of the measured times about others (seconds), all frames counting: whether the images agree with them. With
    /// `any_exponent` up to one exponent on all times, as an unknown response leaves it. None of fewer than three measured frames.
    pub fn scatter_about(&self, times_s: &[f64], any_exponent: bool) -> Option<f64> {
        let told = || (0..self.frames.len()).filter(|&i| self.frames[i].sigma.is_some());
        let measured: Vec<f64> = told().map(|i| self.frames[i].time_s.ln()).collect();
        let others: Vec<f64> = told().map(|i| times_s[i].ln()).collect();
        (measured.len() >= 3).then(|| scatter(&measured, &others, any_exponent))
    }
}

/// Logarithms of expected times, one for each frame of `bracket`.
fn logarithms(bracket: &Bracket, expected_s: &[f64]) -> Result<Vec<f64>, BracketError> {
    let (found, needed) = (bracket.exposures().len(), expected_s.len());
    if found != needed {
        return Err(BracketError::TooFewFrames { found, needed });
    }
    for (frame, &time_s) in bracket.exposures().iter().zip(expected_s) {
        if !(time_s.is_finite() && time_s > 0.0) {
            return Err(BracketError::BadTime { name: frame.name.clone(), time_s });
        }
    }
    Ok(expected_s.iter().map(|t| t.ln()).collect())
}

fn seconds(log_times: &[f64]) -> Vec<f64> {
    log_times.iter().map(|s| s.exp()).collect()
}

/// Rounds of `gather` (what the images say, grouped with the last times) and solving for the times.
fn iterate(
    expected: &[f64],
    free_exponent: bool,
    reference: Option<usize>,
    mut gather: impl FnMut(&mut Information, &[f64]) -> Result<(), BracketError>,
) -> Result<MeasuredTimes, BracketError> {
    let mut log_times = expected.to_vec();
    let mut round = || {
        let mut information = Information::none(expected.len());
        gather(&mut information, &log_times)?;
        let solved = Solved::new(&information, expected, free_exponent, reference)?;
        log_times.clone_from(&solved.log_times);
        Ok(solved.into_times(&information.overlap))
    };
    for _ in 1..if free_exponent { ROUNDS } else { ROUNDS_WITH_RESPONSE } {
        round()?;
    }
    round()
}

struct Solved {
    log_times: Vec<f64>,
    sigma: Vec<Option<f64>>,
    reference: usize,
    exponent_sigma: f64,
    exponent_told: bool,
    scatter: f64,
    chi_squared: f64,
}

impl Solved {
    fn new(
        information: &Information,
        expected: &[f64],
        free_exponent: bool,
        reference: Option<usize>,
    ) -> Result<Self, BracketError> {
        let told: Vec<usize> = (0..expected.len()).filter(|&i| information.overlap[i] >= MIN_OVERLAP).collect();
        let at_least = if free_exponent { MIN_FRAMES } else { 2 };
        let too_few = BracketError::TooFewOverlap { found: told.len(), needed: at_least };
        if told.len() < at_least {
            return Err(too_few);
        }
        let own: Vec<f64> = told.iter().map(|&i| expected[i]).collect();
        let fixed = fixed_directions(&own, free_exponent);
        let spread = if reference.is_some() { REPEATED } else { SHUTTER };
        let (raw, mut covariance, chi_squared) =
            information.constrained(&told, &own, &fixed, spread).ok_or(too_few.clone())?;
        let gauge = gauge(&raw, &own, free_exponent).ok_or(too_few)?;
        covariance *= gauge.exponent.powi(2);
        let mut found: Vec<f64> = raw.iter().map(|s| gauge.exponent * s + gauge.shift).collect();
        let at = match reference.and_then(|frame| told.iter().position(|&i| i == frame)) {
            Some(at) => at,
            None => choose_reference(&found, &own, gauge.scatter),
        };
        let offset = own[at] - found[at];
        found.iter_mut().for_each(|s| *s += offset);
        let mut log_times = expected.to_vec();
        let mut sigma = vec![None; expected.len()];
        for (i, &frame) in told.iter().enumerate() {
            log_times[frame] = found[i];
            let ratio = covariance[(i, i)] - 2.0 * covariance[(i, at)] + covariance[(at, at)];
            let exponent = gauge.exponent_sigma * (found[i] - found[at]);
            sigma[frame] = Some((ratio.max(0.0) + exponent * exponent).sqrt());
        }
        let Gauge { exponent_sigma, exponent_told, scatter, .. } = gauge;
        Ok(Self { log_times, sigma, reference: told[at], exponent_sigma, exponent_told, scatter, chi_squared })
    }

    fn into_times(self, overlap: &[usize]) -> MeasuredTimes {
        let frames = (0..overlap.len())
            .map(|i| MeasuredTime { time_s: self.log_times[i].exp(), sigma: self.sigma[i], overlap: overlap[i] })
            .collect();
        let Self { reference, exponent_sigma, exponent_told, scatter, chi_squared, .. } = self;
        MeasuredTimes { frames, reference, exponent_sigma, exponent_told, scatter, chi_squared }
    }
}

/// Directions the images are silent in: all times longer alike, and with an unknown response the exponent.
fn fixed_directions(expected: &[f64], free_exponent: bool) -> DMatrix<f64> {
    let n = expected.len();
    let mean = expected.iter().sum::<f64>() / n as f64;
    let mut directions = DMatrix::from_element(n, if free_exponent { 2 } else { 1 }, 1.0);
    if free_exponent {
        directions.set_column(1, &DVector::from_iterator(n, expected.iter().map(|s| s - mean)));
    }
    directions
}

/// The frame nearest to 1 s among those that do not stand apart.
fn choose_reference(found: &[f64], expected: &[f64], scatter: f64) -> usize {
    let apart = |i: usize| (found[i] - expected[i]).abs() > 3.0 * scatter.max(1e-3);
    let rank = |&i: &usize| (apart(i), expected[i].abs());
    (0..found.len())
        .min_by(|a, b| {
            let ((a_apart, a), (b_apart, b)) = (rank(a), rank(b));
            a_apart.cmp(&b_apart).then(a.total_cmp(&b))
        })
        .unwrap_or(0)
}
