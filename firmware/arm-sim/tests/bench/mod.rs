//! The board on the bench: an arm fast enough for tests.
#![allow(dead_code, reason = "each test file uses its own part")]

use arm_logic::{Mechanics, Settings};
use arm_sim::{Board, World};
use firmware_protocol::{DeviceInfo, Hal, caps};

/// 40 steps a degree.
pub const FAST: Settings = Settings {
    steps_per_turn: 14_400,
    speed_mdeg_s: 90_000,
    acceleration_mdeg_s2: 180_000,
    seek_mdeg_s: 45_000,
    approach_mdeg_s: 2_000,
    travel_mdeg: [-90_000, 90_000],
    edge_mdeg: -80_000,
    clear_mdeg: 3_000,
    tolerance_mdeg: 1_000,
    steady_us: 2_000,
};

pub const INFO: DeviceInfo = DeviceInfo {
    firmware: [0, 1, 0],
    caps: caps::DIMMING | caps::DEAD_MAN | caps::STEP_LOSS_CHECK | caps::REBOOT_DETECT,
    reset_cause: 1,
    boot_nonce: 0xdead_beef,
    travel_mdeg: FAST.travel_mdeg,
};

/// Whole steps nearest to an angle, counted independently of the firmware.
pub fn count(mdeg: i32) -> i32 {
    (f64::from(mdeg) * f64::from(FAST.steps_per_turn) / 360_000.0).round() as i32
}

/// A board whose arm stands `from` steps from angle 0. The timer is about to wrap, which nothing may notice.
pub fn start(from: i64, bounce_us: u32) -> Board {
    let mut world = World::new(&FAST, from - i64::from(count(FAST.edge_mdeg)), u32::MAX - 1_234_567);
    world.bounce_us = bounce_us;
    Board::new(world, Mechanics::new(FAST).unwrap(), INFO)
}

/// Lets time pass until the motor stands, at most two minutes.
pub fn run(board: &mut Board) {
    for _ in 0..120_000 {
        if !board.motor().moving {
            return;
        }
        board.advance(1000);
    }
    panic!("still moving after two minutes: {:?}", board.motor());
}

pub fn homed() -> Board {
    let mut board = start(200, 0);
    board.arm_mut().start_home();
    run(&mut board);
    assert!(board.motor().homed, "{:?}", board.motor());
    board
}
