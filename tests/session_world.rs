//! Sessions on the simulated world with faults: the production arm driver over real bytes, and the simulated camera. Every frame
//! that counts in the end is compared with one taken under exactly the planned light.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rig_config::{Rig, Shutter};
use rigd::devices::Cancel;
use rigd::devices::camera::{Camera, Shot};
use rigd::devices::rigproto::{RigprotoArm, RigprotoSettings};
use rigd::numerics::image::Image;
use rigd::pipeline::decode::decode;
use rigd::pipeline::fit::OnProgress;
use rigd::session::adaptive::Weighed;
use rigd::session::engine::{EngineParts, start};
use rigd::session::handle::{EngineHandle, SessionSnapshot};
use rigd::session::plan::StartRequest;
use rigd::session::processing::{Bracket, FitJob, Judged, Next, OpenBracket, Processing, StepJob};
use rigd::session::state::{SessionState as S, Verb};
use rigd::sim::arm::{ArmConfig, ArmFaults, SimulatedArm};
use rigd::sim::camera::{CameraFaults, Fault, SimulatedCamera};
use rigd::sim::pose::{Pose, SharedPose};
use rigd::store::Store;
use serde_json::{Value, json};
use support::{events, until, wait_for};

const ANGLES_DEG: [f64; 5] = [-55.0, -20.0, 15.0, 50.0, 85.0];
const EXPOSURES: [&str; 4] = ["1/40", "1/8", "0.6", "3.2"];
/// Angle of rest, so that parking shows.
const PARK_DEG: f64 = -7.5;

/// The same picture with a quarter of the pixels.
fn small(mut rig: Rig) -> Rig {
    (rig.camera.width, rig.camera.height) = (144, 96);
    (rig.camera.focal_px, rig.camera.principal_px) = ([1650.0; 2], [72.0, 48.0]);
    rig
}

/// Frames are what is looked at here.
struct NoProcessing;

impl Processing for NoProcessing {
    fn least_exposures(&self) -> usize {
        1
    }

    fn develop(&mut self, _: &Bracket) -> Result<Value, String> {
        Ok(Value::Null)
    }
    fn meter(&mut self, _: &OpenBracket) -> Result<Next, String> {
        Err("no metering here".into())
    }
    fn weigh(&mut self, _: &FitJob, _: OnProgress<'_>) -> Result<Weighed, String> {
        Err("no fit here".into())
    }
    fn judge(&mut self, _: &StepJob) -> Result<Judged, String> {
        Err("no calibration here".into())
    }
    fn fit(&mut self, _: &FitJob, _: OnProgress<'_>) -> Result<Value, String> {
        Ok(json!({}))
    }
}

struct World {
    engine: EngineHandle,
    id: String,
    rig: Rig,
    pose: SharedPose,
    arm: ArmFaults,
    camera: CameraFaults,
    data: tempfile::TempDir,
}

impl World {
    /// Starts a session of 5 stations and 4 exposures on a small frame.
    fn start() -> Self {
        let (_, shipped) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap();
        let mut rig = small(Rig::from_toml(shipped, "simulated.toml").unwrap());
        rig.arm.park_deg = PARK_DEG;
        rig.simulation.as_mut().unwrap().speed = 100.0;

        let (data, pose, camera) = (tempfile::tempdir().unwrap(), SharedPose::default(), CameraFaults::default());
        let simulated = SimulatedArm::spawn(ArmConfig::from_rig(&rig, pose.clone())).unwrap();
        let arm = simulated.faults();
        // A name of its own, as under /dev/serial/by-id: the number of a PTY that is gone soon belongs to another.
        let port = data.path().join("arm");
        std::os::unix::fs::symlink(simulated.port(), &port).unwrap();
        let settings = RigprotoSettings::new(port, &rig.arm);
        let (camera_rig, camera_pose, camera_faults) = (rig.clone(), pose.clone(), camera.clone());
        let engine = start(EngineParts {
            rig: rig.clone(),
            rig_text: String::new(),
            store: Store::open(data.path(), 0).unwrap(),
            open_arm: Box::new(move || {
                // The simulated board lives as long as this factory does.
                let _board = &simulated;
                Ok(Box::new(RigprotoArm::open(settings.clone())?))
            }),
            open_camera: Box::new(move |_| {
                let simulation = camera_rig.simulation.as_ref().unwrap();
                let (pose, faults) = (camera_pose.clone(), camera_faults.clone());
                Ok(Box::new(SimulatedCamera::new(&camera_rig, simulation, pose, faults)))
            }),
            remedies: Vec::new(),
            processing: Box::new(NoProcessing),
            speed: 100.0,
        })
        .unwrap();
        let request = StartRequest {
            stations_deg: Some(ANGLES_DEG.to_vec()),
            exposures: Some(EXPOSURES.map(str::to_owned).to_vec()),
            ..StartRequest::default()
        };
        let id = engine.start(&request, None).unwrap().snapshot.id;
        Self { engine, id, rig, pose, arm, camera, data }
    }

