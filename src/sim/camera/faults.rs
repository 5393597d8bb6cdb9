//! Faults a test makes the simulated camera show.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// What goes wrong with one shot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The shutter opens one stop longer than asked; the EXIF says so.
    WrongExposure,
    /// The last frame is delivered again. Without a last frame the shot is sound.
    RepeatLastFrame,
    /// The file ends in the middle.
    TruncatedFile,
    /// The shutter is open for this part of what it says, permille; the EXIF says what was asked.
    OpenFor(u16),
    /// The shutter keeps the time of the shot before; the EXIF says what was asked. Sound without a shot before.
    LastShutter,
    /// The picture of the shot before under the EXIF of this one. Sound without a shot before.
    StalePicture,
    /// The lamp gives this part of its light, permille: 0 is burnt out.
    LampAt(u16),
    /// Something is before the reference patch, which shows this part of its light, permille. Sound without a patch.
    PatchAt(u16),
    /// A room light is on: so much of the mean radiance of what is lit, permille, everywhere.
    Ambient(u16),
    /// Every other band of rows of this height is this many levels too bright.
    Stripes {
        /// Rows of a band.
        rows: u8,
        /// Levels.
        levels: u8,
    },
    /// The camera shakes along the picture's diagonal by this many pixels.
    Shake(u8),
    /// Everything stands this many pixels further to the right and further down.
    Moved(i8, i8),
    /// The file is whole, its picture grey below this part of its height, permille.
    GreyBelow(u16),
    /// The call does not return until [`CameraFaults::release`], whatever its caller cancels.
    Hang,
}

/// Handle on the faults of a camera; clones share them, also with a camera opened later.
#[derive(Clone, Debug, Default)]
pub struct CameraFaults(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    released: Condvar,
}

#[derive(Debug, Default)]
struct State {
    pending: VecDeque<Fault>,
    releases: u64,
}

impl CameraFaults {
    /// The next shot that no earlier fault waits for shows `fault`.
    pub fn inject(&self, fault: Fault) {
        self.lock().pending.push_back(fault);
    }

    /// Ends every hanging call.
    pub fn release(&self) {
        self.lock().releases += 1;
        self.0.released.notify_all();
    }

    pub(super) fn take(&self) -> Option<Fault> {
        self.lock().pending.pop_front()
    }

    pub(super) fn wait_for_release(&self) {
        let state = self.lock();
        let before = state.releases;
        let waited = self.0.released.wait_while(state, |state| state.releases == before);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
