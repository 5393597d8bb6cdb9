//! The daemon killed and ended at moments it does not choose. Its arm runs in the test, behind a PTY, so that the test sees what the
//! lamp and the arm truly do when nobody drives them any more.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod daemon;

use daemon::{Daemon, shipped};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rig_config::Rig;
use rigd::devices::Cancel;
use rigd::devices::camera::{Camera, Shot};
use rigd::sim::arm::{ArmConfig, SimulatedArm};
use rigd::sim::camera::{CameraFaults, SimulatedCamera};
use rigd::sim::pose::{Pose, SharedPose};
use rigd::store::journal;
use serde_json::Value;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::{Duration, Instant};

/// Seed of the moments at which the daemon is killed.
const SEED: u64 = 20_261_123;
const ANGLES_DEG: [f64; 3] = [-30.0, 10.0, 50.0];
const EXPOSURES: [&str; 3] = ["1/40", "1/8", "0.6"];
const PARK_DEG: f64 = -7.5;

/// A simulated arm of this process, a folder of frames for the replay camera, and the rig file that names both.
struct Rigged {
    pose: SharedPose,
    config: String,
    folder: tempfile::TempDir,
    /// Takes the frames of the folder, anew before every start of the daemon: each picture has its own noise.
    camera: RefCell<SimulatedCamera>,
    camera_pose: SharedPose,
    rig: Rig,
    _arm: SimulatedArm,
}

impl Rigged {
    fn new(soak_s: f64) -> Self {
        let rig = Rig::from_toml(shipped(), "simulated.toml").unwrap();
        let (folder, pose) = (tempfile::tempdir().unwrap(), SharedPose::default());
        let arm = SimulatedArm::spawn(ArmConfig::from_rig(&rig, pose.clone())).unwrap();
        let frames = folder.path().join("frames");
        std::fs::create_dir(&frames).unwrap();
        let mut simulation = rig.simulation.clone().unwrap();
        simulation.speed = f64::INFINITY;
        let camera_pose = SharedPose::default();
        let camera = SimulatedCamera::new(&rig, &simulation, camera_pose.clone(), CameraFaults::default());
        let config = shipped()
            .split("[simulation]")
            .next()
            .unwrap()
            .replacen(
                "driver = \"simulated\"",
                &format!("driver = \"rigproto\"\nport = {:?}", arm.port().to_str().unwrap()),
                1,
            )
            .replacen(
                "driver = \"simulated\"",
                &format!("driver = \"replay\"\ndirectory = {:?}", frames.to_str().unwrap()),
                1,
            )
            .replace(
                "stations_deg = [-55.0, -20.0, 15.0, 50.0, 85.0, 115.0, 140.0]",
                &format!("stations_deg = {ANGLES_DEG:?}"),
            )
            .replace(
                r#"exposures = ["1/100", "1/40", "1/20", "1/8", "1/4", "0.6", "1.3", "3.2", "6", "15"]"#,
                &format!("exposures = {EXPOSURES:?}"),
            )
            .replace("park_deg = 0.0", &format!("park_deg = {PARK_DEG}"))
            .replace("settle_s = 0.5", "settle_s = 0.1")
            .replace("soak_s = 5.0", &format!("soak_s = {soak_s:.1}"));
        Self { pose, config, folder, camera: RefCell::new(camera), camera_pose, rig, _arm: arm }
    }

    fn data(&self) -> std::path::PathBuf {
        self.folder.path().join("data")
    }

    fn daemon(&self) -> Daemon {
        self.shoot();
        Daemon::start_with(tempfile::tempdir().unwrap(), &self.config, &self.data())
    }

    /// The plan's frames, as a camera of the same rig takes them.
    fn shoot(&self) {
        let mut camera = self.camera.borrow_mut();
        for (station, angle_deg) in ANGLES_DEG.into_iter().enumerate() {
            self.camera_pose.set(Pose { angle_deg, lamp_permille: self.rig.lamp.level_permille });
            for (exposure, label) in EXPOSURES.into_iter().enumerate() {
                let shutter = rig_config::Shutter::from_label(label).unwrap();
                let shot =
                    Shot { station, exposure, shutter, f_number: self.rig.camera.f_number, iso: self.rig.camera.iso };
                let frame = camera.shoot(&shot, &Cancel::default()).unwrap();
                std::fs::write(self.folder.path().join(format!("frames/{station}-{exposure}.jpg")), frame.bytes)
                    .unwrap();
            }
        }
    }

    fn assert_at_rest(&self, what: &str) {
        let Pose { angle_deg, lamp_permille } = self.pose.get();
        assert_eq!(lamp_permille, 0, "{what}: the lamp is on");
        assert!((angle_deg - PARK_DEG).abs() < 0.06, "{what}: the arm is at {angle_deg} degrees, not parked");
    }
}

