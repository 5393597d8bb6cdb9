//! What a residual costs under an objective, sample by sample in f64, and the weighted least squares that stands for it:
//! Cauchy's function grows slower than its tangent parabola, so lowering that parabola lowers the cost (iteratively
//! reweighted least squares; Holland & Welsch 1977).

use super::kernel::{REWEIGHTINGS, SETTLED};
use super::objective::Objective;
use super::observations::{Observations, Sample};
use super::weights::{PointQuadratic, WeightRule};
use super::{CHUNK, MAX_MATERIALS, Mixture, predict};
use crate::numerics::brdf::{Lobe, Material};
use rayon::prelude::*;

/// An objective with Cauchy's scale in radiance units.
#[derive(Clone, Copy)]
pub struct Loss<'a> {
    lobe: &'a dyn Lobe,
    objective: Objective,
    /// Square of Cauchy's scale.
    scale2: Option<f64>,
}

impl<'a> Loss<'a> {
    /// The loss of `objective`; `brightness` is the root mean square radiance.
    pub fn new(lobe: &'a dyn Lobe, objective: Objective, brightness: f64) -> Self {
        Self { lobe, objective, scale2: objective.cauchy_scale(brightness).map(|scale| scale * scale) }
    }

    /// Cost of some samples of a point whose material weights are `gamma`.
    pub fn of(&self, materials: &[Material], gamma: &[f64], samples: impl IntoIterator<Item = Sample>) -> f64 {
        let mut cost = 0.0;
        for sample in samples {
            let model = predict(self.lobe, materials, gamma, &sample);
            let weights = self.objective.weights(&sample);
            for c in 0..3 {
                let square = weights[c] * (sample.radiance[c] - model[c]).powi(2);
                cost += self.scale2.map_or(square, |scale2| scale2 * (square / scale2).ln_1p());
            }
        }
        cost
    }

    /// Cost of a whole mixture.
    pub fn of_all(&self, observations: &Observations, mixture: &Mixture) -> f64 {
        let points: Vec<usize> = (0..observations.points()).collect();
        let of_point = |&p: &usize| self.of(&mixture.materials, mixture.weights_of(p), observations.of(p));
        let chunks: Vec<f64> = points.par_chunks(CHUNK).map(|chunk| chunk.iter().map(of_point).sum()).collect();
        chunks.iter().sum()
    }

    /// The sample with irradiance and radiance scaled so that its squared absolute residuals are the parabolas tangent to
    /// the loss at the present model.
    pub fn scaled(&self, materials: &[Material], gamma: &[f64], sample: &Sample) -> Sample {
        let model = predict(self.lobe, materials, gamma, sample);
        let weights = self.objective.weights(sample);
        let mut scaled = *sample;
        for c in 0..3 {
            let square = weights[c] * (sample.radiance[c] - model[c]).powi(2);
            let tangent = self.scale2.map_or(1.0, |scale2| 1.0 / (1.0 + square / scale2));
            let factor = (weights[c] * tangent).sqrt();
            scaled.irradiance[c] *= factor;
            scaled.radiance[c] *= factor;
        }
        scaled
    }

    /// [`Loss::scaled`] of all samples.
    pub fn reweighted(&self, observations: &Observations, mixture: &Mixture) -> Observations {
        let scale = |point, sample| Some(self.scaled(&mixture.materials, mixture.weights_of(point), &sample));
        observations.changed(0, scale).0
    }

    /// Non-negative weights of one point, exact for plain squares, after a few reweightings for Cauchy's function.
    pub fn weights(&self, materials: &[Material], samples: &[Sample]) -> [f64; MAX_MATERIALS] {
        let plain = Objective { cauchy: false, ..self.objective };
        let quadratic = PointQuadratic::new(self.lobe, materials, plain, samples.iter().copied());
        let mut gamma = quadratic.minimise(WeightRule::Exact);
        if self.scale2.is_some() {
            for _ in 0..REWEIGHTINGS {
                let scaled = samples.iter().map(|sample| self.scaled(materials, &gamma, sample));
                let quadratic = PointQuadratic::new(self.lobe, materials, Objective::ABSOLUTE, scaled);
                let before = gamma;
                gamma = quadratic.minimise(WeightRule::Exact);
                let sum: f64 = gamma.iter().sum();
                if gamma.iter().zip(before).all(|(now, before)| (now - before).abs() <= SETTLED * sum) {
                    break;
                }
            }
        }
        gamma
    }
}
