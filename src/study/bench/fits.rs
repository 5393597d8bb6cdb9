//! Fits of the size of the paper, judged by the truth.

use super::{Add, Bar, BenchError, Entry, Plan, Section, repeated};
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::solver::{SOLVERS, Solver};
use crate::pipeline::fit::FitOptions;
use crate::pipeline::judged::fit_observations;
use crate::study::clock::{OneThread, time_of_process};
use crate::study::method::{LOBE, Method};
use crate::study::scene::{Problem, Scene};
use crate::study::score::score;
use std::ops::ControlFlow;

/// The default solver with the default objective, materials given.
const GIVEN: Bar = Bar { most_s: 0.020, goal_s: 0.005 };

/// Everything left to the data.
const AUTOMATIC: Bar = Bar { most_s: 0.5, goal_s: 0.1 };

/// Objective of a fit unless told otherwise.
pub const DEFAULT: Objective = Objective::NOISE_CAUCHY;

/// The scenes with their names, seed 0.
pub fn problems(plan: &Plan) -> [(&'static str, Scene, Problem); 2] {
    [("marble", Scene::marble()), ("wood", Scene::wood())].map(|(name, scene)| {
        let scene = Scene { points: plan.points.unwrap_or(scene.points), ..scene };
        let problem = scene.generate(0);
        (name, scene, problem)
    })
}

/// Every solver with the default objective, the project's own with plain squares as well, and the paper's alternation with
/// its own objective.
fn methods() -> Vec<Method> {
    let of = |&solver: &&'static dyn Solver| {
        let other = match solver.name() {
            "varpro" | "subset" => Some(Objective::NOISE),
            "zheng2008" => Some(Objective::RELATIVE),
            _ => None,
        };
        std::iter::once(DEFAULT).chain(other).map(move |objective| Method::new(solver, objective))
    };
    SOLVERS.iter().flat_map(of).collect()
}

/// Fits with the true number of materials, Ward, coloured lobes: start and final weights included.
pub fn given(plan: &Plan, add: Add<'_>) -> Result<(), BenchError> {
    let thread = OneThread::new()?;
    for (name, scene, problem) in &problems(plan) {
        for method in methods() {
            let observations = &problem.observations;
            let (solution, times) = repeated(plan.repeats, || {
                let (solution, cpu_s) = thread.time(|| method.solve(observations, scene.materials.len()))?;
                Ok((solution?, cpu_s))
            })?;
            let is_default = method.solver.name() == FitOptions::default().solver && method.objective == DEFAULT;
            let what = (method.solver_label(), method.objective);
            add(Entry {
                relight: Some(score(LOBE, problem, &solution.mixture).relight),
                bar: is_default.then_some(GIVEN),
                ..Entry::new((Section::Given, name), what, size(problem), Ok(times))
            })?;
        }
    }
    Ok(())
}

/// What `rigd fit` does unless told otherwise, on all cores: number of materials, model, lobe and gains by left-out lights,
/// the fit, standard errors and flags.
pub fn automatic(plan: &Plan, add: Add<'_>) -> Result<(), BenchError> {
    let options = FitOptions::default();
    for (name, _, problem) in &problems(plan) {
        let (judged, times) = repeated(plan.repeats, || {
            let fit = || fit_observations(&problem.observations, &options, &mut |_| ControlFlow::Continue(()));
            let (judged, cpu_s) = time_of_process(fit)?;
            Ok((judged?, cpu_s))
        })?;
        let task = &judged.task;
        let work = format!("{}: {} x {}", options.solver, task.materials, task.lobe.name());
        add(Entry {
            relight: Some(score(task.lobe, problem, &judged.solution.mixture).relight),
            bar: Some(AUTOMATIC),
            ..Entry::new((Section::Automatic, name), (work, task.objective), size(problem), Ok(times))
        })?;
    }
    Ok(())
}

/// Points and samples.
pub fn size(problem: &Problem) -> [usize; 2] {
    [problem.observations.points(), problem.observations.samples()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_objective_is_that_of_a_fit() {
        assert_eq!(FitOptions::default().objective, DEFAULT.name());
    }
}
