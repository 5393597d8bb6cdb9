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
pub struct SharedPose(Arc<Mutex<State>>);

#[derive(Clone, Copy, Debug, Default)]
struct State {
    pose: Pose,
    swing: Option<Swing>,
    /// Since when the lamp has been on.
    lit: Option<Instant>,
}

impl SharedPose {
    /// The pose now, swinging included.
    pub fn get(&self) -> Pose {
        let State { pose, swing, .. } = *self.lock();
        let off_deg = swing.map_or(0.0, |s| s.ringing.at(s.speed * s.stopped.elapsed().as_secs_f64()));
        Pose { angle_deg: pose.angle_deg + off_deg, ..pose }
    }

    /// Sets the pose; it does not swing.
    pub fn set(&self, pose: Pose) {
        self.lock().set(pose, None);
    }

    /// Sets a pose about which the arm swings.
    pub fn set_swinging(&self, pose: Pose, swing: Swing) {
        self.lock().set(pose, Some(swing));
    }

    /// Since when the lamp has been on; none while it is off.
    pub fn lit(&self) -> Option<Instant> {
        self.lock().lit
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn set(&mut self, pose: Pose, swing: Option<Swing>) {
        let lit = (pose.lamp_permille > 0).then(|| self.lit.unwrap_or_else(Instant::now));
        *self = Self { pose, swing, lit };
    }
}
