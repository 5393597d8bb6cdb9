//! What the page shows beyond sessions: the fit as it goes on, verification, the log and the settings, asked of a real daemon as any client may.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod daemon;

use daemon::{Daemon, shipped};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::time::{Duration, Instant};

const JSON: (&str, &str) = ("content-type", "application/json");
const PLAN: &str = r#"{"stations_deg": [-55, -20, 15, 50, 85], "exposures": ["1", "1/4", "1/20", "1/100"]}"#;
/// Longest wait for anything here: a failure, not a measure.
const PATIENCE: Duration = Duration::from_secs(90);

/// Events of a stream to its end: id, if it has one, and data.
fn events(daemon: &Daemon, path: &str) -> Vec<(Option<u64>, Value)> {
    let (mut all, mut id) = (Vec::new(), None);
    for line in BufReader::new(daemon.open(path, &[])).lines().map_while(Result::ok) {
        if let Some(text) = line.strip_prefix("id:") {
            id = Some(text.trim().parse().unwrap());
        }
        if let Some(text) = line.strip_prefix("data:") {
            all.push((id.take(), serde_json::from_str(text).unwrap()));
        }
    }
    all
}

/// What the system itself says of disk and memory, and what a dry run says of the plan.
#[test]
fn the_rig_tells_what_the_computer_has_and_what_its_own_plan_needs() {
    let daemon = Daemon::start();
    let rig = daemon.get("/v1/rig").json();
    let df =
        std::process::Command::new("df").args(["--output=avail", "-B1"]).arg(std::env::temp_dir()).output().unwrap();
    let avail: f64 = String::from_utf8(df.stdout).unwrap().lines().nth(1).unwrap().trim().parse().unwrap();
    let free = rig["computer"]["disk_free_bytes"].as_f64().unwrap();
    assert!((free / avail - 1.0).abs() < 0.2, "{free} bytes told, {avail} by df");
    let meminfo = std::fs::read_to_string("/proc/meminfo").unwrap();
    let total =
        meminfo.lines().find_map(|l| l.strip_prefix("MemTotal:")?.trim().strip_suffix(" kB")?.parse::<u64>().ok());
    let memory = rig["computer"]["memory_bytes"].as_u64().unwrap();
    assert!(memory > 0 && memory <= total.unwrap() * 1024, "{memory} of {total:?} kB");
    let plan = daemon.call("POST", "/v1/sessions?dry_run=true", &[JSON], "{}").json();
    assert_eq!(rig["own_plan"]["disk_bytes"], plan["estimated_bytes"]);
    assert_eq!(rig["own_plan"]["calibration"], plan["calibration"]);
    assert!(rig["own_plan"]["memory_bytes"].as_u64().unwrap() > 0);
}

fn start(daemon: &Daemon) -> String {
    let started = daemon.call("POST", "/v1/sessions", &[JSON], PLAN);
    assert_eq!(started.status, 202, "{}", started.text);
    started.header("location").unwrap().to_owned()
}

