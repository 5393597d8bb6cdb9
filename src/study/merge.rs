//! How close the merge comes to inverse variance with everything known, on brackets of a simulated EOS 5D.
//!
//! The camera is written for this study alone: photon noise of an 80 000 e- well, 30 e- of read noise, 12 bits from black 128 to
//! white 3692, then 8 bits through the curve of sRGB, as they are or as a JPEG of the finest setting. The curve is known to all.

use super::csv;
use crate::numerics::image::{Image, RadianceImage};
use crate::numerics::radiometry::bracket::{Bracket, BracketError, Exposure};
use crate::numerics::radiometry::merge::{Estimator, Merger};
use crate::numerics::radiometry::noise::SensorNoise;
use crate::numerics::radiometry::response::{REFERENCE_LEVEL, Response};
use crate::pipeline::develop::{BracketFrame, DevelopError, read_bracket};
use jpeg_encoder::{ColorType, Encoder, EncodingError, SamplingFactor};
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, StandardNormal};

const FULL_WELL_E: f64 = 80_000.0;
const READ_NOISE_E: f64 = 30.0;
const DIGITAL_RANGE: f64 = 3692.0 - 128.0;
/// A frame whose mean level reaches this is no sample of the oracle's.
const ORACLE_CLIPS: f64 = 251.5;
/// The paper's bracket: 1/100 to 15 s, seconds.
const TIMES_S: [f64; 10] = [0.01, 1.0 / 40.0, 1.0 / 15.0, 1.0 / 6.0, 0.4, 1.0, 2.0, 4.0, 8.0, 15.0];

/// Signals whose errors are looked at together, electrons a second.
pub const RANGES: [(&str, f64, f64); 3] =
    [("dark 30-3e3 e-/s", 30.0, 3e3), ("mid 3e3-3e5 e-/s", 3e3, 3e5), ("high 3e5-8e6 e-/s", 3e5, 8e6)];

/// How the camera stores a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Storage {
    /// Rounded to 8 bits.
    EightBit,
    /// 8 bits as JPEG 4:4:4, quality 99.
    Jpeg,
}

impl Storage {
    /// Both.
    pub const ALL: [Self; 2] = [Self::EightBit, Self::Jpeg];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::EightBit => "8 bit",
            Self::Jpeg => "8 bit, JPEG 4:4:4",
        }
    }
}

