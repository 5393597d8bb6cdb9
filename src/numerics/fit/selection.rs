//! How many materials the object needs, judged by left-out lights (METHOD 7): one more is accepted only if it lowers the
//! error on lights the fit never saw.

use super::initialise::initialise;
use super::objective::Objective;
use super::observations::Observations;
use super::quality::judge_left_out;
use super::solver::Termination;
use super::weights::solve_weights;
use super::zheng2008::{self, Options};
use super::{MAX_MATERIALS, Mixture};
use crate::numerics::brdf::Lobe;
use std::ops::ControlFlow;

/// Points that decide: alpha is settled by far fewer than an image has.
const POINTS: usize = 800;

/// Most groups of lights left out in turn.
const FOLDS: usize = 6;

/// A further material must lower the left-out error by this much, relative, to be worth having.
const GAIN: f64 = 0.02;

/// Rounds of the fit to all lights, and of each refit without one group of them, which starts from that fit.
const ROUNDS: (usize, usize) = (60, 12);

/// A number of materials with its score.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Number of materials.
    pub materials: usize,
    /// Mean relative error on left-out lights.
    pub left_out_relative_error: f64,
    /// True for the one taken.
    pub taken: bool,
}

/// Tries one material, then one more as long as that pays. Empty when the caller broke off or too few lights see a point.
pub fn select_materials(
    lobe: &dyn Lobe,
    observations: &Observations,
    objective: Objective,
    go_on: &mut dyn FnMut() -> ControlFlow<()>,
) -> Vec<Candidate> {
    let subset = observations.subset(POINTS);
    let mut candidates: Vec<Candidate> = Vec::new();
    for materials in 1..=MAX_MATERIALS {
        let Some(error) = left_out_error(lobe, &subset, objective, materials, go_on) else { break };
        let best = candidates.last().map_or(f64::INFINITY, |c| c.left_out_relative_error);
        candidates.push(Candidate { materials, left_out_relative_error: error, taken: false });
        if error > best * (1.0 - GAIN) {
            let previous = candidates.len() - 2;
            candidates[previous].taken = true;
            return candidates;
        }
    }
    if let Some(last) = candidates.last_mut() {
        last.taken = true;
    }
    candidates
}

/// Mean relative error over all samples, each predicted by a fit that did not see its light.
fn left_out_error(
    lobe: &dyn Lobe,
    subset: &Observations,
    objective: Objective,
    materials: usize,
    go_on: &mut dyn FnMut() -> ControlFlow<()>,
) -> Option<f64> {
    let start = initialise(lobe, subset, materials);
    let full = fit(lobe, subset, start, objective, ROUNDS.0, go_on)?;
    let folds = subset.lights.min(FOLDS);
    let mut sum = 0.0;
    let mut count = 0.0;
    for fold in 0..folds {
        let in_fold = |light: usize| light % folds == fold;
        let (rest, kept) = subset.filtered(2, |light| !in_fold(light));
        if rest.points() == 0 {
            continue;
        }
        let gamma = solve_weights(lobe, &full.materials, objective, super::weights::WeightRule::Exact, &rest);
        let start = Mixture { materials: full.materials.clone(), gamma };
        let mixture = fit(lobe, &rest, start, objective, ROUNDS.1, go_on)?;
        if let Some(quality) = judge_left_out(lobe, &mixture, subset, &kept, in_fold) {
            sum += quality.mean_relative_error;
            count += 1.0;
        }
    }
    (count > 0.0).then(|| sum / count)
}

fn fit(
    lobe: &dyn Lobe,
    observations: &Observations,
    start: Mixture,
    objective: Objective,
    rounds: usize,
    go_on: &mut dyn FnMut() -> ControlFlow<()>,
) -> Option<Mixture> {
    let options = Options { iterations: rounds, relative_decrease: 1e-4, ..Options::new(objective) };
    let solution = zheng2008::solve(lobe, observations, start, options, &mut |_, _| go_on());
    (solution.termination != Termination::Cancelled).then_some(solution.mixture)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::observations::{Sample, tests::synthetic};
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    #[test]
    fn takes_as_many_materials_as_made_the_data() {
        for truth in [1, 2] {
            let (clean, _) = synthetic(500, truth, 30 + truth as u64);
            let mut rng = StdRng::seed_from_u64(31);
            let (observations, _) = clean.changed(1, |_, sample| {
                let radiance = sample.radiance.map(|i| i * (1.0 + rng.random_range(-0.03..0.03)));
                Some(Sample { radiance, ..sample })
            });
            let found = select_materials(&Ward, &observations, Objective::NOISE, &mut || ControlFlow::Continue(()));
            let taken: Vec<usize> = found.iter().filter(|c| c.taken).map(|c| c.materials).collect();
            assert_eq!(taken, vec![truth], "{found:?}");
        }
    }
}
