//! Charge and noise of the simulated sensor. Shares nothing with the recovery of responses.

use crate::numerics::image::Image;
use crate::sim::tone::Tone;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, Poisson, StandardNormal};

/// Level that radiance x seconds = 1 gives in every channel.
const UNIT_LEVEL: f64 = 128.0;
/// Steps of the table from charge to level.
const STEPS: usize = 1 << 16;
/// Above this many electrons the Poisson distribution is normal to the eye of an 8-bit file.
const POISSON_BELOW_E: f64 = 100.0;

pub(super) struct Sensor {
    full_well_e: f64,
    read_noise_e: f64,
    seed: u64,
    /// Full wells per unit of exposure, each channel.
    charge_per_exposure: [f64; 3],
    /// Level of a charge of step / STEPS, each channel.
    levels: [Vec<f32>; 3],
}

impl Sensor {
    pub(super) fn new(camera: &rig_config::Camera, tones: &[Tone; 3], seed: u64) -> Self {
        let table = |curve: &Tone| (0..=STEPS).map(|i| curve.level(i as f64 / STEPS as f64) as f32).collect();
        Self {
            full_well_e: camera.full_well_e,
            read_noise_e: camera.read_noise_e,
            seed,
            charge_per_exposure: tones.each_ref().map(|tone| tone.charge(UNIT_LEVEL)),
            levels: tones.each_ref().map(table),
        }
    }

    /// Exposes `radiance` for `time_s` and reads the levels out, not rounded: bodies count charge finer than files count levels.
    /// The noise depends on the seed and `frame_number` alone.
    pub(super) fn read_out(&self, radiance: &Image<[f64; 3]>, time_s: f64, frame_number: u32) -> Image<[f32; 3]> {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(self.seed.rotate_left(32) ^ u64::from(frame_number));
        let electrons_per_radiance = self.charge_per_exposure.map(|charge| charge * self.full_well_e * time_s);
        let pixels = radiance
            .pixels
            .iter()
            .map(|pixel| {
                std::array::from_fn(|c| {
                    let electrons = self.collect(pixel[c] * electrons_per_radiance[c], &mut random);
                    let charge = (electrons / self.full_well_e).clamp(0.0, 1.0);
                    self.levels[c][(charge * STEPS as f64).round() as usize]
                })
            })
            .collect();
        Image { width: radiance.width, height: radiance.height, pixels }
    }

    /// Photon noise, saturation of the well, read noise.
    fn collect(&self, mean_e: f64, random: &mut Xoshiro256PlusPlus) -> f64 {
        let mut normal = || -> f64 { StandardNormal.sample(random) };
        let read = self.read_noise_e * normal();
        let photons = if mean_e >= POISSON_BELOW_E {
            mean_e + mean_e.sqrt() * normal()
        } else {
            // No light, no photons: the distribution has no mean of zero.
            Poisson::new(mean_e).map_or(0.0, |photons| photons.sample(random))
        };
        photons.min(self.full_well_e) + read
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photon_and_read_noise_have_the_stated_variance() {
        let levels = [Vec::new(), Vec::new(), Vec::new()];
        let sensor =
            Sensor { full_well_e: 80_000.0, read_noise_e: 30.0, seed: 0, charge_per_exposure: [1.0; 3], levels };
        let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
        for mean in [0.0, 50.0, 99.0, 101.0, 5_000.0] {
            const N: usize = 40_000;
            let values: Vec<f64> = (0..N).map(|_| sensor.collect(mean, &mut random)).collect();
            let average = values.iter().sum::<f64>() / N as f64;
            let variance = values.iter().map(|v| (v - average).powi(2)).sum::<f64>() / N as f64;
            let expected = mean + 900.0;
            assert!((average - mean).abs() < 5.0 * (expected / N as f64).sqrt(), "{mean}: mean {average}");
            assert!((variance / expected - 1.0).abs() < 0.04, "{mean}: variance {variance}");
        }
    }
}
