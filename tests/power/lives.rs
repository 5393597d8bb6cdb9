//! A session that loses its power again and again, each time found on one of the disks that are possible then, until it is completed.

use super::clock::VirtualClock;
use super::course::Course;
use super::disk::{Forgets, PowerDisk};
use super::faults::{self, Chance, Counts};
use super::known::{Known, Told};
use super::paced::{PacedArm, PacedCamera};
use super::processing::Keeping;
use super::turns::Turns;
use crate::support::{Fakes, PARK};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rigd::session::engine::{EngineParts, start};
use rigd::session::handle::{EngineError, EngineHandle, FitRequest};
use rigd::session::plan::{Adaptive, StartRequest};
use rigd::session::state::{SessionState as S, Verb};
use rigd::session::verify::verify;
use rigd::store::{Clock, Store, journal};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// What a session lived through.
#[derive(Debug, Default)]
pub struct Tally {
    pub cuts: u64,
    pub frames: u64,
    /// Exposures that were shot a second time.
    pub repeated: u64,
    /// Every operation of the disk, in order.
    pub trace: Vec<String>,
    /// The journal as it was at the end of each life.
    pub journals: Vec<Vec<u8>>,
    /// Faults of the devices, by name.
    pub faults: Counts,
    /// Time it took, seconds of the simulation.
    pub seconds: f64,
}

/// One session from its start to its end, through as many cuts as `seed` says. `in_turn`: the seed also says when the worker develops;
/// otherwise the threads' chance does, and sessions of odd seeds are adaptive: in those the engine waits for the worker. The error is
/// a promise that was broken.
pub fn live_through(seed: u64, course: Course, forgets: Forgets, in_turn: bool) -> Result<Tally, String> {
    let folder = folder(seed);
    let tally = Tally::default();
    let chance = Arc::new(Chance::new(seed, course.fault_every, tally.faults.clone()));
    let mut session = Session {
        random: StdRng::seed_from_u64(seed),
        course,
        clock: Arc::new(VirtualClock::new(seed)),
        fakes: Fakes::default(),
        fits: Arc::default(),
        known: Known::default(),
        whole: BTreeSet::new(),
        waiting: 0,
        in_turn,
        adaptive: !in_turn && seed % 2 == 1,
        tally,
    };
    faults::install(&session.fakes, &chance);
    let mut turns = session.turns();
    let root = folder.path().join("0");
    let mut disk = Arc::new(PowerDisk::new(&root, forgets, turns.clone(), session.clock.clone(), chance));
    for life in 1.. {
        let soon = session.random.random_bool(0.2);
        let range = session.course.cut_range(soon);
        let cut = (life <= session.course.most_cuts).then(|| session.random.random_range(range));
        disk.arm(cut, session.random.random());
        let completed = session.live(&disk, &turns)?;
        session.tally.cuts += u64::from(disk.is_off());
        session.tally.trace.extend(disk.trace());
        session.keep_journal(&disk);
        let root = folder.path().join(life.to_string());
        let before = disk.root().to_owned();
        let image = disk.image(&mut session.random, &root);
        let told = session.check(&root, &before)?;
        if completed {
            session.known.check_whole(&told, &session.course.rig)?;
            let sound = verify(&session.directory(&before).unwrap()).map_err(|e| e.to_string())?;
            if !sound.faults.is_empty() {
                return Err(sound.faults.join("; "));
            }
            break;
        }
        (session.whole, session.waiting) = (told.whole(&session.course.rig), told.waiting(&session.course.rig));
        turns = session.turns();
        disk = Arc::new(image.with_turns(turns.clone()));
        std::fs::remove_dir_all(before).unwrap();
        session.clock.go_on();
    }
    session.tally.seconds = session.clock.elapsed().as_secs_f64();
    Ok(session.tally)
}

/// A directory with the same name whenever this process lives through the seed in this test: journals tell of it.
fn folder(seed: u64) -> TempDir {
    let thread = std::thread::current().name().unwrap_or("many").to_owned();
    let name = format!("rigd-{}-{thread}-{seed}", std::process::id());
    tempfile::Builder::new().prefix(&name).rand_bytes(0).tempdir_in(fast()).unwrap()
}

/// Where small files cost least.
fn fast() -> PathBuf {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { memory.into() } else { std::env::temp_dir() }
}

