//! `rigd retention`: what `storage.keep_days` will remove.

use super::error::{bad_input, print_json, print_line};
use super::on_rig::OnRig;
use super::verify::runs;
use crate::session::retention::may_go;
use crate::session::verify::look;
use crate::store::files::escaped;
use crate::store::manifest::SESSIONS;
use jiff::Timestamp;
use serde::Serialize;

/// List which sessions the daemon removes at its next look (storage.keep_days), and why the others stay. Removes nothing.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    on: OnRig,
    /// Print an array and nothing else.
    #[arg(long)]
    json: bool,
}

/// What becomes of a session.
#[derive(Serialize)]
struct Verdict {
    session: String,
    goes: bool,
    why: String,
}

/// Runs the command.
///
/// # Errors
/// A rig file that is refused or keeps sessions for ever; a data directory that cannot be listed.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let rig = args.on.read()?;
    let keep_days = rig.storage.keep_days.ok_or_else(|| {
        bad_input(format!("{}: has no storage.keep_days: sessions are kept for ever", args.on.config.display()))
    })?;
    let now = Timestamp::now();
    let mut verdicts = Vec::new();
    for run in runs(&rig.storage.data)?.iter().filter(|run| run.parent().is_some_and(|shelf| shelf.ends_with(SESSIONS)))
    {
        let verdict = look(run).map_err(|e| e.to_string()).and_then(|session| {
            may_go(&session, run, keep_days, now).map(|()| format!("ended {}", session.ended.unwrap_or_default()))
        });
        verdicts.push(Verdict {
            session: run.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            goes: verdict.is_ok(),
            why: verdict.unwrap_or_else(|why| why),
        });
    }
    if args.json {
        return print_json(&verdicts);
    }
    for Verdict { session, goes, why } in &verdicts {
        let what = if *goes { "goes," } else { "stays:" };
        print_line(format!("{session}  {what} {}", escaped(why)))?;
    }
    Ok(())
}
