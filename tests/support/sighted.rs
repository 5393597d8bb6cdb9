//! A simulated camera before the fakes.

use super::Fakes;
use rigd::devices::Cancel;
use rigd::devices::camera::{Camera, CameraError, CameraIdentity, RawFrame, Shot};
use rigd::sim::camera::SimulatedCamera;
use rigd::sim::pose::{Pose, SharedPose};

/// Takes its pictures with the lamp and the arm of the fakes.
pub struct Sighted(pub SimulatedCamera, pub Fakes, pub SharedPose);

impl Camera for Sighted {
    fn identity(&self) -> CameraIdentity {
        self.0.identity()
    }
    fn shoot(&mut self, shot: &Shot, cancel: &Cancel) -> Result<RawFrame, CameraError> {
        let pose = {
            let world = self.1.world();
            Pose { angle_deg: world.angle_deg, lamp_permille: world.lamp }
        };
        self.2.set(pose);
        self.0.shoot(shot, cancel)
    }
}
