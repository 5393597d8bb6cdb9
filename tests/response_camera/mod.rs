//! A camera for the tests of response and exposure ratios: a shaded ball in the dark, photon and read noise, 12 bits, tone curves.
//! Written for the tests alone: it shares no formula with what it tests.
#![allow(dead_code, missing_docs, clippy::unwrap_used)]

use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rigd::numerics::image::Image;
use rigd::numerics::radiometry::bracket::{Bracket, Exposure};

/// Ten exposures like the paper's, 1/100 to 15 s, as thirds of a stop from 1 s, and what the dial says.
pub const THIRDS: [i32; 10] = [-20, -16, -12, -8, -4, 0, 3, 6, 9, 12];
pub const DIAL_S: [f64; 10] = [0.01, 0.025, 1.0 / 15.0, 1.0 / 6.0, 0.4, 1.0, 2.0, 4.0, 8.0, 15.0];
pub const FULL_WELL_E: f64 = 80_000.0;
pub const READ_NOISE_E: f64 = 30.0;
/// Saturation above black, 12-bit counts: 3692 - 128.
pub const COUNTS: f64 = 3564.0;
/// Share of the well that radiance 1 fills in a second.
const SPEED: f64 = 0.35;

/// A tone curve, a little different in each channel.
#[derive(Clone, Copy, Debug)]
pub enum Tone {
    /// IEC 61966-2-1: straight near black, then a power of 2.4.
    Srgb,
    /// A power of 2.2, 2.3 and 2.4: infinitely steep at black.
    Gamma,
    /// Shoulder, steep middle, soft toe, as a camera's standard picture style.
    SCurve,
}

pub const TONES: [Tone; 3] = [Tone::Srgb, Tone::Gamma, Tone::SCurve];

impl Tone {
    /// Level, 0 to 255, of a charge from 0 to 1 (full well).
    pub fn level(self, charge: f64, channel: usize) -> f64 {
        let q = charge.clamp(0.0, 1.0);
        let c = channel as f64;
        255.0
            * match self {
                Self::Srgb if q <= 0.003_130_8 => 12.92 * q,
                Self::Srgb => 1.055 * q.powf(1.0 / 2.4) - 0.055,
                Self::Gamma => q.powf(1.0 / (2.2 + 0.1 * c)),
                Self::SCurve => {
                    let shoulder = |x: f64| x * (1.0 + 0.15 * x) / (1.0 + x + 0.09 * x * x);
                    let t = (shoulder(3.2 * q) / shoulder(3.2)).powf(1.0 / (1.7 + 0.1 * c));
                    t + 0.25 * t * (1.0 - t) * (2.0 * t - 1.0)
                }
            }
    }

