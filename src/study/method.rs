//! A way to fit: solver, objective, and when to stop.

use crate::numerics::brdf::{Lobe, ward::Ward};
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::solver::{Iterate, Refusal, SOLVERS, Solution, Solver, Task};
use crate::numerics::fit::unknowns::Colour;
use crate::numerics::fit::varpro::{Subset, Varpro};
use crate::numerics::fit::weights::WeightRule;
use std::ops::ControlFlow;

/// Model of every fit here.
pub const LOBE: &dyn Lobe = &Ward;

/// Rounds after which Zheng 2008 calls its alternation converged.
const PAPER_ROUNDS: usize = 10;

/// A way to fit.
#[derive(Clone, Copy)]
pub struct Method {
    /// Solver.
    pub solver: &'static dyn Solver,
    /// What is minimised.
    pub objective: Objective,
    /// Points that settle the materials; none where all do.
    pub points: Option<usize>,
    /// True: number of materials, model, lobe and light gains are left to the data.
    pub automatic: bool,
    /// Outer iterations after which the solver is stopped; none lets it end by itself.
    pub rounds: Option<usize>,
}

impl Method {
    /// Every solver with one objective: the one that fits a subset in each of the sizes `subsets`, the paper's alternation as
    /// its authors stopped it, and to the end (up to 300 rounds) when `to_the_end`.
    pub fn all(objective: Objective, subsets: &'static [Subset], to_the_end: bool) -> Vec<Self> {
        let mut all = Vec::new();
        for &solver in SOLVERS {
            let method = Self::new(solver, objective);
            match solver.name() {
                "subset" => all.extend(subsets.iter().map(|s| Self { solver: s, points: Some(s.0), ..method })),
                "zheng2008" => {
                    all.push(method);
                    all.extend(to_the_end.then_some(Self { rounds: None, ..method }));
                }
                _ => all.push(method),
            }
        }
        all
    }

    /// A solver with an objective, everything told; the paper's alternation as its authors stopped it.
    pub fn new(solver: &'static dyn Solver, objective: Objective) -> Self {
        let rounds = (solver.name() == "zheng2008").then_some(PAPER_ROUNDS);
        Self { solver, objective, points: None, automatic: false, rounds }
    }

    /// What a fit does unless told otherwise.
    pub fn automatic(objective: Objective) -> Self {
        Self { solver: &Varpro, objective, points: None, automatic: true, rounds: None }
    }

    /// The solver's name, or that everything is left to the data.
    pub fn solver_name(&self) -> &'static str {
        if self.automatic { "automatic" } else { self.solver.name() }
    }

    /// Solver, and its rounds where they are limited.
    pub fn solver_label(&self) -> String {
        let rounds = self.rounds.map_or(String::new(), |rounds| format!(" ({rounds} rounds)"));
        format!("{}{rounds}", self.solver_name())
    }

    /// What the solver is asked for.
    pub fn task(&self, materials: usize) -> Task {
        let (objective, colour, rule) = (self.objective, Colour::Coloured, WeightRule::Exact);
        Task { lobe: LOBE, objective, materials, colour, rule }
    }

    /// Fits.
    ///
    /// # Errors
    /// The solver refuses the observations.
    pub fn solve(&self, observations: &Observations, materials: usize) -> Result<Solution, Refusal> {
        let mut stop = |at: Iterate<'_>| {
            if self.rounds.is_some_and(|limit| at.iteration >= limit) {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        self.solver.solve(observations, &self.task(materials), &mut stop)
    }
}
