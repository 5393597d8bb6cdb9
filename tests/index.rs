//! The index of the data directory: what it says is what the journals say, whatever happens to it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod indexed;
mod support;

use indexed::{dump, engine, files, folder, from_journals, live, restore, rig, runs};
use nix::sys::resource::{Resource, getrlimit, setrlimit};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rigd::session::handle::EngineHandle;
use rigd::session::plan::StartRequest;
use rigd::session::state::SessionState as S;
use rigd::store::index::{FILE, FrameRow, Rows};
use serde_json::Value;
use std::path::Path;
use std::process::Command;
use support::{Fakes, begin, until, wait_for};

/// What an outsider reads in a journal.
fn lines(run: &Path) -> (Vec<Value>, String) {
    let text = std::fs::read_to_string(run.join("journal.jsonl")).unwrap();
    let records = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    (records, blake3::hash(text.lines().last().unwrap().as_bytes()).to_hex().to_string())
}

fn frame<'a>(rows: &'a Rows, file: &str) -> &'a FrameRow {
    rows.frames.iter().find(|frame| frame.file == file).unwrap()
}

#[test]
fn grown_alongside_it_says_what_the_journals_say() {
    let (fakes, folder) = (Fakes::default(), folder());
    let data = folder.path();
    let (engine, lived) = live(&fakes, data);
    engine.shutdown().unwrap();
    let grown = dump(data);
    assert_eq!(grown, from_journals(data));
    let ids: Vec<&str> = grown.iter().map(|rows| rows.id.as_str()).collect();
    assert_eq!(ids, [lived.resumed, lived.stopped, lived.calibration]);
    assert!(!data.join(format!("{FILE}-wal")).exists(), "it was closed");

    // Against the journals as an outsider reads them.
    for rows in &grown {
        let run = runs(data).into_iter().find(|run| run.ends_with(&rows.id)).unwrap();
        let (records, hash) = lines(&run);
        assert_eq!((usize::try_from(rows.run.records), rows.run.hash.as_ref()), (Ok(records.len()), Some(&hash)));
        let committed = || records.iter().filter(|record| record["type"] == "frame.committed");
        assert_eq!(rows.frames.len(), committed().count());
        for record in committed() {
            let row = serde_json::to_value(frame(rows, record["file"].as_str().unwrap())).unwrap();
            for key in [
                "station",
                "exposure",
                "attempt",
                "bracket",
                "angle_deg",
                "shutter",
                "true_s",
                "bytes",
                "blake3",
                "taken",
            ] {
                assert_eq!(row[key], record[key], "{key} of {}", record["file"]);
            }
        }
        let fits = records.iter().filter(|record| record["type"] == "fit.finished" && record["error"].is_null());
        let fits: Vec<Value> = fits.map(|record| record["seq"].clone()).collect();
        assert_eq!(rows.fits.iter().map(|fit| Value::from(fit.seq)).collect::<Vec<_>>(), fits);
        let state = records.iter().rfind(|record| record["type"] == "session.state").unwrap();
        assert_eq!((&state["state"], &state["time"]), (&Value::from(&*rows.run.state), &rows.run.ended.clone().into()));
    }
    // And against what is known of how they went.
    let [resumed, stopped, calibration] = &grown[..] else { panic!("{} runs", grown.len()) };
    assert_eq!((&*resumed.run.kind, &*resumed.run.state, resumed.run.frames_committed), ("session", "completed", 6));
    assert_eq!((resumed.frames.len(), resumed.fits.len()), (7, 2));
    assert_eq!(frame(resumed, "001-00.jpg").state, "superseded");
    assert_eq!(frame(resumed, "001-00-a2.jpg").state, "committed");
    assert_eq!((resumed.fits[1].mean_relative_error, resumed.run.rig.as_deref()), (Some(0.04), Some("fake rig")));
    assert_eq!((&*stopped.run.state, stopped.run.frames_planned), ("stopped", 6));
    assert_eq!((&*calibration.run.kind, calibration.run.calibration_version), ("calibration", Some(1)));
    assert_eq!((&*calibration.run.state, calibration.run.frames_committed), ("completed", 1 + 3 + 6));
}

/// A copy of it taken while the daemon has it open is what a SIGKILL or a power cut leaves; from there on somebody cuts it, overwrites it,
/// loses a file of it, or puts an older one back. Sessions go on meanwhile, and in the end it says what the journals say.
#[test]
fn whatever_becomes_of_it_no_start_is_hurt_and_it_comes_back_the_same() {
    let (fakes, folder) = (Fakes::default(), folder());
    let data = folder.path();
    let (first, _) = live(&fakes, data);
    until("the calibration in it", || files(data).len() == 3 && dump(data).len() == 3);
    let older = files(data);
    let last = begin_uncalibrated(&first);
    wait_for(&first, &last, S::Completed);
    until("the last one in it", || dump(data).len() == 4 && dump(data) == from_journals(data));
    let killed = files(data);
    first.shutdown().unwrap();
    let expected = from_journals(data);
    assert_eq!(expected.len(), 4);
    let clean = files(data);
    assert_eq!((killed.len(), clean.len()), (3, 1));
    assert!(older[0..2] != killed[0..2], "nothing was written in between");

    for seed in 0..120 {
        let mut random = StdRng::seed_from_u64(seed);
        restore(data, [&killed, &clean, &older, &clean][seed as usize % 4]);
        if seed % 4 != 2 {
            damage(data, &mut random, seed);
        }
        let captures = seed % 24 == 5;
        let engine = engine(&fakes, data, rig());
        if captures {
            let id = begin_uncalibrated(&engine);
            wait_for(&engine, &id, S::Completed);
        }
        assert!(!engine.index_fault(), "seed {seed}");
        engine.shutdown().unwrap();
        let told = if captures { from_journals(data) } else { expected.clone() };
        assert_eq!(dump(data), told, "seed {seed}");
        if captures {
            remove_newest(data);
        }
    }
}

