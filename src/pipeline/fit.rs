//! Fits a material to a dataset and says how good it is.

use super::dataset::Dataset;
use super::inputs;
use super::judged::judge;
use super::options::Chosen;
pub use super::options::FitOptions;
use super::progress::tell;
pub use super::progress::{FitProgress, FitStep, OnProgress};
use super::report::{CandidateReport, GAUGE, LightReport, MaterialFile, Provenance, Report, Seconds};
use crate::numerics::fit::Mixture;
use crate::numerics::fit::directions::Tilt;
use crate::numerics::fit::observations::{Observations, Scene};
use crate::numerics::fit::quality::{Quality, judge_left_out, judge_lights};
use crate::numerics::fit::solver::Termination;
use crate::numerics::fit::uncertainty::Uncertainty;
use std::time::Instant;

/// A point needs this many samples, or as many as there are lights if those are fewer.
const LEAST_SAMPLES: usize = 3;

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
    inputs::check_lights(lights)?;
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

/// The samples of a dataset with cosines above `cutoff`, with the azimuths of their lights where `azimuths` is true.
pub fn observe(dataset: &Dataset, cutoff: f64, azimuths: bool) -> Observations {
    let geometry = &dataset.geometry;
    let scene = Scene {
        projection: &geometry.projection,
        object: &geometry.object,
        mask: geometry.mask.as_ref(),
        lights: geometry.lights.iter().map(|l| &l.light).zip(&dataset.images).collect(),
        cosine_cutoff: cutoff,
    };
    let mut observations = Observations::gather(&scene, geometry.width, geometry.height);
    if azimuths {
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
    tell(progress, FitProgress::Step(FitStep::Observe))?;
    let all = observe(dataset, chosen.cutoff, chosen.solver.needs_azimuths());
    let used_lights = (0..dataset.geometry.lights.len()).filter(|light| !options.leave_out.contains(light)).count();
    let (observations, kept) =
        all.filtered(LEAST_SAMPLES.min(used_lights), |light| !options.leave_out.contains(&light));
    if observations.points() == 0 {
        return Err(FitError::Input(no_samples(dataset, chosen, &all)));
    }
    let observed = Instant::now();
    let (points, samples) = (observations.points(), observations.samples());
    tell(progress, FitProgress::Observed { points, samples, width: dataset.geometry.width })?;

    let judged = judge(&observations, chosen, progress)?;
    let mixture = &judged.solution.mixture;
    let turned = judged.solution.tilts.as_ref().map(|tilts| turned(&all, &kept, tilts));
    let seen = turned.as_ref().unwrap_or(&all);
    let left_out = judge_left_out(judged.task.lobe, mixture, seen, &kept, |light| options.leave_out.contains(&light));
    let fitted = judged.changed.as_ref().unwrap_or(&observations);
    let count = dataset.geometry.lights.len();
    let seen_fitted = judge_lights(judged.task.lobe, mixture, fitted, Some, count);
    let seen_left_out = judge_lights(judged.task.lobe, mixture, seen, |point| kept.binary_search(&point).ok(), count);
    let done = Instant::now();

    let report = Report {
        pixels: observations.points(),
        samples: observations.samples(),
        materials: judged.task.materials,
        model: judged.task.lobe.name().to_owned(),
        lobe: judged.task.colour.name().to_owned(),
        light_gains: judged.taken().and_then(|taken| taken.gains.clone()),
        solver: options.solver.clone(),
        weights: options.weights.clone(),
        objective: options.objective.clone(),
        mean_relative_error: judged.quality.mean_relative_error,
        highlight_relative_error: judged.quality.highlight_relative_error,
        left_out_relative_error: left_out.map(|q| q.mean_relative_error),
        left_out_highlight_relative_error: left_out.and_then(|q| q.highlight_relative_error),
        left_out: options.leave_out.clone(),
        lights: lights(dataset, &options.leave_out, &seen_fitted, &seen_left_out),
        cost: judged.solution.cost,
        reduced_chi2: judged.reduced_chi2,
        iterations: judged.solution.iterations,
        termination: match judged.solution.termination {
            Termination::Converged => "converged".to_owned(),
            Termination::IterationLimit | Termination::Cancelled => "iteration limit".to_owned(),
        },
        seconds: Seconds {
            load: 0.0,
            observe: (observed - begin).as_secs_f64(),
            initialise: judged.choosing_s,
            fit: (done - observed).as_secs_f64() - judged.choosing_s,
            total: (done - begin).as_secs_f64(),
        },
        cpu_seconds: cpu_seconds() - cpu_begin,
        cosine_cutoff: chosen.cutoff,
        unusable_samples: observations.unusable,
        candidates: judged.candidates.iter().map(CandidateReport::from).collect(),
        warnings: inputs::dark_lights(&all)
            .into_iter()
            .chain(inputs::left_out_twins(&all, &options.leave_out))
            .chain(left_out.and_then(|left_out| far_worse(&left_out, &judged.quality)))
            .chain(judged.warnings.iter().cloned())
            .collect(),
        notes: judged.solution.notes.clone(),
        adaptive: None,
    };
    let material = MaterialFile {
        format: 1,
        model: judged.task.lobe.name().to_owned(),
        gauge: GAUGE.to_owned(),
        materials: judged.materials.clone(),
        size: [dataset.geometry.width, dataset.geometry.height],
        provenance: Provenance {
            software: concat!("rigd ", env!("CARGO_PKG_VERSION")).to_owned(),
            images: dataset.geometry.lights.iter().map(|l| l.name.clone()).collect(),
            simulated: None,
            calibration: None,
        },
    };
    let size = material.size;
    Ok(FitResult {
        report,
        material,
        observations: judged.changed.unwrap_or(observations),
        mixture: judged.solution.mixture,
        uncertainty: judged.uncertainty,
        size,
    })
}

/// Every light, fitted or predicted.
fn lights(
    dataset: &Dataset,
    left_out: &[usize],
    fitted: &[(usize, Option<f64>)],
    predicted: &[(usize, Option<f64>)],
) -> Vec<LightReport> {
    let one = |(light, (described, (fitted, predicted)))| {
        let left_out = left_out.contains(&light);
        let &(samples, mean_relative_error) = if left_out { predicted } else { fitted };
        let image = String::clone(described);
        LightReport { image, left_out, samples, mean_relative_error }
    };
    let names = dataset.geometry.lights.iter().map(|light| &light.name);
    names.zip(fitted.iter().zip(predicted)).enumerate().map(one).collect()
}

/// Left-out lights predicted by so much worse than the fitted ones are a warning; errors below the second are rounding.
const FAR_WORSE: (f64, f64) = (3.0, 1e-3);

/// What errors on left-out lights far above those of the fit say.
fn far_worse(left_out: &Quality, fitted: &Quality) -> Option<String> {
    let times = left_out.mean_relative_error / fitted.mean_relative_error.max(FAR_WORSE.1);
    (times > FAR_WORSE.0).then(|| {
        format!(
            "left-out lights are predicted {times:.0} times worse than fitted ones are explained: do not relight with this material"
        )
    })
}

/// All observations about the normals refined for those of them that were `kept`.
fn turned(all: &Observations, kept: &[usize], tilts: &[Tilt]) -> Observations {
    let mut everywhere = vec![[0.0; 2]; all.points()];
    for (&point, &tilt) in kept.iter().zip(tilts) {
        everywhere[point] = tilt;
    }
    all.turned(&everywhere)
}

/// Why nothing is left to fit.
fn no_samples(dataset: &Dataset, chosen: &Chosen, all: &Observations) -> String {
    let cutoff = chosen.cutoff;
    if all.samples() == 0 && all.unusable > 0 {
        return format!(
            "no valid samples: all {} lit points of the object are clipped, black in a channel, masked, or out of range (radiance and irradiance from 1e-15 to 1e15, within a factor of 1e12); check the exposures, [samples] saturation and the strength of the lights",
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
