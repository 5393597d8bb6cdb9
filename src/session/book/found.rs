//! Runs that the daemon finds on disk when it starts.

use super::{Entry, Inner};
use crate::session::ledger::Ledger;
use crate::session::state::{Event, SessionState};
use crate::session::work::Work;
use crate::store::StoreError;
use crate::store::sessions::Found;
use std::collections::VecDeque;

impl Inner {
    /// Takes a session found on disk; true when it had to be marked interrupted.
    pub(super) fn take_in(&mut self, found: Found) -> bool {
        let Found { directory, manifest, journal } = found;
        let work = match Work::of(&manifest) {
            Ok(work) => work,
            Err(error) => {
                tracing::warn!(session = manifest.id, %error, "the manifest holds no plan: the session is left alone");
                return true;
            }
        };
        let mut ledger = Ledger::new(&manifest, &work);
        journal.records.iter().for_each(|record| ledger.apply(record));
        let id = manifest.id.clone();
        let unfinished = !ledger.snapshot.state.is_final();
        let entry = Entry {
            ledger,
            head: journal.head.clone(),
            manifest,
            work,
            directory,
            pace: 1.0,
            worker_fault: None,
            journal: None,
            tail: VecDeque::new(),
        };
        self.runs.insert(id.clone(), entry);
        if let Some(fault) = journal.head.fault {
            self.distrust(&id, &fault);
        } else if unfinished && let Err(error) = self.interrupt(&id) {
            // One damaged directory must not keep the daemon, and with it the lamp's switch, from starting.
            self.distrust(&id, &error.to_string());
        }
        unfinished
    }

    /// A journal that somebody changed: what it says up to there is shown, nothing is added to it.
    fn distrust(&mut self, id: &str, fault: &str) {
        tracing::error!(session = id, fault, "a damaged session");
        if let Some(entry) = self.runs.get_mut(id) {
            let snapshot = &mut entry.ledger.snapshot;
            snapshot.reason = Some(format!("damaged: {fault}; what the journal says before that is shown"));
            if !snapshot.state.is_final() {
                snapshot.state = SessionState::Interrupted;
            }
        }
    }

    fn interrupt(&mut self, id: &str) -> Result<(), StoreError> {
        if let Some(entry) = self.runs.get(id) {
            let removed = self.store.set_strays_aside(&entry.directory, |name| entry.ledger.has_file(name))?;
            if !removed.is_empty() {
                tracing::info!(session = id, ?removed, "unacknowledged frames set aside");
            }
        }
        // A state that is not final can always be interrupted.
        let _ = self.happen(id, Event::DaemonEnded, Some("the daemon ended in the middle of the session"));
        tracing::warn!(session = id, "the daemon before this one ended in the middle of the session");
        Ok(())
    }
}
