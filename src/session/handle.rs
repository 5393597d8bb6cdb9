//! What HTTP, CLI and demo hold of the engine. Cheap to clone; every call is answered at once.

use super::plan::{CapturePlan, PlanError, StartRequest};
use super::state::{SessionState, Verb};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A session as anyone may see it: the body of `GET /v1/sessions/{id}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SessionSnapshot {
    /// Session id, a UUID v7.
    pub id: String,
    /// Name of the sampled object.
    pub name: String,
    /// Where the session stands.
    pub state: SessionState,
    /// Why it stands there, where that needs a reason (suspended, failed).
    pub reason: Option<String>,
    /// True when arm or camera is simulated.
    pub simulated: bool,
    /// Start, RFC 3339.
    pub started: String,
    /// End, RFC 3339; null while it runs.
    pub ended: Option<String>,
    /// Stations in the plan.
    pub stations: usize,
    /// Exposures a station.
    pub exposures: usize,
    /// Index of the station being shot.
    pub station: usize,
    /// Frames committed to disk and journalled.
    pub frames_committed: usize,
    /// Frames in the plan.
    pub frames_planned: usize,
    /// Stations developed to radiance.
    pub stations_developed: usize,
    /// Estimated time left, seconds; null when unknown or over.
    pub remaining_s: Option<f64>,
    /// Mean relative error of the fit, once there is one.
    pub mean_relative_error: Option<f64>,
    /// Sequence number of the last journal record.
    pub last_seq: u64,
}

/// Why a request to the engine was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EngineError {
    /// Nothing by that id.
    #[error("no session {id}: see GET /v1/sessions for those there are")]
    UnknownSession {
        /// The id asked for.
        id: String,
    },
    /// The request is no plan.
    #[error("the plan is refused: {0}")]
    Plan(#[from] PlanError),
    /// A session is running; the rig takes one at a time.
    #[error("session {running} is {state:?}: stop or abort it, or wait for its end")]
    Busy {
        /// The session that holds the rig.
        running: String,
        /// Its state.
        state: SessionState,
    },
    /// The verb makes no sense in this state.
    #[error("cannot {verb:?} a session that is {state:?}")]
    WrongState {
        /// What was asked.
        verb: Verb,
        /// The session's state.
        state: SessionState,
        /// What can be asked instead.
        allowed: Vec<Verb>,
    },
    /// The Idempotency-Key was used before with another body.
    #[error("this Idempotency-Key was used for another request: choose a new key")]
    KeyReused,
    /// Not enough space for the plan.
    #[error("{needed} bytes are needed and {free} are free on {path}: make room or choose another --data")]
    NoSpace {
        /// Bytes the plan and the reserve need.
        needed: u64,
        /// Bytes free.
        free: u64,
        /// The data directory.
        path: String,
    },
    /// The store could not be written or read.
    #[error("storage: {0}")]
    Storage(String),
    /// The engine's thread ended.
    #[error("the engine has ended: restart the daemon")]
    Gone,
}

/// The body of a refit request; everything left out comes from the rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FitRequest {
    /// Number of materials; null lets left-out lights decide.
    pub materials: Option<usize>,
    /// BRDF model name.
    pub model: Option<String>,
    /// Objective name.
    pub objective: Option<String>,
    /// Indices of lights left out of the fit and used to judge it.
    pub leave_out: Option<Vec<usize>>,
}

/// What a start answered: the session, and whether this call made it or an earlier one with the same key.
#[derive(Clone, Debug, PartialEq)]
pub struct Started {
    /// The session.
    pub snapshot: SessionSnapshot,
    /// True when an earlier call with the same Idempotency-Key made it.
    pub replayed: bool,
}

/// Handle on the engine.
#[derive(Clone)]
pub struct EngineHandle {}

#[allow(clippy::unused_self, missing_docs)]
impl EngineHandle {
    /// The plan a request would run (dry run): checks everything, moves nothing.
    pub fn plan(&self, _request: &StartRequest) -> Result<CapturePlan, EngineError> {
        unimplemented!("filled on the session branch")
    }
    /// Starts a session.
    pub fn start(&self, _request: &StartRequest, _key: Option<&str>) -> Result<Started, EngineError> {
        unimplemented!()
    }
    /// Asks something of a session; answers with its snapshot after the request was taken.
    pub fn command(&self, _id: &str, _verb: Verb) -> Result<SessionSnapshot, EngineError> {
        unimplemented!()
    }
    /// Every session, newest first.
    pub fn sessions(&self) -> Vec<SessionSnapshot> {
        unimplemented!()
    }
    /// One session.
    pub fn session(&self, _id: &str) -> Result<SessionSnapshot, EngineError> {
        unimplemented!()
    }
    /// Changes with every journal record of any session; the value is the total count of records. Watch it, then read the journal.
    pub fn changes(&self) -> tokio::sync::watch::Receiver<u64> {
        unimplemented!()
    }
    /// Journal records of a session with a sequence number above `after`, oldest first, as JSON objects
    /// with at least `seq` (u64), `time` (RFC 3339), `type` (`session.state`, `frame.committed`, ...), `session`, `simulated`.
    pub fn events_after(&self, _id: &str, _after: u64) -> Result<Vec<serde_json::Value>, EngineError> {
        unimplemented!()
    }
    /// The frames of a session: station, exposure, file, blake3, bytes, shutter, state.
    pub fn frames(&self, _id: &str) -> Result<Vec<serde_json::Value>, EngineError> {
        unimplemented!()
    }
    /// The fitted material: `material.json` and `report.json` of the session, if it has one.
    pub fn material(&self, _id: &str) -> Result<Option<serde_json::Value>, EngineError> {
        unimplemented!()
    }
    /// Path of a result file (`preview.png`, `weights.exr`, `valid.png`, ...) of the session, if there.
    pub fn result_file(&self, _id: &str, _name: &str) -> Result<Option<std::path::PathBuf>, EngineError> {
        unimplemented!()
    }
    /// Queues a refit of a finished session on the fitting worker.
    pub fn refit(&self, _id: &str, _request: &FitRequest) -> Result<SessionSnapshot, EngineError> {
        unimplemented!()
    }
    /// `Ok` when a session could start now; otherwise each reason why not (arm, camera, disk).
    pub fn readiness(&self) -> Result<(), Vec<String>> {
        unimplemented!()
    }
}
