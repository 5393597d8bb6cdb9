//! How well a sample of one exposure tells a radiance.

use super::super::noise::SensorNoise;
use super::super::response::{LEVELS, Response, level_of, slope};
use super::{CLIPPED_LEVEL, LOWEST_LEVEL};

/// Trust in a frame fades from here to the clipped level, where the response is less and less certain. Were it cut off, noise
/// would choose among good samples.
pub(super) const FADING_LEVEL: f64 = 244.0;

/// It fades likewise from [`LOWEST_LEVEL`] to this one.
const DARKEST_LEVEL: f64 = 4.0;

/// Precision of one channel's samples.
pub(in crate::numerics::radiometry) struct Precision<'a> {
    log_exposure: &'a [f64],
    noise: &'a SensorNoise,
    level_variance: f64,
    saturation: f64,
    pub(super) times: Vec<f64>,
}

impl<'a> Precision<'a> {
    /// Of frames of these times (seconds); `level_variance` is what storing them added, levels squared.
    pub fn new(
        times: Vec<f64>,
        level_variance: f64,
        response: &'a Response,
        noise: &'a SensorNoise,
        channel: usize,
    ) -> Self {
        let log_exposure = &response.log_exposure[channel][..];
        Self { log_exposure, noise, level_variance, saturation: log_exposure[LEVELS - 1].exp(), times }
    }

    /// Exposure (radiance x seconds) of a level.
    pub fn exposure(&self, level: usize) -> f64 {
        self.log_exposure[level].exp()
    }

    /// The level that `frame` has of a radiance.
    pub fn level(&self, radiance: f64, frame: usize) -> f64 {
        level_of(self.log_exposure, (radiance * self.times[frame]).ln())
    }

    /// Inverse variance of the radiance that `frame` alone gives, times the trust in it; 0 where it is not to be used.
    pub fn of(&self, radiance: f64, frame: usize) -> f64 {
        let level = self.level(radiance, frame);
        let clipped = f64::from(CLIPPED_LEVEL);
        let bright = (clipped - level) / (clipped - FADING_LEVEL);
        let dark = (level - DARKEST_LEVEL) / (f64::from(LOWEST_LEVEL) - DARKEST_LEVEL);
        let trust = bright.min(dark).clamp(0.0, 1.0);
        let time = self.times[frame];
        trust * time * time / self.exposure_variance(radiance * time, level)
    }

    fn exposure_variance(&self, exposure: f64, level: f64) -> f64 {
        let per_level = exposure * slope(self.log_exposure, level);
        self.noise.exposure_variance(exposure, self.saturation) + self.level_variance * per_level * per_level
    }
}
