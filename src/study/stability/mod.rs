//! Stability: what each solver makes of the regimes in which a fit of mixed materials is known to fail.

mod chart;
mod regimes;

use super::chart::ChartError;
use super::csv;
use super::median;
use super::method::{LOBE, Method};
use super::scene::Problem;
use super::score::{ParameterErrors, Score, score};
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::solver::{Solution, Task};
use crate::numerics::fit::varpro::Subset;
use crate::pipeline::fit::FitOptions;
use crate::pipeline::judged::{Judged, fit_observations};
use crate::pipeline::report::Identified;
use rayon::prelude::*;
pub use regimes::{Row, rows};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Points of a scene: parameters are settled by far fewer than an image has, and a thousand fits must end.
pub const POINTS: usize = 1500;

/// What a report would warn of after a fit: observations, what was asked, what came out.
pub type Warnings<'a> = &'a (dyn Fn(&Observations, &Task, &Solution) -> Vec<String> + Sync);

/// What a study of stability covers.
pub struct Plan<'a> {
    /// Regimes and levels.
    pub rows: Vec<Row>,
    /// Solvers and objectives.
    pub columns: Vec<Method>,
    /// Seeds: 0 to this, exclusive.
    pub seeds: u64,
    /// What a report would warn of.
    pub warnings: Warnings<'a>,
}

/// One solver in one row, over all seeds.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Median relight error, relative.
    pub relight: f64,
    /// Largest relight error, relative.
    pub worst_relight: f64,
    /// Median relight error in highlights, relative; none where no scene shows one.
    pub relight_highlight: Option<f64>,
    /// Medians of the parameters' errors; none when the numbers of materials differ or every fit failed altogether.
    pub parameters: Option<ParameterErrors>,
    /// Median fit error, relative.
    pub fit: f64,
    /// Share of seeds that failed.
    pub failures: f64,
    /// Share of seeds that failed without any warning.
    pub silent_failures: f64,
    /// Mean number of warnings.
    pub warnings: f64,
}

/// The subset of the points of a scene that the solver of that name fits.
static SUBSETS: [Subset; 1] = [Subset(300)];

/// What `rigd fit` does unless told otherwise (materials, model, lobe and light gains left to the data), the paper's alternation
/// with the paper's objective, ten rounds (Zheng 2008, Eq. 11), then every solver with `objective`.
pub fn columns(objective: Objective, long: bool) -> Vec<Method> {
    let papers = Method::all(Objective::RELATIVE, &[], false).into_iter().filter(|method| method.rounds.is_some());
    let ours = Method::all(objective, &SUBSETS, long).into_iter().filter(|method| method.rounds.is_none());
    std::iter::once(Method::automatic(objective)).chain(papers).chain(ours).collect()
}

/// Runs the plan: `cells[row][column]`, the same at any number of threads. `progress` hears how many scenes of how many
/// are done.
pub fn run(plan: &Plan<'_>, progress: &(dyn Fn(usize, usize) + Sync)) -> Vec<Vec<Cell>> {
    let jobs: Vec<(usize, u64)> = (0..plan.rows.len()).flat_map(|row| (0..plan.seeds).map(move |s| (row, s))).collect();
    let done = AtomicUsize::new(0);
    let fits: Vec<Vec<(Score, usize)>> = jobs
        .par_iter()
        .map(|&(row, seed)| {
            let row = &plan.rows[row];
            let problem = row.scene.generate(seed);
            let fits = plan.columns.iter().map(|column| fit(plan, row, column, &problem)).collect();
            progress(1 + done.fetch_add(1, Ordering::Relaxed), jobs.len());
            fits
        })
        .collect();
    let of_row = |fits: &[Vec<(Score, usize)>]| {
        (0..plan.columns.len()).map(|column| cell(fits.iter().map(|of_seed| of_seed[column]).collect())).collect()
    };
    fits.chunks(plan.seeds.max(1) as usize).map(of_row).collect()
}

fn fit(plan: &Plan<'_>, row: &Row, column: &Method, problem: &Problem) -> (Score, usize) {
    if problem.observations.points() == 0 {
        return (Score::FAILURE, 0);
    }
    if column.automatic {
        let found = fit_observations(&problem.observations, &FitOptions::default(), &mut |_| ControlFlow::Continue(()));
        return found.map_or((Score::FAILURE, 1), |found| {
            (score(found.task.lobe, problem, &found.solution.mixture), doubts(&found))
        });
    }
    let Ok(solution) = column.solve(&problem.observations, row.materials) else { return (Score::FAILURE, 1) };
    let warnings = (plan.warnings)(&problem.observations, &column.task(row.materials), &solution);
    (score(LOBE, problem, &solution.mixture), warnings.len())
}

