//! Brings the index up to the book: what was removed goes, what was journalled since comes in, one transaction a run.

use super::account::Account;
use crate::session::book::{Book, Entry, Inner};
use crate::session::state::SessionState;
use crate::store::index::{Index, IndexError};
use crate::store::journal::Head;
use std::collections::BTreeMap;
use std::path::PathBuf;

pub(super) struct Writer {
    data: PathBuf,
    index: Option<Index>,
    /// How far each run is in the index.
    known: BTreeMap<String, Head>,
    /// In which state each run was when it was last brought in.
    states: BTreeMap<String, SessionState>,
    faulty: bool,
}

impl Writer {
    pub(super) fn new(data: PathBuf) -> Self {
        Self { data, index: None, known: BTreeMap::new(), states: BTreeMap::new(), faulty: false }
    }

    /// True after the index could not be written, until it could.
    pub(super) fn is_faulty(&self) -> bool {
        self.faulty
    }

    /// Brings the index up to the book, unless `stop` says that there is no time for all of it.
    pub(super) fn bring_up(&mut self, book: &Book, stop: &dyn Fn() -> bool) {
        let mut outcome = self.try_to(book, stop);
        if matches!(outcome, Err(IndexError::Damaged { .. })) {
            // Opening it anew finds the damage and makes it anew.
            self.index = None;
            outcome = self.try_to(book, stop);
        }
        if outcome.is_err() {
            self.index = None;
        }
        self.tell(book, outcome.err());
    }

    /// Says it once when the index cannot be written, and when it can again.
    fn tell(&mut self, book: &Book, error: Option<IndexError>) {
        let faulty = error.is_some();
        match error {
            Some(error) if !self.faulty => {
                tracing::error!(%error, "the index is not kept; sessions go on, and it is tried again every minute");
            }
            None if self.faulty => tracing::info!("the index is kept again"),
            _ => {}
        }
        if faulty != self.faulty {
            book.lock().index_fault = faulty;
        }
        self.faulty = faulty;
    }

    fn try_to(&mut self, book: &Book, stop: &dyn Fn() -> bool) -> Result<(), IndexError> {
        let mut index = match self.index.take() {
            Some(index) => index,
            None => {
                let index = Index::open(&self.data)?;
                self.known = index.heads()?;
                index
            }
        };
        let (removed, changed) = self.behind(&book.lock());
        for id in removed {
            index.remove(&id)?;
            self.known.remove(&id);
        }
        for (id, head, state) in changed {
            if stop() {
                break;
            }
            account_for(&mut index, book, &id, &head)?;
            self.states.insert(id.clone(), state);
            self.known.insert(id, head);
        }
        self.index = Some(index);
        Ok(())
    }

    /// Runs of the index that are no more, and runs of the book that the index is behind with. One that goes on is brought in when its
    /// state changes: its rows would be memory that grows with every frame of a night.
    fn behind(&self, inner: &Inner) -> (Vec<String>, Vec<(String, Head, SessionState)>) {
        let removed = self.known.keys().filter(|id| !inner.runs.contains_key(*id)).cloned().collect();
        let wanted = |id: &str, run: &Entry| run.state().is_final() || self.states.get(id) != Some(&run.state());
        let changed = inner.runs.iter().filter(|(id, run)| self.known.get(*id) != Some(&run.head) && wanted(id, run));
        (removed, changed.map(|(id, run)| (id.clone(), run.head.clone(), run.state())).collect())
    }
}

fn account_for(index: &mut Index, book: &Book, id: &str, head: &Head) -> Result<(), IndexError> {
    let account = book.look(id, |run| Account::new(&run.directory, &run.manifest, &run.work));
    // Removed in between.
    let Some(mut account) = account else { return Ok(()) };
    match account.read_to(head.records) {
        Ok(()) => index.put(&account.rows(head.fault.as_ref()))?,
        Err(error) => tracing::warn!(session = id, %error, "a journal that cannot be read is not in the index"),
    }
    Ok(())
}
