//! Variable projection: the weights are eliminated exactly at every point, so that the search runs over the BRDF
//! parameters alone (`varpro`), or over those of a part of the points (`subset`).
//!
//! Non-negative weights clip the noise of points that lack a material on one side, and the rest of it biases the
//! parameters by many standard errors. Free weights do not; but where the data do not tell the materials apart they run
//! wild. So the parameters found with free weights are taken only if they predict left-out lights better.

use super::folds::{Folds, predicted};
use super::initialise::{Class, classes};
use super::kernel::{self, Sign};
use super::levmar::{self, Normal, Problem, Stop};
use super::observations::Observations;
use super::prepared::{Prepared, Recipe, brightness};
use super::sampling::stratified;
use super::solver::{OnIteration, Solution, Solver, Task, Termination};
use super::unknowns::{Colour, Unknowns};
use super::{Mixture, gauge};
use crate::numerics::brdf::Material;
use nalgebra::DVector;

/// Roughnesses a search starts from.
const BETA_STARTS: [f64; 3] = [0.06, 0.15, 0.35];

/// Specular albedo a search starts from, in parts of the largest diffuse albedo.
const SPECULAR_START: f64 = 0.1;

/// Points of the first search, from several starts, and of the second.
const COARSE: (usize, usize) = (384, 3000);

/// Points the free weights are judged on by left-out lights.
const JUDGED: usize = 800;

/// When the first search, the second, those without a light, and the last one stop.
const COARSE_STOP: Stop = Stop { relative_decrease: 1e-3, iterations: 40 };
const MEDIUM_STOP: Stop = Stop { relative_decrease: 1e-5, iterations: 40 };
pub(super) const FOLD_STOP: Stop = Stop { relative_decrease: 1e-4, iterations: 3 };
const FINE_STOP: Stop = Stop { relative_decrease: 1e-9, iterations: 200 };

/// Where a search over BRDF parameters ended.
#[derive(Clone, Debug)]
pub struct Found {
    /// The BRDF parameters.
    pub materials: Vec<Material>,
    /// Their cost, in prepared units.
    pub cost: f64,
    /// Steps tried.
    pub iterations: usize,
    /// True when nothing more was to be gained.
    pub converged: bool,
}

struct Projected<'a> {
    prepared: &'a Prepared,
    unknowns: &'a Unknowns,
    sign: Sign,
}

impl Problem for Projected<'_> {
    fn normal(&self, x: &DVector<f64>) -> Normal {
        self.unknowns.reduce(&kernel::normal(self.prepared, &self.unknowns.unpack(x), self.sign))
    }

    // Sums over samples are f32.
    fn noise(&self) -> f64 {
        1e-8
    }
}

/// Minimises the cost over the BRDF parameters from `start`.
pub fn search(prepared: &Prepared, start: &[Material], colour: Colour, sign: Sign, stop: Stop) -> Found {
    let unknowns = Unknowns::new(start, colour);
    let problem = Projected { prepared, unknowns: &unknowns, sign };
    let outcome = levmar::minimise(&problem, &unknowns.pack(), &unknowns.bounds(), stop);
    Found {
        materials: unknowns.unpack(&outcome.x),
        cost: outcome.cost,
        iterations: outcome.iterations,
        converged: outcome.converged,
    }
}

/// BRDF parameters to start a search from: diffuse albedos of the classes (paper Eq. 5-8), each roughness in turn.
pub fn starts(observations: &Observations, materials: usize) -> Vec<Vec<Material>> {
    let classes = classes(observations, materials);
    let with = |beta: f64| {
        let material = |class: &Class| {
            let largest = class.diffuse.rho_d.iter().copied().fold(0.0, f64::max);
            Material { rho_d: class.diffuse.rho_d, rho_s: [SPECULAR_START * largest; 3], beta }
        };
        classes.iter().map(material).collect()
    };
    BETA_STARTS.iter().map(|&beta| with(beta)).collect()
}

/// The best of the searches from every start, non-negative weights.
pub fn multi_start(observations: &Observations, recipe: &Recipe<'_>, materials: usize, colour: Colour) -> Found {
    let prepared = Prepared::new(observations, recipe);
    let from = |start: &Vec<Material>| search(&prepared, start, colour, Sign::NonNegative, COARSE_STOP);
    let mut found = starts(observations, materials).iter().map(from).collect::<Vec<Found>>();
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    found.swap_remove(0)
}

/// What of the points the BRDF parameters are fitted to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Extent {
    All,
    /// So many, chosen over classes and half angles.
    Subset(usize),
}

/// Variable projection on all points.
pub struct Varpro;

/// BRDF parameters from so many points, then one pass for the weights of all.
pub struct Subset(pub usize);

impl Solver for Varpro {
    fn name(&self) -> &'static str {
        "varpro"
    }

    fn solve(&self, observations: &Observations, task: &Task, progress: OnIteration<'_>) -> Solution {
        solve(observations, task, Extent::All, progress)
    }
}

impl Solver for Subset {
    fn name(&self) -> &'static str {
        "subset"
    }

    fn solve(&self, observations: &Observations, task: &Task, progress: OnIteration<'_>) -> Solution {
        solve(observations, task, Extent::Subset(self.0), progress)
    }
}

