//! Standard errors (METHOD 8): the weights are eliminated point by point (Schur complement of the normal matrix), what is
//! left is inverted and scaled by the reduced chi^2 of the fit.
//!
//! The gauge is the normal form's: the weight that equals 1 at the point of greatest weight of each material is no unknown.

use super::alpha::{Basis, Layout, PER_CHANNEL, derivatives};
use super::objective::Objective;
use super::observations::Observations;
use super::{CHUNK, MAX_MATERIALS, Mixture};
use crate::numerics::brdf::Lobe;
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Standard errors of everything that was fitted.
#[derive(Clone, Debug)]
pub struct Uncertainty {
    /// Per unknown in the order of [`Layout`]; none for one that stands at a bound or that the data leave free.
    pub alpha: Vec<Option<f64>>,
    /// Per weight, as `Mixture::gamma`, for fixed BRDF parameters; 0 for a weight held at zero.
    pub gamma: Vec<f64>,
    /// Sum of weighted squared residuals over degrees of freedom.
    pub reduced_cost: f64,
}

/// Contribution of some points.
struct Partial {
    schur: DMatrix<f64>,
    gamma: Vec<f64>,
    cost: f64,
    channels: usize,
    free_weights: usize,
}

/// Standard errors of a mixture in normal form.
pub fn uncertainty(
    lobe: &dyn Lobe,
    mixture: &Mixture,
    objective: Objective,
    observations: &Observations,
) -> Uncertainty {
    let layout = Layout::new(lobe, mixture.materials.len());
    let pinned = pinned_points(mixture);
    let points = observations.points();
    let partials: Vec<Partial> = (0..points.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let range = chunk * CHUNK..((chunk + 1) * CHUNK).min(points);
            eliminate(lobe, mixture, objective, observations, layout, &pinned, range)
        })
        .collect();
    let n = layout.unknowns();
    let mut schur = DMatrix::zeros(n, n);
    let (mut gamma, mut cost, mut channels, mut free) = (Vec::new(), 0.0, 0, n);
    for partial in partials {
        schur += partial.schur;
        gamma.extend(partial.gamma);
        cost += partial.cost;
        channels += partial.channels;
        free += partial.free_weights;
    }
    let reduced_cost = cost / channels.saturating_sub(free).max(1) as f64;
    let scale = reduced_cost.sqrt();
    gamma.iter_mut().for_each(|sigma| *sigma *= scale);
    let alpha = standard_errors(&schur, &at_bound(layout, mixture), scale);
    Uncertainty { alpha, gamma, reduced_cost }
}

/// Per material, the point whose weight is the gauge.
fn pinned_points(mixture: &Mixture) -> Vec<usize> {
    let count = mixture.materials.len();
    let points = mixture.gamma.len() / count.max(1);
    (0..count)
        .map(|m| {
            (0..points)
                .max_by(|&a, &b| mixture.gamma[a * count + m].total_cmp(&mixture.gamma[b * count + m]).then(b.cmp(&a)))
                .unwrap_or(0)
        })
        .collect()
}

/// True for unknowns that stand at a bound: they did not move with the data, so they have no standard error.
fn at_bound(layout: Layout, mixture: &Mixture) -> Vec<bool> {
    let x = layout.pack(&mixture.materials);
    let bounds = layout.bounds(&mixture.materials);
    // No bound is an infinite one, and everything would be near that.
    let near = |a: f64, b: f64| b.is_finite() && (a - b).abs() <= 1e-6 * b.abs();
    (0..x.len()).map(|i| near(x[i], bounds.lower[i]) || near(x[i], bounds.upper[i])).collect()
}

/// Square roots of the diagonal of the inverse, over the unknowns not at a bound, in units of each unknown's own scale.
fn standard_errors(schur: &DMatrix<f64>, fixed: &[bool], scale: f64) -> Vec<Option<f64>> {
    let free: Vec<usize> = (0..fixed.len()).filter(|&i| !fixed[i] && schur[(i, i)] > 0.0).collect();
    if free.is_empty() {
        return vec![None; fixed.len()];
    }
    let d: Vec<f64> = free.iter().map(|&i| schur[(i, i)].sqrt()).collect();
    let scaled = DMatrix::from_fn(free.len(), free.len(), |i, j| schur[(free[i], free[j])] / (d[i] * d[j]));
    let mut errors = vec![None; fixed.len()];
    let eigen = scaled.symmetric_eigen();
    for (i, &unknown) in free.iter().enumerate() {
        let mut variance = 0.0;
        for (k, &value) in eigen.eigenvalues.iter().enumerate() {
            variance += eigen.eigenvectors[(i, k)].powi(2) / value.max(1e-12);
        }
        let sigma = variance.sqrt() / d[i] * scale;
        errors[unknown] = sigma.is_finite().then_some(sigma);
    }
    errors
}