/// Errors of an estimator on one range.
#[derive(Clone, Debug)]
pub struct Score {
    /// How the frames were stored.
    pub storage: Storage,
    /// Estimator; `oracle` is inverse variance with true radiance, noise and curve.
    pub estimator: &'static str,
    /// Index into [`RANGES`].
    pub range: usize,
    /// Relative error, rms.
    pub rms: f64,
    /// Mean relative error.
    pub bias: f64,
    /// Share of pixels that are valid; the errors are those of valid pixels.
    pub valid: f64,
}

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum MergeStudyError {
    /// The frames are no bracket.
    #[error(transparent)]
    Bracket(#[from] BracketError),
    /// They cannot be read back.
    #[error(transparent)]
    Develop(#[from] DevelopError),
    /// They cannot be stored.
    #[error("the simulated frame cannot be stored: {0}")]
    Jpeg(#[from] EncodingError),
}

/// Scores of every storage, range and estimator on `width * height` pixels a range; the oracle comes first of each.
///
/// # Errors
/// Frames cannot be stored or read back.
pub fn run((width, height): (usize, usize), seed: u64) -> Result<Vec<Score>, MergeStudyError> {
    let mut scores = Vec::new();
    for storage in Storage::ALL {
        for (range, &(_, low, high)) in RANGES.iter().enumerate() {
            let truth = scene(width, height, low, high);
            let bracket = shoot(&truth, storage, seed)?;
            let oracle = oracle(&truth, &bracket);
            let noise = SensorNoise { full_well_e: FULL_WELL_E, read_noise_e: READ_NOISE_E };
            let response = Response { log_exposure: std::array::from_fn(|_| curve()) };
            let merged = Estimator::ALL
                .map(|estimator| (estimator.name(), Merger::new(&bracket, &response, &noise, estimator).whole()));
            let mut valid = merged[0].1.valid.clone();
            valid.pixels.iter_mut().zip(&oracle.valid.pixels).for_each(|(valid, &known)| *valid &= known);
            let all = std::iter::once(("oracle", oracle)).chain(merged);
            scores.extend(all.map(|(estimator, image)| {
                let (rms, bias, valid) = errors(&truth, &image, &valid);
                Score { storage, estimator, range, rms, bias, valid }
            }));
        }
    }
    Ok(scores)
}

/// True signal, electrons a second: log-uniform from left to right, the channels apart.
fn scene(width: usize, height: usize, low: f64, high: f64) -> Image<[f64; 3]> {
    let signal = |i: usize, c: usize| {
        let across = ((i % width) as f64 + c as f64 / 3.0) / width as f64;
        low * (high / low).powf(across)
    };
    let pixel = |i: usize| std::array::from_fn(|c| signal(i, c));
    Image { width, height, pixels: (0..width * height).map(pixel).collect() }
}

fn shoot(truth: &Image<[f64; 3]>, storage: Storage, seed: u64) -> Result<Bracket, MergeStudyError> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut frames = Vec::new();
    for time_s in TIMES_S {
        let pixels = truth.pixels.iter().map(|pixel| pixel.map(|rate| level(rate * time_s, &mut random))).collect();
        frames.push((Image { width: truth.width, height: truth.height, pixels }, time_s));
    }
    match storage {
        Storage::EightBit => {
            let exposure = |(levels, time_s)| Exposure { name: format!("{time_s} s"), levels, time_s };
            Ok(Bracket::new(frames.into_iter().map(exposure).collect(), [1.0 / 12.0; 3])?)
        }
        Storage::Jpeg => {
            let files: Vec<Vec<u8>> = frames.iter().map(|(levels, _)| jpeg(levels)).collect::<Result<_, _>>()?;
            let frame = |(bytes, time_s)| BracketFrame { name: "simulated", bytes, time_s };
            let frames: Vec<_> = files.iter().map(Vec::as_slice).zip(TIMES_S).map(frame).collect();
            Ok(read_bracket(&frames, None)?)
        }
    }
}

/// The level the camera stores of a mean charge, electrons.
fn level(mean: f64, random: &mut Xoshiro256PlusPlus) -> u8 {
    let normal: f64 = StandardNormal.sample(random);
    let electrons = (mean + normal * (mean + READ_NOISE_E.powi(2)).sqrt()) / FULL_WELL_E;
    // The converter's own rounding, blurred by nothing else.
    let digital = (electrons * DIGITAL_RANGE).round() / DIGITAL_RANGE;
    (255.0 * encode(digital.clamp(0.0, 1.0))).round() as u8
}

fn jpeg(levels: &Image<[u8; 3]>) -> Result<Vec<u8>, EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, 99);
    encoder.set_sampling_factor(SamplingFactor::F_1_1);
    encoder.encode(levels.pixels.as_flattened(), levels.width as u16, levels.height as u16, ColorType::Rgb)?;
    Ok(bytes)
}

