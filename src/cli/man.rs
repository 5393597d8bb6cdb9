//! `rigd man`: the manual pages, made of what `--help` says.

use super::error::{bad_input, print_line};
use clap::Command;
use std::path::PathBuf;

/// Write the manual pages, one a command: rigd.1, rigd-session.1, rigd-session-start.1 ...
///
/// `man -l DIR/rigd.1` shows one. The Debian package installs them.
#[derive(clap::Args)]
pub struct Args {
    /// Directory for them; made if missing.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Runs the command; `program` is all of this one's commands.
///
/// # Errors
/// The directory cannot be made or written.
pub fn run(args: &Args, program: Command) -> anyhow::Result<()> {
    let out = args.out.display();
    let refuse = |error: std::io::Error| bad_input(format!("{out}: {error}: give a directory that can be written"));
    std::fs::create_dir_all(&args.out).map_err(refuse)?;
    clap_mangen::generate_to(program, &args.out).map_err(refuse)?;
    Ok(print_line(format!("manual pages in {out}"))?)
}
