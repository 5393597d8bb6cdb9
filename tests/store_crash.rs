//! The store's promises: killed at any step, changed by hand, or opened twice.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rigd::session::engine::start;
use rigd::session::state::SessionState as S;
use rigd::store::manifest::Manifest;
use rigd::store::sessions::FrameWriter;
use rigd::store::{Store, StoreError, frames};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::Ordering;
use support::{Fakes, begin, until};

/// Every journalled frame has a file of that size and hash, and nothing else lies in `frames/` but what was set aside.
fn assert_frames_hold(session: &Path, journal: &[Value], what: &str) {
    let mut files = BTreeSet::new();
    for record in journal.iter().filter(|r| r["type"] == "frame.committed") {
        let file = record["file"].as_str().unwrap();
        let bytes = std::fs::read(session.join("frames").join(file)).unwrap_or_else(|e| panic!("{what}: {file}: {e}"));
        assert_eq!(record["bytes"], bytes.len(), "{what}: {file}");
        assert_eq!(record["blake3"], blake3::hash(&bytes).to_hex().as_str(), "{what}: {file}");
        files.insert(file.to_owned());
    }
    let on_disk: BTreeSet<String> = std::fs::read_dir(session.join("frames"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| !name.ends_with(frames::ASIDE))
        .collect();
    assert_eq!(on_disk, files, "{what}: strays");
}

/// What a power cut may do to bytes that were never forced to disk: half of every temporary file is gone.
fn tear_temporary_files(data: &Path) {
    let sessions = std::fs::read_dir(data.join("sessions")).into_iter().flatten();
    for frames in sessions.filter_map(|s| std::fs::read_dir(s.unwrap().path().join("frames")).ok()) {
        for path in frames.map(|f| f.unwrap().path()).filter(|p| p.extension().is_some_and(|e| e == "tmp")) {
            let bytes = std::fs::read(&path).unwrap();
            std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        }
    }
}

#[test]
fn killed_at_every_step_of_a_session_no_acknowledged_frame_is_lost() {
    let steps = {
        let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
        let engine = fakes.engine(data.path());
        let id = begin(&engine);
        support::wait_for(&engine, &id, S::Completed);
        fakes.disk.steps.load(Ordering::SeqCst)
    };
    assert!(steps > 60, "{steps} steps: the disk is not asked");
    for step in 0..steps {
        let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
        fakes.disk.steps_left.store(i64::try_from(step).unwrap(), Ordering::SeqCst);
        let acknowledged = run_until_dead(&fakes, data.path());
        fakes.assert_dark();
        tear_temporary_files(data.path());

        let (after, mut rig) = (Fakes::default(), support::rig());
        // What was left is looked at before the session goes on.
        rig.storage.resume_at_start = false;
        let engine = after.try_engine(data.path(), rig).unwrap();
        let mut found = Vec::new();
        for session in engine.sessions() {
            let what = format!("killed at step {step} of {steps}");
            assert!(session.state.is_final(), "{what}: {:?}", session.state);
            let journal = engine.events_after(&session.id, 0).unwrap();
            assert_frames_hold(&data.path().join("sessions").join(&session.id), &journal, &what);
            found.extend(engine.frames(&session.id).unwrap());
        }
        for frame in &acknowledged {
            assert!(found.contains(frame), "killed at step {step} of {steps}: acknowledged and lost: {frame}");
        }
        engine.shutdown().unwrap();
    }
}

/// Runs a session on a disk that dies; returns the frames that were acknowledged before.
fn run_until_dead(fakes: &Fakes, data: &Path) -> Vec<Value> {
    let Ok(store) = Store::open_on(data, 0, fakes.disk.clone()) else { return Vec::new() };
    let engine = start(fakes.parts(store, support::rig(), "name = \"fake rig\"")).unwrap();
    let mut frames = Vec::new();
    if let Ok(started) = engine.start(&Default::default(), None) {
        let id = started.snapshot.id;
        until("the end of the session", || engine.session(&id).unwrap().state.is_final());
        frames = engine.frames(&id).unwrap();
    }
    engine.shutdown().unwrap();
    frames
}

fn manifest(id: &str) -> Manifest {
    let rig = support::rig();
    let plan = rigd::session::plan::CapturePlan::new(&rig, &Default::default()).unwrap();
    Manifest {
        format: 1,
        id: id.into(),
        name: "left behind".into(),
        started: "2026-11-23T12:00:00Z".into(),
        software: "test".into(),
        simulated: false,
        plan: serde_json::to_value(plan).unwrap(),
        rig_file: String::new(),
        arm: None,
        camera: None,
        idempotency: None,
        version: None,
    }
}

fn state(state: &str) -> Map<String, Value> {
    json!({"state": state, "reason": null}).as_object().unwrap().clone()
}

#[test]
fn a_session_that_a_crash_left_running_is_marked_interrupted_and_the_lamp_is_switched_off() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let directory = {
        let store = Store::open(data.path(), 0).unwrap();
        let (directory, mut journal, _) =
            store.create(&manifest("01a0-crashed"), &[], "session.state", state("preflight")).unwrap();
        journal.append("session.state", state("running")).unwrap();
        let writer: FrameWriter = store.frame_writer(&directory);
        writer.write("000-00.jpg", b"committed").unwrap();
        let frame = json!({
            "station": 0, "exposure": 0, "attempt": 1, "bracket": 1, "file": "000-00.jpg", "bytes": 9,
            "blake3": blake3::hash(b"committed").to_hex().as_str(), "shutter": "1/100", "true_s": 0.01, "taken": null,
        });
        journal.append("frame.committed", frame.as_object().unwrap().clone()).unwrap();
        writer.write("000-01.jpg", b"never acknowledged").unwrap();
        directory
    };
    std::fs::write(directory.join("frames/.000-02.jpg.tmp"), b"half").unwrap();
    std::fs::create_dir(data.path().join("sessions/.new-01a0-unborn")).unwrap();
    (fakes.world().lamp, fakes.world().homed) = (900, true);

    let engine = fakes.engine(data.path());
    let sessions = engine.sessions();
    assert_eq!((sessions.len(), sessions[0].state, sessions[0].frames_committed), (1, S::Interrupted, 1));
    assert!(sessions[0].reason.is_some());
    let events = engine.events_after("01a0-crashed", 0).unwrap();
    assert_frames_hold(&directory, &events, "after the crash");
    assert!(directory.join("frames/000-01.jpg.unacknowledged").exists());
    assert_eq!(events.last().unwrap()["state"], "interrupted");
    until("the lamp to go off", || fakes.world().lamp == 0 && !fakes.world().arm_open);
    fakes.assert_safe();
    let next = begin(&engine);
    support::wait_for(&engine, &next, S::Completed);
}

