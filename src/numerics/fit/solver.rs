//! One interface for every solver, so that all are chosen by name and compared on the same problems.

use super::Mixture;
use super::bank::Bank;
use super::directions::Tilt;
use super::initialise::initialise;
use super::kernel::Sign;
use super::normals::Normals;
use super::objective::Objective;
use super::observations::Observations;
use super::split::Split;
use super::unknowns::Colour;
use super::varpro::{Subset, Varpro};
use super::weights::WeightRule;
use super::zheng2008::{self, Options};
use crate::numerics::brdf::{Lobe, Material};
use std::ops::ControlFlow;

/// What is asked of a solver.
#[derive(Clone, Copy)]
pub struct Task {
    /// Reflection model.
    pub lobe: &'static dyn Lobe,
    /// What is minimised.
    pub objective: Objective,
    /// Number of materials, 1 to [`super::MAX_MATERIALS`].
    pub materials: usize,
    /// How much of a lobe is fitted; the paper's alternation knows coloured lobes only.
    pub colour: Colour,
    /// Constraints of the weights; only the paper's alternation knows another rule than `exact`.
    pub rule: WeightRule,
}

/// Where a solver stands after an iteration.
#[derive(Clone, Copy, Debug)]
pub struct Iterate<'a> {
    /// Steps tried so far; of a solver that alternates, its round. A search over all points repeats the last number of the one before.
    pub iteration: usize,
    /// Cost of the objective over the points in use.
    pub cost: f64,
    /// Root mean square residual in the units of the objective: standard deviations, relative error, or radiance.
    pub rms: f64,
    /// Points in use: a search may begin with a few of them.
    pub points: usize,
    /// BRDF parameters, not yet in normal form.
    pub materials: &'a [Material],
}

impl<'a> Iterate<'a> {
    /// After `iteration` iterations, with `cost` over all of `observations`.
    pub fn new(iteration: usize, cost: f64, observations: &Observations, materials: &'a [Material]) -> Self {
        let residuals = (3 * observations.samples()).max(1) as f64;
        Self { iteration, cost, rms: (cost / residuals).sqrt(), points: observations.points(), materials }
    }
}

/// Callback of a solver: it looks on, and can break off.
pub type OnIteration<'a> = &'a mut dyn FnMut(Iterate<'_>) -> ControlFlow<()>;

/// Why a solver ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Termination {
    /// Nothing more was to be gained.
    Converged,
    /// The permitted iterations were used up.
    IterationLimit,
    /// The caller broke off.
    Cancelled,
}

/// What came out.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The mixture, in normal form under [`WeightRule::Exact`].
    pub mixture: Mixture,
    /// Cost of the objective.
    pub cost: f64,
    /// Outer iterations done.
    pub iterations: usize,
    /// Why it ended.
    pub termination: Termination,
    /// Constraint of the weights while the BRDF parameters were found.
    pub sign: Sign,
    /// Per point, how its normal was turned; none where the solver keeps the given normals.
    pub tilts: Option<Vec<Tilt>>,
    /// What a reader must know of how it was found: a refit refused, normals that moved.
    pub notes: Vec<String>,
}

/// Why a solver cannot work on a task at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// It knows one reflection model only.
    #[error(
        "the solver {solver} knows the model {needs} only, not {model}: choose the model {needs} or auto, or another solver"
    )]
    OtherModel {
        /// The solver.
        solver: &'static str,
        /// The model it knows.
        needs: &'static str,
        /// The model it was given.
        model: &'static str,
    },
    /// It turns normals, and the observations do not say where the lights stand about them.
    #[error("the solver {solver} refines normals: it needs observations with the azimuths of their lights")]
    NoAzimuths {
        /// The solver.
        solver: &'static str,
    },
}

/// A way to fit materials and weights to observations.
pub trait Solver: Sync {
    /// Name in reports and on the command line.
    fn name(&self) -> &'static str;
    /// True when the solver fits a specular albedo for each channel and knows no other lobe.
    fn coloured_only(&self) -> bool {
        false
    }

    /// The one reflection model the solver knows; none where it fits any.
    fn only_model(&self) -> Option<&'static dyn Lobe> {
        None
    }

    /// True for a solver that refuses observations without the azimuths of their lights
    /// ([`Observations::set_azimuths`]).
    fn needs_azimuths(&self) -> bool {
        false
    }
    /// Fits. The observations hold at least one point.
    fn solve(&self, observations: &Observations, task: &Task, progress: OnIteration<'_>) -> Result<Solution, Refusal>;
}

