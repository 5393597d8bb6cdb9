//! What a test may do to the simulated arm while it runs.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Wishes not yet carried out, and states that last.
#[derive(Debug, Default)]
pub(super) struct Injected {
    pub noise_bytes: usize,
    pub drop_answers: u32,
    pub garble_answers: u32,
    pub reboot: bool,
    pub frozen: bool,
    pub stalled: bool,
    pub slip_deg: f64,
    pub shaft_deg: f64,
    pub unplug: bool,
}

/// Handle that injects faults; each takes effect within 50 ms.
#[derive(Clone, Debug, Default)]
pub struct ArmFaults(Arc<Mutex<Injected>>);

impl ArmFaults {
    /// Sends `count` random bytes in front of the next answer.
    pub fn noise(&self, count: usize) {
        self.wishes().noise_bytes = count;
    }

    /// Executes the next `count` requests and loses their answers.
    pub fn drop_answers(&self, count: u32) {
        self.wishes().drop_answers = count;
    }

    /// Flips a bit in each of the next `count` answers.
    pub fn garble_answers(&self, count: u32) {
        self.wishes().garble_answers = count;
    }

    /// Cuts and restores the controller's power: another boot nonce, lamp off, not homed.
    pub fn reboot(&self) {
        self.wishes().reboot = true;
    }

    /// Hangs the controller: no answer, no step, and no dead-man either. `false` lets it go on.
    pub fn freeze(&self, frozen: bool) {
        self.wishes().frozen = frozen;
    }

    /// Blocks the motor. `false` frees it.
    pub fn stall(&self, stalled: bool) {
        self.wishes().stalled = stalled;
    }

    /// Turns the arm by `degrees` without the controller noticing.
    pub fn lose_steps(&self, degrees: f64) {
        self.wishes().slip_deg += degrees;
    }

    /// Turns the arm on its shaft, which the switch sits on: homing does not mend it.
    pub fn slip_on_shaft(&self, degrees: f64) {
        self.wishes().shaft_deg += degrees;
    }

    /// Pulls the cable for good: the port hangs up. The board keeps its power.
    pub fn unplug(&self) {
        self.wishes().unplug = true;
    }

    pub(super) fn wishes(&self) -> MutexGuard<'_, Injected> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
