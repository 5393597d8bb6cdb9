//! Standard errors: the weights are eliminated point by point (Schur complement of the normal matrix), what is left is
//! inverted and scaled by the scatter of the residuals.
//!
//! The gauge counts as exact: the largest diffuse albedo of each material only says what a weight of 1 means, so it has no
//! standard error, and those of the other parameters are relative to it.

use super::Mixture;
use super::kernel::{self, PER_MATERIAL, Sign};
use super::observations::{Observations, Sample};
use super::prepared::{Prepared, Recipe};
use super::unknowns::{Colour, Unknowns};
use super::varpro::{degrees_of_freedom, loosen};
use super::{CHUNK, predict};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Standard errors of everything that was fitted.
#[derive(Clone, Debug)]
pub struct Uncertainty {
    /// Per parameter, [`PER_MATERIAL`] a material (rho_d, rho_s, ln beta): none for one that is not fitted, that fixes the
    /// gauge, or that stands at a bound.
    pub alpha: Vec<Option<f64>>,
    /// Per parameter, how much of its error comes from directions the data hardly see, 0 to 1.
    pub loose: Vec<f64>,
    /// Per weight, as `Mixture::gamma`, for fixed BRDF parameters; 0 for a weight held at zero.
    pub gamma: Vec<f64>,
    /// Smallest eigenvalue of the normal matrix scaled to a unit diagonal: near 0 where parameters trade against each other.
    pub least_eigenvalue: f64,
}

/// An eigenvalue below this is a direction the data do not see: the sums are kept in f32.
const UNSEEN: f64 = 1e-5;

/// Standard errors of a mixture in normal form that was found with weights under `sign`.
pub fn uncertainty(
    recipe: &Recipe<'_>,
    mixture: &Mixture,
    colour: Colour,
    sign: Sign,
    observations: &Observations,
) -> Uncertainty {
    let mut prepared = Prepared::new(observations, recipe);
    if sign == Sign::Slack {
        let (_, cost) = kernel::weights(&prepared, &mixture.materials, Sign::NonNegative);
        let variance = cost / degrees_of_freedom(observations, mixture.materials.len());
        loosen(&mut prepared, &mixture.materials, variance);
    }
    let unknowns = Unknowns::new(&mixture.materials, colour);
    let normal = unknowns.reduce(&kernel::normal(&prepared, &mixture.materials, sign));
    let free_weights = mixture.gamma.iter().filter(|&&gamma| gamma > 0.0).count();
    let scatter = Scatter::of(recipe, mixture, observations);
    // Channels that repeat one another add to all sums, but tell nothing.
    let copies = 3 / observations.channels();
    // The normal matrix is in prepared units, the residuals are not.
    let scale = scatter.scale(copies * (free_weights + unknowns.count())) * (copies as f64 / prepared.unit2).sqrt();
    let (sigma, loose, least_eigenvalue) = standard_errors(&normal.hessian, &unknowns.at_bound(), scale);
    let place = |list: &[f64], i: usize| unknowns.place(i / PER_MATERIAL, i % PER_MATERIAL).map(|p| list[p]);
    let parameters = 0..PER_MATERIAL * mixture.materials.len();
    let gamma = kernel::deviations(&prepared, &mixture.materials, Sign::NonNegative);
    Uncertainty {
        alpha: parameters.clone().map(|i| place(&sigma, i).filter(|s| s.is_finite())).collect(),
        loose: parameters.map(|i| place(&loose, i).unwrap_or(0.0)).collect(),
        gamma: gamma.iter().map(|sigma| sigma * scale).collect(),
        least_eigenvalue,
    }
}

/// Per unknown, the square root of the diagonal of the inverse, NaN for those at a bound; how much of that comes from
/// unseen directions; and the smallest eigenvalue.
fn standard_errors(hessian: &DMatrix<f64>, fixed: &[bool], scale: f64) -> (Vec<f64>, Vec<f64>, f64) {
    let free: Vec<usize> = (0..fixed.len()).filter(|&i| !fixed[i] && hessian[(i, i)] > 0.0).collect();
    let (mut sigma, mut loose) = (vec![f64::NAN; fixed.len()], vec![0.0; fixed.len()]);
    if free.is_empty() {
        return (sigma, loose, 0.0);
    }
    let unit: Vec<f64> = free.iter().map(|&i| hessian[(i, i)].sqrt()).collect();
    let scaled = DMatrix::from_fn(free.len(), free.len(), |i, j| hessian[(free[i], free[j])] / (unit[i] * unit[j]));
    let eigen = scaled.symmetric_eigen();
    for (i, &unknown) in free.iter().enumerate() {
        let (mut seen, mut unseen) = (0.0, 0.0);
        for (k, &value) in eigen.eigenvalues.iter().enumerate() {
            let part = eigen.eigenvectors[(i, k)].powi(2) / value.max(0.1 * UNSEEN);
            *(if value < UNSEEN { &mut unseen } else { &mut seen }) += part;
        }
        sigma[unknown] = (seen + unseen).sqrt() / unit[i] * scale;
        loose[unknown] = unseen / (seen + unseen);
    }
    (sigma, loose, eigen.eigenvalues.min())
}

/// Sums over residuals that say how the objective scatters: squares of the influence psi, weights, slopes of psi.
#[derive(Clone, Copy, Default)]
struct Scatter {
    psi2: f64,
    weight: f64,
    slope: f64,
    count: f64,
}

