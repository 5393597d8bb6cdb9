//! `rigd verify` on a session that is sound, and on the same with damage of every kind.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod daemon;

use daemon::Daemon;
use rigd::store::index::{FILE, Reader};
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

    index_of_a_real_fit(data, &session);
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

/// What the index says of a fit is what its material.json says.
fn index_of_a_real_fit(data: &Path, session: &Path) {
    let id = session.file_name().unwrap().to_str().unwrap();
    let rows = Reader::open(data).unwrap().rows(id).unwrap().unwrap();
    assert_eq!((rows.frames.len(), rows.fits.len()), (70, 1));
    let read = |file: &str| -> Value {
        serde_json::from_slice(&std::fs::read(session.join("result").join(file)).unwrap()).unwrap()
    };
    let (material, report) = (read("material.json"), read("report.json"));
    let fit = serde_json::to_value(&rows.fits[0]).unwrap();
    assert_eq!((&fit["parameters"], &fit["model"]), (&material["materials"], &material["model"]));
    assert!(fit["parameters"][0]["beta"]["standard_error"].is_f64(), "{fit}");
    for key in ["materials", "mean_relative_error", "left_out_relative_error", "iterations", "termination"] {
        assert_eq!(fit[key], report[key], "{key}");
    }
}

/// The index of a data directory with one sound session, made by hand into one that says something else.
#[test]
fn what_the_index_says_wrongly_is_told_apart_and_cured() {
    let mut daemon = Daemon::start();
    let answer = daemon.call("POST", "/v1/sessions", &[("content-type", "application/json")], "{}");
    let location = answer.header("location").unwrap().to_owned();
    // Long before its end: the journal must be no longer than the index by chance.
    assert_eq!(daemon.call("POST", &format!("{location}/abort"), &[], "").status, 202);
    daemon.wait_for_end(&location);
    assert!(daemon.terminate().success());
    let session = daemon.directory(&location);
    let data = session.parent().unwrap().parent().unwrap();
    let index = data.join(FILE);
    let good = std::fs::read(&index).unwrap();
    let found = || -> (Option<i32>, Value) {
        let said = rigd(&["--json"], data);
        let found: Vec<Value> = serde_json::from_slice(&said.stdout).unwrap();
        assert_eq!((found.len(), &found[0]["faults"]), (1, &serde_json::json!([])));
        (said.status.code(), found[0].clone())
    };
    assert_eq!(found().1["index_faults"], serde_json::json!([]));

    for (change, told) in [
        ("UPDATE runs SET state = 'completed'", "index: the run: state is \"completed\", by the journal \"aborted\""),
        ("UPDATE runs SET hash = 'x'", "index: the run: hash is \"x\", by the journal "),
        ("UPDATE runs SET records = records + 1", "index: the run: records is "),
        (
            "INSERT INTO frames (run, file, station, exposure, attempt, bracket, shutter, true_s, bytes, blake3, state)
                SELECT run, '900-00.jpg', 900, 0, 1, 1, '1', 1.0, 1, 'x', 'committed' FROM runs",
            "index: frame 900-00.jpg is not in the journal",
        ),
        ("PRAGMA user_version = 9", "its tables are those of version 9"),
    ] {
        let changed = rusqlite::Connection::open(&index).unwrap();
        changed.execute_batch(change).unwrap();
        drop(changed);
        std::fs::remove_file(session.join("verified.json")).unwrap();
        let (status, run) = found();
        let faults = run["index_faults"].to_string();
        assert!(status == Some(1) && faults.contains(&told.replace('"', "\\\"")), "{change}: {status:?} {faults}");
        assert!(session.join("verified.json").exists(), "the frames are sound all the same");
        let text = String::from_utf8(rigd(&[], data).stderr).unwrap();
        assert!(text.contains("of 1 of 1 the index says what the journals do not: `rigd index rebuild`"), "{text}");
        let cured = Command::new(env!("CARGO_BIN_EXE_rigd")).args(["index", "rebuild"]).arg(data).output().unwrap();
        assert!(cured.status.success());
        assert!(String::from_utf8(cured.stdout).unwrap().starts_with("1 sessions and calibrations, "));
        assert_eq!((found().0, &found().1["index_faults"]), (Some(0), &serde_json::json!([])), "{change}");
    }
    std::fs::write(&index, &good).unwrap();
    let behind = rusqlite::Connection::open(&index).unwrap();
    behind.execute_batch("DELETE FROM runs; DELETE FROM frames; DELETE FROM fits").unwrap();
    drop(behind);
    let (status, run) = found();
    assert_eq!((status, &run["notes"]), (Some(0), &serde_json::json!(["the index does not have it yet"])));
    std::fs::remove_file(&index).unwrap();
    let (status, run) = found();
    assert_eq!((status, &run["notes"]), (Some(0), &serde_json::json!(["no index beside it"])));
}
