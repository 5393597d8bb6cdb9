//! Fits a material to a dataset and says how good it is.

use super::dataset::Dataset;
use super::identify;
use super::report::{CandidateReport, GAUGE, MaterialFile, Provenance, Report, Seconds};
use crate::numerics::brdf::{self, Lobe};
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::observations::{Observations, Scene};
use crate::numerics::fit::quality::{judge_all, judge_left_out};
use crate::numerics::fit::selection::select_materials;
use crate::numerics::fit::solver::{self, Solution, Solver, Task, Termination};
use crate::numerics::fit::uncertainty::{Uncertainty, uncertainty};
use crate::numerics::fit::unknowns::Colour;
use crate::numerics::fit::weights::WeightRule;
use crate::numerics::fit::{MAX_MATERIALS, Mixture};
use std::ops::ControlFlow;
use std::time::Instant;

/// A point needs this many samples, or as many as there are lights if those are fewer.
const LEAST_SAMPLES: usize = 3;

/// Most worker threads that can be asked for.
const MAX_THREADS: usize = 256;

/// What to fit and how.
#[derive(Clone, Debug, PartialEq)]
pub struct FitOptions {
    /// Number of materials; none lets left-out lights decide.
    pub materials: Option<usize>,
    /// BRDF model name (`numerics::brdf::MODELS`).
    pub model: String,
    /// Solver name; `zheng2008` is the one there is.
    pub solver: String,
    /// Rule of the weights: `exact` or `paper`.
    pub weights: String,
    /// Objective name.
    pub objective: String,
    /// Indices of lights kept out of the fit and used to judge it.
    pub leave_out: Vec<usize>,
    /// Cosine cut-off; none takes the dataset's.
    pub cosine_cutoff: Option<f64>,
    /// Worker threads; none takes all cores. The result does not depend on it.
    pub threads: Option<usize>,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            materials: None,
            model: "ward".to_owned(),
            solver: "zheng2008".to_owned(),
            weights: "exact".to_owned(),
            objective: "noise".to_owned(),
            leave_out: Vec::new(),
            cosine_cutoff: None,
            threads: None,
        }
    }
}

/// Progress of a fit: outer iteration and cost.
#[derive(Clone, Copy, Debug)]
pub struct FitProgress {
    /// Outer iteration, from 1.
    pub iteration: usize,
    /// Cost of the objective.
    pub cost: f64,
}

/// Callback for progress and cancelling.
pub type OnProgress<'a> = &'a mut (dyn FnMut(FitProgress) -> ControlFlow<()> + Send);

/// Why there is no fit at all. A poor fit is a report, not an error.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// The caller's callback broke off.
    #[error("the fit was cancelled")]
    Cancelled,
    /// An option or the data cannot be used: what, where, what to do.
    #[error("{0}")]
    Input(String),
    /// The worker threads could not be started.
    #[error("no worker threads: {0}")]
    Threads(String),
}

/// A fitted material with its report and the maps beside it.
#[derive(Clone, Debug)]
pub struct FitResult {
    /// `report.json`.
    pub report: Report,
    /// `material.json`.
    pub material: MaterialFile,
    /// The observations it was fitted to.
    pub observations: Observations,
    /// Materials and weights, in normal form.
    pub mixture: Mixture,
    /// Standard errors.
    pub uncertainty: Uncertainty,
    /// Size of the image, width and height.
    pub size: [usize; 2],
}

/// The names in [`FitOptions`], resolved.
struct Chosen {
    lobe: &'static dyn Lobe,
    objective: Objective,
    rule: WeightRule,
    solver: &'static dyn Solver,
    cutoff: f64,
}

/// Fits `dataset`.
pub fn fit(dataset: &Dataset, options: &FitOptions, progress: OnProgress<'_>) -> Result<FitResult, FitError> {
    let chosen = check(dataset, options)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads.unwrap_or(0))
        .build()
        .map_err(|error| FitError::Threads(error.to_string()))?;
    pool.install(|| run(dataset, options, &chosen, progress))
}

/// Processor time of this process so far, seconds.
pub fn cpu_seconds() -> f64 {
    let clock = nix::time::clock_gettime(nix::time::ClockId::CLOCK_PROCESS_CPUTIME_ID);
    clock.map_or(0.0, |time| std::time::Duration::from(time).as_secs_f64())
}

fn one_of(what: &str, name: &str, known: &[&str]) -> FitError {
    FitError::Input(format!("unknown {what} \"{name}\": choose one of {}", known.join(", ")))
}

