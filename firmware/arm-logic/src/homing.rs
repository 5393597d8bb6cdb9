//! Homing in two passes: find the switch fast, turn round above it, and measure its edge slowly.

use crate::arm::Arm;
use crate::pins::Pins;
use firmware_protocol::Faults;

/// What the homing under way waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    /// Down, fast: the switch closes.
    Seek,
    /// Up: the switch opens.
    Release,
    /// Up: far enough above the edge.
    Clear,
    /// Down, slowly: the switch closes, at the edge.
    Approach,
    /// Up: clear of the edge, where homing ends.
    PullOff,
}

impl<P: Pins> Arm<P> {
    /// Starts with the pass that the switch of now asks for.
    pub(crate) fn begin_homing(&mut self) {
        if self.switch.pressed() {
            self.enter(Phase::Release, true, self.mechanics.release_steps());
        } else {
            self.enter(Phase::Seek, false, self.mechanics.seek_steps());
        }
    }

    /// Goes on when the switch or the end of a motion says so.
    pub(crate) fn home_on(&mut self, phase: Phase) {
        match (phase, self.switch.pressed(), self.stands()) {
            (Phase::Seek | Phase::Approach, true, false) => self.end_within(0),
            (Phase::Seek, true, true) => self.enter(Phase::Release, true, self.mechanics.release_steps()),
            (Phase::Seek | Phase::Approach, false, true) => self.fail(Faults::HOME_FAILED),
            (Phase::Release, false, false) => {
                self.phase = Some(Phase::Clear);
                self.end_within(self.mechanics.clear);
            }
            (Phase::Release | Phase::Clear, false, true) => {
                self.enter(Phase::Approach, false, self.mechanics.approach_steps());
            }
            (Phase::Approach, true, true) => self.count_from_the_edge(),
            (Phase::Release | Phase::Clear | Phase::PullOff, true, true) => self.fail(Faults::SWITCH_STUCK),
            (Phase::PullOff, false, true) => (self.phase, self.homed) = (None, true),
            (Phase::Seek | Phase::Approach, false, false)
            | (Phase::Release | Phase::Clear | Phase::PullOff, _, false) => {}
        }
    }

    fn count_from_the_edge(&mut self) {
        self.count += self.mechanics.edge - self.switch.edge_count();
        let below = self.count.abs_diff(self.mechanics.edge);
        self.enter(Phase::PullOff, true, self.mechanics.clear + below);
    }

    fn enter(&mut self, phase: Phase, up: bool, steps: u32) {
        let pace = if phase == Phase::Approach { self.mechanics.approach_pace } else { self.mechanics.seek_pace };
        self.phase = Some(phase);
        self.turn(pace, up, steps);
    }
}
