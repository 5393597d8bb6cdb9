//! The queue: order, times, repeats, failures, and the end of the daemon at every moment.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use jiff::{SignedDuration, Timestamp};
use rigd::devices::camera::CameraError;
use rigd::session::handle::{EngineError, EngineHandle, QueueRequest};
use rigd::session::plan::StartRequest;
use rigd::session::state::{SessionState as S, Verb};
use std::sync::atomic::Ordering;
use support::{Act, Fakes, begin, until, wait_for};

fn named(name: &str) -> QueueRequest {
    let session = StartRequest { name: Some(name.into()), ..StartRequest::default() };
    QueueRequest { session, ..QueueRequest::default() }
}

/// Names and states of the sessions, oldest first.
fn history(engine: &EngineHandle) -> Vec<(String, S)> {
    engine.sessions().into_iter().rev().map(|session| (session.name, session.state)).collect()
}

fn names(engine: &EngineHandle) -> Vec<String> {
    let name = |queued: rigd::session::handle::QueuedSession| queued.entry.request.session.name.unwrap();
    engine.queue().entries.into_iter().map(name).collect()
}

fn until_empty(engine: &EngineHandle) {
    until("the queue to be empty", || engine.queue().entries.is_empty());
}

fn completed(names: &[&str]) -> Vec<(String, S)> {
    names.iter().map(|name| ((*name).to_owned(), S::Completed)).collect()
}

#[test]
fn sessions_are_shot_in_order_once_the_rig_is_free() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let gate = fakes.gate_at(1);
    let engine = fakes.engine(data.path());
    begin(&engine);
    gate.reached();
    for name in ["a", "b", "c"] {
        engine.enqueue(&named(name)).unwrap();
    }
    let last = engine.queue().entries.pop().unwrap();
    assert_eq!(engine.queue_first(&last.entry.id).unwrap().entries[0].entry.id, last.entry.id);
    // Each is expected after the one before it.
    let times: Vec<_> =
        engine.queue().entries.into_iter().map(|q| (q.estimated_start.unwrap(), q.estimated_end.unwrap())).collect();
    assert!(times.windows(2).all(|pair| pair[0].0 < pair[0].1 && pair[0].1 <= pair[1].0), "{times:?}");
    let middle = engine.queue().entries.remove(2);
    assert_eq!(middle.entry.request.session.name.as_deref(), Some("b"));
    engine.dequeue(&middle.entry.id).unwrap();
    assert!(matches!(engine.dequeue(&middle.entry.id), Err(EngineError::UnknownEntry { .. })));
    assert_eq!(names(&engine), ["c", "a"]);
    gate.open();
    until_empty(&engine);
    assert_eq!(history(&engine), completed(&["fake rig", "c", "a"]));
    fakes.assert_safe();
}

#[test]
fn an_entry_runs_as_often_as_asked_and_not_before_its_time() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(data.path());
    engine.hold_queue(true).unwrap();
    let tomorrow = (Timestamp::now() + SignedDuration::from_hours(24)).to_string();
    let late = engine.enqueue(&QueueRequest { not_before: Some(tomorrow.clone()), ..named("late") }).unwrap();
    assert_eq!(late.estimated_start.unwrap(), tomorrow);
    engine.enqueue(&QueueRequest { runs: 3, every_s: Some(0.0), ..named("thrice") }).unwrap();
    engine.enqueue(&QueueRequest { runs: 2, every_s: Some(3600.0), ..named("hourly") }).unwrap();
    assert!(engine.sessions().is_empty(), "a held queue starts nothing");
    assert_eq!(engine.queue().held.as_deref(), Some("held by a user"));
    engine.hold_queue(false).unwrap();
    until("the second hourly run to be all that is left", || {
        let left: Vec<_> = engine.queue().entries.into_iter().map(|q| (q.entry.started, q.entry.last)).collect();
        left.len() == 2 && left[1].0 == 1 && left[1].1.as_ref().is_some_and(|run| run.ended.is_some())
    });
    assert_eq!(history(&engine), completed(&["thrice", "thrice", "thrice", "hourly"]));
    assert_eq!(names(&engine), ["late", "hourly"]);
    let next: Timestamp = engine.queue().entries[1].estimated_start.as_ref().unwrap().parse().unwrap();
    let wait = next.duration_since(Timestamp::now());
    assert!(wait > SignedDuration::from_mins(50) && wait <= SignedDuration::from_mins(60), "{wait}");
}

