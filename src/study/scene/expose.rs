//! Radiance of every sample: the forward model, then everything that goes wrong on the way to the fit.

use super::stage::{ARC_MM, Stage, StageLight, StagePoint, lit};
use super::{Scene, UNSEEN_COSINE_CUTOFF, Unseen};
use crate::numerics::fit::directions::azimuth;
use crate::numerics::fit::observations::{HIGHLIGHT_HALF_ANGLE, Observations, Sample};
use crate::study::forward::reflect;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;

/// Irradiance on a surface that faces a light from 600 mm: white Lambert has radiance 1 there.
const IRRADIANCE: f64 = PI;

/// Largest factor by which an outlier is wrong.
const OUTLIER_FACTOR: f64 = 3.0;

/// Saturation of the sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clipping {
    /// Largest radiance, in medians of the scene's radiance.
    pub at_medians: f64,
    /// True when clipped values are taken as measured; otherwise such samples are dropped and counted as unusable.
    pub kept: bool,
}

/// Noise-free radiance of a point under a light, gain included.
fn radiance(scene: &Scene, point: &StagePoint, gamma: &[f64], light: &StageLight) -> [f64; 3] {
    let path = light.position - point.position;
    let to_light = path.normalize();
    let received =
        light.gain * IRRADIANCE * ARC_MM * ARC_MM / path.norm_squared() * point.normal.dot(&to_light).max(0.0);
    let mut sum = [0.0; 3];
    for (material, weight) in scene.materials.iter().zip(gamma) {
        let brdf = reflect(scene.reflectance, material, &point.normal, &to_light, &point.to_view);
        for c in 0..3 {
            sum[c] += weight * received * brdf[c];
        }
    }
    sum
}

/// A sample as the fit believes it to be seen, without its variance.
fn sample(scene: &Scene, point: &StagePoint, light: usize, assumed: &Vector3<f64>, radiance: [f64; 3]) -> Sample {
    let angles = point.angles(assumed);
    let distance = if scene.distance_ignored { ARC_MM } else { (assumed - point.position).norm() };
    let irradiance = [IRRADIANCE * (ARC_MM / distance).powi(2) * angles.cos_i; 3];
    Sample { light, angles, irradiance, radiance, variance: [0.0; 3] }
}

/// The observations, and which of the stage's points they hold.
pub fn expose(scene: &Scene, stage: &Stage, gamma: &[f64], seed: u64) -> (Observations, Vec<usize>) {
    let sound = sound_samples(scene, stage, gamma);
    let mut all: Vec<f64> = sound.iter().flatten().flat_map(|s| s.radiance).collect();
    all.sort_by(f64::total_cmp);
    let median = all.get(all.len() / 2).copied().unwrap_or(0.0);
    let mut rng = StdRng::seed_from_u64(seed ^ 0x5e_4507);
    let mut observations = Observations::new(stage.lights.len());
    let mut kept = Vec::new();
    for (index, samples) in sound.into_iter().enumerate() {
        let mut usable = Vec::new();
        for mut sample in samples {
            if disturb(scene, median, &mut sample, &mut rng) {
                usable.push(sample);
            } else {
                observations.unusable += 1;
                observations.unusable_highlight += usize::from(sample.angles.half_angle() < HIGHLIGHT_HALF_ANGLE);
            }
        }
        if usable.len() >= stage.least_lights {
            observations.push(stage.points[index].pixel, &usable);
            kept.push(index);
        }
    }
    observations.set_azimuths(|point, sample| {
        let (place, light) = (&stage.points[kept[point]], &stage.lights[sample.light]);
        azimuth(&place.normal, &(light.assumed - place.position).normalize(), &place.to_view)
    });
    (observations, kept)
}

/// Per point, its samples without noise.
fn sound_samples(scene: &Scene, stage: &Stage, gamma: &[f64]) -> Vec<Vec<Sample>> {
    let count = scene.materials.len();
    let of_point = |(index, point): (usize, &StagePoint)| {
        let weights = &gamma[index * count..(index + 1) * count];
        let seen = stage.lights.iter().enumerate();
        seen.filter(|(_, light)| lit(&point.angles(&light.assumed), scene.cosine_cutoff))
            .map(|(at, light)| sample(scene, point, at, &light.assumed, radiance(scene, point, weights, light)))
            .collect()
    };
    stage.points.iter().enumerate().map(of_point).collect()
}

/// Adds outlier, noise and clipping; false when nothing usable is left. Draws the same numbers whatever the scene.
fn disturb(scene: &Scene, median: f64, sample: &mut Sample, rng: &mut StdRng) -> bool {
    let outlier = rng.random_range(0.0..1.0) < scene.outliers;
    let factor = OUTLIER_FACTOR.powf(rng.random_range(-1.0..1.0));
    let floor = scene.floor * median;
    let limit = scene.clipping.map_or(f64::INFINITY, |clipping| clipping.at_medians * median);
    let mut clipped = false;
    for c in 0..3 {
        let (relative, additive): (f64, f64) = (StandardNormal.sample(rng), StandardNormal.sample(rng));
        let wrong = if outlier { factor } else { 1.0 };
        let value = sample.radiance[c] * wrong * (1.0 + scene.noise * relative) + floor * additive;
        clipped |= value > limit;
        sample.radiance[c] = value.min(limit);
        if scene.variance_known {
            sample.variance[c] = (scene.noise * sample.radiance[c]).powi(2) + floor * floor;
        }
    }
    let dropped = clipped && scene.clipping.is_some_and(|clipping| !clipping.kept);
    !dropped && sample.radiance.iter().all(|&value| value > 0.0)
}

/// Noise-free samples of the kept points under the unseen lights, whose positions are known exactly.
pub fn unseen(scene: &Scene, stage: &Stage, gamma: &[f64], kept: &[usize]) -> Vec<Unseen> {
    let count = scene.materials.len();
    let mut all = Vec::new();
    for (point, &index) in kept.iter().enumerate() {
        let place = &stage.points[index];
        let weights = &gamma[index * count..(index + 1) * count];
        for (at, light) in stage.unseen.iter().enumerate() {
            if lit(&place.angles(&light.position), UNSEEN_COSINE_CUTOFF) {
                let truth = radiance(scene, place, weights, light);
                all.push(Unseen { point, sample: sample(scene, place, at, &light.position, truth) });
            }
        }
    }
    all
}
