//! The paper's solver (3.6): weights of every point for fixed BRDF parameters, then BRDF parameters for fixed weights,
//! in turn until nothing more is gained. Under a Cauchy objective, which the paper does not have, every round first weights
//! each sample by its residual (iteratively reweighted least squares).

use super::kernel::Sign;
use super::levmar::Stop;
use super::loss::Loss;
use super::objective::Objective;
use super::observations::Observations;
use super::prepared::brightness;
use super::solver::{Iterate, OnIteration, Solution, Termination};
use super::weights::{WeightRule, solve_weights};
use super::{Mixture, alpha, gauge};
use crate::numerics::brdf::Lobe;

/// How the alternation runs.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// What is minimised.
    pub objective: Objective,
    /// Constraints of the weights.
    pub rule: WeightRule,
    /// Most alternations.
    pub iterations: usize,
    /// The alternation has converged when one round lowers the cost by less than this, relative. The coupling of weights
    /// and albedos makes each round's gain tiny long before the optimum: 1e-4 is a stall, not convergence.
    pub relative_decrease: f64,
}

impl Options {
    /// Sound defaults for an objective.
    pub fn new(objective: Objective) -> Self {
        Self { objective, rule: WeightRule::Exact, iterations: 300, relative_decrease: 1e-6 }
    }
}

/// Stop rule of the BRDF half-step: finer than what a round gains, or the rounds would inherit its error.
pub const ALPHA_STOP: Stop = Stop { relative_decrease: 1e-7, iterations: 60 };

/// One full alternation: weights (Eq. 10), then BRDF parameters; returns the cost after it.
pub fn alternate(
    lobe: &dyn Lobe,
    observations: &Observations,
    mixture: &mut Mixture,
    objective: Objective,
    rule: WeightRule,
    alpha_stop: Stop,
) -> f64 {
    mixture.gamma = solve_weights(lobe, &mixture.materials, objective, rule, observations);
    if rule == WeightRule::Exact {
        gauge::normalise(mixture);
    }
    alpha::solve_alpha(lobe, mixture, objective, observations, alpha_stop).cost
}

/// Runs the alternation from `start`. `progress` looks on; it can break off.
pub fn solve(
    lobe: &dyn Lobe,
    observations: &Observations,
    start: Mixture,
    options: Options,
    progress: OnIteration<'_>,
) -> Solution {
    let loss = Loss::new(lobe, options.objective, brightness(observations));
    let robust = options.objective.cauchy;
    let mut mixture = start;
    let mut cost = f64::INFINITY;
    let mut termination = Termination::IterationLimit;
    let mut iterations = 0;
    while iterations < options.iterations {
        let next = if robust {
            let weighted = loss.reweighted(observations, &mixture);
            alternate(lobe, &weighted, &mut mixture, Objective::ABSOLUTE, options.rule, ALPHA_STOP);
            loss.of_all(observations, &mixture)
        } else {
            alternate(lobe, observations, &mut mixture, options.objective, options.rule, ALPHA_STOP)
        };
        iterations += 1;
        let gained = (cost - next) / next.max(f64::MIN_POSITIVE);
        cost = next;
        if progress(Iterate::new(iterations, cost, observations, &mixture.materials)).is_break() {
            termination = Termination::Cancelled;
            break;
        }
        if gained < options.relative_decrease {
            termination = Termination::Converged;
            break;
        }
    }
    mixture.gamma = if robust {
        let weighted = loss.reweighted(observations, &mixture);
        solve_weights(lobe, &mixture.materials, Objective::ABSOLUTE, options.rule, &weighted)
    } else {
        solve_weights(lobe, &mixture.materials, options.objective, options.rule, observations)
    };
    if options.rule == WeightRule::Exact {
        gauge::normalise(&mut mixture);
    }
    let cost = if robust {
        loss.of_all(observations, &mixture)
    } else {
        alpha::cost(lobe, &mixture, options.objective, observations)
    };
    Solution { mixture, cost, iterations, termination, sign: Sign::NonNegative, tilts: None, notes: Vec::new() }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::brdf::{Material, ward::Ward};
    use crate::numerics::fit::initialise::initialise;
    use crate::numerics::fit::observations::Sample;
    use crate::numerics::fit::observations::tests::{noisy, synthetic};
    use crate::numerics::fit::quality::judge_all;
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    use std::ops::ControlFlow;

    /// From the paper's start, noise-free data of two materials lead back to the materials that made them.
    #[test]
    fn recovers_a_known_mixture() {
        let (observations, mut truth) = synthetic(250, 2, 11);
        gauge::normalise(&mut truth);
        let start = initialise(&Ward, &observations, 2);
        let options = Options { iterations: 1000, relative_decrease: 1e-8, ..Options::new(Objective::RELATIVE) };
        let solution = solve(&Ward, &observations, start, options, &mut |_| ControlFlow::Continue(()));
        for (found, known) in solution.mixture.materials.iter().zip(&truth.materials) {
            assert!((found.beta / known.beta - 1.0).abs() < 0.02, "{found:?} instead of {known:?}");
        }
        assert!(solution.cost < 1e-4, "cost {}", solution.cost);
    }

    #[test]
    fn no_round_raises_the_cost() {
        let (observations, _) = synthetic(200, 2, 12);
        let start = initialise(&Ward, &observations, 2);
        let mut costs = Vec::new();
        let options = Options { iterations: 15, relative_decrease: 0.0, ..Options::new(Objective::NOISE) };
        solve(&Ward, &observations, start, options, &mut |at| {
            costs.push(at.cost);
            ControlFlow::Continue(())
        });
        assert!(costs.windows(2).all(|pair| pair[1] <= pair[0] * (1.0 + 1e-9)), "{costs:?}");
    }

    /// With 3 % of the samples three times too bright, Cauchy's function keeps the roughness and the exact radiance where
    /// plain squares lose both; no round raises its cost.
    #[test]
    fn cauchy_withstands_outliers() {
        let (exact, mut truth) = synthetic(600, 2, 13);
        gauge::normalise(&mut truth);
        let mut rng = StdRng::seed_from_u64(13);
        let spoil = |_, mut sample: Sample| {
            if rng.random_bool(0.03) {
                sample.radiance = sample.radiance.map(|i| 3.0 * i);
            }
            Some(sample)
        };
        let observations = noisy(&exact, 0.02, 13).changed(1, spoil).0;
        let run = |objective: Objective| {
            let start = initialise(&Ward, &observations, 2);
            let mut costs = Vec::new();
            let solution = solve(&Ward, &observations, start, Options::new(objective), &mut |at| {
                costs.push(at.cost);
                ControlFlow::Continue(())
            });
            assert!(costs.windows(2).all(|pair| pair[1] <= pair[0] * (1.0 + 1e-6)), "{objective:?} {costs:?}");
            let off = |(a, b): (&Material, &Material)| (a.beta / b.beta).ln().abs();
            let beta = solution.mixture.materials.iter().zip(&truth.materials).map(off).fold(0.0, f64::max);
            (beta, judge_all(&Ward, &solution.mixture, &exact).unwrap().mean_relative_error)
        };
        let (plain, robust) = (run(Objective::NOISE), run(Objective::NOISE_CAUCHY));
        assert!(robust.0 < 0.5 * plain.0 && robust.1 < 0.5 * plain.1, "plain {plain:?}, Cauchy {robust:?}");
        assert!(robust.0 < 0.1 && robust.1 < 0.02, "{robust:?}");
    }
}
