//! The production driver against the firmware's handler, over real bytes on a PTY.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use firmware_protocol::{Answer, DEAD_MAN_MS, Decoder, ErrorCode, Faults, Hello, Request};
use rigd::devices::Cancel;
use rigd::devices::arm::{Arm, ArmError};
use rigd::devices::rigproto::{RigprotoArm, RigprotoSettings};
use rigd::devices::serial::SerialTransport;
use rigd::sim::arm::{ArmConfig, SimulatedArm};
use rigd::sim::pose::SharedPose;
use std::path::Path;
use std::time::{Duration, Instant};

const TRAVEL_DEG: [f64; 2] = [-90.0, 90.0];
/// Bound on every wait: far above what a busy machine needs, so that only a hang meets it.
const PATIENCE: Duration = Duration::from_secs(20);

struct Bench {
    simulated: SimulatedArm,
    pose: SharedPose,
}

impl Bench {
    /// An arm whose motor runs `speed` times faster than real.
    fn new(speed: f64) -> Self {
        let pose = SharedPose::default();
        let config = ArmConfig {
            speed_deg_s: 30.0,
            acceleration_deg_s2: 100.0,
            travel_deg: TRAVEL_DEG,
            speed,
            ringing: None,
            pose: pose.clone(),
        };
        Self { simulated: SimulatedArm::spawn(config).unwrap(), pose }
    }

    fn settings(&self) -> RigprotoSettings {
        RigprotoSettings {
            port: self.simulated.port().to_owned(),
            baud: 115_200,
            speed_deg_s: 30.0,
            acceleration_deg_s2: 100.0,
            tolerance_deg: 0.02,
            travel_deg: TRAVEL_DEG,
            home_timeout_s: 60.0,
        }
    }

    fn driver(&self) -> RigprotoArm {
        RigprotoArm::open(self.settings()).unwrap()
    }

    fn homed_driver(&self) -> RigprotoArm {
        let mut arm = self.driver();
        arm.home(&Cancel::default()).unwrap();
        arm
    }
}

/// Waits until `condition` holds and says how long that took.
fn until(what: &str, mut condition: impl FnMut() -> bool) -> Duration {
    let started = Instant::now();
    while !condition() {
        assert!(started.elapsed() < PATIENCE, "{what} did not happen");
        std::thread::sleep(Duration::from_millis(2));
    }
    started.elapsed()
}

#[test]
fn home_move_and_lamp_end_where_the_truth_is() {
    let bench = Bench::new(100.0);
    let mut arm = bench.driver();
    assert!(arm.identity().firmware.contains("protocol 1"));
    assert!(!arm.status().unwrap().homed);
    let homed = arm.home(&Cancel::default()).unwrap();
    assert!(homed.homed && !homed.moving);
    for angle_deg in [-60.0, 33.333, 90.0, -89.9995] {
        let status = arm.move_to(angle_deg, &Cancel::default()).unwrap();
        assert!((status.angle_deg - angle_deg).abs() <= 0.001, "{status:?}");
        assert!((bench.pose.get().angle_deg - angle_deg).abs() <= 0.001);
    }
    assert_eq!(arm.set_lamp(800).unwrap().lamp_permille, 800);
    assert_eq!(bench.pose.get().lamp_permille, 800);
    assert_eq!(arm.set_lamp(0).unwrap().lamp_permille, 0);
    assert_eq!(bench.pose.get().lamp_permille, 0);
    assert_eq!(bench.simulated.moves_started(), 5);
}

#[test]
fn what_the_device_would_refuse_is_refused_in_words() {
    let bench = Bench::new(100.0);
    let mut arm = bench.driver();
    let refused = |result: Result<_, ArmError>, words: &str| match result {
        Err(ArmError::Refused { reason, .. }) => assert!(reason.contains(words), "{reason}"),
        other => panic!("not refused: {other:?}"),
    };
    refused(arm.move_to(10.0, &Cancel::default()), "home it first");
    arm.home(&Cancel::default()).unwrap();
    for angle_deg in [90.01, -1e300, f64::NAN, f64::INFINITY] {
        refused(arm.move_to(angle_deg, &Cancel::default()), "travel_deg");
    }
    refused(arm.set_lamp(1001), "outside the device's range");
    assert_eq!(bench.simulated.moves_started(), 1);
    drop(arm);
    let wide = RigprotoSettings { travel_deg: [-91.0, 90.0], ..bench.settings() };
    refused(RigprotoArm::open(wide).and_then(|mut arm| arm.status()), "exceeds the firmware's");
}

