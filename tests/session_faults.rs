//! Sessions in which something goes wrong or someone interferes. After every way out: lamp off, arm parked, devices released.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rigd::devices::arm::ArmError;
use rigd::devices::camera::CameraError;
use rigd::session::handle::EngineHandle;
use rigd::session::state::{SessionState as S, Verb};
use std::sync::atomic::Ordering;
use support::{Act, Fakes, LEVEL, SIZE, begin, events, jpeg, until, wait_for};

fn no_answer() -> ArmError {
    ArmError::NoAnswer { what: "move", waited_s: 0.75 }
}

/// Runs a session to the state given; fakes must be safe afterwards.
fn run(fakes: &Fakes, state: S, check: impl FnOnce(&EngineHandle, &str)) {
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    wait_for(&engine, &id, state);
    fakes.assert_safe();
    check(&engine, &id);
}

#[test]
fn each_kind_of_bad_frame_is_refused_for_its_reason_and_retaken() {
    type Kind = (&'static str, fn() -> Act);
    let kinds: Vec<Kind> = vec![
        ("was asked for: the body ignored the shutter speed", || Act::Jpeg(Box::new(|e| e.exposure = (1, 125)))),
        ("EXIF says f/8", || Act::Jpeg(Box::new(|e| e.f_number = (8, 1)))),
        ("EXIF says ISO 200", || Act::Jpeg(Box::new(|e| e.iso = 200))),
        ("the last frame again, byte for byte", || Act::Repeat),
        ("again", || Act::Jpeg(Box::new(|e| (e.exposure, e.number, e.iso) = ((1, 100), 2, 100)))),
        ("before the last frame", || Act::Jpeg(Box::new(|e| e.taken = "2020:01:01 00:00:00".into()))),
        ("no readable EXIF", || Act::Bytes(jpeg::encode(SIZE, None))),
        ("is no JPEG", || Act::Bytes(b"II*\0 a raw file".to_vec())),
        ("is no JPEG", || Act::Bytes(Vec::new())),
        ("64 x 48 pixels, the rig file says 32 x 24", || Act::Bytes(jpeg::encode((64, 48), None))),
        ("went to sleep", || Act::Fail(CameraError::Unusable { reason: "it went to sleep".into() })),
    ];
    for (reason, act) in kinds {
        let fakes = Fakes::default();
        // Shot 2 is station 1, exposure 0.
        fakes.on_shot(move |_, count, _| if count == 2 { act() } else { Act::Good });
        run(&fakes, S::Completed, |engine, id| {
            let rejected = events(engine, id, "frame.rejected");
            assert_eq!(rejected.len(), 1, "{reason}: {rejected:?}");
            let found = rejected[0]["reason"].as_str().unwrap();
            assert!(found.contains(reason), "{found} does not say {reason}");
            assert_eq!((&rejected[0]["station"], &rejected[0]["attempt"]), (&1.into(), &1.into()));
            let files: Vec<_> = engine.frames(id).unwrap().iter().map(|f| f["file"].clone()).collect();
            assert!(files.contains(&"001-00-a2.jpg".into()) && files.len() == 6, "{files:?}");
        });
    }
}

#[test]
fn a_file_cut_off_anywhere_is_refused() {
    let fakes = Fakes::default();
    fakes.on_shot(|shot, count, _| {
        let bytes = jpeg::encode(SIZE, Some(&jpeg::Exif::of(shot, count)));
        if count < 2 { Act::Bytes(bytes[..bytes.len() * (count + 1) / 3].to_vec()) } else { Act::Good }
    });
    run(&fakes, S::Completed, |engine, id| assert_eq!(events(engine, id, "frame.rejected").len(), 2));
}

#[test]
fn the_same_third_stop_written_differently_is_accepted() {
    let fakes = Fakes::default();
    fakes.on_shot(|shot, _, _| {
        let exact = shot.shutter.true_s;
        Act::Jpeg(Box::new(move |e| e.exposure = ((exact * 1e6).round() as u32, 1_000_000)))
    });
    run(&fakes, S::Completed, |engine, id| assert!(events(engine, id, "frame.rejected").is_empty()));
}

#[test]
fn a_body_that_stays_wrong_ends_the_session_after_two_retakes() {
    let fakes = Fakes::default();
    fakes.on_shot(
        |shot, _, _| {
            if shot.station == 1 { Act::Jpeg(Box::new(|e| e.exposure = (2, 1))) } else { Act::Good }
        },
    );
    run(&fakes, S::Interrupted, |engine, id| {
        assert_eq!(events(engine, id, "frame.rejected").len(), 3);
        let snapshot = engine.session(id).unwrap();
        let reason = snapshot.reason.unwrap();
        assert!(reason.contains("station 1, exposure 0 (1/100 s)"), "{reason}");
        assert_eq!(snapshot.frames_committed, 2);
    });
    assert!(fakes.world().fitted.is_empty());
}

#[test]
fn a_panicking_camera_driver_ends_the_session_safely() {
    let fakes = Fakes::default();
    fakes.on_shot(|_, count, _| if count >= 1 { panic!("as planned") } else { Act::Good });
    run(&fakes, S::Interrupted, |engine, id| {
        assert!(engine.session(id).unwrap().reason.unwrap().contains("driver has ended"));
    });
    assert_eq!(fakes.world().camera_opened, 4);
}

#[test]
fn a_panicking_arm_driver_ends_the_session_safely_and_the_next_one_runs() {
    let fakes = Fakes::default();
    let mut panicked = false;
    fakes.on_arm(move |call, world| {
        if call == "move" && world.shots.len() == 2 && !std::mem::replace(&mut panicked, true) {
            panic!("as planned");
        }
        None
    });
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    wait_for(&engine, &id, S::Failed);
    fakes.assert_safe();
    let reason = engine.session(&id).unwrap().reason.unwrap();
    assert!(reason.contains("internal error: as planned"), "{reason}");
    let next = begin(&engine);
    wait_for(&engine, &next, S::Completed);
    fakes.assert_safe();
}

#[test]
fn an_arm_that_stops_answering_is_recovered_and_its_station_shot_again() {
    let fakes = Fakes::default();
    let mut failed = false;
    // The status call after the second frame of station 1.
    fakes.on_arm(move |call, world| {
        let now = call == "status" && world.shots.len() == 4 && !std::mem::replace(&mut failed, true);
        now.then(no_answer)
    });
    run(&fakes, S::Completed, |engine, id| {
        assert_eq!(events(engine, id, "fault.raised").len(), 1);
        assert_eq!(events(engine, id, "fault.cleared").len(), 1);
        let frames = engine.frames(id).unwrap();
        let superseded: Vec<_> = frames.iter().filter(|f| f["state"] == "superseded").collect();
        assert_eq!((frames.len(), superseded.len()), (7, 1));
        assert_eq!(superseded[0]["file"], "001-00.jpg");
        assert_eq!(engine.session(id).unwrap().frames_committed, 6);
    });
    let world = fakes.world();
    assert_eq!(world.arm_opened, 2);
    let cells: Vec<_> = world.shots.iter().map(|s| (s.0, s.1)).collect();
    assert_eq!(cells, [(0, 0), (0, 1), (1, 0), (1, 1), (1, 0), (1, 1), (2, 0), (2, 1)]);
    assert!(world.shots.iter().all(|s| s.2 == LEVEL));
}

#[test]
fn an_arm_that_fails_four_times_ends_the_session() {
    let fakes = Fakes::default();
    fakes.on_arm(|call, world| (call == "move" && world.shots.len() == 2 && world.arm_opened <= 4).then(no_answer));
    run(&fakes, S::Interrupted, |engine, id| {
        assert_eq!(events(engine, id, "fault.raised").len(), 4);
        assert!(engine.session(id).unwrap().reason.unwrap().contains("the arm failed 4 times"));
    });
}

#[test]
fn a_blocked_arm_is_no_matter_for_trying_again() {
    let fakes = Fakes::default();
    let mut blocked = false;
    fakes.on_arm(move |call, world| {
        let now = call == "move" && world.shots.len() == 2 && !std::mem::replace(&mut blocked, true);
        now.then_some(ArmError::NotArrived { angle_deg: 3.0, target_deg: 15.0, waited_s: 4.0 })
    });
    run(&fakes, S::Interrupted, |engine, id| {
        assert!(engine.session(id).unwrap().reason.unwrap().contains("blocked arm"));
        assert!(engine.readiness().unwrap_err()[0].contains("blocked arm"));
    });
}

#[test]
fn an_arm_or_camera_that_cannot_be_opened_fails_the_session_and_readiness_says_why() {
    let fakes = Fakes::default();
    fakes.on_arm(|call, _| {
        (call == "open").then(|| ArmError::Port { port: "/dev/ttyX".into(), reason: "permission denied".into() })
    });
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    let end = wait_for(&engine, &id, S::Failed);
    assert!(end.reason.unwrap().contains("/dev/ttyX"));
    assert!(engine.readiness().unwrap_err()[0].contains("permission denied"));
    assert!(!fakes.world().camera_open);
    fakes.on_arm(|_, _| None);
    let next = begin(&engine);
    wait_for(&engine, &next, S::Completed);
    assert!(engine.readiness().is_ok());
}

#[test]
fn a_lamp_that_cannot_be_proved_off_is_said_aloud() {
    let fakes = Fakes::default();
    fakes.on_arm(|call, world| {
        if call == "status" && world.shots.len() == 6 && world.lamp == 0 {
            world.lamp = 40;
        }
        None
    });
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    let end = wait_for(&engine, &id, S::Completed);
    assert!(end.reason.unwrap().contains("switch the lamp's supply off"));
    assert_eq!(events(&engine, &id, "fault.raised").len(), 1);
}

#[test]
fn a_full_disk_suspends_and_with_room_again_nothing_is_missing() {
    for by_hand in [false, true] {
        let fakes = Fakes::default();
        let data = tempfile::tempdir().unwrap();
        let engine = fakes.engine(data.path());
        let disk = fakes.disk.clone();
        fakes.on_shot(move |_, count, _| {
            if count == 3 {
                disk.free.store(1200, Ordering::SeqCst);
            }
            Act::Good
        });
        let id = begin(&engine);
        let suspended = wait_for(&engine, &id, S::Suspended);
        assert_eq!(suspended.frames_committed, 3);
        let reason = suspended.reason.unwrap();
        assert!(reason.contains("bytes are needed and 1200 are free"), "{reason}");
        if by_hand {
            let last = suspended.last_seq;
            engine.command(&id, Verb::Resume).unwrap();
            until("a second suspension", || {
                let now = engine.session(&id).unwrap();
                now.state == S::Suspended && now.last_seq > last + 1
            });
        }
        fakes.disk.free.store(u64::MAX, Ordering::SeqCst);
        let end = wait_for(&engine, &id, S::Completed);
        assert_eq!(end.frames_committed, 6);
        assert!(!events(&engine, &id, "fault.cleared").is_empty());
        let files = std::fs::read_dir(data.path().join("sessions").join(&id).join("frames")).unwrap().count();
        assert_eq!(files, 6, "no half-written file is left");
        fakes.assert_safe();
    }
}

#[test]
fn a_disk_that_takes_not_even_a_journal_line_suspends_and_leaves_no_gap() {
    let fakes = Fakes::default();
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let disk = fakes.disk.clone();
    fakes.on_shot(move |_, count, _| {
        if count == 3 {
            disk.full.store(true, Ordering::SeqCst);
        }
        Act::Good
    });
    let id = begin(&engine);
    let suspended = wait_for(&engine, &id, S::Suspended);
    assert_eq!(suspended.frames_committed, 3);
    fakes.disk.full.store(false, Ordering::SeqCst);
    assert_eq!(wait_for(&engine, &id, S::Completed).frames_committed, 6);
    let events = engine.events_after(&id, 0).unwrap();
    assert!(events.iter().enumerate().all(|(i, e)| e["seq"] == i + 1));
    let files = std::fs::read_dir(data.path().join("sessions").join(&id).join("frames")).unwrap().count();
    assert_eq!(files, 6);
}

#[test]
fn a_session_suspended_by_a_full_disk_can_be_stopped() {
    let fakes = Fakes::default();
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let disk = fakes.disk.clone();
    fakes.on_shot(move |_, count, _| {
        if count == 3 {
            disk.free.store(0, Ordering::SeqCst);
        }
        Act::Good
    });
    let id = begin(&engine);
    wait_for(&engine, &id, S::Suspended);
    engine.command(&id, Verb::Stop).unwrap();
    wait_for(&engine, &id, S::Stopped);
    fakes.assert_safe();
    assert_eq!(fakes.world().fitted, [1]);
}

#[test]
fn a_disk_too_full_to_develop_or_to_fit_suspends_and_both_are_done_once_there_is_room() {
    for step in ["develop 1", "fit"] {
        let fakes = Fakes::default();
        let data = tempfile::tempdir().unwrap();
        let engine = fakes.engine(data.path());
        let disk = fakes.disk.clone();
        let mut full = false;
        fakes.on_step(move |now| {
            (now == step && !std::mem::replace(&mut full, true)).then(|| {
                disk.free.store(5000, Ordering::SeqCst);
                "No space left on device".into()
            })
        });
        let id = begin(&engine);
        let reason = wait_for(&engine, &id, S::Suspended).reason.unwrap();
        assert!(reason.contains("No space left") && reason.contains("5000 are free"), "{step}: {reason}");
        fakes.disk.free.store(u64::MAX, Ordering::SeqCst);
        let end = wait_for(&engine, &id, S::Completed);
        assert_eq!((end.frames_committed, end.stations_developed), (6, 3), "{step}");
        assert_eq!(fakes.world().fitted, [3], "{step}");
        fakes.assert_safe();
    }
}

#[test]
fn a_fit_suspended_by_a_full_disk_can_be_stopped_aborted_and_shut_down() {
    for (verb, state) in [(Some(Verb::Stop), S::Stopped), (Some(Verb::Abort), S::Aborted), (None, S::Interrupted)] {
        let fakes = Fakes::default();
        let data = tempfile::tempdir().unwrap();
        let engine = fakes.engine(data.path());
        let disk = fakes.disk.clone();
        fakes.on_step(move |now| {
            (now == "fit").then(|| {
                disk.free.store(0, Ordering::SeqCst);
                "No space left on device".into()
            })
        });
        let id = begin(&engine);
        wait_for(&engine, &id, S::Suspended);
        match verb {
            Some(verb) => drop(engine.command(&id, verb).unwrap()),
            None => engine.shutdown().unwrap(),
        }
        assert_eq!(wait_for(&engine, &id, state).frames_committed, 6);
        fakes.assert_safe();
    }
}

#[test]
fn a_disk_cleared_before_the_failed_develop_step_is_noticed_is_no_reason_to_fail() {
    let fakes = Fakes::default();
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    // Shot 4 is station 2, exposure 0; station 1 is developed, in vain, while it is taken.
    let gate = fakes.gate_at(4);
    let (disk, shot) = (fakes.disk.clone(), gate.clone());
    let mut full = false;
    fakes.on_step(move |now| {
        (now == "develop 1" && !std::mem::replace(&mut full, true)).then(|| {
            shot.reached();
            disk.asked.store(0, Ordering::SeqCst);
            disk.free.store(5000, Ordering::SeqCst);
            "No space left on device".into()
        })
    });
    let id = begin(&engine);
    gate.reached();
    until("the disk to fill up", || fakes.disk.free.load(Ordering::SeqCst) == 5000);
    until("the worker to look at the room", || fakes.disk.asked.load(Ordering::SeqCst) >= 2);
    fakes.disk.free.store(u64::MAX, Ordering::SeqCst);
    gate.open();
    assert_eq!(wait_for(&engine, &id, S::Completed).stations_developed, 3);
    fakes.assert_safe();
}
