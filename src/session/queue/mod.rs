//! Sessions that wait for their turn: in order, some not before a time, some again and again. The queue is a file; it survives the
//! daemon, and a session of it is started once however often the daemon ends meanwhile.

mod dispatch;

pub use dispatch::spawn;

use super::plan::StartRequest;
use super::state::SessionState;
use crate::store::{Store, StoreError};
use jiff::{SignedDuration, Timestamp};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use std::time::Duration;
use utoipa::ToSchema;

/// Its file in the data directory.
const FILE: &str = "queue.json";
/// Version of that file.
const FORMAT: u32 = 1;
/// Most entries.
pub const MOST_ENTRIES: usize = 1000;
/// Most runs of one entry.
pub const MOST_RUNS: u32 = 10_000;
/// Longest time from start to start, seconds: a year.
pub const LONGEST_EVERY_S: f64 = 366.0 * 86_400.0;

/// What `POST /v1/queue` may say.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct QueueRequest {
    /// The session, as in `POST /v1/sessions`.
    #[serde(deserialize_with = "object")]
    pub session: StartRequest,
    /// How often it is shot.
    #[schema(minimum = 1, maximum = 10_000)]
    pub runs: u32,
    /// Not started before this time, RFC 3339.
    #[schema(format = DateTime)]
    pub not_before: Option<String>,
    /// Seconds from one start to the next; as soon as possible if left out.
    #[schema(minimum = 0, maximum = 31_622_400)]
    pub every_s: Option<f64>,
    /// A run that fails holds the queue until somebody releases it; otherwise the next entry is started.
    pub hold_on_failure: bool,
}

/// An object and nothing else: a list would be taken for the values of its keys in their order.
fn object<'de, D: Deserializer<'de>>(from: D) -> Result<StartRequest, D::Error> {
    let value = serde_json::Value::deserialize(from)?;
    if !value.is_object() {
        return Err(D::Error::custom("session must be an object, {} for the rig file's own plan"));
    }
    StartRequest::deserialize(value).map_err(D::Error::custom)
}

impl Default for QueueRequest {
    fn default() -> Self {
        Self { session: StartRequest::default(), runs: 1, not_before: None, every_s: None, hold_on_failure: false }
    }
}

impl QueueRequest {
    /// Every mistake that can be seen without the rig.
    pub fn mistakes(&self) -> Vec<String> {
        let mut reasons = Vec::new();
        if !(1..=MOST_RUNS).contains(&self.runs) {
            reasons.push(format!("runs: {} runs, from 1 to {MOST_RUNS} are possible", self.runs));
        }
        if self.not_before.as_ref().is_some_and(|time| time.parse::<Timestamp>().is_err()) {
            reasons.push("not_before: it is no time: write it as 2026-11-30T22:00:00+01:00".into());
        }
        if self.every_s.is_some_and(|every| !(0.0..=LONGEST_EVERY_S).contains(&every)) {
            reasons.push(format!("every_s: write 0 to {LONGEST_EVERY_S} seconds"));
        }
        reasons
    }
}

/// A run of an entry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct QueueRun {
    /// The session.
    pub session: String,
    /// How it ended; null while it runs.
    pub ended: Option<SessionState>,
}

/// A session that waits, or whose runs are not all done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct QueueEntry {
    /// Its id.
    pub id: String,
    /// What was asked; `not_before` moves on with every start of a repeated one.
    pub request: QueueRequest,
    /// Runs that were started.
    pub started: u32,
    /// The last of them; null before the first.
    pub last: Option<QueueRun>,
    /// Why it cannot be started, if so: it is passed over until it is moved to the front.
    pub refused: Option<String>,
}

impl QueueEntry {
    /// The time before which it is not started, if it has one.
    pub fn not_before(&self) -> Option<Timestamp> {
        self.request.not_before.as_ref()?.parse().ok()
    }

    /// Its run that was started and has not ended as far as the queue knows.
    fn running(&self) -> Option<&str> {
        self.last.as_ref().filter(|run| run.ended.is_none()).map(|run| run.session.as_str())
    }

    fn is_due(&self, now: Timestamp) -> bool {
        self.refused.is_none()
            && self.running().is_none()
            && self.not_before().is_none_or(|time| time <= now || self.is_beyond(time, now))
    }

