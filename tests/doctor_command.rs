//! `rigd doctor` as people and scripts meet it, and a session's refusal of what it would have found.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod daemon;

use daemon::{Daemon, shipped};
use nix::pty::openpty;
use rig_config::Rig;
use rigd::sim::arm::{ArmConfig, SimulatedArm};
use rigd::sim::pose::{Pose, SharedPose};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

struct Said {
    status: Option<i32>,
    findings: Vec<Value>,
    stderr: String,
}

impl Said {
    fn of_grade(&self, grade: &str) -> Vec<&Value> {
        self.findings.iter().filter(|finding| finding["grade"] == grade).collect()
    }

    /// The one error whose `what` holds this text.
    fn error(&self, what: &str) -> &Value {
        let errors = self.of_grade("error");
        let found = errors.iter().find(|error| error["what"].as_str().unwrap().contains(what));
        found.unwrap_or_else(|| panic!("no error says {what:?}: {errors:?}"))
    }
}

fn doctor(config: &str, data: &Path) -> Said {
    doctor_of(Path::new(env!("CARGO_BIN_EXE_rigd")), config, data)
}

fn doctor_of(program: &Path, config: &str, data: &Path) -> Said {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("rig.toml");
    std::fs::write(&file, config).unwrap();
    let mut command = Command::new(program);
    let output = command.args(["doctor", "--json", "--config"]).arg(&file).arg("--data").arg(data).output().unwrap();
    let findings = serde_json::from_slice(&output.stdout).unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    Said { status: output.status.code(), findings, stderr }
}

/// By another process: a child that a test beside this one starts must not inherit a program that is still open for writing.
fn copy(program: &str, to: &Path) {
    assert!(Command::new("cp").arg(program).arg(to).status().unwrap().success());
}

/// The shipped rig with our own protocol on `port`, and a folder of frames for a camera.
fn rigproto(port: &Path, frames: &Path) -> String {
    std::fs::create_dir_all(frames).unwrap();
    std::fs::write(frames.join("0.jpg"), "").unwrap();
    let arm = format!("driver = \"rigproto\"\nport = {:?}", port.to_str().unwrap());
    let camera = format!("driver = \"replay\"\ndirectory = {:?}", frames.to_str().unwrap());
    let text = shipped().split("[simulation]").next().unwrap();
    text.replacen("driver = \"simulated\"", &arm, 1).replacen("driver = \"simulated\"", &camera, 1)
}

/// A port that this process has open, and who that is.
fn held_port() -> (nix::pty::OpenptyResult, std::path::PathBuf, String) {
    let pty = openpty(None, None).unwrap();
    let port = nix::unistd::ttyname(&pty.slave).unwrap();
    (pty, port, format!("(process {})", std::process::id()))
}

#[test]
fn the_simulated_rig_is_well_and_nothing_is_written() {
    let data = tempfile::tempdir().unwrap();
    let said = doctor(shipped(), data.path());
    assert_eq!(said.status, Some(0), "{:?} {}", said.findings, said.stderr);
    assert!(said.of_grade("error").is_empty() && said.stderr.is_empty(), "{}", said.stderr);
    let whats: Vec<_> = said.findings.iter().map(|finding| finding["what"].as_str().unwrap()).collect();
    for part in ["sound", "the arm answers: rig firmware", "the camera answers", "are free"] {
        assert!(whats.iter().any(|what| what.contains(part)), "nothing says {part}: {whats:?}");
    }
    assert_eq!(std::fs::read_dir(data.path()).unwrap().count(), 0);
    for finding in &said.findings {
        let keys: Vec<_> = finding.as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(keys, ["grade", "remedy", "what", "where"]);
        assert_eq!(finding["remedy"].is_null(), finding["grade"] == "ok", "{finding}");
    }
}

#[test]
fn people_read_lines_and_remedies() {
    let data = tempfile::tempdir().unwrap();
    let file = data.path().join("rig.toml");
    std::fs::write(&file, rigproto(Path::new("/dev/no-such-arm"), &data.path().join("frames"))).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    let output = command.args(["doctor", "--config"]).arg(&file).arg("--data").arg(data.path()).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(
        text.contains("error    /dev/no-such-arm: there is no such device\n         -> check the arm's cable"),
        "{text}"
    );
    assert!(text.starts_with("ok       "), "{text}");
    assert!(String::from_utf8(output.stderr).unwrap().contains("keep a session from running"));
}

#[test]
fn an_arm_that_answers_is_neither_turned_nor_lit() {
    let (data, pose) = (tempfile::tempdir().unwrap(), SharedPose::default());
    pose.set(Pose { angle_deg: 12.5, lamp_permille: 0 });
    let rig = Rig::from_toml(shipped(), "simulated.toml").unwrap();
    let arm = SimulatedArm::spawn(ArmConfig::from_rig(&rig, pose.clone())).unwrap();
    let before = pose.get();
    let said = doctor(&rigproto(arm.port(), &data.path().join("frames")), data.path());
    assert_eq!(said.status, Some(0), "{:?} {}", said.findings, said.stderr);
    assert!(said.findings.iter().any(|f| f["what"].as_str().unwrap().starts_with("the arm answers: rig firmware")));
    assert_eq!((arm.moves_started(), pose.get()), (0, before));
}

