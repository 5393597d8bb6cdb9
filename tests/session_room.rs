//! The room as a session sees it before its lamp is lit.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod lamp;
mod support;

use lamp::{Stage, events, request, small_rig, wait_for};
use rigd::devices::arm::ArmError;
use rigd::session::state::{SessionState as S, Verb};
use rigd::sim::camera::Fault;
use support::Fakes;

const ANGLES_DEG: [f64; 2] = [-30.0, 10.0];
const EXPOSURES: [&str; 4] = ["1.6", "1/15", "1/6", "0.6"];
const FRAMES: usize = 8;

fn in_room(radiance: f64) -> Stage {
    let mut stage = Stage::new(small_rig(), |_| [1.0; 3]);
    stage.room = radiance;
    stage
}

/// What is journalled of the room, and the session's warnings.
fn told(stage: &Stage) -> (serde_json::Value, Vec<String>) {
    let engine = stage.engine();
    let id = engine.start(&request(&ANGLES_DEG, &EXPOSURES), None).unwrap().snapshot.id;
    let end = wait_for(&engine, &id, S::Completed);
    assert_eq!((end.frames_committed, end.refused, stage.shots()), (FRAMES, 0, FRAMES), "{:?}", end.last_refusal);
    let kept = std::fs::read_dir(stage.directory(&id).join("frames")).unwrap().count();
    assert_eq!(kept, FRAMES, "the picture of the room is not kept");
    let mut seen = events(&engine, &id, "ambient.measured");
    assert_eq!(seen.len(), 1, "{seen:?}");
    (seen.remove(0), end.warnings)
}

#[test]
fn a_dark_room_is_measured_and_nobody_is_bothered() {
    let (seen, warnings) = told(&in_room(0.0));
    assert_eq!(seen["shutter"], "1.6", "the longest exposure of the plan");
    assert!(seen["level"].as_f64().unwrap() < 2.0 && seen["share"].as_f64().unwrap() < 0.005, "{seen}");
    assert!(warnings.is_empty(), "{warnings:?}");
}

/// Radiance 1 gives level 128 in 1 s, and a display's curve gives level 64 in 0.238 of that time.
#[test]
fn room_light_is_told_by_how_much_of_a_dim_pixels_light_it_is() {
    for (radiance, matters) in [(0.001, false), (0.012, true), (0.05, true)] {
        let truth = radiance * 1.587 / 0.238;
        let (seen, warnings) = told(&in_room(radiance));
        let share = seen["share"].as_f64().unwrap();
        // The camera's own curve is steeper than the one that levels are read by.
        assert!((0.4..2.0).contains(&(share / truth)), "{share} for {truth}");
        assert_eq!(warnings.len(), usize::from(matters), "{radiance}: {seen}, {warnings:?}");
        for warning in warnings {
            assert!(warning.starts_with("the room is not dark") && warning.contains("1.6 s"), "{warning}");
        }
    }
}

/// The first frame of the session is held against the picture of the room.
#[test]
fn a_camera_that_gives_the_rooms_picture_again_is_found_out() {
    let stage = in_room(0.0);
    stage.faults.inject(Fault::OpenFor(1000));
    stage.faults.inject(Fault::RepeatLastFrame);
    let engine = stage.engine();
    let id = engine.start(&request(&ANGLES_DEG, &["1.6", "1/15", "1/6"]), None).unwrap().snapshot.id;
    let end = wait_for(&engine, &id, S::Completed);
    assert_eq!((end.frames_committed, end.refused), (6, 1));
    assert!(end.last_refusal.unwrap().contains("the last frame again"));
}

#[test]
fn a_room_that_cannot_be_seen_is_told_and_costs_nothing_else() {
    let stage = in_room(0.0);
    (0..3).for_each(|_| stage.faults.inject(Fault::TruncatedFile));
    let engine = stage.engine();
    let id = engine.start(&request(&ANGLES_DEG, &EXPOSURES), None).unwrap().snapshot.id;
    let end = wait_for(&engine, &id, S::Completed);
    assert_eq!((end.frames_committed, end.refused, stage.shots()), (FRAMES, 0, FRAMES));
    let failed = events(&engine, &id, "ambient.failed");
    assert!(failed.len() == 1 && failed[0]["reason"].as_str().unwrap().contains("cut off"), "{failed:?}");
    assert!(events(&engine, &id, "ambient.measured").is_empty());
}

/// Once a session while the lamp is off: an arm that is brought back lights it again at once, a session that goes on is a new evening.
#[test]
fn the_room_is_seen_at_the_start_and_when_a_session_goes_on_and_no_more() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let mut silent = 1;
    fakes.on_arm(move |call, world| {
        let now = call == "status" && world.shots.len() == 3 && std::mem::take(&mut silent) > 0;
        now.then_some(ArmError::NoAnswer { what: "status", waited_s: 1.0 })
    });
    let id = support::ended_after(&fakes, data.path(), &Default::default(), 5);
    assert_eq!(fakes.world().dark_shots, 1);
    let engine = fakes.engine(data.path());
    if engine.session(&id).unwrap().state == S::Interrupted {
        engine.command(&id, Verb::Resume).unwrap();
    }
    support::wait_for(&engine, &id, S::Completed);
    assert_eq!(fakes.world().dark_shots, 2);
    assert_eq!(support::events(&engine, &id, "ambient.measured").len(), 2);
    assert_eq!(support::events(&engine, &id, "fault.cleared").len(), 1);
}
