//! Time that passes as the simulated devices let it: the same in every run of a seed.

use jiff::Timestamp;
use rigd::store::Clock;
use std::sync::{Mutex, MutexGuard};
use std::time::Duration;
use uuid::Uuid;

/// An evening.
const BEGIN: &str = "2026-11-23T19:00:00Z";
/// From a cut to the next start of the daemon.
const OUTAGE: Duration = Duration::from_secs(60);

#[derive(Debug)]
pub struct VirtualClock {
    seed: u64,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    elapsed: Duration,
    /// The power is off: what the devices still do takes no time.
    stopped: bool,
    ids: u16,
}

impl VirtualClock {
    pub fn new(seed: u64) -> Self {
        Self { seed, state: Mutex::default() }
    }

    /// A device took this long, seconds.
    pub fn pass(&self, seconds: f64) {
        let mut state = self.lock();
        if !state.stopped {
            state.elapsed += Duration::from_secs_f64(seconds);
        }
    }

    pub fn stop(&self) {
        self.lock().stopped = true;
    }

    pub fn go_on(&self) {
        let mut state = self.lock();
        state.stopped = false;
        state.elapsed += OUTAGE;
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }
}

impl Clock for VirtualClock {
    fn now(&self) -> Timestamp {
        BEGIN.parse::<Timestamp>().unwrap() + self.lock().elapsed
    }

    fn elapsed(&self) -> Duration {
        // What the worker does takes no time; when its thread comes to look is chance.
        let is_worker = std::thread::current().name() == Some("worker");
        if is_worker { Duration::ZERO } else { self.lock().elapsed }
    }

    fn rest(&self, time: Duration) -> Duration {
        self.pass(time.as_secs_f64());
        Duration::ZERO
    }

    fn new_id(&self) -> Uuid {
        let millis = self.now().as_millisecond() as u64;
        let mut state = self.lock();
        state.ids += 1;
        let mut rest = [0; 10];
        rest[..8].copy_from_slice(&self.seed.to_be_bytes());
        rest[8..].copy_from_slice(&state.ids.to_be_bytes());
        uuid::Builder::from_unix_timestamp_millis(millis, &rest).into_uuid()
    }
}
