//! The `rigd` command.

use clap::{Parser, Subcommand};
use rigd::cli::{error, fit, relight};
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
    Fit(fit::Args),
    Relight(relight::Args),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    error::exit_code(match &cli.command {
        Command::Fit(args) => fit::run(args),
        Command::Relight(args) => relight::run(args),
    })
}