#[test]
fn lost_and_garbled_answers_and_noise_are_recovered_and_nothing_runs_twice() {
    let bench = Bench::new(100.0);
    let faults = bench.simulated.faults();
    faults.noise(500);
    let mut arm = bench.homed_driver();
    let mut moves = 1;
    for (round, angle_deg) in [-50.0, -10.0, 30.0, 70.0].into_iter().enumerate() {
        match round {
            0 => faults.drop_answers(2),
            1 => faults.garble_answers(2),
            2 => faults.noise(700),
            _ => {
                faults.drop_answers(1);
                faults.noise(50);
            }
        }
        let status = arm.move_to(angle_deg, &Cancel::default()).unwrap();
        moves += 1;
        assert_eq!(status.angle_deg, angle_deg);
        assert_eq!(bench.simulated.moves_started(), moves);
    }
}

#[test]
fn a_command_whose_answers_are_lost_is_executed_once() {
    let bench = Bench::new(1.0);
    let mut port = SerialTransport::open(bench.simulated.port(), 115_200).unwrap();
    assert!(matches!(talk(&mut port, Request::Hello(Hello { proto_min: 1, proto_max: 1 }), 1), Answer::HelloAck(_)));
    bench.simulated.faults().drop_answers(1);
    assert_eq!(talk(&mut port, Request::Home { move_id: 1 }, 2), Answer::Accepted);
    assert_eq!(bench.simulated.moves_started(), 1);
    assert_eq!(talk(&mut port, Request::Home { move_id: 2 }, 3), Answer::Error(ErrorCode::Busy));
}

/// Sends until an answer comes, always with the same sequence number.
fn talk(port: &mut SerialTransport, request: Request, seq: u16) -> Answer {
    let mut decoder = Decoder::default();
    let mut buffer = [0; 64];
    for _ in 0..40 {
        port.write(request.to_frame(seq, 0x5e55).to_wire().as_slice()).unwrap();
        for _ in 0..5 {
            let count = port.read(&mut buffer).unwrap();
            let heard = buffer[..count].iter().filter_map(|byte| decoder.push(*byte)).find(|frame| frame.seq == seq);
            if let Some(frame) = heard {
                return Answer::from_frame(&frame).unwrap();
            }
        }
    }
    panic!("no answer to {request:?}")
}

#[test]
fn a_reboot_in_motion_is_noticed_and_homing_makes_the_arm_usable_again() {
    let bench = Bench::new(1.0);
    let mut arm = bench.driver();
    arm.set_lamp(500).unwrap();
    let was = arm.identity().boot_nonce;
    let faults = bench.simulated.faults();
    let start = bench.pose.get().angle_deg;
    let result = std::thread::scope(|scope| {
        let homing = scope.spawn(|| arm.home(&Cancel::default()));
        until("the motion", || bench.pose.get().angle_deg < start - 5.0);
        faults.reboot();
        homing.join().unwrap()
    });
    match result {
        Err(ArmError::Rebooted { was: before, now }) => {
            assert_eq!(before, was);
            assert_ne!(now, was);
            assert_eq!(arm.identity().boot_nonce, now);
        }
        other => panic!("{other:?}"),
    }
    let status = arm.status().unwrap();
    assert!(!status.homed && !status.moving && status.lamp_permille == 0);
    assert!(matches!(arm.move_to(0.0, &Cancel::default()), Err(ArmError::Refused { .. })));
}

#[test]
fn a_reboot_while_nobody_asks_is_told_to_the_next_who_does() {
    let bench = Bench::new(100.0);
    let mut arm = bench.homed_driver();
    arm.set_lamp(500).unwrap();
    bench.simulated.faults().reboot();
    until("the reboot", || bench.pose.get().lamp_permille == 0);
    // Time for the driver's own poll to find out first, which must not swallow it.
    std::thread::sleep(Duration::from_millis(700));
    assert!(matches!(arm.move_to(0.0, &Cancel::default()), Err(ArmError::Rebooted { .. })));
    arm.home(&Cancel::default()).unwrap();
    assert_eq!(arm.move_to(0.0, &Cancel::default()).unwrap().angle_deg, 0.0);
}

