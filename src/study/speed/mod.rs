//! Speed against accuracy: every solver with every objective, one thread.

mod chart;
mod measure;

use super::chart::ChartError;
use super::csv::{self, number};
use super::method::{LOBE, Method};
use super::scene::{Problem, Scene};
use super::score::Score;
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::quality::Quality;
use crate::numerics::fit::varpro::Subset;
pub use measure::MeasureError;
use std::path::Path;

/// Sizes of subsets in the short form.
static FEW: [Subset; 1] = [Subset(300)];
/// Sizes of subsets in the long form.
static MANY: [Subset; 4] = [Subset(200), Subset(500), Subset(1000), Subset(3000)];

/// What a study of speed covers.
pub struct Plan {
    /// Scenes with their names.
    pub scenes: Vec<(String, Scene)>,
    /// Seeds: 0 to this, exclusive.
    pub seeds: u64,
    /// Sizes of the subsets.
    pub subsets: &'static [Subset],
    /// False leaves out the paper's alternation beyond its ten rounds: it takes seconds a fit.
    pub to_the_end: bool,
    /// Photographs, if there are any.
    pub photographs: Option<Photographs>,
}

/// A dataset of photographs: nothing is known of it but what it shows.
pub struct Photographs {
    /// Name in table and chart.
    pub name: String,
    /// Its samples.
    pub observations: Observations,
    /// Number of materials to fit.
    pub materials: usize,
}

/// One fit.
pub struct Measurement {
    /// Name of the scene.
    pub scene: String,
    /// How it was fitted.
    pub method: Method,
    /// Points of the scene.
    pub scene_points: usize,
    /// Seed of the scene; none for photographs.
    pub seed: Option<u64>,
    /// The light left out; none for synthetic scenes, which have lights of their own to judge by.
    pub left_out: Option<usize>,
    /// Processor time of the thread that fitted, seconds.
    pub cpu_s: f64,
    /// Outer iterations.
    pub iterations: usize,
    /// Errors.
    pub outcome: Outcome,
}

/// How good a fit turned out.
#[derive(Clone, Copy)]
pub enum Outcome {
    /// Against the truth of a synthetic scene.
    Truth(Score),
    /// On the light left out of the photographs; none when no point could be judged or an error is not finite.
    LeftOut(Option<Quality>),
}

impl Outcome {
    /// Relative error under lights the fit never saw.
    pub fn unseen_error(&self) -> f64 {
        match self {
            Self::Truth(score) => score.relight,
            Self::LeftOut(quality) => quality.map_or(f64::INFINITY, |q| q.mean_relative_error),
        }
    }

    /// The same in highlights.
    fn unseen_highlight_error(&self) -> Option<f64> {
        match self {
            Self::Truth(score) => score.relight_highlight,
            Self::LeftOut(quality) => quality.and_then(|q| q.highlight_relative_error),
        }
    }
}

impl Plan {
    /// Two scenes of 3 000 points: under a minute of processor time.
    pub fn short() -> Self {
        let small = |scene: Scene| Scene { points: 3000, ..scene };
        let scenes = vec![("marble".to_owned(), small(Scene::marble())), ("wood".to_owned(), small(Scene::wood()))];
        Self { scenes, seeds: 2, subsets: &FEW, to_the_end: false, photographs: None }
    }

    /// Both scenes at the size of Zheng 2008.
    pub fn long() -> Self {
        let scenes = vec![("marble".to_owned(), Scene::marble()), ("wood".to_owned(), Scene::wood())];
        Self { scenes, seeds: 8, subsets: &MANY, to_the_end: true, photographs: None }
    }

    /// Every way to fit.
    fn methods(&self) -> Vec<Method> {
        Objective::ALL.into_iter().flat_map(|(_, o)| Method::all(o, self.subsets, self.to_the_end)).collect()
    }
}

