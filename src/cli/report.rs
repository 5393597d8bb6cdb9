//! `rigd report`: the report of a session, for people, as HTML and as PDF.

use super::error::{bad_input, print_line};
use super::place;
use crate::document::{html, pdf};
use crate::session::report;
use crate::store::files::{Unfinished, make_ready, shown};
use anyhow::anyhow;
use std::path::{Path, PathBuf};

/// What is written.
const FILES: [&str; 2] = ["report.html", "report.pdf"];

/// Write a session's report: what was captured, with what, how good it is, what went wrong, how to verify it.
///
/// It is made of the session's files; no daemon is needed, and a running one not disturbed. Of a result of `rigd fit` outside a session it tells what that has.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Directory of a session, DATA/ID for the session ID of the data directory DATA, or a directory written by `rigd fit --out`.
    session: PathBuf,
    /// Directory of report.html and report.pdf, made if missing.
    #[arg(long, default_value = ".")]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// No session and no result, a damaged one, or a place where nothing can be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let directory = directory(&args.session)?;
    let at_path = |path: &Path, reason: &dyn std::fmt::Display| format!("{}: {reason}", shown(path));
    make_ready(&args.out, FILES, &report::inputs(&directory))
        .map_err(|(path, reason)| bad_input(at_path(&path, &reason)))?;
    let made = match directory.join("manifest.json").exists() {
        true => report::of_session(&directory),
        false => report::of_result(&directory),
    };
    let document = made.map_err(bad_input)?;
    let mut unfinished = Unfinished::within(&args.out);
    for (name, bytes) in FILES.into_iter().zip([html::write(&document).into_bytes(), pdf::write(&document)]) {
        let path = unfinished.path(name);
        std::fs::write(&path, bytes).map_err(|e| anyhow!(at_path(&path, &e)))?;
    }
    unfinished.finish().map_err(|(path, e)| anyhow!(at_path(&path, &e)))?;
    Ok(print_line(format!("{} in {}", FILES.join(", "), args.out.display()))?)
}

/// The directory that is meant, by its own name: a session's must be its id.
fn directory(named: &Path) -> anyhow::Result<PathBuf> {
    let found = place::directory(named).and_then(|path| path.canonicalize().ok());
    found.ok_or_else(|| {
        bad_input(format!(
            "{}: no such directory: give a session's directory, DATA/ID, or a directory written by `rigd fit --out`",
            shown(named)
        ))
    })
}
