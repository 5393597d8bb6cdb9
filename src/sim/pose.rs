//! Where the simulated arm really is and what its lamp really does: the one thing arm and camera share.

use std::sync::{Arc, Mutex, PoisonError};

/// The physical truth, not what anyone was told.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Angle of the arm, degrees.
    pub angle_deg: f64,
    /// Lamp level, permille of full.
    pub lamp_permille: u16,
}

/// The shared pose: the arm simulator writes it, the camera simulator reads it.
#[derive(Clone, Debug, Default)]
pub struct SharedPose(Arc<Mutex<Pose>>);

impl SharedPose {
    /// The pose now.
    pub fn get(&self) -> Pose {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the pose.
    pub fn set(&self, pose: Pose) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = pose;
    }
}
