//! Fits of millions of samples. The observations are those of a marble scene over and over: a fit costs the same whether its
//! points are alike or not, and no time goes into making them different.

use super::fits::DEFAULT;
use super::memory::{self, Ready, Shortage};
use super::{Add, Bar, BenchError, Entry, ONCE_ABOVE, Plan, Section, Times, repeated};
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::solver::{SOLVERS, Solver};
use crate::study::clock::OneThread;
use crate::study::method::Method;
use crate::study::scene::Scene;

/// An image of 4 million pixels under seven lights.
const LARGE: Bar = Bar { most_s: 0.5, goal_s: 0.1 };

/// Azimuths of seven lights that one point can see all of, degrees.
const NEAR_AZIMUTHS_DEG: [f64; 7] = [-45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0];

/// Solvers of the growth.
const GROWING: [&str; 2] = ["subset", "varpro"];

/// `subset` on a large image, every pixel of it lit by all seven lights.
pub fn large(plan: &Plan, add: Add<'_>) -> Result<(), BenchError> {
    let scene = Scene { azimuths_deg: NEAR_AZIMUTHS_DEG.to_vec(), ..marble(plan) };
    let source = scene.generate(0).observations.filtered(NEAR_AZIMUTHS_DEG.len(), |_| true).0;
    let case = Case {
        place: (Section::Large, "marble seen by all lights"),
        source,
        points: plan.large_points,
        materials: scene.materials.len(),
        repeats: plan.repeats,
        bar: Some(LARGE),
    };
    case.measure(&["subset"], add)
}

/// `subset` and `varpro` on ever more samples.
pub fn growth(plan: &Plan, add: Add<'_>) -> Result<(), BenchError> {
    let scene = marble(plan);
    let source = scene.generate(0).observations;
    for &samples in &plan.growth {
        let points = (samples as f64 * source.points() as f64 / source.samples() as f64).round() as usize;
        let repeats = if samples > ONCE_ABOVE { 1 } else { plan.repeats };
        let case = Case {
            place: (Section::Growth, "marble"),
            source: source.clone(),
            points,
            materials: scene.materials.len(),
            repeats,
            bar: None,
        };
        case.measure(&GROWING, add)?;
    }
    Ok(())
}

fn marble(plan: &Plan) -> Scene {
    let scene = Scene::marble();
    Scene { points: plan.points.unwrap_or(scene.points), ..scene }
}

/// So many points like those of `source`.
struct Case {
    place: (Section, &'static str),
    source: Observations,
    points: usize,
    materials: usize,
    repeats: usize,
    bar: Option<Bar>,
}

impl Case {
    /// Measures the solvers of these names, with the default objective.
    fn measure(&self, solvers: &[&str], add: Add<'_>) -> Result<(), BenchError> {
        let mut made: Option<Observations> = None;
        for &solver in SOLVERS.iter().filter(|solver| solvers.contains(&solver.name())) {
            let method = Method::new(solver, DEFAULT);
            let times = match self.check(solver, made.is_some())? {
                Ok(()) => Ok(self.fit(made.get_or_insert_with(|| spread(&self.source, self.points)), method)?),
                Err(shortage) => Err(shortage),
            };
            let samples = made.as_ref().map_or_else(|| self.expected_samples(), Observations::samples);
            let what = (method.solver_label(), method.objective);
            add(Entry { bar: self.bar, ..Entry::new(self.place, what, [self.points, samples], times) })?;
        }
        Ok(())
    }

    fn expected_samples(&self) -> usize {
        (self.points as f64 * self.source.samples() as f64 / self.source.points() as f64).round() as usize
    }

    /// Whether the memory suffices for a solver; the observations are part of what it needs, unless they are there already.
    fn check(&self, solver: &dyn Solver, made: bool) -> Result<Result<(), Shortage>, BenchError> {
        let held = if made { memory::needed_bytes(&self.source, self.points, 0, Ready::Part) } else { 0.0 };
        Ok(memory::check(self.needed_bytes(solver), held + memory::available_bytes()?))
    }

    fn needed_bytes(&self, solver: &dyn Solver) -> f64 {
        let ready = if solver.name() == "subset" { Ready::Part } else { Ready::All };
        memory::needed_bytes(&self.source, self.points, self.materials, ready)
    }

    fn fit(&self, observations: &Observations, method: Method) -> Result<Times, BenchError> {
        let thread = OneThread::new()?;
        let ((), times) = repeated(self.repeats, || {
            let (solution, cpu_s) = thread.time(|| method.solve(observations, self.materials))?;
            solution?;
            Ok(((), cpu_s))
        })?;
        Ok(times)
    }
}

/// So many points: some of `source`, evenly spread, or all of them over and over.
fn spread(source: &Observations, points: usize) -> Observations {
    if points <= source.points() {
        return source.subset(points);
    }
    let mut all = Observations::new(source.lights);
    let mut samples = Vec::new();
    for point in 0..points {
        samples.clear();
        samples.extend(source.of(point % source.points()));
        all.push(point, &samples);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_points_keep_their_samples() {
        let source = Scene { points: 150, ..Scene::marble() }.generate(0).observations;
        let many = spread(&source, 1000);
        assert_eq!(many.points(), 1000);
        for point in [0, source.points(), 999] {
            let of = |observations: &Observations, at: usize| observations.of(at).collect::<Vec<_>>();
            assert_eq!(of(&many, point), of(&source, point % source.points()));
        }
        assert_eq!(spread(&source, 40).points(), 40);
    }
}
