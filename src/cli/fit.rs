//! `rigd fit`: fits a dataset directory, no daemon needed.

use super::error::{bad_input, print_json};
use super::place;
use super::progress::Progress;
use super::terminal::Tone;
use crate::pipeline::fit::{FitError, FitOptions, FitProgress, FitResult, cpu_seconds, fit};
use crate::pipeline::options::{AUTO, models, solvers};
use crate::pipeline::report::{Identified, Parameter};
use crate::store::{dataset, result};
use std::io::Write;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;

/// Fit a material to a dataset directory (dataset.toml beside its images).
#[derive(clap::Args)]
pub struct Args {
    /// Dataset directory; a finished session is one, and DATA/ID names it, too.
    pub dataset: PathBuf,
    /// Where to write the result; a file of the dataset is never written over.
    #[arg(long, default_value = "rigd-result")]
    pub out: PathBuf,
    /// Number of materials, 1 to 4, or auto: left-out lights decide.
    #[arg(long, default_value = "auto", value_parser = parse_materials, allow_negative_numbers = true)]
    pub materials: Materials,
    /// BRDF model, by name.
    #[arg(long, default_value = AUTO, help = format!("BRDF model: {}", models().join(", ")))]
    pub model: String,
    /// Lobe: none, achromatic (one specular albedo), coloured (one a channel), or auto: left-out lights decide.
    #[arg(long, default_value = AUTO)]
    pub lobe: String,
    /// A gain for each light against lamp drift: on, off, or auto: left-out lights decide.
    #[arg(long, default_value = AUTO)]
    pub gains: String,
    /// Solver, by name.
    #[arg(long, default_value = "varpro", help = format!("Solver: {}", solvers().join(", ")))]
    pub solver: String,
    /// Weights: exact (gamma >= 0, the sum is a gauge) or, for zheng2008, paper (Eq. 10: sum gamma <= 1 as well).
    #[arg(long, default_value = "exact")]
    pub weights: String,
    /// Objective: absolute (Eq. 2), relative (Eq. 11), noise (variance and a 2 % model floor), each with -cauchy against
    /// outliers.
    #[arg(long, default_value = "noise-cauchy")]
    pub objective: String,
    /// Lights kept out of the fit and used to judge it, numbered from 0: 3,5.
    #[arg(long, value_delimiter = ',', allow_negative_numbers = true)]
    pub leave_out: Vec<usize>,
    /// Least cosine of incidence and reflection of a used sample; default: the dataset's.
    #[arg(long, allow_negative_numbers = true)]
    pub cosine_cutoff: Option<f64>,
    /// Worker threads; default: all cores. The result is the same to the bit.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print report.json and nothing else.
    #[arg(long)]
    pub json: bool,
}

/// Number of materials on the command line.
#[derive(Clone, Copy, Debug)]
pub struct Materials(pub Option<usize>);

fn parse_materials(text: &str) -> Result<Materials, String> {
    if text == "auto" {
        return Ok(Materials(None));
    }
    text.parse().map(|count| Materials(Some(count))).map_err(|_| "give a number from 1 to 4, or auto".to_owned())
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let (begin, cpu_begin) = (Instant::now(), cpu_seconds());
    let directory = place::dataset(&args.dataset).map_err(bad_input)?;
    let data = dataset::read(&directory).map_err(bad_input)?;
    let (load, cpu_load) = (begin.elapsed(), cpu_seconds() - cpu_begin);
    let options = FitOptions {
        materials: args.materials.0,
        model: args.model.clone(),
        lobe: args.lobe.clone(),
        gains: args.gains.clone(),
        solver: args.solver.clone(),
        weights: args.weights.clone(),
        objective: args.objective.clone(),
        leave_out: args.leave_out.clone(),
        cosine_cutoff: args.cosine_cutoff,
        threads: args.threads,
    };
    // Found out before the fit, not after it.
    let inputs = dataset::inputs(&directory).map_err(bad_input)?;
    result::make_ready(&args.out, &inputs).map_err(bad_input)?;
    let progress = Progress::stages_unless(args.json);
    progress.stage("fitting: the number of materials and the model are sought first, unless they are given");
    let mut on_progress = |now: FitProgress<'_>| {
        if let FitProgress::Iteration(at, _) = now {
            progress.detail(format!("iteration {}, cost {:.6e}", at.iteration, at.cost));
        }
        ControlFlow::Continue(())
    };
    let fitted = fit(&data, &options, &mut on_progress);
    progress.end();
    let mut fitted = fitted.map_err(|error| match error {
        FitError::Input(_) => bad_input(format!("{}: {error}", args.dataset.display())),
        FitError::Cancelled | FitError::Threads(_) => error.into(),
    })?;
    fitted.report.add_load(load.as_secs_f64(), cpu_load);
    result::write(&args.out, &fitted)?;
    if args.json {
        return print_json(&fitted.report);
    }
    let mut out = std::io::stdout().lock();
    print_summary(&mut out, &fitted)?;
    Ok(writeln!(out, "result in {}", args.out.display())?)
}

