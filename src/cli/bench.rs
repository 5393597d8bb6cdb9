//! `rigd bench`: what fits cost on this machine.

use super::error::{bad_input, print_json, print_line};
use crate::study::bench::photographs::FULL_SIZE;
use crate::study::bench::{self, Entry, Plan, Section, merging, rendering};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Measure what fits cost on this machine, in processor time, and print the table.
///
/// Scenes of known truth: fits of the size of the paper with every solver and with everything automatic, an image of
/// 4 million pixels, growing sizes up to a million samples, and single passes of the inner loop with every instruction set
/// the processor has. Times are of the processor, never of the wall: of one thread, or of all for the automatic fit. Run
/// nothing else meanwhile all the same: caches and memory are shared.
#[derive(clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Args {
    /// Another table than that of the fits.
    #[command(subcommand)]
    pub part: Option<Part>,
    /// Directory for bench.csv and the chart of the growth (growth.svg, growth.png); made if missing.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// How often each thing is measured; the table has best and median. Growth above a million samples is measured once.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub repeats: u16,
    /// Let sizes grow to a hundred million samples; those that do not fit in memory are left out, and the table says so.
    #[arg(long)]
    pub long: bool,
    /// Print an array, a row of bench.csv each, and nothing else.
    #[arg(long)]
    pub json: bool,
}

/// Other tables.
#[derive(clap::Subcommand)]
pub enum Part {
    /// What developing a bracket of ten 12.7-megapixel JPEG frames costs: decoding, merging, writing, memory.
    Merge(MergeArgs),
    /// What rendering a mesh of 70 000 triangles on a megapixel costs.
    Render(RenderArgs),
}

/// Arguments of `rigd bench merge`.
#[derive(clap::Args)]
pub struct MergeArgs {
    /// Directory for the frames, exposures.toml and the EXR files (400 MB); made if missing.
    #[arg(long)]
    pub out: PathBuf,
    /// How often each thing is measured.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub repeats: u16,
    /// Print an array, an object a figure, and nothing else.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `rigd bench render`.
#[derive(clap::Args)]
pub struct RenderArgs {
    /// How often each thing is measured.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub repeats: u16,
    /// Print an array, an object a figure, and nothing else.
    #[arg(long)]
    pub json: bool,
}

/// A time with its bar, seconds.
fn record(cost: &merging::Cost) -> Value {
    let (times, bar) = (cost.times, cost.bar);
    let (most, goal) = (bar.map(|bar| bar.most_s), bar.map(|bar| bar.goal_s));
    json!({
        "work": cost.work, "clock": if cost.wall { "wall" } else { "processor" }, "repeats": times.repeats,
        "best_s": times.best_s, "median_s": times.median_s, "bar_s": most, "goal_s": goal,
    })
}

fn run_render(args: &RenderArgs) -> anyhow::Result<()> {
    if args.json {
        let mut records = Vec::new();
        rendering::run(rendering::SIZE, usize::from(args.repeats), &mut |cost| {
            records.push(record(cost));
            Ok(())
        })?;
        return print_json(&records);
    }
    print_line(rendering::heading(rendering::SIZE))?;
    Ok(rendering::run(rendering::SIZE, usize::from(args.repeats), &mut |cost| print_line(cost.line()))?)
}

fn run_merge(args: &MergeArgs) -> anyhow::Result<()> {
    make(&args.out)?;
    if args.json {
        let mut records = Vec::new();
        merging::run(FULL_SIZE, usize::from(args.repeats), &args.out, &mut |finding| {
            records.push(match finding {
                merging::Finding::Time(cost) => record(cost),
                merging::Finding::Memory { work, peak_bytes } => json!({ "work": work, "peak_bytes": peak_bytes }),
            });
            Ok(())
        })?;
        return print_json(&records);
    }
    print_line(merging::heading(FULL_SIZE))?;
    let told = &mut |finding: &merging::Finding| print_line(merging::line(finding));
    Ok(merging::run(FULL_SIZE, usize::from(args.repeats), &args.out, told)?)
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    match &args.part {
        Some(Part::Merge(args)) => return run_merge(args),
        Some(Part::Render(args)) => return run_render(args),
        None => {}
    }
    // Found out before the work, not after it.
    args.out.as_deref().map(make).transpose()?;
    let repeats = usize::from(args.repeats);
    let plan = if args.long { Plan::long(repeats) } else { Plan::short(repeats) };
    let mut section: Option<Section> = None;
    let entries = bench::run(&plan, &mut |entry: &Entry| {
        if args.json {
            return Ok(());
        }
        if section != Some(entry.section) {
            let gap = if section.is_some() { "\n" } else { "" };
            print_line(format_args!("{gap}{}", bench::heading(entry.section)))?;
            section = Some(entry.section);
        }
        print_line(bench::line(entry))
    })?;
    if let Some(out) = &args.out {
        bench::write(out, &entries)?;
    }
    if args.json {
        return print_json(&bench::table(&entries).records());
    }
    let Some(out) = &args.out else { return Ok(()) };
    print_line(format_args!("\nbench.csv, growth.svg, growth.png in {}", out.display()))?;
    Ok(())
}

fn make(directory: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(directory).map_err(|error| {
        bad_input(format!("{}: no directory for the table: {error}; give another --out", directory.display()))
    })
}
