//! Both arm drivers against boards that lie: positions, proofs and settings that no sound board states.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod lies;
mod line;

use firmware_protocol::Status;
use lies::Peer;
use lies::grbl::{Grbl, Seen, target};
use lies::rigproto::Rigproto;
use line::arms::{Kind, config, open};
use rig_config::{Arm as ArmConfig, ArmDriver, GrblLamp};
use rigd::devices::Cancel;
use rigd::devices::arm::{Arm, ArmError, ArmStatus};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

/// Bound on every call: far above what any of them needs, so that only a hang meets it.
const PATIENCE: Duration = Duration::from_secs(60);

/// Runs a call that must end.
fn ends<T: Send + 'static>(call: impl FnOnce() -> T + Send + 'static) -> T {
    let (send, result) = channel();
    thread::spawn(move || send.send(call()));
    result.recv_timeout(PATIENCE).expect("the call hangs")
}

type Open = Box<dyn Arm>;

fn move_to(mut arm: Open, angle_deg: f64) -> (Open, Result<ArmStatus, ArmError>) {
    ends(move || {
        let result = arm.move_to(angle_deg, &Cancel::default());
        (arm, result)
    })
}

fn home(arm: &mut Open) -> Result<ArmStatus, ArmError> {
    arm.home(&Cancel::default())
}

/// The words of a refusal or a fault.
fn words<T: std::fmt::Debug>(result: Result<T, ArmError>) -> String {
    match result {
        Err(error @ (ArmError::Refused { .. } | ArmError::Locked { .. })) => {
            let words = error.to_string();
            assert!(words.len() < 600, "{words}");
            words
        }
        other => panic!("not refused: {other:?}"),
    }
}

/// Fast, so that limits of time are short.
fn fast(kind: Kind, peer: &Peer) -> ArmConfig {
    ArmConfig { speed_deg_s: 1000.0, acceleration_deg_s2: 10_000.0, ..config(kind, peer.port()) }
}

fn rigproto(lie: impl FnMut(&mut Status, u32) + Send + 'static) -> (Peer, Open) {
    let peer = Peer::new(|heard| Rigproto::new(heard, lie));
    let arm = open(&fast(Kind::Rigproto, &peer)).unwrap();
    (peer, arm)
}

#[test]
fn a_position_that_no_arm_can_have_begins_no_move_and_bounds_no_wait() {
    for absurd in [i32::MAX, i32::MIN, 102_001, -102_001] {
        let (peer, mut arm) = rigproto(move |status, moves| {
            if status.lamp_permille > 0 {
                status.position_mdeg = absurd;
            }
            status.moving = moves > 0;
        });
        home(&mut arm).unwrap();
        assert!(!arm.set_lamp(800).unwrap().homed, "{absurd} mdeg is believed");
        let (mut arm, moved) = move_to(arm, 10.0);
        assert!(words(moved).contains("not believed"));
        assert!(peer.heard("MoveTo").is_empty());
        // What the lamp does is still proved.
        assert_eq!(arm.set_lamp(0).unwrap().lamp_permille, 0);
        assert!(arm.status().unwrap().homed);
    }
}

#[test]
fn a_position_that_no_arm_can_have_is_no_arrival_and_no_homing() {
    let (_peer, mut arm) = rigproto(|status, moves| {
        if moves > 0 {
            status.position_mdeg = i32::MAX;
        }
    });
    home(&mut arm).unwrap();
    let (mut arm, moved) = move_to(arm, 10.0);
    assert!(words(moved).contains("not believed"));
    assert!(words(home(&mut arm)).contains("not believed"));
}

#[test]
fn a_motor_that_turns_for_ever_is_given_up() {
    let (peer, mut arm) = rigproto(|status, moves| status.moving = moves > 0);
    home(&mut arm).unwrap();
    let (_arm, moved) = move_to(arm, 90.0);
    assert!(words(moved).contains("cut its power"));
    assert!(!peer.heard("Stop").is_empty());
}

