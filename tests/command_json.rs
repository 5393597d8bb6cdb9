//! `--json`: stdout is one JSON value and nothing else, of the shape that docs/commands.md states.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod daemon;

use daemon::{Daemon, serve, shipped};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// What a command that succeeds prints; nothing may stand on stderr.
fn said(args: &[&str]) -> Value {
    let out = Command::new(env!("CARGO_BIN_EXE_rigd")).args(args).arg("--json").output().unwrap();
    let errors = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success() && errors.is_empty(), "{args:?}: {errors}");
    serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{args:?}: {e}"))
}

/// True when a value, or each of an array, is an object with these keys.
fn has(value: &Value, keys: &str) -> bool {
    let all = |object: &Value| keys.split(' ').all(|key| object.get(key).is_some());
    value.as_array().map_or_else(|| all(value), |rows| !rows.is_empty() && rows.iter().all(all))
}

fn daemon_answers(url: &str) -> String {
    let ask = |command: &[&str]| said(&[command, &["--url", url]].concat());
    let session = "id name state started frames_committed frames_planned warnings last_seq";
    let started = ask(&["session", "start", "--name", "ball"]);
    assert!(has(&started, session));
    let id = started["id"].as_str().unwrap();
    assert!(has(&ask(&["session", "start", "--dry-run"]), "frames stations"));
    let ended = ask(&["session", "watch", id]);
    assert!(has(&ended, session) && ended["state"] == "completed", "{ended}");
    assert!(has(&ask(&["session", "list"]), session) && has(&ask(&["session", "show", id]), session));
    let frames = ask(&["session", "frames", id]);
    assert!(has(&frames, "station exposure file shutter bytes blake3 state") && frames.as_array().unwrap().len() == 70);
    assert_eq!(ask(&["calibrate", "list"]), Value::Array(Vec::new()));
    let queue = "held waits entries";
    assert!(has(&ask(&["queue", "hold"]), queue));
    let entry = ask(&["queue", "add", "--name", "next"]);
    assert!(has(&entry, "id estimated_start estimated_end estimated_bytes"), "{entry}");
    for command in [&["queue", "list"][..], &["queue", "first", entry["id"].as_str().unwrap()]] {
        assert_eq!(ask(command)["entries"].as_array().unwrap().len(), 1);
    }
    assert_eq!(ask(&["queue", "remove", entry["id"].as_str().unwrap()])["entries"], Value::Array(Vec::new()));
    assert!(has(&ask(&["queue", "release"]), queue));
    id.to_owned()
}

fn of_the_session(session: &Path, folder: &Path) {
    let (dataset, out) = (session.to_str().unwrap(), |name: &str| folder.join(name).to_str().unwrap().to_owned());
    let material = ["fit", dataset, "--out", &out("fit"), "--materials", "1", "--model", "lambert"];
    assert!(has(&said(&material), "pixels samples materials model solver mean_relative_error candidates warnings"));
    let relit = said(&["relight", &out("fit"), "--lights", dataset, "--out", &out("relit")]);
    assert!(has(&relit, "light file") && relit.as_array().unwrap().len() == 7);
    let rendered =
        said(&["render", &out("fit"), "--mesh", "sphere", "--size", "32x32", "--patch", "8", "--out", &out("render")]);
    assert!(has(&rendered, "files triangles without_area textured patch exposure_s response"), "{rendered}");
    assert!(rendered["files"].as_array().unwrap().iter().all(|file| Path::new(file.as_str().unwrap()).is_file()));
    let bracket = folder.join("bracket");
    std::fs::create_dir(&bracket).unwrap();
    for exposure in 0..10 {
        let name = format!("003-{exposure:02}.jpg");
        std::fs::copy(session.join("frames").join(&name), bracket.join(&name)).unwrap();
    }
    let merged = said(&["merge", bracket.to_str().unwrap()]);
    assert!(has(&merged, "out frames width height valid_share calibration") && merged["frames"] == 10, "{merged}");
    assert!(has(&merged["calibration"]["exposures"], "name nominal_s estimated_s"));
    assert!(has(&said(&["calibrate", "response", bracket.to_str().unwrap()]), "exposures reference"));
}

#[test]
fn commands_whose_output_is_data_print_it_as_json_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let config =
        shipped().replace("speed = 40.0", "speed = 400.0").replacen("[storage]", "[storage]\nkeep_days = 1", 1);
    let data = folder.path().join("data");
    let mut daemon = Daemon::start_with(tempfile::tempdir().unwrap(), &config, &data);
    let id = daemon_answers(&daemon.url());
    assert!(daemon.terminate().success());
    let data = data.to_str().unwrap();
    let session = Path::new(data).join("sessions").join(&id);
    of_the_session(&session, folder.path());

    assert!(has(&said(&["history", data]), "run kind state started frames_committed frames_planned fit"));
    assert!(has(&said(&["verify", data]), "id state records frames faults index_faults notes"));
    assert!(has(&said(&["index", "rebuild", data]), "runs frames fits left_out"));
    // The file is one that `rigd serve` would read.
    drop(serve(folder.path(), &config, Path::new(data)));
    let rig = folder.path().join("rig.toml");
    let rig = rig.to_str().unwrap();
    assert!(has(&said(&["config", "check", rig]), "file name not_served"));
    assert!(has(&said(&["doctor", "--config", rig, "--data", data]), "grade what where remedy"));
    let kept = said(&["retention", "--config", rig, "--data", data]);
    assert!(has(&kept, "session goes why") && kept[0]["goes"] == false, "{kept}");
    let schema = Command::new(env!("CARGO_BIN_EXE_rigd")).args(["config", "schema"]).output().unwrap();
    assert!(has(&serde_json::from_slice(&schema.stdout).unwrap(), "properties"));
}
