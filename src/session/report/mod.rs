//! The report of a session for people: what was captured, with what, how good it is, what went wrong, and how to verify it. It is made of
//! the session's files alone, without a clock, so that the same session gives the same report; what a session lacks is said in words.

mod calibration;
mod capture;
mod events;
mod fit;
mod lamp;
mod maps;
mod material;
mod preview;
mod provenance;
mod sources;
mod summary;
mod time;
mod words;

use crate::document::{Block, Document};
use crate::store::StoreError;
use crate::store::result::ResultError;
use sources::{Fitted, Session};
use std::path::{Path, PathBuf};

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// Manifest or journal cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file of the result cannot be read.
    #[error(transparent)]
    Result(#[from] ResultError),
    /// A file is not what was written, and what a report said of it would be as wrong.
    #[error("{path}: {reason}")]
    Damaged {
        /// The file.
        path: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// There is nothing to report on.
    #[error("{path}: {reason}")]
    Nothing {
        /// The directory.
        path: String,
        /// What it is instead, and what to give.
        reason: String,
    },
}

/// The report of the session in `directory`, as far as the session has got.
///
/// # Errors
/// It is no session, or a file of it is damaged.
pub fn of_session(directory: &Path) -> Result<Document, ReportError> {
    let session = Session::read(directory)?;
    let mut blocks = summary::of_session(&session)?;
    blocks.extend(capture::section(&session));
    blocks.extend(calibration::section(&session));
    blocks.extend(lamp::section(&session));
    match &session.fitted {
        Some(fitted) => blocks.extend(of_fit(fitted)?),
        None => blocks.extend([Block::Section("The fit".into()), Block::text(summary::no_result(&session))]),
    }
    blocks.extend(events::section(&session));
    blocks.extend(time::section(&session));
    blocks.extend(provenance::of_session(&session)?);
    Ok(Document { title: format!("Session report: {}", session.manifest.name), blocks })
}

/// The report of a result of `rigd fit` that belongs to no session: what it has.
///
/// # Errors
/// There is no result, or a file of it is damaged.
pub fn of_result(directory: &Path) -> Result<Document, ReportError> {
    let fitted = Fitted::read(directory)?.ok_or_else(|| ReportError::Nothing {
        path: crate::store::files::shown(directory),
        reason: "neither a session (no manifest.json) nor a result (no report.json): give a session directory, DATA/ID, or the --out of \
                 `rigd fit`"
            .into(),
    })?;
    let mut blocks = summary::of_result(&fitted)?;
    blocks.extend(of_fit(&fitted)?);
    blocks.extend(provenance::of_result(&fitted)?);
    Ok(Document { title: "Fit report".into(), blocks })
}

fn of_fit(fitted: &Fitted) -> Result<Vec<Block>, ReportError> {
    let mut blocks = fit::section(fitted);
    blocks.extend(material::section(fitted));
    blocks.extend(maps::section(fitted)?);
    Ok(blocks)
}

/// The files of a session or a result that a report is made of, none of which may be written over.
pub fn inputs(directory: &Path) -> Vec<PathBuf> {
    let own = ["manifest.json", "journal.jsonl", "calibration.json", "dataset.toml", "verified.json"];
    let of = |folder: &Path, names: &[&str]| names.iter().map(|name| folder.join(name)).collect::<Vec<_>>();
    let results = crate::store::result::FILES;
    [of(directory, &own), of(directory, &results), of(&directory.join("result"), &results)].concat()
}
