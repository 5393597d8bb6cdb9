//! Time and names as the daemon has them from the machine it runs on. A simulation of a night gives its own: time that passes as the
//! simulated devices let it, so that a seed is the same journal, bit for bit.

use jiff::Timestamp;
use std::fmt::Debug;
use std::time::{Duration, Instant};
use uuid::Uuid;

/// Where time and the names of runs come from.
pub trait Clock: Debug + Send + Sync {
    /// Time of day.
    fn now(&self) -> Timestamp;
    /// Time since a moment that stays the same; it never goes back.
    fn elapsed(&self) -> Duration;
    /// A rest of this length begins: the part of it that is to be waited for.
    fn rest(&self, time: Duration) -> Duration;
    /// The name of a new run: a UUID v7, so that names sort by their time.
    fn new_id(&self) -> Uuid;
}

/// The machine's own time.
#[derive(Debug)]
pub struct RealClock(Instant);

impl Default for RealClock {
    fn default() -> Self {
        Self(Instant::now())
    }
}

impl Clock for RealClock {
    fn now(&self) -> Timestamp {
        Timestamp::now()
    }
    fn elapsed(&self) -> Duration {
        self.0.elapsed()
    }
    fn rest(&self, time: Duration) -> Duration {
        time
    }
    fn new_id(&self) -> Uuid {
        Uuid::now_v7()
    }
}