#[test]
fn what_was_acknowledged_and_never_begun_is_not_done() {
    let (_peer, mut arm) = rigproto(|status, _| status.move_id = 0);
    assert!(words(home(&mut arm)).contains("did not begin"));
    // It stands at the target already, homed, and keeps the id of the first motion of an earlier run.
    let peer = Peer::new(|heard| {
        let mut board = Rigproto::new(heard, |_: &mut Status, _: u32| {});
        board.ignores = true;
        board
    });
    let mut arm = open(&fast(Kind::Rigproto, &peer)).unwrap();
    assert!(words(home(&mut arm)).contains("did not begin"));
    let (_arm, moved) = move_to(arm, 0.0);
    assert!(words(moved).contains("did not begin"));
}

#[test]
fn an_arm_that_lost_its_home_in_a_move_has_not_arrived() {
    let (_peer, mut arm) = rigproto(|status, moves| status.homed = moves == 0);
    home(&mut arm).unwrap();
    let (_arm, moved) = move_to(arm, 10.0);
    assert!(words(moved).contains("home it first"));
}

#[test]
fn another_protocol_is_refused() {
    let peer = Peer::new(|heard| {
        let mut board = Rigproto::new(heard, |_: &mut Status, _: u32| {});
        board.proto = 77;
        board
    });
    let opened = open(&fast(Kind::Rigproto, &peer)).map(|_| ());
    assert!(words(opened).contains("another protocol version"));
}

fn grbl(settings: &[(u16, &str)], lie: impl FnMut(&Seen, String) -> String + Send + 'static) -> (Peer, Open) {
    let peer = Peer::new(|heard| Grbl::new(heard, settings, lie));
    let arm = open(&fast(Kind::Grbl, &peer)).unwrap();
    (peer, arm)
}

/// A board whose outputs stay on.
fn stuck<L>(mut board: Grbl<L>) -> Grbl<L> {
    board.stuck = true;
    board
}

/// The report with another position.
fn at(report: &str, position: &str) -> String {
    let (before, after) = report.split_once("MPos:").unwrap();
    format!("{before}MPos:{position}{}", &after[after.find(',').unwrap()..])
}

#[test]
fn grbl_at_a_position_that_no_arm_can_have_begins_no_move_and_bounds_no_wait() {
    for absurd in ["1e300", "1e308", "-1e6", "9.1", "-195.1"] {
        let (peer, mut arm) = grbl(&[], move |seen, report| {
            let report = if seen.lamp_on { at(&report, absurd) } else { report };
            if seen.moves > 0 { report.replace("Idle", "Run") } else { report }
        });
        home(&mut arm).unwrap();
        assert!(!arm.set_lamp(800).unwrap().homed, "{absurd} is believed");
        let (mut arm, moved) = move_to(arm, 10.0);
        assert!(words(moved).contains("not believed"), "{absurd}");
        assert!(peer.heard("G21").is_empty());
        let status = arm.status().unwrap();
        assert_eq!((status.homed, status.lamp_permille), (false, 0), "it was not reset");
    }
}

#[test]
fn grbl_at_a_position_that_no_arm_can_have_has_not_arrived_and_is_not_homed() {
    let (_peer, mut arm) = grbl(&[], |seen, report| if seen.moves > 0 { at(&report, "1e308") } else { report });
    home(&mut arm).unwrap();
    let (mut arm, moved) = move_to(arm, 10.0);
    assert!(words(moved).contains("1e308 degrees"));
    assert!(words(home(&mut arm)).contains("after homing"));
    assert!(words(arm.move_to(10.0, &Cancel::default())).contains("home it first"));
}

#[test]
fn an_ok_to_homing_proves_none() {
    let (_peer, mut arm) = grbl(&[], |_, report| at(&report, "-50.000"));
    assert!(words(home(&mut arm)).contains("after homing it must stand at 90 degrees"));
    assert!(!arm.status().unwrap().homed);
}

#[test]
fn a_homing_whose_ok_is_lost_is_made_again_at_once() {
    let peer = Peer::new(|heard| {
        let mut board = Grbl::new(heard, &[], |_: &Seen, report: String| report);
        board.lost_ok = true;
        board
    });
    let mut arm = open(&fast(Kind::Grbl, &peer)).unwrap();
    assert!(home(&mut arm).unwrap().homed);
    assert_eq!(peer.heard("$H").len(), 2);
}

