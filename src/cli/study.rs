//! `rigd study`: how fast, how accurate and how stable the solvers are.

use super::error::{bad_input, print_json, print_line};
use super::progress::Progress;
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::quality::judge_all;
use crate::numerics::fit::solver::{Solution, Task};
use crate::pipeline::fit::{FitOptions, fit, observe};
use crate::pipeline::judged::{reduced_chi2, warnings_of};
use crate::store::dataset;
use crate::study::accuracy;
use crate::study::lights;
use crate::study::merge;
use crate::study::speed::{self, Photographs};
use crate::study::stability;
use anyhow::Context;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// Which study.
#[derive(clap::Subcommand)]
pub enum Study {
    /// Processor seconds of one thread against accuracy: every solver, objective and size of subset.
    ///
    /// Writes speed.csv, speed.svg and speed.png. The error is that of noise-free radiance under four lights the fit never
    /// saw, in percent; for photographs, that on lights left out of the fit in turn. The short form (2 scenes of 3 000
    /// points, 2 seeds) takes less than a minute, --long (13 067 and 10 997 points, 8 seeds, more subsets, the paper's alternation
    /// to its end) about ten minutes. Run nothing
    /// else meanwhile: times are of one thread, but memory is shared.
    Speed(SpeedArgs),
    /// What each solver makes of clipping, noise, outliers, few lights, wrong positions, alike materials and other trouble.
    ///
    /// Writes stability.csv and the heat maps stability-relight and stability-failures (svg, png): median relight error in
    /// percent, and percent of seeds that failed. Scenes have about 1 500 points. The short form (the hardest level of each
    /// regime, 2 seeds) takes less than a minute of processor time, --long (every level, 20 seeds, the paper's
    /// alternation to its end) less than 25 minutes on two cores. The same seeds give the same table at any number of threads.
    Stability(Extent),
    /// Whether fits keep what they promise: optimum, errors, standard errors, number of materials, flags.
    ///
    /// Prints every figure with its bar and writes accuracy.csv. The short form has scenes of about 3 000 points, 20 seeds and
    /// 35 cases of flags and takes seconds; --long has scenes of full size, 200 seeds and 500 cases of flags and takes minutes
    /// (materials counted and imperfect rig: 6 000 points; flags: 1 500 in both). The same seeds give the same table at any
    /// number of threads.
    Accuracy(Extent),
    /// How far light positions measured with three balls are from the truth, and whether their covariance says so.
    ///
    /// Prints the table and writes lights.csv. Features: outlines and highlights with noise on them, 200 seeds. Pictures: frames
    /// rendered with blur and noise, balls and highlights found without a click; the short form has 3 seeds at a quarter of
    /// the sensor's resolution (highlight noise scaled with it), --long 20 seeds at full resolution (several minutes).
    Lights(Extent),
    /// How close each estimator of the merge comes to inverse variance with everything known.
    ///
    /// Prints the relative error of the merged radiance by range of the signal, on brackets of a simulated EOS 5D stored as 8 bits
    /// and as JPEG. Takes seconds.
    Merge(MergeArgs),
}

/// Arguments of `rigd study merge`.
#[derive(clap::Args)]
pub struct MergeArgs {
    /// Seed of the noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print an array, a row of the table each, and nothing else.
    #[arg(long)]
    pub json: bool,
}

