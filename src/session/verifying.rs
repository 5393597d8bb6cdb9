//! Verification by the daemon of a session that has ended: one at a time, on a thread of its own.

use super::book::Book;
use super::handle::EngineError;
use super::verify::{Verified, examine, write_down};
use crate::store::verified::{self, Record};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use utoipa::ToSchema;

/// Faults that are told: a directory that is gone has one a frame.
const FAULTS: usize = 100;

/// What is known of a session's frames on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Soundness {
    /// Nobody has looked.
    Unverified,
    /// Its frames are being read.
    Verifying,
    /// Every frame was what was committed, and nothing was journalled since.
    Sound,
    /// Every frame was, but the journal has grown since.
    Outdated,
    /// `faults` tells why not.
    NotSound,
}

/// The body of `GET /v1/sessions/{id}/verify`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct VerifyStatus {
    /// What is known.
    pub soundness: Soundness,
    /// When that was found, RFC 3339; null where nobody has looked, or somebody looks now.
    pub time: Option<String>,
    /// Frames that were what was committed; null as above.
    pub frames: Option<usize>,
    /// What is wrong, in words, the first hundred; known as long as this daemon lives and verifies no other session.
    pub faults: Vec<String>,
}

impl VerifyStatus {
    fn bare(soundness: Soundness) -> Self {
        Self { soundness, time: None, frames: None, faults: Vec::new() }
    }

    /// What `verified.json` of the run in `directory` says.
    ///
    /// # Errors
    /// Record or journal cannot be read.
    pub(super) fn on_disk(directory: &Path) -> Result<Self, EngineError> {
        let Some((record, holds)) = verified::look(directory)? else { return Ok(Self::bare(Soundness::Unverified)) };
        let soundness = if holds { Soundness::Sound } else { Soundness::Outdated };
        Ok(Self { soundness, time: Some(record.time), frames: Some(record.frames), faults: Vec::new() })
    }
}

/// The verification that goes on, or the last one that found something wrong.
pub struct Verification {
    session: String,
    /// None while it goes on.
    found: Option<VerifyStatus>,
}

impl Verification {
    /// The session whose frames are being read.
    pub fn running(&self) -> Option<&str> {
        self.found.is_none().then_some(self.session.as_str())
    }

    /// What it says of a session; none of another.
    pub fn of(&self, session: &str) -> Option<VerifyStatus> {
        let found = || self.found.clone().unwrap_or_else(|| VerifyStatus::bare(Soundness::Verifying));
        (self.session == session).then(found)
    }
}

/// Begins to verify a session that has ended. One that is being verified already is not begun anew.
pub(super) fn begin(book: &Arc<Book>, id: &str) -> Result<(), EngineError> {
    let mut inner = book.lock();
    // The frames of a night are read: a run that shoots has the disk to itself.
    inner.check_idle()?;
    let directory = inner.session(id)?.directory.clone();
    match inner.verifying.as_ref().and_then(Verification::running) {
        Some(running) if running == id => return Ok(()),
        Some(running) => return Err(EngineError::Verifying { id: running.to_owned() }),
        None => {}
    }
    let (seen, owned) = (inner.session(id)?.ledger.snapshot.last_seq, id.to_owned());
    let shared = Arc::clone(book);
    let work = move || {
        let (found, record) = examine(&directory);
        conclude(&shared, &owned, seen, &directory, &found, record);
    };
    std::thread::Builder::new()
        .name("verify".into())
        .spawn(work)
        .map_err(|e| EngineError::Storage(format!("no thread to verify with: {e}")))?;
    inner.verifying = Some(Verification { session: id.to_owned(), found: None });
    Ok(())
}

/// Writes down what was found, unless the daemon has let its directory go; of a session that went on meanwhile nothing was found.
fn conclude(book: &Book, id: &str, seen: u64, directory: &Path, found: &Verified, record: Option<Record>) {
    let mut inner = book.lock();
    inner.verifying = None;
    let still = inner.session(id).is_ok_and(|entry| entry.ledger.snapshot.last_seq == seen);
    if inner.shutdown || inner.ended || !still {
        return;
    }
    if let Err(error) = write_down(inner.store.disk().as_ref(), directory, found, record) {
        tracing::error!(session = id, %error, "what was found is not written down");
    }
    if !found.faults.is_empty() {
        tracing::error!(session = id, faults = found.faults.len(), "not what was committed");
        let faults = found.faults.iter().take(FAULTS).cloned().collect();
        let (time, frames) = (Some(book.clock.now().to_string()), Some(found.frames));
        let found = VerifyStatus { soundness: Soundness::NotSound, time, frames, faults };
        inner.verifying = Some(Verification { session: id.to_owned(), found: Some(found) });
    }
}
