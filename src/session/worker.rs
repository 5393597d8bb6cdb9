//! The embedded fitting worker: one thread that develops station k while station k + 1 is shot, then fits; also serves refits.

use super::acquire::Ended;
use super::adaptive::Weighed;
use super::book::{Book, Entry};
use super::handle::FitRequest;
use super::live::Observer;
use super::processing::{Bracket, FitJob, Judged, Next, OpenBracket, Processing, StepJob};
use super::room::{self, Lack};
use super::state::SessionState;
use crate::pipeline::fit::FitProgress;
use crate::store::{Disk, StoreError};
use rig_config::Rig;
use serde_json::{Value, json};
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Jobs that may wait: beyond it the engine waits too, so that frames never pile up unseen.
const QUEUE: usize = 2;
/// Least time between two `fit.progress` records.
const PROGRESS_EVERY: Duration = Duration::from_millis(500);

/// Longest wait for the worker while the lamp is lit: no step of it takes so long unless its disk hangs.
pub const PATIENCE: Duration = Duration::from_secs(1800);
/// Why a run ends whose worker does not answer within it.
pub const HANGS: &str =
    "developing and fitting have not gone on for half an hour: does the disk hang? restart the daemon, then resume";

/// Something for the worker to do.
pub enum Job {
    /// Develop a complete bracket.
    Develop {
        /// Session id.
        session: String,
        /// Index of the light station.
        station: usize,
    },
    /// Judge a step of a calibration.
    Judge {
        /// Id of the run.
        session: String,
        /// Index of the step.
        step: usize,
        /// Told what it is worth.
        done: SyncSender<Result<Judged, Fault>>,
    },
    /// Say which exposure of an adaptive bracket comes next.
    Meter {
        /// Session id.
        session: String,
        /// Index of the light station.
        station: usize,
        /// Exposures of the bracket that are committed, in the order in which they were shot.
        shot: Vec<usize>,
        /// Told which; a reason where nothing can be said.
        done: SyncSender<Result<Next, String>>,
    },
    /// Fit the stations so far and say how good they are.
    Weigh {
        /// Session id.
        session: String,
        /// Told how good.
        done: SyncSender<Result<Weighed, Fault>>,
    },
    /// Nothing more: the worker ends.
    End,
    /// Fit what is complete.
    Fit {
        /// Session id.
        session: String,
        /// What differs from the rig file.
        request: FitRequest,
        /// Told how it went, if someone waits.
        done: Option<SyncSender<Result<(), Fault>>>,
    },
}

/// Why a step of the worker's failed.
pub struct Fault {
    /// In words.
    pub reason: String,
    /// The room that was missing, when that may be the cause: then the step is made again once there is some.
    pub lack: Option<Lack>,
}

/// What the journal tells of a fit.
const TOLD: [&str; 7] =
    ["mean_relative_error", "left_out_relative_error", "iterations", "termination", "model", "materials", "parameters"];

/// Starts the worker's thread; it ends with [`Job::End`], or when every sender is gone.
pub fn spawn(
    book: Arc<Book>,
    rig: Rig,
    processing: Box<dyn Processing>,
) -> std::io::Result<(SyncSender<Job>, JoinHandle<()>)> {
    let (sender, jobs) = sync_channel(QUEUE);
    let worker = Worker { book, rig, processing };
    let thread = std::thread::Builder::new().name("worker".into()).spawn(move || worker.run(&jobs))?;
    Ok((sender, thread))
}

struct Worker {
    book: Arc<Book>,
    rig: Rig,
    processing: Box<dyn Processing>,
}

impl Worker {
    fn run(mut self, jobs: &Receiver<Job>) {
        for job in jobs {
            match job {
                Job::End => return,
                Job::Develop { session, station } => self.develop_live(&session, station),
                Job::Judge { session, step, done } => {
                    let judged = self.judge(&session, step).map_err(|reason| self.fault(&session, &reason));
                    // The engine may have gone on without it.
                    let _ = done.send(judged);
                }
                Job::Meter { session, station, shot, done } => {
                    // The engine may have gone on without it, here and below.
                    let _ = done.send(self.meter(&session, station, &shot));
                }
                Job::Weigh { session, done } => {
                    let weighed = self.weigh(&session).map_err(|reason| self.fault(&session, &reason));
                    let _ = done.send(weighed);
                }
                Job::Fit { session, request, done } => {
                    let result = self.fit(&session, request);
                    let outcome = result.as_ref().map(|_| ()).map_err(|reason| self.fault(&session, reason));
                    self.journal_fit(&session, &result);
                    match done {
                        // The engine may have gone on without the fit.
                        Some(done) => drop(done.send(outcome)),
                        None => {
                            self.book.lock().refitted(&session);
                            self.book.show();
                        }
                    }
                }
            }
            self.book.nudge();
        }
    }