struct Session {
    random: StdRng,
    course: Course,
    clock: Arc<VirtualClock>,
    fakes: Fakes,
    fits: Arc<AtomicU64>,
    known: Known,
    /// Stations that are whole on the disk at the beginning of a life.
    whole: BTreeSet<usize>,
    /// Those of them that the worker is given then.
    waiting: usize,
    in_turn: bool,
    adaptive: bool,
    tally: Tally,
}

/// Why a life ended early: the power, which is no fault, or a promise that was broken.
enum Short {
    Cut,
    Broken(String),
}

impl Session {
    fn turns(&mut self) -> Arc<Turns> {
        let waiting = self.in_turn.then_some(self.waiting);
        Arc::new(Turns::new(self.random.random(), self.course.rig.plan.exposures.len(), waiting))
    }

    fn keep_journal(&mut self, disk: &PowerDisk) {
        let journal = self.directory(disk.root()).map(|directory| directory.join(journal::FILE));
        self.tally.journals.extend(journal.and_then(|path| std::fs::read(path).ok()));
    }

    /// The directory of the session on the file system at `root`.
    fn directory(&self, root: &Path) -> Option<PathBuf> {
        Some(root.join("data/sessions").join(self.known.id.as_ref()?))
    }

    fn check(&mut self, root: &Path, before: &Path) -> Result<Told, String> {
        let (Some(image), Some(live)) = (self.directory(root), self.directory(before)) else {
            return Ok(Told::default());
        };
        self.known.check(&image, &live, &self.course.rig, &self.fakes.world())
    }

    /// From power on to the session's end (true) or the next cut.
    fn live(&mut self, disk: &Arc<PowerDisk>, turns: &Arc<Turns>) -> Result<bool, String> {
        let shots = self.fakes.world().shots.len();
        let lived = self.try_live(disk, turns);
        self.check_shots(shots)?;
        // The dead-man of the arm; where it stands is not known to it any more.
        (self.fakes.world().lamp, self.fakes.world().homed) = (0, false);
        match lived {
            Ok(()) => Ok(true),
            Err(Short::Cut) => Ok(false),
            Err(Short::Broken(reason)) => Err(reason),
        }
    }

    fn try_live(&mut self, disk: &Arc<PowerDisk>, turns: &Arc<Turns>) -> Result<(), Short> {
        let by_itself = self.random.random();
        let engine = self.power_on(disk, turns, by_itself)?;
        let lived = self.shoot(&engine, disk);
        // What the engine told before the power went is what an observer knows.
        if let Some(id) = &self.known.id {
            let snapshot = engine.session(id).map_err(|e| Short::Broken(e.to_string()))?;
            self.known.last_seq = snapshot.last_seq;
            for frame in engine.frames(id).unwrap() {
                self.known.frames.insert(frame["file"].as_str().unwrap().to_owned(), frame);
            }
            self.tally.frames = self.known.frames.len() as u64;
        }
        turns.end();
        engine.shutdown().map_err(|e| Short::Broken(e.to_string()))?;
        let world = self.fakes.world();
        if lived.is_ok() && (world.lamp, world.angle_deg) != (0, PARK) {
            let left = format!("left with the lamp at {} and the arm at {} degrees", world.lamp, world.angle_deg);
            return Err(Short::Broken(left));
        }
        lived
    }

    fn power_on(&mut self, disk: &Arc<PowerDisk>, turns: &Arc<Turns>, by_itself: bool) -> Result<EngineHandle, Short> {
        let store = Store::open_on(&disk.root().join("data"), 0, disk.clone()).map_err(|e| short(disk, e))?;
        let store = store.with_clock(self.clock.clone());
        let mut rig = self.course.rig.clone();
        rig.storage.resume_at_start = by_itself;
        let mut parts = self.fakes.parts(store, rig, "name = \"fake rig\"");
        let (mut open, paced, clock) = (parts.open_arm, turns.clone(), self.clock.clone());
        parts.open_arm = Box::new(move || {
            let (arm, turns, clock) = (open()?, paced.clone(), clock.clone());
            Ok(Box::new(PacedArm { arm, turns, clock, angle_deg: 0.0 }))
        });
        let (mut open, clock) = (parts.open_camera, self.clock.clone());
        parts.open_camera = Box::new(move |cancel| {
            let (camera, clock) = (open(cancel)?, clock.clone());
            Ok(Box::new(PacedCamera { camera, clock }))
        });
        parts.speed = self.course.speed;
        let processing = Keeping { turns: turns.clone(), fits: self.fits.clone() };
        start(EngineParts { processing: Box::new(processing), ..parts }).map_err(|e| short(disk, e))
    }