fn check(dataset: &Dataset, options: &FitOptions) -> Result<Chosen, FitError> {
    let models: Vec<&str> = brdf::MODELS.iter().map(|m| m.name()).collect();
    let lobe = brdf::by_name(&options.model).ok_or_else(|| one_of("BRDF model", &options.model, &models))?;
    let objective = Objective::by_name(&options.objective)
        .ok_or_else(|| one_of("objective", &options.objective, &Objective::ALL.map(|(name, _)| name)))?;
    let rule = WeightRule::by_name(&options.weights)
        .ok_or_else(|| one_of("weight rule", &options.weights, &["exact", "paper"]))?;
    let solvers: Vec<&str> = solver::SOLVERS.iter().map(|s| s.name()).collect();
    let solver = solver::by_name(&options.solver).ok_or_else(|| one_of("solver", &options.solver, &solvers))?;
    if options.materials.is_some_and(|m| m == 0 || m > MAX_MATERIALS) {
        return Err(FitError::Input(format!("materials must be 1 to {MAX_MATERIALS}, or auto")));
    }
    if options.threads.is_some_and(|threads| !(1..=MAX_THREADS).contains(&threads)) {
        return Err(FitError::Input(format!("threads must be 1 to {MAX_THREADS}; left out, all cores work")));
    }
    let cutoff = options.cosine_cutoff.unwrap_or(dataset.geometry.cosine_cutoff);
    if !(0.0..1.0).contains(&cutoff) {
        return Err(FitError::Input(format!("the cosine cut-off is {cutoff}: choose a value from 0 to below 1")));
    }
    let lights = dataset.geometry.lights.len();
    if let Some(light) = options.leave_out.iter().find(|&&light| light >= lights) {
        return Err(FitError::Input(format!(
            "light {light} cannot be left out: the dataset has {lights} lights, numbered 0 to {}",
            lights.saturating_sub(1)
        )));
    }
    if (0..lights).all(|light| options.leave_out.contains(&light)) {
        return Err(FitError::Input("every light is left out: keep at least one to fit".to_owned()));
    }
    Ok(Chosen { lobe, objective, rule, solver, cutoff })
}

fn observe(dataset: &Dataset, chosen: &Chosen) -> Observations {
    let geometry = &dataset.geometry;
    let scene = Scene {
        projection: &geometry.projection,
        object: &geometry.object,
        mask: geometry.mask.as_ref(),
        lights: geometry.lights.iter().map(|l| &l.light).zip(&dataset.images).collect(),
        cosine_cutoff: chosen.cutoff,
    };
    Observations::gather(&scene, geometry.width, geometry.height)
}

fn run(
    dataset: &Dataset,
    options: &FitOptions,
    chosen: &Chosen,
    progress: OnProgress<'_>,
) -> Result<FitResult, FitError> {
    let begin = Instant::now();
    let cpu_begin = cpu_seconds();
    let all = observe(dataset, chosen);
    let used_lights = (0..dataset.geometry.lights.len()).filter(|light| !options.leave_out.contains(light)).count();
    let (observations, kept) =
        all.filtered(LEAST_SAMPLES.min(used_lights), |light| !options.leave_out.contains(&light));
    if observations.points() == 0 {
        return Err(FitError::Input(no_samples(dataset, chosen, &all)));
    }
    let observed = Instant::now();

    let (materials, candidates) = choose_materials(options, chosen, &observations, progress)?;
    let initialised = Instant::now();

    let task =
        Task { lobe: chosen.lobe, objective: chosen.objective, materials, rule: chosen.rule, colour: Colour::Coloured };
    let mut report_progress = |iteration, cost| progress(FitProgress { iteration, cost });
    let mut solution = chosen.solver.solve(&observations, &task, &mut report_progress);
    if solution.termination == Termination::Cancelled {
        return Err(FitError::Cancelled);
    }
    crate::numerics::fit::gauge::normalise(&mut solution.mixture);
    let errors = uncertainty(chosen.lobe, &solution.mixture, chosen.objective, &observations);
    let quality = judge_all(chosen.lobe, &solution.mixture, &observations)
        .ok_or_else(|| FitError::Input(no_samples(dataset, chosen, &all)))?;
    let left_out =
        judge_left_out(chosen.lobe, &solution.mixture, &all, &kept, |light| options.leave_out.contains(&light));
    let free_weights = solution.mixture.gamma.iter().filter(|&&g| g > 0.0).count();
    let freedom = (3 * observations.samples()).saturating_sub(free_weights + 7 * materials).max(1);
    let done = Instant::now();

    let report = Report {
        pixels: observations.points(),
        samples: observations.samples(),
        materials,
        model: options.model.clone(),
        solver: options.solver.clone(),
        weights: options.weights.clone(),
        objective: options.objective.clone(),
        mean_relative_error: quality.mean_relative_error,
        highlight_relative_error: quality.highlight_relative_error,
        left_out_relative_error: left_out.map(|q| q.mean_relative_error),
        left_out_highlight_relative_error: left_out.and_then(|q| q.highlight_relative_error),
        left_out: options.leave_out.clone(),
        cost: solution.cost,
        reduced_chi2: quality.chi2 / freedom as f64,
        iterations: solution.iterations,
        termination: match solution.termination {
            Termination::Converged => "converged".to_owned(),
            Termination::IterationLimit | Termination::Cancelled => "iteration limit".to_owned(),
        },
        seconds: Seconds {
            load: 0.0,
            observe: (observed - begin).as_secs_f64(),
            initialise: (initialised - observed).as_secs_f64(),
            fit: (done - initialised).as_secs_f64(),
            total: (done - begin).as_secs_f64(),
        },
        cpu_seconds: cpu_seconds() - cpu_begin,
        cosine_cutoff: chosen.cutoff,
        unusable_samples: observations.unusable,
        candidates: candidates.clone(),
        warnings: warnings(&solution, &observations, &candidates, options),
    };
    let material = MaterialFile {
        format: 1,
        model: options.model.clone(),
        gauge: GAUGE.to_owned(),
        materials: identify::describe(chosen.lobe, &solution.mixture, &errors, &observations),
        size: [dataset.geometry.width, dataset.geometry.height],
        provenance: Provenance {
            software: concat!("rigd ", env!("CARGO_PKG_VERSION")).to_owned(),
            images: dataset.geometry.lights.iter().map(|l| l.name.clone()).collect(),
            simulated: None,
        },
    };
    let size = material.size;
    Ok(FitResult { report, material, observations, mixture: solution.mixture, uncertainty: errors, size })
}

