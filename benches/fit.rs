//! `cargo bench`: the inner loop and the solvers on the marble scene at the size of the paper, for comparing two states of the
//! code. Wall time of one thread on a machine with nothing else to do; `rigd bench` has processor times, errors and bars.
#![allow(clippy::unwrap_used)]

use divan::Bencher;
use divan::counter::ItemsCount;
use rigd::numerics::brdf::Material;
use rigd::numerics::fit::kernel::{Sign, normal_at, weights_at};
use rigd::numerics::fit::objective::Objective;
use rigd::numerics::fit::prepared::{Prepared, Recipe, brightness};
use rigd::numerics::fit::solver::by_name;
use rigd::numerics::simd::Level;
use rigd::study::forward::TrueMaterial;
use rigd::study::method::{LOBE, Method};
use rigd::study::scene::{Problem, Scene};

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().unwrap();
    divan::main();
}

/// What a fit minimises unless told otherwise.
const OBJECTIVE: Objective = Objective::NOISE_CAUCHY;

fn problem() -> Problem {
    Scene::marble().generate(0)
}

fn ready(problem: &Problem) -> (Prepared, Vec<Material>, ItemsCount) {
    let observations = &problem.observations;
    let recipe = Recipe { lobe: LOBE, objective: OBJECTIVE, brightness: brightness(observations) };
    let material = |truth: &TrueMaterial| Material { rho_d: truth.rho_d, rho_s: truth.rho_s, beta: truth.beta };
    let materials = problem.truth.materials.iter().map(material).collect();
    (Prepared::new(observations, &recipe), materials, ItemsCount::new(observations.samples()))
}

#[divan::bench(args = Level::available())]
fn normal_equations(bencher: Bencher<'_, '_>, level: Level) {
    let (prepared, materials, samples) = ready(&problem());
    bencher.counter(samples).bench(|| normal_at(level, &prepared, &materials, Sign::Free));
}

#[divan::bench(args = Level::available())]
fn weights(bencher: Bencher<'_, '_>, level: Level) {
    let (prepared, materials, samples) = ready(&problem());
    bencher.counter(samples).bench(|| weights_at(level, &prepared, &materials, Sign::NonNegative));
}

#[divan::bench(args = ["varpro", "subset"])]
fn solver(bencher: Bencher<'_, '_>, name: &str) {
    let (problem, method) = (problem(), Method::new(by_name(name).unwrap(), OBJECTIVE));
    let samples = ItemsCount::new(problem.observations.samples());
    bencher.counter(samples).bench(|| method.solve(&problem.observations, problem.truth.materials.len()));
}
