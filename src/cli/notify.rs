//! `rigd notify`: whether messages arrive.

use super::daemon::notify::targets;
use super::error::{bad_input, print_json, print_line};
use super::serve::read_rig;
use crate::notify::{Message, Patience};
use std::path::PathBuf;

/// Send a test message to everyone whom the rig file names under `[notify]`.
#[derive(clap::Args)]
pub struct Args {
    /// Rig file.
    #[arg(long)]
    config: PathBuf,
    /// Print an array, an object a target, and nothing else.
    #[arg(long)]
    json: bool,
}

/// Runs the command; fails when a message is not taken.
///
/// # Errors
/// A rig file that is refused or names nobody; a target that does not take the message.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let (rig, _) = read_rig(&args.config)?;
    let (targets, limit) = (targets(&rig).map_err(bad_input)?, Patience::default().answer);
    if targets.is_empty() {
        return Err(bad_input(format!("{}: has no [notify]: there is nobody to tell", args.config.display())));
    }
    let (message, mut refused, mut told) = (Message::test(&rig.name), 0, Vec::new());
    for target in &targets {
        let outcome = target.send(&message, limit);
        refused += usize::from(outcome.is_err());
        if args.json {
            told.push(
                serde_json::json!({ "target": target.kind(), "taken": outcome.is_ok(), "reason": outcome.err() }),
            );
        } else {
            print_line(format!("{}: {}", target.kind(), outcome.err().unwrap_or_else(|| "taken".into())))?;
        }
    }
    if args.json {
        print_json(&told)?;
    }
    if refused > 0 {
        anyhow::bail!("{refused} of {} did not take the message", targets.len());
    }
    Ok(())
}