fn wait(daemon: &Daemon, path: &str, there: impl Fn(&Value) -> bool) -> Value {
    let end = Instant::now() + PATIENCE;
    loop {
        let found = daemon.get(path).json();
        if there(&found) {
            return found;
        }
        assert!(Instant::now() < end, "waited in vain: {found}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Of the records none is missing or doubled because of what is told between them, and what is told has no id.
fn assert_in_order(told: &[(Option<u64>, Value)], first: u64) {
    let ids: Vec<u64> = told.iter().filter_map(|(id, _)| *id).collect();
    assert_eq!(ids, (first..first + ids.len() as u64).collect::<Vec<_>>());
    for (id, data) in told {
        assert_eq!(id.is_none(), data["type"] == "fit.live", "{data}");
    }
    let revisions: Vec<u64> = told.iter().filter_map(|(_, data)| data["revision"].as_u64()).collect();
    assert!(!revisions.is_empty() && revisions.windows(2).all(|pair| pair[0] < pair[1]), "{revisions:?}");
}

/// Two lights do not determine the lobes: the session says of how many parameters, counted in what GET material tells.
#[test]
fn a_session_tells_how_many_parameters_are_weak() {
    let daemon = Daemon::start();
    let plan = r#"{"stations_deg": [-55, -20], "exposures": ["1", "1/4", "1/20", "1/100"]}"#;
    let started = daemon.call("POST", "/v1/sessions", &[JSON], plan);
    let location = started.header("location").unwrap().to_owned();
    let session = wait(&daemon, &location, |session| session["ended"] != Value::Null);
    let material = daemon.get(&format!("{location}/material")).json()["material"].to_string();
    let (all, sound) =
        (material.matches(r#""identified":""#).count(), material.matches(r#""identified":"identified""#).count());
    assert!(all > sound, "{material}");
    assert_eq!(session["weak_parameters"], all - sound);
}

#[test]
fn a_fit_is_watched_verified_and_fitted_again() {
    let daemon = Daemon::start();
    let location = start(&daemon);
    let (fit, verify) = (format!("{location}/fit"), format!("{location}/verify"));
    assert_eq!(daemon.get(&fit).status, 409, "nothing is fitted yet");
    assert_eq!(daemon.call("POST", &verify, &[], "").status, 409, "it goes on");
    let told = events(&daemon, &format!("{location}/events"));
    assert_in_order(&told, 1);
    assert_eq!(daemon.get(&location).json()["state"], "completed");

    let seen = daemon.get(&fit).json();
    assert_eq!((&seen["running"], &seen["step"], &seen["error"]), (&json!(false), &json!("uncertainty"), &Value::Null));
    let report = daemon.get(&format!("{location}/material")).json();
    let (material, report) = (&report["material"], &report["report"]);
    assert_eq!((&seen["points"], &seen["samples"]), (&report["pixels"], &report["samples"]));
    let last = seen["iterations"].as_array().unwrap().last().unwrap();
    assert_eq!((&last["iteration"], &last["points"]), (&report["iterations"], &report["pixels"]));
    assert_eq!(seen["candidates"].as_array().unwrap().len(), report["candidates"].as_array().unwrap().len());
    for (shown, told) in seen["materials"].as_array().unwrap().iter().zip(material["materials"].as_array().unwrap()) {
        for key in ["value", "standard_error", "identified"] {
            assert_eq!(shown["beta"][key], told["beta"][key], "{key}");
            assert_eq!(shown["rho_d"][1][key], told["rho_d"][1][key], "{key}");
        }
    }
    let map = &seen["residual_map"];
    let cells: Vec<f64> = map["cells"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
    assert_eq!(map["cells"].as_array().unwrap().len() % map["columns"].as_u64().unwrap() as usize, 0);
    let mean = cells.iter().sum::<f64>() / cells.len() as f64;
    let error = report["mean_relative_error"].as_f64().unwrap();
    assert!(
        cells.len() > 200 && (0.5 * error..2.0 * error).contains(&mean),
        "{} cells, mean {mean}, report {error}",
        cells.len()
    );

    let journalled = told.iter().filter_map(|(id, _)| *id).max().unwrap();
    let body = r#"{"materials": 2, "model": "ward", "lobe": "coloured", "gains": "off"}"#;
    assert_eq!(daemon.call("POST", &fit, &[JSON], body).status, 202);
    // The stream of a session that has ended lasts as long as its refit.
    let again = events(&daemon, &format!("{location}/events?after={journalled}"));
    assert_eq!(again.iter().rfind(|(id, _)| id.is_some()).unwrap().1["type"], "fit.finished", "{again:?}");
    assert_in_order(&again, journalled + 1);
    assert!(daemon.get(&fit).json()["revision"].as_u64() > seen["revision"].as_u64());
    let after = daemon.get(&location).json()["last_seq"].as_u64().unwrap();
    assert_eq!(daemon.get(&format!("{location}/events?after={after}")).status, 204);

    assert_eq!(
        daemon.get(&verify).json(),
        json!({"soundness": "unverified", "time": null, "frames": null, "faults": []})
    );
    assert_eq!(daemon.call("POST", &verify, &[], "").status, 202);
    let sound = wait(&daemon, &verify, |found| found["soundness"] != "verifying");
    assert_eq!((&sound["soundness"], &sound["frames"]), (&json!("sound"), &json!(20)), "{sound}");
    let record = daemon.directory(&location).join("verified.json");
    let written: Value = serde_json::from_str(&std::fs::read_to_string(&record).unwrap()).unwrap();
    assert_eq!((&written["time"], &written["frames"]), (&sound["time"], &sound["frames"]));
    let frame = daemon.directory(&location).join("frames/002-01.jpg");
    let mut bytes = std::fs::read(&frame).unwrap();
    bytes[1000] ^= 1;
    std::fs::write(&frame, bytes).unwrap();
    assert_eq!(daemon.call("POST", &verify, &[], "").status, 202);
    let damaged = wait(&daemon, &verify, |found| found["soundness"] != "verifying");
    let faults = damaged["faults"].as_array().unwrap();
    assert_eq!((&damaged["soundness"], &damaged["frames"], faults.len()), (&json!("not_sound"), &json!(19), 1));
    assert!(faults[0].as_str().unwrap().contains("002-01.jpg") && !record.exists(), "{damaged}");

    let lines = daemon.get("/v1/log?lines=500").json()["lines"].as_array().unwrap().clone();
    let said = |words: &str| lines.iter().any(|line| line["text"].as_str().unwrap().contains(words));
    assert!(said("frame.committed") && said("fit.finished") && said("not what was committed"), "{lines:?}");
    let newest = lines.last().unwrap()["seq"].as_u64().unwrap();
    assert_eq!(daemon.get(&format!("/v1/log?after={newest}")).json(), json!({"lines": []}));
    assert_eq!(daemon.get("/v1/log?lines=1").json()["lines"].as_array().unwrap().len(), 1);
    for query in [
        "lines=0",
        "lines=501",
        "lines=many",
        "after=-1",
        "after=99999999999999999999",
        "after=9007199254740992",
        "line=3",
    ] {
        assert_eq!(daemon.get(&format!("/v1/log?{query}")).status, 400, "{query}");
    }
}

#[test]
fn settings_tell_what_holds_and_nothing_secret() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
        path
    };
    let (read, control) = ("read-0123456789abcdef0123456789abcdef", "ctrl-0123456789abcdef0123456789abcdef");
    let tokens = write("tokens", &format!("# ours\nread {read}\n\ncontrol {control}\n"));
    let hook = write("hook", "http://127.0.0.1:9/hook-secret-5d41402abc4b2a76\n");
    let text = shipped().replace("# tokens = \"/etc/rigd/tokens\"", &format!("tokens = {tokens:?}"))
        + &format!(
            "\n[notify]\nwebhook_file = {hook:?}\nmail_to = \"somebody@example.org\"\nsendmail = \"/bin/true\"\n"
        );
    let data = folder.path().join("data");
    let file = folder.path().join("rig.toml");
    let daemon = Daemon::start_with(folder, &text, &data);
    let bearer = format!("Bearer {read}");
    let found = daemon.call("GET", "/v1/settings", &[("authorization", &bearer)], "");
    let settings = found.json();
    assert_eq!(settings["tokens"], json!([{"line": 2, "scope": "read"}, {"line": 4, "scope": "control"}]));
    assert_eq!(settings["file"], file.to_str().unwrap());
    let kinds: Vec<&Value> = settings["notifications"].as_array().unwrap().iter().map(|one| &one["target"]).collect();
    assert_eq!(kinds, ["webhook", "mail"]);
    let value = |key: &str| {
        let all = settings["settings"].as_array().unwrap();
        all.iter().find(|one| one["key"] == key).unwrap_or_else(|| panic!("no {key}"))["value"].clone()
    };
    // The command line wins over the file.
    assert_eq!(value("storage.data"), data.to_str().unwrap());
    assert_eq!((value("server.listen"), value("simulation.speed")), (json!("127.0.0.1:0"), json!(40.0)));
    let log = daemon.call("GET", "/v1/log?lines=500", &[("authorization", &bearer)], "");
    assert_eq!(log.status, 200);
    for secret in [read, control, "hook-secret", "somebody@example.org"] {
        assert!(!found.text.contains(secret) && !log.text.contains(secret), "{secret}");
    }
    for method in ["POST", "PUT", "DELETE"] {
        for path in ["/v1/settings", "/v1/log"] {
            let refused = daemon.call(method, path, &[("authorization", &format!("Bearer {control}"))], "");
            assert_eq!(refused.status, 405, "{method} {path}");
        }
    }
}
