//! `rigd config`: the rig file's schema, and a check of a file.

use super::daemon::{missing_drivers, notify, tls};
use super::serve::read_rig;
use std::io::Write;
use std::path::PathBuf;

/// Look at rig files.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Print the JSON Schema of the rig file.
    Schema,
    /// Check a rig file; lists every mistake.
    Check {
        /// The file.
        file: PathBuf,
    },
    /// Print a shipped rig file, to start your own from.
    Show {
        /// Its name: zheng-2008, simulated or simulated-calibration.
        name: String,
    },
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    match &args.command {
        Command::Schema => writeln!(out, "{}", serde_json::to_string_pretty(&rig_config::json_schema())?)?,
        Command::Check { file } => {
            let (rig, _) = read_rig(file)?;
            writeln!(out, "{}: sound ({})", file.display(), rig.name)?;
            for reason in
                missing_drivers(&rig).into_iter().chain(notify::targets(&rig).err()).chain(tls::load(&rig.server).err())
            {
                writeln!(out, "rigd serve refuses it all the same: {reason}")?;
            }
        }
        Command::Show { name } => {
            let known: Vec<&str> = rig_config::SHIPPED.iter().map(|(name, _)| *name).collect();
            let shipped = rig_config::SHIPPED.iter().find(|(shipped, _)| shipped == name);
            let (_, text) = shipped.ok_or_else(|| {
                super::error::bad_input(format!("no shipped rig {name}: choose one of {}", known.join(", ")))
            })?;
            write!(out, "{text}")?;
        }
    }
    Ok(())
}
