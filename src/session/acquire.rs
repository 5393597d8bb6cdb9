//! One acquisition: stations, brackets, frames; `prepare` has what comes before them, `hold` what interrupts them, `clock`
//! where the time goes, `guided` the steps of a calibration. A frame counts
//! once it is shot, verified, on disk and journalled, in this order.

mod adaptive;
mod ambient;
mod broken;
mod burst;
mod clock;
mod frames;
mod guided;
mod hold;
mod lit_from;
mod patch;
mod prepare;
mod shooting;
mod warm_up;

use super::bench::Bench;
use super::book::Book;
use super::budget::Stage;
use super::calibration::file::CalibrationFile;
use super::calibration::stale;
use super::quality::{Fingerprint, Optics};
use super::shadow::Shadow;
use super::state::Event;
use super::witness::{self, Witness};
use super::work::Work;
use super::worker::{self, Job};
use crate::devices::arm::{ArmError, ArmStatus};
use crate::devices::camera::RawFrame;
use crate::store::sessions::FrameWriter;
use clock::Clock;
use rig_config::Rig;
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::Duration;

/// Retakes of a bracket whose frames contradict each other.
const BRACKETS: usize = 2;

/// Stations after which an arm that cannot see lost steps is led to its switch, and at the end once more.
const PROOF_STATIONS: usize = 20;

/// Why an acquisition ended before its last frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Ended {
    /// A user asked for a stop.
    Stopped,
    /// A user asked for an abort.
    Aborted,
    /// The daemon ends.
    ShutDown,
    /// It cannot go on, for this reason.
    Failed(String),
    /// Arm or camera cannot go on, for this reason; what was shot is kept.
    Interrupted(String),
}

/// What breaks off a bracket.
enum Trouble {
    /// The arm must be recovered; then the station is shot again from its first exposure.
    Arm(String),
    /// The frames of the bracket contradict each other: all of them are shot again under one lamp.
    Bracket(String),
    /// The camera answers, but none of its frames serves: the end of a session; an operator may help a calibration on.
    Frame(String),
    /// The acquisition is over.
    End(Ended),
}

impl From<Ended> for Trouble {
    fn from(ended: Ended) -> Self {
        Self::End(ended)
    }
}

/// A running acquisition.
pub struct Acquisition<'a> {
    id: &'a str,
    rig: &'a Rig,
    work: Work,
    book: &'a Book,
    bench: &'a mut Bench,
    worker: &'a SyncSender<Job>,
    writer: FrameWriter,
    speed: f64,
    attempts: BTreeMap<(usize, usize), usize>,
    bracket: usize,
    /// It goes on with a session that was interrupted.
    resumed: bool,
    /// The station whose bracket the interruption broke, until it was seen whether that can go on.
    broken: Option<usize>,
    recoveries: usize,
    last: Option<Fingerprint>,
    /// What the pictures say of each other.
    witness: Witness,
    /// What they say of where the lamp stands.
    shadow: Shadow,
    /// The last bracket was lit from elsewhere: the next one tells whether homing mended that.
    arm_doubted: bool,
    /// The last frame was black: the next one tells whether the lamp is out.
    lamp_doubted: bool,
    /// Rung of the camera's ladder that comes next; the first again after a good frame.
    rung: usize,
    /// The calibration in use, until the first frame was held against it.
    to_doubt: Option<CalibrationFile>,
    clock: Clock,
    /// When the arm last reported that it stands, by the book's clock.
    rested: Duration,
    /// Time between two frames of a burst, seconds; known after the first.
    period_s: f64,
}

impl<'a> Acquisition<'a> {
    /// Takes up the run `id` of the book; none when the book does not know it.
    pub fn new(
        id: &'a str,
        rig: &'a Rig,
        book: &'a Book,
        bench: &'a mut Bench,
        worker: &'a SyncSender<Job>,
        speed: f64,
    ) -> Option<Self> {
        let work = book.look(id, |entry| entry.work.clone())?;
        let writer = book.frame_writer(id)?;
        let (resumed, (attempts, bracket), spent) = book.look(id, |entry| {
            let ledger = &entry.ledger;
            (ledger.taken_up() > 0, ledger.attempts(), ledger.snapshot.time_budget.clone().unwrap_or_default())
        })?;
        let calibrated = work.capture().is_some_and(|plan| plan.calibration.is_some());
        let witness = Witness::new(witness::part(rig, calibrated));
        let now = book.clock.elapsed();
        Some(Self {
            id,
            rig,
            witness,
            shadow: Shadow::new(rig),
            arm_doubted: false,
            lamp_doubted: false,
            work,
            book,
            bench,
            worker,
            writer,
            speed,
            attempts,
            bracket,
            resumed,
            broken: None,
            recoveries: 0,
            last: None,
            rung: 0,
            to_doubt: None,
            clock: Clock::new(spent, now),
            rested: now,
            period_s: 0.0,
        })
    }