/// Warnings of an automatic fit, and one more when it calls a parameter weak or unidentified.
fn doubts(found: &Judged) -> usize {
    let parameters = found.materials.iter().flat_map(|m| m.rho_d.iter().chain(&m.rho_s).chain(&m.beta));
    found.warnings.len() + usize::from(parameters.into_iter().any(|p| p.identified != Identified::Identified))
}

fn cell(fits: Vec<(Score, usize)>) -> Cell {
    let share = |count: usize| count as f64 / fits.len() as f64;
    let all = |of: fn(&Score) -> Option<f64>| {
        let values: Vec<f64> = fits.iter().filter_map(|(score, _)| of(score)).collect();
        (!values.is_empty()).then(|| median(values))
    };
    let parameter = |of: fn(&ParameterErrors) -> f64| {
        let values: Vec<f64> = fits.iter().filter_map(|(score, _)| score.parameters.as_ref().map(of)).collect();
        (!values.is_empty()).then(|| median(values))
    };
    let parameters = match (parameter(|p| p.beta), parameter(|p| p.rho_s), parameter(|p| p.gamma)) {
        (Some(beta), Some(rho_s), Some(gamma)) => Some(ParameterErrors { beta, rho_s, gamma }),
        _ => None,
    };
    Cell {
        relight: median(fits.iter().map(|(score, _)| score.relight).collect()),
        worst_relight: fits.iter().map(|(score, _)| score.relight).fold(0.0, f64::max),
        relight_highlight: all(|score| score.relight_highlight),
        parameters,
        fit: median(fits.iter().map(|(score, _)| score.fit).collect()),
        failures: share(fits.iter().filter(|(score, _)| score.failed).count()),
        silent_failures: share(fits.iter().filter(|(score, warnings)| score.failed && *warnings == 0).count()),
        warnings: share(fits.iter().map(|(_, warnings)| warnings).sum()),
    }
}

/// Columns of `stability.csv`.
pub const COLUMNS: [&str; 18] = [
    "regime",
    "level",
    "fitted_materials",
    "solver",
    "objective",
    "fitted_points",
    "round_limit",
    "seeds",
    "relight_median_pct",
    "relight_worst_pct",
    "relight_highlight_median_pct",
    "fit_error_median_pct",
    "beta_error_median_pct",
    "rho_s_error_median_pct",
    "gamma_rms_median",
    "failure_rate",
    "silent_failure_rate",
    "warnings_mean",
];

fn line(row: &Row, column: &Method, seeds: u64, cell: &Cell) -> Vec<String> {
    let percent = |value: Option<f64>| csv::number(value.map(|v| 100.0 * v));
    vec![
        row.regime.to_owned(),
        row.level.to_owned(),
        row.materials.to_string(),
        column.solver_label(),
        column.objective.name().to_owned(),
        column.points.map_or(String::new(), |points| points.to_string()),
        column.rounds.map_or(String::new(), |rounds| rounds.to_string()),
        seeds.to_string(),
        percent(Some(cell.relight)),
        percent(Some(cell.worst_relight)),
        percent(cell.relight_highlight),
        percent(Some(cell.fit)),
        percent(cell.parameters.map(|p| p.beta)),
        percent(cell.parameters.map(|p| p.rho_s)),
        csv::number(cell.parameters.map(|p| p.gamma)),
        cell.failures.to_string(),
        cell.silent_failures.to_string(),
        cell.warnings.to_string(),
    ]
}

/// The cells as a table.
pub fn table(plan: &Plan<'_>, cells: &[Vec<Cell>]) -> csv::Table {
    let mut rows = Vec::new();
    for (row, cells) in plan.rows.iter().zip(cells) {
        rows.extend(plan.columns.iter().zip(cells).map(|(column, cell)| line(row, column, plan.seeds, cell)));
    }
    csv::Table { columns: &COLUMNS, rows }
}

/// Writes `stability.csv` and the heat maps `stability-relight` and `stability-failures` (svg, png) into `directory`.
///
/// # Errors
/// A file cannot be written or a chart cannot be drawn.
pub fn write(directory: &Path, plan: &Plan<'_>, cells: &[Vec<Cell>]) -> Result<(), ChartError> {
    let path = directory.join("stability.csv");
    table(plan, cells).write(&path).map_err(|source| ChartError::Write { path: path.display().to_string(), source })?;
    chart::draw(plan, cells, &chart::RELIGHT)?.write(directory, "stability-relight")?;
    chart::draw(plan, cells, &chart::FAILURES)?.write(directory, "stability-failures")
}
