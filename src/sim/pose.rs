//! Where the simulated arm really is and what its lamp really does: the one thing arm and camera share.

use super::ringing::Ringing;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// The physical truth, not what anyone was told.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Angle of the arm, degrees.
    pub angle_deg: f64,
    /// Lamp level, permille of full.
    pub lamp_permille: u16,
}

/// An arm that swings on after its motor has stopped.
#[derive(Clone, Copy, Debug)]
pub struct Swing {
    /// About the angle of the pose.
    pub ringing: Ringing,
    /// When the motor stopped.
    pub stopped: Instant,
    /// How many times faster than real time passes.
    pub speed: f64,
}

/// The shared pose: the arm simulator writes it, the camera simulator reads it.
#[derive(Clone, Debug, Default)]
pub struct SharedPose(Arc<Mutex<(Pose, Option<Swing>)>>);

impl SharedPose {
    /// The pose now, swinging included.
    pub fn get(&self) -> Pose {
        let (pose, swing) = *self.lock();
        let off_deg = swing.map_or(0.0, |s| s.ringing.at(s.speed * s.stopped.elapsed().as_secs_f64()));
        Pose { angle_deg: pose.angle_deg + off_deg, ..pose }
    }

    /// Sets the pose; it does not swing.
    pub fn set(&self, pose: Pose) {
        *self.lock() = (pose, None);
    }

    /// Sets a pose about which the arm swings.
    pub fn set_swinging(&self, pose: Pose, swing: Swing) {
        *self.lock() = (pose, Some(swing));
    }

    fn lock(&self) -> MutexGuard<'_, (Pose, Option<Swing>)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
