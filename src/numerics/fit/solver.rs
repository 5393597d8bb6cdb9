//! One interface for every solver, so that all are chosen by name and compared on the same problems.

use super::Mixture;
use super::initialise::initialise;
use super::kernel::Sign;
use super::objective::Objective;
use super::observations::Observations;
use super::unknowns::Colour;
use super::varpro::{Subset, Varpro};
use super::weights::WeightRule;
use super::zheng2008::{self, Options};
use crate::numerics::brdf::Lobe;
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

/// Callback of a solver: outer iteration and cost; it can break off.
pub type OnIteration<'a> = &'a mut dyn FnMut(usize, f64) -> ControlFlow<()>;

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
    /// What a reader must know of how it was found: a refit refused, normals that moved.
    pub notes: Vec<String>,
}

/// A way to fit materials and weights to observations.
pub trait Solver: Sync {
    /// Name in reports and on the command line.
    fn name(&self) -> &'static str;
    /// Fits. The observations hold at least one point.
    fn solve(&self, observations: &Observations, task: &Task, progress: OnIteration<'_>) -> Solution;
}

/// The paper's own alternation (3.6) from its own start (3.4-3.5).
struct Zheng2008;

impl Solver for Zheng2008 {
    fn name(&self) -> &'static str {
        "zheng2008"
    }

    fn solve(&self, observations: &Observations, task: &Task, progress: OnIteration<'_>) -> Solution {
        let start = initialise(task.lobe, observations, task.materials);
        let options = Options { rule: task.rule, ..Options::new(task.objective) };
        zheng2008::solve(task.lobe, observations, start, options, progress)
    }
}

/// Every solver that can be selected.
pub const SOLVERS: &[&dyn Solver] = &[&Varpro, &Subset(SUBSET), &Zheng2008];

/// Points that settle the BRDF parameters for the solver `subset`.
const SUBSET: usize = 3000;

/// The solver of this name, if rigd has it.
pub fn by_name(name: &str) -> Option<&'static dyn Solver> {
    SOLVERS.iter().copied().find(|solver| solver.name() == name)
}