    /// Runs the plan; returns when every frame is committed and handed to the worker.
    pub fn run(mut self) -> Result<(), Ended> {
        let ended = self.whole_run();
        self.tell_budget();
        ended
    }

    fn whole_run(&mut self) -> Result<(), Ended> {
        let todo = self.adopt()?;
        if todo.is_empty() {
            return Ok(());
        }
        let prepared = self.preflight();
        self.spend(Stage::Preparation, self.clock.begin());
        prepared?;
        // Refused only when a user ended the session meanwhile: the next safe point sees it.
        let _ = self.book.happen(self.id, Event::Ready, None);
        self.start_pace();
        if let Work::Calibration(plan) = &self.work {
            let plan = plan.clone();
            return self.guided(&plan);
        }
        for stations in todo.chunks(PROOF_STATIONS) {
            let shot = self.stations(stations)?;
            self.prove_position(&stations[..shot])?;
            if shot < stations.len() {
                break;
            }
        }
        Ok(())
    }

    /// Shoots these stations until they suffice; how many that were.
    fn stations(&mut self, stations: &[usize]) -> Result<usize, Ended> {
        for (shot, &station) in stations.iter().enumerate() {
            if self.lights_suffice(station)? {
                return Ok(shot);
            }
            self.whole_station(station)?.map_err(Ended::Interrupted)?;
            self.hand_over(|session| Job::Develop { session, station })?;
        }
        Ok(stations.len())
    }

    /// Proves that these stations were lit from where the arm said.
    fn prove_position(&mut self, stations: &[usize]) -> Result<(), Ended> {
        let (Some(first), Some(last)) = (stations.first(), stations.last()) else { return Ok(()) };
        let (cancel, begin) = (self.book.cancel.clone(), self.now());
        let proved = self.bench.arm().and_then(|arm| arm.prove_position(&cancel));
        self.spend(Stage::Motion, begin);
        match proved {
            Ok(()) => Ok(()),
            Err(error @ ArmError::StepsLost { .. }) => Err(Ended::Interrupted(format!(
                "{error}; stations {first} to {last} may have been lit from elsewhere: shoot them again"
            ))),
            Err(ArmError::Cancelled) => Err(self.asked_end()),
            Err(other) => Err(Ended::Interrupted(format!(
                "{other}; whether steps were lost during stations {first} to {last} is not known: shoot them again"
            ))),
        }
    }

    /// Shoots a station, however often the arm has to be recovered for it; the inner error says why its frames do not serve.
    fn whole_station(&mut self, station: usize) -> Result<Result<(), String>, Ended> {
        let mut brackets = 0;
        while let Err(trouble) = self.shoot_station(station) {
            match trouble {
                Trouble::Bracket(reason) if brackets < BRACKETS => {
                    brackets += 1;
                    self.record("bracket.rejected", json!({"station": station, "reason": reason}))?;
                }
                Trouble::Bracket(reason) => {
                    return Ok(Err(format!(
                        "the bracket was refused {} times, at last because {reason}",
                        brackets + 1
                    )));
                }
                Trouble::Arm(reason) => {
                    let begin = self.now();
                    let recovered = self.recover(reason);
                    self.spend(Stage::Recovery, begin);
                    recovered?;
                }
                Trouble::Frame(reason) => return Ok(Err(reason)),
                Trouble::End(ended) => return Err(ended),
            }
        }
        self.recoveries = 0;
        self.tell_budget();
        Ok(Ok(()))
    }

    /// Journals what the devices say against the calibration this session uses.
    fn doubt_devices(&mut self, arm: &str, camera: &str) -> Result<(), Ended> {
        let directory = self.book.look(self.id, |entry| entry.directory.clone()).unwrap_or_default();
        let Some(calibration) = CalibrationFile::of_session(&directory).map_err(Ended::Failed)? else { return Ok(()) };
        let warnings = stale::other_devices(&calibration, arm, camera);
        self.to_doubt = Some(calibration);
        self.doubt(warnings)
    }

