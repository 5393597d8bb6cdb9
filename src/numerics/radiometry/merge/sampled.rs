//! Estimators whose weights depend on the level alone: sums of look-ups over all open frames.

use super::super::bracket::Bracket;
use super::super::noise::SensorNoise;
use super::super::response::{LEVELS, Response, slope};
use super::{CLIPPED_LEVEL, Estimator, Method, Out, usable};
use crate::numerics::simd::Level;

/// What a level of a frame adds to the three sums of a pixel.
#[derive(Clone, Copy, Default)]
struct Terms {
    /// Weight times what is averaged.
    weighted: f64,
    weight: f64,
    /// Squared weight times the variance of what is averaged.
    variance: f64,
}

/// Tables by channel and frame.
pub(super) struct Sampled {
    terms: [Vec<[Terms; LEVELS]>; 3],
    /// Logarithms are averaged.
    logarithmic: bool,
    /// Least radiance known of a pixel that is clipped in every frame, by channel.
    bound: [f64; 3],
}

impl Method for Sampled {
    fn merge(&self, _: Level, bracket: &Bracket, from: usize, into: &mut Out<'_>) {
        let out = into.radiance.iter_mut().zip(into.variance.iter_mut()).zip(into.valid.iter_mut());
        for (pixel, ((radiance, variance), valid)) in (from..).zip(out) {
            *valid = true;
            for c in 0..3 {
                let (value, of, usable) = self.estimate(bracket, pixel, c);
                (radiance[c], variance[c]) = (value as f32, of as f32);
                *valid &= usable;
            }
        }
    }
}

impl Sampled {
    pub fn new(estimator: Estimator, bracket: &Bracket, response: &Response, noise: &SensorNoise) -> Self {
        let times: Vec<f64> = bracket.exposures().iter().map(|frame| frame.time_s).collect();
        let table = |c: usize| {
            let curve = &response.log_exposure[c];
            let level_variance = bracket.level_variance()[c];
            let terms = |time: &f64| std::array::from_fn(|z| terms(estimator, curve, noise, level_variance, *time, z));
            times.iter().map(terms).collect()
        };
        let bound = |c: usize| response.log_exposure[c][usize::from(CLIPPED_LEVEL)].exp() / times[0];
        Self {
            terms: std::array::from_fn(table),
            logarithmic: estimator == Estimator::Debevec,
            bound: std::array::from_fn(bound),
        }
    }

    /// Radiance, its variance, and whether it is usable.
    fn estimate(&self, bracket: &Bracket, pixel: usize, c: usize) -> (f64, f64, bool) {
        let mut sums = Terms::default();
        let (mut open, mut level) = (0, 0);
        for (frame, terms) in bracket.exposures().iter().zip(&self.terms[c]) {
            let next = frame.levels.pixels[pixel][c];
            if next >= CLIPPED_LEVEL {
                break;
            }
            let terms = &terms[usize::from(next)];
            sums.weighted += terms.weighted;
            sums.weight += terms.weight;
            sums.variance += terms.variance;
            (open, level) = (open + 1, next);
        }
        if open == 0 {
            return (self.bound[c], self.bound[c].powi(2), false);
        }
        if sums.weight == 0.0 {
            return (0.0, 0.0, false);
        }
        let (mean, variance) = (sums.weighted / sums.weight, sums.variance / sums.weight.powi(2));
        let (value, variance) =
            if self.logarithmic { (mean.exp(), variance * (2.0 * mean).exp()) } else { (mean, variance) };
        let usable = usable(open, level);
        (value, if usable { variance } else { value * value }, usable)
    }
}

fn terms(estimator: Estimator, curve: &[f64], noise: &SensorNoise, level_variance: f64, time: f64, z: usize) -> Terms {
    let (level, exposure) = (z as f64, curve[z].exp());
    let per_level = exposure * slope(curve, level);
    let variance = noise.exposure_variance(exposure, curve[LEVELS - 1].exp()) + level_variance * per_level * per_level;
    let linear = |weight: f64| Terms {
        weighted: weight * exposure / time,
        weight,
        variance: (weight / time).powi(2) * variance,
    };
    match estimator {
        Estimator::InverseVariance => linear(time * time / variance),
        Estimator::Poisson => linear(time),
        Estimator::Robertson => linear(gaussian(level) * time * time),
        Estimator::Debevec => {
            let weight = level.min(255.0 - level);
            let relative = variance / (exposure * exposure);
            Terms { weighted: weight * (curve[z] - time.ln()), weight, variance: weight * weight * relative }
        }
    }
}

/// Robertson's weight of a level: a Gaussian about the middle, brought to 0 at both ends and 1 in the middle.
fn gaussian(level: f64) -> f64 {
    let at = |level: f64| (-4.0 * ((level - 127.5) / 127.5).powi(2)).exp();
    (at(level) - at(0.0)) / (1.0 - at(0.0))
}
