//! One acquisition end to end over REST: the real binary, the simulated rig, and clients that come and go.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod daemon;

use daemon::Daemon;
use rigd::store::exr::read_planes;
use serde_json::{Value, json};
use std::collections::HashSet;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const JSON: (&str, &str) = ("content-type", "application/json");
/// Longest wait for anything here: a failure, not a measure.
const PATIENCE: Duration = Duration::from_secs(60);

/// Starts the rig file's own plan; the session's path.
fn start(daemon: &Daemon) -> String {
    let started = daemon.call("POST", "/v1/sessions", &[JSON], "{}");
    assert_eq!(started.status, 202, "{}", started.text);
    started.header("location").unwrap().to_owned()
}

fn ask(daemon: &Daemon, location: &str, verb: &str) -> Value {
    let answer = daemon.call("POST", &format!("{location}/{verb}"), &[], "");
    assert_eq!(answer.status, 202, "{verb}: {}", answer.text);
    answer.json()
}

/// Waits until a look at the session satisfies `there`.
fn wait(daemon: &Daemon, location: &str, there: impl Fn(&Value) -> bool) -> Value {
    let end = Instant::now() + PATIENCE;
    loop {
        let snapshot = daemon.get(location).json();
        if there(&snapshot) {
            return snapshot;
        }
        assert!(Instant::now() < end, "waited in vain: {snapshot}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// The journal's records, from the file.
fn journal(daemon: &Daemon, location: &str) -> Vec<Value> {
    let text = std::fs::read_to_string(daemon.directory(location).join("journal.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// The states a session went through.
fn states(journal: &[Value]) -> Vec<&str> {
    let changes = journal.iter().filter(|record| record["type"] == "session.state");
    changes.map(|record| record["state"].as_str().unwrap()).collect()
}

#[test]
fn a_session_outlives_its_client_and_who_reconnects_misses_no_event() {
    let daemon = Daemon::start();
    let mut client = Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(["session", "--url", &daemon.url(), "start", "--watch"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut id = String::new();
    BufReader::new(client.stdout.take().unwrap()).read_line(&mut id).unwrap();
    let location = format!("/v1/sessions/{}", id.trim());
    let events = format!("{location}/events");

    let (_, mut ids) = daemon.events(&events, &[], 12);
    client.kill().unwrap();
    client.wait().unwrap();
    assert!(daemon.get(&location).json()["ended"].is_null(), "the client was killed in the middle of the session");

    // Every connection takes a few more events than the one before, so that they break off at many different places.
    for most in 5.. {
        let last = ids.last().unwrap().to_string();
        let (status, more) = daemon.events(&events, &[("last-event-id", &last)], most);
        ids.extend(more);
        if status == 204 {
            break;
        }
    }
    let journal = journal(&daemon, &location);
    assert_eq!(ids, (1..=journal.len() as u64).collect::<Vec<_>>(), "every record was told once and in order");

    let session = daemon.get(&location).json();
    assert_eq!((&session["state"], &session["frames_committed"]), (&json!("completed"), &json!(70)), "{session}");
    assert!(session["mean_relative_error"].as_f64().unwrap() < 0.0589, "the paper's error: {session}");
    let directory = daemon.directory(&location);
    let own = ["dataset.toml", "manifest.json", "radiance/06.exr"].map(String::from);
    let results = [
        "report.json",
        "material.json",
        "weights.exr",
        "weights_sigma.exr",
        "valid.png",
        "residual.png",
        "residual.exr",
        "preview.png",
    ];
    for file in own.into_iter().chain(results.map(|name| format!("result/{name}"))) {
        let size = std::fs::metadata(directory.join(&file)).unwrap_or_else(|e| panic!("{file}: {e}")).len();
        assert!(size > 0, "{file} is empty");
    }
    for name in results {
        assert_eq!(daemon.get(&format!("{location}/result/{name}")).status, 200, "{name}");
    }
    let material = daemon.get(&format!("{location}/material")).json();
    assert_eq!(material["report"]["mean_relative_error"], session["mean_relative_error"]);
    assert_eq!(material["material"]["provenance"]["simulated"], true);
    what_a_viewer_needs_is_told(&daemon, &location, &material["material"]);
}

/// The bytes of an answer to GET, as a file.
fn downloaded(daemon: &Daemon, target: &str, path: &Path) {
    let mut answer = Vec::new();
    daemon.open(target, &[]).read_to_end(&mut answer).unwrap();
    let body = answer.windows(4).position(|four| four == b"\r\n\r\n").unwrap() + 4;
    assert!(answer.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&answer[..body]));
    std::fs::write(path, &answer[body..]).unwrap();
}

/// Texture, response, lights and surface are those of the files, and wrong requests for them are refused.
fn what_a_viewer_needs_is_told(daemon: &Daemon, location: &str, material: &Value) {
    let folder = tempfile::tempdir().unwrap();
    let full: (usize, usize) = serde_json::from_value(material["size"].clone()).unwrap();
    let maps = read_planes(&daemon.directory(location).join("result/weights.exr"), full).unwrap();
    let texture = daemon.get(&format!("{location}/texture?patch=32")).json();
    let count = material["materials"].as_array().unwrap().len();
    assert_eq!((&texture["model"], texture["materials"].as_array().unwrap().len()), (&material["model"], count));
    assert_eq!(texture["materials"][0]["rho_d"][1], material["materials"][0]["rho_d"][1]["value"]);
    let [x, y] = ["x", "y"].map(|key| texture[key].as_u64().unwrap() as usize);
    // Beyond the first quarter, where its edges were joined, the texture is the weight map.
    for (i, j) in [(8, 8), (31, 9), (20, 31)] {
        for m in 0..count {
            let told = texture["weights"][(j * 32 + i) * count + m].as_f64().unwrap() as f32;
            assert_eq!(told, maps.channels[m].1[(y + j) * full.0 + x + i], "texel {i}, {j}, material {m}");
        }
    }
    let response = daemon.get(&format!("{location}/response")).json();
    assert_eq!((&response["calibration"], &response["log_exposure"][2][128]), (&Value::Null, &json!(0.0)));
    let lights = daemon.get(&format!("{location}/lights")).json();
    assert_eq!(lights["lights"].as_array().unwrap().len(), 7);
    assert!(lights["lights"][6]["position_mm"][2].is_number() && lights["lights"][6].get("direction").is_none());

    let path = folder.path().join("surface.exr");
    downloaded(daemon, &format!("{location}/surface?most=64"), &path);
    // The shipped ball is at (0, 0, 1500) with a radius of 30 mm.
    let size = (1..=64).flat_map(|w| [(w, w), (w, w - 1), (w - 1, w)]).find(|&size| read_planes(&path, size).is_ok());
    let seen = read_planes(&path, size.unwrap()).unwrap();
    let plane = |name: &str| &seen.channels.iter().find(|(known, _)| known == name).unwrap().1;
    let on: Vec<usize> = (0..plane("normal.Z").len()).filter(|&i| plane("normal.Z")[i] != 0.0).collect();
    assert!(on.len() > 1000, "{} points are seen", on.len());
    for &i in &on {
        let from = [plane("position.X")[i], plane("position.Y")[i], plane("position.Z")[i] - 1500.0].map(|c| c / 30.0);
        let normal = ["X", "Y", "Z"].map(|axis| plane(&format!("normal.{axis}"))[i]);
        assert!(from.iter().zip(normal).all(|(a, b)| (a - b).abs() < 1e-4), "{from:?} {normal:?}");
    }
    let weights: HashSet<u32> = maps.channels[0].1.iter().map(|weight| weight.to_bits()).collect();
    assert!(on.iter().all(|&i| weights.contains(&plane("material_1")[i].to_bits())), "pixels are picked, not averaged");
    assert!(["sigma_1", "residual.G", "view.Z"].iter().all(|name| plane(name).iter().any(|v| *v != 0.0)));
    downloaded(daemon, &format!("{location}/surface/6?most=64"), &path);
    assert_eq!(read_planes(&path, size.unwrap()).unwrap().channels.len(), 4);

    for (rest, status) in [
        ("texture?patch=256", 422),
        ("texture?patch=7", 400),
        ("texture?side=32", 400),
        ("surface?most=15", 400),
        ("surface/7", 404),
        ("surface/one", 404),
        ("lights/0", 404),
    ] {
        assert_eq!(daemon.get(&format!("{location}/{rest}")).status, status, "{rest}");
    }
}

#[test]
fn a_session_is_paused_resumed_and_aborted() {
    let daemon = Daemon::start();
    let location = start(&daemon);
    wait(&daemon, &location, |s| s["frames_committed"].as_u64().unwrap() >= 3);
    ask(&daemon, &location, "pause");
    let paused = wait(&daemon, &location, |s| s["state"] == "paused");
    ask(&daemon, &location, "resume");
    let shot = paused["frames_committed"].as_u64().unwrap();
    wait(&daemon, &location, |s| s["frames_committed"].as_u64().unwrap() > shot);
    ask(&daemon, &location, "abort");
    daemon.wait_for_end(&location);

    let journal = journal(&daemon, &location);
    let want = ["preflight", "running", "pausing", "paused", "running", "aborting", "aborted"];
    assert_eq!(states(&journal), want);
    let at = journal.iter().position(|record| record["state"] == "paused").unwrap();
    let shots_before = journal[..at].iter().filter(|record| record["type"] == "frame.committed").count() as u64;
    assert_eq!(shots_before, shot);
    let next = journal[at..].iter().skip(1).find(|record| record["type"] != "station.developed").unwrap();
    assert_eq!(next["state"], "running", "nothing is shot between pause and resume");
    assert!(!daemon.directory(&location).join("result").exists(), "an aborted session fits nothing");
    assert_eq!(daemon.call("GET", &format!("{location}/material"), &[], "").status, 409);
    assert_eq!(daemon.call("POST", &format!("{location}/resume"), &[], "").status, 409);
}

#[test]
fn a_stopped_session_fits_what_it_has_and_can_be_fitted_again() {
    let daemon = Daemon::start();
    let location = start(&daemon);
    wait(&daemon, &location, |s| s["station"].as_u64().unwrap() >= 3);
    ask(&daemon, &location, "stop");
    daemon.wait_for_end(&location);
    let stopped = daemon.get(&location).json();
    assert_eq!(stopped["state"], "stopped", "{stopped}");
    assert_eq!(daemon.get(&format!("{location}/material")).json()["report"]["materials"], 2);

    for (body, reasons) in
        [(json!({"materials": 5, "objective": "least"}), 2), (json!({"model": "wardd", "leave_out": [99]}), 2)]
    {
        let refused = daemon.call("POST", &format!("{location}/fit"), &[JSON], &body.to_string());
        assert_eq!(refused.status, 422, "{}", refused.text);
        assert_eq!(refused.json()["reasons"].as_array().map(Vec::len), Some(reasons), "{}", refused.text);
    }
    let seq = stopped["last_seq"].as_u64().unwrap();
    let asked = json!({"materials": 1, "objective": "relative"}).to_string();
    assert_eq!(daemon.call("POST", &format!("{location}/fit"), &[JSON], &asked).status, 202);
    let finished = || journal(&daemon, &location).into_iter().rev().find(|r| r["type"] == "fit.finished");
    wait(&daemon, &location, |s| {
        s["last_seq"].as_u64().unwrap() > seq && finished().is_some_and(|r| r["seq"].as_u64().unwrap() > seq)
    });
    let report = &daemon.get(&format!("{location}/material")).json()["report"];
    assert_eq!((&report["materials"], &report["objective"]), (&json!(1), &json!("relative")), "{report}");
}
