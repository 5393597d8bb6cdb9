//! Single passes of the inner loop over a marble scene, with every instruction set the processor has.

use super::fits::{DEFAULT, problems, size};
use super::{Add, BenchError, Entry, Plan, Section, Times, repeated};
use crate::numerics::brdf::Material;
use crate::numerics::fit::kernel::{self, Sign};
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::prepared::{Prepared, Recipe, brightness};
use crate::numerics::simd::Level;
use crate::study::clock::OneThread;
use crate::study::forward::TrueMaterial;
use crate::study::method::LOBE;

/// A pass: normal equations with free weights, as the search ends; or non-negative weights, as the fit ends.
#[derive(Clone, Copy)]
enum Pass {
    Normal,
    Weights,
}

impl Pass {
    fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal equations",
            Self::Weights => "weights",
        }
    }

    fn run(self, level: Level, prepared: &Prepared, materials: &[Material]) {
        match self {
            Self::Normal => drop(kernel::normal_at(level, prepared, materials, Sign::Free)),
            Self::Weights => drop(kernel::weights_at(level, prepared, materials, Sign::NonNegative)),
        }
    }
}

/// Both passes with plain squares and with the default objective.
pub fn passes(plan: &Plan, add: Add<'_>) -> Result<(), BenchError> {
    let [(name, scene, problem), _] = problems(plan);
    let observations = &problem.observations;
    let materials: Vec<Material> = scene.materials.iter().map(material).collect();
    for pass in [Pass::Normal, Pass::Weights] {
        for objective in [Objective::NOISE, DEFAULT] {
            let recipe = Recipe { lobe: LOBE, objective, brightness: brightness(observations) };
            let prepared = Prepared::new(observations, &recipe);
            let mut scalar_s = None;
            for level in Level::available() {
                let times = measure(plan, || pass.run(level, &prepared, &materials))?;
                let scalar_s = *scalar_s.get_or_insert(times.median_s);
                add(Entry {
                    level: Some(level),
                    speedup: Some(scalar_s / times.median_s),
                    ..Entry::new((Section::Pass, name), (pass.name().to_owned(), objective), size(&problem), Ok(times))
                })?;
            }
        }
    }
    Ok(())
}

fn measure(plan: &Plan, work: impl Fn() + Send + Sync) -> Result<Times, BenchError> {
    let thread = OneThread::new()?;
    let ((), times) = repeated(plan.repeats, || Ok(thread.time(&work)?))?;
    Ok(times)
}

fn material(truth: &TrueMaterial) -> Material {
    Material { rho_d: truth.rho_d, rho_s: truth.rho_s, beta: truth.beta }
}