/// The calibration of the fakes measured nothing that a session could use.
fn begin_uncalibrated(engine: &EngineHandle) -> String {
    let request = StartRequest { calibration: Some("none".into()), ..StartRequest::default() };
    engine.start(&request, None).unwrap().snapshot.id
}

/// One of the files is lost, cut at any byte, or gets noise somewhere.
fn damage(data: &Path, random: &mut StdRng, seed: u64) {
    let there = files(data);
    let (path, mut bytes) = there[random.random_range(0..there.len())].clone();
    match (seed / 4) % 4 {
        0 => return std::fs::remove_file(path).unwrap(),
        1 => bytes.truncate(random.random_range(0..=bytes.len())),
        2 => {
            let from = random.random_range(0..bytes.len());
            let to = (from + random.random_range(1..5000)).min(bytes.len());
            random.fill(&mut bytes[from..to]);
        }
        // One bit: no page's structure need suffer.
        _ => {
            let at = random.random_range(0..bytes.len());
            bytes[at] ^= 1 << random.random_range(0..8);
        }
    }
    std::fs::write(path, bytes).unwrap();
}

/// Takes the newest session away, as nobody should: the next start must not be misled by it either.
fn remove_newest(data: &Path) {
    let newest = runs(data).into_iter().rfind(|run| run.parent().unwrap().ends_with("sessions")).unwrap();
    std::fs::remove_dir_all(newest).unwrap();
}

#[test]
fn a_session_that_is_removed_after_its_time_goes_out_of_it() {
    let (fakes, folder) = (Fakes::default(), folder());
    let data = folder.path();
    let (first, lived) = live(&fakes, data);
    first.shutdown().unwrap();
    assert_eq!(indexed::said(&indexed::rigd(&["verify"], data)).0, Some(0));
    let mut keeping = rig();
    keeping.storage.keep_days = Some(1e-12);
    let engine = engine(&fakes, data, keeping);
    until("the removal", || engine.session(&lived.resumed).is_err());
    // While the daemon goes on, not only at its end.
    until("the rows to go", || dump(data).len() == 2);
    engine.shutdown().unwrap();
    let grown = dump(data);
    assert_eq!(grown, from_journals(data));
    assert!(grown.iter().all(|rows| rows.id != lived.resumed));
}

#[test]
fn one_that_cannot_be_opened_is_told_and_holds_nothing_up() {
    let (fakes, folder) = (Fakes::default(), folder());
    let data = folder.path();
    let in_its_place = data.join(FILE);
    std::fs::create_dir_all(in_its_place.join("something")).unwrap();
    let engine = engine(&fakes, data, rig());
    let id = begin(&engine);
    wait_for(&engine, &id, S::Completed);
    until("the fault", || engine.index_fault());
    assert_eq!(engine.readiness(), Ok(()), "sessions need no index");
    // Once the place is free the end of the daemon makes good for it.
    std::fs::remove_dir_all(in_its_place).unwrap();
    engine.shutdown().unwrap();
    assert!(!engine.index_fault());
    assert_eq!(dump(data), from_journals(data));
    assert_eq!(dump(data).len(), 1);
}

/// Largest file that the full disk takes, bytes: journal and frames of two sessions of the fakes, and the index of one.
const MOST: u64 = 40 << 10;
/// Set in the process whose disk is full.
const FULL: &str = "RIGD_TEST_FULL_DISK";

/// In a process of its own, of whose files none may grow beyond [`MOST`]: as on a full disk or beyond a quota, what the index writes fails.
#[test]
fn a_full_disk_ends_no_session_and_the_index_comes_once_there_is_room() {
    if std::env::var_os(FULL).is_some() {
        return live_on_a_full_disk();
    }
    let name = "a_full_disk_ends_no_session_and_the_index_comes_once_there_is_room";
    let out = Command::new("sh")
        .args(["-c", "trap '' XFSZ; exec \"$@\"", "sh"])
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", name, "--nocapture"])
        .env(FULL, "1")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success() && text.contains("1 passed"), "{:?} {text}", out.status);
}

fn live_on_a_full_disk() {
    let (fakes, folder) = (Fakes::default(), folder());
    let data = folder.path();
    let (_, hard) = getrlimit(Resource::RLIMIT_FSIZE).unwrap();
    setrlimit(Resource::RLIMIT_FSIZE, MOST, hard).unwrap();
    assert!(std::fs::write(data.join("large"), vec![0; MOST as usize + 1]).is_err(), "the disk is not full");
    let engine = engine(&fakes, data, rig());
    for _ in 0..4 {
        let id = begin(&engine);
        wait_for(&engine, &id, S::Completed);
        // Each in a transaction of its own, until one no longer fits.
        until("the index", || engine.index_fault() || dump_or_none(data).iter().any(|rows| rows.id == id));
    }
    assert!(engine.index_fault());
    setrlimit(Resource::RLIMIT_FSIZE, hard, hard).unwrap();
    engine.shutdown().unwrap();
    assert!(!engine.index_fault());
    assert_eq!(dump(data), from_journals(data));
    assert_eq!(dump(data).len(), 4);
}

/// What it says once it is there.
fn dump_or_none(data: &Path) -> Vec<Rows> {
    if data.join(FILE).exists() { dump(data) } else { Vec::new() }
}
