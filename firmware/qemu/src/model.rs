//! What would hang on the pins: an arm that follows every step, and a vane with a true edge.

use arm_logic::Pins;
use cortex_m::peripheral::SYST;

/// QEMU runs the board from its internal oscillator after reset: 12.5 MHz, 25 ticks in 2 us.
const TICKS_IN_2_US: u32 = 25;
/// The timer counts down over 24 bits: 1.34 s a round.
pub const RELOAD: u32 = 0x00ff_ffff;
/// Where the arm stands at the start, steps above the vane's edge.
const START: i32 = 345;

/// Motor, vane and clock.
pub struct Model {
    _clock: SYST,
    last_ticks: u32,
    /// Ticks that do not make up a whole 2 us yet.
    rest_ticks: u32,
    now_us: u32,
    up: bool,
    enabled: bool,
    above_edge: i32,
}

impl Model {
    /// A model of a standing arm; the clock runs.
    pub fn new(clock: SYST) -> Self {
        let last_ticks = SYST::get_current();
        Self { _clock: clock, last_ticks, rest_ticks: 0, now_us: 0, up: false, enabled: false, above_edge: START }
    }

    /// Reads the timer, at least once in each of its rounds; microseconds since the start.
    pub fn tick(&mut self) -> u32 {
        let ticks = SYST::get_current();
        self.rest_ticks += self.last_ticks.wrapping_sub(ticks) & RELOAD;
        self.last_ticks = ticks;
        self.now_us = self.now_us.wrapping_add(self.rest_ticks / TICKS_IN_2_US * 2);
        self.rest_ticks %= TICKS_IN_2_US;
        self.now_us
    }
}

impl Pins for Model {
    fn now_us(&self) -> u32 {
        self.now_us
    }

    fn pressed(&mut self) -> bool {
        self.above_edge <= 0
    }

    fn enable(&mut self) {
        self.enabled = true;
    }

    fn direction(&mut self, up: bool) {
        self.up = up;
    }

    fn step(&mut self) {
        if self.enabled {
            self.above_edge += if self.up { 1 } else { -1 };
        }
    }

    fn lamp(&mut self, _permille: u16) {}
}
