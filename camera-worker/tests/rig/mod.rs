//! The daemon's engine with its production drivers before simulated hardware.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, dead_code, reason = "each test file uses its part")]

#[path = "../support/usb.rs"]
mod usb;

use rig_config::Rig;
use rigd::devices::gphoto2::{Gphoto2Camera, Gphoto2Settings, KnownBody, WorkerCommand};
use rigd::devices::rigproto::{RigprotoArm, RigprotoSettings};
use rigd::session::engine::{EngineParts, start};
use rigd::session::handle::{EngineHandle, SessionSnapshot};
use rigd::session::plan::StartRequest;
use rigd::session::processing::{PipelineProcessing, Processing};
use rigd::sim::arm::{ArmConfig, ArmFaults, SimulatedArm};
use rigd::sim::camera::{CameraFaults, SimulatedCamera};
use rigd::sim::eos::EosSensor;
use rigd::sim::pose::SharedPose;
use rigd::store::Store;
use serde_json::Value;
use simulated_eos::{Body, BodyOptions, Faults, Server};
use std::path::PathBuf;
use std::time::{Duration, Instant};
use tempfile::TempDir;
pub use usb::Usb;

/// How many times faster than real everything passes, unless a test says otherwise.
pub const SPEED: f64 = 40.0;
/// Bound on every wait: only a hang meets it.
const PATIENCE: Duration = Duration::from_secs(900);

/// What the camera is connected by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cable {
    PtpIp,
    Usb,
}

enum Link {
    PtpIp(Server),
    Usb(Usb),
}

/// A rig, running.
pub struct Rigged {
    pub engine: EngineHandle,
    /// With the simulation the engine does not know of.
    pub truth: Rig,
    pub pose: SharedPose,
    pub arm: ArmFaults,
    pub camera: Faults,
    data: TempDir,
    link: Link,
}

impl Rigged {
    /// The shipped simulated rig, developed and fitted.
    pub fn whole(speed: f64) -> Self {
        let mut truth = shipped();
        truth.simulation.as_mut().unwrap().speed = speed;
        let processing = Box::new(PipelineProcessing::new(&truth));
        Self::new(truth, processing, Cable::PtpIp)
    }

    pub fn new(truth: Rig, processing: Box<dyn Processing>, cable: Cable) -> Self {
        let (data, pose) = (tempfile::tempdir().unwrap(), SharedPose::default());
        let simulation = truth.simulation.clone().unwrap();
        let simulated = SimulatedArm::spawn(ArmConfig::from_rig(&truth, pose.clone())).unwrap();
        let arm = simulated.faults();
        // A name of its own, as under /dev/serial/by-id: the number of a PTY that is gone soon belongs to another.
        let port = data.path().join("arm");
        std::os::unix::fs::symlink(simulated.port(), &port).unwrap();
        let settings = RigprotoSettings::new(port, &truth.arm);

        let sensor = EosSensor::new(SimulatedCamera::new(&truth, &simulation, pose.clone(), CameraFaults::default()));
        let options = BodyOptions { speed: simulation.speed, ..BodyOptions::default() };
        let link = Link::new(Body::new(Box::new(sensor), options).unwrap(), cable);
        let camera = link.settings(data.path().join("camera-home"));
        let faults = link.faults();
        let parts = EngineParts {
            rig: truth.clone(),
            rig_text: String::new(),
            store: Store::open(&data.path().join("data"), 0).unwrap(),
            open_arm: Box::new(move || {
                // The simulated board lives as long as this factory does.
                let _board = &simulated;
                Ok(Box::new(RigprotoArm::open(settings.clone())?))
            }),
            open_camera: Box::new(move |cancel| Ok(Box::new(Gphoto2Camera::open(camera.clone(), cancel)?))),
            remedies: Vec::new(),
            processing,
            speed: simulation.speed,
        };
        Self { engine: start(parts).unwrap(), truth, pose, arm, camera: faults, data, link }
    }

    /// Starts a session and waits for its end.
    pub fn run(&self, request: &StartRequest) -> SessionSnapshot {
        let id = self.engine.start(request, None).unwrap().snapshot.id;
        self.ended(&id)
    }

    pub fn ended(&self, id: &str) -> SessionSnapshot {
        let begin = Instant::now();
        loop {
            let now = self.engine.session(id).unwrap();
            if now.state.is_final() {
                return now;
            }
            assert!(begin.elapsed() < PATIENCE, "{now:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// The USB bus that the camera is on.
    pub fn usb(&self) -> &Usb {
        match &self.link {
            Link::Usb(usb) => usb,
            Link::PtpIp(_) => panic!("the camera is not on USB"),
        }
    }

    /// Pulls the arm's cable: its name goes with it, before the number of its PTY can be another session's.
    pub fn unplug_arm(&self) {
        std::fs::remove_file(self.data.path().join("arm")).unwrap();
        self.arm.unplug();
    }

    pub fn directory(&self, id: &str) -> PathBuf {
        self.data.path().join("data").join("sessions").join(id)
    }

    /// Journal lines of a kind.
    pub fn events(&self, id: &str, kind: &str) -> Vec<Value> {
        let text = std::fs::read_to_string(self.directory(id).join("journal.jsonl")).unwrap();
        let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        lines.filter(|line| line["type"] == kind).collect()
    }
}

impl Link {
    fn new(body: Body, cable: Cable) -> Self {
        match cable {
            Cable::PtpIp => Self::PtpIp(Server::start(body, 0).unwrap()),
            Cable::Usb => Self::Usb(Usb::new(vec![body])),
        }
    }

    fn faults(&self) -> Faults {
        match self {
            Self::PtpIp(server) => server.faults(),
            Self::Usb(usb) => usb.faults(),
        }
    }

    fn settings(&self, home: PathBuf) -> Gphoto2Settings {
        match self {
            Self::PtpIp(server) => settings(home, Vec::new(), server.gphoto2_port()),
            Self::Usb(usb) => settings(home, usb.environment(), usb.port()),
        }
    }
}

/// The production driver with this worker's home and environment, for the camera at a port.
pub fn settings(home: PathBuf, environment: Vec<(String, String)>, port: String) -> Gphoto2Settings {
    let worker = WorkerCommand { program: env!("CARGO_BIN_EXE_camera-worker").into(), home, environment };
    Gphoto2Settings { worker, model: None, port: Some(port), body: KnownBody::default() }
}

/// The shipped simulated rig.
pub fn shipped() -> Rig {
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap();
    let mut rig = Rig::from_toml(text, "simulated.toml").unwrap();
    rig.simulation.as_mut().unwrap().speed = SPEED;
    rig
}
