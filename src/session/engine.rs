//! The engine: one thread that owns arm and camera and does one run (session or calibration) after another, with clean-up after
//! every one.

use super::acquire::{Acquisition, Ended};
use super::bench::{Bench, OpenArm, OpenCamera, Remedy};
use super::book::{Book, Entry, Next};
use super::handle::{EngineError, EngineHandle, FitRequest};
use super::index::Indexer;
use super::processing::Processing;
use super::queue;
use super::retention;
use super::room::{self, Lack};
use super::state::{Event, SessionState, WrongEvent};
use super::worker::{self, Fault, Job, message};
use crate::store::{Store, StoreError};
use rig_config::Rig;
use serde_json::json;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Wait between two tries to put out a lamp that may be on.
const SAFE_AGAIN: Duration = Duration::from_secs(5);

/// How often a session is taken up at the daemon's start without a frame in between: it may be what ends the daemon.
const TAKEN_UP: usize = 3;

/// What the composition root gives the engine.
pub struct EngineParts {
    /// The rig.
    pub rig: Rig,
    /// The rig file, word for word, for the manifests.
    pub rig_text: String,
    /// Where sessions are kept.
    pub store: Store,
    /// Opens the arm.
    pub open_arm: OpenArm,
    /// Opens the camera.
    pub open_camera: OpenCamera,
    /// What may bring back a camera that does not open anew, in this order.
    pub remedies: Vec<Remedy>,
    /// Develops and fits; [`super::processing::PipelineProcessing`] outside tests.
    pub processing: Box<dyn Processing>,
    /// How many times faster than real the engine's own waits (soak, settle) pass; 1 on real hardware.
    pub speed: f64,
}

/// Marks what a crash left behind, starts engine and worker, and hands out the handle.
pub fn start(parts: EngineParts) -> Result<EngineHandle, EngineError> {
    let EngineParts { rig, rig_text, store, open_arm, open_camera, remedies, processing, speed } = parts;
    if !(speed.is_finite() && speed > 0.0) {
        return Err(EngineError::Storage(format!("simulation.speed is {speed}: it must be a positive number")));
    }
    let unsafe_before = store.is_marked_unsafe();
    let indexed = store.indexed().map(Path::to_path_buf);
    let (book, interrupted) = Book::open(store, speed)?;
    let book = Arc::new(book);
    let no_thread = |e: std::io::Error| EngineError::Storage(format!("no thread for the engine: {e}"));
    let least_exposures = processing.least_exposures();
    let (jobs, worker) = worker::spawn(Arc::clone(&book), rig.clone(), processing).map_err(no_thread)?;
    let bench =
        Bench::new(rig.clone(), open_arm, open_camera, remedies, interrupted > 0 || unsafe_before, &book.cancel);
    if rig.storage.resume_at_start {
        resume(&book, &rig_text);
    }
    let engine = Engine { rig: rig.clone(), book: Arc::clone(&book), bench, jobs: jobs.clone(), speed };
    let index = indexed.map(|data| Indexer::spawn(Arc::clone(&book), data)).transpose().map_err(no_thread)?;
    let end = End { book: Arc::clone(&book), jobs: jobs.clone(), worker: Some(worker), index };
    let run = move || {
        let _end = end;
        engine.run();
    };
    std::thread::Builder::new().name("engine".into()).spawn(run).map_err(no_thread)?;
    let handle = EngineHandle::new(Arc::clone(&book), rig.clone(), rig_text, jobs, speed, least_exposures);
    if let Some(keep_days) = rig.storage.keep_days {
        retention::spawn(Arc::clone(&book), keep_days).map_err(no_thread)?;
    }
    queue::spawn(book, handle.clone()).map_err(no_thread)?;
    Ok(handle)
}

