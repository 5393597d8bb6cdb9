//! Both arm drivers on a bad line: ten million random bytes each way, frames dropped and doubled both ways, another name after a hang-up.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod line;

use firmware_protocol::{Decoder, Request};
use line::Weather;
use line::arms::{Bench, Board, KINDS, Kind, board, open};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{Rng, RngExt, SeedableRng};
use rigd::devices::Cancel;
use rigd::devices::arm::{Arm, ArmError};
use rigd::sim::pose::SharedPose;
use serialport::SerialPort;
use std::io::{Read, Write};
use std::thread;
use std::time::{Duration, Instant};

const NOISE_BYTES: usize = 10_000_000;
/// The finest that the drivers' own check of the position allows, degrees.
const TOLERANCE_DEG: f64 = 0.03;
const PATIENCE: Duration = Duration::from_secs(60);

/// What a line that only loses, doubles and adds may cost: silence, and what a board says that was asked half a question.
fn typed(error: &ArmError) {
    let known = matches!(
        error,
        ArmError::NoAnswer { .. }
            | ArmError::Refused { .. }
            | ArmError::Locked { .. }
            | ArmError::NotArrived { .. }
            | ArmError::Rebooted { .. }
    );
    assert!(known, "{error}");
}

/// Opens and homes however often it takes.
fn homed(bench: &Bench) -> Box<dyn Arm> {
    let started = Instant::now();
    loop {
        assert!(started.elapsed() < PATIENCE, "it never works again");
        match bench.open().and_then(|mut arm| arm.home(&Cancel::default()).map(|_| arm)) {
            Ok(arm) => return arm,
            Err(error) => typed(&error),
        }
    }
}

/// Sends the arm about; every move that is called done was begun once and ended at its target.
fn travel(bench: &Bench, arm: &mut Option<Box<dyn Arm>>, rng: &mut Xoshiro256PlusPlus) -> bool {
    let target = rng.random_range(-80.0..80.0);
    arm.get_or_insert_with(|| homed(bench));
    let before = bench.moves();
    let result = arm.as_mut().unwrap().move_to(target, &Cancel::default());
    let begun = bench.moves().zip(before).map(|(after, before)| after - before);
    assert!(begun.is_none_or(|begun| begun <= 1), "one move was begun {begun:?} times");
    match result {
        Ok(status) => {
            assert!(begun.is_none_or(|begun| begun == 1), "{target} was acknowledged and never begun");
            let truth = bench.pose.get().angle_deg;
            assert!((truth - target).abs() <= TOLERANCE_DEG && (status.angle_deg - target).abs() <= TOLERANCE_DEG);
            true
        }
        Err(error) => {
            typed(&error);
            *arm = None;
            false
        }
    }
}

fn dropped_and_doubled(kind: Kind, seed: u64, moves: usize) {
    let bench = Bench::new(kind, 100.0, seed);
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    bench.line.weather(Weather { drop: 0.04, double: 0.15, ..Weather::default() });
    let mut arm = None;
    let done = (0..moves).filter(|_| travel(&bench, &mut arm, &mut rng)).count();
    assert!(done * 2 > moves, "{kind:?}, seed {seed}: {done} of {moves} moves");
    bench.line.weather(Weather::default());
    drop(arm.take());
    assert!(travel(&bench, &mut arm, &mut rng));
    println!("{kind:?}, seed {seed}: {done} of {moves} moves at the first try");
}

fn in_parallel(work: impl Fn(Kind, u64) + Sync, seeds: std::ops::Range<u64>) {
    thread::scope(|scope| {
        for kind in KINDS {
            for seed in seeds.clone() {
                let work = &work;
                scope.spawn(move || work(kind, seed));
            }
        }
    });
}

#[test]
fn dropped_and_doubled_frames_move_nothing_twice_and_acknowledge_nothing_that_is_not_so() {
    in_parallel(|kind, seed| dropped_and_doubled(kind, seed, 12), 0..4);
}

/// Several minutes.
#[test]
#[ignore = "minutes: cargo test --test arm_line -- --ignored --nocapture"]
fn dropped_and_doubled_frames_for_long() {
    in_parallel(|kind, seed| dropped_and_doubled(kind, seed, 100), 100..110);
}

