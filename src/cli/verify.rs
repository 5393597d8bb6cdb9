//! `rigd verify`: is what lies on disk still what was committed?

use super::error::{bad_input, print_json, print_line};
use super::place;
use super::terminal::Tone;
use crate::session::index::{CheckError, check};
use crate::session::verify::{Verified, examine, write_down};
use crate::store::RealDisk;
use crate::store::files::shown;
use crate::store::index::{IndexError, Reader};
use crate::store::manifest::{CALIBRATIONS, SESSIONS};
use anyhow::bail;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Check every hash of sessions and calibrations: the chain of the journal, and each frame that was committed. What is sound gets a
/// `verified.json` that says so, what is not loses it. What the index of the data directory says is held against the journals as well.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Directories of sessions or calibrations, DATA/ID, or a data directory: then all that is in it.
    #[arg(required = true)]
    directories: Vec<PathBuf>,
    /// Print an array of what was found and nothing else.
    #[arg(long)]
    json: bool,
}

/// A run, and what the index of its data directory says of it.
#[derive(Serialize)]
struct Found {
    #[serde(flatten)]
    run: Verified,
    /// In what the index contradicts the journal.
    index_faults: Vec<String>,
    /// What is no fault.
    notes: Vec<String>,
}

/// Runs the command; fails when anything is not what was committed, or the index says something else.
///
/// # Errors
/// A directory that is none, or holds nothing to check; anything that is not what it was.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut all = Vec::new();
    for named in &args.directories {
        let directory = &place::directory(named).ok_or_else(|| {
            bad_input(format!(
                "{}: no such directory: name a session (its directory, or DATA/ID) or a data directory",
                shown(named)
            ))
        })?;
        let runs = runs(directory)?;
        if runs.is_empty() {
            return Err(bad_input(format!(
                "{}: no session in it: name a session or a data directory",
                directory.display()
            )));
        }
        all.extend(runs);
    }
    let found: Vec<Found> = all.iter().map(|run| with_index(checked(run), run)).collect();
    if args.json {
        print_json(&found)?;
    } else {
        found.iter().try_for_each(show)?;
    }
    let bad = found.iter().filter(|found| !found.run.faults.is_empty()).count();
    if bad > 0 {
        bail!("{bad} of {} are not what was committed", found.len());
    }
    let misstated = found.iter().filter(|found| !found.index_faults.is_empty()).count();
    if misstated > 0 {
        bail!(
            "of {misstated} of {} the index says what the journals do not: `rigd index rebuild` makes it anew; nothing else is wrong",
            found.len()
        );
    }
    Ok(())
}

/// The index is made of the journals: that it is missing or behind is no fault.
fn with_index(run: Verified, directory: &Path) -> Found {
    let (mut index_faults, mut notes) = (Vec::new(), Vec::new());
    let data = directory.parent().and_then(Path::parent);
    match data.map(Reader::open) {
        None => {}
        Some(Err(IndexError::Missing { .. })) => notes.push("no index beside it".into()),
        Some(Err(error)) => index_faults.push(error.to_string()),
        Some(Ok(index)) => match check(&index, directory) {
            Ok(checked) => {
                index_faults = checked.contradictions;
                notes.extend(checked.note);
            }
            // What keeps the run from being read is told already.
            Err(CheckError::Store(_)) => {}
            Err(error) => index_faults.push(error.to_string()),
        },
    }
    Found { run, index_faults, notes }
}

/// Verifies a run and writes down what was found.
fn checked(run: &Path) -> Verified {
    let (found, record) = examine(run);
    if let Err(error) = write_down(&RealDisk, run, &found, record) {
        // An archive that cannot be written is as sound as it is.
        tracing::warn!(%error, "what was found is not written down");
    }
    found
}

fn show(found: &Found) -> std::io::Result<()> {
    let run = &found.run;
    let verdict = if run.faults.is_empty() { Tone::Good.out("sound") } else { Tone::Bad.out("NOT SOUND") };
    let (id, records, frames) = (&run.id, run.records, run.frames);
    print_line(format!("{id}  {:11}  {records:>5} records, {frames:>4} frames: {verdict}", run.state))?;
    run.faults.iter().chain(&found.index_faults).try_for_each(|fault| print_line(format!("  {fault}")))?;
    found.notes.iter().try_for_each(|note| print_line(format!("  note: {note}")))
}

/// The directory itself when it is a run; the runs in it when it is a data directory.
pub(super) fn runs(directory: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if directory.join("manifest.json").exists() {
        return Ok(vec![directory.to_path_buf()]);
    }
    let mut runs = Vec::new();
    for shelf in [SESSIONS, CALIBRATIONS] {
        let shelf = directory.join(shelf);
        if !shelf.is_dir() {
            continue;
        }
        for entry in std::fs::read_dir(&shelf)? {
            let path = entry?.path();
            let hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
            if path.is_dir() && !hidden {
                runs.push(path);
            }
        }
    }
    runs.sort();
    Ok(runs)
}
