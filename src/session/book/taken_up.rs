//! Interrupted sessions that go on.

use super::{Entry, Inner, unknown};
use crate::session::handle::EngineError;
use crate::session::state::{Event, Verb};
use rig_config::Rig;

impl Inner {
    /// Takes an interrupted session up again and leaves it for the engine, which goes on where it ended; the caller tells it.
    pub fn take_up(&mut self, id: &str, rig_text: &str, reason: &str) -> Result<&Entry, EngineError> {
        self.check_idle()?;
        let entry = self.runs.get_mut(id).ok_or_else(|| unknown(id))?;
        if !same_rig(&entry.manifest.rig_file, rig_text) {
            return Err(EngineError::RigChanged { id: id.to_owned() });
        }
        let snapshot = &entry.ledger.snapshot;
        let frames = (snapshot.frames_planned as u64).max(1);
        let left = frames.saturating_sub(snapshot.frames_committed as u64);
        let plan_bytes = entry.work.capture().map_or(0, |plan| plan.estimated_bytes);
        self.store.check_space(plan_bytes / frames * left)?;
        self.store.make_shelves(&entry.directory)?;
        entry.journal = Some(self.store.open_journal(&entry.directory, &entry.manifest)?);
        entry.worker_fault = None;
        self.happen(id, Event::Asked(Verb::Resume), Some(reason)).map_err(|e| EngineError::Storage(e.to_string()))?;
        self.pending = Some(id.to_owned());
        self.entry(id)
    }

    /// Says more of why a run stands where it does, as long as this daemon lives.
    pub fn append_reason(&mut self, id: &str, more: &str) {
        if let Some(entry) = self.runs.get_mut(id) {
            let reason = entry.ledger.snapshot.reason.take().unwrap_or_default();
            entry.ledger.snapshot.reason = Some(format!("{reason}; {more}"));
        }
    }
}

/// Whether frames of both rigs belong together: one lamp, one camera, one geometry, one hidden world. Ports, speeds and plans may differ.
fn same_rig(before: &str, now: &str) -> bool {
    let read = |text: &str| Rig::from_toml(text, "").ok();
    before == now || read(before).zip(read(now)).is_some_and(|(before, now)| before.sees_like(&now))
}