#[test]
fn a_journal_changed_by_hand_is_reported_and_left_as_it_is() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    support::wait_for(&engine, &id, S::Completed);
    engine.shutdown().unwrap();
    drop(engine);
    let path = data.path().join("sessions").join(&id).join("journal.jsonl");
    let changed = std::fs::read_to_string(&path).unwrap().replacen("\"exposure\":1", "\"exposure\":0", 1);
    std::fs::write(&path, &changed).unwrap();
    let engine = fakes.engine(data.path());
    let session = engine.session(&id).unwrap();
    assert!(session.reason.unwrap().contains("damaged: line"));
    assert_eq!(session.state, S::Interrupted);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), changed);
}

#[test]
fn a_second_store_on_the_same_directory_is_refused() {
    let data = tempfile::tempdir().unwrap();
    let first = Store::open(data.path(), 0).unwrap();
    let second = Store::open(data.path(), 0);
    match second {
        Err(error @ StoreError::Locked { .. }) => assert!(error.to_string().contains("another rigd")),
        other => panic!("{:?}", other.err()),
    }
    drop(first);
    assert!(Store::open(data.path(), 0).is_ok());
}

#[test]
fn a_frame_never_replaces_another() {
    let data = tempfile::tempdir().unwrap();
    let store = Store::open(data.path(), 0).unwrap();
    let (directory, ..) = store.create(&manifest("01a0"), &[], "session.state", state("preflight")).unwrap();
    let writer = store.frame_writer(&directory);
    writer.write("000-00.jpg", b"first").unwrap();
    assert!(matches!(writer.write("000-00.jpg", b"second"), Err(StoreError::Io { .. })));
    assert_eq!(std::fs::read(directory.join("frames/000-00.jpg")).unwrap(), b"first");
    assert_eq!(std::fs::read_dir(directory.join("frames")).unwrap().count(), 1);
}