fn until(what: &str, mut true_now: impl FnMut() -> bool) {
    let end = Instant::now() + Duration::from_secs(30);
    while !true_now() {
        assert!(Instant::now() < end, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn begin(daemon: &Daemon) -> String {
    let answer = daemon.call("POST", "/v1/sessions", &[("content-type", "application/json")], "{}");
    assert_eq!(answer.status, 202, "{}", answer.text);
    answer.json()["id"].as_str().unwrap().to_owned()
}

fn session(daemon: &Daemon, id: &str) -> Value {
    daemon.get(&format!("/v1/sessions/{id}")).json()
}

/// Whole chain, and every journalled frame on disk as it was journalled, and no other but what is set aside; returns their number.
fn check_session(directory: &Path) -> usize {
    let path = directory.join(journal::FILE);
    let read = journal::read(&path).unwrap();
    assert_eq!(read.head.fault, None, "{}", path.display());
    assert_eq!(read.length, std::fs::metadata(&path).unwrap().len(), "{}: a torn line is left", path.display());
    let mut files = BTreeSet::new();
    for frame in read.records.iter().filter(|r| r["type"] == "frame.committed") {
        let name = frame["file"].as_str().unwrap();
        let bytes = std::fs::read(directory.join("frames").join(name)).unwrap();
        assert_eq!(
            (&frame["bytes"], &frame["blake3"]),
            (&bytes.len().into(), &blake3::hash(&bytes).to_hex().as_str().into())
        );
        files.insert(name.to_owned());
    }
    let names =
        std::fs::read_dir(directory.join("frames")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let frames: BTreeSet<String> = names.filter(|name| !name.ends_with(".unacknowledged")).collect();
    assert_eq!(frames, files, "{}", directory.display());
    files.len()
}

/// Kills of one session.
const KILLS: usize = 3;

/// Kills daemons at random moments of their sessions, again and again, until `kills` are done; every session goes on by itself and ends
/// with each cell of the plan once, no acknowledged frame is ever lost, and a kill costs one exposure at most beside the one in the camera.
fn kill_and_go_on(kills: usize) {
    let (rigged, mut random) = (Rigged::new(0.1), StdRng::seed_from_u64(SEED));
    let (mut done, mut caught, mut repeated, mut slowest) = (0, 0, [0; 2], Duration::ZERO);
    while done < kills {
        let mut daemon = rigged.daemon();
        let id = begin(&daemon);
        let directory = rigged.data().join("sessions").join(&id);
        let mut acknowledged = BTreeMap::new();
        for _ in 0..KILLS {
            if random.random() {
                std::thread::sleep(Duration::from_millis(random.random_range(0..700)));
            } else {
                // The bracket of a replayed folder is soon over: this moment lies within one more often than chance has it.
                let frames = committed(&directory).len();
                until("a frame", || committed(&directory).len() > frames || ended(&directory));
                std::thread::sleep(Duration::from_micros(random.random_range(0..20_000)));
            }
            daemon.kill();
            done += 1;
            let before = committed(&directory);
            for (file, hash) in &acknowledged {
                assert_eq!(before.get(file), Some(hash), "kill {done} of seed {SEED}: {file} is lost");
            }
            acknowledged = before;
            let again = Instant::now();
            daemon = rigged.daemon();
            until("the session to be taken up", || session(&daemon, &id)["state"] != "interrupted");
            slowest = slowest.max(again.elapsed());
            assert!(slowest < Duration::from_secs(10), "kill {done}: taken up after {slowest:?}");
            caught += usize::from(session(&daemon, &id)["state"] != "completed");
        }
        daemon.wait_for_end(&format!("/v1/sessions/{id}"));
        let ended = session(&daemon, &id);
        assert_eq!(
            (&ended["state"], &ended["frames_committed"]),
            (&"completed".into(), &9.into()),
            "seed {SEED}: {ended}"
        );
        assert!(daemon.terminate().success());
        check_session(&directory);
        let last = committed(&directory);
        assert!(acknowledged.iter().all(|(file, hash)| last.get(file) == Some(hash)), "seed {SEED}");
        for again in shot_again(&directory) {
            assert!(
                again[0] + again[1] <= 1,
                "seed {SEED}: {again:?} shot again after one kill in {}",
                directory.display()
            );
            (0..2).for_each(|i| repeated[i] += again[i]);
        }
        rigged.assert_at_rest("after a session");
    }
    let [frames, proofs] = repeated;
    println!(
        "{done} kills, {caught} in mid-session, {frames} frames and {proofs} proofs of the light shot again, at most one a kill, \
         taken up within {slowest:.1?}"
    );
    assert!(caught > kills / 2, "{caught} of {kills} kills met a session: the moments are badly chosen");
}

/// Exposures that were shot a second time after each interruption: acknowledged frames, and those that prove the light.
fn shot_again(directory: &Path) -> Vec<[usize; 2]> {
    let (mut cells, mut runs) = (BTreeSet::new(), vec![]);
    for record in journal::read(&directory.join(journal::FILE)).unwrap().records {
        match record["type"].as_str().unwrap() {
            "session.state" if record["state"] == "interrupted" => runs.push([0, 0]),
            "frame.committed" => {
                let again = !cells.insert((record["station"].as_u64(), record["exposure"].as_u64()));
                if let Some(run) = runs.last_mut() {
                    run[0] += usize::from(again);
                }
            }
            "bracket.resumed" | "bracket.rejected" => runs.last_mut().unwrap()[1] += 1,
            _ => {}
        }
    }
    runs
}

/// True once the session is completed.
fn ended(directory: &Path) -> bool {
    let read = journal::read(&directory.join(journal::FILE)).unwrap();
    read.records.iter().any(|record| record["state"] == "completed")
}

/// Files and hashes of the frames that were ever acknowledged.
fn committed(directory: &Path) -> BTreeMap<String, String> {
    let read = journal::read(&directory.join(journal::FILE)).unwrap();
    let text = |frame: &Value, key: &str| frame[key].as_str().unwrap().to_owned();
    let frames = read.records.iter().filter(|record| record["type"] == "frame.committed");
    frames.map(|frame| (text(frame, "file"), text(frame, "blake3"))).collect()
}

#[test]
fn killed_at_random_moments_it_goes_on_and_loses_nothing() {
    kill_and_go_on(6);
}

#[test]
#[ignore = "ten minutes: cargo test --test daemon_kill -- --ignored --nocapture"]
fn killed_five_hundred_times_it_goes_on_and_loses_nothing() {
    kill_and_go_on(500);
}

#[test]
fn a_killed_daemon_s_lamp_goes_off_by_itself() {
    let rigged = Rigged::new(60.0);
    let mut daemon = rigged.daemon();
    begin(&daemon);
    until("the lamp", || rigged.pose.get().lamp_permille > 0);
    daemon.kill();
    until("the dead-man", || rigged.pose.get().lamp_permille == 0);
}

/// What the service manager runs after a daemon that ended in any way.
#[test]
fn a_killed_daemon_s_arm_is_parked_and_its_lamp_off_after_rigd_safe() {
    let rigged = Rigged::new(0.1);
    let config = rigged.folder.path().join("rig.toml");
    std::fs::write(&config, &rigged.config).unwrap();
    let safe = || {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_rigd"));
        command.arg("safe").arg("--config").arg(&config).arg("--data").arg(rigged.data());
        let out = command.output().unwrap();
        (out.status.code(), String::from_utf8(out.stderr).unwrap())
    };
    let mut daemon = rigged.daemon();
    begin(&daemon);
    until("the lamp on a station", || {
        let Pose { angle_deg, lamp_permille } = rigged.pose.get();
        lamp_permille > 0 && (angle_deg - PARK_DEG).abs() > 5.0
    });
    let (status, says) = safe();
    assert_eq!((status, says.contains("nothing was touched")), (Some(1), true), "beside a live daemon: {says}");
    assert!(rigged.pose.get().lamp_permille > 0, "the daemon's lamp was switched off");

    daemon.kill();
    // The second time there is nothing left to do.
    for _ in 0..2 {
        let (status, says) = safe();
        assert_eq!(status, Some(0), "{says}");
        rigged.assert_at_rest("after rigd safe");
    }
    let missing = rigged.config.replacen("port = \"", "port = \"/nowhere", 1);
    std::fs::write(&config, missing).unwrap();
    let (status, says) = safe();
    assert_eq!((status, says.contains("the lamp may be on")), (Some(1), true), "{says}");
}

#[test]
fn sigterm_in_any_state_ends_in_order_with_the_lamp_off_and_the_arm_parked() {
    for state in ["preflight", "running", "paused"] {
        let rigged = Rigged::new(if state == "preflight" { 60.0 } else { 0.1 });
        let mut daemon = rigged.daemon();
        let id = begin(&daemon);
        until("the lamp", || rigged.pose.get().lamp_permille > 0);
        if state == "paused" {
            until("a pause to be taken", || {
                daemon.call("POST", &format!("/v1/sessions/{id}/pause"), &[], "").status == 202
            });
        }
        until(state, || session(&daemon, &id)["state"] == state);
        assert!(daemon.terminate().success(), "{state}");
        rigged.assert_at_rest(state);
        let directory = rigged.data().join("sessions").join(&id);
        check_session(&directory);
        let journal = journal::read(&directory.join(journal::FILE)).unwrap();
        assert_eq!(journal.records.last().unwrap()["state"], "interrupted", "{state}");
        // Nor is a replayed folder asked for a picture of the room, which it does not have.
        let told = |kind: &str| journal.records.iter().any(|record| record["type"].as_str().unwrap().starts_with(kind));
        assert!(!told("fault.raised") && !told("ambient."), "{state}");
    }
}
