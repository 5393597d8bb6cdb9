//! Hardware behind two small traits: [`arm::Arm`] and [`camera::Camera`]. Knows nothing of pipeline, store or session.
pub mod arm;
pub mod camera;
pub mod gphoto2;
pub mod grbl;
pub mod inspect;
mod motion;
mod port_thread;
pub mod replay;
pub mod rigproto;
pub mod serial;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that a blocking device call looks at: once set, the call stops the hardware and returns its `Cancelled` error.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Asks every call that holds this flag to stop.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::SeqCst);
    }

    /// Makes the flag usable again for the next piece of work.
    pub fn clear(&self) {
        self.0.store(false, Ordering::SeqCst);
    }

    /// True once [`Cancel::cancel`] was called.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }
}
