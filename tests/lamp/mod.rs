//! A simulated rig whose lamp lives, small enough for tests: arm and camera in simulated time, the real pipeline.
#![allow(dead_code, missing_docs, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rig_config::{ReferencePatch, Rig};
use rigd::devices::rigproto::{RigprotoArm, RigprotoSettings};
use rigd::session::engine::{EngineParts, start};
use rigd::session::handle::{EngineHandle, SessionSnapshot};
use rigd::session::plan::StartRequest;
use rigd::session::processing::PipelineProcessing;
use rigd::session::state::SessionState;
use rigd::sim::arm::{ArmConfig, SimulatedArm};
use rigd::sim::camera::{CameraFaults, SimulatedCamera};
use rigd::sim::lamp::{Burning, SimulatedLamp};
use rigd::sim::pose::SharedPose;
use rigd::store::Store;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How many times faster than real everything goes.
pub const SPEED: f64 = 400.0;

/// The shipped simulated rig with a patch at the lower left, turned 20 degrees towards the lamps.
pub fn rig() -> Rig {
    let (_, shipped) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap();
    let mut rig = Rig::from_toml(shipped, "simulated.toml").unwrap();
    let (sin, cos) = 20_f64.to_radians().sin_cos();
    rig.reference_patch =
        Some(ReferencePatch { center_mm: [-47.0, 25.0, 1460.0], normal: [sin, 0.0, -cos], diameter_mm: 22.0 });
    rig.simulation.as_mut().unwrap().speed = SPEED;
    rig.lamp.soak_s = 0.0;
    rig
}

/// The same with a quarter of the pixels: no fit is made of it.
pub fn small_rig() -> Rig {
    let mut rig = rig();
    (rig.camera.width, rig.camera.height) = (144, 96);
    (rig.camera.focal_px, rig.camera.principal_px) = ([1650.0; 2], [72.0, 48.0]);
    rig
}

/// Station angles at which the patch is lit, so ordered that its lean is told from a drift: every third one on the way out, the next ones
/// on the way back, the rest on the way out again.
pub fn three_ways(stations: usize) -> Vec<f64> {
    let back = (0..stations).rev().filter(|i| i % 3 == 1);
    let order = (0..stations).step_by(3).chain(back).chain((0..stations).filter(|i| i % 3 == 2));
    order.map(|i| -36.0 + 106.0 * i as f64 / (stations - 1) as f64).collect()
}

pub fn request(stations_deg: &[f64], exposures: &[&str]) -> StartRequest {
    StartRequest {
        stations_deg: Some(stations_deg.to_vec()),
        exposures: Some(exposures.iter().map(|&label| label.to_owned()).collect()),
        ..StartRequest::default()
    }
}

/// The rig, its lamp, and a data directory.
pub struct Stage {
    /// What the engine is told.
    pub rig: Rig,
    /// What the camera sees.
    pub true_rig: Rig,
    pub pose: SharedPose,
    pub data: tempfile::TempDir,
    /// What goes wrong with the next shots.
    pub faults: CameraFaults,
    /// Radiance that the room adds everywhere.
    pub room: f64,
    lamp: SimulatedLamp,
    /// Brightness at every shot that the lamp lit.
    pub burnt: Arc<Mutex<Vec<[f64; 3]>>>,
}

impl Stage {
    pub fn new(rig: Rig, life: impl Fn(Burning) -> [f64; 3] + Send + Sync + 'static) -> Self {
        let burnt: Arc<Mutex<Vec<[f64; 3]>>> = Arc::default();
        let log = Arc::clone(&burnt);
        let lamp = SimulatedLamp::new(move |burning| {
            let brightness = life(burning);
            log.lock().unwrap().push(brightness);
            brightness
        });
        let (true_rig, data) = (rig.clone(), tempfile::tempdir().unwrap());
        let (pose, faults) = (SharedPose::default(), CameraFaults::default());
        Self { rig, true_rig, pose, data, faults, room: 0.0, lamp, burnt }
    }

    pub fn engine(&self) -> EngineHandle {
        let simulated = SimulatedArm::spawn(ArmConfig::from_rig(&self.rig, self.pose.clone())).unwrap();
        let settings = RigprotoSettings::new(simulated.port().to_owned(), &self.rig.arm);
        let (rig, pose, lamp) = (self.true_rig.clone(), self.pose.clone(), self.lamp.clone());
        let (faults, room) = (self.faults.clone(), self.room);
        start(EngineParts {
            rig: self.rig.clone(),
            rig_text: "the test's".into(),
            store: Store::open(self.data.path(), 0).unwrap(),
            open_arm: Box::new(move || {
                // The simulated board lives as long as this factory does.
                let _board = &simulated;
                Ok(Box::new(RigprotoArm::open(settings.clone())?))
            }),
            open_camera: Box::new(move |_| {
                let simulation = rig.simulation.as_ref().unwrap();
                let camera = SimulatedCamera::new(&rig, simulation, pose.clone(), faults.clone());
                Ok(Box::new(camera.lit_by(lamp.clone()).in_room(room)))
            }),
            remedies: Vec::new(),
            processing: Box::new(PipelineProcessing::new(&self.rig)),
            speed: SPEED,
        })
        .unwrap()
    }

    pub fn directory(&self, id: &str) -> PathBuf {
        self.data.path().join("sessions").join(id)
    }

    /// Shots under the lamp so far.
    pub fn shots(&self) -> usize {
        self.burnt.lock().unwrap().len()
    }
}

/// Waits for something that must come true within ten minutes: fits take their time.
pub fn until(what: &str, mut true_now: impl FnMut() -> bool) {
    let end = Instant::now() + Duration::from_secs(600);
    while !true_now() {
        assert!(Instant::now() < end, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits for the end of a session, which must be this.
pub fn wait_for(engine: &EngineHandle, id: &str, state: SessionState) -> SessionSnapshot {
    until("the session's end", || engine.session(id).unwrap().state.is_final());
    let end = engine.session(id).unwrap();
    assert_eq!(end.state, state, "{:?}", end.reason);
    end
}

pub fn events(engine: &EngineHandle, id: &str, kind: &str) -> Vec<Value> {
    engine.events_after(id, 0).unwrap().into_iter().filter(|event| event["type"] == kind).collect()
}

/// Intensities of the lights of a session's dataset.
pub fn intensities(directory: &Path) -> Vec<[f64; 3]> {
    let text = std::fs::read_to_string(directory.join("dataset.toml")).unwrap();
    let table: toml::Table = text.parse().unwrap();
    let lights = table["light"].as_array().unwrap();
    let numbers = |light: &toml::Value| -> Vec<f64> {
        light["intensity"].as_array().unwrap().iter().map(|x| x.as_float().unwrap()).collect()
    };
    lights.iter().map(|light| numbers(light).try_into().unwrap()).collect()
}
