//! Why the engine refuses, in words for whoever asked.

use crate::session::plan::PlanError;
use crate::session::state::{SessionState, Verb};

/// Why a request to the engine was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EngineError {
    /// Nothing by that id.
    #[error("no session {id}: see GET /v1/sessions (rigd session list) for those there are")]
    UnknownSession {
        /// The id asked for.
        id: String,
    },
    /// No calibration by that id.
    #[error("no calibration {id}: see GET /v1/calibrations (rigd calibrate list) for those there are")]
    UnknownCalibration {
        /// The id asked for.
        id: String,
    },
    /// No entry of the queue by that id.
    #[error("no entry {id} in the queue: see GET /v1/queue (rigd queue list) for those there are")]
    UnknownEntry {
        /// The id asked for.
        id: String,
    },
    /// No light of that number.
    #[error("no light {light}: the session has {lights}, numbered from 0")]
    UnknownLight {
        /// The number asked for.
        light: usize,
        /// How many there are.
        lights: usize,
    },
    /// A material or mesh that cannot be shown as asked.
    #[error("{reason}")]
    Unshown {
        /// Why, and what to do.
        reason: String,
    },
    /// What a completed calibration measured is damaged or gone.
    #[error("calibration {version} ({id}) cannot be used: {reason}")]
    DamagedCalibration {
        /// Id of the run.
        id: String,
        /// Its consecutive number.
        version: u64,
        /// The file, what is wrong with it, and what to do.
        reason: String,
    },
    /// A session of which no report can be made.
    #[error("no report of session {id}: {reason}")]
    DamagedSession {
        /// Its id.
        id: String,
        /// The file, what is wrong with it, and what to do.
        reason: String,
    },
    /// The request is no plan.
    #[error("the plan is refused: {0}")]
    Plan(#[from] PlanError),
    /// A session or a calibration is running; the rig takes one at a time.
    #[error(
        "session or calibration {running} is {state}: end it (`rigd session stop` or `abort`; a calibration with q in `rigd calibrate run`, or POST .../abort), or wait"
    )]
    Busy {
        /// The run that holds the rig.
        running: String,
        /// Its state.
        state: SessionState,
    },
    /// The verb makes no sense in this state.
    #[error("cannot {verb} what is {state}")]
    WrongState {
        /// What was asked.
        verb: Verb,
        /// The session's state.
        state: SessionState,
        /// What can be asked instead.
        allowed: Vec<Verb>,
    },
    /// Another session is being verified.
    #[error("session {id} is being verified: wait until that has ended")]
    Verifying {
        /// The session whose frames are being read.
        id: String,
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
    /// An interrupted session cannot be taken up with another rig file.
    #[error(
        "session {id} was begun with another rig file: start the daemon with that one (manifest.json of the session holds it), or start a new session"
    )]
    RigChanged {
        /// The session.
        id: String,
    },
    /// The engine's thread ended.
    #[error("the engine has ended: restart the daemon")]
    Gone,
}