#[test]
fn a_failure_holds_the_queue_only_if_it_was_told_to() {
    for hold_on_failure in [false, true] {
        let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
        fakes.on_shot(|_, count, _| match count {
            0 => Act::Good,
            1..=3 => Act::Bytes(vec![1]),
            _ => Act::Good,
        });
        let engine = fakes.engine(data.path());
        engine.hold_queue(true).unwrap();
        engine.enqueue(&QueueRequest { hold_on_failure, ..named("bad") }).unwrap();
        engine.enqueue(&named("good")).unwrap();
        engine.hold_queue(false).unwrap();
        if hold_on_failure {
            until("the hold", || engine.queue().held.is_some());
            assert!(engine.queue().held.unwrap().contains("is interrupted: station 0"));
            assert_eq!(names(&engine), ["good"]);
            engine.hold_queue(false).unwrap();
        }
        until_empty(&engine);
        assert_eq!(history(&engine), [("bad".to_owned(), S::Interrupted), ("good".to_owned(), S::Completed)]);
    }
}

/// A rig that cannot work would fail every entry in a row.
#[test]
fn a_session_without_a_frame_makes_the_queue_wait() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    fakes.on_arm(|call, _| {
        let reason = "permission denied".to_owned();
        (call == "open").then(|| rigd::devices::arm::ArmError::Port { port: "/dev/arm".into(), reason })
    });
    let engine = fakes.engine(data.path());
    engine.enqueue(&named("first")).unwrap();
    engine.enqueue(&named("second")).unwrap();
    until("the first to fail", || names(&engine) == ["second"]);
    fakes.on_arm(|_, _| None);
    std::thread::sleep(std::time::Duration::from_millis(50));
    assert_eq!(history(&engine), [("first".to_owned(), S::Failed)]);
    assert_eq!(names(&engine), ["second"]);
}

#[test]
fn bad_requests_are_refused_with_every_reason() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(data.path());
    let mut request = QueueRequest { runs: 0, not_before: Some("soon".into()), every_s: Some(f64::NAN), ..named("") };
    request.session.stations_deg = Some(vec![1e9]);
    let Err(EngineError::Plan(error)) = engine.enqueue(&request) else { panic!("taken") };
    let said = error.reasons.join("\n");
    for part in ["runs: 0", "not_before: ", "every_s: ", "session.name: ", "session.stations_deg[0]: "] {
        assert!(said.contains(part), "{part}: {said}");
    }
    for body in [r#"{"session": ["a"]}"#, r#"{"session": null}"#, r#"{"sesion": {}}"#] {
        assert!(serde_json::from_str::<QueueRequest>(body).is_err(), "{body}");
    }
    assert_eq!(serde_json::from_str::<QueueRequest>("{}").unwrap(), QueueRequest::default());
    assert!(engine.queue().entries.is_empty());
}

/// The daemon ends while the first entry is shot; the next daemon goes on with it, and starts each entry once.
#[test]
fn it_survives_the_daemon_and_starts_nothing_twice() {
    for shots in 0..8 {
        let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
        fakes.on_shot(move |_, count, cancel| {
            if count == shots {
                until("the cancel", || cancel.is_cancelled());
                return Act::Fail(CameraError::Cancelled);
            }
            Act::Good
        });
        let engine = fakes.engine(data.path());
        for name in ["a", "b"] {
            engine.enqueue(&named(name)).unwrap();
        }
        until("the shot", || fakes.world().shots.len() == shots + 1);
        engine.shutdown().unwrap();
        drop(engine);
        fakes.on_shot(|_, _, _| Act::Good);
        let engine = fakes.engine(data.path());
        until_empty(&engine);
        assert_eq!(history(&engine), completed(&["a", "b"]), "ended at shot {shots}");
    }
}

