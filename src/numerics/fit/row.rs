//! How samples lie in memory: those of sixteen points side by side, in f32.

use crate::numerics::geometry::Angles;
use crate::numerics::simd::{LANES, Lane};

/// Most lights observations can tell apart: rows number them in 16 bits.
pub const MAX_LIGHTS: usize = u16::MAX as usize;

/// One point under one light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Index of the light.
    pub light: usize,
    /// The sample's angles.
    pub angles: Angles,
    /// Irradiance on the surface per channel: l_c cos(theta_i), with fall-off.
    pub irradiance: [f64; 3],
    /// Measured radiance per channel, positive.
    pub radiance: [f64; 3],
    /// Variance of the radiance per channel; 0 where unknown.
    pub variance: [f64; 3],
}

/// Radiances and irradiances that fits can use, and the greatest ratio of the two: their squares are kept in f32.
const USABLE: [f64; 2] = [1e-15, 1e15];
const GREATEST_RATIO: f64 = 1e12;

impl Sample {
    /// Why a fit cannot use it, if so: it must be positive and finite, and nothing so large or small that f32 cannot square it.
    pub fn fault(&self) -> Option<&'static str> {
        let within = |value: &f64| (USABLE[0]..=USABLE[1]).contains(value);
        let ratio = |c: usize| self.radiance[c] / self.irradiance[c];
        let angles = &self.angles;
        let cosine = |value: f64| value > 0.0 && value <= 1.0 + 1e-6;
        let checks = [
            (self.radiance.iter().all(within), "its radiance must be from 1e-15 to 1e15 in every channel"),
            (self.irradiance.iter().all(within), "its irradiance must be from 1e-15 to 1e15 in every channel"),
            (
                (0..3).all(|c| (1.0 / GREATEST_RATIO..=GREATEST_RATIO).contains(&ratio(c))),
                "its radiance and irradiance must be within a factor of 1e12",
            ),
            (
                self.variance.iter().all(|variance| (0.0..=USABLE[1] * USABLE[1]).contains(variance)),
                "its variance must be from 0 to 1e30 in every channel",
            ),
            (cosine(angles.cos_i) && cosine(angles.cos_r), "its cosines must be above 0 and at most 1"),
            (
                (0.0..f64::INFINITY).contains(&angles.tan2_half) && angles.cos_iv.is_finite(),
                "the angles between light, normal and view must be finite",
            ),
        ];
        checks.into_iter().find(|(holds, _)| !holds).map(|(_, rule)| rule)
    }

    /// True when a fit can use it.
    pub fn usable(&self) -> bool {
        self.fault().is_none()
    }
}

/// One sample of each of [`LANES`] points that stand side by side; zeros where a point has no more samples.
///
/// Kept in f32: rounding is 6e-8 of a value, measured radiance is not known to better than 1e-3.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub struct Row {
    /// tan^2 of the half angle.
    pub tan2_half: Lane,
    /// Cosine between normal and light; 1 where there is no sample.
    pub cos_i: Lane,
    /// Cosine between normal and view; 1 where there is no sample.
    pub cos_r: Lane,
    /// Cosine between light and view.
    pub cos_iv: Lane,
    /// Irradiance on the surface per channel.
    pub irradiance: [Lane; 3],
    /// Measured radiance per channel.
    pub radiance: [Lane; 3],
    /// Variance of the radiance per channel; 0 where unknown.
    pub variance: [Lane; 3],
    /// Index of the light.
    pub light: [u16; LANES],
}

impl Row {
    pub(super) const EMPTY: Self = Self {
        tan2_half: [0.0; LANES],
        cos_i: [1.0; LANES],
        cos_r: [1.0; LANES],
        cos_iv: [1.0; LANES],
        irradiance: [[0.0; LANES]; 3],
        radiance: [[0.0; LANES]; 3],
        variance: [[0.0; LANES]; 3],
        light: [0; LANES],
    };

    /// Angles of one lane.
    pub fn angles(&self, lane: usize) -> Angles {
        Angles {
            cos_i: f64::from(self.cos_i[lane]),
            cos_r: f64::from(self.cos_r[lane]),
            tan2_half: f64::from(self.tan2_half[lane]),
            cos_iv: f64::from(self.cos_iv[lane]),
        }
    }

    pub(super) fn get(&self, lane: usize) -> Sample {
        let rgb = |lanes: &[Lane; 3]| std::array::from_fn(|c| f64::from(lanes[c][lane]));
        Sample {
            light: usize::from(self.light[lane]),
            angles: self.angles(lane),
            irradiance: rgb(&self.irradiance),
            radiance: rgb(&self.radiance),
            variance: rgb(&self.variance),
        }
    }

    /// Takes over one lane of another row.
    pub(super) fn copy(&mut self, lane: usize, source: &Self, from: usize) {
        self.light[lane] = source.light[from];
        self.tan2_half[lane] = source.tan2_half[from];
        self.cos_i[lane] = source.cos_i[from];
        self.cos_r[lane] = source.cos_r[from];
        self.cos_iv[lane] = source.cos_iv[from];
        for c in 0..3 {
            self.irradiance[c][lane] = source.irradiance[c][from];
            self.radiance[c][lane] = source.radiance[c][from];
            self.variance[c][lane] = source.variance[c][from];
        }
    }

    pub(super) fn set(&mut self, lane: usize, sample: &Sample) {
        // More than [`MAX_LIGHTS`] are refused before anything is gathered.
        self.light[lane] = u16::try_from(sample.light).unwrap_or(u16::MAX);
        self.tan2_half[lane] = sample.angles.tan2_half as f32;
        self.cos_i[lane] = sample.angles.cos_i as f32;
        self.cos_r[lane] = sample.angles.cos_r as f32;
        self.cos_iv[lane] = sample.angles.cos_iv as f32;
        for c in 0..3 {
            self.irradiance[c][lane] = sample.irradiance[c] as f32;
            self.radiance[c][lane] = sample.radiance[c] as f32;
            self.variance[c][lane] = sample.variance[c] as f32;
        }
    }
}