/// The paper's own alternation (3.6) from its own start (3.4-3.5).
struct Zheng2008;

impl Solver for Zheng2008 {
    fn name(&self) -> &'static str {
        "zheng2008"
    }

    fn coloured_only(&self) -> bool {
        true
    }

    fn solve(&self, observations: &Observations, task: &Task, progress: OnIteration<'_>) -> Result<Solution, Refusal> {
        let start = initialise(task.lobe, observations, task.materials);
        let options = Options { rule: task.rule, ..Options::new(task.objective) };
        Ok(zheng2008::solve(task.lobe, observations, start, options, progress))
    }
}

/// Every solver that can be selected.
pub const SOLVERS: &[&dyn Solver] = &[&Varpro, &Subset(SUBSET), &Zheng2008, &Split, &Normals, &Bank];

/// Points that settle the BRDF parameters for the solver `subset`.
const SUBSET: usize = 3000;

/// Names of all solvers.
pub fn names() -> Vec<&'static str> {
    SOLVERS.iter().map(|solver| solver.name()).collect()
}

/// The solver of this name, if rigd has it.
pub fn by_name(name: &str) -> Option<&'static dyn Solver> {
    SOLVERS.iter().copied().find(|solver| solver.name() == name)
}

#[cfg(test)]
pub(crate) mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::brdf::{lambert::Lambert, ward::Ward};
    use crate::numerics::fit::MAX_MATERIALS;
    use crate::numerics::fit::observations::Sample;
    use crate::numerics::fit::observations::tests::{noisy, synthetic};

    /// A task under the Ward model.
    pub(crate) fn task(materials: usize, objective: Objective) -> Task {
        Task { lobe: &Ward, objective, materials, colour: Colour::Coloured, rule: WeightRule::Exact }
    }

    pub(crate) fn go_on(_: Iterate<'_>) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn hostile() -> Vec<Observations> {
        let (plain, _) = synthetic(3, 2, 21);
        let with = |radiance: f64| {
            let change = |_, sample| Some(Sample { radiance: [radiance; 3], ..sample });
            plain.changed(1, change).0
        };
        vec![
            plain.select(&[0]),
            plain.filtered(1, |light| light == 3).0,
            plain.select(&[1, 1, 1, 1, 1]),
            with(0.3),
            with(1e-30),
            with(1e15),
        ]
    }

    #[test]
    fn hostile_observations_give_finite_mixtures() {
        for solver in SOLVERS {
            for (index, observations) in hostile().iter().enumerate() {
                for objective in [Objective::ABSOLUTE, Objective::NOISE_CAUCHY] {
                    for materials in 1..=MAX_MATERIALS {
                        let solution = solver.solve(observations, &task(materials, objective), &mut go_on).unwrap();
                        let what = format!("{} on case {index} with {materials}", solver.name());
                        let mixture = solution.mixture;
                        assert_eq!(mixture.materials.len(), materials, "{what}");
                        assert_eq!(mixture.gamma.len(), materials * observations.points(), "{what}");
                        assert!(mixture.gamma.iter().all(|g| g.is_finite() && *g >= 0.0), "{what}");
                        let finite = |m: &crate::numerics::brdf::Material| {
                            m.rho_d.iter().chain(&m.rho_s).chain([&m.beta]).all(|v| v.is_finite())
                        };
                        assert!(mixture.materials.iter().all(finite), "{what}: {:?}", mixture.materials);
                    }
                }
            }
        }
    }

    #[test]
    fn the_number_of_threads_does_not_change_a_bit() {
        let (exact, _) = synthetic(700, 2, 22);
        let observations = noisy(&exact, 0.02, 22);
        for solver in SOLVERS {
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let task = task(2, Objective::NOISE_CAUCHY);
                pool.install(|| solver.solve(&observations, &task, &mut go_on).unwrap().mixture)
            };
            assert_eq!(run(1), run(4), "{}", solver.name());
        }
    }

    #[test]
    fn a_bank_of_ward_parameters_is_refused_for_another_model() {
        let (observations, _) = synthetic(20, 1, 23);
        let task = Task { lobe: &Lambert, ..task(1, Objective::NOISE) };
        let refusal = by_name("bank").unwrap().solve(&observations, &task, &mut go_on).unwrap_err();
        assert_eq!(refusal, Refusal::OtherModel { solver: "bank", needs: "ward", model: "lambert" });
    }
}
