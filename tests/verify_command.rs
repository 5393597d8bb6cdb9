//! `rigd verify` on a session that is sound, and on the same with damage of every kind.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod daemon;

use daemon::Daemon;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn rigd(arguments: &[&str], directory: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd")).arg("verify").args(arguments).arg(directory).output().unwrap()
}

/// Faults of the one session that is found.
fn faults(directory: &Path) -> Vec<String> {
    let said = rigd(&["--json"], directory);
    let found: Vec<Value> = serde_json::from_slice(&said.stdout).unwrap();
    assert_eq!(found.len(), 1);
    let faults: Vec<String> = serde_json::from_value(found[0]["faults"].clone()).unwrap();
    assert_eq!(said.status.code(), Some(if faults.is_empty() { 0 } else { 1 }), "{faults:?}");
    faults
}

fn edit(path: &Path, change: impl FnOnce(&mut Vec<u8>)) {
    let mut bytes = std::fs::read(path).unwrap();
    change(&mut bytes);
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn damage_of_every_kind_is_named() {
    let mut daemon = Daemon::start();
    let answer = daemon.call("POST", "/v1/sessions", &[("content-type", "application/json")], "{}");
    let location = answer.header("location").unwrap().to_owned();
    daemon.wait_for_end(&location);
    assert!(daemon.terminate().success());
    let session = daemon.directory(&location);
    let data = session.parent().unwrap().parent().unwrap();

    let said = rigd(&[], data);
    let text = String::from_utf8(said.stdout).unwrap();
    assert_eq!(said.status.code(), Some(0), "{text}");
    assert!(text.contains("completed") && text.trim_end().ends_with("70 frames: sound"), "{text}");

    let record = session.join("verified.json");
    assert!(record.exists());

    let frame = session.join("frames/003-04.jpg");
    let good = std::fs::read(&frame).unwrap();
    edit(&frame, |bytes| bytes[100] ^= 1);
    assert!(faults(&session)[0].contains("003-04.jpg is not what was committed"));
    assert!(!record.exists(), "retention would take what is not sound for verified");
    edit(&frame, |bytes| bytes.truncate(100));
    assert!(faults(&session)[0].contains("has 100 bytes"));
    std::fs::remove_file(&frame).unwrap();
    assert!(faults(&session)[0].contains("cannot be read"));
    std::fs::write(&frame, good).unwrap();

    let stray = session.join("frames/099-00.jpg");
    std::fs::write(&stray, "").unwrap();
    assert!(faults(data)[0].contains("099-00.jpg: the journal does not know it"));
    std::fs::remove_file(&stray).unwrap();

    let journal = session.join("journal.jsonl");
    let whole = std::fs::read_to_string(&journal).unwrap();
    std::fs::write(&journal, whole.replacen("\"attempt\":1", "\"attempt\":3", 1)).unwrap();
    assert!(faults(&session)[0].starts_with("journal.jsonl: "));
    std::fs::write(&journal, whole).unwrap();
    assert!(faults(&session).is_empty() && record.exists());

    let nothing = rigd(&[], &session.join("frames"));
    assert_eq!(nothing.status.code(), Some(2));
    assert!(String::from_utf8(nothing.stderr).unwrap().contains("no session in it"));
}
