//! Calibration runs on fakes: step by step with an operator, and every way out.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rig_config::{Calibration, Rig, Shutter};
use rigd::devices::camera::CameraError;
use rigd::session::handle::{CalibrationRequest, CalibrationSnapshot, EngineError, EngineHandle, Step};
use rigd::session::plan::StartRequest;
use rigd::session::state::{SessionState as S, Verb};
use serde_json::json;
use std::path::Path;
use support::{Act, Fakes, LEVEL, until};

/// Three views, two balls' stations of which one lights the card.
fn rig() -> Rig {
    let labels = ["1/100", "0.4", "1"].map(|label| Shutter::from_label(label).unwrap());
    let calibration = Calibration {
        board_columns: 9,
        board_rows: 6,
        square_mm: 5.0,
        board_views: 3,
        board_exposure: labels[1].clone(),
        board_station_deg: 15.0,
        card_reflectance: 0.18,
        card_reflectance_sigma: 0.02,
        card_side_mm: 40.0,
        balls: 3,
        ball_radius_mm: 10.0,
        stations_deg: vec![-20.0, 110.0],
        exposures: labels.to_vec(),
        max_age_days: 30.0,
    };
    Rig { calibration: Some(calibration), ..support::rig() }
}

fn engine(fakes: &Fakes, data: &Path) -> EngineHandle {
    fakes.try_engine(data, rig()).unwrap()
}

fn begin(engine: &EngineHandle) -> String {
    engine.start_calibration(&CalibrationRequest::default()).unwrap().id
}

fn wait(engine: &EngineHandle, id: &str, there: impl Fn(&CalibrationSnapshot) -> bool) -> CalibrationSnapshot {
    until("a state of the calibration", || {
        let now = engine.calibration(id).unwrap();
        assert!(there(&now) || !now.state.is_final(), "{:?}: {:?}", now.state, now.reason);
        there(&now)
    });
    engine.calibration(id).unwrap()
}

/// Waits for the operator's turn and takes it.
fn shoot(engine: &EngineHandle, id: &str, step: Step) {
    wait(engine, id, |run| run.state == S::Awaiting && run.step == step);
    engine.command_calibration(id, Verb::Shoot).unwrap();
}

fn steps() -> [Step; 5] {
    let board = |view| Step::Board { view, of: 3 };
    [board(1), board(2), board(3), Step::Card, Step::Balls]
}

#[test]
fn a_run_asks_step_by_step_and_shoots_what_each_needs() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let engine = engine(&fakes, data.path());
    assert_eq!(engine.calibration_step(), None);
    let id = begin(&engine);
    let first = wait(&engine, &id, |run| run.state == S::Awaiting);
    assert_eq!((first.version, first.steps, first.frames_planned), (1, 5, 3 + 3 + 6));
    assert!(first.instruction.unwrap().contains("View 1 of 3"));
    assert!(fakes.world().shots.is_empty(), "nothing is shot before the operator says so");
    assert_eq!(fakes.world().lamp, LEVEL, "the lamp stays warm");
    for step in steps() {
        wait(&engine, &id, |run| run.state == S::Awaiting && run.step == step);
        assert_eq!(engine.calibration_step(), Some((id.clone(), step)));
        engine.command_calibration(&id, Verb::Shoot).unwrap();
    }
    let end = wait(&engine, &id, |run| run.state == S::Completed);
    assert_eq!((end.steps_accepted, end.frames_committed, end.step), (5, 12, Step::Done));
    assert_eq!((end.instruction, engine.calibration_step()), (None, None));
    let judged: Vec<_> = end.verdicts.iter().map(|v| (v.step, v.accepted, v.found["frames"].as_u64())).collect();
    let frames = [1, 1, 1, 3, 6].map(Some);
    assert_eq!(judged, steps().into_iter().zip(frames).map(|(step, n)| (step, true, n)).collect::<Vec<_>>());
    let angles: Vec<f64> = fakes.world().shots.iter().map(|shot| shot.3).collect();
    assert_eq!(
        angles,
        [[15.0; 3], [-20.0; 3], [-20.0; 3], [110.0; 3]].concat(),
        "the card only where light falls on it"
    );
    fakes.assert_safe();
    let directory = data.path().join("calibrations").join(&id);
    for file in ["manifest.json", "journal.jsonl", "frames/000-00.jpg", "frames/005-02.jpg"] {
        assert!(directory.join(file).is_file(), "{file}");
    }
    assert!(engine.sessions().is_empty());
    assert_eq!(engine.session(&id), Err(EngineError::UnknownSession { id: id.clone() }));
}

