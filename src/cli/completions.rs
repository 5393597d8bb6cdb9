//! `rigd completions`: what a shell needs to complete this program's command lines.

use clap::Command;
use clap_complete::{Shell, generate};
use std::io::Write;

/// Print the completions of a shell.
///
/// bash: `rigd completions bash > ~/.local/share/bash-completion/completions/rigd`; zsh: into a directory of `$fpath`, as `_rigd`;
/// fish: `rigd completions fish > ~/.config/fish/completions/rigd.fish`. The Debian package installs those of these three.
#[derive(clap::Args)]
pub struct Args {
    /// Which shell.
    shell: Shell,
}

/// Runs the command; `program` is all of this one's commands.
///
/// # Errors
/// stdout is closed or full.
pub fn run(args: &Args, program: &mut Command) -> anyhow::Result<()> {
    let mut script = Vec::new();
    generate(args.shell, program, "rigd", &mut script);
    Ok(std::io::stdout().write_all(&script)?)
}
