//! Messages to people who are not there: a session has ended or cannot go on, the lamp may be on.
//!
//! A thread looks at the engine once a second, as any client may, and never holds it up; a thread of its own serves each target, with a
//! bounded queue before it, so that one that hangs keeps none of the others waiting.

mod message;
mod target;
mod watch;

pub use message::{Message, What};
pub use target::{Target, trusting};

use crate::session::handle::EngineHandle;
use jiff::Timestamp;
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// How long targets are waited for.
#[derive(Clone, Debug)]
pub struct Patience {
    /// One attempt.
    pub answer: Duration,
    /// Waits before the second attempt, the third, and so on.
    pub again: Vec<Duration>,
    /// Messages that wait for one target; one more is given up.
    pub queue: usize,
    /// Time between two looks at the engine.
    pub look: Duration,
    /// Time that is left for messages when the daemon ends.
    pub end: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            answer: Duration::from_secs(10),
            again: [5, 30, 120, 600].map(Duration::from_secs).to_vec(),
            queue: 64,
            look: Duration::from_secs(1),
            end: Duration::from_secs(5),
        }
    }
}

/// What became of the messages to one target.
#[derive(Debug)]
pub struct Count {
    /// Its kind: `webhook`, `ntfy` or `mail`.
    pub target: &'static str,
    sent: AtomicU64,
    failed: AtomicU64,
}

impl Count {
    /// Messages that it took.
    pub fn sent(&self) -> u64 {
        self.sent.load(Ordering::Relaxed)
    }

    /// Messages that were given up.
    pub fn failed(&self) -> u64 {
        self.failed.load(Ordering::Relaxed)
    }
}

/// The way to one target.
struct Outbox {
    inbox: SyncSender<Arc<Message>>,
    count: Arc<Count>,
}

impl Outbox {
    /// Leaves the message for the target's thread; a full queue gives it up.
    fn put(&self, message: &Arc<Message>) {
        let (target, event) = (self.count.target, message.event);
        let reason = match self.inbox.try_send(Arc::clone(message)) {
            Ok(()) => return,
            Err(TrySendError::Full(_)) => "too many messages wait for it already",
            Err(TrySendError::Disconnected(_)) => "its thread has ended",
        };
        self.count.failed.fetch_add(1, Ordering::Relaxed);
        tracing::error!(to = target, ?event, reason, "a notification was given up");
    }
}

/// Whether the daemon ends; waits end with it.
#[derive(Default)]
struct End(Mutex<bool>, Condvar);

impl End {
    fn set(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.1.notify_all();
    }

    /// Waits so long, or until the daemon ends; true when it does.
    fn wait(&self, time: Duration) -> bool {
        let until = Instant::now() + time;
        let mut ending = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        while !*ending {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            ending = self.1.wait_timeout(ending, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        *ending
    }
}

/// The running threads.
pub struct Notifier {
    counts: Arc<[Arc<Count>]>,
    end: Arc<End>,
    patience: Patience,
    /// Disconnected once every thread has ended.
    threads: Receiver<()>,
}

impl Notifier {
    /// Starts to tell `targets` of what happens to the sessions of `engine`; without targets nothing runs. A session that was found
    /// already ended is news if it ended after `since`: the daemon's own start marks those that a crash interrupted.
    ///
    /// # Errors
    /// No threads can be had.
    pub fn start(
        engine: EngineHandle,
        rig: &str,
        targets: Vec<Target>,
        since: Timestamp,
        patience: Patience,
    ) -> io::Result<Self> {
        let (end, (alive, threads)) = (Arc::new(End::default()), sync_channel(1));
        let mut outboxes = Vec::new();
        for target in targets {
            let count = Arc::new(Count { target: target.kind(), sent: AtomicU64::new(0), failed: AtomicU64::new(0) });
            let (inbox, messages) = sync_channel(patience.queue);
            outboxes.push(Outbox { inbox, count: Arc::clone(&count) });
            let messenger = Messenger { target, count, patience: patience.clone(), end: Arc::clone(&end) };
            spawn(&alive, move || messages.iter().for_each(|message: Arc<Message>| messenger.deliver(&message)))?;
        }
        let counts = outboxes.iter().map(|outbox| Arc::clone(&outbox.count)).collect();
        if !outboxes.is_empty() {
            let watcher = watch::Watcher::new(engine, rig, since, outboxes);
            let (end, look) = (Arc::clone(&end), patience.look);
            spawn(&alive, move || watcher.run(&end, look))?;
        }
        Ok(Self { counts, end, patience, threads })
    }

    /// What became of the messages, by target.
    pub fn counts(&self) -> Arc<[Arc<Count>]> {
        Arc::clone(&self.counts)
    }

    /// Looks at the engine a last time and tries once more what is still to be sent, for as long as [`Patience::end`].
    pub fn end(self) {
        self.end.set();
        if matches!(self.threads.recv_timeout(self.patience.end), Err(RecvTimeoutError::Timeout)) {
            tracing::warn!("notifications that were still to be sent are given up");
        }
    }
}

fn spawn(alive: &SyncSender<()>, run: impl FnOnce() + Send + 'static) -> io::Result<()> {
    let alive = alive.clone();
    let run = move || {
        run();
        drop(alive);
    };
    thread::Builder::new().name("notify".into()).spawn(run).map(|_| ())
}

/// Serves one target.
struct Messenger {
    target: Target,
    count: Arc<Count>,
    patience: Patience,
    end: Arc<End>,
}

impl Messenger {
    /// Tries until the target takes the message or patience ends; at the daemon's end once.
    fn deliver(&self, message: &Message) {
        let (to, event) = (self.target.kind(), message.event);
        let waits = std::iter::once(Duration::ZERO).chain(self.patience.again.iter().copied());
        for wait in waits {
            let ending = self.end.wait(wait);
            match self.target.send(message, self.patience.answer) {
                Ok(()) => {
                    self.count.sent.fetch_add(1, Ordering::Relaxed);
                    return tracing::info!(to, ?event, "a notification was sent");
                }
                Err(reason) => tracing::warn!(to, ?event, reason, "a notification was not taken"),
            }
            if ending {
                break;
            }
        }
        self.count.failed.fetch_add(1, Ordering::Relaxed);
        tracing::error!(to, ?event, "a notification was given up");
    }
}
