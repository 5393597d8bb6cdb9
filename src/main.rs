//! The `rigd` command.

use clap::{Parser, Subcommand};
use rigd::cli::{
    bench, calibrate, config, demo, doctor, error, fit, merge, notify, queue, relight, retention, safe, serve, session, simulate, study,
    verify,
};
use std::io::IsTerminal;
use std::process::ExitCode;

/// A material-capture daemon: drives a lamp on an arm and a camera, merges brackets to radiance, fits a relightable material.
#[derive(Parser)]
#[command(version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Serve(serve::Args),
    Safe(safe::Args),
    Demo(demo::Args),
    Session(session::SessionArgs),
    Queue(queue::QueueArgs),
    Fit(fit::Args),
    Relight(relight::Args),
    Merge(merge::Args),
    Verify(verify::Args),
    Retention(retention::Args),
    /// Calibrate the rig of a running daemon, or from photographs in a folder.
    #[command(subcommand)]
    Calibrate(calibrate::Calibrate),
    Config(config::Args),
    Doctor(doctor::Args),
    Notify(notify::Args),
    Bench(bench::Args),
    /// Measure the solvers on scenes of known truth: tables and charts.
    #[command(subcommand)]
    Study(study::Study),
    /// Run a simulated device by itself.
    #[command(subcommand)]
    Simulate(Simulate),
}

#[derive(Subcommand)]
enum Simulate {
    /// The simulated arm on a PTY, until SIGINT or SIGTERM.
    Arm(simulate::arm::Args),
    /// Shoot the rig's plan with the simulated camera into a folder, or serve it over PTP/IP.
    Camera(simulate::camera::Args),
}

/// At its finest the HTTP client logs whole addresses, and those of notifications hold secrets.
const QUIET: [&str; 2] = ["ureq=warn", "ureq_proto=warn"];

fn main() -> ExitCode {
    let filter = tracing_subscriber::EnvFilter::try_from_env("RIGD_LOG")
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("warn"));
    let filter = QUIET.iter().filter_map(|quiet| quiet.parse().ok()).fold(filter, |all, quiet| all.add_directive(quiet));
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        // In a file or the journal, colours are noise.
        .with_ansi(std::io::stderr().is_terminal())
        .with_env_filter(filter)
        // A closed stderr must not become a panic of whoever logs.
        .log_internal_errors(false)
        .init();
    error::exit_code(match Cli::parse().command {
        Command::Session(args) => session::run(&args),
        Command::Queue(args) => queue::run(args),
        Command::Serve(args) => serve::run(&args),
        Command::Safe(args) => safe::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Fit(args) => fit::run(&args),
        Command::Relight(args) => relight::run(&args),
        Command::Merge(args) => merge::run(args),
        Command::Verify(args) => verify::run(&args),
        Command::Retention(args) => retention::run(&args),
        Command::Calibrate(step) => calibrate::run(&step),
        Command::Config(args) => config::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Notify(args) => notify::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Study(study) => study::run(&study),
        Command::Simulate(Simulate::Arm(args)) => simulate::arm::run(args),
        Command::Simulate(Simulate::Camera(args)) => simulate::camera::run(args),
    })
}
