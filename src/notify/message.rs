//! What is said.

use crate::session::handle::SessionSnapshot;
use crate::session::state::SessionState;
use jiff::Timestamp;
use serde::Serialize;

/// Longest text, characters: a message is read on a telephone, and fits a pipe.
const LONGEST: usize = 1000;

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// A session is completed.
    Completed,
    /// A session has failed.
    Failed,
    /// Arm, camera or daemon ended in the middle of a session.
    Interrupted,
    /// A session waits for room on the disk.
    NoRoom,
    /// A clean-up could not put the lamp out.
    LampFault,
    /// Sessions wait in the queue, and none is started: for lack of room, or after one that failed.
    QueueStands,
    /// Nothing: somebody wants to know whether messages arrive.
    Test,
}

impl What {
    /// What a session in this state is told of, if it is.
    pub(super) fn of(state: SessionState) -> Option<Self> {
        match state {
            SessionState::Completed => Some(Self::Completed),
            SessionState::Failed => Some(Self::Failed),
            SessionState::Interrupted => Some(Self::Interrupted),
            SessionState::Suspended => Some(Self::NoRoom),
            _ => None,
        }
    }

    /// The subject, ASCII.
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Completed => "rigd: session completed",
            Self::Failed => "rigd: session failed",
            Self::Interrupted => "rigd: session interrupted",
            Self::NoRoom => "rigd: session waits for room on the disk",
            Self::LampFault => "rigd: the lamp may be on",
            Self::QueueStands => "rigd: the queue stands still",
            Self::Test => "rigd: test",
        }
    }

    /// Whether somebody must do something.
    pub(super) fn is_urgent(self) -> bool {
        !matches!(self, Self::Completed | Self::Test)
    }
}

/// A message, as JSON the body of a webhook's POST.
#[derive(Clone, Debug, Serialize)]
pub struct Message {
    /// What happened.
    pub event: What,
    /// The same in a few words.
    pub title: &'static str,
    /// What to know about it, in a sentence.
    pub text: String,
    /// When it was noticed, RFC 3339.
    pub time: String,
    /// Name of the rig.
    pub rig: String,
    /// The session as `GET /v1/sessions/{id}` has it; null where it is about none.
    pub session: Option<SessionSnapshot>,
}

impl Message {
    /// Somebody wants to know whether messages arrive.
    pub fn test(rig: &str) -> Self {
        Self::new(What::Test, rig, "This is a test: nothing happened.".into(), None)
    }

    /// A session has come to this.
    pub(super) fn of_session(event: What, rig: &str, session: SessionSnapshot) -> Self {
        let SessionSnapshot { name, frames_committed, frames_planned, reason, .. } = &session;
        let simulated = if session.simulated { " (simulated)" } else { "" };
        let error = session.mean_relative_error.map(|error| format!(", mean relative error {:.2} %", 100.0 * error));
        let reason = reason.as_ref().map(|reason| format!(": {reason}"));
        let rest = error.filter(|_| event == What::Completed).or(reason).unwrap_or_default();
        let text = format!("{name}{simulated}, {frames_committed} of {frames_planned} frames{rest}");
        Self::new(event, rig, text, Some(session))
    }

    /// The lamp may be on.
    pub(super) fn of_lamp(rig: &str, fault: &str) -> Self {
        Self::new(What::LampFault, rig, fault.to_owned(), None)
    }

    /// Nothing of the queue is started, for this reason.
    pub(super) fn of_queue(rig: &str, reason: &str) -> Self {
        Self::new(What::QueueStands, rig, reason.to_owned(), None)
    }

    fn new(event: What, rig: &str, text: String, session: Option<SessionSnapshot>) -> Self {
        let (title, time) = (event.title(), Timestamp::now().to_string());
        Self { event, title, text: text.chars().take(LONGEST).collect(), time, rig: rig.to_owned(), session }
    }

    /// As an e-mail, head and body.
    pub(super) fn mail(&self, to: &str) -> String {
        let Self { title, text, time, rig, .. } = self;
        let session = self.session.as_ref().map(|session| format!("session: {}\n", session.id)).unwrap_or_default();
        format!(
            "To: {to}\nSubject: {title}\nMIME-Version: 1.0\nContent-Type: text/plain; charset=utf-8\n\
             Content-Transfer-Encoding: 8bit\nAuto-Submitted: auto-generated\n\n{text}\n\nrig: {rig}\n{session}time: {time}\n"
        )
    }
}
