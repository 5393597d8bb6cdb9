//! A rig of fakes in memory, scripted by the tests: arm, camera, disk, worker steps, and a hand-made rig description.
#![allow(dead_code, missing_docs, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod description;
pub mod disk;
pub mod jpeg;
mod processing;
pub mod sighted;

#[allow(unused_imports, reason = "each test file uses its part")]
pub use description::{LEVEL, PARK, SIZE, rig};
use disk::TestDisk;
use processing::FakeProcessing;

use rig_config::Rig;
use rigd::devices::Cancel;
use rigd::devices::arm::{Arm, ArmError, ArmIdentity, ArmStatus};
use rigd::devices::camera::{Camera, CameraError, CameraIdentity, RawFrame, Shot, Supplies};
use rigd::session::adaptive::Weighed;
use rigd::session::bench::OpenArm;
use rigd::session::calibration::file::CalibrationFile;
use rigd::session::engine::{EngineParts, start};
use rigd::session::handle::{EngineError, EngineHandle, SessionSnapshot};
use rigd::session::plan::StartRequest;
use rigd::session::processing::{Next, OpenBracket};
use rigd::session::state::SessionState;
use rigd::store::Store;
use serde_json::Value;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What the fakes did and where they stand.
#[derive(Debug, Default)]
pub struct World {
    pub angle_deg: f64,
    pub homed: bool,
    pub lamp: u16,
    pub arm_opened: usize,
    pub arm_open: bool,
    pub camera_opened: usize,
    pub camera_open: bool,
    /// What the camera says when it is opened.
    pub supplies: Supplies,
    /// Station, exposure, lamp level and angle at every shot under the lamp.
    pub shots: Vec<(usize, usize, u16, f64)>,
    /// The lamp is not the fake arm's: the camera does not know whether it is lit, and has no picture of the dark room.
    pub lamp_unseen: bool,
    /// Shots with the lamp off, which show a dark room; no script is asked about them.
    pub dark_shots: usize,
    pub developed: Vec<(usize, usize)>,
    pub fitted: Vec<usize>,
    /// Step and its frames.
    pub judged: Vec<(String, usize)>,
}

/// What the fake camera does with a shot.
pub enum Act {
    Good,
    Jpeg(Box<dyn Fn(&mut jpeg::Exif)>),
    /// The same bytes as last time.
    Repeat,
    Bytes(Vec<u8>),
    Fail(CameraError),
}

