//! The one record of all runs, sessions and calibrations: journal first, then memory, then everyone who waits is told. Engine,
//! worker and handle share it; the state in it is also how a user's verb reaches the engine.

mod calibration;
mod found;
mod taken_up;
mod told;
mod wait;
mod waiting;

pub use wait::Next;

use super::calibration::progress::CalibrationSnapshot;
use super::handle::{EngineError, SessionSnapshot};
use super::lamp::hours::LampHours;
use super::ledger::{FrameRecord, Ledger};
use super::live::LiveFit;
use super::plan::PlannedExposure;
use super::queue::Queue;
use super::state::{Event, SessionState, Verb, WrongEvent, allowed, next};
use super::verifying::Verification;
use super::work::Work;
use super::worker::Fault;
use crate::devices::Cancel;
use crate::store::journal::{Head, Journal};
use crate::store::manifest::{self, Manifest};
use crate::store::sessions::FrameWriter;
use crate::store::{Clock, Store, StoreError};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;

/// Records of a run that are kept in memory: whoever follows it reads these, older ones come from the file.
const TAIL: usize = 256;

/// All runs, shared.
pub struct Book {
    inner: Mutex<Inner>,
    changed: Condvar,
    changes: watch::Sender<u64>,
    /// The store's.
    pub clock: Arc<dyn Clock>,
    /// Set to break off a shot or a move: by an abort and by the end of the daemon. Its beats tell that the engine does not hang.
    pub cancel: Cancel,
}

/// What the lock guards.
pub struct Inner {
    /// The data directory.
    pub store: Store,
    /// Sessions and calibrations by id, so oldest first.
    pub runs: BTreeMap<String, Entry>,
    /// Accepted, not yet taken by the engine.
    pending: Option<String>,
    /// The daemon ends.
    pub shutdown: bool,
    /// The engine's thread has ended, everything cleaned up.
    pub ended: bool,
    /// What waits.
    pub queue: Queue,
    /// Sessions whose refit waits or runs, one entry a refit: they are not removed.
    pub refits: Vec<String>,
    /// The last fit of this daemon, for whoever watches.
    pub live: Option<LiveFit>,
    /// The verification that goes on, or the last one.
    pub verifying: Option<Verification>,
    /// Why the queue waits although an entry is due, if so; a user who changes the queue ends the wait.
    pub queue_waits: Option<String>,
    /// Why arm or camera could not be used last time.
    pub device_fault: Option<String>,
    /// That fault is a lamp that may be on.
    pub lamp_fault: bool,
    /// The index cannot be written.
    pub index_fault: bool,
    /// How long the lamp was lit.
    pub lamp: LampHours,
}

/// One run.
pub struct Entry {
    /// What its journal says.
    pub ledger: Ledger,
    /// How far that goes.
    pub head: Head,
    /// What was meant to happen.
    pub manifest: Manifest,
    /// The plan as accepted.
    pub work: Work,
    /// Where it is.
    pub directory: PathBuf,
    /// Seconds of wall time for each planned second.
    pub pace: f64,
    /// Why the worker cannot develop it, if so.
    pub worker_fault: Option<Fault>,
    journal: Option<Journal>,
    /// Its last records.
    tail: VecDeque<Value>,
}

impl Entry {
    /// The snapshot, with the time left at the measured pace.
    pub fn snapshot(&self) -> SessionSnapshot {
        let mut snapshot = self.ledger.snapshot.clone();
        let shooting = !snapshot.state.is_final() && snapshot.state != SessionState::Fitting;
        snapshot.remaining_s = shooting.then(|| self.work.estimated_s() * (1.0 - self.share_done()) * self.pace);
        snapshot
    }

    /// Share of the planned frame time that is committed, or was found to be dispensable.
    pub fn share_done(&self) -> f64 {
        let all = |station| self.work.exposures(station).iter().map(PlannedExposure::seconds).sum::<f64>();
        let left_out = |station: usize| {
            let exposures = self.work.exposures(station).iter().enumerate();
            exposures.filter(move |(exposure, _)| self.ledger.left_out(station, *exposure)).map(|(_, e)| e.seconds())
        };
        let one = |frame: &FrameRecord| self.work.exposures(frame.station).get(frame.exposure);
        let done: f64 = self.ledger.frames().filter_map(one).map(PlannedExposure::seconds).sum();
        let spared: f64 = (0..self.work.stations()).flat_map(left_out).sum();
        (done + spared) / (0..self.work.stations()).map(all).sum::<f64>()
    }

    /// State now.
    pub fn state(&self) -> SessionState {
        self.ledger.snapshot.state
    }
}