    fn frames(&self, count: usize) {
        until(&format!("{count} frames"), || {
            let now = self.engine.session(&self.id).unwrap();
            assert!(!now.state.is_final(), "{:?}: {:?}", now.state, now.reason);
            now.frames_committed >= count
        });
    }

    fn reasons(&self, kind: &str) -> Vec<String> {
        events(&self.engine, &self.id, kind).iter().map(|e| e["reason"].as_str().unwrap().to_owned()).collect()
    }

    /// The session's end, with every journalled frame on disk as it was journalled and the rig at rest.
    fn end(&self, state: S) -> SessionSnapshot {
        let end = wait_for(&self.engine, &self.id, state);
        let folder = self.data.path().join("sessions").join(&self.id).join("frames");
        let journalled = events(&self.engine, &self.id, "frame.committed");
        for frame in &journalled {
            let bytes = std::fs::read(folder.join(frame["file"].as_str().unwrap())).unwrap();
            assert_eq!(frame["blake3"], blake3::hash(&bytes).to_hex().as_str());
        }
        assert_eq!(std::fs::read_dir(folder).unwrap().count(), journalled.len());
        end
    }

    fn assert_at_rest(&self) {
        let pose = self.pose.get();
        assert_eq!(pose.lamp_permille, 0, "the lamp is on");
        let off = (pose.angle_deg - PARK_DEG).abs();
        assert!(off <= self.rig.arm.tolerance_deg, "the arm is at {} degrees, not parked", pose.angle_deg);
    }

    /// Completed, with every frame of the plan taken at its angle under the lamp's planned level.
    fn completed(&self) {
        assert_eq!(self.end(S::Completed).frames_committed, 20);
        self.assert_at_rest();
        let mut simulation = self.rig.simulation.clone().unwrap();
        simulation.speed = f64::INFINITY;
        let pose = SharedPose::default();
        let mut camera = SimulatedCamera::new(&self.rig, &simulation, pose.clone(), CameraFaults::default());
        let folder = self.data.path().join("sessions").join(&self.id).join("frames");
        for frame in self.engine.frames(&self.id).unwrap().iter().filter(|f| f["state"] == "committed") {
            let number = |key: &str| usize::try_from(frame[key].as_u64().unwrap()).unwrap();
            let (station, exposure) = (number("station"), number("exposure"));
            pose.set(Pose { angle_deg: ANGLES_DEG[station], lamp_permille: self.rig.lamp.level_permille });
            let shutter = Shutter::from_label(EXPOSURES[exposure]).unwrap();
            let shot =
                Shot { station, exposure, shutter, f_number: self.rig.camera.f_number, iso: self.rig.camera.iso };
            let expected = decode(&camera.shoot(&shot, &Cancel::default()).unwrap().bytes).unwrap();
            let found = decode(&std::fs::read(folder.join(frame["file"].as_str().unwrap())).unwrap()).unwrap();
            let off = mean_difference(&found, &expected);
            assert!(off < 1.5, "{frame}: {off} levels off a frame under the planned light");
        }
    }
}

