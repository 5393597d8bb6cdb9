//! The GRBL driver against a simulated controller whose answers are those recorded from GRBL 1.1h, over real bytes on a PTY.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rig_config::{Arm as ArmConfig, ArmDriver, GrblLamp};
use rigd::devices::Cancel;
use rigd::devices::arm::{Arm, ArmError};
use rigd::devices::grbl::{GrblArm, GrblSettings};
use rigd::sim::grbl::{GrblConfig, SimulatedGrbl};
use rigd::sim::pose::SharedPose;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

const ZERO_DEG: f64 = 93.0;

/// What the owner of a stock controller must have entered.
fn stored() -> BTreeMap<u16, f64> {
    [
        (1, 255.0),
        (10, 1.0),
        (13, 0.0),
        (20, 0.0),
        (21, 0.0),
        (22, 1.0),
        (23, 0.0),
        (25, 900.0),
        (27, 3.0),
        (30, 1000.0),
        (32, 0.0),
        (100, 44.444),
        (110, 1800.0),
        (120, 100.0),
        (130, 200.0),
    ]
    .into()
}

struct Bench {
    simulated: SimulatedGrbl,
    pose: SharedPose,
}

impl Bench {
    fn new(settings: BTreeMap<u16, f64>, speed: f64) -> Self {
        let pose = SharedPose::default();
        let config = GrblConfig { settings, zero_deg: ZERO_DEG, speed, pose: pose.clone() };
        Self { simulated: SimulatedGrbl::spawn(config).unwrap(), pose }
    }

    fn settings(&self, lamp: GrblLamp) -> GrblSettings {
        let port = self.simulated.port().to_owned();
        let driver = ArmDriver::Grbl { port: port.clone(), lamp, zero_deg: ZERO_DEG };
        let arm = ArmConfig {
            driver,
            baud: 115_200,
            speed_deg_s: 30.0,
            acceleration_deg_s2: 100.0,
            travel_deg: [-90.0, 90.0],
            tolerance_deg: 0.03,
            settle_s: 0.5,
            park_deg: 0.0,
            home_timeout_s: 60.0,
        };
        GrblSettings { port, lamp, zero_deg: ZERO_DEG, arm }
    }

    fn open(&self) -> GrblArm {
        GrblArm::open(self.settings(GrblLamp::Spindle)).unwrap()
    }

    fn homed(&self) -> GrblArm {
        let mut arm = self.open();
        arm.home(&Cancel::default()).unwrap();
        arm
    }

    fn lamp(&self) -> u16 {
        self.pose.get().lamp_permille
    }
}

fn until(what: &str, mut condition: impl FnMut() -> bool) {
    let started = Instant::now();
    while !condition() {
        assert!(started.elapsed() < Duration::from_secs(20), "{what} did not happen");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn reason<T: std::fmt::Debug>(result: Result<T, ArmError>) -> String {
    match result {
        Err(ArmError::Refused { reason, .. } | ArmError::Locked { reason }) => reason,
        other => panic!("not refused: {other:?}"),
    }
}

#[test]
fn home_move_and_lamp_end_where_the_truth_is() {
    let bench = Bench::new(stored(), 50.0);
    let mut arm = bench.open();
    assert_eq!(arm.identity().firmware, "GRBL 1.1h.20190830");
    assert!(!arm.status().unwrap().homed);
    assert!(reason(arm.move_to(0.0, &Cancel::default())).contains("home it first"));
    assert!(arm.home(&Cancel::default()).unwrap().homed);
    for angle_deg in [-60.0, 33.333, 90.0, -90.0] {
        let status = arm.move_to(angle_deg, &Cancel::default()).unwrap();
        assert!(!status.moving && (status.angle_deg - angle_deg).abs() <= 0.03, "{status:?}");
        assert!((bench.pose.get().angle_deg - angle_deg).abs() <= 0.03);
    }
    assert_eq!((arm.set_lamp(800).unwrap().lamp_permille, bench.lamp()), (800, 800));
    assert_eq!((arm.set_lamp(0).unwrap().lamp_permille, bench.lamp()), (0, 0));
    for angle_deg in [90.1, f64::NAN, -1e300] {
        assert!(reason(arm.move_to(angle_deg, &Cancel::default())).contains("travel_deg"));
    }
    assert!(reason(arm.set_lamp(1001)).contains("1000"));
}

#[test]
fn a_lamp_on_the_coolant_output_is_on_or_off() {
    let bench = Bench::new(stored(), 50.0);
    let mut arm = GrblArm::open(bench.settings(GrblLamp::Coolant)).unwrap();
    arm.home(&Cancel::default()).unwrap();
    assert_eq!((arm.set_lamp(1000).unwrap().lamp_permille, bench.lamp()), (1000, 1000));
    assert!(reason(arm.set_lamp(500)).contains("on (1000) or off (0)"));
    drop(arm);
    until("lamp off after the driver's end", || bench.lamp() == 0);
}

#[test]
fn stored_settings_that_contradict_the_rig_file_are_all_named() {
    let mut settings = stored();
    settings.extend([(1, 25.0), (22, 0.0), (110, 600.0), (130, 150.0)]);
    let bench = Bench::new(settings, 50.0);
    let said = reason(GrblArm::open(bench.settings(GrblLamp::Spindle)).map(|_| ()));
    for part in ["$1=255", "$22=1", "$110=1800", "$130 is 150"] {
        assert!(said.contains(part), "{part} not in: {said}");
    }
}

#[test]
fn dropping_the_driver_stops_the_motor_and_darkens() {
    let bench = Bench::new(stored(), 1.0);
    let mut arm = bench.open();
    let cancel = Cancel::default();
    let stop = cancel.clone();
    std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(700));
        stop.cancel();
    });
    assert!(matches!(arm.home(&cancel), Err(ArmError::Cancelled)));
    assert!(!arm.status().unwrap().homed);
    drop(arm);
    let bench = Bench::new(stored(), 50.0);
    let mut arm = bench.homed();
    arm.set_lamp(500).unwrap();
    drop(arm);
    until("lamp off", || bench.lamp() == 0);
}