impl Scatter {
    fn of(recipe: &Recipe<'_>, mixture: &Mixture, observations: &Observations) -> Self {
        let points = observations.points();
        let partial: Vec<Self> = (0..points.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut sums = Self::default();
                for point in chunk * CHUNK..((chunk + 1) * CHUNK).min(points) {
                    for sample in observations.of(point) {
                        sums.add(recipe, &sample, mixture.weights_of(point), mixture);
                    }
                }
                sums
            })
            .collect();
        partial.iter().fold(Self::default(), |a, b| Self {
            psi2: a.psi2 + b.psi2,
            weight: a.weight + b.weight,
            slope: a.slope + b.slope,
            count: a.count + b.count,
        })
    }

    fn add(&mut self, recipe: &Recipe<'_>, sample: &Sample, gamma: &[f64], mixture: &Mixture) {
        let model = predict(recipe.lobe, &mixture.materials, gamma, sample);
        let weights = recipe.objective.weights(sample);
        let scale = recipe.objective.cauchy_scale(recipe.brightness);
        for c in 0..3 {
            let residual2 = weights[c] * (sample.radiance[c] - model[c]).powi(2);
            let ratio = scale.map_or(0.0, |s| residual2 / (s * s));
            let weight = 1.0 / (1.0 + ratio);
            self.psi2 += weight * weight * residual2;
            self.weight += weight;
            self.slope += (1.0 - ratio) * weight * weight;
            self.count += 1.0;
        }
    }

    /// By how much a standard error exceeds the inverse of the weighted normal matrix (Huber 1981, 7.6): for plain squares
    /// the root of the reduced cost.
    fn scale(&self, unknowns: usize) -> f64 {
        let variance = self.psi2 / (self.count - unknowns as f64).max(1.0);
        let slope = (self.slope / self.count.max(1.0)).max(0.1);
        (variance * self.weight / self.count.max(1.0)).sqrt() / slope
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::objective::Objective;
    use crate::numerics::fit::observations::{Sample, tests::synthetic};
    use crate::numerics::fit::prepared::brightness;
    use crate::numerics::fit::solver::{Iterate, Task, by_name};
    use crate::numerics::fit::weights::WeightRule;
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, Normal};
    use std::ops::ControlFlow;

    /// The scatter of the parameters over repeated noise agrees with their standard errors within what 40 repeats can tell.
    #[test]
    fn standard_errors_are_the_scatter() {
        let (clean, truth) = synthetic(150, 1, 41);
        let mut rng = StdRng::seed_from_u64(42);
        let noise = Normal::new(0.0, 0.02).unwrap();
        for objective in [Objective::NOISE, Objective::NOISE_CAUCHY] {
            let task = Task { lobe: &Ward, objective, materials: 1, rule: WeightRule::Exact, colour: Colour::Coloured };
            let mut pulls = [0.0; PER_MATERIAL];
            for _ in 0..40 {
                let (noisy, _) = clean.changed(1, |_, sample| {
                    let radiance = sample.radiance.map(|i| i * (1.0 + noise.sample(&mut rng)));
                    Some(Sample { radiance, variance: [0.0; 3], ..sample })
                });
                let go_on = &mut |_: Iterate<'_>| ControlFlow::Continue(());
                let found = by_name("varpro").unwrap().solve(&noisy, &task, go_on).unwrap();
                let recipe = Recipe { lobe: &Ward, objective, brightness: 1.0 };
                let errors = uncertainty(&recipe, &found.mixture, Colour::Coloured, Sign::NonNegative, &noisy);
                let (found, known) = (found.mixture.materials[0], truth.materials[0]);
                let gauge = found.rho_d[0] / known.rho_d[0];
                assert!(errors.alpha[0].is_none(), "the largest albedo is the gauge");
                let differences = [
                    0.0,
                    found.rho_d[1] / gauge - known.rho_d[1],
                    found.rho_d[2] / gauge - known.rho_d[2],
                    found.rho_s[0] / gauge - known.rho_s[0],
                    found.rho_s[1] / gauge - known.rho_s[1],
                    found.rho_s[2] / gauge - known.rho_s[2],
                    (found.beta / known.beta).ln() / gauge,
                ];
                for k in 1..PER_MATERIAL {
                    pulls[k] += (differences[k] * gauge / errors.alpha[k].unwrap()).powi(2) / 40.0;
                }
            }
            for (k, square) in pulls.iter().enumerate().skip(1) {
                assert!(
                    (0.7..1.4).contains(&square.sqrt()),
                    "{objective:?}: pulls of parameter {k} have rms {}",
                    square.sqrt()
                );
            }
        }
    }

    /// The unit of radiance is nobody's business: a thousand times brighter, the same relative errors.
    #[test]
    fn standard_errors_do_not_depend_on_the_unit_of_radiance() {
        let (clean, mut truth) = synthetic(150, 2, 43);
        truth.materials[0].beta *= 1.02;
        let thousand = |v: [f64; 3]| v.map(|v| 1000.0 * v);
        let (bright, _) = clean.changed(1, |_, s| {
            Some(Sample { radiance: thousand(s.radiance), irradiance: thousand(s.irradiance), variance: [0.0; 3], ..s })
        });
        let (plain, _) = clean.changed(1, |_, s| Some(Sample { variance: [0.0; 3], ..s }));
        for (_, objective) in Objective::ALL {
            let of = |observations: &Observations| {
                let recipe = Recipe { lobe: &Ward, objective, brightness: brightness(observations) };
                uncertainty(&recipe, &truth, Colour::Coloured, Sign::NonNegative, observations).alpha
            };
            for (a, b) in of(&plain).iter().zip(of(&bright)) {
                assert_eq!(a.is_some(), b.is_some());
                let (a, b) = (a.unwrap_or(1.0), b.unwrap_or(1.0));
                assert!((a / b - 1.0).abs() < 0.02, "{}: {a} and {b}", objective.name());
            }
        }
    }
}