fn eliminate(
    lobe: &dyn Lobe,
    mixture: &Mixture,
    objective: Objective,
    observations: &Observations,
    layout: Layout,
    pinned: &[usize],
    points: std::ops::Range<usize>,
) -> Partial {
    let n = layout.unknowns();
    let count = mixture.materials.len();
    let mut partial =
        Partial { schur: DMatrix::zeros(n, n), gamma: Vec::new(), cost: 0.0, channels: 0, free_weights: 0 };
    for point in points {
        let gamma = mixture.weights_of(point);
        let free: Vec<usize> = (0..count).filter(|&m| gamma[m] > 0.0 && pinned[m] != point).collect();
        let mut coupling = DMatrix::zeros(n, free.len());
        let mut block = DMatrix::zeros(free.len(), free.len());
        for sample in observations.of(point) {
            let w = objective.weights(&sample);
            let mut bases = [Basis::default(); MAX_MATERIALS];
            for (basis, material) in bases.iter_mut().zip(&mixture.materials) {
                (basis.lobe, basis.slope) = lobe.value_and_slope(&sample.angles, material.beta);
            }
            for c in 0..3 {
                let row = Row::new(layout, mixture, &bases, gamma, sample.irradiance[c], c);
                let residual = sample.radiance[c] - row.model;
                partial.cost += w[c] * residual * residual;
                partial.channels += 1;
                row.add(w[c], &free, &mut partial.schur, &mut coupling, &mut block);
            }
        }
        partial.free_weights += free.len();
        let inverse = pseudo_inverse(block);
        partial.schur -= &coupling * &inverse * coupling.transpose();
        partial.gamma.extend(
            (0..count).map(|m| free.iter().position(|&f| f == m).map_or(0.0, |k| inverse[(k, k)].max(0.0).sqrt())),
        );
    }
    partial
}

/// Derivatives of one channel of one sample.
struct Row {
    model: f64,
    /// Unknown and derivative by it.
    alpha: [(usize, f64); PER_CHANNEL * MAX_MATERIALS],
    alphas: usize,
    /// Derivative by the weight of each material.
    gamma: [f64; MAX_MATERIALS],
}

impl Row {
    fn new(layout: Layout, mixture: &Mixture, bases: &[Basis], gamma: &[f64], irradiance: f64, channel: usize) -> Self {
        let mut row =
            Self { model: 0.0, alpha: [(0, 0.0); PER_CHANNEL * MAX_MATERIALS], alphas: 0, gamma: [0.0; MAX_MATERIALS] };
        for (m, material) in mixture.materials.iter().enumerate() {
            let d = derivatives(material, &bases[m], irradiance, channel);
            row.gamma[m] = d[0] * material.rho_d[channel] + d[1] * material.rho_s[channel];
            row.model += gamma[m] * row.gamma[m];
            for (index, value) in layout.of_channel(m, channel).into_iter().zip(d) {
                if let Some(index) = index {
                    row.alpha[row.alphas] = (index, gamma[m] * value);
                    row.alphas += 1;
                }
            }
        }
        row
    }

    fn add(
        &self,
        w: f64,
        free: &[usize],
        schur: &mut DMatrix<f64>,
        coupling: &mut DMatrix<f64>,
        block: &mut DMatrix<f64>,
    ) {
        let alpha = &self.alpha[..self.alphas];
        for &(i, a) in alpha {
            for &(j, b) in alpha {
                schur[(i, j)] += w * a * b;
            }
            for (k, &m) in free.iter().enumerate() {
                coupling[(i, k)] += w * a * self.gamma[m];
            }
        }
        for (k, &m) in free.iter().enumerate() {
            for (l, &o) in free.iter().enumerate() {
                block[(k, l)] += w * self.gamma[m] * self.gamma[o];
            }
        }
    }
}

/// Inverse of a small symmetric block; directions the samples do not see contribute nothing.
fn pseudo_inverse(block: DMatrix<f64>) -> DMatrix<f64> {
    let n = block.nrows();
    if n == 0 {
        return block;
    }
    let tolerance = 1e-13 * block.trace();
    block.pseudo_inverse(tolerance).unwrap_or_else(|_| DMatrix::zeros(n, n))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::observations::{Sample, tests::synthetic};
    use crate::numerics::fit::zheng2008::{Options, solve};
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, Normal};
    use std::ops::ControlFlow;

    /// The scatter of beta over repeated noise agrees with its standard error within what 40 repeats can tell.
    #[test]
    fn standard_error_of_beta_is_its_scatter() {
        let (clean, truth) = synthetic(150, 1, 41);
        let mut rng = StdRng::seed_from_u64(42);
        let noise = Normal::new(0.0, 0.02).unwrap();
        let mut pulls = Vec::new();
        for _ in 0..40 {
            let (noisy, _) = clean.changed(1, |_, sample| {
                let radiance = sample.radiance.map(|i| i * (1.0 + noise.sample(&mut rng)));
                Some(Sample { radiance, variance: [0.0; 3], ..sample })
            });
            let options = Options { relative_decrease: 1e-8, ..Options::new(Objective::NOISE) };
            let found = solve(&Ward, &noisy, truth.clone(), options, &mut |_, _| ControlFlow::Continue(()));
            let errors = uncertainty(&Ward, &found.mixture, Objective::NOISE, &noisy);
            assert!(errors.alpha.iter().all(Option::is_some), "no unknown is at a bound: {:?}", errors.alpha);
            let sigma = errors.alpha[6].unwrap_or(f64::NAN);
            pulls.push((found.mixture.materials[0].beta / truth.materials[0].beta).ln() / sigma);
        }
        let rms = (pulls.iter().map(|p| p * p).sum::<f64>() / pulls.len() as f64).sqrt();
        assert!((0.7..1.4).contains(&rms), "pulls have rms {rms}");
    }
}
