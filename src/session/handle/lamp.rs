//! The lamp as users see it.

use super::EngineHandle;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The lamp that is in the rig.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LampStatus {
    /// True while it is lit, as far as is known.
    pub lit: bool,
    /// Hours it was lit in all; of a simulated rig, hours of its own time.
    pub hours: f64,
    /// Its rated life, hours; null when the rig file does not say.
    pub rated_hours: Option<f64>,
}

impl EngineHandle {
    /// The lamp.
    pub fn lamp(&self) -> LampStatus {
        let inner = self.book.lock();
        LampStatus { lit: inner.lamp.is_lit(), hours: inner.lamp.hours(), rated_hours: self.rig.lamp.rated_hours }
    }
}
