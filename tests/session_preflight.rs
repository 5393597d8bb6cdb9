//! What the camera says of card and battery before a session's first frame.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rigd::devices::camera::{CameraError, Supplies};
use rigd::session::state::{SessionState as S, Verb};
use support::{Act, Fakes, begin, events, until, wait_for};

fn supplies(shots_left: u32, battery: &str) -> Supplies {
    Supplies { shots_left: Some(shots_left), battery: Some(battery.into()) }
}

#[test]
fn a_card_too_small_refuses_before_the_lamp_is_on() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    fakes.world().supplies = supplies(5, "100%");
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    let failed = wait_for(&engine, &id, S::Failed);
    let reason = failed.reason.unwrap();
    assert!(reason.contains("takes 5 more shots") && reason.contains("needs 6"), "{reason}");
    assert!(fakes.world().shots.is_empty() && !fakes.world().homed);
    fakes.assert_dark();

    fakes.world().supplies = supplies(6, "100%");
    let id = begin(&engine);
    assert!(wait_for(&engine, &id, S::Completed).warnings.is_empty());
    // The picture of the room is not worth the last frame.
    assert_eq!((fakes.world().dark_shots, events(&engine, &id, "ambient.failed").len()), (0, 1));

    fakes.world().supplies = supplies(7, "100%");
    let id = begin(&engine);
    wait_for(&engine, &id, S::Completed);
    assert_eq!((fakes.world().dark_shots, events(&engine, &id, "ambient.measured").len()), (1, 1));
}

/// A session that is taken up needs room for the rest alone, and is not lost for want of it.
#[test]
fn a_session_that_goes_on_needs_room_for_the_rest() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    fakes.on_shot(|_, count, cancel| {
        if count == 3 {
            until("the cancel", || cancel.is_cancelled());
            return Act::Fail(CameraError::Cancelled);
        }
        Act::Good
    });
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    until("the shot", || fakes.world().shots.len() == 4);
    engine.shutdown().unwrap();
    fakes.on_shot(|_, _, _| Act::Good);
    assert_eq!(engine.session(&id).unwrap().frames_committed, 3);

    // One station is whole; the half of the second is shot again with the other half.
    let left = 4;
    fakes.world().supplies = supplies(left - 1, "100%");
    let engine = fakes.engine(data.path());
    let reason = wait_for(&engine, &id, S::Interrupted).reason.unwrap();
    assert!(reason.contains(&format!("needs {left}")), "{reason}");
    fakes.world().supplies = supplies(left, "100%");
    engine.command(&id, Verb::Resume).unwrap();
    wait_for(&engine, &id, S::Completed);
}

#[test]
fn a_battery_that_may_not_last_is_a_warning() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    fakes.world().supplies = supplies(500, "50%");
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    let ended = wait_for(&engine, &id, S::Completed);
    assert_eq!(ended.warnings.len(), 1, "{:?}", ended.warnings);
    assert!(ended.warnings[0].contains("the camera's battery is at 50%"), "{:?}", ended.warnings);
    assert_eq!(events(&engine, &id, "session.doubted").len(), 1);
}