    /// True if the next of its repeated runs is farther away than two of them are apart: the clock was wrong when it was set.
    fn is_beyond(&self, time: Timestamp, now: Timestamp) -> bool {
        let every_s = self.request.every_s.filter(|_| self.started > 0);
        every_s.is_some_and(|every_s| time.duration_since(now).as_secs_f64() > every_s + 1.0)
    }

    /// Runs still to be started.
    pub fn left(&self) -> u32 {
        self.request.runs.saturating_sub(self.started)
    }
}

/// The queue as its file has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Queue {
    format: u32,
    /// Why nothing of it is started, if so.
    pub held: Option<String>,
    /// In order.
    pub entries: Vec<QueueEntry>,
}

impl Default for Queue {
    fn default() -> Self {
        Self { format: FORMAT, held: None, entries: Vec::new() }
    }
}

impl Queue {
    /// Reads the queue of a data directory; empty when there is none.
    ///
    /// # Errors
    /// A file that is none of ours: it is not written over.
    pub fn read(store: &Store) -> Result<Self, StoreError> {
        let Some(bytes) = store.read_file(FILE)? else { return Ok(Self::default()) };
        let corrupt = |reason: String| StoreError::Corrupt {
            path: FILE.into(),
            reason: format!("{reason}: move it away, the sessions themselves are not in it"),
        };
        let queue: Self = serde_json::from_slice(&bytes).map_err(|e| corrupt(format!("it is no queue ({e})")))?;
        if queue.format != FORMAT {
            return Err(corrupt(format!("it has format {}, this version reads {FORMAT}", queue.format)));
        }
        for entry in &queue.entries {
            let mut mistakes = entry.request.mistakes();
            if entry.started > entry.request.runs {
                mistakes.push(format!("started: {} of {} runs", entry.started, entry.request.runs));
            }
            if !mistakes.is_empty() {
                return Err(corrupt(format!("entry {}: {}", entry.id, mistakes.join("; "))));
            }
        }
        Ok(queue)
    }

    /// Writes it; a crash leaves the old one or the new one.
    pub fn write(&self, store: &Store) -> Result<(), StoreError> {
        let bytes = serde_json::to_vec_pretty(self)
            .map_err(|e| StoreError::Corrupt { path: FILE.into(), reason: e.to_string() })?;
        store.write_file(FILE, &bytes)
    }

    /// The entry whose turn it is.
    pub fn due(&self, now: Timestamp) -> Option<&QueueEntry> {
        self.entries.iter().find(|entry| self.held.is_none() && entry.is_due(now))
    }

    /// The entry and the session that was started for it and is not known to have ended.
    pub fn running(&self) -> Option<(&str, &str)> {
        self.entries.iter().find_map(|entry| Some((entry.id.as_str(), entry.running()?)))
    }

    /// A run of entry `id` was started.
    pub fn started(&mut self, id: &str, session: &str, now: Timestamp) {
        let Some(entry) = self.entries.iter_mut().find(|entry| entry.id == id) else { return };
        entry.started += 1;
        entry.last = Some(QueueRun { session: session.to_owned(), ended: None });
        if let Some(every) = entry.request.every_s {
            let next = now + SignedDuration::try_from(Duration::from_secs_f64(every)).unwrap_or_default();
            entry.request.not_before = Some(next.to_string());
        }
    }

    /// The run of entry `id` ended so; an entry without runs left goes.
    pub fn ended(&mut self, id: &str, state: SessionState, reason: Option<&str>) {
        let Some(entry) = self.entries.iter_mut().find(|entry| entry.id == id) else { return };
        if let Some(run) = &mut entry.last {
            run.ended = Some(state);
            let failed = !matches!(state, SessionState::Completed | SessionState::Stopped | SessionState::Aborted);
            if failed && entry.request.hold_on_failure {
                let reason = reason.map(|reason| format!(": {reason}")).unwrap_or_default();
                self.held = Some(format!("session {} is {state}{reason}", run.session));
            }
        }
        if entry.left() == 0 {
            self.entries.retain(|entry| entry.id != id);
        }
    }
}