/// IEC 61966-2-1.
fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Inverse of [`encode`], for a level; the darkest stands for all that rounds to it.
fn decode(level: f64) -> f64 {
    let value = level.max(0.25) / 255.0;
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// The true response in the unit of the merge.
fn curve() -> Vec<f64> {
    (0..256).map(|z| (decode(f64::from(z)) / decode(REFERENCE_LEVEL as f64)).ln()).collect()
}

/// Inverse variance with the weights of the true radiance; every parameter known, every frame used whose mean is not clipped.
fn oracle(truth: &Image<[f64; 3]>, bracket: &Bracket) -> RadianceImage {
    let unit = decode(REFERENCE_LEVEL as f64) * FULL_WELL_E;
    let estimate = |pixel: usize, c: usize| {
        let rate = truth.pixels[pixel][c];
        let (mut sum, mut total) = (0.0, 0.0);
        for frame in bracket.exposures() {
            let mean = rate * frame.time_s;
            let mean_level = 255.0 * encode((mean / FULL_WELL_E).min(1.0));
            if mean_level < ORACLE_CLIPS {
                let per_level = (decode(mean_level + 0.5) - decode(mean_level - 0.5)) * FULL_WELL_E;
                let stored = bracket.level_variance()[c] * per_level * per_level;
                let digital = (FULL_WELL_E / DIGITAL_RANGE).powi(2) / 12.0;
                let weight = frame.time_s.powi(2) / (mean + READ_NOISE_E.powi(2) + digital + stored);
                let charge = decode(f64::from(frame.levels.pixels[pixel][c])) * FULL_WELL_E;
                sum += weight * charge / frame.time_s;
                total += weight;
            }
        }
        (sum / total / unit) as f32
    };
    let size = (truth.width, truth.height);
    let pixels: Vec<[f32; 3]> = (0..size.0 * size.1).map(|pixel| std::array::from_fn(|c| estimate(pixel, c))).collect();
    let valid = pixels.iter().map(|pixel| pixel.iter().all(|value| value.is_finite())).collect();
    RadianceImage {
        radiance: Image { width: size.0, height: size.1, pixels },
        variance: None,
        valid: Image { width: size.0, height: size.1, pixels: valid },
    }
}

/// Relative rms error and bias over the pixels of `valid`, and their share.
fn errors(truth: &Image<[f64; 3]>, image: &RadianceImage, valid: &Image<bool>) -> (f64, f64, f64) {
    let unit = decode(REFERENCE_LEVEL as f64) * FULL_WELL_E;
    let (mut count, mut sum, mut squares) = (0_usize, 0.0, 0.0);
    for (i, pixel) in truth.pixels.iter().enumerate().filter(|(i, _)| valid.pixels[*i]) {
        for c in 0..3 {
            let error = f64::from(image.radiance.pixels[i][c]) * unit / pixel[c] - 1.0;
            count += 1;
            sum += error;
            squares += error * error;
        }
    }
    let n = count as f64;
    ((squares / n).sqrt(), sum / n, n / (3 * truth.pixels.len()) as f64)
}

/// The scores as a table; the errors are relative.
pub fn records(scores: &[Score]) -> csv::Table {
    let row = |score: &Score| {
        vec![
            score.storage.name().to_owned(),
            score.estimator.to_owned(),
            RANGES[score.range].0.to_owned(),
            score.rms.to_string(),
            score.bias.to_string(),
            score.valid.to_string(),
        ]
    };
    let columns = &["storage", "estimator", "range", "rms_error", "mean_error", "valid_share"];
    csv::Table { columns, rows: scores.iter().map(row).collect() }
}

/// The table for people: relative rms error in percent (bias in brackets, and excess over the oracle) by range.
pub fn table(scores: &[Score]) -> String {
    let mut text = format!(
        "{:<38}{}\n",
        "relative rms error, % (bias; over oracle)",
        RANGES.map(|r| format!("{:>30}", r.0)).concat()
    );
    for storage in Storage::ALL {
        let of = |name: &str, range: usize| {
            scores.iter().find(|s| s.storage == storage && s.estimator == name && s.range == range)
        };
        for name in std::iter::once("oracle").chain(Estimator::ALL.map(Estimator::name)) {
            let cells = (0..RANGES.len()).filter_map(|range| {
                let (score, oracle) = (of(name, range)?, of("oracle", range)?);
                let over = 100.0 * (score.rms / oracle.rms - 1.0);
                Some(format!("{:>12.3} ({:+.3}; {over:+.1} %)", 100.0 * score.rms, 100.0 * score.bias))
            });
            let cells: String = cells.map(|cell| format!("{cell:>30}")).collect();
            text += &format!("{:<41}{cells}\n", format!("{}, {name}", storage.name()));
        }
    }
    text
}