#[test]
fn a_lamp_is_off_only_by_a_sensible_speed_of_none() {
    let absent = "F:0";
    for field in [absent, "FS:0", "FS:0,", "FS:0,nan", "FS:0,-5", "FS:0,inf", "FS:0,1001", "FS:0,x", "FS:0,0"] {
        let peer = Peer::new(|heard| {
            let lie = move |seen: &Seen, report: String| {
                if seen.told_off { report.replace("FS:0,800", field) } else { report }
            };
            stuck(Grbl::new(heard, &[], lie))
        });
        let mut arm = open(&fast(Kind::Grbl, &peer)).unwrap();
        home(&mut arm).unwrap();
        assert_eq!(arm.set_lamp(800).unwrap().lamp_permille, 800);
        let said = words(arm.set_lamp(0));
        assert!(said.contains("$10=1") && said.contains("switch its supply off"), "{field}: {said}");
    }
}

#[test]
fn one_report_that_noise_spoiled_costs_another_look_and_nothing_else() {
    let (_peer, mut arm) =
        grbl(&[], |seen, report| if seen.reports % 3 > 0 { report.replace("FS:0,", "FS:0,\u{fffd}") } else { report });
    home(&mut arm).unwrap();
    assert_eq!(arm.set_lamp(800).unwrap().lamp_permille, 800);
    assert_eq!(arm.set_lamp(0).unwrap().lamp_permille, 0);
}

#[test]
fn a_lamp_on_the_coolant_output_is_off_only_by_a_report_that_lists_what_is_on() {
    type Lie = fn(String) -> String;
    let lies: [(Lie, &str); 4] = [
        (|report| report, "1000 set"),
        (|report| report.replace("|Ov:100,100,100", ""), "never states its outputs"),
        (|report| report.replace("|Ov:100,100,100|A:SF", ""), "never states its outputs"),
        (|report| report.replace("|A:SF", "|A:?"), "never states its outputs"),
    ];
    for (lie, fault) in lies {
        let peer = Peer::new(|heard| {
            let lie = move |seen: &Seen, report: String| if seen.told_off { lie(report) } else { report };
            stuck(Grbl::new(heard, &[], lie))
        });
        let driver = ArmDriver::Grbl { port: peer.port(), lamp: GrblLamp::Coolant, zero_deg: 93.0 };
        let mut arm = open(&ArmConfig { driver, ..fast(Kind::Grbl, &peer) }).unwrap();
        home(&mut arm).unwrap();
        assert_eq!(arm.set_lamp(1000).unwrap().lamp_permille, 1000);
        let said = words(arm.set_lamp(0));
        assert!(said.contains(fault), "{said}");
    }
}

#[test]
fn settings_out_of_all_reason_are_refused_before_anything_turns() {
    for (number, value) in
        [(27, "350"), (27, "-60"), (27, "nan"), (27, ""), (30, "inf"), (130, "inf"), (25, "0"), (100, "1e-300")]
    {
        let peer = Peer::new(|heard| Grbl::new(heard, &[(number, value)], |_: &Seen, report: String| report));
        let said = words(open(&fast(Kind::Grbl, &peer)).map(|_| ()));
        assert!(said.contains(&format!("send ${number}=")), "${number}={value}: {said}");
        assert!(["$H", "$J", "G"].iter().all(|motion| peer.heard(motion).is_empty()));
    }
}

#[test]
fn at_full_speed_the_arm_turns_inside_its_travel_and_slowly_no_farther_than_its_switch() {
    for (pull_off, zero_deg, start) in [("3", 93.0, -3.0), ("10", 93.0, -10.0), ("1", 99.0, -9.0), ("0.1", 90.0, -0.1)]
    {
        let peer = Peer::new(|heard| Grbl::new(heard, &[(27, pull_off)], |_: &Seen, report: String| report));
        let driver = ArmDriver::Grbl { port: peer.port(), lamp: GrblLamp::Spindle, zero_deg };
        let mut arm = open(&ArmConfig { driver, ..fast(Kind::Grbl, &peer) }).unwrap();
        home(&mut arm).unwrap();
        arm.prove_position(&Cancel::default()).unwrap();
        let fast: Vec<f64> = peer.heard("G21").iter().map(|line| target(line)).collect();
        let slow: Vec<f64> = peer.heard("$J").iter().map(|line| target(line.strip_prefix("$J").unwrap())).collect();
        assert_eq!((fast, slow), (vec![start], vec![1.3]));
    }
}