#[test]
fn a_refused_view_is_told_and_asked_for_again() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let mut refusals = 2;
    fakes.on_step(move |step| {
        (step == "board, view 2 of 3" && refusals > 0).then(|| {
            refusals -= 1;
            "no board found: focus on the board".into()
        })
    });
    let engine = engine(&fakes, data.path());
    let id = begin(&engine);
    let board = |view| Step::Board { view, of: 3 };
    for step in [board(1), board(2), board(2), board(2), board(3), Step::Card, Step::Balls] {
        shoot(&engine, &id, step);
    }
    let end = wait(&engine, &id, |run| run.state == S::Completed);
    let accepted: Vec<bool> = end.verdicts.iter().map(|verdict| verdict.accepted).collect();
    assert_eq!(accepted, [true, false, false, true, true, true, true]);
    assert!(end.verdicts[1].reason.as_ref().unwrap().contains("no board found"));
    assert_eq!((end.steps_accepted, end.frames_committed), (5, 12), "the frames of refused views are superseded");
    let superseded = engine.frames(&id).unwrap().iter().filter(|frame| frame["state"] == "superseded").count();
    assert_eq!(superseded, 2);
    fakes.assert_safe();
}

#[test]
fn a_session_and_a_calibration_exclude_each_other_and_verbs_are_checked() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let engine = engine(&fakes, data.path());
    let id = begin(&engine);
    wait(&engine, &id, |run| run.state == S::Awaiting);
    let busy = EngineError::Busy { running: id.clone(), state: S::Awaiting };
    assert_eq!(engine.start(&StartRequest::default(), None), Err(busy.clone()));
    assert_eq!(engine.start_calibration(&CalibrationRequest::default()), Err(busy));
    for verb in [Verb::Pause, Verb::Resume, Verb::Stop] {
        let allowed = vec![Verb::Abort, Verb::Shoot];
        let wrong = EngineError::WrongState { verb, state: S::Awaiting, allowed };
        assert_eq!(engine.command_calibration(&id, verb), Err(wrong));
    }
    assert_eq!(engine.command(&id, Verb::Abort), Err(EngineError::UnknownSession { id: id.clone() }));
    engine.command_calibration(&id, Verb::Abort).unwrap();
    let end = wait(&engine, &id, |run| run.state == S::Aborted);
    assert_eq!((end.frames_committed, end.instruction), (0, None));
    fakes.assert_safe();

    let session = support::begin(&engine);
    assert!(matches!(engine.start_calibration(&CalibrationRequest::default()), Err(EngineError::Busy { .. })));
    support::wait_for(&engine, &session, S::Completed);
    let unknown = EngineError::UnknownCalibration { id: session.clone() };
    assert_eq!(engine.calibration(&session), Err(unknown.clone()));
    assert_eq!(engine.command_calibration(&session, Verb::Shoot), Err(unknown));
    let second = begin(&engine);
    assert_eq!(engine.calibration(&second).unwrap().version, 2, "an aborted run keeps its number");
    engine.shutdown().unwrap();
    assert_eq!(engine.calibration(&second).unwrap().state, S::Interrupted);
    fakes.assert_safe();
}

#[test]
fn an_abort_in_the_middle_of_a_step_and_a_fault_leave_the_rig_safe() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let gate = fakes.gate_at(4);
    let engine = engine(&fakes, data.path());
    let id = begin(&engine);
    for step in steps().into_iter().take(4) {
        shoot(&engine, &id, step);
    }
    gate.reached();
    engine.command_calibration(&id, Verb::Abort).unwrap();
    gate.open();
    wait(&engine, &id, |run| run.state == S::Aborted);
    fakes.assert_safe();

    fakes.on_step(|step| (step == "card").then(|| "fatal: the disk is gone".into()));
    let id = begin(&engine);
    for step in steps().into_iter().take(4) {
        shoot(&engine, &id, step);
    }
    until("the failure", || engine.calibration(&id).unwrap().state == S::Failed);
    assert!(engine.calibration(&id).unwrap().reason.unwrap().contains("the disk is gone"));
    fakes.assert_safe();
}

#[test]
fn an_arm_that_falls_silent_is_recovered_within_a_step() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let mut silent = 1;
    fakes.on_arm(move |call, world| {
        (call == "status" && world.shots.len() == 7 && silent > 0).then(|| {
            silent -= 1;
            rigd::devices::arm::ArmError::NoAnswer { what: "STATUS", waited_s: 1.0 }
        })
    });
    let engine = engine(&fakes, data.path());
    let id = begin(&engine);
    for step in steps() {
        shoot(&engine, &id, step);
    }
    wait(&engine, &id, |run| run.state == S::Completed);
    assert_eq!(support::events(&engine, &id, "fault.raised").len(), 1);
    assert_eq!(engine.calibration(&id).unwrap().frames_committed, 12);
    fakes.assert_safe();
}

