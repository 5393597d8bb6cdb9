//! `rigd config`: the rig file's schema, and a check of a file.

use super::daemon::{missing_drivers, notify, tls};
use super::error::{print_json, print_line};
use super::serve::read_rig;
use std::io::Write;
use std::path::{Path, PathBuf};

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
        /// Print what was found as JSON and nothing else.
        #[arg(long)]
        json: bool,
    },
    /// Print a shipped rig file, to start your own from.
    Show {
        /// Its name: zheng-2008, simulated or simulated-calibration.
        name: String,
    },
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    match &args.command {
        Command::Schema => print_json(&rig_config::json_schema())?,
        Command::Check { file, json } => check(file, *json)?,
        Command::Show { name } => {
            let known: Vec<&str> = rig_config::SHIPPED.iter().map(|(name, _)| *name).collect();
            let shipped = rig_config::SHIPPED.iter().find(|(shipped, _)| shipped == name);
            let (_, text) = shipped.ok_or_else(|| {
                super::error::bad_input(format!("no shipped rig {name}: choose one of {}", known.join(", ")))
            })?;
            write!(std::io::stdout(), "{text}")?;
        }
    }
    Ok(())
}

/// A sound file, and what keeps `rigd serve` from driving it all the same.
fn check(file: &Path, json: bool) -> anyhow::Result<()> {
    let (rig, _) = read_rig(file)?;
    let refused: Vec<String> = missing_drivers(&rig)
        .into_iter()
        .chain(notify::targets(&rig).err())
        .chain(tls::load(&rig.server).err())
        .collect();
    if json {
        return print_json(&serde_json::json!({ "file": file, "name": rig.name, "not_served": refused }));
    }
    print_line(format!("{}: sound ({})", file.display(), rig.name))?;
    Ok(refused.iter().try_for_each(|reason| print_line(format!("rigd serve refuses it all the same: {reason}")))?)
}