impl Book {
    /// Reads every session of the store. Those that a crash left unfinished are cleaned and marked interrupted; their number
    /// is the second value. Time passes `speed` times faster than real.
    pub fn open(store: Store, speed: f64) -> Result<(Self, usize), StoreError> {
        let clock = store.clock();
        let (found, unreadable) = store.runs()?;
        let (queue, lamp) = (Queue::read(&store)?, LampHours::read(&store, speed)?);
        for error in &unreadable {
            tracing::error!(%error, "a session directory is left alone");
        }
        let mut inner = Inner {
            store,
            runs: BTreeMap::new(),
            pending: None,
            shutdown: false,
            ended: false,
            queue,
            refits: Vec::new(),
            live: None,
            verifying: None,
            queue_waits: None,
            device_fault: None,
            lamp_fault: false,
            index_fault: false,
            lamp,
        };
        // One that cannot be read may have been running.
        let mut interrupted = unreadable.len();
        for session in found {
            interrupted += usize::from(inner.take_in(session));
        }
        let total = inner.runs.values().map(|entry| entry.ledger.snapshot.last_seq).sum();
        let (changes, _) = watch::channel(total);
        let book =
            Self { inner: Mutex::new(inner), changed: Condvar::new(), changes, clock, cancel: Cancel::default() };
        Ok((book, interrupted))
    }

    /// The lock; whoever holds it keeps it for no longer than a journal line takes.
    pub fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes with every record.
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }

    /// Tells everyone who watches that a record was added, or a run removed. Called without the lock: a watcher may look at the book at once.
    pub fn tell(&self) {
        self.changes.send_modify(|count| *count += 1);
        self.changed.notify_all();
    }

    /// Tells those alone who watch: something changed that is no record.
    pub fn show(&self) {
        self.changes.send_modify(|count| *count += 1);
    }

    /// Tells everyone who waits that something other than a record changed.
    pub fn nudge(&self) {
        self.changed.notify_all();
    }

    /// Journals a record of a session; it counts once this has returned.
    pub fn record(&self, id: &str, kind: &str, fields: Value) -> Result<(), StoreError> {
        let record = self.lock().record(id, kind, fields)?;
        self.tell();
        if let Some(record) = record {
            told::log(id, &record);
        }
        Ok(())
    }

    /// Journals what need not hold up the work when the disk does not take it.
    pub fn note(&self, id: &str, kind: &str, fields: Value) {
        if let Err(error) = self.record(id, kind, fields) {
            tracing::error!(session = id, kind, %error, "not journalled");
        }
    }

    /// An event of the engine's own: the state after it.
    pub fn happen(&self, id: &str, event: Event, reason: Option<&str>) -> Result<SessionState, WrongEvent> {
        let state = self.lock().happen(id, event, reason)?;
        self.tell();
        tracing::info!(session = id, %state, reason, "session.state");
        Ok(state)
    }

    /// Something a user asks; looks at the run afterwards.
    pub fn ask<T>(&self, id: &str, verb: Verb, look: impl FnOnce(&Entry) -> T) -> Result<T, EngineError> {
        let mut inner = self.lock();
        let entry = inner.entry(id)?;
        let (state, takes) = (entry.state(), |verb: &Verb| entry.work.takes(*verb));
        let allowed: Vec<Verb> = allowed(state).into_iter().filter(takes).collect();
        if inner.ended {
            return Err(EngineError::Gone);
        }
        if !allowed.contains(&verb) || inner.happen(id, Event::Asked(verb), None).is_err() {
            return Err(EngineError::WrongState { verb, state, allowed });
        }
        if verb == Verb::Abort {
            self.cancel.cancel();
        }
        let seen = look(inner.entry(id)?);
        drop(inner);
        self.tell();
        Ok(seen)
    }

    /// The lamp goes on, or off.
    pub fn switch_lamp(&self, lit: bool) {
        let inner = &mut *self.lock();
        if lit { inner.lamp.light() } else { inner.lamp.put_out() }
    }

    /// Writes down who answered at the other end of the cables.
    pub fn identify(&self, id: &str, arm: String, camera: String) -> Result<(), StoreError> {
        let mut inner = self.lock();
        let disk = inner.store.disk();
        let Some(entry) = inner.runs.get_mut(id) else { return Ok(()) };
        (entry.manifest.arm, entry.manifest.camera) = (Some(arm), Some(camera));
        manifest::write(disk.as_ref(), &entry.directory, &entry.manifest)
    }

    /// Writes frames of a session without the lock.
    pub fn frame_writer(&self, id: &str) -> Option<FrameWriter> {
        let inner = self.lock();
        inner.runs.get(id).map(|entry| inner.store.frame_writer(&entry.directory))
    }

    /// Looks something up in a session.
    pub fn look<T>(&self, id: &str, look: impl FnOnce(&mut Entry) -> T) -> Option<T> {
        self.lock().runs.get_mut(id).map(look)
    }
}