fn mean_difference(a: &Image<[u8; 3]>, b: &Image<[u8; 3]>) -> f64 {
    assert_eq!(a.pixels.len(), b.pixels.len());
    let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    pairs.map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / (3 * a.pixels.len()) as f64
}

/// A wrong light shows: five degrees or an eighth of the lamp do more than noise does.
#[test]
fn the_comparison_sees_a_light_that_is_wrong_and_not_the_noise() {
    let (_, shipped) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap();
    let rig = small(Rig::from_toml(shipped, "simulated.toml").unwrap());
    let mut simulation = rig.simulation.clone().unwrap();
    simulation.speed = f64::INFINITY;
    let pose = SharedPose::default();
    let mut camera = SimulatedCamera::new(&rig, &simulation, pose.clone(), CameraFaults::default());
    let mut picture = |angle_deg, lamp_permille| {
        pose.set(Pose { angle_deg, lamp_permille });
        let shutter = Shutter::from_label("0.6").unwrap();
        let shot = Shot { station: 0, exposure: 0, shutter, f_number: rig.camera.f_number, iso: rig.camera.iso };
        decode(&camera.shoot(&shot, &Cancel::default()).unwrap().bytes).unwrap()
    };
    let reference = picture(15.0, 800);
    assert!(mean_difference(&reference, &picture(15.0, 800)) < 1.0);
    assert!(mean_difference(&reference, &picture(20.0, 800)) > 2.0);
    assert!(mean_difference(&reference, &picture(15.0, 700)) > 2.0);
}

#[test]
fn noise_and_lost_and_garbled_answers_do_not_disturb_a_session() {
    let world = World::start();
    world.frames(2);
    world.arm.noise(400);
    world.arm.drop_answers(2);
    world.frames(6);
    world.arm.garble_answers(2);
    world.frames(9);
    world.arm.noise(40);
    world.arm.garble_answers(1);
    world.completed();
    assert_eq!(world.reasons("fault.raised"), [""; 0]);
}

#[test]
fn a_board_that_reboots_twice_is_homed_and_lit_again_and_its_stations_are_shot_again() {
    let world = World::start();
    world.frames(3);
    world.arm.reboot();
    until("the first recovery", || !events(&world.engine, &world.id, "fault.cleared").is_empty());
    world.frames(10);
    world.arm.reboot();
    world.completed();
    let reasons = world.reasons("fault.raised");
    assert!(reasons.len() == 2 && reasons.iter().all(|reason| reason.contains("rebooted")), "{reasons:?}");
}

#[test]
fn a_board_that_hangs_past_its_dead_man_and_comes_back_is_recovered() {
    let world = World::start();
    world.frames(6);
    world.arm.freeze(true);
    until("the silence to be noticed", || !events(&world.engine, &world.id, "fault.raised").is_empty());
    world.arm.freeze(false);
    world.completed();
}

#[test]
fn an_unplugged_arm_interrupts_the_session_in_words_and_its_lamp_goes_off_by_itself() {
    let world = World::start();
    world.frames(4);
    std::fs::remove_file(world.data.path().join("arm")).unwrap();
    world.arm.unplug();
    let end = world.end(S::Interrupted);
    let reason = end.reason.unwrap();
    assert!(
        reason.contains("the arm did not come back within 26 s") && reason.contains("switch the lamp's supply off"),
        "{reason}"
    );
    until("the dead-man", || world.pose.get().lamp_permille == 0);
}

#[test]
fn bad_frames_are_retaken_for_their_reasons() {
    let world = World::start();
    world.frames(2);
    world.camera.inject(Fault::WrongExposure);
    world.camera.inject(Fault::RepeatLastFrame);
    until("two refusals", || events(&world.engine, &world.id, "frame.rejected").len() == 2);
    world.frames(8);
    world.camera.inject(Fault::TruncatedFile);
    world.completed();
    let reasons = world.reasons("frame.rejected");
    let expected = ["the body ignored the shutter speed", "the last frame again", "cut off"];
    assert_eq!(reasons.len(), 3, "{reasons:?}");
    for (reason, part) in reasons.iter().zip(expected) {
        assert!(reason.contains(part), "{reason}: not {part}");
    }
}

