//! The state of a session: one enum, one transition function, serialised as it is.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// State of a session. `completed`, `stopped`, `aborted`, `halted`, `failed` and `interrupted` are final.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SessionState {
    /// Plan accepted; arm, camera and disk are being checked.
    Preflight,
    /// Shooting.
    Running,
    /// Will pause at the next safe point (before a frame; motor standing).
    Pausing,
    /// Waiting for `resume`; motor standing, lamp on.
    Paused,
    /// Waiting for a condition to clear (disk space); looks again by itself, and on `resume`.
    Suspended,
    /// All frames are in: the last stations are developed and the material is fitted.
    Fitting,
    /// Clean-up after `stop`: frames are kept and fitted as far as they go.
    Stopping,
    /// Clean-up after `abort`.
    Aborting,
    /// Done; a material was fitted.
    Completed,
    /// Ended by `stop`.
    Stopped,
    /// Ended by `abort`.
    Aborted,
    /// Ended by `halt`.
    Halted,
    /// Ended by an error, named in `reason`.
    Failed,
    /// The daemon ended in the middle; found so at the next start.
    Interrupted,
}

impl SessionState {
    /// True when nothing more happens to the session.
    pub fn is_final(self) -> bool {
        matches!(
            self,
            Self::Completed | Self::Stopped | Self::Aborted | Self::Halted | Self::Failed | Self::Interrupted
        )
    }
}

/// What a user can ask of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verb {
    /// Pause at the next safe point.
    Pause,
    /// Go on after a pause or suspension.
    Resume,
    /// End early, clean up, keep and fit what is there.
    Stop,
    /// End now, clean up, fit nothing.
    Abort,
}
