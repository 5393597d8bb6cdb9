//! Accuracy: what a fit promises (optimum, standard errors, flags), held against scenes of known truth.

mod flags;
mod measure;

use super::csv;
use super::median;
use super::method::Method;
use super::scene::Scene;
use super::score::{Score, score};
use crate::numerics::fit::objective::Objective;
use crate::pipeline::fit::FitOptions;
use crate::pipeline::judged::fit_observations;
use crate::study::forward::{Reflectance, TrueMaterial};
pub use flags::{Counts, flags};
pub use measure::{Measured, measure};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::path::Path;

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Points of a scene; none takes its full size.
    pub points: Option<usize>,
    /// Seeds a scene.
    pub seeds: u64,
    /// Cases of each kind whose flags are judged.
    pub flagged: u64,
}

/// A promise, what was measured of it, and whether it holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Bar {
    /// What was measured.
    pub name: String,
    /// How often or how large.
    pub value: f64,
    /// Least value that holds.
    pub least: f64,
    /// Largest value that holds; infinite for a figure that is only compared with others.
    pub most: f64,
}

impl Bar {
    fn new(name: impl Into<String>, value: f64, least: f64, most: f64) -> Self {
        Self { name: name.into(), value, least, most }
    }

    /// True when it holds.
    pub fn holds(&self) -> bool {
        (self.least..=self.most).contains(&self.value)
    }

    /// What the value ought to be.
    pub fn range(&self) -> String {
        if self.most.is_infinite() { String::new() } else { format!("{} to {}", self.least, self.most) }
    }

    /// Whether it holds, in words; none for a figure without a bar.
    pub fn verdict(&self) -> &'static str {
        match (self.most.is_infinite(), self.holds()) {
            (true, _) => "",
            (false, true) => "holds",
            (false, false) => "falls short",
        }
    }
}

/// Measures everything.
pub fn run(plan: &Plan) -> Vec<Bar> {
    let mut bars = Vec::new();
    for (name, scene) in [("marble", Scene::marble()), ("wood", Scene::wood())] {
        let scene = Scene { points: plan.points.unwrap_or(scene.points), ..scene };
        let all: Vec<Measured> = (0..plan.seeds).into_par_iter().filter_map(|seed| measure(&scene, seed)).collect();
        let refused = plan.seeds - all.len() as u64;
        bars.push(Bar::new(format!("{name}: seeds that were not fitted"), refused as f64, 0.0, 0.0));
        of_scene(&mut bars, name, &all, plan.seeds);
    }
    bars.push(count(plan));
    stack(&mut bars, plan);
    let Counts { missed, unsound, alarms, sound, regimes } = flags(plan.flagged);
    bars.push(Bar::new(format!("undetermined cases called identified, of {unsound}"), missed, 0.0, 0.0));
    for (name, missed, of) in regimes {
        bars.push(Bar::new(format!("of these: {name}, of {of}"), missed, 0.0, 0.0));
    }
    bars.push(Bar::new(format!("false alarms on {sound} sound cases %"), 100.0 * alarms / sound.max(1.0), 0.0, 2.0));
    bars
}

