//! Motor, switch and lamp as one machine that a board calls when it asked to be called.

use crate::homing::Phase;
use crate::mechanics::{Mechanics, SAMPLE_US};
use crate::pins::Pins;
use crate::ramp::{Pace, Ramp};
use crate::switch::Switch;
use firmware_protocol::{Faults, Hal, MAX_LAMP_PERMILLE, Motor};

#[derive(Clone, Copy)]
struct Motion {
    ramp: Ramp,
    up: bool,
    due_us: u32,
}

/// The light arm on a board: standing, not homed, its motor without current until the first motion.
pub struct Arm<P> {
    pub(crate) pins: P,
    pub(crate) mechanics: Mechanics,
    pub(crate) switch: Switch,
    /// Steps above angle 0, once homed; from where the arm stood at the start, before.
    pub(crate) count: i32,
    pub(crate) phase: Option<Phase>,
    pub(crate) homed: bool,
    motion: Option<Motion>,
    faults: Faults,
}

impl<P: Pins> Arm<P> {
    /// An arm that has just been powered.
    pub fn new(mut pins: P, mechanics: Mechanics) -> Self {
        let switch = Switch::new(mechanics.steady_us, pins.pressed(), pins.now_us());
        Self { pins, mechanics, switch, count: 0, phase: None, homed: false, motion: None, faults: Faults::default() }
    }

    /// The board's wires.
    pub fn pins(&self) -> &P {
        &self.pins
    }

    /// The board's wires, for whoever owns what hangs on them.
    pub fn pins_mut(&mut self) -> &mut P {
        &mut self.pins
    }

    /// Makes the step that is due, looks at the switch, and says within how many microseconds (at most 1000) to be called
    /// again: from a timer's interrupt, or in a loop.
    ///
    /// A late call makes the motion slower, never faster: the next step counts from this one.
    pub fn poll(&mut self) -> u32 {
        let now_us = self.pins.now_us();
        self.step_if_due(now_us);
        let edge_seen = self.switch.sample(self.pins.pressed(), now_us, self.count);
        if let Some(phase) = self.phase {
            self.home_on(phase);
        } else if self.homed {
            self.check_for_lost_steps(edge_seen);
        }
        match self.motion {
            Some(motion) => until(motion.due_us, now_us).min(SAMPLE_US),
            None => SAMPLE_US,
        }
    }

    fn step_if_due(&mut self, now_us: u32) {
        let Some(motion) = &mut self.motion else { return };
        if until(motion.due_us, now_us) > 0 {
            return;
        }
        self.pins.step();
        self.count += if motion.up { 1 } else { -1 };
        match motion.ramp.next_us() {
            Some(interval_us) => motion.due_us = now_us.wrapping_add(interval_us),
            None => self.motion = None,
        }
    }

    /// The edge must be seen at its place; and well past it the switch can have one level only, should no edge be seen at all.
    fn check_for_lost_steps(&mut self, edge_seen: bool) {
        let Mechanics { edge, tolerance, late, .. } = self.mechanics;
        let pressed = self.switch.pressed();
        let misplaced = edge_seen && (self.switch.edge_count() - edge).abs() > tolerance;
        let above = self.count - edge;
        let missing = if pressed { above > tolerance + late } else { above < -(tolerance + late) };
        if misplaced || missing {
            self.fail(Faults::STEP_LOSS);
        }
    }

    /// The position is not to be trusted any more.
    pub(crate) fn fail(&mut self, fault: Faults) {
        self.faults = self.faults.union(fault);
        self.homed = false;
        self.decelerate();
    }

    /// Starts turning by `steps`; the arm stands.
    pub(crate) fn turn(&mut self, pace: Pace, up: bool, steps: u32) {
        let mut ramp = Ramp::new(pace, steps);
        let Some(first_us) = ramp.next_us() else { return };
        self.pins.enable();
        self.pins.direction(up);
        self.motion = Some(Motion { ramp, up, due_us: self.pins.now_us().wrapping_add(first_us) });
    }

    /// Ends the motion under way after `steps`, or as soon as braking allows.
    pub(crate) fn end_within(&mut self, steps: u32) {
        if let Some(motion) = &mut self.motion {
            motion.ramp.end_within(steps);
        }
    }

    /// True while no step is due.
    pub(crate) fn stands(&self) -> bool {
        self.motion.is_none()
    }
}

/// Time from `now_us` until `due_us`, microseconds; 0 when past. Both wrap.
fn until(due_us: u32, now_us: u32) -> u32 {
    let ahead = due_us.wrapping_sub(now_us);
    if ahead <= u32::MAX / 2 { ahead } else { 0 }
}

impl<P: Pins> Hal for Arm<P> {
    fn motor(&self) -> Motor {
        Motor {
            position_mdeg: self.mechanics.angle_mdeg(self.count),
            moving: !self.stands() || self.phase.is_some(),
            homed: self.homed,
            at_switch: self.switch.pressed(),
            faults: self.faults,
        }
    }

    fn start_move(&mut self, target_mdeg: i32) {
        let target = self.mechanics.count(target_mdeg);
        self.turn(self.mechanics.move_pace, target > self.count, target.abs_diff(self.count));
    }

    fn start_home(&mut self) {
        self.homed = false;
        self.begin_homing();
    }

    fn decelerate(&mut self) {
        self.phase = None;
        self.end_within(0);
    }

    fn set_lamp(&mut self, permille: u16) {
        self.pins.lamp(permille.min(MAX_LAMP_PERMILLE));
    }

    fn clear_faults(&mut self) {
        self.faults = Faults::default();
    }
}
