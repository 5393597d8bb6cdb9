//! `rigd session` against a real daemon: what it prints and with which status it ends.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod daemon;

use daemon::Daemon;
use std::process::{Command, Stdio};

/// Exit status, stdout and stderr of `rigd session ARGS`.
fn session(url: &str, args: &[&str]) -> (i32, String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_rigd")).args(["session", "--url", url]).args(args).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (out.status.code().unwrap(), text(out.stdout), text(out.stderr))
}

#[test]
fn a_session_is_started_steered_and_followed() {
    let daemon = Daemon::start();
    let url = daemon.url();
    let (status, plan, _) = session(&url, &["start", "--dry-run"]);
    assert_eq!(status, 0);
    assert_eq!(serde_json::from_str::<serde_json::Value>(&plan).unwrap()["frames"], 70);
    let (status, id, errors) = session(&url, &["start", "--name", "ball"]);
    assert_eq!(status, 0, "{errors}");
    let id = id.trim();
    let (status, _, errors) = session(&url, &["start"]);
    assert_eq!(status, 1, "a busy rig is no wrong usage");
    assert!(errors.contains(id), "{errors}");
    assert_eq!(session(&url, &["abort", id]).0, 0);
    let (status, ended, _) = session(&url, &["watch", id]);
    assert_eq!(status, 1, "an aborted session is no success");
    assert!(ended.contains("aborted") && ended.contains("ball"), "{ended}");
    let (status, _, errors) = session(&url, &["pause", id]);
    assert_eq!((status, errors.contains("nothing more can be asked")), (1, true), "{errors}");
    let (_, list, _) = session(&url, &["list"]);
    assert!(list.lines().nth(1).is_some_and(|line| line.starts_with(id)), "{list}");
    let (status, shown, _) = session(&url, &["show", id]);
    assert_eq!((status, &serde_json::from_str::<serde_json::Value>(&shown).unwrap()["state"]), (0, &"aborted".into()));
}

#[test]
fn bad_input_ends_with_status_2_and_one_message() {
    let daemon = Daemon::start();
    let url = daemon.url();
    for (url, args) in [
        (url.as_str(), &["show", "none"][..]),
        (&url, &["watch", "../rig"]),
        (&url, &["start", "--name", ""]),
        ("nonsense", &["list"]),
        (&url, &["fly"]),
    ] {
        let (status, out, errors) = session(url, args);
        assert_eq!(status, 2, "{args:?}: {errors}");
        assert!(out.is_empty() && !errors.is_empty() && !errors.contains("panicked"), "{args:?}: {errors}");
    }
}

#[test]
fn a_closed_pipe_is_no_panic() {
    let daemon = Daemon::start();
    let mut child = Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(["session", "--url", &daemon.url(), "start", "--dry-run"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let out = child.wait_with_output().unwrap();
    assert_eq!((out.status.code(), String::from_utf8(out.stderr).unwrap()), (Some(0), String::new()));
}
