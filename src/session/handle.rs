//! What HTTP, CLI and demo hold of the engine. Cheap to clone; every call is answered at once.

mod calibration;
mod computer;
mod error;
mod kept;
mod lamp;
mod live;
mod notice;
mod queue;
mod viewer;

use super::adaptive::Saved;
use super::book::{Book, Entry, Inner};
use super::budget::TimeBudget;
use super::calibration::file::NAME as CALIBRATION_FILE;
pub use super::calibration::plan::{CalibrationRequest, Kind};
pub use super::calibration::progress::{CalibrationSnapshot, Verdict};
pub use super::calibration::settle::SettleFile;
pub use super::calibration::step::Step;
pub use super::lamp::drift::LampDrift;
use super::plan::{CapturePlan, PlanError, StartRequest, UsedCalibration};
use super::preflight;
pub use super::queue::QueueRequest;
pub use super::refit::{FitRequest, GAINS, check_rig, lobes, models, objectives, solvers};
use super::state::{SessionState, Verb};
use super::work::Work;
use super::worker::Job;
pub use crate::numerics::fit::MAX_MATERIALS;
use crate::store::journal;
use crate::store::manifest::{self, Idempotency, Manifest};
pub use computer::{ComputerStatus, OwnPlan};
pub use error::EngineError;
pub use kept::{REPORT_POLICY, ReportForm};
pub use lamp::LampStatus;
pub use live::{FitMark, LiveFit, Soundness, VerifyStatus};
pub use queue::{QueueSnapshot, QueuedSession};
use rig_config::Rig;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::Duration;
use utoipa::ToSchema;
pub use viewer::{Curves, Shading, ShownLight, Texture, checked_mesh, shape};

/// A session as anyone may see it: the body of `GET /v1/sessions/{id}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SessionSnapshot {
    /// Session id, a UUID v7.
    pub id: String,
    /// Name of the sampled object.
    pub name: String,
    /// Where the session stands.
    pub state: SessionState,
    /// Why it stands there, where that needs a reason (suspended, failed).
    pub reason: Option<String>,
    /// True when arm or camera is simulated.
    pub simulated: bool,
    /// Start, RFC 3339.
    pub started: String,
    /// End, RFC 3339; null while it runs.
    pub ended: Option<String>,
    /// Stations in the plan.
    pub stations: usize,
    /// Exposures a station.
    pub exposures: usize,
    /// Index of the station being shot.
    pub station: usize,
    /// Frames committed to disk and journalled.
    pub frames_committed: usize,
    /// Frames in the plan, without those that an adaptive session left out.
    pub frames_planned: usize,
    /// What an adaptive session left out so far, and what that cost; null of one that shoots all of its plan.
    pub saved: Option<Saved>,
    /// Stations developed to radiance.
    pub stations_developed: usize,
    /// Estimated time left, seconds; null when unknown or over.
    pub remaining_s: Option<f64>,
    /// Where lights and camera come from; null: from the rig file.
    pub calibration: Option<UsedCalibration>,
    /// What to know before trusting the result: a stale calibration, for instance.
    pub warnings: Vec<String>,
    /// Frames and brackets that did not serve and were shot again.
    pub refused: usize,
    /// Why the last of them did not, in words.
    pub last_refusal: Option<String>,
    /// How often it was interrupted and went on.
    #[serde(default)]
    pub interruptions: usize,
    /// Mean relative error of the fit, once there is one.
    pub mean_relative_error: Option<f64>,
    /// Parameters of that fit that the data determine weakly or not at all: what they say is no measurement.
    #[serde(default)]
    pub weak_parameters: usize,
    /// Where the time went, as of the last whole station; null before the first.
    pub time_budget: Option<TimeBudget>,
    /// What the reference patch said of the lamp; null without one.
    #[serde(default)]
    pub lamp_drift: Option<LampDrift>,
    /// Sequence number of the last journal record.
    pub last_seq: u64,
}

/// What a start answered: the session, and whether this call made it or an earlier one with the same key.
#[derive(Clone, Debug, PartialEq)]
pub struct Started {
    /// The session.
    pub snapshot: SessionSnapshot,
    /// True when an earlier call with the same Idempotency-Key made it.
    pub replayed: bool,
}

/// Longest wait at the daemon's end for the clean-up (a shot that must come back, the way to the park position), and for the worker.
const SHUTDOWN: Duration = Duration::from_secs(90);

