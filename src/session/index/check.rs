//! Whether the index says of a run what its journal says.

use super::account::{Account, differences};
use crate::session::work::Work;
use crate::store::index::{IndexError, Reader, Rows};
use crate::store::{StoreError, journal, manifest};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Checked {
    /// In what the index contradicts the journal, in words: a `rigd index rebuild` cures it.
    pub contradictions: Vec<String>,
    /// That the index is behind; a daemon brings it up.
    pub note: Option<String>,
}

/// Why it cannot be said.
#[derive(Debug, thiserror::Error)]
pub enum CheckError {
    /// The run cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The index cannot be read.
    #[error(transparent)]
    Index(#[from] IndexError),
}

/// Holds what the index says of the run in `directory` against its journal, as far as the index has read that.
///
/// # Errors
/// Run or index cannot be read.
pub fn check(index: &Reader, directory: &Path) -> Result<Checked, CheckError> {
    let manifest = manifest::read(directory)?;
    let behind = |note: String| Checked { note: Some(note), ..Checked::default() };
    let Some(said) = index.rows(&manifest.id)? else { return Ok(behind("the index does not have it yet".into())) };
    let Ok(work) = Work::of(&manifest) else { return Ok(Checked::default()) };
    let mut account = Account::new(directory, &manifest, &work);
    account.read_to(u64::try_from(said.run.records).unwrap_or_default())?;
    let told = account.rows(said.run.fault.as_ref());
    let contradictions = contradictions(&said, &told);
    let ahead = journal::read(&directory.join(journal::FILE))?.head.records.saturating_sub(account.head().records);
    let note = (ahead > 0).then(|| format!("the index is {ahead} records behind"));
    Ok(Checked { contradictions, note })
}

fn contradictions(said: &Rows, told: &Rows) -> Vec<String> {
    let mut all = of_row("the run", &said.run, &told.run);
    all.extend(of_rows(&said.frames, &told.frames, |frame| format!("frame {}", frame.file)));
    all.extend(of_rows(&said.fits, &told.fits, |fit| format!("the fit of record {}", fit.seq)));
    all
}

/// Rows of one table against each other.
fn of_rows<T: Serialize>(said: &[T], told: &[T], name: impl Fn(&T) -> String) -> Vec<String> {
    let mut told: BTreeMap<String, &T> = told.iter().map(|row| (name(row), row)).collect();
    let mut all = Vec::new();
    for (name, row) in said.iter().map(|row| (name(row), row)) {
        match told.remove(&name) {
            Some(other) => all.extend(of_row(&name, row, other)),
            None => all.push(format!("index: {name} is not in the journal")),
        }
    }
    all.extend(told.into_keys().map(|name| format!("index: {name} is missing")));
    all
}

fn of_row(name: &str, said: &impl Serialize, told: &impl Serialize) -> Vec<String> {
    let one = |(column, said, told): (String, Value, Value)| {
        format!("index: {name}: {column} is {said}, by the journal {told}")
    };
    differences(said, told).into_iter().map(one).collect()
}