/// Takes up the newest session that the daemon's end interrupted and that goes on by itself.
fn resume(book: &Book, rig_text: &str) {
    let mut inner = book.lock();
    let goes_on = |entry: &&Entry| entry.ledger.resumes() && entry.work.capture().is_some();
    let Some(entry) = inner.runs.values().rev().find(goes_on) else { return };
    let (id, taken_up) = (entry.manifest.id.clone(), entry.ledger.taken_up());
    if taken_up >= TAKEN_UP {
        tracing::error!(session = id, taken_up, "not taken up again: the daemon ended every time without a new frame");
        let why = format!(
            "not taken up again: the daemon ended {taken_up} times without a new frame; look into its log, then resume the session"
        );
        return inner.append_reason(&id, &why);
    }
    match inner.take_up(&id, rig_text, "taken up again after the daemon ended") {
        // As loud as the end before it.
        Ok(_) => tracing::warn!(session = id, "taken up again"),
        Err(error) => {
            tracing::error!(session = id, %error, "not taken up again");
            inner.append_reason(&id, &format!("not taken up again: {error}"));
        }
    }
}

struct Engine {
    rig: Rig,
    book: Arc<Book>,
    bench: Bench,
    jobs: SyncSender<Job>,
    speed: f64,
}

impl Engine {
    fn run(mut self) {
        // Before a session is taken up as well: it holds all its frames against their hashes first, and a GRBL has no dead-man.
        self.make_safe();
        loop {
            match self.book.next_session(self.bench.is_unsafe().then_some(SAFE_AGAIN)) {
                Next::Run(id) => self.run_session(&id),
                Next::Nothing => self.make_safe(),
                Next::End => break,
            }
        }
        if self.bench.is_unsafe() {
            self.make_safe();
        }
    }

    /// Cleans up outside a session: after a crash, and again and again after a clean-up that failed.
    fn make_safe(&mut self) {
        let faults = self.bench.clean_up();
        self.note_safety(&faults);
    }

    /// Remembers, over the end of the daemon as well, that the lamp may be on; readiness says so.
    fn note_safety(&self, faults: &[String]) {
        for fault in faults {
            tracing::error!(fault, "clean-up");
        }
        if !self.bench.is_unsafe() {
            self.book.switch_lamp(false);
        }
        let mut inner = self.book.lock();
        let fault = self.bench.is_unsafe().then(|| faults.join("; "));
        if let Err(error) = inner.store.mark_unsafe(fault.as_deref()) {
            tracing::error!(%error, "that the lamp may be on is not written down");
        }
        match fault {
            Some(fault) => inner.device_fault = Some(fault),
            None if inner.lamp_fault => inner.device_fault = None,
            None => {}
        }
        inner.lamp_fault = self.bench.is_unsafe();
    }

    /// Acquire, clean up, fit, conclude: every step runs whatever became of the ones before.
    fn run_session(&mut self, id: &str) {
        let mut ended = self.acquire(id);
        if ended.is_ok() {
            // Refused only when a user ended the session at the last frame: the state then says how.
            let _ = self.book.happen(id, Event::FramesIn, None);
        }
        let faults = self.bench.clean_up();
        self.note_safety(&faults);
        for fault in &faults {
            self.book.note(id, "fault.raised", json!({"device": "bench", "reason": fault}));
        }
        let is_session = self.book.look(id, |entry| entry.work.capture().is_some()) == Some(true);
        if is_session && matches!(ended, Ok(()) | Err(Ended::Stopped)) {
            ended = self.fit(id, ended.is_ok());
        }
        self.conclude(id, ended, &faults);
    }

    fn acquire(&mut self, id: &str) -> Result<(), Ended> {
        let Self { rig, book, bench, jobs, speed } = self;
        let run = || {
            let acquisition = Acquisition::new(id, rig, book, bench, jobs, *speed);
            acquisition.ok_or_else(|| Ended::Failed("the session is unknown".into()))?.run()
        };
        catch_unwind(AssertUnwindSafe(run))
            .unwrap_or_else(|panic| Err(Ended::Failed(format!("internal error: {}", message(&*panic)))))
    }

    /// Fits what was shot; a fit that failed for lack of room is made again once there is some.
    fn fit(&self, id: &str, whole: bool) -> Result<(), Ended> {
        while let Err(fault) = self.try_fit(id, whole)? {
            self.outlast(id, fault)?;
        }
        Ok(())
    }

