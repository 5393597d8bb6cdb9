//! The settle time measured by the engine: an arm that swings by the clock, the simulated camera before it, the real pipeline; then the
//! real binary over REST and on the terminal.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod daemon;

use daemon::Daemon;
use rig_config::Rig;
use rigd::devices::Cancel;
use rigd::devices::arm::{Arm, ArmError, ArmIdentity, ArmStatus};
use rigd::session::engine::{EngineParts, start};
use rigd::session::handle::{CalibrationRequest, CalibrationSnapshot, EngineHandle, Kind, SettleFile, Step};
use rigd::session::plan::StartRequest;
use rigd::session::processing::PipelineProcessing;
use rigd::session::state::SessionState as S;
use rigd::sim::camera::{CameraFaults, SimulatedCamera};
use rigd::sim::pose::{Pose, SharedPose, Swing};
use rigd::sim::ringing::Ringing;
use rigd::store::Store;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const SPEED: f64 = 10.0;
/// What the arm reports is not quite what it was asked for.
const OFF_DEG: f64 = 0.013;

/// Is there at once, and swings from that moment on.
struct SwingingArm {
    pose: SharedPose,
    ringing: Option<Ringing>,
    at_deg: f64,
    lamp_permille: u16,
}

impl SwingingArm {
    fn now(&self) -> ArmStatus {
        let (angle_deg, lamp_permille) = (self.at_deg, self.lamp_permille);
        ArmStatus { angle_deg, homed: true, moving: false, lamp_permille, faults: 0 }
    }

    fn pose(&self) -> Pose {
        Pose { angle_deg: self.at_deg, lamp_permille: self.lamp_permille }
    }
}

impl Arm for SwingingArm {
    fn identity(&self) -> ArmIdentity {
        ArmIdentity { firmware: "swinging".into(), boot_nonce: 1 }
    }
    fn home(&mut self, _: &Cancel) -> Result<ArmStatus, ArmError> {
        Ok(self.now())
    }
    fn move_to(&mut self, angle_deg: f64, _: &Cancel) -> Result<ArmStatus, ArmError> {
        let length = (angle_deg - self.at_deg).abs();
        self.at_deg = angle_deg + OFF_DEG;
        match self.ringing {
            None => self.pose.set(self.pose()),
            Some(ringing) => {
                let ringing = ringing.scaled(if length > 10.0 { 1.0 } else { 1.0 / 3.0 });
                self.pose.set_swinging(self.pose(), Swing { ringing, stopped: Instant::now(), speed: SPEED });
            }
        }
        Ok(self.now())
    }
    fn set_lamp(&mut self, permille: u16) -> Result<ArmStatus, ArmError> {
        self.lamp_permille = permille;
        self.pose.set(self.pose());
        Ok(self.now())
    }
    fn status(&mut self) -> Result<ArmStatus, ArmError> {
        Ok(self.now())
    }
    fn stop(&mut self) -> Result<ArmStatus, ArmError> {
        Ok(self.now())
    }
}

/// The shipped simulated rig, in which [`SwingingArm`] stands for the arm.
fn engine(data: &Path, ringing: Option<Ringing>) -> EngineHandle {
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap();
    let rig = Rig::from_toml(text, "simulated").unwrap();
    let (pose, camera_rig) = (SharedPose::default(), rig.clone());
    let mut simulation = rig.simulation.clone().unwrap();
    simulation.speed = SPEED;
    let camera_pose = pose.clone();
    start(EngineParts {
        processing: Box::new(PipelineProcessing::new(&rig)),
        rig,
        rig_text: (*text).into(),
        store: Store::open(data, 0).unwrap(),
        open_arm: Box::new(move || {
            Ok(Box::new(SwingingArm { pose: pose.clone(), ringing, at_deg: 0.0, lamp_permille: 0 }) as Box<dyn Arm>)
        }),
        open_camera: Box::new(move |_| {
            let faults = CameraFaults::default();
            Ok(Box::new(SimulatedCamera::new(&camera_rig, &simulation, camera_pose.clone(), faults)))
        }),
        remedies: Vec::new(),
        speed: SPEED,
    })
    .unwrap()
}