    /// Journals what the first frame says against it.
    fn doubt_optics(&mut self, frame: &RawFrame) -> Result<(), Ended> {
        let Some(calibration) = self.to_doubt.take() else { return Ok(()) };
        self.doubt(stale::other_optics(&calibration, &Optics::of(&frame.bytes)))
    }

    fn doubt(&mut self, warnings: Vec<String>) -> Result<(), Ended> {
        if warnings.is_empty() { Ok(()) } else { self.record("calibration.doubted", json!({"warnings": warnings})) }
    }

    fn shoot_station(&mut self, station: usize) -> Result<(), Trouble> {
        self.safe_point()?;
        let angle_deg = self.work.angle_deg(station);
        if let Some(approach) = self.work.approach(station) {
            return self.burst(station, angle_deg, approach);
        }
        self.move_to(station, angle_deg)?;
        let begin = self.now();
        self.rest(self.rig.arm.settle_s)?;
        self.spend(Stage::Settling, begin);
        self.shoot_bracket(station, angle_deg)
    }

    /// Turns the arm; it has reported rest when this returns.
    fn turn(&mut self, angle_deg: f64) -> Result<ArmStatus, Trouble> {
        let cancel = self.book.cancel.clone();
        let moved = self.bench.arm().and_then(|arm| arm.move_to(angle_deg, &cancel));
        self.rested = self.now();
        moved.map_err(|e| self.arm_trouble(&e))
    }

    /// Turns the arm to a station.
    fn move_to(&mut self, station: usize, angle_deg: f64) -> Result<(), Trouble> {
        let begin = self.now();
        let turned = self.turn(angle_deg);
        self.spend(Stage::Motion, begin);
        let status = turned?;
        let fields = json!({"station": station, "target_deg": angle_deg, "angle_deg": status.angle_deg});
        Ok(self.record("arm.moved", fields)?)
    }

    fn shoot_bracket(&mut self, station: usize, angle_deg: f64) -> Result<(), Trouble> {
        let kept = self.keep_broken(station, angle_deg)?;
        if kept.is_empty() {
            self.bracket += 1;
            self.witness.begin();
        }
        self.watch_patch(station);
        self.expose(station, angle_deg, kept)?;
        self.check_lit_from(station, angle_deg)?;
        let of_object = self.witness.finish();
        self.tell_drift(station, of_object)
    }

    /// The frame just taken, or the bracket about to go on, stands under the planned light: the arm's angle by its own status.
    fn check_light(&mut self, angle_deg: f64) -> Result<f64, Trouble> {
        match self.bench.proof_of_light(angle_deg) {
            Ok(Ok(stood_deg)) => Ok(stood_deg),
            Ok(Err(reason)) => Err(Trouble::Arm(reason)),
            Err(error) => Err(self.arm_trouble(&error)),
        }
    }

    /// Gives the worker a job of this run.
    fn hand_over(&self, job: impl FnOnce(String) -> Job) -> Result<(), Ended> {
        let (mut job, begin) = (job(self.id.to_owned()), self.now());
        loop {
            match self.worker.try_send(job) {
                Ok(()) => return Ok(()),
                Err(TrySendError::Disconnected(_)) => return Err(Ended::Failed("the worker has ended".into())),
                Err(TrySendError::Full(_)) if self.since(begin) > worker::PATIENCE => {
                    return Err(Ended::Interrupted(worker::HANGS.into()));
                }
                Err(TrySendError::Full(again)) => {
                    job = again;
                    self.wait_for_worker()?;
                }
            }
        }
    }

    fn arm_trouble(&self, error: &ArmError) -> Trouble {
        match error {
            ArmError::NoAnswer { .. } | ArmError::Port { .. } | ArmError::Rebooted { .. } | ArmError::Locked { .. } => {
                Trouble::Arm(error.to_string())
            }
            ArmError::Cancelled => Trouble::End(self.asked_end()),
            // Trying again makes a blocked or refusing arm no better; what was shot so far stands.
            other => Trouble::End(Ended::Interrupted(other.to_string())),
        }
    }

    fn arm_ended(&self, error: &ArmError) -> Ended {
        match error {
            ArmError::Cancelled => self.asked_end(),
            other => self.unfit(other.to_string()),
        }
    }
}