#[test]
fn a_blocked_arm_has_not_arrived() {
    let bench = Bench::new(100.0);
    let mut arm = bench.homed_driver();
    bench.simulated.faults().stall(true);
    match arm.move_to(-89.0, &Cancel::default()) {
        Err(ArmError::NotArrived { angle_deg, target_deg, .. }) => {
            assert!((angle_deg - -90.0).abs() < 0.5 && target_deg == -89.0);
        }
        other => panic!("{other:?}"),
    }
    assert!(!arm.status().unwrap().moving, "the motor was not stopped");
}

#[test]
fn a_blocked_arm_cannot_home_and_can_after_it_is_freed() {
    let bench = Bench::new(100.0);
    let mut arm = bench.driver();
    bench.simulated.faults().stall(true);
    match arm.home(&Cancel::default()) {
        Err(ArmError::Refused { reason, .. }) => assert!(reason.contains("home switch"), "{reason}"),
        other => panic!("{other:?}"),
    }
    assert_eq!(arm.status().unwrap().faults, Faults::HOME_FAILED.0);
    bench.simulated.faults().stall(false);
    arm.home(&Cancel::default()).unwrap();
}

#[test]
fn lost_steps_deceive_the_status_but_not_the_truth() {
    let bench = Bench::new(100.0);
    let mut arm = bench.homed_driver();
    bench.simulated.faults().lose_steps(11.3);
    until("the slip", || bench.pose.get().angle_deg > -80.0);
    assert_eq!(arm.move_to(0.0, &Cancel::default()).unwrap().angle_deg, 0.0);
    assert!((bench.pose.get().angle_deg - 11.3).abs() < 1e-6);
}

#[test]
fn a_pulled_cable_is_a_port_error_within_the_dead_man_time() {
    let bench = Bench::new(100.0);
    let mut arm = bench.homed_driver();
    arm.set_lamp(1000).unwrap();
    bench.simulated.faults().unplug();
    let started = Instant::now();
    let error = loop {
        if let Err(error) = arm.status() {
            break error;
        }
    };
    assert!(matches!(error, ArmError::Port { .. }), "{error}");
    assert!(started.elapsed() < Duration::from_millis(u64::from(DEAD_MAN_MS)));
    // It stays an error, and nothing hangs.
    assert!(matches!(arm.set_lamp(0), Err(ArmError::Port { .. })));
    assert!(matches!(arm.move_to(0.0, &Cancel::default()), Err(ArmError::Port { .. })));
    // The board, alone with its power supply, switches the lamp off.
    until("lamp off", || bench.pose.get().lamp_permille == 0);
}

#[test]
fn a_frozen_controller_is_silence_not_a_hang() {
    let bench = Bench::new(100.0);
    let mut arm = bench.homed_driver();
    bench.simulated.faults().freeze(true);
    let error = until_error(&mut arm);
    assert!(matches!(error, ArmError::NoAnswer { .. }), "{error}");
    bench.simulated.faults().freeze(false);
    until("an answer", || arm.status().is_ok());
    // It slept through the dead-man time, and says so.
    assert_eq!(arm.status().unwrap().faults, Faults::HOST_LOST.0);
    assert!(matches!(arm.move_to(0.0, &Cancel::default()), Err(ArmError::Locked { .. })));
    arm.home(&Cancel::default()).unwrap();
}

fn until_error(arm: &mut RigprotoArm) -> ArmError {
    let started = Instant::now();
    loop {
        assert!(started.elapsed() < PATIENCE);
        if let Err(error) = arm.status() {
            return error;
        }
    }
}

