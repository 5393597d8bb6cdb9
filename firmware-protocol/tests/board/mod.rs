//! A board whose motor turns only when the test says so.
#![allow(dead_code, reason = "each test file uses its own part")]

use firmware_protocol::{DeviceInfo, Faults, Hal, Motor, caps};

pub const INFO: DeviceInfo = DeviceInfo {
    firmware: [0, 1, 2],
    caps: caps::DIMMING | caps::DEAD_MAN | caps::REBOOT_DETECT,
    reset_cause: 1,
    boot_nonce: 0xdead_beef,
    travel_mdeg: [-90_000, 90_000],
};

#[derive(Default)]
pub struct Board {
    pub motor: Motor,
    pub target_mdeg: i32,
    pub homing: bool,
    pub lamp_permille: u16,
    pub moves: u32,
    pub homings: u32,
}

impl Board {
    /// The motion under way comes to its end.
    pub fn arrive(&mut self) {
        if self.motor.moving && self.homing {
            self.motor.homed = true;
            self.target_mdeg = -90_000;
        }
        self.motor.position_mdeg = self.target_mdeg;
        (self.motor.moving, self.homing) = (false, false);
    }

    pub fn fail(&mut self, faults: Faults) {
        self.motor.faults = faults;
    }
}

impl Hal for Board {
    fn motor(&self) -> Motor {
        self.motor
    }
    fn start_move(&mut self, target_mdeg: i32) {
        self.moves += 1;
        self.target_mdeg = target_mdeg;
        self.motor.moving = target_mdeg != self.motor.position_mdeg;
    }
    fn start_home(&mut self) {
        self.homings += 1;
        (self.homing, self.motor.homed, self.motor.moving) = (true, false, true);
    }
    fn decelerate(&mut self) {
        self.target_mdeg = self.motor.position_mdeg;
        (self.motor.moving, self.homing) = (false, false);
    }
    fn set_lamp(&mut self, permille: u16) {
        self.lamp_permille = permille;
    }
    fn clear_faults(&mut self) {
        self.motor.faults = Faults::default();
    }
}