    /// The session goes on to its end, and is sometimes fitted again.
    fn shoot(&mut self, engine: &EngineHandle, disk: &Arc<PowerDisk>) -> Result<(), Short> {
        let found = engine.sessions().first().map(|session| session.id.clone());
        if let Some(id) = &self.known.id
            && found.as_ref() != Some(id)
        {
            return Err(Short::Broken(format!("session {id} is lost")));
        }
        let id = match found {
            Some(id) => id,
            None => {
                let adaptive = self.adaptive.then(Adaptive::default);
                let request = StartRequest { adaptive, ..StartRequest::default() };
                patiently(|| engine.start(&request, None)).map_err(|e| short(disk, e))?.snapshot.id
            }
        };
        self.known.id = Some(id.clone());
        let now = || engine.session(&id).unwrap();
        if now().state == S::Interrupted {
            let faults = verify(&self.directory(disk.root()).unwrap()).map(|found| found.faults);
            if faults != Ok(Vec::new()) && !disk.is_off() {
                return Err(Short::Broken(format!("not sound: {faults:?}")));
            }
            patiently(|| engine.command(&id, Verb::Resume)).map_err(|e| short(disk, e))?;
        }
        wait("the end of the session", || now().state.is_final());
        let ended = now();
        if disk.is_off() || ended.state != S::Completed {
            return Err(short(disk, format!("{:?}: {:?}", ended.state, ended.reason)));
        }
        if self.random.random_bool(0.4) {
            self.fit_again(engine, disk, &id)?;
        }
        Ok(())
    }

    /// A refit, which the power may end as well; the session itself is completed.
    fn fit_again(&mut self, engine: &EngineHandle, disk: &PowerDisk, id: &str) -> Result<(), Short> {
        disk.arm(Some(self.random.random_range(0..20)), self.random.random());
        let last = || engine.session(id).unwrap().last_seq;
        let before = last();
        engine.refit(id, &FitRequest::default()).map_err(|e| Short::Broken(e.to_string()))?;
        wait("the fit", || last() > before || disk.is_off());
        let failed = engine.events_after(id, before).unwrap().into_iter().find(|event| !event["error"].is_null());
        failed.map_or(Ok(()), |event| Err(Short::Broken(event.to_string())))
    }

    /// Whole stations are shot no second time, and only what one broken bracket had is repeated.
    fn check_shots(&mut self, before: usize) -> Result<(), String> {
        let world = self.fakes.world();
        let again = |shot: &&(usize, usize, u16, f64)| {
            world.shots[..before].iter().any(|old| (old.0, old.1) == (shot.0, shot.1))
        };
        let repeated: Vec<_> = world.shots[before..].iter().filter(again).collect();
        self.tally.repeated += repeated.len() as u64;
        let stations: BTreeSet<usize> = repeated.iter().map(|shot| shot.0).collect();
        let whole = world.shots[before..].iter().find(|shot| self.whole.contains(&shot.0));
        match whole {
            Some(shot) => Err(format!("station {} was whole and is shot again", shot.0)),
            None if stations.len() > 1 => Err(format!("stations {stations:?} are shot again after one cut")),
            None => Ok(()),
        }
    }
}

/// A failure is no fault once the power is off.
fn short(disk: &PowerDisk, reason: impl ToString) -> Short {
    if disk.is_off() { Short::Cut } else { Short::Broken(reason.to_string()) }
}

/// Asks again while the disk is full.
fn patiently<T>(mut ask: impl FnMut() -> Result<T, EngineError>) -> Result<T, EngineError> {
    loop {
        match ask() {
            Err(EngineError::NoSpace { .. }) => {}
            other => return other,
        }
    }
}

fn wait(what: &str, mut true_now: impl FnMut() -> bool) {
    let end = Instant::now() + Duration::from_secs(120);
    while !true_now() {
        assert!(Instant::now() < end, "waited in vain for {what}");
        std::thread::sleep(Duration::from_micros(300));
    }
}
