//! What the handle tells those who look for news.

use super::EngineHandle;
use crate::session::book::Entry;
use crate::session::state::SessionState;

impl EngineHandle {
    /// The state of every session, oldest first.
    pub fn states(&self) -> Vec<(String, SessionState)> {
        let inner = self.book.lock();
        let sessions = inner.runs.iter().filter(|(_, entry)| entry.work.capture().is_some());
        sessions.map(|(id, entry)| (id.clone(), Entry::state(entry))).collect()
    }

    /// Why the lamp may be on, if a clean-up could not put it out.
    pub fn lamp_fault(&self) -> Option<String> {
        let inner = self.book.lock();
        inner.lamp_fault.then(|| inner.device_fault.clone().unwrap_or_default())
    }

    /// True while the index cannot be written.
    pub fn index_fault(&self) -> bool {
        self.book.lock().index_fault
    }
}
