//! A way to fit: solver, objective, and when to stop.

use crate::numerics::brdf::{Lobe, ward::Ward};
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::solver::{SOLVERS, Solution, Solver, Task};
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
    /// Name of the objective.
    pub objective_name: &'static str,
    /// What is minimised.
    pub objective: Objective,
    /// Outer iterations after which the solver is stopped; none lets it end by itself.
    pub rounds: Option<usize>,
}

impl Method {
    /// Every solver with one objective. The paper's alternation comes as its authors stopped it, and to the end only when
    /// `to_the_end`: that takes up to 300 rounds.
    pub fn all(objective_name: &'static str, objective: Objective, to_the_end: bool) -> Vec<Self> {
        let mut all = Vec::new();
        for &solver in SOLVERS {
            let method = Self { solver, objective_name, objective, rounds: None };
            let papers = solver.name() == "zheng2008";
            if papers {
                all.push(Self { rounds: Some(PAPER_ROUNDS), ..method });
            }
            if !papers || to_the_end {
                all.push(method);
            }
        }
        all
    }

    /// Solver, and its rounds where they are limited.
    pub fn solver_label(&self) -> String {
        let rounds = self.rounds.map_or(String::new(), |rounds| format!(" ({rounds} rounds)"));
        format!("{}{rounds}", self.solver.name())
    }

    /// What the solver is asked for.
    pub fn task(&self, materials: usize) -> Task {
        Task { lobe: LOBE, objective: self.objective, materials, rule: WeightRule::Exact }
    }

    /// Fits.
    pub fn solve(&self, observations: &Observations, materials: usize) -> Solution {
        let mut stop = |round, _| {
            if self.rounds.is_some_and(|limit| round >= limit) {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        self.solver.solve(observations, &self.task(materials), &mut stop)
    }
}