#[test]
fn a_body_that_keeps_cutting_files_off_interrupts_the_session_with_the_lamp_off() {
    let world = World::start();
    world.frames(5);
    (0..3).for_each(|_| world.camera.inject(Fault::TruncatedFile));
    let reason = world.end(S::Interrupted).reason.unwrap();
    assert!(reason.contains("refused 3 times") && reason.contains("cut off"), "{reason}");
    world.assert_at_rest();
}

#[test]
fn an_abort_does_not_wait_for_a_camera_that_hangs() {
    let world = World::start();
    world.frames(3);
    world.camera.inject(Fault::Hang);
    world.frames(3);
    world.engine.command(&world.id, Verb::Abort).unwrap();
    let reason = world.end(S::Aborted).reason;
    world.assert_at_rest();
    world.camera.release();
    assert!(reason.is_none_or(|reason| reason.contains("switch the camera off and on")));
}

#[test]
fn pictures_that_do_not_show_what_their_exif_says_are_retaken() {
    let world = World::start();
    world.frames(6);
    world.camera.inject(Fault::StalePicture);
    world.camera.inject(Fault::GreyBelow(500));
    world.completed();
    let reasons = world.reasons("frame.rejected");
    assert_eq!(reasons.len(), 2, "{reasons:?}");
    assert!(
        reasons[0].contains("it has the pixels of station") && reasons[1].contains("rows are one grey"),
        "{reasons:?}"
    );
    let end = world.engine.session(&world.id).unwrap();
    assert!(end.refused == 2 && end.last_refusal.unwrap().contains("one grey"));
}

#[test]
fn a_bracket_under_two_lamps_is_shot_again_whole() {
    let world = World::start();
    world.frames(9);
    (0..3).for_each(|_| world.camera.inject(Fault::LampAt(600)));
    world.completed();
    let brackets = world.reasons("bracket.rejected");
    assert_eq!(brackets.len(), 1, "{brackets:?}");
    assert!(brackets[0].contains("times was expected"), "{brackets:?}");
}

#[test]
fn a_lamp_that_burns_out_interrupts_the_session_and_says_so() {
    let world = World::start();
    world.frames(9);
    (0..60).for_each(|_| world.camera.inject(Fault::LampAt(0)));
    let reason = world.end(S::Interrupted).reason.unwrap();
    assert!(reason.starts_with("the lamp is out: replace it") && reason.contains("black again"), "{reason}");
    assert_eq!(world.reasons("frame.rejected").len(), 2);
    world.assert_at_rest();
}

#[test]
fn a_slip_of_the_arm_is_seen_by_the_light_and_the_station_is_shot_again() {
    let world = World::start();
    world.frames(12);
    world.arm.lose_steps(9.0);
    world.completed();
    let raised = world.reasons("fault.raised");
    assert!(raised.len() == 1 && raised[0].contains("by the pictures"), "{raised:?}");
    let refused = events(&world.engine, &world.id, "bracket.rejected");
    assert!(!refused.is_empty() && refused.iter().all(|bracket| bracket["station"] == 3), "{refused:?}");
}

#[test]
fn a_slip_that_homing_does_not_mend_interrupts_the_session_and_its_bracket_does_not_count() {
    let world = World::start();
    world.frames(12);
    world.arm.slip_on_shaft(-12.0);
    let end = world.end(S::Interrupted);
    let reason = end.reason.unwrap();
    assert!(
        reason.contains("homing does not mend it: tighten the lamp") && reason.contains("by the pictures"),
        "{reason}"
    );
    assert_eq!(end.frames_committed, 12, "{reason}");
    assert_eq!(world.pose.get().lamp_permille, 0);
}