fn solve(observations: &Observations, task: &Task, extent: Extent, progress: OnIteration<'_>) -> Solution {
    let part = match extent {
        Extent::Subset(points) if points < observations.points() => {
            Some(stratified(observations, task.materials, points))
        }
        _ => None,
    };
    let part = part.map(|points| observations.select(&points));
    let fitted = part.as_ref().unwrap_or(observations);
    let recipe = recipe(task, fitted);
    let alpha = fit_alpha(fitted, task, &recipe, progress);
    finish(observations, &recipe, alpha)
}

/// What the samples of a task are made ready with.
pub fn recipe<'a>(task: &'a Task, observations: &Observations) -> Recipe<'a> {
    Recipe { lobe: task.lobe, objective: task.objective, brightness: brightness(observations) }
}

/// BRDF parameters and how they were found.
pub struct AlphaFit {
    /// Where the search ended.
    pub found: Found,
    /// Constraint of the weights during the last search.
    pub sign: Sign,
    /// True when the caller broke off.
    pub cancelled: bool,
    /// What a reader must know.
    pub notes: Vec<String>,
}

/// BRDF parameters from coarse to fine, then with free weights if left-out lights say so.
pub fn fit_alpha(observations: &Observations, task: &Task, recipe: &Recipe<'_>, progress: OnIteration<'_>) -> AlphaFit {
    // Evenly spread parts of a stratified choice are stratified.
    let some = observations.select(&stratified(observations, task.materials, COARSE.1));
    let coarse = some.subset(COARSE.0);
    let mut found = multi_start(&coarse, recipe, task.materials, task.colour);
    let mut iterations = found.iterations;
    let mut cancelled = progress(iterations, found.cost).is_break();
    let mut stage = |prepared: &Prepared, from: &Found, sign: Sign, stop: Stop| {
        let next = search(prepared, &from.materials, task.colour, sign, stop);
        iterations += next.iterations;
        cancelled |= progress(iterations, next.cost).is_break();
        next
    };
    let large = observations.points() > 2 * COARSE.1;
    let medium = large.then(|| Prepared::new(&some, recipe));
    if let Some(medium) = &medium {
        found = stage(medium, &found, Sign::NonNegative, MEDIUM_STOP);
    }
    let mut sign = Sign::NonNegative;
    let mut notes = Vec::new();
    // A single material's weights are never negative: there is nothing to free.
    if task.materials > 1 {
        if free_weights_predict_better(&some.subset(JUDGED), recipe, &found.materials, task.colour) {
            sign = Sign::Free;
        } else {
            notes.push(
                "free weights predicted left-out lights no better: the parameters were found with weights >= 0"
                    .to_owned(),
            );
        }
    }
    if let (Some(medium), Sign::Free) = (&medium, sign) {
        found = stage(medium, &found, sign, MEDIUM_STOP);
    }
    found = stage(&Prepared::new(observations, recipe), &found, sign, FINE_STOP);
    found.iterations = iterations;
    AlphaFit { found, sign, cancelled, notes }
}

/// True when the parameters found with free weights predict left-out lights better than those found with non-negative
/// ones; all predictions are made with non-negative weights.
fn free_weights_predict_better(
    observations: &Observations,
    recipe: &Recipe<'_>,
    start: &[Material],
    colour: Colour,
) -> bool {
    let folds = Folds::new(observations);
    let error =
        |sign: Sign| predicted(&folds, recipe, |prepared| search(prepared, start, colour, sign, FOLD_STOP).materials);
    match (error(Sign::Free), error(Sign::NonNegative)) {
        (Some(free), Some(bounded)) => free.overall < bounded.overall,
        _ => false,
    }
}

/// Non-negative weights of every point, and the normal form.
pub fn finish(observations: &Observations, recipe: &Recipe<'_>, alpha: AlphaFit) -> Solution {
    let materials = alpha.found.materials;
    let (gamma, cost) = stream_weights(observations, recipe, &materials);
    let mut mixture = Mixture { materials, gamma };
    gauge::normalise(&mut mixture);
    let termination = match (alpha.cancelled, alpha.found.converged) {
        (true, _) => Termination::Cancelled,
        (false, true) => Termination::Converged,
        (false, false) => Termination::IterationLimit,
    };
    Solution { mixture, cost, iterations: alpha.found.iterations, termination, sign: alpha.sign, notes: alpha.notes }
}

/// Non-negative weights of every point, and the cost; samples are made ready a part at a time, so that millions of points
/// need no second copy in memory.
pub fn stream_weights(observations: &Observations, recipe: &Recipe<'_>, materials: &[Material]) -> (Vec<f64>, f64) {
    const PART: usize = 64;
    let blocks = observations.blocks();
    let (mut gamma, mut cost) = (Vec::with_capacity(observations.points() * materials.len()), 0.0);
    for begin in (0..blocks).step_by(PART) {
        let prepared = Prepared::of_blocks(observations, recipe, begin..(begin + PART).min(blocks));
        let (part, part_cost) = kernel::weights(&prepared, materials, Sign::NonNegative);
        gamma.extend(part);
        cost += part_cost * prepared.unit2;
    }
    (gamma, cost)
}
