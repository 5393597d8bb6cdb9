//! What is worth a message: seen by looking at the engine, as any client does.

use super::message::{Message, What};
use super::{End, Outbox};
use crate::session::handle::{EngineHandle, SessionSnapshot};
use crate::session::state::SessionState;
use jiff::Timestamp;
use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A disk that fills up and is cleared again and again is worth a message this often.
const ROOM_AGAIN: Duration = Duration::from_secs(600);

pub(super) struct Watcher {
    engine: EngineHandle,
    rig: String,
    since: Timestamp,
    outboxes: Vec<Outbox>,
    /// The state of every session as of the last look.
    known: HashMap<String, SessionState>,
    lamp: Option<String>,
    queue: Option<String>,
    /// When a lack of room was last told.
    room: Option<Instant>,
}

impl Watcher {
    pub(super) fn new(engine: EngineHandle, rig: &str, since: Timestamp, outboxes: Vec<Outbox>) -> Self {
        Self {
            engine,
            rig: rig.to_owned(),
            since,
            outboxes,
            known: HashMap::new(),
            lamp: None,
            queue: None,
            room: None,
        }
    }

    /// Looks until the daemon ends, and once more then.
    pub(super) fn run(mut self, end: &End, look: Duration) {
        loop {
            let ending = end.wait(look);
            self.look();
            if ending {
                return;
            }
        }
    }

    fn look(&mut self) {
        for (id, state) in self.engine.states() {
            let before = self.known.get(&id).copied();
            // A lack of room that is not told yet is looked at again: it may last.
            if before == Some(state) || state == SessionState::Suspended && self.room_was_told() {
                continue;
            }
            self.known.insert(id.clone(), state);
            let Some((event, Ok(session))) = What::of(state).map(|event| (event, self.engine.session(&id))) else {
                continue;
            };
            if before.is_some() || self.is_news(&session) {
                self.tell(Message::of_session(event, &self.rig, session));
            }
        }
        let lamp = self.engine.lamp_fault();
        if self.lamp.is_none()
            && let Some(fault) = &lamp
        {
            self.tell(Message::of_lamp(&self.rig, fault));
        }
        self.lamp = lamp;
        let queue = self.engine.queue_stands();
        if self.queue.is_none()
            && let Some(reason) = &queue
        {
            self.tell(Message::of_queue(&self.rig, reason));
        }
        self.queue = queue;
    }

    fn room_was_told(&self) -> bool {
        self.room.is_some_and(|told| told.elapsed() < ROOM_AGAIN)
    }

    /// Whether a session seen for the first time has come to this since the daemon started.
    fn is_news(&self, session: &SessionSnapshot) -> bool {
        let ended = session.ended.as_ref().and_then(|time| time.parse::<Timestamp>().ok());
        !session.state.is_final() || ended.is_some_and(|ended| ended >= self.since)
    }

    fn tell(&mut self, message: Message) {
        if message.event == What::NoRoom {
            self.room = Some(Instant::now());
        }
        let message = Arc::new(message);
        self.outboxes.iter().for_each(|outbox| outbox.put(&message));
    }
}
