//! Fitting a mixture of materials to radiance: observations, initialisation (paper 3.4-3.5), weights, solvers,
//! objectives (paper 3.6), quality and uncertainty.
//!
//! Model (paper Eq. 1-4): `I = sum_m gamma_m * l_c * cos(theta_i) * BRDF(alpha_m)`. All sums run over fixed chunks of
//! points in a fixed order, so that the result is the same to the bit at any number of threads.

pub mod albedo;
pub mod alpha;
pub mod bank;
pub mod directions;
pub mod folds;
pub mod gains;
pub mod gauge;
pub mod initialise;
pub mod kernel;
pub mod kmeans;
pub mod levmar;
pub mod loss;
pub mod normals;
pub mod objective;
pub mod observations;
pub mod prepared;
pub mod quality;
mod row;
pub mod sampling;
pub mod selection;
pub mod solver;
pub mod split;
pub mod twins;
pub mod uncertainty;
pub mod unknowns;
pub mod varpro;
pub mod weights;
pub mod zheng2008;

use super::brdf::{Lobe, Material};

/// Points handled by one task: large enough to amortise scheduling, fixed so that sums do not depend on the thread count.
pub(crate) const CHUNK: usize = 256;

/// Most materials a fit may have: the exact weight solve enumerates 2^M supports.
pub const MAX_MATERIALS: usize = 4;

/// Roughness is sought in this range: below it a lobe is narrower than a pixel, above it the lobe becomes a broad
/// correction of the diffuse term and the highlight is lost.
pub const BETA_RANGE: [f64; 2] = [0.01, 0.5];

/// A mixture: materials and, per point, their weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixture {
    /// BRDF parameters per material.
    pub materials: Vec<Material>,
    /// `gamma[point * materials + m]`, non-negative.
    pub gamma: Vec<f64>,
}

impl Mixture {
    /// Weights of one point.
    pub fn weights_of(&self, point: usize) -> &[f64] {
        let count = self.materials.len();
        &self.gamma[point * count..(point + 1) * count]
    }
}

/// Radiance per channel and unit weight that `material` sends from a sample (f_c of paper Eq. 3).
pub fn unit_radiance(lobe: &dyn Lobe, material: &Material, sample: &observations::Sample) -> [f64; 3] {
    let brdf = material.brdf(lobe, &sample.angles);
    std::array::from_fn(|c| sample.irradiance[c] * brdf[c])
}

/// Radiance per channel of a mixture (paper Eq. 1).
pub fn predict(lobe: &dyn Lobe, materials: &[Material], gamma: &[f64], sample: &observations::Sample) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (material, weight) in materials.iter().zip(gamma) {
        let unit = unit_radiance(lobe, material, sample);
        for c in 0..3 {
            sum[c] += weight * unit[c];
        }
    }
    sum
}