#[test]
fn a_host_that_falls_silent_costs_lamp_and_motion_in_the_dead_man_time() {
    let bench = Bench::new(1.0);
    let mut port = SerialTransport::open(bench.simulated.port(), 115_200).unwrap();
    talk(&mut port, Request::Hello(Hello { proto_min: 1, proto_max: 1 }), 1);
    assert_eq!(talk(&mut port, Request::SetLamp { level_permille: 1000, ttl_ms: 600_000 }, 2), Answer::Accepted);
    let silent_since = Instant::now();
    assert_eq!(talk(&mut port, Request::Home { move_id: 1 }, 3), Answer::Accepted);
    // Homing from 66 degrees above the switch at 15 degrees a second outlasts the dead-man.
    let start = bench.pose.get().angle_deg;
    until("the motion", || bench.pose.get().angle_deg < start - 1.0);
    assert_eq!(bench.pose.get().lamp_permille, 1000);
    until("lamp off", || bench.pose.get().lamp_permille == 0);
    assert!(silent_since.elapsed() >= Duration::from_millis(u64::from(DEAD_MAN_MS)), "too early");
    let (mut seq, mut last) = (3, None);
    until("standstill", || {
        seq += 1;
        last = Some(talk(&mut port, Request::Status, seq));
        matches!(last, Some(Answer::Status(status)) if !status.moving)
    });
    let Some(Answer::Status(status)) = last else { panic!("no status") };
    assert_eq!(status.faults, Faults::HOST_LOST);
    assert!(!status.homed && bench.pose.get().angle_deg > TRAVEL_DEG[0] + 1.0, "it stopped short of the switch");
    let rest = bench.pose.get();
    assert!(matches!(talk(&mut port, Request::Status, seq + 1), Answer::Status(_)));
    assert_eq!(bench.pose.get(), rest);
}

#[test]
fn an_idle_driver_keeps_the_dead_man_fed() {
    let bench = Bench::new(100.0);
    let mut arm = bench.homed_driver();
    arm.set_lamp(1000).unwrap();
    let silence = Instant::now();
    while silence.elapsed() < Duration::from_millis(u64::from(DEAD_MAN_MS) + 700) {
        assert_eq!(bench.pose.get().lamp_permille, 1000, "lamp off after {:?}", silence.elapsed());
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(arm.status().unwrap().faults, 0);
}

#[test]
fn a_dropped_driver_leaves_motor_and_lamp_off_and_the_port_free() {
    let bench = Bench::new(1.0);
    let mut arm = bench.driver();
    arm.set_lamp(1000).unwrap();
    assert_eq!(bench.pose.get().lamp_permille, 1000);
    drop(arm);
    // The drop itself waited for it: no grace needed.
    assert_eq!(bench.pose.get().lamp_permille, 0);
    bench.driver();
}

#[test]
fn cancelling_stops_the_motor() {
    let bench = Bench::new(1.0);
    let mut arm = bench.driver();
    let cancel = Cancel::default();
    let start = bench.pose.get().angle_deg;
    let result = std::thread::scope(|scope| {
        let homing = scope.spawn(|| arm.home(&cancel));
        until("the motion", || bench.pose.get().angle_deg < start - 2.0);
        cancel.cancel();
        homing.join().unwrap()
    });
    assert!(matches!(result, Err(ArmError::Cancelled)), "{result:?}");
    let rest = bench.pose.get().angle_deg;
    assert!(rest > TRAVEL_DEG[0] + 30.0, "it ran on to {rest}");
    assert!(!arm.status().unwrap().moving);
    assert_eq!(bench.pose.get().angle_deg, rest);
}

#[test]
fn a_port_in_use_and_a_silent_port_are_told_apart() {
    let bench = Bench::new(100.0);
    let arm = bench.driver();
    match RigprotoArm::open(bench.settings()) {
        Err(ArmError::Port { reason, .. }) => assert!(reason.contains("another program"), "{reason}"),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("two drivers on one port"),
    }
    drop(arm);
    bench.simulated.faults().freeze(true);
    // The freeze takes effect with the next look of the simulator at its wishes.
    std::thread::sleep(Duration::from_millis(150));
    match RigprotoArm::open(bench.settings()) {
        Err(ArmError::NoAnswer { what, .. }) => assert_eq!(what, "the handshake"),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("a frozen device answered"),
    }
    let missing = RigprotoSettings { port: Path::new("/dev/no-such-arm").to_owned(), ..bench.settings() };
    assert!(matches!(RigprotoArm::open(missing), Err(ArmError::Port { .. })));
}
