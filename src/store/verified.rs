//! `verified.json` of a run: every frame was what was committed when the journal was this one.

use super::journal::{self, bytes_of};
use super::{Disk, StoreError, replace};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// File name in the run's directory.
pub const FILE: &str = "verified.json";
/// Version of that file.
const FORMAT: u32 = 1;

/// What was found, and when.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Record {
    format: u32,
    /// RFC 3339.
    pub time: String,
    /// Program and version.
    pub software: String,
    /// Frames that were read.
    pub frames: usize,
    /// Hash of `journal.jsonl` before the first of them was read: what was journalled since is not covered.
    pub journal_blake3: String,
}

impl Record {
    /// The record of a run whose frames are about to be read.
    ///
    /// # Errors
    /// Its journal cannot be read.
    pub fn begin(directory: &Path, software: &str) -> Result<Self, StoreError> {
        let (time, software) = (jiff::Timestamp::now().to_string(), software.to_owned());
        Ok(Self { format: FORMAT, time, software, frames: 0, journal_blake3: journal_hash(directory)? })
    }

    /// Writes it down once `frames` frames were found to be what was committed.
    ///
    /// # Errors
    /// The run's directory takes no file.
    pub fn write(self, disk: &dyn Disk, directory: &Path, frames: usize) -> Result<(), StoreError> {
        let corrupt = |e: serde_json::Error| StoreError::Corrupt {
            path: FILE.into(),
            reason: format!("it cannot be written: {e}"),
        };
        replace(disk, directory, FILE, &serde_json::to_vec_pretty(&Self { frames, ..self }).map_err(corrupt)?)
    }
}

/// Takes back what an earlier look found: the run is not what it was.
///
/// # Errors
/// The record cannot be removed.
pub fn withdraw(disk: &dyn Disk, directory: &Path) -> Result<(), StoreError> {
    super::remove_if_there(disk, &directory.join(FILE))?;
    super::sync_directory(disk, directory)
}

/// Whether the run was verified as it stands: nothing was journalled since.
///
/// # Errors
/// Record or journal cannot be read.
pub fn holds(directory: &Path) -> Result<bool, StoreError> {
    Ok(look(directory)?.is_some_and(|(_, holds)| holds))
}

/// The record of a run, and whether it is of the run as it stands; none where there is none.
///
/// # Errors
/// Record or journal cannot be read.
pub fn look(directory: &Path) -> Result<Option<(Record, bool)>, StoreError> {
    let path = directory.join(FILE);
    if !path.exists() {
        return Ok(None);
    }
    let corrupt = |reason| StoreError::Corrupt { path: path.display().to_string(), reason };
    let text = super::files::read_text(&path, "record").map_err(corrupt)?;
    let record: Record = serde_json::from_str(&text).map_err(|e| corrupt(format!("no record: {e}; verify anew")))?;
    let holds = record.format == FORMAT && record.journal_blake3 == journal_hash(directory)?;
    Ok(Some((record, holds)))
}

fn journal_hash(directory: &Path) -> Result<String, StoreError> {
    Ok(blake3::hash(&bytes_of(&directory.join(journal::FILE))?).to_hex().to_string())
}