/// Handle on the engine.
#[derive(Clone)]
pub struct EngineHandle {
    book: Arc<Book>,
    rig: Arc<Rig>,
    rig_text: Arc<str>,
    jobs: SyncSender<Job>,
    speed: f64,
    least_exposures: usize,
}

impl EngineHandle {
    pub(super) fn new(
        book: Arc<Book>,
        rig: Rig,
        rig_text: String,
        jobs: SyncSender<Job>,
        speed: f64,
        least_exposures: usize,
    ) -> Self {
        Self { book, rig: Arc::new(rig), rig_text: rig_text.into(), jobs, speed, least_exposures }
    }

    /// The plan a request would run (dry run): checks everything, moves nothing.
    pub fn plan(&self, request: &StartRequest) -> Result<CapturePlan, EngineError> {
        let inner = self.book.lock();
        let (plan, _) = self.planned(&inner, request)?;
        inner.store.check_space(plan.estimated_bytes)?;
        Ok(plan)
    }

    /// The plan, and the text of the calibration it uses.
    fn planned(&self, inner: &Inner, request: &StartRequest) -> Result<(CapturePlan, Option<String>), EngineError> {
        let mut plan = CapturePlan::new(&self.rig, request)?;
        let text = self.use_calibration(inner, request, &mut plan)?;
        plan.warnings.extend(self.settle_warning(inner));
        plan.warnings.extend(inner.lamp.warning(self.rig.lamp.rated_hours));
        plan.warnings.extend(preflight::of_machine(&self.rig, &plan, inner));
        if plan.exposures.len() < self.least_exposures {
            let (found, least) = (plan.exposures.len(), self.least_exposures);
            let reason = format!("exposures: a bracket of {found} cannot be developed: name at least {least}");
            return Err(PlanError { reasons: vec![reason] }.into());
        }
        Ok((plan, text))
    }

    /// Starts a session.
    pub fn start(&self, request: &StartRequest, key: Option<&str>) -> Result<Started, EngineError> {
        let idempotency = key.map(|key| idempotency(key, request)).transpose()?;
        let mut inner = self.book.lock();
        if let Some(idempotency) = &idempotency
            && let Some(earlier) = earlier_start(&inner, idempotency)?
        {
            return Ok(earlier);
        }
        let (plan, calibration) = self.planned(&inner, request)?;
        inner.check_idle()?;
        inner.store.check_space(plan.estimated_bytes)?;
        let manifest = Manifest { idempotency, ..self.manifest(&plan.name, &plan)? };
        let files: Vec<_> = calibration.iter().map(|text| (CALIBRATION_FILE, text.as_bytes())).collect();
        let snapshot = inner.begin(manifest, Work::Capture(plan), &files, 1.0 / self.speed)?.snapshot();
        drop(inner);
        self.book.tell();
        Ok(Started { snapshot, replayed: false })
    }

    fn manifest(&self, name: &str, plan: &impl Serialize) -> Result<Manifest, EngineError> {
        Ok(Manifest {
            format: manifest::FORMAT,
            id: self.book.clock.new_id().to_string(),
            name: name.to_owned(),
            started: self.book.clock.now().to_string(),
            software: super::SOFTWARE.into(),
            simulated: self.rig.is_simulated(),
            plan: serde_json::to_value(plan).map_err(|e| EngineError::Storage(e.to_string()))?,
            rig_file: self.rig_text.to_string(),
            arm: None,
            camera: None,
            idempotency: None,
            version: None,
        })
    }

    /// Asks something of a session; answers with its snapshot after the request was taken.
    pub fn command(&self, id: &str, verb: Verb) -> Result<SessionSnapshot, EngineError> {
        let mut inner = self.book.lock();
        let interrupted = inner.session(id)?.state() == SessionState::Interrupted;
        if verb == Verb::Resume && interrupted {
            let snapshot = inner.take_up(id, &self.rig_text, "taken up again by a user")?.snapshot();
            drop(inner);
            self.book.tell();
            return Ok(snapshot);
        }
        drop(inner);
        self.book.ask(id, verb, Entry::snapshot)
    }

    /// Every session, newest first.
    pub fn sessions(&self) -> Vec<SessionSnapshot> {
        let inner = self.book.lock();
        inner.runs.values().rev().filter(|entry| entry.work.capture().is_some()).map(Entry::snapshot).collect()
    }

