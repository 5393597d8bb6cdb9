//! Arm and camera whose calls take the simulation's time; those of the arm are also where the engine lets the worker work.

use super::clock::VirtualClock;
use super::turns::Turns;
use rigd::devices::Cancel;
use rigd::devices::arm::{Arm, ArmError, ArmIdentity, ArmStatus};
use rigd::devices::camera::{Camera, CameraError, CameraIdentity, RawFrame, Shot};
use std::sync::Arc;

/// What an arm does in a second, degrees.
const SPEED_DEG_S: f64 = 20.0;
/// Time homing takes, and a shot besides its exposure, seconds.
const HOMING_S: f64 = 12.0;
const SHOT_S: f64 = 1.2;

pub struct PacedArm {
    pub arm: Box<dyn Arm>,
    pub turns: Arc<Turns>,
    pub clock: Arc<VirtualClock>,
    pub angle_deg: f64,
}

impl Arm for PacedArm {
    fn identity(&self) -> ArmIdentity {
        self.arm.identity()
    }
    fn home(&mut self, cancel: &Cancel) -> Result<ArmStatus, ArmError> {
        self.clock.pass(HOMING_S);
        self.arm.home(cancel)
    }
    fn move_to(&mut self, angle_deg: f64, cancel: &Cancel) -> Result<ArmStatus, ArmError> {
        self.turns.engine();
        self.clock.pass((angle_deg - self.angle_deg).abs() / SPEED_DEG_S);
        self.angle_deg = angle_deg;
        self.arm.move_to(angle_deg, cancel)
    }
    fn set_lamp(&mut self, permille: u16) -> Result<ArmStatus, ArmError> {
        self.arm.set_lamp(permille)
    }
    fn prove_position(&mut self, _: &Cancel) -> Result<(), ArmError> {
        self.turns.engine();
        Ok(())
    }
    fn status(&mut self) -> Result<ArmStatus, ArmError> {
        self.turns.engine();
        self.arm.status()
    }
    fn stop(&mut self) -> Result<ArmStatus, ArmError> {
        self.arm.stop()
    }
}

pub struct PacedCamera {
    pub camera: Box<dyn Camera>,
    pub clock: Arc<VirtualClock>,
}

impl Camera for PacedCamera {
    fn identity(&self) -> CameraIdentity {
        self.camera.identity()
    }
    fn shoot(&mut self, shot: &Shot, cancel: &Cancel) -> Result<RawFrame, CameraError> {
        self.clock.pass(shot.shutter.true_s + SHOT_S);
        self.camera.shoot(shot, cancel)
    }
}
