//! The few wires an arm needs from its board.

/// Motor driver, home switch, lamp and clock. Every call returns within microseconds.
pub trait Pins {
    /// Microseconds; wraps.
    fn now_us(&self) -> u32;
    /// True while the vane presses (or shades) the home switch, as read now, bounces included.
    fn pressed(&mut self) -> bool;
    /// Switches the motor driver's current on.
    fn enable(&mut self);
    /// Sets the sense of the next steps: true turns to greater angles. At least 10 ms before the first of them.
    fn direction(&mut self, up: bool);
    /// One step: a pulse as long as the motor driver needs.
    fn step(&mut self);
    /// Sets the lamp, permille of full; 0 is off.
    fn lamp(&mut self, permille: u16);
}
