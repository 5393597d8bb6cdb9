//! Calibrations over REST and on the terminal: the real binary on the simulated rig to calibrate.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod daemon;

use daemon::Daemon;
use rigd::store::journal::Journal;
use rigd::store::{RealClock, RealDisk};
use serde_json::{Value, json};
use std::io::Write;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const JSON: (&str, &str) = ("content-type", "application/json");
/// Longest wait for anything here: a failure, not a measure.
const PATIENCE: Duration = Duration::from_secs(60);

fn serve() -> Daemon {
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated-calibration").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    Daemon::start_with(folder, &text.replace("speed = 40.0", "speed = 4000.0"), &data)
}

fn begin(daemon: &Daemon) -> String {
    let started = daemon.call("POST", "/v1/calibrations", &[JSON], r#"{"name": "first"}"#);
    assert_eq!(started.status, 202, "{}", started.text);
    started.header("location").unwrap().to_owned()
}

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

#[test]
fn a_calibration_is_started_shot_refused_and_aborted_over_rest() {
    let daemon = serve();
    let location = begin(&daemon);
    let id = location.strip_prefix("/v1/calibrations/").unwrap().to_owned();
    let waiting = wait(&daemon, &location, |run| run["state"] == "awaiting");
    assert_eq!((&waiting["version"], &waiting["name"], &waiting["steps"]), (&json!(1), &json!("first"), &json!(14)));
    assert_eq!(waiting["step"], json!({"kind": "board", "view": 1, "of": 12}));
    assert!(waiting["instruction"].as_str().unwrap().contains("9x6 inner corners"), "{waiting}");

    let busy = daemon.call("POST", "/v1/sessions", &[JSON], "{}");
    assert_eq!((busy.status, &busy.json()["running"]), (409, &json!(id)), "{}", busy.text);
    assert_eq!(daemon.call("POST", "/v1/calibrations", &[JSON], "{}").status, 409);
    let nothing = daemon.get(&format!("{location}/result"));
    assert_eq!((nothing.status, &nothing.json()["current_state"]), (409, &json!("awaiting")));

    assert_eq!(daemon.call("POST", &format!("{location}/shoot"), &[], "").status, 202);
    let judged = wait(&daemon, &location, |run| run["verdicts"].as_array().unwrap().len() == 1);
    assert_eq!(judged["verdicts"][0]["step"]["kind"], "board");
    assert_eq!(judged["frames_committed"], 1);
    wait(&daemon, &location, |run| run["state"] == "awaiting");
    assert_eq!(daemon.call("POST", &format!("{location}/abort"), &[], "").status, 202);
    let (status, ids) = daemon.events(&format!("{location}/events"), &[], usize::MAX);
    assert_eq!(status, 200);
    let end = daemon.get(&location).json();
    assert_eq!((&end["state"], end["last_seq"].as_u64()), (&json!("aborted"), ids.last().copied()), "{end}");
    assert_eq!(ids, (1..=ids.len() as u64).collect::<Vec<_>>());
    let last = ids.last().unwrap().to_string();
    assert_eq!(daemon.events(&format!("{location}/events"), &[("last-event-id", &last)], 1).0, 204);
    let refused = daemon.call("POST", &format!("{location}/shoot"), &[], "");
    assert_eq!((refused.status, &refused.json()["allowed"]), (409, &json!([])), "{}", refused.text);

    let list = daemon.get("/v1/calibrations").json();
    assert_eq!(list["calibrations"][0]["id"], json!(id));
    assert_eq!(daemon.get("/v1/sessions").json()["sessions"], json!([]));
    assert_eq!(daemon.get(&format!("/v1/sessions/{id}")).status, 404);
    let unknown = daemon.get("/v1/calibrations/01a208e9-cbda-76fb-b465-63318274b666");
    assert_eq!(unknown.status, 404);
    assert!(unknown.json()["detail"].as_str().unwrap().contains("no calibration"), "{}", unknown.text);
    assert_eq!(daemon.get("/v1/calibrations/..%2F..").status, 404);
}

#[test]
fn a_session_names_a_calibration_that_is_there_or_is_refused() {
    let daemon = serve();
    let plan = |body: Value| daemon.call("POST", "/v1/sessions?dry_run=true", &[JSON], &body.to_string());
    let none = plan(json!({})).json();
    assert_eq!(&none["calibration"], &Value::Null, "{none}");
    assert!(none["warnings"][0].as_str().unwrap().contains("there is no calibration yet"), "{none}");
    assert_eq!(plan(json!({"calibration": "none"})).status, 200);
    let id = begin(&daemon).strip_prefix("/v1/calibrations/").unwrap().to_owned();
    for (name, reason) in
        [("latest", "there is none yet"), ("mine", "no calibration mine"), (id.as_str(), "name one that is completed")]
    {
        let refused = plan(json!({"calibration": name}));
        assert_eq!(refused.status, 422, "{name}: {}", refused.text);
        assert!(refused.json()["reasons"][0].as_str().unwrap().contains(reason), "{name}: {}", refused.text);
    }
    let other = Daemon::start();
    let refused = other.call("POST", "/v1/calibrations", &[JSON], "{}");
    assert_eq!(refused.status, 422);
    assert!(refused.json()["reasons"][0].as_str().unwrap().contains("no [calibration]"), "{}", refused.text);
}

#[test]
fn the_terminal_says_what_to_do_and_takes_up_a_run_that_waits() {
    let daemon = serve();
    let run = |input: &str| {
        let mut child = Command::new(env!("CARGO_BIN_EXE_rigd"))
            .args(["calibrate", "run", "--url", &daemon.url()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
        let output = child.wait_with_output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (output.status.code(), text(&output.stdout), text(&output.stderr))
    };
    let (status, out, err) = run("\n");
    assert_eq!(status, Some(1), "{out}{err}");
    assert!(out.contains("View 1 of 12: put the chessboard") && out.contains("board, view 1 of 12:"), "{out}");
    assert!(err.contains("still waits; run this again"), "{err}");
    let (status, out, err) = run("shoot\nquit\n");
    assert_eq!((status, out.matches("nothing is done: press Enter alone").count()), (Some(1), 2), "{out}{err}");
    let shots = || daemon.get("/v1/calibrations").json()["calibrations"][0]["verdicts"].as_array().unwrap().len();
    assert_eq!(shots(), 1, "words shoot nothing: {out}");
    let (status, out, err) = run("q\n");
    assert_eq!(status, Some(1), "{out}{err}");
    assert!(out.contains("is awaiting: taken up") && err.contains("is aborted"), "{out}{err}");
    let list = Command::new(env!("CARGO_BIN_EXE_rigd")).args(["calibrate", "list", "--url", &daemon.url()]).output();
    let list = String::from_utf8(list.unwrap().stdout).unwrap();
    let rows: Vec<_> = list.lines().collect();
    assert!(rows.len() == 2 && rows[1].trim_start().starts_with("1  ") && rows[1].contains("aborted"), "{list}");
}

/// What the killed daemon shot is kept, but not gone on with: board and card may have been moved since.
#[test]
fn a_run_whose_daemon_is_killed_in_an_exposure_is_interrupted_and_a_new_one_begins_at_the_first_view() {
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated-calibration").unwrap();
    // The board's exposure lasts two seconds: time to kill it in the middle.
    let text =
        text.replace("speed = 40.0", "speed = 4.0").replace("board_exposure = \"1/4\"", "board_exposure = \"8\"");
    let kept = tempfile::tempdir().unwrap();
    let data = kept.path().join("data");
    let mut daemon = Daemon::start_with(tempfile::tempdir().unwrap(), &text, &data);
    let location = begin(&daemon);
    wait(&daemon, &location, |run| run["state"] == "awaiting");
    assert_eq!(daemon.call("POST", &format!("{location}/shoot"), &[], "").status, 202);
    let until_moved = Instant::now() + PATIENCE;
    let journal =
        data.join("calibrations").join(location.strip_prefix("/v1/calibrations/").unwrap()).join("journal.jsonl");
    while !std::fs::read_to_string(&journal).unwrap().contains("arm.moved") {
        assert!(Instant::now() < until_moved);
        std::thread::sleep(Duration::from_millis(5));
    }
    daemon.kill();

    let daemon = Daemon::start_with(tempfile::tempdir().unwrap(), &text, &data);
    let run = daemon.get(&location).json();
    assert_eq!((&run["state"], &run["frames_committed"]), (&json!("interrupted"), &json!(0)), "{run}");
    assert!(run["reason"].as_str().unwrap().contains("the daemon ended"), "{run}");
    assert_eq!(daemon.call("POST", &format!("{location}/shoot"), &[], "").status, 409);
    let again = begin(&daemon);
    let waiting = wait(&daemon, &again, |run| run["state"] == "awaiting");
    assert_eq!((&waiting["version"], &waiting["step"]["view"]), (&json!(2), &json!(1)));
}

#[test]
fn a_damaged_result_is_a_problem_that_says_what_to_do() {
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated-calibration").unwrap();
    let kept = tempfile::tempdir().unwrap();
    let data = kept.path().join("data");
    let mut daemon = Daemon::start_with(tempfile::tempdir().unwrap(), text, &data);
    let location = begin(&daemon);
    wait(&daemon, &location, |run| run["state"] == "awaiting");
    let id = location.strip_prefix("/v1/calibrations/").unwrap().to_owned();
    daemon.kill();
    // A run that ended well, whose result was then cut off.
    let directory = data.join("calibrations").join(&id);
    complete(&directory.join("journal.jsonl"), &id);
    std::fs::create_dir(directory.join("result")).unwrap();
    std::fs::write(directory.join("result/calibration.json"), "{\"format\": 1, \"id\"").unwrap();
    let daemon = Daemon::start_with(tempfile::tempdir().unwrap(), text, &data);
    let problem = daemon.get(&format!("{location}/result"));
    assert_eq!(
        (problem.status, problem.header("content-type")),
        (409, Some("application/problem+json")),
        "{}",
        problem.text
    );
    let body = problem.json();
    assert_eq!(body["type"], "urn:rigd:problem:calibration-damaged");
    for word in [id.as_str(), "result/calibration.json", "calibrate anew"] {
        assert!(body["detail"].as_str().unwrap().contains(word), "{word}: {body}");
    }
    assert_eq!(daemon.get("/v1/calibrations").json()["calibrations"][0]["state"], "completed");
    let latest = daemon.call("POST", "/v1/sessions?dry_run=true", &[JSON], r#"{"calibration": "latest"}"#);
    assert_eq!(latest.status, 422, "{}", latest.text);
    let unasked = daemon.call("POST", "/v1/sessions?dry_run=true", &[JSON], "{}").json();
    assert_eq!(unasked["calibration"], Value::Null);
    assert!(unasked["warnings"][0].as_str().unwrap().contains(&id), "{unasked}");
}

/// Adds to the journal of a run that it was completed.
fn complete(path: &std::path::Path, id: &str) {
    let mut journal =
        Journal::open(path, id, true, (std::sync::Arc::new(RealDisk), std::sync::Arc::new(RealClock::default())))
            .unwrap();
    let Value::Object(fields) = json!({"state": "completed", "reason": null}) else { unreachable!() };
    journal.append("session.state", fields).unwrap();
}
