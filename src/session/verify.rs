//! Whether what a run left on disk is still what it was.

use super::handle::SessionSnapshot;
use super::ledger::Ledger;
use super::work::Work;
use crate::store::manifest::{self, Manifest};
use crate::store::verified::{Record, withdraw};
use crate::store::{Disk, StoreError, frames, journal};
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::Path;

/// What was found in the directory of a session or a calibration.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verified {
    /// Its id.
    pub id: String,
    /// Its state, as the journal has it.
    pub state: String,
    /// Records of the journal whose chain is sound.
    pub records: usize,
    /// Frames that were read and are what was committed.
    pub frames: usize,
    /// What is wrong, in words; empty when nothing is.
    pub faults: Vec<String>,
}

/// Reads every frame that was ever committed in `directory` and holds it against the journal, whose chain of hashes is walked first.
///
/// # Errors
/// [`StoreError`] when there is no readable manifest or journal.
pub fn verify(directory: &Path) -> Result<Verified, StoreError> {
    let (manifest, journal, ledger) = read(directory)?;
    let mut faults: Vec<String> = journal.head.fault.iter().map(|fault| format!("journal.jsonl: {fault}")).collect();
    faults.extend(journal.foreign(&manifest.id).map(|fault| format!("journal.jsonl: {fault}")));
    let shelf = directory.join("frames");
    let (mut sound, mut known) = (0, BTreeSet::new());
    for frame in ledger.every_frame() {
        known.insert(frame.file.clone());
        match frames::check(&shelf.join(&frame.file), frame.bytes, &frame.blake3) {
            Ok(()) => sound += 1,
            Err(reason) => faults.push(reason),
        }
    }
    if ledger.snapshot.state.is_final() {
        // While it goes on a frame has its name before its record.
        faults.extend(strays(&shelf, &known)?);
    }
    let state = ledger.snapshot.state.to_string();
    Ok(Verified { id: manifest.id, state, records: journal.records.len(), frames: sound, faults })
}

/// Verifies a run; one that cannot be read at all is one with a fault. Beside what was found, the record that says so of one that is sound.
pub fn examine(directory: &Path) -> (Verified, Option<Record>) {
    let begun = Record::begin(directory, super::SOFTWARE);
    let found = verify(directory);
    let record = begun.ok().filter(|_| found.as_ref().is_ok_and(|found| found.faults.is_empty()));
    let unreadable = |error: StoreError| Verified {
        id: directory.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default(),
        state: "unreadable".into(),
        records: 0,
        frames: 0,
        faults: vec![error.to_string()],
    };
    (found.unwrap_or_else(unreadable), record)
}

/// Writes beside a run that it is sound (`verified.json`), or takes that back.
///
/// # Errors
/// The directory takes no file, or gives none away.
pub fn write_down(
    disk: &dyn Disk,
    directory: &Path,
    found: &Verified,
    record: Option<Record>,
) -> Result<(), StoreError> {
    match record {
        Some(record) => record.write(disk, directory, found.frames),
        None => withdraw(disk, directory),
    }
}

/// A session as its journal on disk has it.
///
/// # Errors
/// [`StoreError`] when there is no readable manifest or journal.
pub fn look(directory: &Path) -> Result<SessionSnapshot, StoreError> {
    Ok(read(directory)?.2.snapshot)
}

/// Manifest, journal, and what the journal adds up to.
pub(super) fn read(directory: &Path) -> Result<(Manifest, journal::Read, Ledger), StoreError> {
    let manifest = manifest::read(directory)?;
    let journal = journal::read(&directory.join(journal::FILE))?;
    let unplanned = |e: serde_json::Error| StoreError::Corrupt {
        path: directory.join("manifest.json").display().to_string(),
        reason: format!("it holds no plan: {e}"),
    };
    let mut ledger = Ledger::new(&manifest, &Work::of(&manifest).map_err(unplanned)?);
    journal.records.iter().for_each(|record| ledger.apply(record));
    Ok((manifest, journal, ledger))
}

/// Files that no record of the journal knows: a daemon removes those of its own that a crash left.
fn strays(shelf: &Path, known: &BTreeSet<String>) -> Result<Vec<String>, StoreError> {
    let mut strays: Vec<String> = frames::names(shelf)?
        .into_iter()
        .filter(|name| !known.contains(name) && !name.ends_with(frames::ASIDE))
        .collect();
    strays.sort();
    Ok(strays.into_iter().map(|name| format!("{}: the journal does not know it", shelf.join(name).display())).collect())
}
