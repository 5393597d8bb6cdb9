//! Sessions that were interrupted and go on: by themselves when the daemon starts again, or when an operator says so.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rigd::devices::arm::ArmError;
use rigd::devices::camera::CameraError;
use rigd::session::handle::{EngineError, EngineHandle};
use rigd::session::plan::StartRequest;
use rigd::session::state::{SessionState as S, Verb};
use std::collections::BTreeSet;
use std::path::Path;
use support::{Act, Fakes, LEVEL, begin, ended_after, events, rig, until, wait_for};

/// Every cell of the plan has one frame that counts, a station's frames are of one bracket, and each was lit as planned.
fn assert_whole(fakes: &Fakes, engine: &EngineHandle, id: &str) {
    let frames = engine.frames(id).unwrap();
    let count = |f: &&serde_json::Value| f["state"] == "committed";
    let cells: BTreeSet<_> =
        frames.iter().filter(count).map(|f| (f["station"].as_u64(), f["exposure"].as_u64())).collect();
    assert_eq!((cells.len(), frames.iter().filter(count).count()), (6, 6));
    for station in 0..3 {
        let brackets: BTreeSet<_> =
            frames.iter().filter(count).filter(|f| f["station"] == station).map(|f| f["bracket"].as_u64()).collect();
        assert_eq!(brackets.len(), 1, "station {station}");
    }
    assert!(fakes.world().shots.iter().all(|shot| shot.2 == LEVEL));
    fakes.assert_safe();
}

#[test]
fn a_session_goes_on_when_the_daemon_starts_again_and_shoots_whole_stations_no_second_time() {
    for frames in 0..6 {
        let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
        let id = ended_after(&fakes, data.path(), &StartRequest::default(), frames);
        fakes.world().shots.clear();
        let engine = fakes.engine(data.path());
        let end = wait_for(&engine, &id, S::Completed);
        assert_eq!((end.frames_committed, end.ended.is_some(), end.reason), (6, true, None));
        let again: Vec<_> = fakes.world().shots.iter().map(|shot| (shot.0, shot.1)).collect();
        let want: Vec<_> = (frames / 2..3).flat_map(|station| [(station, 0), (station, 1)]).collect();
        assert_eq!(again, want, "{frames} frames before");
        assert_whole(&fakes, &engine, &id);
        assert_eq!(events(&engine, &id, "frame.committed").len(), 6 + frames % 2);
    }
}

#[test]
fn a_session_whose_frames_are_all_in_is_fitted_without_touching_the_rig() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    wait_for(&engine, &id, S::Completed);
    engine.shutdown().unwrap();
    drop(engine);
    // The journal as a crash in the middle of the fit leaves it.
    let path = data.path().join("sessions").join(&id).join("journal.jsonl");
    let text = std::fs::read_to_string(&path).unwrap();
    let fitting = text.lines().position(|line| line.contains("\"state\":\"fitting\"")).unwrap();
    let kept: Vec<&str> = text.lines().take(fitting + 1).collect();
    std::fs::write(&path, kept.join("\n") + "\n").unwrap();
    let opened = fakes.world().arm_opened;

    let engine = fakes.engine(data.path());
    wait_for(&engine, &id, S::Completed);
    let world = fakes.world();
    assert_eq!((world.fitted.len(), world.shots.len()), (2, 6));
    // By the clean-up: what the crash left of the lamp is not known.
    assert_eq!(world.arm_opened, opened + 1);
    drop(world);
    fakes.assert_safe();
}

#[test]
fn an_operator_takes_up_what_the_hardware_interrupted() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let blocked = || ArmError::NotArrived { angle_deg: 3.0, target_deg: 15.0, waited_s: 4.0 };
    let mut once = true;
    fakes.on_arm(move |call, world| {
        (call == "status" && world.shots.len() == 3 && std::mem::take(&mut once)).then(blocked)
    });
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    wait_for(&engine, &id, S::Interrupted);
    assert!(engine.readiness().is_err());
    fakes.assert_safe();
    assert_eq!(engine.command(&id, Verb::Resume).unwrap().state, S::Preflight);
    let refused = engine.command(&id, Verb::Resume).unwrap_err();
    assert!(matches!(refused, EngineError::WrongState { .. }), "{refused}");
    wait_for(&engine, &id, S::Completed);
    assert_whole(&fakes, &engine, &id);
    assert!(engine.readiness().is_ok());
    // Events of both runs, in one chain, for a client that was away.
    let all = engine.events_after(&id, 0).unwrap();
    assert!(all.iter().enumerate().all(|(i, event)| event["seq"] == i as u64 + 1));
}

