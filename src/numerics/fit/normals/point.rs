//! The normal of one point: Gauss-Newton on its tilt, weights eliminated.

use crate::numerics::brdf::Material;
use crate::numerics::fit::directions::{Tilt, turned};
use crate::numerics::fit::loss::Loss;
use crate::numerics::fit::observations::Sample;
use crate::numerics::fit::prepared::Recipe;
use crate::numerics::fit::{MAX_MATERIALS, predict, unit_radiance};
use nalgebra::{DMatrix, DVector};

/// Tangent of the farthest a normal may turn (5 degrees).
const FARTHEST: f64 = 0.0875;

/// A point needs so many lights for its normal to be refined, as photometric stereo does.
const LEAST_LIGHTS: usize = 3;

/// Most Gauss-Newton steps of a normal, and what one must gain, relative, for another.
const STEPS: (usize, f64) = (12, 1e-4);

/// Change of a tilt that derivatives are taken over.
const DELTA: f64 = 1e-4;

/// What holds tilts to the given normal.
#[derive(Clone, Copy)]
pub struct Pull {
    /// Cost of a tilt of 1: variance of the residuals over that of the tilts.
    pub strength: f64,
    /// Variance of the residuals.
    pub residual: f64,
}

/// How a normal was turned.
pub struct Turn {
    pub tilt: Tilt,
    /// Sum of the variances of the two tilts given the samples; none where the point has no say.
    pub uncertainty: Option<f64>,
}

/// A point with its normal sought.
pub struct Refinement<'a> {
    /// Model and objective.
    pub recipe: &'a Recipe<'a>,
    /// BRDF parameters, held.
    pub materials: &'a [Material],
    /// Cost of the samples.
    pub loss: Loss<'a>,
    /// Cost of the tilt.
    pub pull: Pull,
    /// Samples about the given normal, with azimuths.
    pub samples: Vec<(Sample, f64)>,
}

/// A tilt with the best weights there.
struct Trial {
    tilt: Tilt,
    samples: Vec<Sample>,
    gamma: [f64; MAX_MATERIALS],
    cost: f64,
}

impl Refinement<'_> {
    /// The best tilt found from `start`; the given normal where that costs no more.
    pub fn best(&self, start: Tilt) -> Turn {
        const GIVEN: Tilt = [0.0; 2];
        let kept = Turn { tilt: GIVEN, uncertainty: None };
        if self.samples.len() < LEAST_LIGHTS {
            return kept;
        }
        let Some(given) = self.trial(GIVEN) else { return kept };
        let most = given.cost;
        let mut best = if start == GIVEN { given } else { self.trial(start).unwrap_or(given) };
        let mut damping = 1e-3;
        for _ in 0..STEPS.0 {
            let Some(Step { step, .. }) = self.step(&best, damping) else { break };
            let next = self.trial(bounded([best.tilt[0] + step[0], best.tilt[1] + step[1]]));
            match next.filter(|next| next.cost < best.cost) {
                Some(next) => {
                    let gained = best.cost - next.cost;
                    best = next;
                    damping *= 0.1;
                    if gained < STEPS.1 * best.cost {
                        break;
                    }
                }
                None => damping *= 10.0,
            }
        }
        if best.cost >= most {
            return kept;
        }
        let uncertainty = self.step(&best, 0.0).map(|step| step.uncertainty);
        Turn { tilt: best.tilt, uncertainty }
    }

    fn trial(&self, tilt: Tilt) -> Option<Trial> {
        let samples = self.turned(tilt)?;
        let gamma = self.loss.weights(self.materials, &samples);
        let square = tilt[0].powi(2) + tilt[1].powi(2);
        let cost = self.loss.of(self.materials, &gamma, samples.iter().copied()) + self.pull.strength * square;
        Some(Trial { tilt, samples, gamma, cost })
    }

    /// All samples about a turned normal; none if any falls into shadow.
    fn turned(&self, tilt: Tilt) -> Option<Vec<Sample>> {
        self.samples.iter().map(|(sample, azimuth)| turned(sample, *azimuth, tilt)).collect()
    }

    /// Damped Gauss-Newton step of the tilt together with the positive weights.
    fn step(&self, at: &Trial, damping: f64) -> Option<Step> {
        let sides = [self.turned([at.tilt[0] + DELTA, at.tilt[1]])?, self.turned([at.tilt[0], at.tilt[1] + DELTA])?];
        let active: Vec<usize> = (0..self.materials.len()).filter(|&m| at.gamma[m] > 0.0).collect();
        let n = 2 + active.len();
        let (mut matrix, mut right) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
        for (index, sample) in at.samples.iter().enumerate() {
            let model = predict(self.recipe.lobe, self.materials, &at.gamma, sample);
            let scaled = self.loss.scaled(self.materials, &at.gamma, sample);
            let moved = [0, 1].map(|k| predict(self.recipe.lobe, self.materials, &at.gamma, &sides[k][index]));
            let units = active.iter().map(|&m| unit_radiance(self.recipe.lobe, &self.materials[m], sample));
            let units: Vec<[f64; 3]> = units.collect();
            for c in 0..3 {
                let factor = scaled.radiance[c] / sample.radiance[c];
                let row = DVector::from_fn(n, |k, _| {
                    factor * if k < 2 { (moved[k][c] - model[c]) / DELTA } else { units[k - 2][c] }
                });
                right.axpy(factor * (sample.radiance[c] - model[c]), &row, 1.0);
                matrix.ger(1.0, &row, &row, 1.0);
            }
        }
        for k in 0..2 {
            right[k] -= self.pull.strength * at.tilt[k];
            matrix[(k, k)] = (matrix[(k, k)] + self.pull.strength) * (1.0 + damping);
        }
        let factor = matrix.cholesky()?;
        let step = factor.solve(&right);
        let inverse = factor.inverse();
        let uncertainty = self.pull.residual * (inverse[(0, 0)] + inverse[(1, 1)]);
        let finite = step.iter().chain([&uncertainty]).all(|value| value.is_finite());
        finite.then(|| Step { step: [step[0], step[1]], uncertainty })
    }
}

/// A step of a tilt.
struct Step {
    step: Tilt,
    /// Sum of the variances of the two tilts.
    uncertainty: f64,
}

/// The tilt, shortened to what is permitted.
fn bounded(tilt: Tilt) -> Tilt {
    let shrink = (FARTHEST / tilt[0].hypot(tilt[1])).min(1.0);
    [tilt[0] * shrink, tilt[1] * shrink]
}