fn measure(engine: &EngineHandle, exposure: Option<&str>) -> CalibrationSnapshot {
    let request = CalibrationRequest { name: None, kind: Kind::Settle, exposure: exposure.map(str::to_owned) };
    let id = engine.start_calibration(&request).unwrap().id;
    let end = Instant::now() + Duration::from_secs(300);
    loop {
        let now = engine.calibration(&id).unwrap();
        assert_ne!(now.state, S::Awaiting, "nobody is there");
        if now.state.is_final() {
            return now;
        }
        assert!(Instant::now() < end, "waited in vain: {now:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn frames(engine: &EngineHandle, id: &str) -> Vec<Value> {
    engine.frames(id).unwrap()
}

#[test]
fn a_swinging_arm_is_measured_and_sessions_are_told() {
    let (data, truth) =
        (tempfile::tempdir().unwrap(), Ringing { amplitude_deg: 1.5, frequency_hz: 0.9, decay_s: 0.35 });
    let engine = engine(data.path(), Some(truth));
    let done = measure(&engine, None);
    assert_eq!(
        (done.state, done.kind, done.step, done.frames_committed),
        (S::Completed, Kind::Settle, Step::Done, 119)
    );
    let file: SettleFile = serde_json::from_value(engine.calibration_result(&done.id).unwrap().unwrap()).unwrap();
    let report = &file.report;
    println!("{:.3} s -{:.3}, {:?}", report.settle_s, report.uncertainty_s, report.moves);
    assert_eq!((file.exposure.as_str(), file.station_deg, file.rig_settle_s), ("1/4", -20.0, 0.5));
    assert_eq!(report.moves.iter().map(|of| of.move_deg).collect::<Vec<_>>(), [35.0, 2.0]);
    assert_eq!(report.table.len(), 16 * 7);

    // When the envelope falls below what can be seen. The swing shows in full once in half an oscillation; the picture is of a time
    // later than its request by what the simulated camera dawdles, which the report bounds, and spans its exposure.
    let end_s = |part: f64| truth.decay_s * (truth.amplitude_deg / (part * report.smallest_seen_deg)).ln();
    let (early, late) = (end_s(1.5) - 0.5 / truth.frequency_hz, end_s(0.6));
    assert!(report.settle_s < late + report.uncertainty_s, "{} s after {late} s", report.settle_s);
    assert!(report.settle_s > early - 0.25 - report.shutter_lag_at_most_s, "{} s before {early} s", report.settle_s);

    // Every frame has where the arm reported to stand, and when it was asked for; bursts are staggered.
    let all = frames(&engine, &done.id);
    for frame in &all {
        let target = if frame["station"] == 0 { -22.0 } else { -20.0 };
        assert_eq!(frame["angle_deg"], json!(target + OFF_DEG), "{frame}");
        assert!(frame["since_rest_s"][0].as_f64().unwrap() < frame["since_rest_s"][1].as_f64().unwrap());
    }
    let asked = |station: usize, exposure: usize| {
        let frame = all.iter().find(|f| f["station"] == station && f["exposure"] == exposure).unwrap();
        frame["since_rest_s"][0].as_f64().unwrap()
    };
    let period = (1..7).map(|i| asked(0, i) - asked(0, i - 1)).fold(f64::INFINITY, f64::min);
    for station in 1..17 {
        let delay = ((station - 1) % 8) as f64 / 8.0 * period;
        assert!(asked(station, 0) >= delay, "burst {station}: {} s, {delay} s at least", asked(station, 0));
    }

    // The rig file waits half a second, which is too short; lights and camera are still the rig file's.
    let plan = engine.plan(&StartRequest::default()).unwrap();
    assert!(plan.calibration.is_none());
    let [warning] = plan.warnings.as_slice() else { panic!("{:?}", plan.warnings) };
    assert!(warning.contains("arm.settle_s is 0.5 s") && warning.contains("calibration 1 of"), "{warning}");
    let named = StartRequest { calibration: Some(done.id.clone()), ..StartRequest::default() };
    assert!(engine.plan(&named).unwrap_err().to_string().contains("measured a settle time only"));
    engine.shutdown().unwrap();
}

#[test]
fn an_arm_at_rest_needs_no_warning_and_what_is_dark_is_refused() {
    let data = tempfile::tempdir().unwrap();
    let engine = engine(data.path(), None);
    let done = measure(&engine, Some("0.4"));
    assert_eq!(done.state, S::Completed, "{:?}", done.reason);
    let file: SettleFile = serde_json::from_value(engine.calibration_result(&done.id).unwrap().unwrap()).unwrap();
    assert!(file.report.moves.iter().all(|of| of.last_above_s.is_none()), "{:?}", file.report.moves);
    assert_eq!(file.report.uncertainty_s, file.report.settle_s);

    let dark = measure(&engine, Some("1/4000"));
    assert_eq!(dark.state, S::Failed);
    assert!(dark.reason.as_ref().unwrap().contains("no light on the object at -20 degrees"), "{:?}", dark.reason);
    assert!(engine.calibration_result(&dark.id).unwrap().is_none());
    let refusal = |request| engine.start_calibration(&request).unwrap_err().to_string();
    let odd = CalibrationRequest { kind: Kind::Settle, exposure: Some("1/3.7".into()), ..Default::default() };
    assert!(refusal(odd).contains("exposure: "));
    let of_rig = CalibrationRequest { exposure: Some("1/4".into()), ..Default::default() };
    assert!(refusal(of_rig).contains("no meaning for kind `rig`"));
    engine.shutdown().unwrap();
}

#[test]
fn the_terminal_measures_it_on_a_daemon_whose_arm_rings() {
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let daemon = Daemon::start_with(folder, &text.replace("seed = 1\n", "seed = 1\nringing = true\n"), &data);
    let said = Command::new(env!("CARGO_BIN_EXE_rigd")).args(["calibrate", "settle", "--url", &daemon.url()]).output();
    let said = said.unwrap();
    let out = String::from_utf8(said.stdout).unwrap();
    assert!(said.status.success(), "{out}\n{}", String::from_utf8_lossy(&said.stderr));
    println!("{out}");
    assert!(out.contains("calibration 1 (") && out.contains("119 frames"), "{out}");
    assert!(out.contains("\nsettle time ") && out.contains("arm.settle_s = "), "{out}");
    let runs = daemon.get("/v1/calibrations").json();
    let run = &runs["calibrations"][0];
    assert_eq!(
        (&run["kind"], &run["state"], &run["steps_accepted"]),
        (&json!("settle"), &json!("completed"), &json!(1))
    );
    let result = daemon.get(&format!("/v1/calibrations/{}/result", run["id"].as_str().unwrap())).json();
    assert_eq!(result["report"]["table"].as_array().unwrap().len(), 112);
}
