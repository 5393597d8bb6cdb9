//! The state of a session: one enum, one transition function, serialised as it is.

use serde::{Deserialize, Serialize};
use std::fmt;
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
    /// A calibration run waits until what its step asks for is in place, and for `shoot`; motor standing, lamp on.
    Awaiting,
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
    /// The daemon, the arm or the camera ended in the middle; what was shot is kept, and `resume` takes it up again.
    Interrupted,
}

impl SessionState {
    /// True when nothing more happens to the session, unless somebody takes up an interrupted one again.
    pub fn is_final(self) -> bool {
        matches!(
            self,
            Self::Completed | Self::Stopped | Self::Aborted | Self::Halted | Self::Failed | Self::Interrupted
        )
    }

    /// True when a session that the daemon's end catches in this state goes on at the next start: it was shooting or fitting, nobody
    /// held it up or wanted it to end.
    pub fn goes_on_by_itself(self) -> bool {
        matches!(self, Self::Preflight | Self::Running | Self::Suspended | Self::Fitting)
    }
}

/// What a user can ask of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verb {
    /// Pause at the next safe point.
    Pause,
    /// Go on after a pause, a suspension or an interruption.
    Resume,
    /// End early, clean up, keep and fit what is there.
    Stop,
    /// End now, clean up, fit nothing.
    Abort,
    /// What a calibration's step asks for is in place: shoot it.
    Shoot,
}

/// As on the wire.
impl fmt::Display for SessionState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// As on the wire.
impl fmt::Display for Verb {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

impl Verb {
    /// Every verb.
    pub const ALL: [Self; 5] = [Self::Pause, Self::Resume, Self::Stop, Self::Abort, Self::Shoot];
}

/// What can happen to a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A user asked for something.
    Asked(Verb),
    /// Arm, camera and lamp are ready.
    Ready,
    /// The engine stands between two frames.
    SafePoint,
    /// A calibration's next step needs an operator.
    OperatorNeeded,
    /// A condition outside the session keeps it from going on (disk space), while shooting or while fitting.
    ConditionLost,
    /// The condition is back.
    ConditionBack,
    /// Every planned frame is committed.
    FramesIn,
    /// All that was left to do in this state is done.
    Done,
    /// The session cannot go on.
    Fault,
    /// Arm or camera cannot go on.
    HardwareLost,
    /// The daemon ends, or ended, with the session unfinished.
    DaemonEnded,
}

/// The event makes no sense in the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{event:?} cannot happen to a session that is {state}")]
pub struct WrongEvent {
    /// The session's state.
    pub state: SessionState,
    /// What was to happen.
    pub event: Event,
}

/// The state after `event`: the only place where a session's state is decided.
pub fn next(state: SessionState, event: Event) -> Result<SessionState, WrongEvent> {
    use SessionState as S;
    let after = match (state, event) {
        (S::Preflight, Event::Ready) => S::Running,
        (S::Interrupted, Event::Asked(Verb::Resume)) => S::Preflight,
        (S::Running, Event::Asked(Verb::Pause)) => S::Pausing,
        (S::Pausing, Event::SafePoint) => S::Paused,
        (S::Pausing | S::Paused | S::Suspended, Event::Asked(Verb::Resume)) => S::Running,
        (S::Running, Event::OperatorNeeded) => S::Awaiting,
        (S::Awaiting, Event::Asked(Verb::Shoot)) => S::Running,
        (S::Running | S::Pausing | S::Fitting, Event::ConditionLost) => S::Suspended,
        (S::Suspended, Event::ConditionBack) => S::Running,
        (S::Preflight | S::Running | S::Pausing, Event::FramesIn) => S::Fitting,
        (S::Fitting, Event::Done) => S::Completed,
        (S::Stopping, Event::Done) => S::Stopped,
        (S::Aborting, Event::Done) => S::Aborted,
        (S::Preflight | S::Running | S::Pausing | S::Paused | S::Suspended, Event::Asked(Verb::Stop)) => S::Stopping,
        (
            S::Preflight | S::Running | S::Pausing | S::Paused | S::Suspended | S::Awaiting | S::Fitting | S::Stopping,
            Event::Asked(Verb::Abort),
        ) => S::Aborting,
        (state, Event::Fault) if !state.is_final() => S::Failed,
        (state, Event::DaemonEnded | Event::HardwareLost) if !state.is_final() => S::Interrupted,
        (state, event) => return Err(WrongEvent { state, event }),
    };
    Ok(after)
}