    /// Develops a bracket while the session goes on; a failure is left for the engine to find at its next safe point.
    fn develop_live(&mut self, session: &str, station: usize) {
        if broken_off(&self.book, session) {
            return;
        }
        if let Err(fault) = self.develop(session, station) {
            self.book.look(session, |entry| entry.worker_fault = Some(fault));
        }
    }

    fn fault(&self, session: &str, reason: &str) -> Fault {
        Fault { reason: reason.to_owned(), lack: room::lack(&self.book, session, &self.rig) }
    }

    /// What a journal that took no line is: room was missing when it was tried, whatever is free by now.
    fn unrecorded(error: StoreError) -> Fault {
        let reason = error.to_string();
        let lack = matches!(error, StoreError::NoSpace { .. }).then_some(Lack { error, bytes: 0 });
        Fault { reason, lack }
    }

    fn develop(&mut self, session: &str, station: usize) -> Result<(), Fault> {
        let start = self.book.clock.elapsed();
        let told = self.radiance(session, station).map_err(|reason| self.fault(session, &reason))?;
        let seconds = self.book.clock.elapsed().saturating_sub(start).as_secs_f64();
        let mut fields = json!({"station": station, "seconds": seconds});
        for key in ["exposures", "patch"] {
            fields[key] = told[key].clone();
        }
        self.book.record(session, "station.developed", fields).map_err(Self::unrecorded)
    }

    fn disk(&self) -> Arc<dyn Disk> {
        self.book.lock().store.disk()
    }

    /// Develops a bracket; what the journal says of it.
    fn radiance(&mut self, session: &str, station: usize) -> Result<Value, String> {
        let disk = self.disk();
        let bracket = self
            .book
            .look(session, |entry| {
                let frames = entry.ledger.bracket(station)?;
                let light = entry.work.capture()?.stations.get(station)?.clone();
                let (session, directory) = (session.to_owned(), entry.directory.clone());
                Some(Bracket { session, directory, disk, station, light, frames })
            })
            .flatten()
            .ok_or_else(|| format!("the bracket of station {station} is not complete"))?;
        let processing = &mut self.processing;
        guarded(|| processing.develop(&bracket)).map_err(|e| format!("station {station} cannot be developed: {e}"))
    }

    fn judge(&mut self, session: &str, step: usize) -> Result<Judged, String> {
        let disk = self.disk();
        let job = self.book.look(session, |entry| {
            let plan = entry.work.calibration()?.clone();
            let frames: Option<_> = (0..plan.stations_of(step).end).map(|s| entry.ledger.bracket(s)).collect();
            let (directory, manifest) = (entry.directory.clone(), entry.manifest.clone());
            Some(StepJob { directory, disk, manifest, plan, step, frames: frames? })
        });
        let job = job.flatten().ok_or_else(|| format!("the frames of step {step} are not complete"))?;
        let processing = &mut self.processing;
        guarded(|| processing.judge(&job))
    }

    fn meter(&mut self, session: &str, station: usize, shot: &[usize]) -> Result<Next, String> {
        let bracket = self.book.look(session, |entry| {
            let plan = entry.work.capture()?;
            let cell = |&exposure: &usize| entry.ledger.frame(station, exposure).cloned();
            Some(OpenBracket {
                session: session.to_owned(),
                directory: entry.directory.clone(),
                number: station,
                station: plan.stations.get(station)?.clone(),
                exposures: plan.exposures.clone(),
                frames: shot.iter().map(cell).collect::<Option<_>>()?,
            })
        });
        let bracket = bracket.flatten().ok_or_else(|| format!("the frames of station {station} are not there"))?;
        let processing = &mut self.processing;
        guarded(|| processing.meter(&bracket))
    }

    fn weigh(&mut self, session: &str) -> Result<Weighed, String> {
        let job = self.fit_job(session, FitRequest::default())?;
        let book = Arc::clone(&self.book);
        let mut go_on = |_: FitProgress<'_>| {
            if broken_off(&book, session) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let processing = &mut self.processing;
        guarded(|| processing.weigh(&job, &mut go_on))
    }

