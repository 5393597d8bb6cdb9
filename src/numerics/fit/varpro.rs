//! Variable projection: the weights are eliminated exactly at every point, so that the search runs over the BRDF
//! parameters alone (`varpro`), or over those of a part of the points (`subset`).
//!
//! Non-negative weights clip the noise of points that lack a material on one side, and the rest of it biases the
//! parameters by many standard errors. Free weights do not; but where only the sign of the weights tells the materials
//! apart they run wild. So the parameters are found once more with weights that may fall as far below zero as noise takes
//! them, and taken if they predict left-out lights better; the weights themselves are never negative.

use super::folds::left_out_errors;
use super::initialise::{Class, classes};
use super::kernel::{self, Sign};
use super::levmar::{self, Normal, Problem, Stop};
use super::observations::Observations;
use super::prepared::{Prepared, Recipe, brightness};
use super::sampling::stratified;
use super::solver::{Iterate, OnIteration, Refusal, Solution, Solver, Task, Termination};
use super::unknowns::{Colour, Unknowns};
use super::{Mixture, gauge};
use crate::numerics::brdf::Material;
use crate::numerics::simd::LANES;
use nalgebra::DVector;
use rayon::prelude::*;
use std::ops::ControlFlow;

/// Roughnesses a search starts from.
const BETA_STARTS: [f64; 3] = [0.06, 0.15, 0.35];

/// Specular albedo a search starts from, in parts of the largest diffuse albedo.
const SPECULAR_START: f64 = 0.1;

/// Points of the first search, from several starts, and of the second.
pub(super) const COARSE: (usize, usize) = (384, 3000);

/// When the first search, the second, and the last one stop.
pub(super) const COARSE_STOP: Stop = Stop { relative_decrease: 1e-3, iterations: 40 };
const MEDIUM_STOP: Stop = Stop { relative_decrease: 1e-5, iterations: 40 };
const FINE_STOP: Stop = Stop { relative_decrease: 1e-7, iterations: 200 };

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

    // A residual is rounded by some 1e-6 of it (f32 against a noise of percents), each in its own way.
    fn noise(&self) -> f64 {
        1e-5 / (self.prepared.residuals() as f64).sqrt()
    }

    // With the weights eliminated the linear model holds far: more damping only costs steps.
    fn damping(&self) -> f64 {
        1e-4
    }
}

/// Minimises the cost over the BRDF parameters from `start`.
pub fn search(prepared: &Prepared, start: &[Material], colour: Colour, sign: Sign, stop: Stop) -> Found {
    search_watched(prepared, start, colour, sign, stop, &mut |_, _, _| ControlFlow::Continue(()))
}

/// Callback of a search: steps tried so far, BRDF parameters and their cost; it can break off.
type OnSearchStep<'a> = &'a mut dyn FnMut(usize, &[Material], f64) -> ControlFlow<()>;

/// The same; `on_step` looks on.
fn search_watched(
    prepared: &Prepared,
    start: &[Material],
    colour: Colour,
    sign: Sign,
    stop: Stop,
    on_step: OnSearchStep<'_>,
) -> Found {
    let unknowns = Unknowns::new(start, colour);
    let problem = Projected { prepared, unknowns: &unknowns, sign };
    let outcome =
        levmar::minimise_watched(&problem, &unknowns.pack(), &unknowns.bounds(), stop, &mut |step, x, cost| {
            on_step(step, &unknowns.unpack(x), cost)
        });
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

    fn solve(&self, observations: &Observations, task: &Task, progress: OnIteration<'_>) -> Result<Solution, Refusal> {
        Ok(solve(observations, task, Extent::All, progress))
    }
}

