//! Ten JPEG frames of a scene as large as those of an EOS 5D, for measuring what merging costs.

use crate::numerics::image::Image;
use jpeg_encoder::{ColorType, Encoder, EncodingError, SamplingFactor};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

/// Columns and rows of an EOS 5D.
pub const FULL_SIZE: (usize, usize) = (4368, 2912);
/// The paper's bracket, seconds.
pub const TIMES_S: [f64; 10] = [0.01, 1.0 / 40.0, 1.0 / 15.0, 1.0 / 6.0, 0.4, 1.0, 2.0, 4.0, 8.0, 15.0];
/// Charge at saturation and read noise, electrons.
const SENSOR: (f32, f32) = (80_000.0, 30.0);
/// Gives files of some 3 MB, as the camera's.
const QUALITY: u8 = 95;

/// The curve of the frames: levels 0 to 255 of exposures 0 to 1, a power of 1/2.2 with a straight toe.
const TOE: f64 = 0.055;

/// Exposure of a level, 1 at saturation.
pub fn exposure(level: f64) -> f64 {
    let power = |v: f64| v.powf(2.2);
    (power(level / 255.0 + TOE) - power(TOE)) / (power(1.0 + TOE) - power(TOE))
}

/// The files, shortest exposure first: textured balls of a radiance of 2500 : 1, with photon and read noise, 4:2:2 as the camera's.
///
/// # Errors
/// The size does not fit a JPEG.
pub fn files(size: (usize, usize)) -> Result<Vec<Vec<u8>>, EncodingError> {
    let levels = level_table();
    (0..TIMES_S.len()).map(|frame| jpeg(&shoot(size, frame, &levels))).collect()
}

/// Level of 65536 exposures.
fn level_table() -> Vec<u8> {
    let of: Vec<f64> = (0..256).map(|z| exposure(f64::from(z) + 0.5)).collect();
    (0..=u16::MAX).map(|e| of.partition_point(|&top| top <= f64::from(e) / 65535.0).min(255) as u8).collect()
}

fn shoot((width, height): (usize, usize), frame: usize, levels: &[u8]) -> Image<[u8; 3]> {
    let (time, (well, read)) = (TIMES_S[frame] as f32, SENSOR);
    let row = |y: usize| {
        let mut random = Xoshiro256PlusPlus::seed_from_u64((frame * height + y) as u64);
        (0..width).map(move |x| {
            std::array::from_fn(|c| {
                let mean = well * radiance(x as f32, y as f32, c) * time;
                // Eight random bytes: near enough to a normal distribution.
                let bytes = random.random::<u64>().to_le_bytes();
                let sum: i32 = bytes.iter().map(|&b| i32::from(b)).sum();
                let normal = (sum - 1020) as f32 / 209.0;
                let electrons = mean + normal * (mean + read * read).sqrt();
                levels[(65535.0 * (electrons / well).clamp(0.0, 1.0)) as usize]
            })
        })
    };
    let rows: Vec<Vec<[u8; 3]>> = (0..height).into_par_iter().map(|y| row(y).collect()).collect();
    Image { width, height, pixels: rows.concat() }
}

/// Saturations a second of the scene, from 0.01 to 25.
fn radiance(x: f32, y: f32, channel: usize) -> f32 {
    let ball = (0.004 * x).sin() * (0.005 * y).sin();
    let texture = 0.15 * (0.11 * x + 0.07 * y).sin() * (0.05 * x - 0.09 * y).sin();
    let tint = [1.0, 0.8, 0.5][channel];
    0.5 * tint * (3.9 * (ball + texture).clamp(-1.0, 1.0)).exp()
}

fn jpeg(levels: &Image<[u8; 3]>) -> Result<Vec<u8>, EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, QUALITY);
    encoder.set_sampling_factor(SamplingFactor::F_2_1);
    encoder.encode(levels.pixels.as_flattened(), levels.width as u16, levels.height as u16, ColorType::Rgb)?;
    Ok(bytes)
}
