//! Chooses, fits and judges materials for observations, however they came about.

use super::fit::{FitError, FitOptions, FitProgress, FitStep, OnProgress};
use super::identify::{self, Evidence, FEW_POINTS, MISFIT};
use super::inputs;
use super::options::Chosen;
use super::progress::{residual_map, tell};
use super::report::MaterialReport;
use crate::numerics::fit::kernel::Sign;
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::quality::{Quality, judge_all};
use crate::numerics::fit::selection::{Candidate, Wishes, select};
use crate::numerics::fit::solver::{Iterate, Solution, Task, Termination};
use crate::numerics::fit::twins::places;
use crate::numerics::fit::uncertainty::{Uncertainty, uncertainty};
use crate::numerics::fit::{Mixture, gauge, varpro};
use std::time::Instant;

/// A material is a ghost when left-out lights are predicted within this part as well without it.
const SUPERFLUOUS: f64 = 0.002;

/// Materials fitted to observations, and what is known of them.
pub struct Judged {
    /// Everything that was tried; one of them is taken.
    pub candidates: Vec<Candidate>,
    /// What the solver was asked for.
    pub task: Task,
    /// What it found, in normal form.
    pub solution: Solution,
    /// The observations with the light gains and the normals that the fit settled on, where it changed them.
    pub changed: Option<Observations>,
    /// Standard errors.
    pub uncertainty: Uncertainty,
    /// Errors on the samples fitted to.
    pub quality: Quality,
    /// Chi^2 (noise and model floor) over degrees of freedom.
    pub reduced_chi2: f64,
    /// Parameters with standard errors, flags and reasons.
    pub materials: Vec<MaterialReport>,
    /// What a reader must be warned of.
    pub warnings: Vec<String>,
    /// Wall time of the choice, seconds.
    pub choosing_s: f64,
}

impl Judged {
    /// The candidate taken.
    pub fn taken(&self) -> Option<&Candidate> {
        self.candidates.iter().find(|candidate| candidate.taken)
    }
}

/// Fits `observations` as `options` ask. Leaving lights out and the cosine cut-off are the business of who gathered them.
///
/// # Errors
/// An option that cannot be used, observations without a sample or with one that no fit can use, a solver's refusal, or the
/// caller's cancelling.
pub fn fit_observations(
    observations: &Observations,
    options: &FitOptions,
    progress: OnProgress<'_>,
) -> Result<Judged, FitError> {
    let chosen = options.resolve(usize::MAX, 0.0)?;
    let mut judged = judge(observations, &chosen, progress)?;
    judged.warnings.extend(inputs::dark_lights(observations));
    Ok(judged)
}

pub(super) fn judge(
    observations: &Observations,
    chosen: &Chosen,
    progress: OnProgress<'_>,
) -> Result<Judged, FitError> {
    inputs::check(observations)?;
    let begin = Instant::now();
    let (wishes, mut warnings) = inputs::reduced(observations, chosen.wishes);
    let candidates = choose(observations, chosen, wishes, progress)?;
    let choosing_s = begin.elapsed().as_secs_f64();
    let taken = candidates.iter().find(|c| c.taken).ok_or(FitError::Cancelled)?;
    let mut changed = taken.gains.as_ref().map(|gains| observations.with_gains(gains));
    let task = Task {
        lobe: taken.lobe,
        objective: chosen.objective,
        materials: taken.materials,
        rule: chosen.rule,
        colour: taken.colour,
    };
    tell(progress, FitProgress::Step(FitStep::Fit))?;
    let used = changed.as_ref().unwrap_or(observations);
    let mut report_progress =
        |at: Iterate<'_>| progress(FitProgress::Iteration(at, &|width| residual_map(used, &task, at.materials, width)));
    let mut solution = chosen
        .solver
        .solve(used, &task, &mut report_progress)
        .map_err(|refusal| FitError::Input(refusal.to_string()))?;
    if solution.termination == Termination::Cancelled {
        return Err(FitError::Cancelled);
    }
    gauge::normalise(&mut solution.mixture);
    // What follows judges the fit about the normals it used.
    if let Some(tilts) = &solution.tilts {
        changed = Some(changed.as_ref().unwrap_or(observations).turned(tilts));
    }
    let fitted = changed.as_ref().unwrap_or(observations);
    tell(progress, FitProgress::Step(FitStep::Uncertainty))?;
    let uncertainty =
        uncertainty(&varpro::recipe(&task, fitted), &solution.mixture, task.colour, solution.sign, fitted);
    let quality = judge_all(task.lobe, &solution.mixture, fitted)
        .ok_or_else(|| FitError::Input("there is no sample to judge the fit by".to_owned()))?;
    let reduced_chi2 = reduced_chi2(&task, &solution.mixture, fitted, quality.chi2);
    let evidence = Evidence {
        points: fitted.points(),
        materials: task.materials,
        places: places(fitted),
        converged: solution.termination == Termination::Converged,
        superfluous: superfluous(&candidates),
        reduced_chi2,
        bounded: task.materials > 1 && solution.sign == Sign::NonNegative,
    };
    let materials = identify::describe(&task, &solution.mixture, &uncertainty, fitted, &evidence);
    warnings.extend(warnings_about(&solution, fitted, &evidence, &candidates));
    let found = &solution.mixture.materials;
    tell(progress, FitProgress::Judged(&materials, &|width| residual_map(fitted, &task, found, width)))?;
    Ok(Judged {
        task,
        solution,
        changed,
        uncertainty,
        quality,
        reduced_chi2,
        materials,
        warnings,
        choosing_s,
        candidates,
    })
}