/// Runs the plan; `progress` hears of every fit: how many are done, of how many.
///
/// # Errors
/// A thread cannot be started or its clock cannot be read.
pub fn run(plan: &Plan, progress: &mut dyn FnMut(usize, usize)) -> Result<Vec<Measurement>, MeasureError> {
    let methods = plan.methods();
    let lights = plan.photographs.as_ref().map_or(Vec::new(), |p| measure::lights_to_leave_out(p.observations.lights));
    let total = methods.len() * (plan.scenes.len() * plan.seeds as usize + lights.len());
    let bench = measure::Bench::new()?;
    let mut all = Vec::with_capacity(total);
    for (name, scene) in &plan.scenes {
        for seed in 0..plan.seeds {
            let problem = scene.generate(seed);
            for &method in &methods {
                all.push(synthetic(&bench, name, scene, &problem, method, seed)?);
                progress(all.len(), total);
            }
        }
    }
    if let Some(photographs) = &plan.photographs {
        for &light in &lights {
            for &method in &methods {
                all.push(bench.photographs(photographs, method, light)?);
                progress(all.len(), total);
            }
        }
    }
    Ok(all)
}

fn synthetic(
    bench: &measure::Bench,
    name: &str,
    scene: &Scene,
    problem: &Problem,
    method: Method,
    seed: u64,
) -> Result<Measurement, MeasureError> {
    let fitted = bench.fit(&problem.observations, scene.materials.len(), method)?;
    Ok(Measurement {
        scene: name.to_owned(),
        method,
        scene_points: problem.observations.points(),
        seed: Some(seed),
        left_out: None,
        cpu_s: fitted.cpu_s,
        iterations: fitted.iterations,
        outcome: Outcome::Truth(super::score::score(LOBE, problem, &fitted.mixture)),
    })
}

/// Columns of `speed.csv`.
pub const COLUMNS: [&str; 16] = [
    "scene",
    "scene_points",
    "seed",
    "left_out_light",
    "solver",
    "objective",
    "fitted_points",
    "round_limit",
    "cpu_s",
    "iterations",
    "unseen_error_pct",
    "unseen_highlight_error_pct",
    "fit_error_pct",
    "beta_error_pct",
    "rho_s_error_pct",
    "gamma_rms",
];

fn row(measured: &Measurement) -> Vec<String> {
    let percent = |value: Option<f64>| number(value.map(|v| 100.0 * v));
    let count = |value: Option<usize>| value.map_or(String::new(), |v| v.to_string());
    let score = match measured.outcome {
        Outcome::Truth(score) => Some(score),
        Outcome::LeftOut(_) => None,
    };
    let parameters = score.and_then(|s| s.parameters);
    let method = &measured.method;
    vec![
        measured.scene.clone(),
        measured.scene_points.to_string(),
        measured.seed.map_or(String::new(), |seed| seed.to_string()),
        count(measured.left_out),
        method.solver.name().to_owned(),
        method.objective.name().to_owned(),
        method.points.unwrap_or(measured.scene_points).min(measured.scene_points).to_string(),
        count(method.rounds),
        measured.cpu_s.to_string(),
        measured.iterations.to_string(),
        percent(Some(measured.outcome.unseen_error())),
        percent(measured.outcome.unseen_highlight_error()),
        percent(score.map(|s| s.fit)),
        percent(parameters.map(|p| p.beta)),
        percent(parameters.map(|p| p.rho_s)),
        number(parameters.map(|p| p.gamma)),
    ]
}

/// The measurements as a table.
pub fn table(measured: &[Measurement]) -> csv::Table {
    csv::Table { columns: &COLUMNS, rows: measured.iter().map(row).collect() }
}

/// Writes `speed.csv`, `speed.svg` and `speed.png` into `directory`.
///
/// # Errors
/// A file cannot be written or the chart cannot be drawn.
pub fn write(directory: &Path, measured: &[Measurement]) -> Result<(), ChartError> {
    let path = directory.join("speed.csv");
    table(measured).write(&path).map_err(|source| ChartError::Write { path: path.display().to_string(), source })?;
    chart::draw(measured)?.write(directory, "speed")
}