    /// Id of the session or calibration that has the rig.
    pub fn running(&self) -> Option<String> {
        self.book.lock().active().map(|run| run.manifest.id.clone())
    }

    /// One session.
    pub fn session(&self, id: &str) -> Result<SessionSnapshot, EngineError> {
        Ok(self.book.lock().session(id)?.snapshot())
    }

    /// The plan of one session.
    pub fn session_plan(&self, id: &str) -> Result<CapturePlan, EngineError> {
        let inner = self.book.lock();
        let plan = inner.session(id)?.work.capture().cloned();
        plan.ok_or_else(|| EngineError::UnknownSession { id: id.to_owned() })
    }

    /// Changes with every journal record of any run and with its removal; the value counts them. Watch it, then read the journal.
    pub fn changes(&self) -> tokio::sync::watch::Receiver<u64> {
        self.book.changes()
    }

    /// Journal records of a session or calibration with a sequence number above `after`, oldest first, as JSON objects
    /// with at least `seq` (u64), `time` (RFC 3339), `type` (`session.state`, `frame.committed`, ...), `session`, `simulated`.
    pub fn events_after(&self, id: &str, after: u64) -> Result<Vec<Value>, EngineError> {
        let (tail, directory, last_seq) = {
            let inner = self.book.lock();
            let entry = inner.entry(id)?;
            (inner.tail_after(id, after)?, entry.directory.clone(), entry.ledger.snapshot.last_seq)
        };
        if let Some(records) = tail {
            return Ok(records);
        }
        // A line that is being written was not acknowledged yet.
        let mut records = journal::read(&directory.join(journal::FILE))?.records;
        records.retain(|record| record["seq"].as_u64().is_some_and(|seq| seq > after && seq <= last_seq));
        Ok(records)
    }

    /// `Ok` when a session could start now; otherwise each reason why not (arm, camera, disk).
    pub fn readiness(&self) -> Result<(), Vec<String>> {
        let inner = self.book.lock();
        let mut reasons: Vec<String> = inner.device_fault.iter().cloned().collect();
        if inner.shutdown || inner.ended {
            reasons.push(EngineError::Gone.to_string());
        }
        match self.planned(&inner, &StartRequest::default()) {
            Ok((plan, _)) => reasons.extend(inner.store.check_space(plan.estimated_bytes).err().map(|e| e.to_string())),
            Err(error) => reasons.push(error.to_string()),
        }
        if reasons.is_empty() { Ok(()) } else { Err(reasons) }
    }

    /// Grows as long as the engine does not hang.
    pub fn beats(&self) -> u64 {
        self.book.cancel.beats()
    }

    /// Ends the engine: a running session is broken off, cleaned up and marked interrupted. Returns once that is done, the worker
    /// has put down its work, and the data directory is free for another daemon.
    pub fn shutdown(&self) -> Result<(), EngineError> {
        self.book.lock().shutdown = true;
        self.book.cancel.cancel();
        self.book.nudge();
        let late = |what: &str| EngineError::Storage(format!("{what} within {} s", SHUTDOWN.as_secs()));
        let cleaned = self.book.wait(SHUTDOWN, |inner| inner.ended.then_some(()));
        cleaned.ok_or_else(|| late("switch the lamp's supply off by hand: no clean-up"))?;
        let free = self.book.wait(SHUTDOWN, |inner| (!inner.store.is_held()).then_some(()));
        free.ok_or_else(|| late("rig and lamp are safe, but developing or fitting did not end"))
    }
}

fn idempotency(key: &str, request: &StartRequest) -> Result<Idempotency, EngineError> {
    let request = serde_json::to_vec(request).map_err(|e| EngineError::Storage(e.to_string()))?;
    Ok(Idempotency { key: key.into(), request_blake3: blake3::hash(&request).to_hex().to_string() })
}

/// The session an earlier call with this key made; refuses the key for another request.
fn earlier_start(inner: &Inner, now: &Idempotency) -> Result<Option<Started>, EngineError> {
    let with_key = |entry: &&Entry| entry.manifest.idempotency.as_ref().is_some_and(|i| i.key == now.key);
    let Some(entry) = inner.runs.values().find(with_key) else { return Ok(None) };
    if entry.manifest.idempotency.as_ref() != Some(now) {
        return Err(EngineError::KeyReused);
    }
    Ok(Some(Started { snapshot: entry.snapshot(), replayed: true }))
}