    /// The charge of a level.
    pub fn charge(self, level: f64, channel: usize) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.level(middle, channel) < level { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// The lowest level of a channel whose charge is ten times the noise of one sample: below, one sample says little.
    pub fn lowest_used(self, channel: usize) -> usize {
        let clear = |level: &usize| {
            let e = self.charge(*level as f64, channel) * FULL_WELL_E;
            e > 10.0 * (e + READ_NOISE_E.powi(2)).sqrt()
        };
        (10..128).find(clear).unwrap_or(128)
    }
}

pub struct Shoot {
    pub seed: u64,
    /// Relative scatter of the shutter about 2^(k/3).
    pub jitter: f64,
    /// True times instead of 2^(k/3), seconds.
    pub times_s: Option<Vec<f64>>,
    pub size: (usize, usize),
    /// Light that is everywhere, in units of radiance.
    pub ambient: f64,
    /// Counts at saturation.
    pub counts: f64,
}

/// Frames of one bracket: true times, and the charge of every pixel in 12-bit counts of full scale 1.
pub struct Shot {
    pub times_s: Vec<f64>,
    pub raw: Vec<Image<[f64; 3]>>,
}

/// Radiance of a ball with texture and a highlight in a nearly black room.
pub fn scene(size: (usize, usize), phase: f64) -> Image<[f64; 3]> {
    let (w, h) = size;
    let radius = 0.475 * w.min(h) as f64;
    let pixel = |i: usize| {
        let u = ((i % w) as f64 + 0.5 - w as f64 / 2.0) / radius;
        let v = ((i / w) as f64 + 0.5 - h as f64 / 2.0) / radius;
        let r2 = u * u + v * v;
        if r2 >= 1.0 {
            return [2e-4; 3];
        }
        let n = [u, v, (1.0 - r2).sqrt()];
        let dot = |a: [f64; 3]| a[0] * n[0] + a[1] * n[1] + a[2] * n[2];
        let lambert = dot([0.6, -0.2, 0.774_597]).max(0.0);
        let half = dot([0.318_5, -0.106_2, 0.941_97]).min(1.0);
        let lobe = 25.0 * (-(1.0 - half * half) / (half * half) / 0.01).exp();
        let texture = 0.6 + 0.4 * (7.0 * u + 3.0 * v * v + phase).sin() * (5.0 * v).cos();
        [0.5, 0.35, 0.25].map(|albedo| 2e-4 + lambert * (texture * albedo + lobe))
    };
    Image { width: w, height: h, pixels: (0..w * h).map(pixel).collect() }
}

impl Shoot {
    pub fn new(seed: u64) -> Self {
        Self { seed, jitter: 0.0, times_s: None, size: (240, 160), ambient: 0.0, counts: COUNTS }
    }

    pub fn shot(&self) -> Shot {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(self.seed);
        let normal = |random: &mut Xoshiro256PlusPlus| -> f64 { StandardNormal.sample(random) };
        let scene = scene(self.size, random.random::<f64>() * std::f64::consts::TAU);
        let time = |k: &i32| 2_f64.powf(f64::from(*k) / 3.0);
        let aimed: Vec<f64> = THIRDS.iter().map(time).collect();
        let shutter = self.times_s.as_ref().unwrap_or(&aimed).iter();
        let times_s: Vec<f64> = shutter.map(|t| t * (self.jitter * normal(&mut random)).exp()).collect();
        let raw = times_s
            .iter()
            .map(|t| {
                let expose = |pixel: &[f64; 3]| {
                    pixel.map(|radiance| {
                        let mean = (radiance + self.ambient) * t * SPEED * FULL_WELL_E;
                        let photons = (mean + mean.sqrt() * normal(&mut random)).clamp(0.0, FULL_WELL_E);
                        let electrons = photons + READ_NOISE_E * normal(&mut random);
                        (electrons / FULL_WELL_E * self.counts).round() / self.counts
                    })
                };
                Image { width: scene.width, height: scene.height, pixels: scene.pixels.iter().map(expose).collect() }
            })
            .collect();
        Shot { times_s, raw }
    }
}

impl Shot {
    /// The frames as 8-bit pictures, listed with the times the shutter aims at.
    pub fn bracket(&self, tone: Tone) -> Bracket {
        Bracket::new(self.exposures(tone), [1.0 / 12.0; 3]).unwrap()
    }

    pub fn exposures(&self, tone: Tone) -> Vec<Exposure> {
        let frame = |(i, raw): (usize, &Image<[f64; 3]>)| {
            let levels = |pixel: &[f64; 3]| std::array::from_fn(|c| tone.level(pixel[c], c).round() as u8);
            Exposure {
                name: format!("frame {i}"),
                levels: Image { width: raw.width, height: raw.height, pixels: raw.pixels.iter().map(levels).collect() },
                time_s: 2_f64.powf(f64::from(THIRDS[i]) / 3.0),
            }
        };
        self.raw.iter().enumerate().map(frame).collect()
    }

    /// `[channel][frame][point]`.
    pub fn linear(&self) -> Vec<Vec<Vec<f32>>> {
        let of = |c: usize| self.raw.iter().map(|raw| raw.pixels.iter().map(|p| p[c] as f32).collect()).collect();
        (0..3).map(of).collect()
    }
}