fn percent(error: Option<f64>) -> String {
    error.map_or("none".to_owned(), |e| format!("{:.2} %", 100.0 * e))
}

/// A parameter as people read it, to two digits of its standard error; an unidentified one is not shown as if measured.
pub fn show(parameter: &Parameter) -> String {
    let weak = if parameter.identified == Identified::Weak { " (weak)" } else { "" };
    match (parameter.identified, parameter.standard_error) {
        (Identified::Unidentified, _) => "not determined".to_owned(),
        (_, None) => format!("{:.4}{weak}", parameter.value),
        (_, Some(sigma)) => {
            let digits = if sigma > 0.0 { (1.0 - sigma.log10().floor()).clamp(2.0, 9.0) as usize } else { 4 };
            format!("{:.digits$} ± {sigma:.digits$}{weak}", parameter.value)
        }
    }
}

/// So many things, in words.
fn counted(count: usize, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// Parameters and errors as a table.
pub fn print_summary(out: &mut impl Write, fitted: &FitResult) -> std::io::Result<()> {
    let report = &fitted.report;
    writeln!(
        out,
        "{}, {}, {}, {} by {} ({} objective), {} after {} iterations, {:.2} s",
        counted(report.pixels, "point"),
        counted(report.samples, "sample"),
        counted(report.materials, "material"),
        report.model,
        report.solver,
        report.objective,
        report.termination,
        report.iterations,
        report.seconds.total
    )?;
    for (index, material) in fitted.material.materials.iter().enumerate() {
        writeln!(out, "material {} ({:.0} % of the object)", index + 1, 100.0 * material.share)?;
        for (name, list) in [("diffuse albedo ", &material.rho_d), ("specular albedo", &material.rho_s)] {
            let shown: Vec<String> = list.iter().map(show).collect();
            if !shown.is_empty() {
                writeln!(out, "  {name}  {}", shown.join("  "))?;
            }
        }
        if let Some(beta) = &material.beta {
            writeln!(out, "  roughness        {}", show(beta))?;
        }
        for parameter in material.rho_d.iter().chain(&material.rho_s).chain(&material.beta) {
            if let Some(reason) = &parameter.reason {
                writeln!(out, "  note: {reason}")?;
                break;
            }
        }
    }
    writeln!(
        out,
        "mean relative error {}; highlights {}; {}; chi2 per degree of freedom {:.2}; cosines above {}",
        percent(Some(report.mean_relative_error)),
        percent(report.highlight_relative_error),
        match report.left_out_relative_error {
            Some(error) => format!("left-out lights {}", percent(Some(error))),
            None if report.left_out.is_empty() => "no light left out".to_owned(),
            None => "left-out lights have no usable sample".to_owned(),
        },
        report.reduced_chi2,
        report.cosine_cutoff
    )?;
    writeln!(out, "tried (by varpro, at some of the points), with the error on lights left out in turn:")?;
    for candidate in &report.candidates {
        writeln!(
            out,
            "{} {}, {} {}{}: {}; {}",
            if candidate.taken { "->" } else { "  " },
            counted(candidate.materials, "material"),
            candidate.lobe,
            candidate.model,
            if candidate.light_gains { ", light gains" } else { "" },
            candidate.left_out_relative_error.map_or("not judged".to_owned(), |e| format!("{:.2} %", 100.0 * e)),
            candidate.reason
        )?;
    }
    for note in &report.notes {
        writeln!(out, "note: {note}")?;
    }
    for warning in &report.warnings {
        writeln!(out, "{} {warning}", Tone::Doubtful.out("warning:"))?;
    }
    Ok(())
}
