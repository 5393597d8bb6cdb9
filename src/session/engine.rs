//! The engine: one thread that owns arm and camera and does one run (session or calibration) after another, with clean-up after
//! every one.

use super::acquire::{Acquisition, Ended};
use super::bench::{Bench, OpenArm, OpenCamera, Remedy};
use super::book::Book;
use super::handle::{EngineError, EngineHandle, FitRequest};
use super::processing::Processing;
use super::room::{self, Lack};
use super::state::{Event, SessionState, WrongEvent};
use super::worker::{self, Fault, Job, message};
use crate::store::{Store, StoreError};
use rig_config::Rig;
use serde_json::json;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;

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
    let (book, interrupted) = Book::open(store)?;
    let book = Arc::new(book);
    let no_thread = |e: std::io::Error| EngineError::Storage(format!("no thread for the engine: {e}"));
    let least_exposures = processing.least_exposures();
    let (jobs, worker) = worker::spawn(Arc::clone(&book), rig.clone(), processing).map_err(no_thread)?;
    let bench = Bench::new(rig.clone(), open_arm, open_camera, remedies, interrupted > 0, &book.cancel);
    let engine = Engine { rig: rig.clone(), book: Arc::clone(&book), bench, jobs: jobs.clone(), speed };
    let end = End { book: Arc::clone(&book), jobs: jobs.clone(), worker: Some(worker) };
    let run = move || {
        let _end = end;
        engine.run();
    };
    std::thread::Builder::new().name("engine".into()).spawn(run).map_err(no_thread)?;
    Ok(EngineHandle::new(book, rig, rig_text, jobs, speed, least_exposures))
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
        for fault in self.bench.clean_up() {
            tracing::error!(fault, "clean-up after a crash");
        }
        while let Some(id) = self.book.next_session() {
            self.run_session(&id);
        }
    }

    /// Acquire, clean up, fit, conclude: every step runs whatever became of the ones before.
    fn run_session(&mut self, id: &str) {
        let mut ended = self.acquire(id);
        if ended.is_ok() {
            // Refused only when a user ended the session at the last frame: the state then says how.
            let _ = self.book.happen(id, Event::FramesIn, None);
        }
        let faults = self.bench.clean_up();
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
                self.book.lock().device_fault = Some(reason.clone());
                let reason = left_over.map_or(reason.clone(), |left_over| format!("{reason}; {left_over}"));
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

/// Says that the engine has ended, even when its thread panicked, then waits for the worker: nothing of this process writes after
/// that, so the data directory is let go.
struct End {
    book: Arc<Book>,
    jobs: SyncSender<Job>,
    worker: Option<JoinHandle<()>>,
}

impl Drop for End {
    fn drop(&mut self) {
        self.book.lock().ended = true;
        self.book.nudge();
        // Either fails only where the worker has ended by itself, which is what is waited for.
        let _ = self.jobs.send(Job::End);
        let _ = self.worker.take().map(JoinHandle::join);
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
