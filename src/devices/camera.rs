//! The camera as the session sees it.

use super::Cancel;
use rig_config::Shutter;

/// One picture to take. `station` and `exposure` index the plan; a camera that plays stored frames uses them to find its frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Index of the light station in the plan.
    pub station: usize,
    /// Index of the exposure in the bracket.
    pub exposure: usize,
    /// Shutter to set.
    pub shutter: Shutter,
    /// Aperture to set, f-number.
    pub f_number: f64,
    /// ISO speed to set.
    pub iso: u32,
}

/// A downloaded frame, still as the camera wrote it.
#[derive(Clone, Debug)]
pub struct RawFrame {
    /// The file's bytes.
    pub bytes: Vec<u8>,
    /// The camera's own name of the file.
    pub name: String,
}

/// What body this is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraIdentity {
    /// Maker and model as the camera reports it.
    pub model: String,
}

/// Why a camera call failed.
#[derive(Clone, Debug, thiserror::Error)]
pub enum CameraError {
    /// The camera could not be opened or used.
    #[error("camera: {reason}")]
    Unusable {
        /// What happened and what to do.
        reason: String,
    },
    /// The camera has no frame for this shot.
    #[error("camera: no frame for station {station}, exposure {exposure}: {reason}")]
    NoFrame {
        /// Station of the shot.
        station: usize,
        /// Exposure of the shot.
        exposure: usize,
        /// What happened and what to do.
        reason: String,
    },
    /// The call outlived its deadline; the driver must be reopened.
    #[error("camera: {what} took longer than {deadline_s:.0} s: switch the camera off and on, then start again")]
    Deadline {
        /// The call.
        what: &'static str,
        /// The deadline, seconds.
        deadline_s: f64,
    },
    /// The caller's [`Cancel`] was set before the frame was taken.
    #[error("the shot was cancelled")]
    Cancelled,
}

/// A camera driver: blocking, run on its own thread by [`CameraHandle`].
pub trait Camera: Send {
    /// What body this is.
    fn identity(&self) -> CameraIdentity;
    /// Sets the exposure, shoots, downloads.
    fn shoot(&mut self, shot: &Shot, cancel: &Cancel) -> Result<RawFrame, CameraError>;
}