#[test]
fn a_paused_session_and_one_that_is_left_to_the_operator_wait_for_him() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let gate = fakes.gate_at(2);
    let engine = fakes.engine(data.path());
    let paused = begin(&engine);
    gate.reached();
    engine.command(&paused, Verb::Pause).unwrap();
    gate.open();
    wait_for(&engine, &paused, S::Paused);
    engine.shutdown().unwrap();
    drop(engine);
    fakes.world().shots.clear();
    let left = ended_after(&fakes, data.path(), &StartRequest::default(), 3);
    fakes.world().shots.clear();

    let mut rig = rig();
    rig.storage.resume_at_start = false;
    let engine = fakes.try_engine(data.path(), rig).unwrap();
    for id in [&paused, &left] {
        assert_eq!(engine.session(id).unwrap().state, S::Interrupted);
    }
    for id in [&left, &paused] {
        engine.command(id, Verb::Resume).unwrap();
        assert!(matches!(
            engine.command(&paused, Verb::Resume),
            Err(EngineError::Busy { .. } | EngineError::WrongState { .. })
        ));
        wait_for(&engine, id, S::Completed);
        assert_whole(&fakes, &engine, id);
    }
}

#[test]
fn a_frame_that_is_no_longer_what_was_committed_is_shot_again_with_its_bracket() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let id = ended_after(&fakes, data.path(), &StartRequest::default(), 4);
    let frames = data.path().join("sessions").join(&id).join("frames");
    let mut bytes = std::fs::read(frames.join("000-01.jpg")).unwrap();
    bytes[40] ^= 1;
    std::fs::write(frames.join("000-01.jpg"), bytes).unwrap();
    std::fs::remove_file(frames.join("001-00.jpg")).unwrap();
    fakes.world().shots.clear();
    let engine = fakes.engine(data.path());
    wait_for(&engine, &id, S::Completed);
    let lost: Vec<_> =
        events(&engine, &id, "frame.lost").iter().map(|e| e["file"].as_str().unwrap().to_owned()).collect();
    assert_eq!(lost, ["000-01.jpg", "001-00.jpg"]);
    assert_eq!(fakes.world().shots.len(), 6);
    assert_whole(&fakes, &engine, &id);
    assert!(frames.join("000-01.jpg").exists(), "the damaged file is evidence");
}

#[test]
fn an_arm_that_falls_silent_while_it_is_homed_again_is_brought_back() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let id = ended_after(&fakes, data.path(), &StartRequest::default(), 3);
    let mut once = true;
    fakes.on_arm(move |call, _| {
        let silent = || ArmError::NoAnswer { what: "status", waited_s: 0.8 };
        (call == "home" && std::mem::take(&mut once)).then(silent)
    });
    let engine = fakes.engine(data.path());
    wait_for(&engine, &id, S::Completed);
    assert_eq!(events(&engine, &id, "fault.raised").len(), 1);
    assert_whole(&fakes, &engine, &id);
}

#[test]
fn another_rig_file_does_not_go_on_with_it() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let id = ended_after(&fakes, data.path(), &StartRequest::default(), 3);
    let engine = fakes.engine_of(data.path(), rig(), "name = \"another rig\"").unwrap();
    let refused = engine.command(&id, Verb::Resume).unwrap_err();
    assert!(matches!(&refused, EngineError::RigChanged { .. }), "{refused}");
    assert_eq!(engine.session(&id).unwrap().state, S::Interrupted);
}

/// A session that ends the daemon each time it is taken up must not do so for ever.
#[test]
fn the_fourth_take_up_without_a_frame_is_left_to_the_operator() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let id = ended_after(&fakes, data.path(), &StartRequest::default(), 3);
    for take_up in 1..=4 {
        let before = fakes.world().shots.len();
        fakes.on_shot(|_, _, cancel| {
            until("the cancel", || cancel.is_cancelled());
            Act::Fail(CameraError::Cancelled)
        });
        let engine = fakes.engine(data.path());
        if take_up <= 3 {
            until("a shot", || fakes.world().shots.len() > before);
        }
        engine.shutdown().unwrap();
        let went_on = fakes.world().shots.len() > before;
        assert_eq!(went_on, take_up <= 3, "take-up {take_up}");
    }
    fakes.on_shot(|_, _, _| Act::Good);
    let engine = fakes.engine(data.path());
    assert_eq!(engine.session(&id).unwrap().state, S::Interrupted);
    engine.command(&id, Verb::Resume).unwrap();
    wait_for(&engine, &id, S::Completed);
    assert_whole(&fakes, &engine, &id);
}

