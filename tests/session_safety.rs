//! A lamp that a clean-up could not put out: tried again until the arm is back, also by the next daemon.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rigd::devices::arm::ArmError;
use rigd::session::state::SessionState as S;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use support::{Fakes, LEVEL, begin, until, wait_for};

/// An arm that is gone from the third shot on, as long as the flag says so: its lamp, which has no dead-man, stays on.
fn vanishing(fakes: &Fakes) -> Arc<AtomicBool> {
    let gone = Arc::new(AtomicBool::new(true));
    let flag = gone.clone();
    fakes.on_arm(move |_, world| {
        (world.shots.len() > 2 && flag.load(Ordering::SeqCst))
            .then(|| ArmError::Port { port: "/dev/arm".into(), reason: "it is gone".into() })
    });
    gone
}

#[test]
fn it_is_put_out_once_the_arm_is_back() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let gone = vanishing(&fakes);
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    let ended = wait_for(&engine, &id, S::Interrupted);
    assert!(ended.reason.unwrap().contains("the lamp may be on"));
    assert_eq!(fakes.world().lamp, LEVEL);
    assert!(engine.readiness().unwrap_err()[0].contains("switch the lamp's supply off"));
    gone.store(false, Ordering::SeqCst);
    until("the lamp to go off", || fakes.world().lamp == 0);
    until("readiness", || engine.readiness().is_ok());
    fakes.assert_safe();
}

#[test]
fn the_next_daemon_knows_of_it() {
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    let gone = vanishing(&fakes);
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    wait_for(&engine, &id, S::Interrupted);
    engine.shutdown().unwrap();
    drop(engine);
    assert_eq!(fakes.world().lamp, LEVEL);
    assert!(data.path().join("lamp-may-be-on").exists());
    gone.store(false, Ordering::SeqCst);
    let engine = fakes.engine(data.path());
    until("the lamp to go off", || fakes.world().lamp == 0);
    until("the mark to go", || !data.path().join("lamp-may-be-on").exists());
    assert!(engine.readiness().is_ok());
    fakes.assert_safe();
}