#[test]
fn noise_before_a_command_costs_a_repeat_and_nothing_else() {
    let bench = Bench::new(stored(), 50.0);
    let mut arm = bench.homed();
    for (i, angle_deg) in [-50.0, -10.0, 30.0, 70.0].into_iter().enumerate() {
        bench.simulated.faults().noise_before_next([&b"q"[..], b"#7", b"G1", b"\n\xff"][i]);
        let status = arm.move_to(angle_deg, &Cancel::default()).unwrap();
        assert!((status.angle_deg - angle_deg).abs() <= 0.03 && (bench.pose.get().angle_deg - angle_deg).abs() <= 0.03);
    }
    // Feed override +10 %: seen, and gone with the reset that follows.
    bench.simulated.faults().noise_before_next(&[0x91]);
    assert!(reason(arm.status().and_then(|_| arm.status())).contains("overrides"));
}

#[test]
fn a_restart_is_heard_even_when_nobody_asks_and_homing_cures_it() {
    let bench = Bench::new(stored(), 50.0);
    let mut arm = bench.homed();
    let before = arm.identity().boot_nonce;
    arm.set_lamp(900).unwrap();
    bench.simulated.faults().reboot();
    std::thread::sleep(Duration::from_millis(800));
    assert!(matches!(arm.status(), Err(ArmError::Rebooted { .. })));
    assert_ne!(arm.identity().boot_nonce, before);
    let status = arm.status().unwrap();
    assert_eq!((status.homed, status.lamp_permille), (false, 0));
    assert!(arm.home(&Cancel::default()).unwrap().homed);
}

#[test]
fn a_hit_limit_is_told_reset_and_homed() {
    let bench = Bench::new(stored(), 50.0);
    let mut arm = bench.homed();
    bench.simulated.faults().hit_limit();
    std::thread::sleep(Duration::from_millis(800));
    match arm.status() {
        // A session homes again after this one.
        Err(ArmError::Locked { reason }) => assert!(reason.contains("ALARM:1"), "{reason}"),
        other => panic!("{other:?}"),
    }
    assert!(arm.home(&Cancel::default()).unwrap().homed);
}

#[test]
fn a_switch_that_is_never_met_is_told() {
    let bench = Bench::new(stored(), 200.0);
    let mut arm = bench.open();
    bench.simulated.faults().stall(true);
    assert!(reason(arm.home(&Cancel::default())).contains("ALARM:9"));
    bench.simulated.faults().stall(false);
    assert!(arm.home(&Cancel::default()).unwrap().homed);
}

#[test]
fn steps_lost_since_the_last_homing_are_measured_at_the_next() {
    let bench = Bench::new(stored(), 2.0);
    let mut arm = bench.homed();
    arm.home(&Cancel::default()).expect("nothing was lost");
    bench.simulated.faults().lose_steps(-1.1);
    std::thread::sleep(Duration::from_millis(50));
    match arm.home(&Cancel::default()) {
        Err(ArmError::StepsLost { slip_deg: Some(slip) }) => assert!((slip - 1.1).abs() < 0.3, "{slip}"),
        other => panic!("{other:?}"),
    }
    assert!((arm.move_to(10.0, &Cancel::default()).unwrap().angle_deg - bench.pose.get().angle_deg).abs() < 0.1);
    bench.simulated.faults().lose_steps(11.3);
    std::thread::sleep(Duration::from_millis(50));
    assert!(matches!(arm.home(&Cancel::default()), Err(ArmError::StepsLost { .. })));
    arm.home(&Cancel::default()).expect("found again");
}

#[test]
fn a_frozen_and_an_unplugged_controller_are_told_in_bounded_time() {
    let bench = Bench::new(stored(), 50.0);
    let mut arm = bench.homed();
    bench.simulated.faults().freeze(true);
    let started = Instant::now();
    assert!(matches!(arm.status(), Err(ArmError::NoAnswer { .. })));
    assert!(started.elapsed() < Duration::from_secs(10));
    bench.simulated.faults().freeze(false);
    until("an answer", || arm.status().is_ok());
    bench.simulated.faults().unplug();
    until("the loss is told", || matches!(arm.status(), Err(ArmError::Port { .. })));
    let started = Instant::now();
    drop(arm);
    assert!(started.elapsed() < Duration::from_secs(4));
}