fn choose_materials(
    options: &FitOptions,
    chosen: &Chosen,
    observations: &Observations,
    progress: OnProgress<'_>,
) -> Result<(usize, Vec<CandidateReport>), FitError> {
    if let Some(materials) = options.materials {
        return Ok((materials, Vec::new()));
    }
    let mut go_on = || progress(FitProgress { iteration: 0, cost: f64::NAN });
    let candidates = select_materials(chosen.lobe, observations, chosen.objective, &mut go_on);
    if go_on().is_break() {
        return Err(FitError::Cancelled);
    }
    let taken = candidates.iter().find(|c| c.taken).map_or(1, |c| c.materials);
    Ok((taken, candidates.iter().map(CandidateReport::from).collect()))
}

/// Why nothing is left to fit.
fn no_samples(dataset: &Dataset, chosen: &Chosen, all: &Observations) -> String {
    let cutoff = chosen.cutoff;
    if all.samples() == 0 && all.unusable > 0 {
        return format!(
            "no valid samples: all {} lit points of the object are clipped, black or masked; check the exposures and [samples] saturation",
            all.unusable
        );
    }
    if all.samples() == 0 {
        return format!(
            "no valid samples: no point of the object is both seen and lit with cosines above {cutoff}; check [object], the mask and the light positions"
        );
    }
    format!(
        "no valid samples: no point of the object is lit by {} of the {} lights; add lights or lower the cosine cut-off {cutoff}",
        LEAST_SAMPLES.min(dataset.geometry.lights.len()),
        dataset.geometry.lights.len()
    )
}

/// What a reader must be warned of, whatever was asked for.
pub fn warnings_of(solution: &Solution, observations: &Observations) -> Vec<String> {
    let mut warnings = Vec::new();
    if solution.termination == Termination::IterationLimit {
        warnings.push(format!(
            "the alternation was still gaining after {} rounds: the parameters may be off by more than their standard errors",
            solution.iterations
        ));
    }
    if observations.unusable > 0 {
        warnings.push(format!(
            "{} lit samples were not used (clipped, too dark or masked), {} of them in highlights",
            observations.unusable, observations.unusable_highlight
        ));
    }
    if observations.lights < 3 {
        warnings.push("fewer than three lights: the materials are not determined".to_owned());
    }
    warnings
}

fn warnings(
    solution: &Solution,
    observations: &Observations,
    candidates: &[CandidateReport],
    options: &FitOptions,
) -> Vec<String> {
    let mut warnings = warnings_of(solution, observations);
    if options.materials.is_none() && candidates.len() < 2 {
        warnings.push("too few lights to judge a second material: one was fitted".to_owned());
    }
    warnings
}