impl Solver for Subset {
    fn name(&self) -> &'static str {
        "subset"
    }

    fn solve(&self, observations: &Observations, task: &Task, progress: OnIteration<'_>) -> Result<Solution, Refusal> {
        Ok(solve(observations, task, Extent::Subset(self.0), progress))
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

/// BRDF parameters from coarse to fine, then with slack for the weights if left-out lights say so.
pub fn fit_alpha(observations: &Observations, task: &Task, recipe: &Recipe<'_>, progress: OnIteration<'_>) -> AlphaFit {
    // Evenly spread parts of a stratified choice are stratified.
    let some = observations.select(&stratified(observations, task.materials, COARSE.1));
    let start = multi_start(&some.subset(COARSE.0), recipe, task.materials, task.colour);
    descend(observations, &some, start, task, recipe, progress)
}

/// From a start that fits roughly to the optimum of all points; `some` is a stratified choice of them.
pub fn descend(
    observations: &Observations,
    some: &Observations,
    start: Found,
    task: &Task,
    recipe: &Recipe<'_>,
    progress: OnIteration<'_>,
) -> AlphaFit {
    let mut found = start;
    let (mut iterations, mut cancelled) = (found.iterations, false);
    let mut stage = |points: &Observations, prepared: &Prepared, from: &Found, sign: Sign, stop: Stop| {
        let mut tell = |step: usize, materials: &[Material], cost: f64| {
            let at = Iterate::new(iterations + step, cost * prepared.unit2, points, materials);
            cancelled |= progress(at).is_break();
            if cancelled { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let next = search_watched(prepared, &from.materials, task.colour, sign, stop, &mut tell);
        // The last step may be taken unseen. Who breaks off here is heard by the next search, or by the caller.
        let _ = tell(next.iterations, &next.materials, next.cost);
        iterations += next.iterations;
        next
    };
    let mut medium = Prepared::new(some, recipe);
    found = stage(some, &medium, &found, Sign::NonNegative, MEDIUM_STOP);
    let (mut sign, mut notes) = (Sign::NonNegative, Vec::new());
    let variance = found.cost / degrees_of_freedom(some, task.materials);
    // A single material's weights are never negative: there is nothing to loosen.
    if task.materials > 1 {
        loosen(&mut medium, &found.materials, variance);
        let loose = stage(some, &medium, &found, Sign::Slack, MEDIUM_STOP);
        match refusal_of_slack(some, &medium, [&found.materials, &loose.materials]) {
            None => (sign, found) = (Sign::Slack, loose),
            Some(reason) => notes.push(format!("{reason}: the parameters were found with weights >= 0")),
        }
    }
    let mut whole = if some.points() == observations.points() { medium } else { Prepared::new(observations, recipe) };
    if sign == Sign::Slack {
        loosen(&mut whole, &found.materials, variance);
    }
    // Weights with slack converge in few steps; the last digits of a biased optimum are not worth many.
    let stop = if sign == Sign::Slack { FINE_STOP } else { MEDIUM_STOP };
    found = stage(observations, &whole, &found, sign, stop);
    found.iterations = iterations;
    AlphaFit { found, sign, cancelled, notes }
}

/// Lets the weights that `materials` leave fall as far below zero as noise takes them.
pub fn loosen(prepared: &mut Prepared, materials: &[Material], residual_variance: f64) {
    let deviations = kernel::deviations(prepared, materials, Sign::Free);
    prepared.loosen(&deviations, materials.len(), residual_variance);
}

/// Residuals less weights, at least 1; each counts as often as a channel repeats another, as it does in the cost.
pub fn degrees_of_freedom(observations: &Observations, materials: usize) -> f64 {
    let copies = 3 / observations.channels();
    (3 * observations.samples()).saturating_sub(copies * materials * observations.points()).max(1) as f64
}

/// Why the parameters found with slack are not to be taken instead of those found with non-negative weights; none if they
/// are. With the non-negative weights that are used in the end they must predict left-out lights better.
fn refusal_of_slack(
    observations: &Observations,
    prepared: &Prepared,
    [bounded, loose]: [&[Material]; 2],
) -> Option<String> {
    match left_out_errors(observations, prepared, [bounded, loose]) {
        Some([bounded, loose]) if loose < bounded => None,
        Some(_) => Some("weights that may fall a little below 0 predicted left-out lights worse".to_owned()),
        None => Some("no light can be left out to judge weights that may fall a little below 0".to_owned()),
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
    Solution {
        mixture,
        cost,
        iterations: alpha.found.iterations,
        termination,
        sign: alpha.sign,
        tilts: None,
        notes: alpha.notes,
    }
}

/// Non-negative weights of every point, and the cost; samples are made ready a part at a time, so that millions of points
/// need no second copy in memory.
pub fn stream_weights(observations: &Observations, recipe: &Recipe<'_>, materials: &[Material]) -> (Vec<f64>, f64) {
    let count = materials.len();
    let mut gamma = vec![0.0; observations.points() * count];
    let part = |prepared: &mut Prepared, (index, gamma): (usize, &mut [f64])| {
        let begin = index * PART;
        prepared.refill(observations, recipe, begin..(begin + PART).min(observations.blocks()));
        kernel::part_weights(prepared, materials, gamma) * prepared.unit2
    };
    let room = || Prepared::empty(recipe).following_the_model(recipe.objective);
    let costs: Vec<f64> = gamma.par_chunks_mut(PART * LANES * count).enumerate().map_init(room, part).collect();
    (gamma, costs.iter().sum())
}

/// Blocks whose weights are found at a time: their rows stay in the cache.
const PART: usize = 8;