/// Three bad frames end a session; in a calibration somebody stands there who can put it right.
#[test]
fn a_frame_fault_is_asked_again_and_a_lost_camera_ends_the_run() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    // Shots 3 to 5 are the card's first exposure.
    fakes.on_shot(|_, count, _| match count {
        3..6 => Act::Bytes(b"no picture".to_vec()),
        _ => Act::Good,
    });
    let running = engine(&fakes, data.path());
    let id = begin(&running);
    let [one, two, three, card, balls] = steps();
    for step in [one, two, three, card, card, balls] {
        shoot(&running, &id, step);
    }
    let end = wait(&running, &id, |run| run.state == S::Completed);
    let refused = &end.verdicts[3];
    let reason = refused.reason.as_ref().unwrap();
    assert!(!refused.accepted && refused.step == card, "{refused:?}");
    assert!(reason.contains("refused 3 times") && reason.contains("set the camera to JPEG"), "{reason}");
    assert_eq!((end.steps_accepted, end.frames_committed), (5, 12));
    fakes.assert_safe();

    let gone = || Act::Fail(CameraError::Unusable { reason: "unplugged".into() });
    let first = fakes.world().shots.len();
    fakes.on_shot(move |_, count, _| if count > first { gone() } else { Act::Good });
    let id = begin(&running);
    shoot(&running, &id, one);
    shoot(&running, &id, two);
    until("the failure", || running.calibration(&id).unwrap().state == S::Interrupted);
    assert!(running.calibration(&id).unwrap().reason.unwrap().contains("unplugged"));
    fakes.assert_safe();
}

/// Who starts another daemon at once must not find the directory locked, even if the worker was in the middle of something.
#[test]
fn the_data_directory_is_free_when_shutdown_returns() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    fakes.on_step(|_| {
        std::thread::sleep(std::time::Duration::from_millis(300));
        None
    });
    for _ in 0..3 {
        let running = engine(&fakes, data.path());
        let id = begin(&running);
        shoot(&running, &id, steps()[0]);
        until("the worker", || !fakes.world().judged.is_empty());
        running.shutdown().unwrap();
        assert!(rigd::store::Store::open(data.path(), 0).is_ok(), "the lock is free while a handle is still held");
        assert_eq!(running.calibration(&id).unwrap().state, S::Interrupted);
        assert_eq!(running.start_calibration(&CalibrationRequest::default()), Err(EngineError::Gone));
        fakes.world().judged.clear();
    }
}

#[test]
fn runs_are_as_they_were_after_a_restart_and_their_numbers_go_on() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let engine = engine(&fakes, data.path());
    let id = begin(&engine);
    steps().into_iter().for_each(|step| shoot(&engine, &id, step));
    let before = wait(&engine, &id, |run| run.state == S::Completed);
    let broken_off = begin(&engine);
    wait(&engine, &broken_off, |run| run.state == S::Awaiting);
    engine.shutdown().unwrap();
    drop(engine);
    let engine = fakes.try_engine(data.path(), rig()).unwrap();
    assert_eq!(engine.calibration(&id).unwrap(), before);
    assert_eq!(engine.calibration(&broken_off).unwrap().state, S::Interrupted);
    let ids: Vec<_> = engine.calibrations().into_iter().map(|run| run.id).collect();
    assert_eq!(ids, [broken_off, id]);
    let third = begin(&engine);
    assert_eq!(engine.calibration(&third).unwrap().version, 3);
    let steps: Vec<_> = support::events(&engine, &third, "session.state").iter().map(|e| e["state"].clone()).collect();
    assert_eq!(steps[0], json!("preflight"));
}

#[test]
fn a_rig_file_that_allows_no_calibration_is_told_why() {
    let (data, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
    let refusal = |rig: Rig, request: CalibrationRequest| {
        let data = data.path().join(uuid::Uuid::now_v7().to_string());
        let engine = fakes.try_engine(&data, rig).unwrap();
        match engine.start_calibration(&request) {
            Err(EngineError::Plan(error)) => error.reasons,
            other => panic!("{other:?}"),
        }
    };
    let none = refusal(support::rig(), CalibrationRequest::default());
    assert!(none[0].contains("[calibration]"), "{none:?}");
    let mut poor = rig();
    let calibration = poor.calibration.as_mut().unwrap();
    calibration.exposures.truncate(2);
    calibration.stations_deg = vec![110.0, 150.0];
    let reasons = refusal(poor, CalibrationRequest { name: Some("a\nb".into()), ..CalibrationRequest::default() });
    for expected in ["control character", "at least 3", "none stands within 70 degrees"] {
        assert!(reasons.iter().any(|reason| reason.contains(expected)), "{expected}: {reasons:?}");
    }
    assert_eq!(reasons.len(), 3);
}
