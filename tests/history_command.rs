//! `rigd history` and `rigd index rebuild`, beside a daemon and without one.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod indexed;
mod support;

use indexed::{dump, folder, live, rigd, said};
use rigd::store::index::FILE;
use serde_json::Value;
use std::path::Path;
use support::{Fakes, until};

/// Ids of the runs that are told.
fn ids(arguments: &[&str], data: &Path) -> Vec<String> {
    let out = rigd(&[&["history", "--json"], arguments].concat(), data);
    assert!(out.status.success(), "{:?}", said(&out));
    let told: Vec<Value> = serde_json::from_slice(&out.stdout).unwrap();
    told.iter().map(|run| run["run"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn questions_over_all_runs_are_answered_beside_a_daemon_and_without_one() {
    let (fakes, folder) = (Fakes::default(), folder());
    let data = folder.path();
    let (engine, lived) = live(&fakes, data);
    until("all in the index", || dump(data).len() == 3 && dump(data)[2].run.state == "completed");
    let (status, refused) = said(&rigd(&["index", "rebuild"], data));
    assert!(status == Some(1) && refused.contains("is held by a daemon"), "{refused}");
    let newest_first = [&lived.calibration, &lived.stopped, &lived.resumed].map(String::clone);
    assert_eq!(ids(&[], data), newest_first, "beside the daemon");
    engine.shutdown().unwrap();
    assert_eq!(ids(&[], data), newest_first);

    let frame = data.join("sessions").join(&lived.resumed).join("frames/001-00.jpg");
    let hash = blake3::hash(&std::fs::read(&frame).unwrap()).to_hex().to_string();
    let started = |at: usize| dump(data)[at].run.started.clone();
    let nothing: [&String; 0] = [];
    for (arguments, expected) in [
        (vec!["--state", "stopped"], vec![&lived.stopped]),
        (vec!["--state", "running"], nothing.to_vec()),
        (vec!["--calibration", "1"], vec![&lived.calibration]),
        (vec!["--calibration", &lived.calibration], vec![&lived.calibration]),
        (vec!["--calibration", "2"], nothing.to_vec()),
        (vec!["--frame", frame.to_str().unwrap()], vec![&lived.resumed]),
        (vec!["--frame", &hash.to_uppercase()], vec![&lived.resumed]),
        (vec!["--frame", &"0".repeat(64)], nothing.to_vec()),
        (vec!["--since", &started(1)], vec![&lived.calibration, &lived.stopped]),
        (vec!["--until", &started(1)], vec![&lived.resumed]),
        (vec!["--since", &started(1), "--until", &started(2)], vec![&lived.stopped]),
        (vec!["--until", "1970-01-02"], nothing.to_vec()),
        (vec!["--since", "1970-01-02", "--state", "completed"], vec![&lived.calibration, &lived.resumed]),
    ] {
        assert_eq!(ids(&arguments, data).iter().collect::<Vec<_>>(), expected, "{arguments:?}");
    }
    let day = &started(0)[..10];
    assert!(
        ids(&["--since", day, "--until", day], data).contains(&lived.resumed),
        "a date is meant from its begin to its end"
    );

    let (_, text) = said(&rigd(&["history", "--frame", &hash], data));
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[0].starts_with("started ") && lines.len() == 3, "{text}");
    let told = ["session", "completed", "6/6", "4.00 %"];
    assert!(lines[1].contains(&lived.resumed) && told.iter().all(|word| lines[1].contains(word)), "{text}");
    assert_eq!(lines[2], "  frame 001-00.jpg: station 1, exposure 0 (1/100 s), attempt 1, superseded");
    for (arguments, reason) in [
        (["--state", "done"], "no state of a session"),
        (["--since", "yesterday"], "write 2026-11-30"),
        (["--since", "2026-11-30T10:00"], "write 2026-11-30"),
        (["--frame", "abc"], "nor a blake3 hash of 64 digits"),
    ] {
        let (status, text) = said(&rigd(&[&["history"], &arguments[..]].concat(), data));
        assert!(status == Some(2) && text.contains(reason), "{arguments:?}: {text}");
    }

    // An archive that nobody may write to answers as well, and one whose index lacks runs says so.
    let grown = dump(data);
    std::fs::remove_file(data.join(FILE)).unwrap();
    let (status, text) = said(&rigd(&["history"], data));
    assert!(status == Some(2) && text.contains("rigd index rebuild"), "{text}");
    let (status, text) = said(&rigd(&["index", "rebuild"], data));
    let frames: usize = grown.iter().map(|rows| rows.frames.len()).sum();
    assert_eq!((status, text), (Some(0), format!("3 sessions and calibrations, {frames} frames, 3 fits\n")));
    assert_eq!(dump(data), grown);
    let run = data.join("sessions").join("00000000-0000-7000-8000-000000000000");
    std::fs::create_dir(&run).unwrap();
    let (status, text) = said(&rigd(&["history"], data));
    assert!(status == Some(0) && text.contains("are not in the index") && text.contains("missing=1"), "{text}");
    let (status, text) = said(&rigd(&["index", "rebuild"], data));
    assert!(status == Some(0) && text.starts_with("left out: ") && text.contains("manifest"), "{text}");
    let (status, text) = said(&rigd(&["index", "rebuild"], &data.join("nowhere")));
    assert!(status == Some(2) && text.contains("no data directory"), "{text}");
    assert!(!data.join("nowhere").exists());
}
