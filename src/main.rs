//! The `rigd` command.

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use rigd::cli::{
    bench, calibrate, completions, config, demo, doctor, error, export, fit, history, index, logging, man, merge,
    notify, queue, relight, render, report, retention, safe, serve, session, simulate, study, terminal, verify,
};
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
    Render(render::Args),
    Export(export::Args),
    Merge(merge::Args),
    Report(report::Args),
    Verify(verify::Args),
    Retention(retention::Args),
    History(history::Args),
    /// The index of a data directory, out of which `rigd history` answers.
    #[command(subcommand)]
    Index(index::Index),
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
    Completions(completions::Args),
    Man(man::Args),
}

#[derive(Subcommand)]
enum Simulate {
    /// The simulated arm on a PTY, until SIGINT or SIGTERM.
    Arm(simulate::arm::Args),
    /// Shoot the rig's plan with the simulated camera into a folder, or serve it over PTP/IP.
    Camera(simulate::camera::Args),
}

fn main() -> ExitCode {
    logging::start();
    let asked = Cli::command().color(terminal::choice()).get_matches();
    let cli = Cli::from_arg_matches(&asked).unwrap_or_else(|error| error.exit());
    error::exit_code(match cli.command {
        Command::Session(args) => session::run(&args),
        Command::Queue(args) => queue::run(args),
        Command::Serve(args) => serve::run(&args),
        Command::Safe(args) => safe::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Fit(args) => fit::run(&args),
        Command::Relight(args) => relight::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Merge(args) => merge::run(args),
        Command::Report(args) => report::run(&args),
        Command::Verify(args) => verify::run(&args),
        Command::Retention(args) => retention::run(&args),
        Command::History(args) => history::run(&args),
        Command::Index(command) => index::run(&command),
        Command::Calibrate(step) => calibrate::run(&step),
        Command::Config(args) => config::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Notify(args) => notify::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Study(study) => study::run(&study),
        Command::Simulate(Simulate::Arm(args)) => simulate::arm::run(args),
        Command::Simulate(Simulate::Camera(args)) => simulate::camera::run(args),
        Command::Completions(args) => completions::run(&args, &mut Cli::command()),
        Command::Man(args) => man::run(&args, Cli::command()),
    })
}
