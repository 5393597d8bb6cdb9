//! Pause, resume, stop, abort, and the end of the daemon: in every case lamp off, arm parked, devices released.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rigd::devices::camera::CameraError;
use rigd::session::state::{SessionState as S, Verb};
use support::{Act, Fakes, LEVEL, begin, until, wait_for};

#[test]
fn pause_waits_between_frames_with_the_lamp_on_and_resume_goes_on_where_it_was() {
    let fakes = Fakes::default();
    let gate = fakes.gate_at(2);
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    gate.reached();
    assert_eq!(engine.command(&id, Verb::Pause).unwrap().state, S::Pausing);
    gate.open();
    let paused = wait_for(&engine, &id, S::Paused);
    assert_eq!(paused.frames_committed, 3);
    {
        let world = fakes.world();
        assert_eq!((world.lamp, world.angle_deg, world.shots.len()), (LEVEL, 15.0, 3));
    }
    engine.command(&id, Verb::Resume).unwrap();
    wait_for(&engine, &id, S::Completed);
    assert_eq!(fakes.world().shots.len(), 6);
    fakes.assert_safe();
}

#[test]
fn a_lamp_that_went_off_in_a_pause_means_the_bracket_is_shot_again() {
    let fakes = Fakes::default();
    let gate = fakes.gate_at(2);
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    gate.reached();
    engine.command(&id, Verb::Pause).unwrap();
    gate.open();
    wait_for(&engine, &id, S::Paused);
    fakes.world().lamp = 0;
    engine.command(&id, Verb::Resume).unwrap();
    wait_for(&engine, &id, S::Completed);
    let world = fakes.world();
    let cells: Vec<_> = world.shots.iter().map(|s| (s.0, s.1, s.2)).collect();
    assert_eq!(cells[2..5], [(1, 0, LEVEL), (1, 0, LEVEL), (1, 1, LEVEL)]);
    assert_eq!(cells.len(), 7);
}

#[test]
fn stop_finishes_the_frame_and_fits_the_complete_stations() {
    let fakes = Fakes::default();
    let gate = fakes.gate_at(4);
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    gate.reached();
    assert_eq!(engine.command(&id, Verb::Stop).unwrap().state, S::Stopping);
    gate.open();
    let end = wait_for(&engine, &id, S::Stopped);
    fakes.assert_safe();
    assert_eq!((end.frames_committed, end.mean_relative_error), (5, Some(0.04)));
    assert_eq!(fakes.world().fitted, [2]);
}

#[test]
fn stop_before_a_complete_station_fits_nothing() {
    let fakes = Fakes::default();
    let gate = fakes.gate_at(0);
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    gate.reached();
    engine.command(&id, Verb::Stop).unwrap();
    gate.open();
    wait_for(&engine, &id, S::Stopped);
    fakes.assert_safe();
    assert!(fakes.world().fitted.is_empty());
}

#[test]
fn abort_breaks_off_the_shot_and_fits_nothing() {
    let fakes = Fakes::default();
    fakes.on_shot(|_, count, cancel| {
        if count == 3 {
            until("the cancel", || cancel.is_cancelled());
            return Act::Fail(CameraError::Cancelled);
        }
        Act::Good
    });
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    until("the fourth shot", || fakes.world().shots.len() == 4);
    assert_eq!(engine.command(&id, Verb::Abort).unwrap().state, S::Aborting);
    let end = wait_for(&engine, &id, S::Aborted);
    fakes.assert_safe();
    assert_eq!(end.frames_committed, 3);
    assert!(fakes.world().fitted.is_empty());
    fakes.on_shot(|_, _, _| Act::Good);
    let next = begin(&engine);
    wait_for(&engine, &next, S::Completed);
}

#[test]
fn stop_and_abort_end_a_pause() {
    for (verb, state) in [(Verb::Stop, S::Stopped), (Verb::Abort, S::Aborted)] {
        let fakes = Fakes::default();
        let gate = fakes.gate_at(2);
        let data = tempfile::tempdir().unwrap();
        let engine = fakes.engine(data.path());
        let id = begin(&engine);
        gate.reached();
        engine.command(&id, Verb::Pause).unwrap();
        gate.open();
        wait_for(&engine, &id, S::Paused);
        engine.command(&id, verb).unwrap();
        wait_for(&engine, &id, state);
        fakes.assert_safe();
    }
}

#[test]
fn shutdown_cleans_up_and_marks_the_session_interrupted() {
    let fakes = Fakes::default();
    fakes.on_shot(|_, count, cancel| {
        if count == 3 {
            until("the cancel", || cancel.is_cancelled());
            return Act::Fail(CameraError::Cancelled);
        }
        Act::Good
    });
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    until("the fourth shot", || fakes.world().shots.len() == 4);
    engine.shutdown().unwrap();
    fakes.assert_safe();
    assert_eq!(engine.session(&id).unwrap().state, S::Interrupted);
    assert_eq!(engine.session(&id).unwrap().frames_committed, 3);
}

#[test]
fn shutdown_ends_a_pause_too() {
    let fakes = Fakes::default();
    let gate = fakes.gate_at(2);
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    gate.reached();
    engine.command(&id, Verb::Pause).unwrap();
    gate.open();
    wait_for(&engine, &id, S::Paused);
    engine.shutdown().unwrap();
    fakes.assert_safe();
    assert_eq!(engine.session(&id).unwrap().state, S::Interrupted);
}