/// Frames are pictures: what no record knows is set aside, what is not ours is left, and a journal that says nothing costs nothing.
#[test]
fn nothing_that_may_be_a_frame_is_ever_removed() {
    type Damage = fn(Vec<u8>) -> Vec<u8>;
    let damages: [(&str, Damage); 4] = [
        ("empty", |_| Vec::new()),
        ("zeros", |bytes| vec![0; bytes.len()]),
        ("a last line that somebody wrote over", |bytes| {
            let cut = bytes[..bytes.len() - 1].iter().rposition(|&b| b == b'\n').unwrap() + 1;
            [&bytes[..cut], &vec![b'x'; bytes.len() - cut - 1], b"\n"].concat()
        }),
        ("torn", |bytes| bytes[..bytes.len() - 9].to_vec()),
    ];
    for (what, damage) in damages {
        let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
        let id = ended_after(&fakes, data.path(), &StartRequest::default(), 3);
        let session = data.path().join("sessions").join(&id);
        let journal = session.join("journal.jsonl");
        // As a crash leaves it: the last record is a committed frame.
        let text = std::fs::read_to_string(&journal).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        let frame = lines.iter().rposition(|line| line.contains("frame.committed")).unwrap();
        let kept = lines[..=frame].join("\n") + "\n";
        std::fs::write(&journal, damage(kept.into_bytes())).unwrap();
        for (name, bytes) in [("note.txt", "mine"), (".000-01.jpg.tmp", "half"), ("002-01.jpg", "whole")] {
            std::fs::write(session.join("frames").join(name), bytes).unwrap();
        }
        std::fs::create_dir(session.join("frames/lost+found")).unwrap();
        let before: BTreeSet<_> = pictures(&session);
        let engine = fakes.engine(data.path());
        let whole = engine.session(&id).unwrap();
        assert_eq!(pictures(&session), before, "{what}");
        assert!(session.join("frames/note.txt").exists() && session.join("frames/lost+found").exists(), "{what}");
        if what == "torn" {
            assert!(!session.join("frames/.000-01.jpg.tmp").exists());
            wait_for(&engine, &id, S::Completed);
            assert_whole(&fakes, &engine, &id);
        } else {
            assert!(whole.reason.unwrap().contains("damaged: line"), "{what}");
            assert_eq!(whole.state, S::Interrupted, "{what}");
        }
    }
}

/// Contents of all whole frames of a session, whatever they are called.
fn pictures(session: &Path) -> BTreeSet<Vec<u8>> {
    let files = std::fs::read_dir(session.join("frames")).unwrap().map(|entry| entry.unwrap().path());
    let whole = |path: &std::path::PathBuf| path.extension().is_some_and(|e| e == "jpg" || e == "unacknowledged");
    files.filter(whole).map(|path| std::fs::read(path).unwrap()).collect()
}

/// What is no file of ours must neither hang the daemon nor keep it down.
#[test]
fn damaged_directories_are_left_alone_and_the_rest_works() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let id = ended_after(&fakes, data.path(), &StartRequest::default(), 3);
    let shelf = data.path().join("sessions");
    let pipe = |path: &Path| nix::unistd::mkfifo(path, nix::sys::stat::Mode::S_IRWXU).unwrap();
    for (name, damage) in [
        (
            "pipe-for-a-journal",
            Box::new(|run: &Path| {
                std::fs::remove_file(run.join("journal.jsonl")).unwrap();
                pipe(&run.join("journal.jsonl"));
            }) as Box<dyn Fn(&Path)>,
        ),
        ("a-copy", Box::new(|_| {})),
        ("no-manifest", Box::new(|run| std::fs::remove_file(run.join("manifest.json")).unwrap())),
    ] {
        let run = shelf.join(name);
        std::fs::create_dir_all(run.join("frames")).unwrap();
        for file in ["manifest.json", "journal.jsonl"] {
            std::fs::copy(shelf.join(&id).join(file), run.join(file)).unwrap();
        }
        damage(&run);
    }
    std::fs::write(shelf.join(".new-x"), "no directory").unwrap();
    let frame = shelf.join(&id).join("frames/000-00.jpg");
    std::fs::remove_file(&frame).unwrap();
    pipe(&frame);
    let engine = fakes.engine(data.path());
    wait_for(&engine, &id, S::Completed);
    assert_eq!(events(&engine, &id, "frame.lost").len(), 1);
    assert_eq!(engine.sessions().len(), 1);
}

/// A port that was corrected and a comment are no other rig; another lamp is.
#[test]
fn what_does_not_change_a_picture_may_change() {
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "zheng-2008").unwrap();
    for (now, goes_on) in [
        (text.replace("settle_s = ", "# a comment\nsettle_s = 1"), true),
        (text.replace("usb-rigd_light_arm-if00", "usb-another"), true),
        (text.replace("level_permille = 1000", "level_permille = 900"), false),
        (text.replace("iso = 100", "iso = 200"), false),
    ] {
        assert_ne!(&now, text);
        let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
        let mut own = rig();
        own.storage.resume_at_start = false;
        let engine = fakes.engine_of(data.path(), own.clone(), text).unwrap();
        let gate = fakes.gate_at(3);
        let id = begin(&engine);
        gate.reached();
        let ending = std::thread::spawn({
            let engine = engine.clone();
            move || engine.shutdown().unwrap()
        });
        gate.open();
        ending.join().unwrap();
        drop(engine);
        fakes.on_shot(|_, _, _| Act::Good);
        let engine = fakes.engine_of(data.path(), own, &now).unwrap();
        match (engine.command(&id, Verb::Resume), goes_on) {
            (Ok(_), true) => drop(wait_for(&engine, &id, S::Completed)),
            (Err(EngineError::RigChanged { .. }), false) => {}
            (other, _) => panic!("{other:?}"),
        }
    }
}