fn noise_among_answers(kind: Kind, seed: u64) {
    let bench = Bench::new(kind, 100.0, seed);
    let mut arm = homed(&bench);
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    bench.line.weather(Weather { noise: 100_000, double: 0.1, ..Weather::default() });
    let (started, mut done) = (Instant::now(), 0);
    while bench.line.noise_sent() < NOISE_BYTES {
        assert!(started.elapsed() < 2 * PATIENCE, "{kind:?}: {} bytes", bench.line.noise_sent());
        let target = rng.random_range(-80.0..80.0);
        match arm.move_to(target, &Cancel::default()) {
            Ok(_) => {
                let truth = bench.pose.get().angle_deg;
                assert!((truth - target).abs() <= TOLERANCE_DEG, "{kind:?}: a wrong acceptance");
                done += 1;
            }
            Err(error) => typed(&error),
        }
    }
    bench.line.weather(Weather::default());
    drop(arm);
    assert!(travel(&bench, &mut None, &mut rng));
    println!("{kind:?}: {done} moves done meanwhile, {:?}", started.elapsed());
}

#[test]
fn ten_million_random_bytes_among_the_answers_leave_a_driver_that_works() {
    in_parallel(noise_among_answers, 7..8);
}

#[test]
fn ten_million_random_bytes_into_the_board_move_nothing_and_leave_it_working() {
    for kind in KINDS {
        let pose = SharedPose::default();
        let board = board(kind, 100.0, pose.clone());
        let port = match &board {
            Board::Rigproto(arm) => arm.port(),
            Board::Grbl(arm) => arm.port(),
        };
        drop(open(&line::arms::config(kind, port.to_owned())).unwrap());
        let rest = pose.get().angle_deg;
        let wire = serialport::new(port.to_str().unwrap(), 115_200).timeout(Duration::from_millis(500));
        let mut wire = wire.open_native().unwrap();
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(11);
        let (mut noise, mut answers) = ([0; 1024], [0; 2048]);
        for _ in 0..NOISE_BYTES.div_ceil(noise.len()) {
            rng.fill_bytes(&mut noise);
            wire.write_all(&noise).unwrap();
            while wire.bytes_to_read().unwrap() > 0 {
                assert!(wire.read(&mut answers).unwrap() > 0);
            }
        }
        // Until it has heard all of it.
        while wire.read(&mut answers).is_ok() {}
        drop(wire);
        assert_eq!(pose.get().angle_deg, rest, "{kind:?}");
        let mut arm = open(&line::arms::config(kind, port.to_owned())).unwrap();
        assert_eq!(pose.get().lamp_permille, 0);
        arm.home(&Cancel::default()).unwrap();
        arm.move_to(12.0, &Cancel::default()).unwrap();
        assert!((pose.get().angle_deg - 12.0).abs() <= TOLERANCE_DEG);
    }
}

#[test]
fn every_frame_among_ten_million_random_bytes_is_decoded_and_no_other() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    let mut decoder = Decoder::default();
    let (mut sent, mut heard, mut noise) = (0u16, 0u16, [0; 256]);
    for _ in 0..NOISE_BYTES / noise.len() {
        rng.fill_bytes(&mut noise);
        let frame = Request::MoveTo { target_mdeg: i32::from(sent), move_id: 5 }.to_frame(sent, 0xa1b2_c3d4);
        sent = sent.wrapping_add(1);
        for byte in noise.iter().chain(frame.to_wire().as_slice()) {
            if let Some(found) = decoder.push(*byte) {
                assert_eq!(
                    found,
                    Request::MoveTo { target_mdeg: i32::from(heard), move_id: 5 }.to_frame(heard, 0xa1b2_c3d4)
                );
                heard = heard.wrapping_add(1);
            }
        }
    }
    assert_eq!(heard, sent);
}

#[test]
fn a_port_that_comes_back_under_another_number_is_found_behind_its_link() {
    for kind in KINDS {
        let bench = Bench::new(kind, 100.0, 1);
        let mut arm = homed(&bench);
        let before = bench.line.node();
        bench.line.hang_up();
        let started = Instant::now();
        while !matches!(arm.status(), Err(ArmError::Port { .. })) {
            assert!(started.elapsed() < PATIENCE, "{kind:?}: the hang-up is not told");
        }
        assert!(matches!(bench.open().map(|_| ()), Err(ArmError::Port { .. })));
        bench.line.come_back(Duration::ZERO, || {});
        assert_ne!(bench.line.node(), before, "the same name again");
        // The handle of the old port does not revive.
        assert!(matches!(arm.status(), Err(ArmError::Port { .. })));
        drop(arm);
        homed(&bench).move_to(20.0, &Cancel::default()).unwrap();
        assert!((bench.pose.get().angle_deg - 20.0).abs() <= TOLERANCE_DEG);
    }
}