type ArmScript = Box<dyn FnMut(&'static str, &mut World) -> Option<ArmError> + Send>;
type CameraScript = Box<dyn FnMut(&Shot, usize, &Cancel) -> Act + Send>;
type StepScript = Box<dyn FnMut(&str) -> Option<String> + Send>;
type MeterScript = Box<dyn FnMut(&OpenBracket) -> Result<Next, String> + Send>;
type WeighScript = Box<dyn FnMut(usize) -> Result<Weighed, String> + Send>;

/// Everything a test can script or look at.
#[derive(Clone)]
pub struct Fakes {
    pub world: Arc<Mutex<World>>,
    pub arm_script: Arc<Mutex<ArmScript>>,
    pub camera_script: Arc<Mutex<CameraScript>>,
    pub step_script: Arc<Mutex<StepScript>>,
    pub meter_script: Arc<Mutex<MeterScript>>,
    pub weigh_script: Arc<Mutex<WeighScript>>,
    /// What the last step of a calibration measures.
    pub measured: Arc<Mutex<Option<CalibrationFile>>>,
    pub disk: Arc<TestDisk>,
}

impl Default for Fakes {
    fn default() -> Self {
        Self {
            world: Arc::default(),
            arm_script: Arc::new(Mutex::new(Box::new(|_, _| None))),
            camera_script: Arc::new(Mutex::new(Box::new(|_, _, _| Act::Good))),
            step_script: Arc::new(Mutex::new(Box::new(|_| None))),
            meter_script: Arc::new(Mutex::new(Box::new(|_| Err("no metering here".into())))),
            weigh_script: Arc::new(Mutex::new(Box::new(|_| Err("no fit here".into())))),
            measured: Arc::default(),
            disk: Arc::default(),
        }
    }
}

impl Fakes {
    /// What the fakes did so far; a script that panicked is no reason not to look.
    pub fn world(&self) -> MutexGuard<'_, World> {
        self.world.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn on_arm(&self, script: impl FnMut(&'static str, &mut World) -> Option<ArmError> + Send + 'static) {
        *self.arm_script.lock().unwrap() = Box::new(script);
    }

    /// The script gets the shot, how many shots there were before it, and the cancel flag; it may block.
    pub fn on_shot(&self, script: impl FnMut(&Shot, usize, &Cancel) -> Act + Send + 'static) {
        *self.camera_script.lock().unwrap() = Box::new(script);
    }

    /// Called with `develop N` and `fit`; a text makes that step fail.
    pub fn on_step(&self, script: impl FnMut(&str) -> Option<String> + Send + 'static) {
        *self.step_script.lock().unwrap() = Box::new(script);
    }

    /// Called with every adaptive bracket before its next exposure.
    pub fn on_meter(&self, script: impl FnMut(&OpenBracket) -> Result<Next, String> + Send + 'static) {
        *self.meter_script.lock().unwrap() = Box::new(script);
    }

    /// Called with the number of stations whose fit is judged.
    pub fn on_weigh(&self, script: impl FnMut(usize) -> Result<Weighed, String> + Send + 'static) {
        *self.weigh_script.lock().unwrap() = Box::new(script);
    }

    /// Blocks shot number `n` until the returned gate is opened.
    pub fn gate_at(&self, n: usize) -> Gate {
        let gate = Gate::default();
        let inside = gate.clone();
        self.on_shot(move |_, count, _| {
            if count == n {
                inside.pass();
            }
            Act::Good
        });
        gate
    }

    pub fn engine(&self, data: &Path) -> EngineHandle {
        self.try_engine(data, rig()).unwrap()
    }

    pub fn try_engine(&self, data: &Path, rig: Rig) -> Result<EngineHandle, EngineError> {
        self.engine_of(data, rig, "name = \"fake rig\"")
    }

    /// An engine whose manifests hold this rig file.
    pub fn engine_of(&self, data: &Path, rig: Rig, rig_text: &str) -> Result<EngineHandle, EngineError> {
        start(self.parts(self.store(data), rig, rig_text))
    }

    /// An engine in real time whose arm is opened by `open_arm`.
    pub fn engine_with_arm(&self, data: &Path, rig: Rig, open_arm: OpenArm) -> EngineHandle {
        self.world().lamp_unseen = true;
        start(EngineParts { open_arm, speed: 1.0, ..self.parts(self.store(data), rig, "name = \"fake rig\"") }).unwrap()
    }

    fn store(&self, data: &Path) -> Store {
        Store::open_on(data, 1000, self.disk.clone()).unwrap()
    }

    /// What an engine on this store is made of, ten thousand times faster than real.
    pub fn parts(&self, store: Store, rig: Rig, rig_text: &str) -> EngineParts {
        let (arm, camera) = (self.clone(), self.clone());
        EngineParts {
            rig,
            rig_text: rig_text.into(),
            store,
            open_arm: Box::new(move || arm.open_arm()),
            open_camera: Box::new(move |_| camera.open_camera()),
            remedies: Vec::new(),
            processing: Box::new(FakeProcessing(self.clone())),
            speed: 10_000.0,
        }
    }

    fn open_arm(&self) -> Result<Box<dyn Arm>, ArmError> {
        if let Some(error) = self.arm_call("open") {
            return Err(error);
        }
        let mut world = self.world();
        world.arm_opened += 1;
        world.arm_open = true;
        Ok(Box::new(FakeArm(self.clone())))
    }

    fn arm_call(&self, call: &'static str) -> Option<ArmError> {
        let mut script = self.arm_script.lock().unwrap_or_else(PoisonError::into_inner);
        let mut world = self.world();
        script(call, &mut world)
    }

    fn open_camera(&self) -> Result<Box<dyn Camera>, CameraError> {
        let mut world = self.world();
        world.camera_opened += 1;
        world.camera_open = true;
        Ok(Box::new(FakeCamera { fakes: self.clone(), last: Vec::new() }))
    }

    /// What must hold even when nothing can be written any more.
    pub fn assert_dark(&self) {
        assert_eq!(self.world().lamp, 0, "the lamp is on");
    }

    /// What must hold after every way out.
    pub fn assert_safe(&self) {
        let world = self.world();
        assert_eq!(world.lamp, 0, "the lamp is on");
        assert_eq!(world.angle_deg, PARK, "the arm is not parked");
        assert!(!world.arm_open, "the arm was not let go");
        assert!(!world.camera_open, "the camera was not released");
    }
}

/// Lets a test hold a script at a point.
#[derive(Clone, Default)]
pub struct Gate(Arc<(AtomicBool, AtomicBool)>);

impl Gate {
    fn pass(&self) {
        self.0.0.store(true, Ordering::SeqCst);
        until("the gate to open", || self.0.1.load(Ordering::SeqCst));
    }
    pub fn reached(&self) {
        until("the gate to be reached", || self.0.0.load(Ordering::SeqCst));
    }
    pub fn open(&self) {
        self.0.1.store(true, Ordering::SeqCst);
    }
}

/// Waits for something that must come true.
pub fn until(what: &str, mut true_now: impl FnMut() -> bool) {
    let end = Instant::now() + Duration::from_secs(30);
    while !true_now() {
        assert!(Instant::now() < end, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

pub fn wait_for(engine: &EngineHandle, id: &str, state: SessionState) -> SessionSnapshot {
    until(&format!("{state:?}"), || {
        let now = engine.session(id).unwrap();
        assert!(now.state == state || !now.state.is_final(), "{:?}: {:?}", now.state, now.reason);
        now.state == state
    });
    engine.session(id).unwrap()
}

pub fn begin(engine: &EngineHandle) -> String {
    engine.start(&Default::default(), None).unwrap().snapshot.id
}

/// Shoots until `frames` are committed, then the daemon ends; the session's id.
pub fn ended_after(fakes: &Fakes, data: &Path, request: &StartRequest, frames: usize) -> String {
    fakes.on_shot(move |_, count, cancel| {
        if count == frames {
            until("the cancel", || cancel.is_cancelled());
            return Act::Fail(CameraError::Cancelled);
        }
        Act::Good
    });
    let engine = fakes.engine(data);
    let id = engine.start(request, None).unwrap().snapshot.id;
    until("the shot", || fakes.world().shots.len() == frames + 1);
    engine.shutdown().unwrap();
    fakes.on_shot(|_, _, _| Act::Good);
    assert_eq!(engine.session(&id).unwrap().state, SessionState::Interrupted);
    id
}

pub fn events(engine: &EngineHandle, id: &str, kind: &str) -> Vec<Value> {
    engine.events_after(id, 0).unwrap().into_iter().filter(|e| e["type"] == kind).collect()
}

struct FakeArm(Fakes);

impl FakeArm {
    fn call(&self, call: &'static str, work: impl FnOnce(&mut World)) -> Result<ArmStatus, ArmError> {
        if let Some(error) = self.0.arm_call(call) {
            return Err(error);
        }
        let mut world = self.0.world();
        work(&mut world);
        Ok(ArmStatus {
            angle_deg: world.angle_deg,
            homed: world.homed,
            moving: false,
            lamp_permille: world.lamp,
            faults: 0,
        })
    }
}

impl Arm for FakeArm {
    fn identity(&self) -> ArmIdentity {
        ArmIdentity { firmware: "fake 1.0".into(), boot_nonce: 7 }
    }
    fn home(&mut self, cancel: &Cancel) -> Result<ArmStatus, ArmError> {
        if cancel.is_cancelled() {
            return Err(ArmError::Cancelled);
        }
        self.call("home", |world| (world.homed, world.angle_deg) = (true, 0.0))
    }
    fn move_to(&mut self, angle_deg: f64, cancel: &Cancel) -> Result<ArmStatus, ArmError> {
        if cancel.is_cancelled() {
            return Err(ArmError::Cancelled);
        }
        self.call("move", |world| world.angle_deg = angle_deg)
    }
    fn set_lamp(&mut self, permille: u16) -> Result<ArmStatus, ArmError> {
        self.call("lamp", |world| world.lamp = permille)
    }
    fn status(&mut self) -> Result<ArmStatus, ArmError> {
        self.call("status", |_| {})
    }
    fn stop(&mut self) -> Result<ArmStatus, ArmError> {
        self.call("stop", |_| {})
    }
}

impl Drop for FakeArm {
    fn drop(&mut self) {
        self.0.world().arm_open = false;
    }
}

struct FakeCamera {
    fakes: Fakes,
    last: Vec<u8>,
}

impl Camera for FakeCamera {
    fn identity(&self) -> CameraIdentity {
        CameraIdentity { model: "Fake EOS".into() }
    }
    fn supplies(&self) -> Supplies {
        self.fakes.world().supplies.clone()
    }
    fn is_live(&self) -> bool {
        !self.fakes.world().lamp_unseen
    }
    fn shoot(&mut self, shot: &Shot, cancel: &Cancel) -> Result<RawFrame, CameraError> {
        let count = {
            let mut world = self.fakes.world();
            let (lamp, angle) = (world.lamp, world.angle_deg);
            if lamp == 0 && !world.lamp_unseen {
                world.dark_shots += 1;
                return Ok(dark(shot, &world));
            }
            world.shots.push((shot.station, shot.exposure, lamp, angle));
            world.shots.len() - 1
        };
        let act = (self.fakes.camera_script.lock().unwrap_or_else(PoisonError::into_inner))(shot, count, cancel);
        let mut exif = jpeg::Exif::of(shot, count);
        let bytes = match act {
            Act::Good => jpeg::encode(SIZE, Some(&exif)),
            Act::Jpeg(change) => {
                change(&mut exif);
                jpeg::encode(SIZE, Some(&exif))
            }
            Act::Repeat => self.last.clone(),
            Act::Bytes(bytes) => bytes,
            Act::Fail(error) => return Err(error),
        };
        self.last.clone_from(&bytes);
        Ok(RawFrame { bytes, name: format!("IMG_{count:04}.JPG"), transfer: Duration::ZERO })
    }
}

/// A picture without a lamp; its number is none that a lit one has.
fn dark(shot: &Shot, world: &World) -> RawFrame {
    let mut exif = jpeg::Exif::of(shot, world.shots.len());
    exif.number = 1_000_000 + world.dark_shots as u32;
    let name = format!("DARK_{:04}.JPG", world.dark_shots);
    RawFrame { bytes: jpeg::encode_at(0, SIZE, Some(&exif)), name, transfer: Duration::ZERO }
}

impl Drop for FakeCamera {
    fn drop(&mut self) {
        self.fakes.world().camera_open = false;
    }
}
