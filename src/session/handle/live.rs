//! Refits, what is watched of a session's fit, and whether its frames are still what they were.

use super::{EngineError, EngineHandle, FitRequest, SessionSnapshot};
pub use crate::session::live::LiveFit;
use crate::session::verifying;
pub use crate::session::verifying::{Soundness, VerifyStatus};
use crate::session::worker::Job;
use std::sync::mpsc::TrySendError;

/// How far the fits of a session are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FitMark {
    /// [`LiveFit::revision`]; 0 of a session that this daemon has not fitted last.
    pub revision: u64,
    /// A refit of it waits or goes on.
    pub refitting: bool,
}

impl EngineHandle {
    /// Queues a refit of a finished session on the fitting worker.
    pub fn refit(&self, id: &str, request: &FitRequest) -> Result<SessionSnapshot, EngineError> {
        let mut inner = self.book.lock();
        // The lamp is lit while a run waits for the worker.
        inner.check_idle()?;
        let entry = inner.session(id)?;
        let (snapshot, lights) = (entry.snapshot(), entry.ledger.stations());
        let busy = || EngineError::Busy { running: id.to_owned(), state: snapshot.state };
        if !snapshot.state.is_final() {
            return Err(busy());
        }
        request.check(lights)?;
        let job = Job::Fit { session: id.to_owned(), request: request.clone(), done: None };
        self.jobs.try_send(job).map_err(|error| match error {
            TrySendError::Full(_) => busy(),
            TrySendError::Disconnected(_) => EngineError::Gone,
        })?;
        inner.refits.push(id.to_owned());
        Ok(snapshot)
    }

    /// The fit of this session that goes on or was the last of this daemon's, if it is this session's.
    pub fn live_fit(&self, id: &str) -> Result<Option<LiveFit>, EngineError> {
        let inner = self.book.lock();
        inner.session(id)?;
        Ok(inner.live.clone().filter(|live| live.session == id))
    }

    /// How far its fits are: cheap, asked at every change.
    pub fn fit_mark(&self, id: &str) -> FitMark {
        let inner = self.book.lock();
        let of_it = inner.live.as_ref().filter(|live| live.session == id);
        FitMark {
            revision: of_it.map_or(0, |live| live.revision),
            refitting: inner.refits.iter().any(|refit| refit == id),
        }
    }

    /// What is known of the session's frames on disk.
    pub fn verify_status(&self, id: &str) -> Result<VerifyStatus, EngineError> {
        let directory = {
            let inner = self.book.lock();
            let directory = inner.session(id)?.directory.clone();
            if let Some(status) = inner.verifying.as_ref().and_then(|one| one.of(id)) {
                return Ok(status);
            }
            directory
        };
        VerifyStatus::on_disk(&directory)
    }

    /// Begins to hold every frame of a session that has ended against its journal.
    pub fn verify(&self, id: &str) -> Result<VerifyStatus, EngineError> {
        let state = self.book.lock().session(id)?.state();
        if !state.is_final() {
            return Err(EngineError::Busy { running: id.to_owned(), state });
        }
        verifying::begin(&self.book, id)?;
        self.verify_status(id)
    }
}
