//! The queue as users see and change it.

use super::{EngineError, EngineHandle};
use crate::session::book::Inner;
use crate::session::plan::PlanError;
use crate::session::queue::{MOST_ENTRIES, QueueEntry, QueueRequest};
use jiff::{SignedDuration, Timestamp};
use serde::{Deserialize, Serialize};
use std::time::Duration;
use utoipa::ToSchema;

/// Why a queue is held that a user holds.
const BY_USER: &str = "held by a user";

/// An entry, with what is to be expected of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct QueuedSession {
    /// The entry.
    #[serde(flatten)]
    pub entry: QueueEntry,
    /// When its next run starts, RFC 3339; null when it cannot be started.
    #[schema(format = DateTime)]
    pub estimated_start: Option<String>,
    /// When the last of its runs ends, RFC 3339.
    #[schema(format = DateTime)]
    pub estimated_end: Option<String>,
    /// Disk space that its runs will take, bytes.
    pub estimated_bytes: Option<u64>,
}

/// All that waits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct QueueSnapshot {
    /// Why nothing of it is started, if so.
    pub held: Option<String>,
    /// Why it waits although an entry is due, if so: for room on the disk, or after a session without a frame.
    pub waits: Option<String>,
    /// In order.
    pub entries: Vec<QueuedSession>,
}

impl EngineHandle {
    /// The queue.
    pub fn queue(&self) -> QueueSnapshot {
        let inner = self.book.lock();
        let mut free = self.book.clock.now();
        if let Some(left_s) = inner.active().and_then(|run| run.snapshot().remaining_s) {
            free = later(free, left_s);
        }
        let entries = inner.queue.entries.iter().map(|entry| self.expected(&inner, entry, &mut free)).collect();
        QueueSnapshot { held: inner.queue.held.clone(), waits: inner.queue_waits.clone(), entries }
    }

    /// Why a queue with entries stands still without a user having held it.
    pub fn queue_stands(&self) -> Option<String> {
        let inner = self.book.lock();
        let held = inner.queue.held.as_deref().filter(|&reason| reason != BY_USER);
        let why = held.or(inner.queue_waits.as_deref()).map(str::to_owned);
        why.filter(|_| !inner.queue.entries.is_empty())
    }

    /// What is to be expected of an entry when the rig is free at `free`, which moves on to when it is free again.
    fn expected(&self, inner: &Inner, entry: &QueueEntry, free: &mut Timestamp) -> QueuedSession {
        let plan = self.planned(inner, &entry.request.session).ok().map(|(plan, _)| plan);
        let unknown = || QueuedSession {
            entry: entry.clone(),
            estimated_start: None,
            estimated_end: None,
            estimated_bytes: None,
        };
        let Some(plan) = plan.filter(|_| entry.refused.is_none()) else { return unknown() };
        if entry.left() == 0 {
            return unknown();
        }
        let start = entry.not_before().map_or(*free, |time| time.max(*free));
        let runs = f64::from(entry.left());
        let one_s = plan.estimated_s / self.speed;
        let every_s = entry.request.every_s.unwrap_or(0.0).max(one_s);
        let end = later(start, every_s * (runs - 1.0) + one_s);
        // While one waits for its time, and between two runs that are far apart, others have their turn.
        if start == *free {
            *free = if entry.request.every_s.is_some() { later(start, one_s) } else { end };
        }
        QueuedSession {
            estimated_start: Some(start.to_string()),
            estimated_end: Some(end.to_string()),
            estimated_bytes: Some(plan.estimated_bytes.saturating_mul(u64::from(entry.left()))),
            entry: entry.clone(),
        }
    }

    /// Puts a session at the end of the queue.
    pub fn enqueue(&self, request: &QueueRequest) -> Result<QueuedSession, EngineError> {
        let mut inner = self.book.lock();
        let mut reasons = request.mistakes();
        if inner.queue.entries.len() >= MOST_ENTRIES {
            reasons.push(format!("the queue has {MOST_ENTRIES} entries: remove one"));
        }
        // A lack of room is met when its turn comes; what could not be shot today is told now.
        match self.planned(&inner, &request.session) {
            Ok(_) => {}
            Err(EngineError::Plan(PlanError { reasons: more })) => {
                reasons.extend(more.into_iter().map(|reason| format!("session.{reason}")));
            }
            Err(error) => return Err(error),
        }
        if !reasons.is_empty() {
            return Err(PlanError { reasons }.into());
        }
        let id = self.book.clock.new_id().to_string();
        let entry = QueueEntry { id: id.clone(), request: request.clone(), started: 0, last: None, refused: None };
        inner.change_queue(|queue| queue.entries.push(entry))?;
        drop(inner);
        self.book.nudge();
        let found = self.queue().entries.into_iter().find(|queued| queued.entry.id == id);
        found.ok_or_else(|| unknown(&id))
    }

    /// Takes an entry out; a run of it that goes on is not ended.
    pub fn dequeue(&self, id: &str) -> Result<(), EngineError> {
        let mut inner = self.book.lock();
        known(&inner, id)?;
        inner.change_queue(|queue| queue.entries.retain(|entry| entry.id != id))?;
        Ok(())
    }

    /// Makes an entry the next one, and one that was refused be tried again.
    pub fn queue_first(&self, id: &str) -> Result<QueueSnapshot, EngineError> {
        let mut inner = self.book.lock();
        known(&inner, id)?;
        inner.queue_waits = None;
        inner.change_queue(|queue| {
            if let Some(at) = queue.entries.iter().position(|entry| entry.id == id) {
                let mut entry = queue.entries.remove(at);
                entry.refused = None;
                queue.entries.insert(0, entry);
            }
        })?;
        drop(inner);
        self.book.nudge();
        Ok(self.queue())
    }

    /// Holds the queue, or lets it go on; the session that is running is not touched.
    pub fn hold_queue(&self, held: bool) -> Result<QueueSnapshot, EngineError> {
        let mut inner = self.book.lock();
        inner.queue_waits = None;
        inner.change_queue(|queue| queue.held = held.then(|| BY_USER.to_owned()))?;
        drop(inner);
        self.book.nudge();
        Ok(self.queue())
    }
}

fn known(inner: &Inner, id: &str) -> Result<(), EngineError> {
    inner.queue.entries.iter().any(|entry| entry.id == id).then_some(()).ok_or_else(|| unknown(id))
}

fn unknown(id: &str) -> EngineError {
    EngineError::UnknownEntry { id: id.chars().take(64).collect() }
}

fn later(time: Timestamp, seconds: f64) -> Timestamp {
    let span = Duration::try_from_secs_f64(seconds).ok().and_then(|span| SignedDuration::try_from(span).ok());
    span.and_then(|span| time.checked_add(span).ok()).unwrap_or(time)
}
