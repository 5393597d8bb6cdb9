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
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// A flag that a blocking device call looks at: once set, the call stops the hardware and returns its `Cancelled` error. Looks are
/// counted, because a call that still looks does not hang: these are the engine's beats, by which the watchdog goes.
#[derive(Clone, Debug, Default)]
pub struct Cancel {
    set: Arc<AtomicBool>,
    beats: Arc<AtomicU64>,
}

impl Cancel {
    /// Asks every call that holds this flag to stop.
    pub fn cancel(&self) {
        self.set.store(true, Ordering::SeqCst);
    }

    /// Makes the flag usable again for the next piece of work.
    pub fn clear(&self) {
        self.set.store(false, Ordering::SeqCst);
    }

    /// True once [`Cancel::cancel`] was called.
    pub fn is_cancelled(&self) -> bool {
        self.beat();
        self.set.load(Ordering::SeqCst)
    }

    /// Counts as a look: work without a device call shows that it goes on.
    pub fn beat(&self) {
        self.beats.fetch_add(1, Ordering::Relaxed);
    }

    /// Looks so far, by whoever holds this flag or one [`apart`](Cancel::apart) from it.
    pub fn beats(&self) -> u64 {
        self.beats.load(Ordering::Relaxed)
    }

    /// A flag of its own, which this one does not set, whose looks count with this one's.
    pub fn apart(&self) -> Self {
        Self { set: Arc::default(), beats: Arc::clone(&self.beats) }
    }
}
