//! Whole sessions on fakes: what is on disk, what is journalled, and what the devices saw.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rigd::session::handle::{EngineError, FitRequest};
use rigd::session::plan::StartRequest;
use rigd::session::state::{SessionState as S, Verb};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use support::{Fakes, LEVEL, begin, events, wait_for};

#[test]
fn a_whole_session_reaches_completed_and_everything_is_on_disk() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    let end = wait_for(&engine, &id, S::Completed);
    assert_eq!((end.frames_committed, end.frames_planned, end.stations_developed), (6, 6, 3));
    assert_eq!((end.mean_relative_error, end.remaining_s), (Some(0.04), None));
    assert!(end.ended.is_some() && !end.simulated);
    fakes.assert_safe();

    let directory = data.path().join("sessions").join(&id);
    let frames = engine.frames(&id).unwrap();
    assert_eq!(frames.len(), 6);
    for frame in &frames {
        let bytes = std::fs::read(directory.join("frames").join(frame["file"].as_str().unwrap())).unwrap();
        assert_eq!(frame["bytes"], bytes.len());
        assert_eq!(frame["blake3"], blake3::hash(&bytes).to_hex().as_str());
        assert_eq!(frame["state"], "committed");
    }
    let names: BTreeSet<String> = frames.iter().map(|f| f["file"].as_str().unwrap().to_owned()).collect();
    assert!(names.contains("002-01.jpg"), "{names:?}");
    let manifest: Value = serde_json::from_slice(&std::fs::read(directory.join("manifest.json")).unwrap()).unwrap();
    assert_eq!((&manifest["arm"], &manifest["camera"]), (&json!("fake 1.0"), &json!("Fake EOS")));
    assert_eq!(manifest["plan"]["frames"], 6);

    let world = fakes.world();
    let expected: Vec<_> = [-20.0, 15.0, 50.0]
        .iter()
        .enumerate()
        .flat_map(|(station, &angle)| [(station, 0, LEVEL, angle), (station, 1, LEVEL, angle)])
        .collect();
    assert_eq!(world.shots, expected);
    assert_eq!((&world.developed[..], &world.fitted[..]), (&[(0, 2), (1, 2), (2, 2)][..], &[3][..]));
}

#[test]
fn events_have_no_gap_and_can_be_read_from_anywhere_while_and_after_it_runs() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let gate = fakes.gate_at(3);
    let engine = fakes.engine(data.path());
    let changes = engine.changes();
    let before = *changes.borrow();
    let id = begin(&engine);
    gate.reached();
    let live = engine.events_after(&id, 0).unwrap();
    let running = engine.session(&id).unwrap();
    assert_eq!(running.frames_committed, 3);
    assert!(running.remaining_s.unwrap() > 0.0);
    gate.open();
    wait_for(&engine, &id, S::Completed);
    let all = engine.events_after(&id, 0).unwrap();
    assert_eq!(all[..live.len()], live[..]);
    let numbers: Vec<u64> = all.iter().map(|e| e["seq"].as_u64().unwrap()).collect();
    assert_eq!(numbers, (1..=all.len() as u64).collect::<Vec<_>>());
    for k in 0..all.len() {
        assert_eq!(engine.events_after(&id, k as u64).unwrap(), all[k..]);
    }
    assert!(engine.events_after(&id, u64::MAX).unwrap().is_empty());
    support::until("the watchers to be told", || *changes.borrow() >= before + all.len() as u64);
    let states: Vec<_> = events(&engine, &id, "session.state").iter().map(|e| e["state"].clone()).collect();
    assert_eq!(states, ["preflight", "running", "fitting", "completed"]);
    for kind in ["arm.moved", "frame.committed", "station.developed", "fit.progress", "fit.finished"] {
        let found = events(&engine, &id, kind);
        assert!(!found.is_empty(), "{kind}");
        assert!(found.iter().all(|e| e["session"] == id.as_str() && e["simulated"] == false && e["time"].is_string()));
    }
}

/// Longer than what is kept in memory: the rest comes from the file, while the session runs.
#[test]
fn early_events_of_a_long_running_session_are_read_from_its_file() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let gate = fakes.gate_at(239);
    let engine = fakes.engine(data.path());
    let stations_deg = Some((0..120).map(f64::from).collect());
    let request = StartRequest { stations_deg, ..StartRequest::default() };
    let id = engine.start(&request, None).unwrap().snapshot.id;
    gate.reached();
    support::until("the stations to be developed", || engine.session(&id).unwrap().stations_developed == 119);
    let last = engine.session(&id).unwrap().last_seq;
    assert!(last > 2 * 256, "only {last} records");
    for after in [0, 1, last - 257, last - 256, last - 255, last - 1, last, last + 1] {
        let found = engine.events_after(&id, after).unwrap();
        let numbers: Vec<u64> = found.iter().map(|event| event["seq"].as_u64().unwrap()).collect();
        assert_eq!(numbers, (after + 1..=last).collect::<Vec<_>>(), "after {after}");
    }
    gate.open();
    wait_for(&engine, &id, S::Completed);
}