    /// A fit of the stations that are complete, all of them developed.
    fn fit_job(&mut self, session: &str, request: FitRequest) -> Result<FitJob, String> {
        let disk = self.disk();
        let unknown = "there is no such session";
        let complete = |entry: &mut Entry| {
            let (ledger, plan) = (&entry.ledger, entry.work.capture()?);
            let complete = (0..plan.stations.len()).take_while(|&s| ledger.bracket(s).is_some()).count();
            Some((complete, (0..complete).any(|station| !ledger.is_developed(station))))
        };
        let (complete, missing) = self.book.look(session, complete).flatten().ok_or(unknown)?;
        if complete == 0 {
            return Err("no station has a complete bracket: there is nothing to fit".into());
        }
        if missing {
            for station in 0..complete {
                self.develop(session, station).map_err(|fault| fault.reason)?;
            }
        }
        // Only now does the journal know of every station what the lamp did there.
        let job = self.book.look(session, |entry| {
            let stations = entry.work.capture()?.stations.iter().take(complete).cloned().collect();
            let (brightness, warnings) = (entry.ledger.brightness(complete), entry.ledger.warnings());
            let (directory, described) = (entry.directory.clone(), entry.ledger.is_described());
            let saved = entry.ledger.snapshot.saved.clone();
            Some(FitJob { directory, disk, stations, brightness, warnings, described, request, saved })
        });
        job.flatten().ok_or_else(|| unknown.to_owned())
    }

    fn fit(&mut self, session: &str, request: FitRequest) -> Result<Value, String> {
        let job = self.fit_job(session, request)?;
        let mut observer = Observer::begin(&self.book, session);
        let (book, mut last) = (Arc::clone(&self.book), None::<Duration>);
        let mut progress = |event: FitProgress<'_>| {
            observer.take(&event);
            let now = book.clock.elapsed();
            if let FitProgress::Iteration(at, _) = event
                && last.is_none_or(|last| now.saturating_sub(last) >= PROGRESS_EVERY)
            {
                last = Some(now);
                book.note(session, "fit.progress", json!({"iteration": at.iteration, "cost": at.cost}));
            }
            if broken_off(&book, session) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let processing = &mut self.processing;
        let result = guarded(|| processing.fit(&job, &mut progress));
        observer.end(&result);
        result
    }

    fn journal_fit(&self, session: &str, result: &Result<Value, String>) {
        let fields = match result {
            Ok(report) => {
                let mut fields = json!({"error": null});
                for key in TOLD {
                    fields[key] = report[key].clone();
                }
                fields
            }
            Err(reason) => json!({"error": reason, "mean_relative_error": null}),
        };
        self.book.note(session, "fit.finished", fields);
    }
}

/// Waits for the worker's answer, unless the run is aborted, the daemon ends, or it takes too long.
pub fn answer<T>(book: &Book, id: &str, answer: &Receiver<T>) -> Result<T, Ended> {
    let look = |inner: &mut super::book::Inner| {
        if inner.shutdown {
            return Some(Err(Ended::ShutDown));
        }
        if inner.entry(id).is_ok_and(|entry| entry.state() == SessionState::Aborting) {
            return Some(Err(Ended::Aborted));
        }
        match answer.try_recv() {
            Ok(answer) => Some(Ok(answer)),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some(Err(Ended::Failed("the worker has ended: restart the daemon".into())))
            }
        }
    };
    // In short waits: each tells the watchdog that the engine lives.
    for _ in 0..PATIENCE.as_secs() {
        if let Some(ended) = book.wait(Duration::from_secs(1), look) {
            return ended;
        }
    }
    Err(Ended::Interrupted(HANGS.into()))
}

/// True when nobody wants the session's work any more.
fn broken_off(book: &Book, session: &str) -> bool {
    let inner = book.lock();
    let state = inner.entry(session).map(super::book::Entry::state);
    inner.shutdown || state.is_ok_and(|state| state == SessionState::Aborting)
}

/// A panic in the numerics is a reason, not the end of the worker.
fn guarded<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| Err(format!("internal error: {}", message(&*panic))))
}

/// What a panic said.
pub(super) fn message(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    text.unwrap_or("a panic without a message").to_owned()
}