    /// Holds a failed fit up until there is room for it; an error when room is not what it lacked, or someone ends the session.
    fn outlast(&self, id: &str, Fault { reason, lack }: Fault) -> Result<(), Ended> {
        let reason = format!("the frames are kept, but there is no fit: {reason}");
        let (Some(Lack { error, bytes }), Some(writer)) = (lack, self.book.frame_writer(id)) else {
            return Err(Ended::Failed(reason));
        };
        room::wait_for(&self.book, id, &writer, bytes, &format!("{reason}; {error}"), self.speed);
        if self.book.lock().shutdown {
            return Err(Ended::ShutDown);
        }
        match self.book.happen(id, Event::FramesIn, None) {
            Ok(_) => Ok(()),
            Err(WrongEvent { state: SessionState::Stopping, .. }) => Err(Ended::Stopped),
            Err(WrongEvent { state: SessionState::Aborting, .. }) => Err(Ended::Aborted),
            Err(wrong) => Err(Ended::Failed(wrong.to_string())),
        }
    }

    /// Waits for the worker's fit. After a stop it is a bonus: what the frames do not give is no failure.
    fn try_fit(&self, id: &str, whole: bool) -> Result<Result<(), Fault>, Ended> {
        let complete = self.book.look(id, |entry| entry.ledger.bracket(0).is_some()).unwrap_or(false);
        if !whole && !complete {
            return Err(Ended::Stopped);
        }
        let (done, answer) = sync_channel(1);
        let job = Job::Fit { session: id.to_owned(), request: FitRequest::default(), done: Some(done) };
        if self.jobs.send(job).is_err() {
            return Err(Ended::Failed("the worker has ended: restart the daemon".into()));
        }
        let answer = worker::answer(&self.book, id, &answer)?;
        if whole { Ok(answer) } else { Err(Ended::Stopped) }
    }

    fn conclude(&self, id: &str, ended: Result<(), Ended>, faults: &[String]) {
        let left_over = (!faults.is_empty()).then(|| faults.join("; "));
        let after = match ended {
            Ok(()) | Err(Ended::Stopped | Ended::Aborted) => self.book.happen(id, Event::Done, left_over.as_deref()),
            Err(Ended::Failed(reason)) => {
                let reason = left_over.map_or(reason.clone(), |left_over| format!("{reason}; {left_over}"));
                self.book.happen(id, Event::Fault, Some(&reason))
            }
            Err(Ended::Interrupted(reason)) => {
                let reason = left_over.map_or(reason.clone(), |left_over| format!("{reason}; {left_over}"));
                self.book.lock().device_fault = Some(reason.clone());
                self.book.happen(id, Event::HardwareLost, Some(&reason))
            }
            Err(Ended::ShutDown) => self.book.happen(id, Event::DaemonEnded, Some("the daemon was shut down")),
        };
        match after {
            Ok(state) => tracing::info!(session = id, ?state, "session ended"),
            Err(error) => {
                tracing::error!(session = id, %error, "session ended out of order");
                let _ = self.book.happen(id, Event::Fault, Some(&error.to_string()));
            }
        }
    }
}

/// Says that the engine has ended, even when its thread panicked, then waits for worker and index: nothing of this process writes
/// after that, so the data directory is let go.
struct End {
    book: Arc<Book>,
    jobs: SyncSender<Job>,
    worker: Option<JoinHandle<()>>,
    index: Option<Indexer>,
}

impl Drop for End {
    fn drop(&mut self) {
        self.book.lock().ended = true;
        self.book.nudge();
        // Either fails only where the worker has ended by itself, which is what is waited for.
        let _ = self.jobs.send(Job::End);
        let _ = self.worker.take().map(JoinHandle::join);
        if let Some(index) = self.index.take() {
            index.end();
        }
        self.book.lock().store.release();
        self.book.nudge();
    }
}

impl From<StoreError> for EngineError {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::NoSpace { path, needed, free } => Self::NoSpace { needed, free, path },
            other => Self::Storage(other.to_string()),
        }
    }
}
