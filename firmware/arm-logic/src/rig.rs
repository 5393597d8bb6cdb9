//! The arm that is built: change these lines to fit yours, and the simulator follows. docs/firmware.md says how to measure them.

use crate::mechanics::{Mechanics, Settings};
use firmware_protocol::{DeviceInfo, caps};

/// A motor of 200 full steps at 16 microsteps, a belt of 5 : 1; speed, acceleration and travel of `zheng-2008.toml`.
pub const SETTINGS: Settings = Settings {
    steps_per_turn: 200 * 16 * 5,
    speed_mdeg_s: 10_000,
    acceleration_mdeg_s2: 10_000,
    seek_mdeg_s: 5_000,
    approach_mdeg_s: 500,
    travel_mdeg: [-90_000, 170_000],
    edge_mdeg: -50_000,
    clear_mdeg: 2_000,
    tolerance_mdeg: 500,
    steady_us: 5_000,
};

/// The same, checked: a wrong arm does not compile.
#[allow(clippy::panic, reason = "speaks while compiling only")]
pub const MECHANICS: Mechanics = match Mechanics::new(SETTINGS) {
    Ok(mechanics) => mechanics,
    Err(what) => panic!("{}", what),
};

/// What a board with this arm says of itself; `more_caps` are those that depend on the board.
pub fn info(more_caps: u16, reset_cause: u8, boot_nonce: u32) -> DeviceInfo {
    DeviceInfo {
        firmware: [0, 1, 0],
        caps: caps::DEAD_MAN | caps::STEP_LOSS_CHECK | more_caps,
        reset_cause,
        boot_nonce,
        travel_mdeg: MECHANICS.travel_mdeg(),
    }
}
