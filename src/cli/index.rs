//! `rigd index`: the index of a data directory, without a daemon.

use super::error::{bad_input, print_json, print_line};
use crate::session::index::{RebuildError, rebuild};
use crate::store::StoreError;
use crate::store::manifest::{CALIBRATIONS, SESSIONS};
use anyhow::anyhow;
use std::path::PathBuf;

/// What to do with it.
#[derive(clap::Subcommand, Debug)]
pub enum Index {
    /// Make it anew from the journals. Refused while a daemon has the directory: that one keeps it by itself.
    Rebuild {
        /// The data directory.
        data: PathBuf,
        /// Print what is in it as JSON and nothing else.
        #[arg(long)]
        json: bool,
    },
}

/// Runs the command.
///
/// # Errors
/// No data directory, a daemon that has it, or a disk that takes no index.
pub fn run(command: &Index) -> anyhow::Result<()> {
    let Index::Rebuild { data, json } = command;
    if ![SESSIONS, CALIBRATIONS].iter().any(|shelf| data.join(shelf).is_dir()) {
        return Err(bad_input(format!("{}: no data directory: name that of rigd serve", data.display())));
    }
    let rebuilt = rebuild(data).map_err(|error| match error {
        RebuildError::Store(StoreError::Locked { path }) => {
            anyhow!("{path} is held by a daemon, which keeps the index itself: nothing was touched")
        }
        other => other.into(),
    })?;
    if *json {
        return print_json(&serde_json::json!({
            "runs": rebuilt.runs, "frames": rebuilt.frames, "fits": rebuilt.fits, "left_out": rebuilt.left_out,
        }));
    }
    for reason in &rebuilt.left_out {
        print_line(format!("left out: {reason}"))?;
    }
    let (runs, frames, fits) = (rebuilt.runs, rebuilt.frames, rebuilt.fits);
    Ok(print_line(format!("{runs} sessions and calibrations, {frames} frames, {fits} fits"))?)
}