/// The file as it is when the daemon dies between the start of a session and the line that says so.
#[test]
fn a_start_that_was_not_written_down_is_found_again() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(data.path());
    engine.hold_queue(true).unwrap();
    engine.enqueue(&named("once")).unwrap();
    let before = std::fs::read(data.path().join("queue.json")).unwrap();
    engine.hold_queue(false).unwrap();
    until_empty(&engine);
    engine.shutdown().unwrap();
    drop(engine);
    let text = String::from_utf8(before).unwrap().replace("\"held by a user\"", "null");
    std::fs::write(data.path().join("queue.json"), text).unwrap();
    let engine = fakes.engine(data.path());
    until_empty(&engine);
    assert_eq!(history(&engine), completed(&["once"]));
}

#[test]
fn an_entry_that_the_rig_no_longer_takes_is_passed_over_and_says_why() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(data.path());
    engine.hold_queue(true).unwrap();
    let mut far = named("far");
    far.session.stations_deg = Some(vec![-20.0, 120.0]);
    engine.enqueue(&far).unwrap();
    engine.enqueue(&named("near")).unwrap();
    engine.shutdown().unwrap();
    drop(engine);
    let path = data.path().join("queue.json");
    let narrowed =
        std::fs::read_to_string(&path).unwrap().replace("120.0", "1200.0").replace("\"held by a user\"", "null");
    std::fs::write(&path, narrowed).unwrap();
    let engine = fakes.engine(data.path());
    until("the rest", || names(&engine) == ["far"] && engine.sessions().iter().any(|s| s.state == S::Completed));
    let refused = engine.queue().entries.remove(0);
    assert!(refused.entry.refused.unwrap().contains("1200"), "{:?}", refused.estimated_start);
    assert_eq!(refused.estimated_start, None);
}

#[test]
fn a_file_that_is_no_queue_is_refused_and_left_alone() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    std::fs::write(data.path().join("queue.json"), "{").unwrap();
    let error = fakes.try_engine(data.path(), support::rig()).err().unwrap().to_string();
    assert!(error.contains("queue.json") && error.contains("move it away"), "{error}");
    assert_eq!(std::fs::read_to_string(data.path().join("queue.json")).unwrap(), "{");
}

/// A user's own session goes first when he is faster, and stopping it lets the queue go on.
#[test]
fn users_and_queue_share_the_rig() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let gate = fakes.gate_at(2);
    let engine = fakes.engine(data.path());
    let own = begin(&engine);
    engine.enqueue(&named("queued")).unwrap();
    gate.reached();
    engine.command(&own, Verb::Stop).unwrap();
    gate.open();
    wait_for(&engine, &own, S::Stopped);
    until_empty(&engine);
    assert_eq!(history(&engine)[1], ("queued".to_owned(), S::Completed));
}

#[test]
fn a_queue_that_waits_for_room_says_so_and_tries_at_once_when_it_is_released() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(data.path());
    fakes.disk.free.store(100, Ordering::SeqCst);
    engine.enqueue(&named("large")).unwrap();
    until("the wait", || engine.queue().waits.is_some());
    let waits = engine.queue().waits.unwrap();
    assert!(waits.contains("100 are free"), "{waits}");
    assert_eq!(engine.queue_stands(), Some(waits));
    assert!(engine.sessions().is_empty());
    assert!(matches!(engine.plan(&StartRequest::default()), Err(EngineError::NoSpace { .. })), "a dry run tells");
    fakes.disk.free.store(u64::MAX, Ordering::SeqCst);
    engine.hold_queue(false).unwrap();
    until_empty(&engine);
    assert_eq!((engine.queue().waits, engine.queue_stands()), (None, None));
    assert_eq!(history(&engine), completed(&["large"]));
}