impl Inner {
    /// Makes a run, with `files` in its directory, and leaves it for the engine; the caller tells it.
    pub fn begin(
        &mut self,
        manifest: Manifest,
        work: Work,
        files: &[(&str, &[u8])],
        pace: f64,
    ) -> Result<&Entry, EngineError> {
        let fields = state_fields(SessionState::Preflight, None);
        let (directory, journal, record) = self.store.create(&manifest, files, "session.state", fields)?;
        let mut ledger = Ledger::new(&manifest, &work);
        ledger.apply(&record);
        let id = manifest.id.clone();
        let (tail, head) = (VecDeque::from([record]), journal.head().clone());
        let journal = Some(journal);
        let entry = Entry { ledger, head, manifest, work, directory, pace, worker_fault: None, journal, tail };
        self.runs.insert(id.clone(), entry);
        self.pending = Some(id.clone());
        self.entry(&id)
    }

    /// Refuses when a run holds the rig, or the daemon ends.
    pub fn check_idle(&self) -> Result<(), EngineError> {
        if self.shutdown || self.ended {
            return Err(EngineError::Gone);
        }
        match self.active() {
            Some(active) => Err(EngineError::Busy { running: active.manifest.id.clone(), state: active.state() }),
            None => Ok(()),
        }
    }

    /// A run by id.
    pub fn entry(&self, id: &str) -> Result<&Entry, EngineError> {
        self.runs.get(id).ok_or_else(|| unknown(id))
    }

    /// A session by id.
    pub fn session(&self, id: &str) -> Result<&Entry, EngineError> {
        let entry = self.entry(id)?;
        entry.work.capture().map(|_| entry).ok_or_else(|| unknown(id))
    }

    /// A calibration run by id.
    pub fn calibration(&self, id: &str) -> Result<(&Entry, CalibrationSnapshot), EngineError> {
        let found = self.runs.get(id).and_then(|entry| Some((entry, entry.calibration()?)));
        found.ok_or_else(|| EngineError::UnknownCalibration { id: id.chars().take(64).collect() })
    }

    /// The run that holds the rig.
    pub fn active(&self) -> Option<&Entry> {
        self.runs.values().rev().find(|entry| !entry.state().is_final())
    }

    /// The record as it was journalled; none when there is no such run.
    fn record(&mut self, id: &str, kind: &str, fields: Value) -> Result<Option<Value>, StoreError> {
        let Value::Object(fields) = fields else { return Ok(None) };
        let Some(entry) = self.runs.get_mut(id) else { return Ok(None) };
        let mut journal = match entry.journal.take() {
            Some(journal) => journal,
            None => self.store.open_journal(&entry.directory, &entry.manifest)?,
        };
        let record = journal.append(kind, fields);
        entry.head.clone_from(journal.head());
        entry.journal = Some(journal);
        let record = record?;
        entry.ledger.apply(&record);
        entry.tail.push_back(record.clone());
        if entry.tail.len() > TAIL {
            entry.tail.pop_front();
        }
        if entry.state().is_final() {
            // From now on the file tells.
            entry.tail = VecDeque::new();
            entry.journal = None;
        }
        let ended = entry.state().is_final();
        self.lamp.keep(&self.store, ended);
        Ok(Some(record))
    }

    /// Changes the state. On a disk that takes nothing more the change is real all the same: the lamp must still go off.
    fn happen(&mut self, id: &str, event: Event, reason: Option<&str>) -> Result<SessionState, WrongEvent> {
        let state = self.runs.get(id).map_or(SessionState::Failed, Entry::state);
        let after = next(state, event)?;
        let mut fields = state_fields(after, reason);
        fields.insert("resumes".into(), json!(event == Event::DaemonEnded && state.goes_on_by_itself()));
        let fields = Value::Object(fields);
        if let Err(error) = self.record(id, "session.state", fields) {
            tracing::error!(session = id, state = ?after, %error, "state not journalled");
            if let Some(entry) = self.runs.get_mut(id) {
                let time = self.store.clock().now().to_string();
                entry.ledger.apply(&json!({"type": "session.state", "state": after, "reason": reason, "time": time}));
            }
        }
        Ok(after)
    }

    /// Events of a run after a number; none when they are to be read from the file.
    pub fn tail_after(&self, id: &str, after: u64) -> Result<Option<Vec<Value>>, EngineError> {
        let entry = self.entry(id)?;
        let before = entry.ledger.snapshot.last_seq.saturating_sub(entry.tail.len() as u64);
        let skip = after.checked_sub(before).map(|skip| usize::try_from(skip).unwrap_or(usize::MAX));
        Ok(skip.map(|skip| entry.tail.iter().skip(skip).cloned().collect()))
    }
}

fn unknown(id: &str) -> EngineError {
    EngineError::UnknownSession { id: id.chars().take(64).collect() }
}

fn state_fields(state: SessionState, reason: Option<&str>) -> Map<String, Value> {
    let mut fields = Map::new();
    fields.insert("state".into(), json!(state));
    fields.insert("reason".into(), json!(reason));
    fields
}
