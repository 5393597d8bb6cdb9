//! How good a fit is: relative errors over all, highlight and left-out samples, and chi^2 against the noise.

use super::objective::noise_weights;
use super::observations::{HIGHLIGHT_HALF_ANGLE, Observations, Sample};
use super::{CHUNK, Mixture, predict};
use crate::numerics::brdf::Lobe;
use rayon::prelude::*;

/// Errors of a mixture on some observations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Mean of |I - model| / I over samples and channels.
    pub mean_relative_error: f64,
    /// The same over samples with a half angle below 6 degrees; none where there is no such sample.
    pub highlight_relative_error: Option<f64>,
    /// Sum of squared residuals over their noise-and-floor variance.
    pub chi2: f64,
}

/// Sums over samples.
#[derive(Clone, Copy, Default)]
struct Sums {
    relative: f64,
    samples: f64,
    highlight: f64,
    highlights: f64,
    chi2: f64,
}

impl Sums {
    fn add(&mut self, sample: &Sample, model: [f64; 3]) {
        let weights = noise_weights(sample);
        let mut relative = 0.0;
        for c in 0..3 {
            let residual = sample.radiance[c] - model[c];
            relative += residual.abs() / sample.radiance[c] / 3.0;
            self.chi2 += weights[c] * residual * residual;
        }
        self.relative += relative;
        self.samples += 1.0;
        if sample.angles.half_angle() < HIGHLIGHT_HALF_ANGLE {
            self.highlight += relative;
            self.highlights += 1.0;
        }
    }

    fn join(mut self, other: &Self) -> Self {
        self.relative += other.relative;
        self.samples += other.samples;
        self.highlight += other.highlight;
        self.highlights += other.highlights;
        self.chi2 += other.chi2;
        self
    }
}

/// Errors of `mixture` on the samples whose light `judged` accepts. None when there is no such sample.
/// `point_of` gives, for each point of `observations`, its point in the mixture, if it has one.
pub fn judge(
    lobe: &dyn Lobe,
    mixture: &Mixture,
    observations: &Observations,
    point_of: impl Fn(usize) -> Option<usize> + Sync,
    judged: impl Fn(usize) -> bool + Sync,
) -> Option<Quality> {
    let [sums] = grouped(lobe, mixture, observations, point_of, |light| judged(light).then_some(0), 1)[..] else {
        return None;
    };
    (sums.samples > 0.0).then(|| Quality {
        mean_relative_error: sums.relative / sums.samples,
        highlight_relative_error: (sums.highlights > 0.0).then(|| sums.highlight / sums.highlights),
        chi2: sums.chi2,
    })
}

/// Sums of each group of lights, of `groups` in all; samples of a light without one are passed over.
fn grouped(
    lobe: &dyn Lobe,
    mixture: &Mixture,
    observations: &Observations,
    point_of: impl Fn(usize) -> Option<usize> + Sync,
    group_of: impl Fn(usize) -> Option<usize> + Sync,
    groups: usize,
) -> Vec<Sums> {
    let points = observations.points();
    let partial: Vec<Vec<Sums>> = (0..points.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let mut sums = vec![Sums::default(); groups];
            for point in chunk * CHUNK..((chunk + 1) * CHUNK).min(points) {
                let Some(known) = point_of(point) else { continue };
                for sample in observations.of(point) {
                    let Some(group) = group_of(sample.light) else { continue };
                    sums[group].add(&sample, predict(lobe, &mixture.materials, mixture.weights_of(known), &sample));
                }
            }
            sums
        })
        .collect();
    partial.iter().fold(vec![Sums::default(); groups], |all, chunk| {
        all.into_iter().zip(chunk).map(|(sums, more)| sums.join(more)).collect()
    })
}

/// What a mixture says of each of `lights` lights: its samples, and the mean of |I - model| / I over them and the channels; none where
/// there is no sample. `point_of` as for [`judge`].
pub fn judge_lights(
    lobe: &dyn Lobe,
    mixture: &Mixture,
    observations: &Observations,
    point_of: impl Fn(usize) -> Option<usize> + Sync,
    lights: usize,
) -> Vec<(usize, Option<f64>)> {
    let each = grouped(lobe, mixture, observations, point_of, Some, lights);
    each.iter()
        .map(|sums| (sums.samples as usize, (sums.samples > 0.0).then(|| sums.relative / sums.samples)))
        .collect()
}

/// Errors on every sample the mixture was fitted to.
pub fn judge_all(lobe: &dyn Lobe, mixture: &Mixture, observations: &Observations) -> Option<Quality> {
    judge(lobe, mixture, observations, Some, |_| true)
}

/// Errors of a mixture that was fitted to `kept` points (indices into `observations`, ascending) on the lights it never saw.
pub fn judge_left_out(
    lobe: &dyn Lobe,
    mixture: &Mixture,
    observations: &Observations,
    kept: &[usize],
    left_out: impl Fn(usize) -> bool + Sync,
) -> Option<Quality> {
    judge(lobe, mixture, observations, |point| kept.binary_search(&point).ok(), left_out)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::observations::tests::synthetic;

    /// Observations are kept in f32.
    const F32: f64 = 1e-7;

    /// Measured radiance 4 % above the model everywhere: |I - model| / I is 0.04 / 1.04 on every sample.
    #[test]
    fn a_uniform_offset_gives_its_relative_error() {
        let (clean, mixture) = synthetic(50, 2, 21);
        let brighter = |sample: Sample| Sample { radiance: sample.radiance.map(|i| 1.04 * i), ..sample };
        let (observations, _) = clean.changed(1, |_, sample| Some(brighter(sample)));
        let quality = judge_all(&Ward, &mixture, &observations).unwrap();
        assert!((quality.mean_relative_error - 0.04 / 1.04).abs() < F32);
        assert!((quality.highlight_relative_error.unwrap_or(0.0) - 0.04 / 1.04).abs() < F32);
        assert!(judge(&Ward, &mixture, &observations, Some, |light| light == 99).is_none());
    }

    /// One light is brighter than the model by a known factor, one has no sample; the others fit.
    #[test]
    fn each_light_has_its_own_error() {
        let (clean, mixture) = synthetic(50, 2, 21);
        let changed = |_, sample: Sample| match sample.light {
            1 => Some(Sample { radiance: sample.radiance.map(|i| 1.25 * i), ..sample }),
            2 => None,
            _ => Some(sample),
        };
        let (observations, _) = clean.changed(1, changed);
        let lights = 1 + clean.all().map(|sample| sample.light).max().unwrap();
        let each = judge_lights(&Ward, &mixture, &observations, Some, lights);
        for (light, (samples, error)) in each.iter().enumerate() {
            assert_eq!(*samples, observations.all().filter(|sample| sample.light == light).count());
            match light {
                1 => assert!((error.unwrap() - 0.2).abs() < F32),
                2 => assert_eq!(*error, None),
                _ => assert!(error.unwrap() < F32),
            }
        }
    }
}
