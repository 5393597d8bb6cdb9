//! `[notify]` of a daemon: its message arrives, its secret is nowhere else, and what cannot work is refused before the night.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod daemon;
mod receiver;

use daemon::{Daemon, serve, shipped};
use receiver::Receiver;
use serde_json::json;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Stdio};

const SECRET: &str = "k3y-that-nobody-else-may-see";

/// The shipped rig with a webhook whose address stands in a file of `folder`.
fn config(folder: &Path, address: &str, mode: u32) -> String {
    let file = folder.join("webhook");
    std::fs::write(&file, format!("{address}\n")).unwrap();
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(mode)).unwrap();
    shipped().replace("speed = 40.0", "speed = 400.0") + &format!("\n[notify]\nwebhook_file = {file:?}\n")
}

#[test]
fn a_message_arrives_and_its_secret_is_nowhere_else() {
    let hook = Receiver::start(|_| Some(200));
    let folder = tempfile::tempdir().unwrap();
    let (data, log) = (folder.path().join("data"), folder.path().join("log"));
    let text = config(folder.path(), &format!("{}/{SECRET}", hook.address), 0o600);
    let stderr = Stdio::from(std::fs::File::create(&log).unwrap());
    let mut daemon = Daemon::start_as(folder, &text, &data, |command| {
        command.args(["--listen", "127.0.0.1:0"]).env("RIGD_LOG", "trace").stderr(stderr)
    });
    // One light gives no material: the session fails, and soon.
    let plan = json!({"stations_deg": [15.0], "exposures": ["1/40", "1/8", "0.6"]}).to_string();
    let started = daemon.call("POST", "/v1/sessions", &[("content-type", "application/json")], &plan);
    assert_eq!(started.status, 202, "{}", started.text);
    let location = started.header("location").unwrap().to_owned();
    let told = hook.wait_for(1);
    assert_eq!(told[0].line, format!("POST /{SECRET} HTTP/1.1"));
    let session = daemon.get(&location).json();
    assert_eq!((&told[0].json()["event"], &told[0].json()["session"]["id"]), (&session["state"], &session["id"]));
    let metrics = loop {
        let metrics = daemon.get("/metrics").text;
        if !metrics.contains(r#"rigd_notifications_sent_total{target="webhook"} 0"#) {
            break metrics;
        }
    };
    assert!(metrics.contains(r#"rigd_notifications_sent_total{target="webhook"} 1"#), "{metrics}");
    assert!(metrics.contains(r#"rigd_notifications_failed_total{target="webhook"} 0"#), "{metrics}");
    for path in ["/v1/rig", "/openapi.json", "/metrics", &location, &format!("{location}/events")] {
        assert!(!daemon.get(path).text.contains(SECRET), "{path}");
    }
    for file in ["manifest.json", "journal.jsonl"] {
        assert!(!std::fs::read_to_string(daemon.directory(&location).join(file)).unwrap().contains(SECRET), "{file}");
    }
    assert!(daemon.terminate().success());
    let log = std::fs::read_to_string(log).unwrap();
    assert!(log.contains("a notification was sent") && !log.contains(SECRET), "{log}");
}

#[test]
fn a_test_message_says_who_takes_it() {
    let (taking, refusing) = (Receiver::start(|_| Some(200)), Receiver::start(|_| Some(403)));
    for (receiver, status, words) in [(&taking, 0, "webhook: taken"), (&refusing, 1, "it answered with status 403")] {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("rig.toml");
        std::fs::write(&file, config(folder.path(), &format!("{}/{SECRET}", receiver.address), 0o600)).unwrap();
        let out = Command::new(env!("CARGO_BIN_EXE_rigd")).args(["notify", "--config"]).arg(&file).output().unwrap();
        let said = String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr);
        assert!(out.status.code() == Some(status) && said.contains(words) && !said.contains(SECRET), "{said}");
        assert_eq!(receiver.got()[0].json()["event"], "test");
    }
}

#[test]
fn what_cannot_work_is_refused_at_the_start_and_told_by_the_check() {
    let address = format!("http://127.0.0.1:9/{SECRET}");
    for (text, mode, words) in [
        (address.as_str(), 0o644, "everyone on this machine may use it"),
        ("no address", 0o600, "holds no address"),
        ("ftp://127.0.0.1/x", 0o600, "holds no address"),
        #[cfg(not(feature = "tls"))]
        ("https://127.0.0.1/x", 0o600, "without `--features tls`"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let config = config(folder.path(), text, mode);
        let out = serve(folder.path(), &config, &folder.path().join("data")).output().unwrap();
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{said}");
        assert!(said.contains("notify.webhook_file") && said.contains(words) && !said.contains(SECRET), "{said}");
        let mut check = Command::new(env!("CARGO_BIN_EXE_rigd"));
        let out = check.args(["config", "check"]).arg(folder.path().join("rig.toml")).output().unwrap();
        let said = String::from_utf8_lossy(&out.stdout).into_owned();
        assert!(out.status.success() && said.contains("refuses it all the same") && said.contains(words), "{said}");
    }
}
