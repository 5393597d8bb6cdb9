//! An index made anew from the journals, by whoever holds the data directory.

use super::account::Account;
use crate::session::work::Work;
use crate::store::index::{Index, IndexError};
use crate::store::{Store, StoreError};
use std::path::Path;

/// What went into an index.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rebuilt {
    /// Sessions and calibrations.
    pub runs: usize,
    /// Their frames.
    pub frames: usize,
    /// Their fits.
    pub fits: usize,
    /// What could not be read, and why.
    pub left_out: Vec<String>,
}

/// Why there is no index.
#[derive(Debug, thiserror::Error)]
pub enum RebuildError {
    /// Another process holds the data directory, or it cannot be listed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The index cannot be written.
    #[error(transparent)]
    Index(#[from] IndexError),
}

/// Makes the index of a data directory anew.
///
/// # Errors
/// Another process holds the directory, or the disk takes no index.
pub fn rebuild(data: &Path) -> Result<Rebuilt, RebuildError> {
    let store = Store::open(data, 0)?;
    let (found, unreadable) = store.runs()?;
    let mut index = Index::make(data)?;
    let mut rebuilt = Rebuilt { left_out: unreadable.iter().map(ToString::to_string).collect(), ..Rebuilt::default() };
    for run in found {
        let work = match Work::of(&run.manifest) {
            Ok(work) => work,
            Err(error) => {
                rebuilt.left_out.push(format!("{}: its manifest holds no plan: {error}", run.directory.display()));
                continue;
            }
        };
        let mut account = Account::new(&run.directory, &run.manifest, &work);
        account.read_to(run.journal.head.records)?;
        let rows = account.rows(run.journal.head.fault.as_ref());
        index.put(&rows)?;
        rebuilt.runs += 1;
        rebuilt.frames += rows.frames.len();
        rebuilt.fits += rows.fits.len();
    }
    Ok(rebuilt)
}
