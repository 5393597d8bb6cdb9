//! Fits a material to a dataset and says how good it is.

use super::dataset::Dataset;
use super::identify::{self, Evidence, MISFIT};
use super::options::Chosen;
pub use super::options::FitOptions;
use super::report::{CandidateReport, GAUGE, MaterialFile, Provenance, Report, Seconds};
use crate::numerics::fit::directions::Tilt;
use crate::numerics::fit::observations::{Observations, Scene};
use crate::numerics::fit::quality::{judge_all, judge_left_out};
use crate::numerics::fit::selection::{Candidate, select};
use crate::numerics::fit::solver::{Solution, Task, Termination};
use crate::numerics::fit::uncertainty::{Uncertainty, uncertainty};
use crate::numerics::fit::{Mixture, gauge, varpro};
use std::ops::ControlFlow;
use std::time::Instant;

/// A point needs this many samples, or as many as there are lights if those are fewer.
const LEAST_SAMPLES: usize = 3;

/// A material is a ghost when left-out lights are predicted within this part as well without it.
const SUPERFLUOUS: f64 = 0.002;

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

/// Fits `dataset`.
pub fn fit(dataset: &Dataset, options: &FitOptions, progress: OnProgress<'_>) -> Result<FitResult, FitError> {
    let lights = dataset.geometry.lights.len();
    let chosen = options.resolve(lights, dataset.geometry.cosine_cutoff)?;
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

fn observe(dataset: &Dataset, chosen: &Chosen) -> Observations {
    let geometry = &dataset.geometry;
    let scene = Scene {
        projection: &geometry.projection,
        object: &geometry.object,
        mask: geometry.mask.as_ref(),
        lights: geometry.lights.iter().map(|l| &l.light).zip(&dataset.images).collect(),
        cosine_cutoff: chosen.cutoff,
    };
    let mut observations = Observations::gather(&scene, geometry.width, geometry.height);
    if chosen.solver.needs_azimuths() {
        observations.gather_azimuths(&scene, geometry.width);
    }
    observations
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

    let candidates = choose(&observations, chosen, progress)?;
    let taken = candidates.iter().find(|c| c.taken).ok_or(FitError::Cancelled)?;
    let gained = taken.gains.as_ref().map(|gains| observations.with_gains(gains));
    let fitted = gained.as_ref().unwrap_or(&observations);
    let initialised = Instant::now();

    let task = Task {
        lobe: taken.lobe,
        objective: chosen.objective,
        materials: taken.materials,
        rule: chosen.rule,
        colour: taken.colour,
    };
    let mut report_progress = |iteration, cost| progress(FitProgress { iteration, cost });
    let mut solution = chosen
        .solver
        .solve(fitted, &task, &mut report_progress)
        .map_err(|refusal| FitError::Input(refusal.to_string()))?;
    if solution.termination == Termination::Cancelled {
        return Err(FitError::Cancelled);
    }
    gauge::normalise(&mut solution.mixture);
    // What follows judges the fit about the normals it used.
    let turned = solution.tilts.as_ref().map(|tilts| turned(&all, fitted, &kept, tilts));
    let (all, fitted) = turned.as_ref().map_or((&all, fitted), |(all, fitted)| (all, fitted));
    let recipe = varpro::recipe(&task, fitted);
    let errors = uncertainty(&recipe, &solution.mixture, task.colour, solution.sign, fitted);
    let quality = judge_all(task.lobe, &solution.mixture, fitted)
        .ok_or_else(|| FitError::Input(no_samples(dataset, chosen, &all)))?;
    let left_out =
        judge_left_out(task.lobe, &solution.mixture, &all, &kept, |light| options.leave_out.contains(&light));
    let reduced_chi2 = reduced_chi2(&task, &solution.mixture, fitted, quality.chi2);
    let evidence = Evidence {
        converged: solution.termination == Termination::Converged,
        superfluous: superfluous(&candidates),
        reduced_chi2,
    };
    let materials = identify::describe(&task, &solution.mixture, &errors, fitted, &evidence);
    let done = Instant::now();

    let report = Report {
        pixels: observations.points(),
        samples: observations.samples(),
        materials: task.materials,
        model: task.lobe.name().to_owned(),
        lobe: task.colour.name().to_owned(),
        light_gains: taken.gains.clone(),
        solver: options.solver.clone(),
        weights: options.weights.clone(),
        objective: options.objective.clone(),
        mean_relative_error: quality.mean_relative_error,
        highlight_relative_error: quality.highlight_relative_error,
        left_out_relative_error: left_out.map(|q| q.mean_relative_error),
        left_out_highlight_relative_error: left_out.and_then(|q| q.highlight_relative_error),
        left_out: options.leave_out.clone(),
        cost: solution.cost,
        reduced_chi2,
        iterations: solution.iterations,
        termination: if evidence.converged { "converged".to_owned() } else { "iteration limit".to_owned() },
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
        candidates: candidates.iter().map(CandidateReport::from).collect(),
        warnings: warnings(&solution, &observations, &evidence, &candidates),
    };
    let material = MaterialFile {
        format: 1,
        model: task.lobe.name().to_owned(),
        gauge: GAUGE.to_owned(),
        materials,
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

/// All observations about the normals refined for those of them that were `kept`; and the kept ones.
fn turned(
    all: &Observations,
    observations: &Observations,
    kept: &[usize],
    tilts: &[Tilt],
) -> (Observations, Observations) {
    let mut everywhere = vec![[0.0; 2]; all.points()];
    for (&point, &tilt) in kept.iter().zip(tilts) {
        everywhere[point] = tilt;
    }
    (all.turned(&everywhere), observations.turned(tilts))
}

/// What left-out lights decide of the number of materials, the model, its lobe and the light gains.
fn choose(observations: &Observations, chosen: &Chosen, progress: OnProgress<'_>) -> Result<Vec<Candidate>, FitError> {
    let mut go_on = || progress(FitProgress { iteration: 0, cost: f64::NAN });
    let candidates = select(observations, chosen.objective, chosen.wishes, &mut go_on);
    if candidates.is_empty() { Err(FitError::Cancelled) } else { Ok(candidates) }
}

/// True when left-out lights are predicted as well with one material fewer.
fn superfluous(candidates: &[Candidate]) -> bool {
    let error = |c: &Candidate| c.left_out.map(|errors| errors.overall);
    let taken = candidates.iter().find(|c| c.taken);
    taken.is_some_and(|taken| {
        let fewer =
            candidates.iter().find(|c| c.materials + 1 == taken.materials && c.lobe.name() == taken.lobe.name());
        fewer.and_then(error).zip(error(taken)).is_some_and(|(fewer, taken)| fewer <= taken * (1.0 + SUPERFLUOUS))
    })
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

/// Chi^2 over degrees of freedom, for a mixture that was asked for by `task` and leaves `chi2`.
pub fn reduced_chi2(task: &Task, mixture: &Mixture, observations: &Observations, chi2: f64) -> f64 {
    let free_weights = mixture.gamma.iter().filter(|&&g| g > 0.0).count();
    let unknowns = free_weights + task.materials * (task.colour.unknowns() - 1);
    chi2 / (3 * observations.samples()).saturating_sub(unknowns).max(1) as f64
}

/// What a reader must be warned of, whatever else was tried.
pub fn warnings_of(solution: &Solution, observations: &Observations, reduced_chi2: f64) -> Vec<String> {
    let mut warnings = solution.notes.clone();
    if solution.termination != Termination::Converged {
        warnings.push(format!(
            "the solver was still gaining after {} iterations: the decomposition is not determined, or the parameters are off by more than their standard errors",
            solution.iterations
        ));
    }
    if reduced_chi2 > MISFIT {
        warnings.push(format!(
            "residuals are {:.1} times what noise and a 2 % model floor explain: the model, the light positions or the shape are off",
            reduced_chi2.sqrt()
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
    evidence: &Evidence,
    candidates: &[Candidate],
) -> Vec<String> {
    let mut warnings = warnings_of(solution, observations, evidence.reduced_chi2);
    if evidence.superfluous {
        warnings.push(
            "left-out lights are predicted as well with one material fewer: one of the materials is a ghost".to_owned(),
        );
    }
    if candidates.iter().all(|c| c.left_out.is_none()) {
        warnings.push(
            "too few lights to leave one out: nothing tells whether the model is more than the scene needs".to_owned(),
        );
    }
    warnings
}