/// What left-out lights decide of the number of materials, the model, its lobe and the light gains.
fn choose(
    observations: &Observations,
    chosen: &Chosen,
    wishes: Wishes,
    progress: OnProgress<'_>,
) -> Result<Vec<Candidate>, FitError> {
    tell(progress, FitProgress::Step(FitStep::Choose))?;
    let mut on_candidate = |candidate: &Candidate, best: bool| progress(FitProgress::Tried(candidate, best));
    let candidates = select(observations, chosen.objective, wishes, &mut on_candidate);
    if candidates.is_empty() { Err(FitError::Cancelled) } else { Ok(candidates) }
}

/// True when left-out lights are predicted as well with one material fewer; where none can be left out, when BIC asks for that.
fn superfluous(candidates: &[Candidate]) -> bool {
    let Some(taken) = candidates.iter().find(|c| c.taken) else { return false };
    let alike = |c: &&Candidate| c.materials + 1 == taken.materials && c.lobe.name() == taken.lobe.name();
    candidates.iter().find(alike).is_some_and(|fewer| match (fewer.left_out, taken.left_out) {
        (Some(fewer), Some(taken)) => fewer.overall <= taken.overall * (1.0 + SUPERFLUOUS),
        _ => fewer.bic <= taken.bic,
    })
}

/// Chi^2 over degrees of freedom, for a mixture that was asked for by `task` and leaves `chi2`.
pub fn reduced_chi2(task: &Task, mixture: &Mixture, observations: &Observations, chi2: f64) -> f64 {
    let free_weights = mixture.gamma.iter().filter(|&&g| g > 0.0).count();
    let channels = observations.channels();
    let unknowns = free_weights + task.materials * (task.colour.unknowns(channels) - 1);
    chi2 / (3 * observations.samples()).saturating_sub(3 / channels * unknowns).max(1) as f64
}

/// What a reader must be warned of, whatever else was tried.
pub fn warnings_of(solution: &Solution, observations: &Observations, reduced_chi2: f64) -> Vec<String> {
    let mut warnings = Vec::new();
    if solution.termination != Termination::Converged {
        warnings.push(format!(
            "the solver was still gaining after {} iterations: the decomposition is not determined, or the parameters are off by more than their standard errors",
            solution.iterations
        ));
    }
    if reduced_chi2 > MISFIT {
        warnings.push(format!(
            "residuals are {:.1} times what noise and a 2 % model floor explain: the model, the light positions or the shape are off, or the solver stopped short of the optimum",
            reduced_chi2.sqrt()
        ));
    }
    if observations.points() < FEW_POINTS {
        warnings.push(format!("fewer than {FEW_POINTS} points ({}): any model fits so few", observations.points()));
    }
    if observations.unusable > 0 {
        warnings.push(format!(
            "{} lit samples were not used (clipped, too dark or masked), {} of them in highlights",
            observations.unusable, observations.unusable_highlight
        ));
    }
    warnings.extend(inputs::lights(observations));
    warnings.extend(identify::lone_peaks(&solution.mixture, observations));
    warnings
}

fn warnings_about(
    solution: &Solution,
    observations: &Observations,
    evidence: &Evidence,
    candidates: &[Candidate],
) -> Vec<String> {
    let mut warnings = warnings_of(solution, observations, evidence.reduced_chi2);
    if solution.tilts.is_some() {
        warnings.push(
            "errors are about refined normals, which the result does not hold: `rigd relight` uses those of the dataset and is less accurate"
                .to_owned(),
        );
    }
    if evidence.superfluous {
        warnings.push(
            "left-out lights (or BIC, where none can be left out) are served as well with one material fewer: one of the materials is a ghost"
                .to_owned(),
        );
    }
    if candidates.iter().all(|c| c.left_out.is_none()) {
        warnings.push(
            "too few lights to leave one out: BIC alone chose, so the model may be more or less than the scene needs"
                .to_owned(),
        );
    }
    warnings
}