/// What a user can ask of a session in this state.
pub fn allowed(state: SessionState) -> Vec<Verb> {
    Verb::ALL.into_iter().filter(|&verb| next(state, Event::Asked(verb)).is_ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use SessionState as S;

    const STATES: [S; 15] = [
        S::Preflight,
        S::Running,
        S::Pausing,
        S::Paused,
        S::Suspended,
        S::Awaiting,
        S::Fitting,
        S::Stopping,
        S::Aborting,
        S::Completed,
        S::Stopped,
        S::Aborted,
        S::Halted,
        S::Failed,
        S::Interrupted,
    ];

    fn events() -> Vec<Event> {
        let own = [
            Event::Ready,
            Event::SafePoint,
            Event::OperatorNeeded,
            Event::ConditionLost,
            Event::ConditionBack,
            Event::FramesIn,
            Event::Done,
            Event::Fault,
            Event::HardwareLost,
            Event::DaemonEnded,
        ];
        own.into_iter().chain(Verb::ALL.map(Event::Asked)).collect()
    }

    /// The verbs of each state, written down by hand.
    #[test]
    fn verbs_per_state() {
        use Verb::{Abort, Pause, Resume, Shoot, Stop};
        let table = [
            (S::Preflight, vec![Stop, Abort]),
            (S::Running, vec![Pause, Stop, Abort]),
            (S::Pausing, vec![Resume, Stop, Abort]),
            (S::Paused, vec![Resume, Stop, Abort]),
            (S::Suspended, vec![Resume, Stop, Abort]),
            (S::Awaiting, vec![Abort, Shoot]),
            (S::Fitting, vec![Abort]),
            (S::Stopping, vec![Abort]),
            (S::Aborting, vec![]),
            (S::Interrupted, vec![Resume]),
            (S::Failed, vec![]),
        ];
        for (state, verbs) in table {
            assert_eq!(allowed(state), verbs, "{state:?}");
        }
    }

    #[test]
    fn states_and_verbs_are_printed_as_on_the_wire() {
        for state in STATES {
            assert_eq!(serde_json::json!(state), state.to_string());
        }
        assert_eq!(Verb::ALL.map(|verb| verb.to_string()), ["pause", "resume", "stop", "abort", "shoot"]);
    }

    #[test]
    fn final_states_stay_but_for_a_resumed_interruption_and_every_other_has_a_way_to_every_kind_of_end() {
        for state in STATES {
            let ways: Vec<S> = events().into_iter().filter_map(|event| next(state, event).ok()).collect();
            if state == S::Interrupted {
                assert_eq!(ways, [S::Preflight]);
            } else if state.is_final() {
                assert!(ways.is_empty(), "{state:?}");
            } else {
                assert_eq!(next(state, Event::Fault), Ok(S::Failed));
                assert_eq!(next(state, Event::DaemonEnded), Ok(S::Interrupted));
                assert!(!ways.contains(&state), "{state:?} has a transition to itself");
            }
        }
    }

    #[test]
    fn every_state_but_halted_can_be_reached() {
        let mut reached = vec![S::Preflight];
        let mut i = 0;
        while let Some(&state) = reached.get(i) {
            let new: Vec<S> = events().into_iter().filter_map(|event| next(state, event).ok()).collect();
            for state in new {
                if !reached.contains(&state) {
                    reached.push(state);
                }
            }
            i += 1;
        }
        assert!(STATES.iter().all(|state| reached.contains(state) || *state == S::Halted));
    }
}