/// How much of a study, and where to.
#[derive(clap::Args)]
pub struct Extent {
    /// Directory for tables and charts; made if missing.
    #[arg(long)]
    pub out: PathBuf,
    /// Seeds a scene or level; default: that of the form.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: Option<u64>,
    /// The long form.
    #[arg(long)]
    pub long: bool,
    /// Print an array, a row of the table each, and nothing else.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `rigd study speed`.
#[derive(clap::Args)]
pub struct SpeedArgs {
    #[command(flatten)]
    extent: Extent,
    /// Also fit this dataset directory, with up to four of its lights left out in turn.
    #[arg(long, value_name = "DATASET")]
    pub photographs: Option<PathBuf>,
}

/// Runs a study.
pub fn run(study: &Study) -> anyhow::Result<()> {
    match study {
        Study::Speed(args) => run_speed(args),
        Study::Stability(args) => run_stability(args),
        Study::Accuracy(args) => run_accuracy(args),
        Study::Lights(args) => run_lights(args),
        Study::Merge(args) => run_merge(args),
    }
}

fn run_merge(args: &MergeArgs) -> anyhow::Result<()> {
    let progress = Progress::stages_unless(args.json);
    progress.stage("merging simulated brackets");
    let scores = merge::run((2000, 100), args.seed)?;
    progress.end();
    if args.json {
        print_json(&merge::records(&scores).records())
    } else {
        Ok(print_line(merge::table(&scores).trim_end())?)
    }
}

fn run_accuracy(args: &Extent) -> anyhow::Result<()> {
    let seeds = args.seeds.unwrap_or(if args.long { 200 } else { 20 });
    let points = (!args.long).then_some(3000);
    let plan = accuracy::Plan { points, seeds, flagged: if args.long { 500 } else { 35 } };
    make(&args.out)?;
    let progress = Progress::stages_unless(args.json);
    progress.stage("fitting scenes of known truth");
    let bars = accuracy::run(&plan);
    progress.end();
    accuracy::write(&args.out, &bars).with_context(|| format!("{}: accuracy.csv", args.out.display()))?;
    if args.json {
        return print_json(&accuracy::table(&bars).records());
    }
    for bar in &bars {
        let (value, range) = (bar.value, bar.range());
        print_line(format_args!("{:<64} {value:>10.4}  {range:<12} {}", bar.name, bar.verdict()))?;
    }
    Ok(())
}

fn run_lights(args: &Extent) -> anyhow::Result<()> {
    let (pictures, scale) = if args.long { (20, 1.0) } else { (3, 0.25) };
    make(&args.out)?;
    let progress = Progress::stages_unless(args.json);
    progress.stage("measuring light positions of known truth");
    let cases = lights::run(&lights::Plan { seeds: args.seeds.unwrap_or(200), pictures, scale });
    progress.end();
    lights::write(&args.out, &cases).with_context(|| format!("{}: lights.csv", args.out.display()))?;
    if args.json {
        return print_json(&lights::table(&cases).records());
    }
    print_line("seen                      noise px  circle   rms mm  worst mm  in 95 % ellipsoid  solved")?;
    for case in &cases {
        print_line(format_args!(
            "{:<24} {:>9} {:>7} {:>8.2} {:>9.2} {:>16.1} % {:>7}",
            case.name,
            case.highlight_px,
            if case.circle { "yes" } else { "no" },
            case.rms_mm,
            case.worst_mm,
            100.0 * case.coverage,
            case.solved
        ))?;
    }
    Ok(())
}

fn run_speed(args: &SpeedArgs) -> anyhow::Result<()> {
    let mut plan = if args.extent.long { speed::Plan::long() } else { speed::Plan::short() };
    plan.seeds = args.extent.seeds.unwrap_or(plan.seeds);
    plan.photographs = args.photographs.as_deref().map(photographs).transpose()?;
    make(&args.extent.out)?;
    let progress = Progress::counted_unless(args.extent.json, "fits");
    let measured = speed::run(&plan, &mut |done, total| progress.count(done, total))?;
    progress.end();
    speed::write(&args.extent.out, &measured)?;
    if args.extent.json {
        return print_json(&speed::table(&measured).records());
    }
    print_line(format_args!("speed.csv, speed.svg, speed.png in {}", args.extent.out.display()))?;
    Ok(())
}

fn run_stability(args: &Extent) -> anyhow::Result<()> {
    let objective = Objective::by_name(&FitOptions::default().objective).context("the default objective")?;
    let plan = stability::Plan {
        rows: stability::rows(args.long),
        columns: stability::columns(objective, args.long),
        seeds: args.seeds.unwrap_or(if args.long { 20 } else { 2 }),
        warnings: &warnings,
    };
    make(&args.out)?;
    let progress = Progress::counted_unless(args.json, "fits");
    let cells = stability::run(&plan, &|done, total| progress.count(done, total));
    progress.end();
    stability::write(&args.out, &plan, &cells)?;
    if args.json {
        return print_json(&stability::table(&plan, &cells).records());
    }
    let names = "stability.csv, stability-relight and stability-failures (svg, png)";
    print_line(format_args!("{names} in {}", args.out.display()))?;
    Ok(())
}

fn make(directory: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(directory)
        .with_context(|| format!("{}: give a directory that can be made", directory.display()))
}

/// What the report of a fit would warn of.
fn warnings(observations: &Observations, task: &Task, solution: &Solution) -> Vec<String> {
    let quality = judge_all(task.lobe, &solution.mixture, observations);
    let chi2 = quality.map_or(f64::INFINITY, |q| reduced_chi2(task, &solution.mixture, observations, q.chi2));
    warnings_of(solution, observations, chi2)
}

/// The samples of a dataset, and how many materials `rigd fit` finds in it.
fn photographs(directory: &Path) -> anyhow::Result<Photographs> {
    let data = dataset::read(directory).map_err(bad_input)?;
    let fitted = fit(&data, &FitOptions::default(), &mut |_| ControlFlow::Continue(()))
        .map_err(|error| bad_input(format!("{}: {error}", directory.display())))?;
    let name = directory.file_name().map_or("photographs".into(), |name| name.to_string_lossy().into_owned());
    Ok(Photographs {
        name,
        observations: observe(&data, data.geometry.cosine_cutoff, true),
        materials: fitted.report.materials,
    })
}