#[test]
fn one_session_at_a_time_and_only_verbs_that_make_sense() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let gate = fakes.gate_at(0);
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    gate.reached();
    let second = engine.start(&StartRequest::default(), None);
    assert_eq!(second, Err(EngineError::Busy { running: id.clone(), state: S::Running }));
    let allowed = vec![Verb::Pause, Verb::Stop, Verb::Abort];
    let resume = engine.command(&id, Verb::Resume);
    assert_eq!(resume, Err(EngineError::WrongState { verb: Verb::Resume, state: S::Running, allowed }));
    assert!(matches!(engine.refit(&id, &FitRequest::default()), Err(EngineError::Busy { .. })));
    assert_eq!(engine.command("nobody", Verb::Stop), Err(EngineError::UnknownSession { id: "nobody".into() }));
    gate.open();
    wait_for(&engine, &id, S::Completed);
    assert!(matches!(engine.command(&id, Verb::Abort), Err(EngineError::WrongState { .. })));
    let next = begin(&engine);
    wait_for(&engine, &next, S::Completed);
    let ids: Vec<_> = engine.sessions().into_iter().map(|s| s.id).collect();
    assert_eq!(ids, [next, id]);
}

#[test]
fn an_idempotency_key_makes_one_session_even_over_a_restart() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let engine = fakes.engine(data.path());
    let request = StartRequest { name: Some("marble".into()), ..Default::default() };
    let first = engine.start(&request, Some("key-1")).unwrap();
    assert!(!first.replayed);
    let again = engine.start(&request, Some("key-1")).unwrap();
    assert_eq!((again.replayed, &again.snapshot.id), (true, &first.snapshot.id));
    let other = StartRequest { name: Some("wood".into()), ..Default::default() };
    assert_eq!(engine.start(&other, Some("key-1")), Err(EngineError::KeyReused));
    wait_for(&engine, &first.snapshot.id, S::Completed);
    engine.shutdown().unwrap();
    drop(engine);
    let engine = fakes.engine(data.path());
    let after = engine.start(&request, Some("key-1")).unwrap();
    assert_eq!((after.replayed, after.snapshot.state, after.snapshot.id), (true, S::Completed, first.snapshot.id));
    assert_eq!(engine.start(&other, Some("key-1")), Err(EngineError::KeyReused));
    assert_eq!(engine.sessions().len(), 1);
}

#[test]
fn a_session_is_as_it_was_after_a_restart() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    let before = wait_for(&engine, &id, S::Completed);
    let (events, frames) = (engine.events_after(&id, 0).unwrap(), engine.frames(&id).unwrap());
    engine.shutdown().unwrap();
    assert_eq!(engine.start(&StartRequest::default(), None), Err(EngineError::Gone));
    drop(engine);
    let engine = fakes.engine(data.path());
    assert_eq!(engine.session(&id).unwrap(), before);
    assert_eq!((engine.events_after(&id, 0).unwrap(), engine.frames(&id).unwrap()), (events, frames));
    assert!(engine.readiness().is_ok());
}

#[test]
fn a_failed_fit_keeps_the_frames_and_a_refit_can_follow() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    fakes.on_step(|step| (step == "fit").then(|| "no valid samples".into()));
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    let end = wait_for(&engine, &id, S::Failed);
    assert!(end.reason.unwrap().contains("no valid samples"));
    assert_eq!(engine.frames(&id).unwrap().len(), 6);
    fakes.assert_safe();
    fakes.on_step(|_| None);
    let bad = FitRequest { leave_out: Some(vec![0, 3, 0]), model: Some("plastic".into()), ..Default::default() };
    match engine.refit(&id, &bad) {
        Err(EngineError::Plan(error)) => assert_eq!(error.reasons.len(), 3, "{error}"),
        other => panic!("{other:?}"),
    }
    engine.refit(&id, &FitRequest::default()).unwrap();
    support::until("the refit", || engine.session(&id).unwrap().mean_relative_error == Some(0.04));
    assert_eq!(fakes.world().fitted, [3]);
    assert_eq!(fakes.world().developed.len(), 3, "radiance on disk is not developed again");
}

#[test]
fn a_bracket_that_cannot_be_developed_ends_the_session_with_the_reason() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    fakes.on_step(|step| (step == "develop 1").then(|| "every pixel is black".into()));
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    let end = wait_for(&engine, &id, S::Failed);
    let reason = end.reason.unwrap();
    assert!(reason.contains("station 1") && reason.contains("every pixel is black"), "{reason}");
    fakes.assert_safe();
}

#[test]
fn a_plan_that_does_not_fit_on_the_disk_is_refused_with_the_bytes_needed() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let engine = fakes.engine(data.path());
    let needed = engine.plan(&StartRequest::default()).unwrap().estimated_bytes + 1000;
    fakes.disk.free.store(5000, std::sync::atomic::Ordering::SeqCst);
    let dry = engine.plan(&StartRequest::default()).map(|_| ());
    let refused = engine.start(&StartRequest::default(), None).map(|_| ());
    for refused in [dry, refused] {
        assert!(
            matches!(refused, Err(EngineError::NoSpace { needed: n, free: 5000, .. }) if n == needed),
            "{refused:?}"
        );
    }
    assert_eq!(engine.readiness().unwrap_err().len(), 1);
    assert!(engine.sessions().is_empty());
}