fn of_scene(bars: &mut Vec<Bar>, scene: &str, all: &[Measured], seeds: u64) {
    let percent = |count: usize, of: usize| 100.0 * count as f64 / of.max(1) as f64;
    let reached = all.iter().filter(|one| one.excess <= 1e-9).count();
    bars.push(Bar::new(format!("{scene}: optimum reached, % of seeds"), percent(reached, seeds as usize), 98.0, 100.0));
    let middle = |of: fn(&Measured) -> f64| 100.0 * median(all.iter().map(of).collect());
    bars.push(Bar::new(format!("{scene}: median beta error %"), middle(|one| one.beta), 0.0, 0.2));
    bars.push(Bar::new(format!("{scene}: median relight error %"), middle(|one| one.relight), 0.0, 0.61));
    let parameters = all.iter().map(|one| one.pulls.len()).max().unwrap_or(0);
    for parameter in 0..parameters {
        let name = measure::name(parameter);
        let pulls: Vec<f64> = all.iter().filter_map(|one| one.pulls.get(parameter).copied().flatten()).collect();
        if pulls.is_empty() {
            continue;
        }
        let held = pulls.iter().filter(|pull| pull.abs() <= 1.96).count();
        bars.push(Bar::new(format!("{scene}: coverage {name} %"), percent(held, pulls.len()), 92.0, 98.0));
        let bounds: Vec<f64> = all.iter().filter_map(|one| one.scatter.get(parameter).copied().flatten()).collect();
        bars.push(Bar::new(format!("{scene}: scatter / bound {name}"), rms(&bounds), 0.0, 1.3));
    }
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// Scenes of 1, 2 and 3 materials whose number was found.
fn count(plan: &Plan) -> Bar {
    let cases: Vec<(usize, u64)> = (1..=3).flat_map(|m| (0..10).map(move |seed| (m, seed))).collect();
    let right = cases.par_iter().filter(|&&(materials, seed)| {
        let mut scene = Scene { points: plan.points.unwrap_or(6000), ..Scene::marble() };
        scene.materials.push(TrueMaterial { rho_d: [0.10, 0.22, 0.30], rho_s: [0.03, 0.04, 0.05], beta: 0.18 });
        scene.materials.truncate(materials);
        let observations = scene.generate(seed).observations;
        let found = fit_observations(&observations, &FitOptions::default(), &mut |_| ControlFlow::Continue(()));
        found.is_ok_and(|found| found.task.materials == materials)
    });
    Bar::new("number of materials found, of 30 scenes", right.count() as f64, 29.0, 30.0)
}

/// Relight errors on a stack of ordinary imperfections: the default, the paper's alternation, and the paper's objectives.
fn stack(bars: &mut Vec<Bar>, plan: &Plan) {
    let mut scene = Scene { points: plan.points.unwrap_or(6000), ..Scene::marble() };
    (scene.reflectance, scene.light_error_mm, scene.drift) = (Reflectance::GgxFresnel, 2.0, 0.02);
    (scene.outliers, scene.floor) = (0.01, 0.02);
    let problems: Vec<_> = (0..plan.seeds.min(10)).map(|seed| scene.generate(seed)).collect();
    let fitted = problems.par_iter().map(|problem| {
        let found = fit_observations(&problem.observations, &FitOptions::default(), &mut |_| ControlFlow::Continue(()));
        found.map_or(f64::INFINITY, |found| score(found.task.lobe, problem, &found.solution.mixture).relight)
    });
    bars.push(Bar::new("imperfect rig: default, median relight error %", 100.0 * median(fitted.collect()), 0.0, 2.0));
    for method in Method::all(Objective::RELATIVE, &[], false).iter().filter(|method| method.rounds.is_some()) {
        compare(bars, &problems, method);
    }
    for objective in [Objective::ABSOLUTE, Objective::RELATIVE, Objective::NOISE, Objective::NOISE_CAUCHY] {
        compare(bars, &problems, &Method { automatic: false, ..Method::automatic(objective) });
    }
}

fn compare(bars: &mut Vec<Bar>, problems: &[super::scene::Problem], method: &Method) {
    let scores = problems.par_iter().map(|problem| {
        let solution = method.solve(&problem.observations, 2);
        solution.map_or(Score::FAILURE, |found| score(super::method::LOBE, problem, &found.mixture))
    });
    let scores: Vec<_> = scores.collect();
    let name = format!("imperfect rig: {} {}", method.solver_label(), method.objective.name());
    let overall = 100.0 * median(scores.iter().map(|s| s.relight).collect());
    let bright = 100.0 * median(scores.iter().filter_map(|s| s.relight_highlight).collect());
    bars.push(Bar::new(format!("{name}, relight error %"), overall, 0.0, f64::INFINITY));
    bars.push(Bar::new(format!("{name}, highlight error %"), bright, 0.0, f64::INFINITY));
}

/// Writes `accuracy.csv` into `directory`.
///
/// # Errors
/// The file cannot be written.
pub fn write(directory: &Path, bars: &[Bar]) -> std::io::Result<()> {
    table(bars).write(&directory.join("accuracy.csv"))
}

/// The bars as a table.
pub fn table(bars: &[Bar]) -> csv::Table {
    let row = |bar: &Bar| {
        vec![
            bar.name.clone(),
            bar.value.to_string(),
            bar.least.to_string(),
            bar.most.to_string(),
            bar.verdict().to_owned(),
        ]
    };
    csv::Table { columns: &["bar", "value", "least", "most", "verdict"], rows: bars.iter().map(row).collect() }
}
