//! How a lamp lives: it warms up, drifts, burns out.

use std::fmt;
use std::sync::Arc;

/// What a lamp has been through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Burning {
    /// Time since it was lit, seconds of the simulated rig.
    pub lit_s: f64,
    /// Shots that it lit before this one.
    pub shots: u32,
}

/// Its brightness then, red green blue, relative to the rig file's.
type Life = dyn Fn(Burning) -> [f64; 3] + Send + Sync;

/// A lamp that does not stay as it is.
#[derive(Clone)]
pub struct SimulatedLamp(Arc<Life>);

impl SimulatedLamp {
    /// A lamp of which `life` tells the brightness.
    pub fn new(life: impl Fn(Burning) -> [f64; 3] + Send + Sync + 'static) -> Self {
        Self(Arc::new(life))
    }

    /// Its brightness, relative to the rig file's.
    pub(super) fn brightness(&self, burning: Burning) -> [f64; 3] {
        (self.0)(burning)
    }
}

/// Steady at once, for ever.
impl Default for SimulatedLamp {
    fn default() -> Self {
        Self::new(|_| [1.0; 3])
    }
}

impl fmt::Debug for SimulatedLamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SimulatedLamp")
    }
}
