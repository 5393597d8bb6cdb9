//! The simulated stage in this process: an engine with the real pipeline, an arm without a motor, and a camera whose pictures a test may
//! spoil.
#![allow(dead_code, missing_docs, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rig_config::Rig;
use rigd::devices::Cancel;
use rigd::devices::arm::{Arm, ArmError, ArmIdentity, ArmStatus};
use rigd::devices::camera::{Camera, CameraError, CameraIdentity, RawFrame, Shot};
use rigd::numerics::image::Image;
use rigd::pipeline::decode::decode;
use rigd::session::engine::{EngineParts, start};
use rigd::session::handle::{CalibrationSnapshot, EngineHandle, Step};
use rigd::session::processing::PipelineProcessing;
use rigd::session::state::SessionState as S;
use rigd::sim::camera::{CameraFaults, SimulatedCamera};
use rigd::sim::pose::{Pose, SharedPose};
use rigd::sim::stage::{Placed, StageHandle};
use rigd::store::Store;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// The shipped rig with fewer views of the board, exposures and stations, so that the test is short.
pub fn text() -> String {
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated-calibration").unwrap();
    let mut text = (*text).to_owned();
    for (from, to) in [
        ("board_views = 12", "board_views = 8"),
        (
            r#"["1/100", "1/40", "1/20", "1/8", "1/4", "0.6", "1.3", "3.2", "6", "15"]"#,
            r#"["1/60", "1/15", "1/4", "1", "4"]"#,
        ),
    ] {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    text
}

/// An arm without a motor: it is where it is told to be.
struct Mover(SharedPose);

impl Mover {
    fn set(&self, change: impl FnOnce(&mut Pose)) -> Result<ArmStatus, ArmError> {
        let mut pose = self.0.get();
        change(&mut pose);
        self.0.set(pose);
        let Pose { angle_deg, lamp_permille } = pose;
        Ok(ArmStatus { angle_deg, homed: true, moving: false, lamp_permille, faults: 0 })
    }
}

impl Arm for Mover {
    fn identity(&self) -> ArmIdentity {
        ArmIdentity { firmware: "mover 1".into(), boot_nonce: 1 }
    }
    fn home(&mut self, _: &Cancel) -> Result<ArmStatus, ArmError> {
        self.set(|pose| pose.angle_deg = 0.0)
    }
    fn move_to(&mut self, angle_deg: f64, _: &Cancel) -> Result<ArmStatus, ArmError> {
        self.set(|pose| pose.angle_deg = angle_deg)
    }
    fn set_lamp(&mut self, permille: u16) -> Result<ArmStatus, ArmError> {
        self.set(|pose| pose.lamp_permille = permille)
    }
    fn status(&mut self) -> Result<ArmStatus, ArmError> {
        self.set(|_| {})
    }
    fn stop(&mut self) -> Result<ArmStatus, ArmError> {
        self.set(|_| {})
    }
}

pub fn engine(text: &str, data: &Path, stage: &StageHandle) -> (Rig, EngineHandle) {
    spoiled_engine(text, data, stage, &Spoil::default())
}

/// The same with a camera whose frames `spoil` changes.
pub fn spoiled_engine(text: &str, data: &Path, stage: &StageHandle, spoil: &Spoil) -> (Rig, EngineHandle) {
    let mut rig = Rig::from_toml(text, "test").unwrap();
    let mut simulation = rig.simulation.clone().unwrap();
    simulation.speed = f64::INFINITY;
    rig.simulation = Some(simulation.clone());
    let (pose, stage, spoil) = (SharedPose::default(), stage.clone(), spoil.clone());
    let (arms, of_camera, sight) = (pose.clone(), rig.clone(), pose);
    let parts = EngineParts {
        rig: rig.clone(),
        rig_text: text.to_owned(),
        store: Store::open(data, 1 << 20).unwrap(),
        open_arm: Box::new(move || Ok(Box::new(Mover(arms.clone())))),
        open_camera: Box::new(move |_| {
            let camera = SimulatedCamera::new(&of_camera, &simulation, sight.clone(), CameraFaults::default());
            Ok(Box::new(Spoiled { camera: camera.before(stage.clone()), spoil: spoil.clone() }))
        }),
        remedies: Vec::new(),
        processing: Box::new(PipelineProcessing::new(&rig)),
        speed: 1e6,
    };
    (rig, start(parts).unwrap())
}

type Change = Box<dyn FnMut(&Shot, RawFrame) -> RawFrame + Send>;

/// What happens to every frame on its way; nothing by default.
#[derive(Clone, Default)]
pub struct Spoil(Arc<Mutex<Option<Change>>>);

impl Spoil {
    pub fn frames(&self, change: impl FnMut(&Shot, RawFrame) -> RawFrame + Send + 'static) {
        *self.0.lock().unwrap() = Some(Box::new(change));
    }

    /// The pictures change, the file stays one of the camera's.
    pub fn pictures(&self, mut change: impl FnMut(&Shot, &mut Image<[u8; 3]>) + Send + 'static) {
        self.frames(move |shot, frame| {
            let mut picture = decode(&frame.bytes).unwrap();
            change(shot, &mut picture);
            RawFrame { bytes: encoded(&picture, &frame.bytes), ..frame }
        });
    }

    pub fn nothing(&self) {
        *self.0.lock().unwrap() = None;
    }
}

/// A picture with the EXIF of another file.
fn encoded(picture: &Image<[u8; 3]>, of: &[u8]) -> Vec<u8> {
    let exif = exif::get_exif_attr_from_jpeg(&mut std::io::Cursor::new(of)).unwrap();
    let mut bytes = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut bytes, 99);
    encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::F_1_1);
    encoder.add_exif_metadata(&exif).unwrap();
    let (width, height) = (picture.width.try_into().unwrap(), picture.height.try_into().unwrap());
    encoder.encode(picture.pixels.as_flattened(), width, height, jpeg_encoder::ColorType::Rgb).unwrap();
    bytes
}

struct Spoiled<C> {
    camera: C,
    spoil: Spoil,
}

impl<C: Camera> Camera for Spoiled<C> {
    fn identity(&self) -> CameraIdentity {
        self.camera.identity()
    }
    fn shoot(&mut self, shot: &Shot, cancel: &Cancel) -> Result<RawFrame, CameraError> {
        let frame = self.camera.shoot(shot, cancel)?;
        let mut change = self.spoil.0.lock().unwrap();
        Ok(match change.as_mut() {
            Some(change) => change(shot, frame),
            None => frame,
        })
    }
}

/// What the operator puts there for a step.
pub fn placed(step: Step) -> Placed {
    match step {
        Step::Board { view, .. } => Placed::Board { view: view - 1 },
        Step::Card => Placed::Card { on: 7 },
        Step::Balls => Placed::Balls,
        Step::Settle | Step::Done => Placed::Sample,
    }
}

pub fn until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + Duration::from_secs(600);
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < end, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Waits for the operator's next turn, or the end.
pub fn turn(engine: &EngineHandle, id: &str) -> CalibrationSnapshot {
    until("the operator's turn", || {
        let now = engine.calibration(id).unwrap();
        (now.state == S::Awaiting || now.state.is_final()).then_some(now)
    })
}