#[test]
fn a_held_port_names_its_holder_and_is_not_opened() {
    let data = tempfile::tempdir().unwrap();
    let (_pty, port, who) = held_port();
    let said = doctor(&rigproto(&port, &data.path().join("frames")), data.path());
    assert_eq!(said.status, Some(1), "{:?}", said.findings);
    let error = said.error("held by");
    assert!(error["what"].as_str().unwrap().contains(&who), "{error}");
    assert_eq!(error["where"], port.to_str().unwrap());
    // A program that another test is starting may have inherited the port as well.
    let only_held = said.of_grade("error").iter().all(|f| f["what"].as_str().unwrap().starts_with("held by"));
    assert!(only_held, "the port was opened all the same: {:?}", said.findings);
}

#[test]
fn a_rig_without_worker_and_arm_lacks_both() {
    let alone = tempfile::tempdir().unwrap();
    let program = alone.path().join("rigd");
    copy(env!("CARGO_BIN_EXE_rigd"), &program);
    let text = rig_config::SHIPPED.iter().find(|(name, _)| *name == "zheng-2008").unwrap().1;
    let said = doctor_of(&program, text, &alone.path().join("data"));
    assert_eq!(said.status, Some(1), "{:?}", said.findings);
    let worker = said.error("the camera worker cannot be started");
    assert_eq!(worker["where"], alone.path().join("camera-worker").to_str().unwrap());
    assert!(worker["remedy"].as_str().unwrap().contains("cargo build --release -p camera-worker"));
    assert_eq!(said.error("no such device")["where"], "/dev/serial/by-id/usb-rigd_light_arm-if00");
}

/// A program by the worker's name that says something else.
#[test]
fn a_worker_that_speaks_no_message_of_ours_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("rigd");
    copy(env!("CARGO_BIN_EXE_rigd"), &program);
    copy("/bin/cat", &folder.path().join("camera-worker"));
    let text = rig_config::SHIPPED.iter().find(|(name, _)| *name == "zheng-2008").unwrap().1;
    let said = doctor_of(&program, text, &folder.path().join("data"));
    assert_eq!(said.status, Some(1));
    let error = said.error("the camera worker failed");
    assert!(error["remedy"].as_str().unwrap().contains("from the sources"), "{error}");
}

#[test]
fn a_bad_rig_file_is_wrong_usage_and_still_an_array() {
    let data = tempfile::tempdir().unwrap();
    let said = doctor(&shipped().replace("radius_mm = 30.0", "radius_mm = -1.0"), data.path());
    assert_eq!(said.status, Some(2));
    assert!(said.findings.len() == 1 && said.stderr.contains("radius_mm"), "{:?} {}", said.findings, said.stderr);
    assert!(said.error("radius_mm")["where"].as_str().unwrap().ends_with("rig.toml"));
}

#[test]
fn another_daemon_on_the_data_directory_is_named_and_its_arm_left_alone() {
    let data = tempfile::tempdir().unwrap();
    let lock = std::fs::File::open(data.path()).unwrap();
    lock.lock().unwrap();
    let said = doctor(shipped(), data.path());
    assert_eq!(said.status, Some(0), "{:?}", said.findings);
    let who = format!("(process {})", std::process::id());
    let warned = |f: &&Value| f["what"].as_str().unwrap().contains("in use by");
    let warning = *said.of_grade("warning").iter().find(|f| warned(f)).unwrap();
    assert!(warning["what"].as_str().unwrap().contains(&who), "{warning}");
    assert_eq!(warning["where"], data.path().to_str().unwrap());
    assert!(!said.findings.iter().any(|f| f["what"].as_str().unwrap().contains("the arm answers")));
}

#[test]
fn a_session_refuses_a_held_port_before_anything_moves_and_names_the_holder() {
    let folder = tempfile::tempdir().unwrap();
    let (_pty, port, who) = held_port();
    let config = rigproto(&port, &folder.path().join("frames"));
    let data = folder.path().join("data");
    let daemon = Daemon::start_with(folder, &config, &data);
    let started = daemon.call("POST", "/v1/sessions", &[("content-type", "application/json")], "{}");
    assert_eq!(started.status, 202, "{}", started.text);
    let location = started.header("location").unwrap().to_owned();
    daemon.wait_for_end(&location);
    let session = daemon.get(&location).json();
    assert_eq!(session["state"], "failed");
    let reason = session["reason"].as_str().unwrap();
    assert!(reason.contains("held by") && reason.contains(&who), "{reason}");
}
