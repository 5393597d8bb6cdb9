//! What hangs on the board's pins: motor, arm, vane, switch, lamp.

use arm_logic::{Pins, Settings};

/// The physical truth, in steps of the motor, and what goes wrong with it. The controller sees it through [`Pins`] alone.
#[derive(Clone, Debug)]
pub struct World {
    /// Time, microseconds; wraps.
    pub now_us: u32,
    /// Where the arm truly is, steps; the origin is the world's own.
    pub place: i64,
    /// The vane presses the switch here and below.
    pub edge: i64,
    /// The arm cannot turn past these places, lower and upper.
    pub stops: [i64; 2],
    /// The motor gets pulses and does not turn.
    pub stalled: bool,
    /// The switch shows this, whatever the vane does.
    pub stuck: Option<bool>,
    /// How long the switch bounces after each change, microseconds.
    pub bounce_us: u32,
    /// The lamp's level, permille of full.
    pub lamp_permille: u16,
    /// The motor's current is on.
    pub enabled: bool,
    /// When the last steps came, newest last: time and place after it; kept for tests until they take them.
    pub steps: Vec<(u32, i64)>,
    up: bool,
    changed_us: u32,
    was_pressed: bool,
}

impl World {
    /// The arm stands `above_edge` steps above the vane's edge; it can turn 2 degrees beyond the travel.
    pub fn new(settings: &Settings, above_edge: i64, now_us: u32) -> Self {
        let steps = |mdeg: i32| i64::from(mdeg) * i64::from(settings.steps_per_turn) / 360_000;
        let [lower, upper] = settings.travel_mdeg;
        Self {
            now_us,
            place: above_edge,
            edge: 0,
            stops: [steps(lower - settings.edge_mdeg - 2000), steps(upper - settings.edge_mdeg + 2000)],
            stalled: false,
            stuck: None,
            bounce_us: 0,
            lamp_permille: 0,
            enabled: false,
            steps: Vec::new(),
            up: false,
            // Long ago: the contact rests.
            changed_us: now_us.wrapping_sub(u32::MAX / 2),
            was_pressed: above_edge <= 0,
        }
    }

    /// Turns the arm by `steps` without the controller knowing.
    pub fn slip(&mut self, steps: i64) {
        self.place += steps;
        self.note_switch();
    }

    fn note_switch(&mut self) {
        let pressed = self.place <= self.edge;
        if pressed != self.was_pressed {
            (self.was_pressed, self.changed_us) = (pressed, self.now_us);
        }
    }
}

impl Pins for World {
    fn now_us(&self) -> u32 {
        self.now_us
    }

    fn pressed(&mut self) -> bool {
        let since_us = self.now_us.wrapping_sub(self.changed_us);
        // The contact springs off and on in no order a filter could rely on.
        let bounced = since_us < self.bounce_us && (since_us.wrapping_mul(2_654_435_761) >> 29) < 3;
        self.stuck.unwrap_or(self.was_pressed != bounced)
    }

    fn enable(&mut self) {
        self.enabled = true;
    }

    fn direction(&mut self, up: bool) {
        self.up = up;
    }

    fn step(&mut self) {
        if self.enabled && !self.stalled {
            let next = self.place + if self.up { 1 } else { -1 };
            self.place = next.clamp(self.stops[0], self.stops[1]);
            self.note_switch();
        }
        self.steps.push((self.now_us, self.place));
    }

    fn lamp(&mut self, permille: u16) {
        self.lamp_permille = permille;
    }
}
