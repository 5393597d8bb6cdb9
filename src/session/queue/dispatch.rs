//! The thread that starts what is due, one session after another.

use super::Queue;
use crate::session::book::{Book, Inner};
use crate::session::handle::{EngineError, EngineHandle};
use crate::session::state::SessionState;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How often a queue with entries is looked at when nothing happens: times come without an event.
const LOOK: Duration = Duration::from_secs(1);
/// Wait after a session that ended without a frame: the rig cannot work now, and the next would fail alike.
const UNFIT: Duration = Duration::from_secs(300);
/// Wait after a lack of room, which may be made at any time.
const ROOM: Duration = Duration::from_secs(10);

/// Starts the thread; it ends with the daemon.
pub fn spawn(book: Arc<Book>, engine: EngineHandle) -> std::io::Result<()> {
    let dispatcher = Dispatcher { book, engine, not_before: Instant::now() };
    std::thread::Builder::new().name("queue".into()).spawn(move || dispatcher.run()).map(|_| ())
}

struct Dispatcher {
    book: Arc<Book>,
    engine: EngineHandle,
    /// While the queue waits nothing is done before.
    not_before: Instant,
}

/// What there is to do.
enum Next {
    End,
    /// A run of this entry ended so.
    Settle {
        entry: String,
        state: SessionState,
        reason: Option<String>,
        frames: usize,
    },
    /// It is this entry's turn.
    Start {
        entry: String,
    },
}

impl Dispatcher {
    fn run(mut self) {
        loop {
            let not_before = self.not_before;
            match self.book.watch(LOOK, |inner| next(inner, not_before)) {
                None => {}
                Some(Next::End) => return,
                Some(Next::Settle { entry, state, reason, frames }) => {
                    if frames == 0 && matches!(state, SessionState::Failed | SessionState::Interrupted) {
                        let why = reason.as_deref().unwrap_or("for no known reason");
                        self.wait(
                            UNFIT,
                            format!("a session is {state} without a frame: {why}; the next is started after 5 minutes"),
                        );
                    }
                    self.change(|queue| queue.ended(&entry, state, reason.as_deref()));
                }
                Some(Next::Start { entry }) => self.start(&entry),
            }
        }
    }

    /// The key makes a session that was started, but not written down as such, be found instead of started again.
    fn start(&mut self, id: &str) {
        let entry = self.book.lock().queue.entries.iter().find(|entry| entry.id == id).cloned();
        let Some(entry) = entry else { return };
        let key = format!("queue {id} run {}", entry.started + 1);
        match self.engine.start(&entry.request.session, Some(&key)) {
            Ok(started) => {
                self.book.lock().queue_waits = None;
                let now = self.book.clock.now();
                self.change(|queue| queue.started(id, &started.snapshot.id, now));
            }
            // Somebody was faster.
            Err(EngineError::Busy { .. } | EngineError::Gone) => {}
            Err(error @ (EngineError::NoSpace { .. } | EngineError::Storage(_))) => {
                self.wait(ROOM, format!("{error}; looked at again every {} s", ROOM.as_secs()));
            }
            Err(error) => self.change(|queue| {
                if let Some(entry) = queue.entries.iter_mut().find(|entry| entry.id == id) {
                    entry.refused = Some(error.to_string());
                }
            }),
        }
    }

    /// A change that cannot be written is not made: what led to it is met again at the next look.
    fn change(&mut self, change: impl FnOnce(&mut Queue)) {
        let changed = self.book.lock().change_queue(change);
        if let Err(error) = changed {
            self.wait(UNFIT, format!("the queue is not written: {error}"));
        }
        self.book.nudge();
    }

    /// Starts nothing for this time, unless a user changes the queue.
    fn wait(&mut self, time: Duration, why: String) {
        self.not_before = Instant::now() + time;
        let mut inner = self.book.lock();
        if inner.queue_waits.is_none() {
            tracing::warn!(why, "the queue waits");
        }
        inner.queue_waits = Some(why);
    }
}

fn next(inner: &mut Inner, not_before: Instant) -> Option<Next> {
    if inner.shutdown || inner.ended {
        return Some(Next::End);
    }
    if inner.queue_waits.is_some() && Instant::now() < not_before {
        return None;
    }
    if let Some((entry, session)) = inner.queue.running() {
        let ledger = inner.entry(session).ok().map(|run| &run.ledger);
        let Some(ledger) = ledger else {
            let reason = Some("its directory is gone".to_owned());
            return Some(Next::Settle { entry: entry.to_owned(), state: SessionState::Failed, reason, frames: 0 });
        };
        let snapshot = &ledger.snapshot;
        return snapshot.state.is_final().then(|| Next::Settle {
            entry: entry.to_owned(),
            state: snapshot.state,
            reason: snapshot.reason.clone(),
            frames: snapshot.frames_committed,
        });
    }
    let due = inner.queue.due(inner.store.clock().now()).filter(|_| inner.active().is_none())?;
    Some(Next::Start { entry: due.id.clone() })
}
